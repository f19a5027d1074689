//! `plantar emulate`: the real firmware feels a recording.

use crate::carrier::{ANSWER, PATIENCE};
use crate::setup::{self, Contact, Wearer, Zeroed};
use crate::summary;
use crate::view::View;
use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use client::{Client, Framed, step_to_json};
use emulation::{COLUMNS, EmulatorConfig};
use emulator::{Board, Electrical, Faulty, Recorded, Time};
use parameters::Parameters;
use plantar::Region;
use plantar::insole::Insole;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::protocol::{Hello, Status, Step, ToDevice, ToHost};
use recording::{Recording, VirtualInsole};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Where `cargo xtask build` puts it.
pub const FIRMWARE: &str = "target/thumbv7em-none-eabihf/firmware/emulated";
/// An insole that streams is never silent for this long.
const SILENCE: Duration = Duration::from_secs(10);

/// Boots the firmware in QEMU, plays a recording into its sensor matrix, and shows what comes over its link.
#[derive(Args)]
pub struct Emulate {
    /// The recording; of at most 256 cells (`plantar import ... --cells 256`).
    recording: PathBuf,
    #[command(flatten)]
    wearer: Wearer,
    #[command(flatten)]
    contact: Contact,
    #[command(flatten)]
    zero: Zeroed,
    /// In real time, or as fast as the emulator can.
    #[arg(long, value_enum, default_value_t = Speed::Real)]
    speed: Speed,
    /// A fault of the sensor's circuit, KIND:WHERE[=VALUE][@SECONDS]; give it again for more. Cells are numbered as in a frame, by
    /// region; rows of the matrix are 16 cells. Kinds: open-cell:17, open-row:3, open-column:5 (no contact), short-cell:17,
    /// short-row:3, short-column:5 (full scale), stuck:17=12000 (this code always), saturate:17 (full scale once loaded),
    /// drift:17=50/s (the zero moves by so many codes), crosstalk:3=0.1 (a row's cells read this part of its most loaded one).
    #[arg(long, value_name = "FAULT")]
    fault: Vec<Electrical>,
    /// End after this many steps.
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
    /// Write the steps, the model's mean error by region and what became of the live frames to this file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// The firmware of the emulated board.
    #[arg(long, value_name = "FILE", default_value = FIRMWARE)]
    firmware: PathBuf,
}

#[derive(Clone, Copy, ValueEnum)]
enum Speed {
    Real,
    Max,
}

/// A recording and the insole that feels it.
pub struct Worn {
    pub recording: Recording,
    pub insole: VirtualInsole,
}

impl Worn {
    /// Reads a recording for the emulated board, and says where it comes from.
    pub fn new(path: &Path, parameters: &Parameters, contact: &Contact, zero: &Zeroed) -> Result<Self> {
        let recording = Recording::read(path)?;
        if recording.cells() > DEVICE_CELLS {
            bail!(
                "{} has {} cells and the insole holds {DEVICE_CELLS}: import it again with --cells {DEVICE_CELLS}",
                path.display(),
                recording.cells()
            );
        }
        println!("{}", recording.source);
        let mut insole = setup::insole(&recording, contact.rule(parameters.identified.as_ref())?)?;
        zero.wear(&mut insole)?;
        // What the board would refuse is refused here, where there is room to say it.
        let accepted = Insole::<f32, DEVICE_CELLS>::new().set_up(insole.setup, insole.cells.iter().copied());
        accepted.with_context(|| format!("{} cannot be worn", path.display()))?;
        Ok(Self { recording, insole })
    }
}

/// What a whole walk gave.
struct Outcome {
    steps: Vec<Step>,
    status: Status,
}

impl Emulate {
    pub fn run(&self) -> Result<()> {
        let parameters = self.wearer.parameters()?;
        let Worn { recording, insole } = Worn::new(&self.recording, &parameters, &self.contact, &self.zero)?;
        let tissue = parameters.tissue();
        let head = EmulatorConfig::new(insole.setup);
        let cells = insole.cells.clone();
        let seconds = recording.frames() as f64 / recording.rate_hz;
        let scans = insole.frames(&recording) as u32;
        if let Some(fault) = self.fault.iter().find(|fault| fault.cells(cells.len()).next().is_none()) {
            bail!(
                "no {} here: {} has cells 0 to {}, in rows of {COLUMNS}",
                fault.place,
                self.recording.display(),
                cells.len() - 1
            );
        }
        let zeros: Vec<u16> = cells.iter().map(|cell| cell.calibration.offset).collect();
        let period_us = insole.setup.period_us;
        let walk = Faulty::new(Recorded::new(recording, insole), self.fault.clone(), period_us, zeros);
        let time = match self.speed {
            Speed::Real => Time::Real,
            Speed::Max => Time::Max,
        };
        let board = Board::start(&self.firmware, &head, &cells, time, walk)?;
        let link = board.link()?;
        link.set_read_timeout(Some(PATIENCE))?;
        let mut client = Client::connect(Framed::new(link), ANSWER)?;
        client.set_tissue(&tissue)?;
        let mut view = View::open(client.hello())?;
        let start = Instant::now();
        let outcome = self.follow(&board, &mut client, &mut view, scans);
        view.close();
        let Outcome { steps, status } = outcome?;
        let counters = client.counters();
        summary::print(&steps);
        summary::print_faults_of(&mut client);
        println!(
            "{} frames of {seconds:.1} s in {:.1} s; live frames: {} sent, {} received, {} lost, {} damaged; scans missed: {}, overrun: {}",
            status.frames,
            start.elapsed().as_secs_f64(),
            counters.frames_sent,
            counters.frames_received,
            counters.frames_lost,
            counters.crc_errors,
            status.frames_missed,
            status.frames_overrun
        );
        if let Some(path) = &self.json {
            let errors: serde_json::Map<_, _> = Region::ALL
                .iter()
                .enumerate()
                .map(|(i, region)| (region.name().into(), summary::model_error_percent(&steps, i).into()))
                .collect();
            let steps: Vec<_> = steps.iter().map(step_to_json).collect();
            let outcome = serde_json::json!({ "steps": steps, "link": counters, "model_error_percent": errors });
            let text = serde_json::to_string_pretty(&outcome)? + "\n";
            std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(())
    }

    /// Receives until the walk is over and everything of it has arrived, or the user or a limit ends it.
    fn follow(
        &self,
        board: &Board,
        client: &mut Client<Framed<TcpStream>>,
        view: &mut View,
        scans: u32,
    ) -> Result<Outcome> {
        client.stream()?;
        board.play();
        let mut steps = Vec::new();
        let mut asked = false;
        let mut heard = Instant::now();
        loop {
            let mut is_silent = false;
            match client.receive()? {
                Some(ToHost::Live(live)) => view.live(&live, client.counters())?,
                Some(ToHost::Step(step)) => {
                    client.send(ToDevice::Acknowledge { step: step.step })?;
                    if self.steps.is_none_or(|limit| steps.len() < limit) {
                        view.step(&step)?;
                        steps.push(step);
                    }
                }
                // A status comes after all that was due before it.
                Some(ToHost::Status(status)) => {
                    let done = status.frames + status.frames_missed + status.frames_overrun;
                    if done >= scans || self.has_enough(&steps) || view.wants_to_end()? {
                        return Ok(Outcome { steps, status });
                    }
                    asked = false;
                }
                Some(ToHost::Hello(hello)) => bail!(restarted(&hello)),
                // Answers to what is not asked here.
                Some(_) => {}
                None if heard.elapsed() > SILENCE => {
                    bail!(restarted(client.reconnect(ANSWER).context("the insole has fallen silent")?))
                }
                None => is_silent = true,
            }
            if !is_silent {
                heard = Instant::now();
            }
            if !asked && (board.plant().scans() >= scans || self.has_enough(&steps) || view.wants_to_end()?) {
                asked = true;
                client.send(ToDevice::GetStatus)?;
            }
        }
    }

    fn has_enough(&self, steps: &[Step]) -> bool {
        self.steps.is_some_and(|limit| steps.len() >= limit)
    }
}

fn restarted(hello: &Hello) -> String {
    let why = hello.last_panic.as_deref().unwrap_or("no fault reported");
    format!("the insole restarted ({:?}, {why}): its steps so far are lost", hello.reset)
}

//! `plantar emulate`: plays a recording into the real firmware.

use crate::setup::{self, ContactArgs, WearerArgs, ZeroArgs};
use crate::summary;
use crate::view::View;
use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use client::{Client, Framed, READ_TIMEOUT, ReconnectPolicy, step_to_json};
use emulation::{COLUMNS, EmulatorConfig};
use emulator::{Board, Faulty, Recorded, SensorFault, Time};
use parameters::Parameters;
use plantar::Region;
use plantar::insole::Insole;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::{Hello, Status, Step, ToDevice, ToHost};
use recording::{Recording, VirtualInsole};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The path at which `cargo xtask build` writes the firmware of the emulated board.
pub const FIRMWARE: &str = "target/thumbv7em-none-eabihf/firmware/emulated";
/// An insole with a live stream is never silent for this long, however slow the emulator is.
const SILENCE: Duration = Duration::from_secs(10);

/// Starts the firmware in QEMU, plays a recording into its sensor matrix, and shows the messages from its link.
#[derive(Args)]
pub struct Emulate {
    /// The recording, with at most 256 cells (`plantar import ... --cells 256`).
    recording: PathBuf,
    #[command(flatten)]
    wearer: WearerArgs,
    #[command(flatten)]
    contact: ContactArgs,
    #[command(flatten)]
    zero: ZeroArgs,
    /// Play in real time, or as fast as the emulator runs.
    #[arg(long, value_enum, default_value_t = Speed::Real)]
    speed: Speed,
    /// An electrical fault of the sensor, KIND:PLACE[=VALUE][@SECONDS]; repeat the option for more. Cells are numbered as in a
    /// frame, by region; a row of the matrix has 16 cells. Kinds: open-cell:17, open-row:3, open-column:5 (no contact),
    /// short-cell:17, short-row:3, short-column:5 (full scale), stuck:17=12000 (always this code), saturate:17 (full scale once
    /// loaded), drift:17=50/s (the baseline changes by so many codes per second), crosstalk:3=0.1 (the cells of a row also read
    /// this fraction of its most loaded cell).
    #[arg(long, value_name = "FAULT")]
    fault: Vec<SensorFault>,
    /// End after this many steps.
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
    /// Write the steps, the mean error of the model per region and the counters of the live frames to this file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the firmware's log to this file, a line per message: time, level and text.
    #[cfg(feature = "log")]
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// The firmware of the emulated board.
    #[arg(long, value_name = "FILE", default_value = FIRMWARE)]
    firmware: PathBuf,
}

#[derive(Clone, Copy, ValueEnum)]
enum Speed {
    Real,
    Max,
}

/// A recording and the virtual insole that measures it.
pub struct EmulatedInsole {
    pub recording: Recording,
    pub insole: VirtualInsole,
}

impl EmulatedInsole {
    /// Reads a recording for the emulated board, and prints its source.
    pub fn new(path: &Path, parameters: &Parameters, contact: &ContactArgs, zero: &ZeroArgs) -> Result<Self> {
        let recording = Recording::read(path)?;
        if recording.cells() > DEVICE_CELLS {
            bail!(
                "{} has {} cells and an insole has at most {DEVICE_CELLS}: import it again with --cells {DEVICE_CELLS}",
                path.display(),
                recording.cells()
            );
        }
        println!("{}", recording.source);
        let mut insole = setup::insole(&recording, contact.rule(parameters.identified.as_ref())?)
            .with_context(|| path.display().to_string())?;
        zero.apply(&mut insole)?;
        // An invalid set-up is refused here with its reason; the board could not report it.
        let accepted = Insole::<f32, DEVICE_CELLS>::new().set_up(insole.setup, insole.cells.iter().copied());
        accepted.with_context(|| format!("{} cannot be played into an insole", path.display()))?;
        Ok(Self { recording, insole })
    }
}

/// The result of a walk.
struct Outcome {
    steps: Vec<Step>,
    status: Status,
}

impl Emulate {
    pub fn run(&self) -> Result<()> {
        let parameters = self.wearer.parameters()?;
        let EmulatedInsole { recording, insole } =
            EmulatedInsole::new(&self.recording, &parameters, &self.contact, &self.zero)?;
        let tissue = parameters.tissue();
        let config = EmulatorConfig::new(insole.setup);
        let cells = insole.cells.clone();
        let seconds = recording.frames() as f64 / recording.rate_hz;
        let scans = insole.frames(&recording) as u32;
        if let Some(fault) = self.fault.iter().find(|fault| fault.cells(cells.len()).next().is_none()) {
            bail!(
                "the matrix has no {}: {} has cells 0 to {}, in rows of {COLUMNS}",
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
        let board = Board::start(&self.firmware, &config, &cells, time, walk)?;
        let link = board.link()?;
        link.set_read_timeout(Some(READ_TIMEOUT))?;
        let result = self.walk(&board, link, &tissue, seconds, scans);
        // The log explains a failure, too.
        #[cfg(feature = "log")]
        self.write_log(&board)?;
        result
    }

    /// Streams the walk, and prints and writes its outcome.
    fn walk(&self, board: &Board, link: TcpStream, tissue: &Tissue, seconds: f64, scans: u32) -> Result<()> {
        let mut client = Client::connect(Framed::new(link), ReconnectPolicy::STREAM.answer)?;
        client.set_tissue(tissue)?;
        let mut view = View::open(client.hello())?;
        let start = Instant::now();
        let outcome = self.follow(board, &mut client, &mut view, scans);
        view.close();
        let Outcome { steps, status } = outcome?;
        let counters = client.counters();
        summary::print(&steps);
        summary::print_faults_of(&mut client);
        println!(
            "{} frames of {seconds:.1} s in {:.1} s; live frames: {} sent, {} received, {} lost, {} damaged; scans \
             missed: {}, overrun: {}",
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

    #[cfg(feature = "log")]
    fn write_log(&self, board: &Board) -> Result<()> {
        let Some(path) = &self.log else { return Ok(()) };
        let lines: String = board.log(&self.firmware)?.iter().map(|entry| format!("{entry}\n")).collect();
        std::fs::write(path, lines).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Receives until the walk is over and all of its messages arrived, or until the user or a limit ends it.
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
        let mut is_status_pending = false;
        let mut last_message = Instant::now();
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
                // A status follows all messages that were due before it.
                Some(ToHost::Status(status)) => {
                    let done = status.frames + status.frames_missed + status.frames_overrun;
                    if done >= scans || self.has_enough(&steps) || view.wants_to_end()? {
                        return Ok(Outcome { steps, status });
                    }
                    is_status_pending = false;
                }
                Some(ToHost::Hello(hello)) => bail!(restarted(&hello)),
                // Answers to requests that are not sent here.
                Some(_) => {}
                None if last_message.elapsed() > SILENCE => {
                    bail!(restarted(
                        client.reconnect(ReconnectPolicy::STREAM.probe).context("the insole has stopped sending")?
                    ))
                }
                None => is_silent = true,
            }
            if !is_silent {
                last_message = Instant::now();
            }
            if !is_status_pending
                && (board.plant().scans() >= scans || self.has_enough(&steps) || view.wants_to_end()?)
            {
                is_status_pending = true;
                client.send(ToDevice::GetStatus)?;
            }
        }
    }

    fn has_enough(&self, steps: &[Step]) -> bool {
        self.steps.is_some_and(|limit| steps.len() >= limit)
    }
}

fn restarted(hello: &Hello) -> String {
    let reason = hello.last_panic.as_deref().unwrap_or("no fault reported");
    format!("the insole restarted (reset reason: {}, {reason}): its steps so far are lost", hello.reset.name())
}

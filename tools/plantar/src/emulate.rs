//! `plantar emulate`: plays a recording into the real firmware, which runs in QEMU.

mod identification;

use crate::paths::check_written;
use crate::records::Records;
use crate::replay::write_text;
use crate::setup::{self, InsoleArgs};
use crate::summary;
use crate::view::View;
use anyhow::{Context, Result, bail, ensure};
use clap::{Args, ValueEnum};
use client::{Client, Framed, READ_TIMEOUT, ReconnectPolicy, alert_to_json, bout_to_json, step_to_json};
use emulation::{COLUMNS, EmulatorConfig};
use emulator::{Board, Faulty, Link, Recorded, SensorFault, Time};
use identification::Identification;
use parameters::{DeformationScale, InsoleSize, Parameters};
use plantar::Region;
use plantar::insole::Insole;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::protocol::{Hello, LoadRecord, Status, Step, ToDevice, ToHost};
use recording::{Recording, VirtualInsole};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The path at which `cargo xtask build` writes the firmware of the emulated board.
const FIRMWARE: &str = "target/thumbv7em-none-eabihf/firmware/emulated";
/// Time without a message after which an insole that sends a live stream counts as failed; long enough for a slow emulator.
const SILENCE: Duration = Duration::from_secs(10);

/// Starts the firmware in QEMU, plays a recording into its sensor matrix, and shows the messages that the firmware sends.
#[derive(Args)]
pub struct Emulate {
    /// The recording, with at most 256 cells (`plantar import ... --cells 256`).
    recording: PathBuf,
    #[command(flatten)]
    insole: InsoleArgs,
    /// Play in real time (real), or as fast as the emulator runs (max).
    #[arg(long, value_enum, default_value_t = Speed::Real)]
    speed: Speed,
    /// Inject an electrical fault of the sensor, KIND:PLACE[=VALUE][@SECONDS]. It begins SECONDS after the start of the walk, or
    /// at once. Repeat the option for several faults. Examples of all kinds: open-cell:17 (no contact); open-row:3,
    /// open-column:5 (an interrupted line); short-cell:17, short-row:3, short-column:5 (full scale); stuck:17=12000 (always this
    /// code); saturate:17 (full scale already under a small load); drift:17=50/s (the code of the cell changes by this number
    /// per second); crosstalk:3=0.1 (each cell of row 3 also reads this fraction of the load of the row's most loaded other
    /// cell). PLACE is the number of a cell, row or column, from 0. The virtual insole numbers its cells by region; each row of
    /// its matrix has 16 cells.
    #[arg(long, value_name = "FAULT")]
    fault: Vec<SensorFault>,
    /// Identify the wearer first: record all cells that the insole sends in the first steps, identify the parameters from this
    /// recording, with the tissue thickness that is typical of --size, and send them to the insole. The table and --json have
    /// later steps only. FOLDER receives recording, parameters and report.
    #[arg(long, value_name = "FOLDER", conflicts_with = "params")]
    identify: Option<PathBuf>,
    /// With --identify: identify the wearer from the first N steps.
    #[arg(long, value_name = "N", default_value = "24", requires = "identify")]
    identify_steps: NonZeroUsize,
    /// End the walk after this number of steps. With --identify, only steps after the identification count.
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
    /// Write the steps, load bouts and alerts, the mean error of the model in each region, and the counters of the link to this
    /// JSON file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the firmware's log to this file. Each line has time, level and text of a message.
    #[cfg(feature = "log")]
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// The firmware file of the emulated board, from `cargo xtask build`. QEMU lets the firmware read and write your files and
    /// run programs: name only a file that you have built [default: the one in the repository of this program].
    #[arg(long, value_name = "FILE")]
    firmware: Option<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Speed {
    Real,
    Max,
}

/// A recording, and the virtual insole that converts its pressures to the codes of a sensor.
pub struct EmulatedInsole {
    pub recording: Recording,
    pub insole: VirtualInsole,
}

impl EmulatedInsole {
    /// Reads a recording for the emulated board, and prints the recording's source.
    pub fn new(path: &Path, parameters: &Parameters, options: &InsoleArgs) -> Result<Self> {
        let recording = Recording::read(path)?;
        if recording.cells() > DEVICE_CELLS {
            bail!(
                "{} has {} cells and an insole has at most {DEVICE_CELLS}: import it again with --cells {DEVICE_CELLS}",
                path.display(),
                recording.cells()
            );
        }
        println!("{}", recording.source);
        let insole = options.insole(&(&recording).into(), options.rule(parameters)?, path)?;
        // Refuses an invalid set-up before the emulator starts. The board would only report the reason in its hello, and
        // measure nothing.
        let accepted = Insole::<f32, DEVICE_CELLS>::new().set_up(insole.setup, insole.cells.iter().copied());
        accepted.with_context(|| format!("{} cannot be played into an insole", path.display()))?;
        Ok(Self { recording, insole })
    }
}

/// The steps, load bouts and alerts of a walk, and the insole's counters after the walk.
struct Outcome {
    records: Records,
    status: Status,
}

/// The firmware file that the option --firmware names or, without it, that in the repository of this program.
///
/// # Errors
/// See [`in_repository`].
pub fn firmware(named: Option<&Path>) -> Result<PathBuf> {
    named.map_or_else(|| in_repository(&std::env::current_exe()?, FIRMWARE, "--firmware"), |path| Ok(path.into()))
}

/// The path of a built file or folder in the repository of `program`, which is in the folder `target` of the repository. The
/// current folder is not searched, because it may contain files of someone else. `option` is the option that names another path.
///
/// # Errors
/// If the program is elsewhere.
pub fn in_repository(program: &Path, path: &str, option: &str) -> Result<PathBuf> {
    let targets = program.ancestors().filter(|folder| folder.file_name().is_some_and(|name| name == "target"));
    let repository = targets.filter_map(Path::parent).find(|folder| folder.join("Cargo.lock").is_file());
    let repository = repository
        .with_context(|| format!("this program is not in the folder `target` of its repository: give {option}"))?;
    Ok(repository.join(path))
}

impl Emulate {
    pub fn run(&self) -> Result<()> {
        self.check_files()?;
        let parameters = match self.identify {
            Some(_) => Parameters::typical(InsoleSize::default()),
            None => self.insole.wearer.parameters()?,
        };
        let EmulatedInsole { recording, insole } = EmulatedInsole::new(&self.recording, &parameters, &self.insole)?;
        let config = EmulatorConfig::new(insole.setup);
        let cells = insole.cells.clone();
        let duration_s = recording.frames() as f64 / recording.rate_hz;
        let scans = insole.frames(&recording) as u32;
        if let Some(fault) = self.fault.iter().find(|fault| fault.cells(cells.len()).next().is_none()) {
            bail!(
                "--fault: the matrix has no {}: {} has cells 0 to {}, in rows of {COLUMNS}",
                fault.place,
                self.recording.display(),
                cells.len() - 1
            );
        }
        let zeros: Vec<u16> = cells.iter().map(|cell| cell.offset).collect();
        let period_us = insole.setup.period_us;
        let walk = Faulty::new(Recorded::new(recording, insole), self.fault.clone(), period_us, zeros);
        let time = match self.speed {
            Speed::Real => Time::Real,
            Speed::Max => Time::Fastest,
        };
        let board = Board::start(&firmware(self.firmware.as_deref())?, &config, &cells, time, walk)?;
        let mut link = board.link()?;
        link.set_read_timeout(Some(READ_TIMEOUT))?;
        let result = self.walk(&board, link, &parameters, duration_s, scans);
        // The log is written even after a failure, because it can explain the failure.
        #[cfg(feature = "log")]
        self.write_log(&board)?;
        result
    }

    /// Checks that no output replaces an input or another output.
    fn check_files(&self) -> Result<()> {
        let mut read = self.insole.inputs(std::slice::from_ref(&self.recording));
        read.push(firmware(self.firmware.as_deref())?);
        let written = [
            self.json.as_deref(),
            #[cfg(feature = "log")]
            self.log.as_deref(),
        ];
        let identified: Vec<PathBuf> = self.identify.iter().flat_map(|folder| Identification::files(folder)).collect();
        let identified = identified.iter().map(|path| Some(path.as_path()));
        check_written(&read, &written.into_iter().chain(identified).collect::<Vec<_>>())
    }

    /// Plays the walk, and prints and writes its outcome. With --identify, `parameters` are not used. `duration_s` is the
    /// duration of the recording, `scans` the number of scans of the walk.
    fn walk(&self, board: &Board, link: Link, parameters: &Parameters, duration_s: f64, scans: u32) -> Result<()> {
        let mut client = Client::connect(Framed::new(link), ReconnectPolicy::STREAM.answer)?;
        let mut identification = match &self.identify {
            Some(folder) => Some(Identification::begin(&mut client, folder, self.identify_steps.get())?),
            None => {
                client.set_tissue(&parameters.tissue())?;
                None
            }
        };
        let mut view = View::open(client.hello())?;
        let start = Instant::now();
        let outcome = self.follow(board, &mut client, &mut view, &mut identification, scans);
        view.close();
        let Outcome { records, status } = outcome?;
        let steps = &records.steps;
        if let Some(identification) = &identification {
            ensure!(
                identification.has_sent_parameters(),
                "the walk ended, or was ended by a key, before the insole had sent {} steps to identify the wearer from: let \
                 it play to its end, play a longer recording, or use fewer steps with --identify-steps",
                self.identify_steps
            );
            ensure!(
                !steps.is_empty(),
                "no step followed the {} steps from which the wearer was identified: play a longer recording, or use fewer \
                 steps with --identify-steps",
                self.identify_steps
            );
            println!(
                "The insole evaluated the following steps with the parameters that were identified from the earlier steps."
            );
        }
        let counters = client.counters();
        // An identification in this command has no measurements of the tissue.
        let scales = if identification.is_none() { parameters.deformation } else { DeformationScale::ALL_ASSUMED };
        records.print(&scales);
        if identification.is_none() {
            setup::note_unless_applicable(parameters, self.insole.wearer.size, steps);
        }
        summary::print_faults_of(&mut client);
        println!(
            "the insole processed {} frames of a walk of {duration_s:.1} s in {:.1} s; {} scans were missed or \
             incomplete, {} were skipped because processing was late, and {} because the insole was not worn; live frames: \
             {} sent, {} received, {} lost; {} messages of any kind were damaged",
            status.frames,
            start.elapsed().as_secs_f64(),
            status.frames_missed,
            status.frames_overrun,
            status.frames_skipped,
            counters.frames_sent,
            counters.frames_received,
            counters.frames_lost,
            counters.crc_errors
        );
        if let Some(path) = &self.json {
            let errors: serde_json::Map<_, _> = Region::ALL
                .iter()
                .enumerate()
                .map(|(i, region)| (region.name().into(), summary::model_error_percent(steps, i).into()))
                .collect();
            let steps: Vec<_> = steps.iter().map(step_to_json).collect();
            let bouts: Vec<_> = records.bouts.iter().map(bout_to_json).collect();
            let alerts: Vec<_> = records.alerts.iter().map(alert_to_json).collect();
            let outcome = serde_json::json!({
                "steps": steps,
                "bouts": bouts,
                "alerts": alerts,
                "link": counters,
                "model_error_percent": errors,
            });
            write_text(path, &serde_json::to_string_pretty(&outcome)?)?;
        }
        Ok(())
    }

    #[cfg(feature = "log")]
    fn write_log(&self, board: &Board) -> Result<()> {
        let Some(path) = &self.log else { return Ok(()) };
        let lines: String =
            board.log(&firmware(self.firmware.as_deref())?)?.iter().map(|entry| format!("{entry}\n")).collect();
        crate::fit::write(path, lines.as_bytes())
    }

    /// Receives messages until the walk is over and all of its messages arrived, or until the user ends the command or --steps is
    /// reached.
    fn follow(
        &self,
        board: &Board,
        client: &mut Client<Framed<Link>>,
        view: &mut View,
        identification: &mut Option<Identification>,
        scans: u32,
    ) -> Result<Outcome> {
        client.stream()?;
        board.play();
        let mut records = Records::default();
        let mut is_status_pending = false;
        let mut last_message = Instant::now();
        // The view is replaced after the identification, and the new one does not know whether the user pressed a key before.
        let mut is_ended_by_user = false;
        // The messages that arrived during the identification.
        let mut arrived = Vec::new().into_iter();
        loop {
            is_ended_by_user |= view.wants_to_end()?;
            let mut is_silent = false;
            let message = arrived.next().map_or_else(|| client.receive(), |message| Ok(Some(message)));
            if message.is_err() && view.wants_to_end()? {
                // A signal from the keyboard or a script also ends the emulator.
                bail!("ended before the insole had reported its status");
            }
            match message? {
                Some(ToHost::Live(live)) => view.live(&live, client.counters())?,
                Some(ToHost::Cells(frame)) => {
                    if let Some(identification) = identification {
                        identification.frame(&frame);
                    }
                }
                Some(ToHost::Step(step)) => {
                    client.send(ToDevice::Acknowledge { number: step.step })?;
                    let is_reported = identification.as_mut().is_none_or(|identification| identification.count(&step));
                    if let Some(identification) = identification.as_mut().filter(|_| !is_reported) {
                        view.step(&step);
                        if identification.is_due() {
                            view.close();
                            board.plant().hold(true);
                            arrived = identification.identify(client, &self.insole)?.into_iter();
                            board.plant().hold(false);
                            *view = View::open(client.hello())?;
                        }
                    } else if self.steps.is_none_or(|limit| records.steps.len() < limit) {
                        view.step(&step);
                        records.steps.push(step);
                    }
                }
                Some(message) if let Some(record) = LoadRecord::of(&message) => {
                    client.send(ToDevice::Acknowledge { number: record.number() })?;
                    view.load_record(&record, Some(Duration::ZERO));
                    records.push(&record);
                }
                // The insole sends its status after all messages that were due before, so none of them is missing.
                Some(ToHost::Status(status)) => {
                    let past_scans = status.frame_times();
                    if past_scans >= scans || self.has_enough(&records.steps) || is_ended_by_user {
                        return Ok(Outcome { records, status });
                    }
                    is_status_pending = false;
                }
                Some(ToHost::Hello(hello)) => bail!(restart_message("began another session during the walk", &hello)),
                // The other messages answer requests that this command does not send.
                Some(_) => {}
                None if last_message.elapsed() > SILENCE => {
                    let event = format!("sent nothing for more than {} s", SILENCE.as_secs());
                    let hello =
                        client.reconnect(ReconnectPolicy::STREAM.probe).context("the insole has stopped sending")?;
                    bail!(restart_message(&event, hello))
                }
                None => is_silent = true,
            }
            if !is_silent {
                last_message = Instant::now();
            }
            if !is_status_pending
                && (board.plant().scans() >= scans || self.has_enough(&records.steps) || is_ended_by_user)
            {
                is_status_pending = true;
                client.send(ToDevice::GetStatus)?;
            }
        }
    }

    /// True if these are as many steps as --steps requests.
    fn has_enough(&self, steps: &[Step]) -> bool {
        self.steps.is_some_and(|limit| steps.len() >= limit)
    }
}

/// The error message for an insole that may have restarted during the walk. `event` states what the insole did.
fn restart_message(event: &str, hello: &Hello) -> String {
    let reason = hello.fault.as_deref().unwrap_or("no failure reported");
    format!(
        "the insole {event}, and may have restarted (last reset: {}, {reason}), so its steps are not shown: run the command \
         again",
        hello.reset.name()
    )
}

#[cfg(test)]
mod tests {
    use super::in_repository;
    use std::fs;

    #[test]
    fn only_the_repository_that_contains_the_program_is_searched() {
        let folder = tempfile::tempdir().expect("a folder");
        let found = |program: &str| {
            let found = in_repository(&folder.path().join(program), "target/firmware", "--firmware");
            found.map_err(|error| error.to_string())
        };
        // A program that was copied to a folder below `target`, without the repository.
        let copied = found("home/target/plantar").expect_err("no repository");
        assert!(copied.contains("give --firmware"), "{copied}");
        fs::create_dir(folder.path().join("home")).expect("a folder");
        fs::write(folder.path().join("home/Cargo.lock"), "").expect("a file");
        assert_eq!(found("home/target/release/plantar"), Ok(folder.path().join("home/target/firmware")));
        assert!(found("home/bin/plantar").is_err(), "the program is not in `target`");
    }
}

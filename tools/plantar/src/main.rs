//! The command line of Plantar.

mod calibrate;
mod carrier;
mod cells;
mod cohort;
mod emulate;
#[cfg(feature = "export")]
mod export;
mod fit;
mod frames;
mod gait;
mod identify;
mod import;
mod info;
mod insole;
mod monitor;
mod params;
mod paths;
mod people;
mod picture;
mod record;
mod records;
mod repeat;
mod replay;
#[cfg(feature = "serve")]
mod serve;
mod setup;
mod signals;
mod summary;
mod tables;
mod update;
mod view;
mod zero;

use clap::{Parser, Subcommand};
use std::io::{self, Write};
use std::panic::{catch_unwind, resume_unwind};
use std::process::ExitCode;

/// Regional loads, contact ellipses and tissue deformation from instrumented insoles.
///
/// A recording is one Parquet file for one foot. Import one, inspect it,
/// replay it on this computer, or play it into the emulated insole; the
/// computed steps are the same:
///
///   plantar import csv --layout layout.csv --frames frames.csv \
///       --side left --out walk.parquet
///   plantar info walk.parquet
///   plantar zero standing.parquet --out zero.toml
///   plantar fit walk.parquet --out params.toml --report report.html
///   plantar cohort study --out table --report cohort.html
///   plantar repeat study --csv repeatability.csv
///   plantar replay walk.parquet --params params.toml --json steps.json
///   plantar emulate walk.parquet
///   plantar export c3d walk.parquet --out walk.c3d
///   plantar gait walk.plantar --json gait.json
///   plantar params push params.toml --serial /dev/ttyACM0
///   plantar identify --serial /dev/ttyACM0 --out me
///   plantar insole name --serial-number P-0001 --serial /dev/ttyACM0
///   plantar calibrate measure --pressures 0,50,100,200,400,200,100,50,0 \
///       --serial /dev/ttyACM0 --out P-0001
///   plantar monitor --serial /dev/ttyACM0
///   plantar monitor --ble left
///   plantar record --serial /dev/ttyACM0 --out session
///   plantar serve --serial /dev/ttyACM0
///   plantar update insole.bin --serial /dev/ttyACM0
///
/// In the help of the commands, "the paper" is DeBerardinis, Dufek, Trabia:
/// "A viscoelastic ellipsoidal model of the mechanics of plantar tissues",
/// J. Biomech. 92 (2019) 137-145. It describes the model of the tissue.
#[derive(Parser)]
#[command(name = "plantar", version = env!("PLANTAR_VERSION"), verbatim_doc_comment)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Convert data from another system to a recording, or compute an example.
    #[command(subcommand)]
    Import(import::Import),
    Info(info::Info),
    Zero(zero::Zero),
    Replay(replay::Replay),
    Fit(fit::Fit),
    /// Determine the calibration of an insole's cells from known pressures.
    ///
    /// The pressures must act on the whole insole, as those of the bladder of a calibration device. docs/calibration.md describes
    /// the procedure.
    #[command(subcommand)]
    Calibrate(calibrate::Calibrate),
    Identify(identify::Identify),
    Cohort(cohort::Cohort),
    Repeat(repeat::Repeat),
    Emulate(emulate::Emulate),
    /// Write recordings in the formats of other programs.
    ///
    /// The exports contain what the insole's own code computes from a recording, as in `plantar replay`. docs/exporting.md
    /// describes the formats.
    #[cfg(feature = "export")]
    #[command(subcommand)]
    Export(export::Export),
    Gait(gait::GaitCommand),
    Monitor(monitor::Monitor),
    Record(record::Record),
    #[cfg(feature = "serve")]
    Serve(serve::Serve),
    /// Write, show, send and read tissue parameters.
    #[command(subcommand)]
    Params(params::Params),
    Update(update::Update),
    /// Show, name, set, zero, calibrate, erase and restart an insole, and set its alerts.
    #[command(subcommand)]
    Insole(insole::Insole),
}

/// Exit status of a command that completed only a part of its work.
const PARTIAL: u8 = 3;

/// Exit status after the program that reads the output has ended: the one that a shell reports for the signal SIGPIPE.
const OUTPUT_CLOSED: u8 = 128 + 13;

/// The beginning of the panic with which the standard library reports output that cannot be written.
const UNWRITABLE: &str = "failed printing to stdout: ";

/// Lets the program end without a message if the program that reads its output has ended, as in `plantar info walk.parquet |
/// head`, and with an error if the output cannot be written for another reason. The standard library reports both as panics. A
/// panic of the main thread continues to [`main`], so that an emulated board is switched off.
fn handle_unwritable_output() {
    let report_panic = std::panic::take_hook();
    let main_thread = std::thread::current().id();
    std::panic::set_hook(Box::new(move |panic| {
        let Some(problem) = panic.payload_as_str().and_then(|text| text.strip_prefix(UNWRITABLE)) else {
            return report_panic(panic);
        };
        let is_closed = problem.starts_with("Broken pipe");
        if !is_closed {
            // This output may be impossible, too.
            let _ = writeln!(io::stderr(), "error: the output cannot be written: {problem}");
        }
        if std::thread::current().id() != main_thread {
            std::process::exit(if is_closed { OUTPUT_CLOSED.into() } else { 1 });
        }
    }));
}

fn main() -> ExitCode {
    handle_unwritable_output();
    catch_unwind(run).unwrap_or_else(|panic| {
        match panic.downcast_ref::<String>().and_then(|text| text.strip_prefix(UNWRITABLE)) {
            Some(problem) if problem.starts_with("Broken pipe") => ExitCode::from(OUTPUT_CLOSED),
            Some(_) => ExitCode::FAILURE,
            None => resume_unwind(panic),
        }
    })
}

/// Runs the command that the arguments name.
fn run() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Import(import) => import.run(),
        Command::Info(info) => info.run(),
        Command::Zero(zero) => zero.run(),
        Command::Replay(replay) => replay.run(),
        Command::Fit(fit) => return status(fit.run()),
        Command::Calibrate(calibrate) => return status(calibrate.run()),
        Command::Identify(identify) => return status(identify.run()),
        Command::Cohort(cohort) => return status(cohort.run()),
        Command::Repeat(repeat) => return status(repeat.run()),
        Command::Emulate(emulate) => emulate.run(),
        #[cfg(feature = "export")]
        Command::Export(export) => export.run(),
        Command::Gait(gait) => gait.run(),
        Command::Update(update) => update.run(),
        Command::Monitor(monitor) => monitor.run(),
        Command::Record(record) => record.run(),
        #[cfg(feature = "serve")]
        Command::Serve(serve) => serve.run(),
        Command::Params(params) => params.run(),
        Command::Insole(insole) => insole.run(),
    };
    status(result.map(|()| true))
}

/// Prints a text on stderr that may quote a file or the name of one. Control characters, which would have an effect on the
/// terminal, are replaced.
fn print_note(text: &str) {
    eprintln!("{}", text.replace(|c: char| c.is_control() && c != '\n', " "));
}

/// Converts the result of a command to its exit status. The value is true if all of the work was done.
fn status(is_complete: anyhow::Result<bool>) -> ExitCode {
    match is_complete {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(PARTIAL),
        Err(error) => {
            print_note(&format!("error: {error:#}"));
            ExitCode::FAILURE
        }
    }
}

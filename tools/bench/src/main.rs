//! The benchmarks of the data path and of the host programs.

mod accuracy;
mod bytes;
mod cells;
mod closed_loop;
mod cohort;
mod idle;
mod identify;
mod instructions;
mod python;
mod replay;
mod replay_file;
mod stack;
mod walkers;
mod wear;

use anyhow::Result;
use bench::Figures;
use clap::Parser;
use std::path::PathBuf;

/// Runs the benchmarks and prints the figures, among them instructions for a frame, accuracy of single precision, lengths of
/// messages, speed of a replay compared with NumPy, and identification compared with SciPy.
#[derive(Parser)]
struct Arguments {
    /// The firmware file of the emulated board.
    #[arg(long)]
    firmware: PathBuf,
    /// A Python interpreter with NumPy and SciPy.
    #[arg(long, required_unless_present = "stack_json")]
    python: Option<PathBuf>,
    /// A Python interpreter with the package of this project and with pandas. With this option, a replay from a file is
    /// compared with pandas and, with `--jiku`, `plantar cohort` with `python -m plantar.cohort`.
    #[arg(long, requires = "plantar")]
    package_python: Option<PathBuf>,
    /// The folder SpeedPP2DS of the Python package jiku-data. With this option, the packed cells, the identification and
    /// `plantar cohort` are also measured on its walkers.
    #[arg(long, requires = "plantar")]
    jiku: Option<PathBuf>,
    /// The source archive of the Python package moticon-opengo. With this option, the detection of steps and load bouts is also
    /// measured.
    #[arg(long, requires = "python")]
    moticon: Option<PathBuf>,
    /// The folder with recordings of people, which are not public. With this option and `--jiku`, the packed cells of an in-shoe
    /// recording are also measured.
    #[arg(long)]
    recordings: Option<PathBuf>,
    /// The program `plantar`. With this option and `--jiku`, the time of `plantar cohort` is also measured; with this option and
    /// `--package-python`, the memory of `plantar replay`.
    #[arg(long)]
    plantar: Option<PathBuf>,
    /// Also write the figures to this file, as one JSON object with a number for each key.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Measure only the deepest stack of the emulated board in a walk, and write this figure to this JSON file.
    #[arg(long, conflicts_with_all = ["python", "json"])]
    stack_json: Option<PathBuf>,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let mut figures = Figures::default();
    if let Some(python) = &arguments.python {
        instructions::measure(&arguments.firmware, &mut figures)?;
        accuracy::measure(&mut figures)?;
        bytes::measure(&mut figures)?;
        replay::measure(python, &mut figures)?;
        identify::measure(python, &mut figures)?;
        idle::measure(&arguments.firmware, &mut figures)?;
        bench::host_loops::measure_speed(&mut figures)?;
        if let Some(moticon) = &arguments.moticon {
            wear::measure(python, moticon, &mut figures)?;
        }
        if let (Some(plantar), Some(python)) = (&arguments.plantar, &arguments.package_python) {
            replay_file::measure(python, plantar, &mut figures)?;
        }
        if let (Some(jiku), Some(plantar)) = (&arguments.jiku, &arguments.plantar) {
            cells::measure(jiku, arguments.recordings.as_deref(), &mut figures)?;
            closed_loop::measure(&arguments.firmware, jiku, &mut figures)?;
            walkers::measure(jiku, &mut figures)?;
            cohort::measure(plantar, arguments.package_python.as_deref(), jiku, &mut figures)?;
        }
    } else {
        stack::measure(&arguments.firmware, &mut figures)?;
    }
    [&arguments.json, &arguments.stack_json].into_iter().flatten().try_for_each(|path| figures.write(path))
}

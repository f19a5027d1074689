//! Tests the endurance of an insole with power cuts, bit errors and a day of walking. The run ends with an error at the first
//! violated requirement.

mod bits;
mod power;
mod walk;

use anyhow::Result;
use bench::Figures;
use clap::Parser;
use std::path::PathBuf;

/// Tests an insole with power cuts in every write and erase operation (in some of them with `--short`), bit errors on the cable
/// and a day of walking, and prints the figures.
#[derive(Parser)]
struct Arguments {
    /// The firmware file of the emulated board.
    #[arg(long)]
    firmware: PathBuf,
    /// Run only a small part of each test. This takes a few minutes instead of an hour.
    #[arg(long)]
    short: bool,
    /// Also write the figures to this file, as one JSON object with a number for each key.
    #[arg(long)]
    json: Option<PathBuf>,
}

fn main() -> Result<()> {
    let Arguments { firmware, short, json } = Arguments::parse();
    let mut figures = Figures::default();
    bench::host_loops::soak(short, &mut figures)?;
    bits::soak(short, &mut figures)?;
    power::test_store(short, &mut figures)?;
    power::test_firmware(&firmware, short, &mut figures)?;
    walk::soak(&firmware, short, &mut figures)?;
    json.map_or(Ok(()), |path| figures.write(&path))
}

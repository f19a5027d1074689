//! Tests the endurance of an insole: losses of power, bit errors, a day of walking. Each figure is measured in this run, which
//! ends with an error at the first violated requirement.

mod bits;
mod power;
mod walk;

use anyhow::Result;
use bench::Figures;
use clap::Parser;
use std::path::PathBuf;

/// Tests an insole with losses of power in every write, bit errors on the cable and a day of walking, and prints the results.
#[derive(Parser)]
struct Arguments {
    /// The firmware of the emulated board.
    #[arg(long)]
    firmware: PathBuf,
    /// Run only a small part of each test, for a few minutes instead of an hour.
    #[arg(long)]
    short: bool,
    /// Also write the figures to this file, one flat JSON object.
    #[arg(long)]
    json: Option<PathBuf>,
}

fn main() -> Result<()> {
    let Arguments { firmware, short, json } = Arguments::parse();
    let mut figures = Figures::default();
    bench::host_loops::soak(short, &mut figures)?;
    bits::soak(short, &mut figures)?;
    power::in_memory(short, &mut figures)?;
    power::of_the_firmware(&firmware, short, &mut figures)?;
    walk::soak(&firmware, short, &mut figures)?;
    json.map_or(Ok(()), |path| figures.write(&path))
}

//! Endurance of an insole: losses of power, bit errors, a day of walking. Each figure is measured in this run, which ends with an
//! error at the first requirement that is violated.

mod bits;
mod power;
mod walk;

use anyhow::Result;
use bench::Figures;
use clap::Parser;
use std::path::PathBuf;

/// Losses of power in every write, bit errors on the cable, a day of walking; prints the results.
#[derive(Parser)]
struct Arguments {
    /// The firmware of the emulated board.
    #[arg(long)]
    firmware: PathBuf,
    /// A small part of each, for a few minutes instead of an hour.
    #[arg(long)]
    short: bool,
    /// Also write the figures to this file, one flat JSON object.
    #[arg(long)]
    json: Option<PathBuf>,
}

fn main() -> Result<()> {
    let Arguments { firmware, short, json } = Arguments::parse();
    let mut figures = Figures::default();
    bits::soak(short, &mut figures)?;
    power::in_memory(short, &mut figures)?;
    power::of_the_firmware(&firmware, short, &mut figures)?;
    walk::soak(&firmware, short, &mut figures)?;
    bench::host_loops::soak(short, &mut figures)?;
    json.map_or(Ok(()), |path| figures.write(&path))
}

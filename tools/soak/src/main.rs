//! What an insole endures, each figure measured in this run. It ends with an error at the first promise that does not hold.

mod bits;
mod power;
mod walk;

use anyhow::Result;
use clap::Parser;
use figures::Figures;
use std::path::PathBuf;

/// Losses of power at every write, days of walking, bit errors on the cable: prints what came of it.
#[derive(Parser)]
struct Arguments {
    /// The firmware of the emulated board.
    #[arg(long)]
    firmware: PathBuf,
    /// A few minutes instead of hours: some of each.
    #[arg(long)]
    short: bool,
    /// Also write the figures to this file, one flat object.
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
    json.map_or(Ok(()), |path| figures.write(&path))
}

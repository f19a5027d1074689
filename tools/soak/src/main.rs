//! What an insole endures, each figure measured in this run. It ends with an error at the first promise that does not hold.

mod bits;
mod power;
mod walk;

use anyhow::{Context, Result};
use clap::Parser;
use serde_json::{Map, Value};
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

/// What was measured, in the order of printing.
#[derive(Default)]
pub struct Figures(Map<String, Value>);

impl Figures {
    /// Prints and keeps a figure.
    pub fn add(&mut self, key: &str, value: impl Into<Value>, meaning: &str) {
        let value = value.into();
        println!("{key:<28} {:>14}  {meaning}", value.to_string());
        self.0.insert(key.into(), value);
    }
}

fn main() -> Result<()> {
    let Arguments { firmware, short, json } = Arguments::parse();
    let mut figures = Figures::default();
    bits::soak(short, &mut figures)?;
    power::in_memory(short, &mut figures)?;
    power::of_the_firmware(&firmware, short, &mut figures)?;
    walk::soak(&firmware, short, &mut figures)?;
    if let Some(path) = json {
        let text = serde_json::to_string_pretty(&figures.0)? + "\n";
        std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

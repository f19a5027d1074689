//! Simulates the front end of the reference board.

use crate::arguments::FiguresFile;
use crate::build::build_host;
use crate::command::{built, run_command};
use crate::setup;
use anyhow::Result;
use std::process::Command;

/// Writes bill of materials, schematic, plots and figures of the reference board, and compares the figures with their limits.
pub fn run(figures: &FiguresFile) -> Result<()> {
    setup::rust()?;
    setup::ngspice()?;
    build_host("hardware")?;
    let mut command = Command::new(built("release/hardware"));
    if let Some(path) = &figures.json {
        command.arg("--json").arg(std::path::absolute(path)?);
    }
    run_command(&mut command)
}

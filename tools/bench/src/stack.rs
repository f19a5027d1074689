//! Measures the deepest stack of the emulated board in a walk with steps and a live stream.

use crate::instructions::walk_through;
use anyhow::{Result, bail};
use bench::Figures;
use emulator::{Recorded, Time};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use recording::{VirtualInsole, synthetic};
use std::path::Path;

/// Plays a walk of three steps into the emulated board.
pub fn measure(firmware: &Path, figures: &mut Figures) -> Result<()> {
    let walk = synthetic::walk(&synthetic::SyntheticWalk { steps: 3, ..Default::default() }).recording;
    let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let status =
        walk_through(firmware, &virtual_insole.clone(), Time::Fastest, Recorded::new(walk, virtual_insole), None)?;
    if status.steps != 3 {
        bail!("the walk of 3 steps resulted in {} steps", status.steps);
    }
    figures.add("stack_bytes", status.stack_bytes, "deepest stack of the emulated board in a walk, bytes");
    Ok(())
}

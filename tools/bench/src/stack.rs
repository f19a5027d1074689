//! The deepest stack of the emulated board in a walk with steps and a live stream.

use crate::Figures;
use crate::instructions::walk_through;
use anyhow::{Result, bail};
use emulator::{Scan, Time, Walk};
use plantar::contact::ContactRule;
use plantar::stance::StanceRule;
use recording::{Recording, VirtualInsole, synthetic};
use std::path::Path;

struct Played(Recording, VirtualInsole);

impl Walk for Played {
    fn scans(&self) -> u32 {
        self.1.frames(&self.0) as u32
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        self.1.codes_of(&self.0, seq as usize, codes);
        Scan::Whole
    }
}

pub fn measure(firmware: &Path, figures: &mut Figures) -> Result<()> {
    let walk = synthetic::walk(&synthetic::SyntheticWalk { steps: 3, ..Default::default() }).recording;
    let worn = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::WALKING);
    let status = walk_through(firmware, &worn.clone(), Time::Max, Played(walk, worn))?;
    if status.steps != 3 {
        bail!("the walk of 3 steps gave {}", status.steps);
    }
    figures.add("stack_bytes", status.stack_bytes, "deepest stack of the emulated board in a walk");
    Ok(())
}

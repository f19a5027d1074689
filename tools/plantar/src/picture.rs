//! Collects the forces of a replay and draws a picture of a step.

use crate::setup::rule_in_words;
use anyhow::{Context, Result};
use plantar::Real;
use plantar::insole::Insole;
use plantar::pipeline::live::RegionLoad;
use plantar::protocol::Step;
use recording::{Recording, VirtualInsole};
use report::{Forces, StepPicture};
use std::path::Path;

/// The measured force and the model force of every region in all frames so far.
#[derive(Default)]
pub struct Picture {
    forces: Vec<Forces>,
}

impl Picture {
    /// Adds the forces of the frame that the insole processed last.
    pub fn push<R: Real, const N: usize>(&mut self, insole: &Insole<R, N>) {
        let forces = |load: &RegionLoad<R>| (load.frame.force.force_n.to_f64(), load.tissue.model_n.to_f64());
        self.forces.push(insole.loads().each_ref().map(forces));
    }

    /// Writes a picture of a step of the recording to an SVG file.
    pub fn write(&self, path: &Path, recording: &Recording, insole: &VirtualInsole, step: Option<&Step>) -> Result<()> {
        let step =
            step.context("the recording has no complete step to draw: use another recording, or omit --picture")?;
        let frame = |us: u64| ((us as f64 * 1e-6 * recording.rate_hz).round() as usize).min(recording.frames());
        let frames = frame(step.start_us)..frame(step.start_us + u64::from(step.duration_us));
        let forces = self.forces.get(frames.clone()).context("the step is outside of the recording")?;
        let contact = rule_in_words(&step.contact_rule);
        let picture = StepPicture { recording, insole, step, frames: &frames, forces, contact: &contact };
        std::fs::write(path, picture.svg()).with_context(|| format!("cannot write {}", path.display()))
    }
}

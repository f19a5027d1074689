//! Collects the first step of a replay and draws a picture of it.

use crate::fit::write;
use crate::setup::rule_in_words;
use anyhow::{Context, Result};
use plantar::Real;
use plantar::insole::Insole;
use plantar::pipeline::live::RegionLoad;
use plantar::protocol::Step;
use recording::{Recording, VirtualInsole};
use report::{Forces, StepPicture};
use std::path::Path;

/// The frames of the current contact with the ground, and later those of the first step.
pub struct Picture {
    /// Largest number of frames of a step.
    longest_frames: usize,
    /// Measured force and model force of every region in each frame.
    forces: Vec<Forces>,
    /// The codes of these frames, one frame after the other.
    codes: Vec<u16>,
    /// True if the foot was on the ground in the last frame.
    was_on_ground: bool,
    /// The first step, once it is complete.
    step: Option<Step>,
}

impl Picture {
    /// A picture without frames, for the steps of this insole.
    pub fn new(insole: &VirtualInsole) -> Self {
        let longest_frames = insole.longest_step_frames();
        Self { longest_frames, forces: Vec::new(), codes: Vec::new(), was_on_ground: false, step: None }
    }

    /// Adds the frame that the insole processed last, its codes, and the step that this frame completed, if any. After the
    /// first step, further frames are ignored.
    pub fn push<R: Real, const N: usize>(&mut self, insole: &Insole<R, N>, codes: &[u16], step: Option<Step>) {
        if self.step.is_some() {
            return;
        }
        if insole.on_ground() && !self.was_on_ground {
            self.forces.clear();
            self.codes.clear();
        }
        self.was_on_ground = insole.on_ground();
        if insole.on_ground() && self.forces.len() < self.longest_frames {
            let forces = |load: &RegionLoad<R>| (load.frame.force.force_n.to_f64(), load.tissue.model_n.to_f64());
            self.forces.push(insole.loads().each_ref().map(forces));
            self.codes.extend(codes);
        }
        self.step = step;
    }

    /// Writes a picture of the first step of the recording to an SVG file.
    pub fn write(&self, path: &Path, recording: &Recording, insole: &VirtualInsole) -> Result<()> {
        let step = self
            .step
            .as_ref()
            .context("the recording has no complete step to draw: use another recording, or omit --picture")?;
        let frames = (step.duration_us / insole.setup.period_us) as usize;
        let forces = self
            .forces
            .get(..frames)
            .context("some frames of the first step are missing: use another recording, or omit --picture")?;
        let mut peak_codes = vec![0; recording.cells()];
        for codes in self.codes.chunks(recording.cells()).take(frames) {
            for (peak, &code) in peak_codes.iter_mut().zip(codes) {
                *peak = code.max(*peak);
            }
        }
        let (peak_kpa, contact) = (insole.measured_by_codes_kpa(&peak_codes), rule_in_words(&step.contact_rule));
        let picture = StepPicture { recording, step, peak_kpa: &peak_kpa, forces, contact: &contact };
        write(path, picture.svg().as_bytes())
    }
}

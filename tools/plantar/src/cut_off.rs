//! The contacts that the beginning or the end of a recording cuts off.

use fit::steps::ExclusionReason;
use plantar::Real;
use plantar::insole::Insole;
use plantar::pipeline::stance_rule::Rejected;
use recording::MAX_CELLS;
use std::path::Path;

/// Finds the contacts that the beginning or the end of a recording cuts off, by the rules of [`fit::steps::isolate`] with one
/// exception: if a recording ends so soon after a step that its toe off is not confirmed yet, `isolate` leaves the step out,
/// but [`Insole::end_stance`] completes it.
#[derive(Default)]
pub struct CutOff {
    /// The time of each contact that was found, s, and the reason why it is no step.
    found: Vec<(f64, ExclusionReason)>,
    /// True after the first frame.
    has_frames: bool,
    /// Time of the first frame of the present or last contact, s.
    start_s: f64,
    /// True if the foot was on the ground in the last frame.
    was_on_ground: bool,
    /// True if the present contact began before the recording.
    starts_loaded: bool,
    /// Number of contacts that the insole had rejected after the last frame.
    rejected: Rejected,
    /// True if the insole rejected the present or last contact.
    is_rejected: bool,
}

impl CutOff {
    /// Evaluates the frame that `insole` processed last, at time `t_s`. `toe_off` is the result of [`Insole::frame`].
    pub fn frame<R: Real>(&mut self, t_s: f64, toe_off: bool, insole: &Insole<R, MAX_CELLS>) {
        let is_on_ground = insole.on_ground();
        if is_on_ground && !self.was_on_ground {
            (self.start_s, self.starts_loaded, self.is_rejected) = (t_s, !self.has_frames, false);
        }
        self.has_frames = true;
        self.is_rejected |= insole.rejected() != self.rejected;
        if self.was_on_ground && !is_on_ground && !toe_off && self.starts_loaded {
            self.found.push((self.start_s, ExclusionReason::NoHeelStrike));
            self.starts_loaded = false;
        }
        (self.was_on_ground, self.rejected) = (is_on_ground, insole.rejected());
    }

    /// Prints a line for each contact of the recording `path` that was found. `insole` has processed all frames, and
    /// [`Insole::end_stance`] was called. A contact that the insole rejected is not named: the insole counts it.
    pub fn print<R: Real>(mut self, insole: &Insole<R, MAX_CELLS>, path: &Path) {
        if insole.on_ground() && !self.is_rejected {
            let reason = if self.starts_loaded { ExclusionReason::NeverLifted } else { ExclusionReason::NoToeOff };
            self.found.push((self.start_s, reason));
        }
        for (at_s, reason) in self.found {
            println!("left out: {} at {at_s:.2} s, {reason}", path.display());
        }
    }
}

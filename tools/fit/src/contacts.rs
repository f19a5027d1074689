//! The contacts of a recording that are no steps, with the reason.

use crate::steps::ExclusionReason;
use plantar::Real;
use plantar::insole::Insole;
use plantar::pipeline::stance_rule::Rejected;

/// Follows the contacts of an insole from frame to frame, and finds those that are no steps. Each contact has one reason: the
/// first one that is found.
#[derive(Debug, Default)]
pub struct Contacts {
    /// True after the first frame.
    has_frames: bool,
    /// Time of the first frame of the present or last contact, s.
    start_s: f64,
    /// True if the foot was on the ground in the last frame.
    was_on_ground: bool,
    /// True if the present or last contact began before the recording.
    starts_loaded: bool,
    /// The counts of the insole after the last frame.
    rejected: Rejected,
    /// True if the present or last contact was found to be no step.
    is_excluded: bool,
}

impl Contacts {
    /// Evaluates the frame that `insole` processed last, at time `t_s`. `toe_off` is the result of [`Insole::frame`]. If the
    /// present or last contact turns out to be no step, returns the reason.
    pub fn frame<R: Real, const CELLS: usize>(
        &mut self,
        t_s: f64,
        toe_off: bool,
        insole: &Insole<R, CELLS>,
    ) -> Option<ExclusionReason> {
        let is_on_ground = insole.on_ground();
        if is_on_ground && !self.was_on_ground {
            (self.start_s, self.starts_loaded, self.is_excluded) = (t_s, !self.has_frames, false);
        }
        let is_lifted = self.was_on_ground && !is_on_ground;
        let rejected = new_rejection(&self.rejected, &insole.rejected());
        (self.has_frames, self.was_on_ground, self.rejected) = (true, is_on_ground, insole.rejected());
        let is_cut_off = is_lifted && !toe_off && self.starts_loaded;
        self.exclude(rejected.or(is_cut_off.then_some(ExclusionReason::NoHeelStrike)))
    }

    /// Evaluates the end of the recording, after the last frame. If the recording ends during a contact, returns the reason why
    /// it is no step. If the toe off of the last contact is not confirmed yet, [`Insole::end_stance`] can complete the step; it
    /// must have been called before, or the contact is excluded.
    pub fn end<R: Real, const CELLS: usize>(&mut self, insole: &Insole<R, CELLS>) -> Option<ExclusionReason> {
        let reason = if self.starts_loaded { ExclusionReason::NeverLifted } else { ExclusionReason::NoToeOff };
        self.exclude(insole.on_ground().then_some(reason))
    }

    /// Time of the first frame of the present or last contact, s.
    pub fn start_s(&self) -> f64 {
        self.start_s
    }

    /// Excludes the contact for `reason`, and returns the reason, unless it was already excluded.
    fn exclude(&mut self, reason: Option<ExclusionReason>) -> Option<ExclusionReason> {
        let reason = reason.filter(|_| !self.is_excluded)?;
        self.is_excluded = true;
        Some(reason)
    }
}

/// The contacts that the beginning or the end of a recording cuts off. A contact that the insole rejected is not among them: the
/// insole counts it.
#[derive(Debug, Default)]
pub struct CutOff {
    contacts: Contacts,
    /// The time of each contact that was found, s, and the reason why it is no step.
    found: Vec<(f64, ExclusionReason)>,
}

impl CutOff {
    /// As [`Contacts::frame`].
    pub fn frame<R: Real, const CELLS: usize>(&mut self, t_s: f64, toe_off: bool, insole: &Insole<R, CELLS>) {
        let reason = self.contacts.frame(t_s, toe_off, insole);
        self.add(reason);
    }

    /// The time of the first frame of each contact, s, and the reason why it is no step. `insole` has processed all frames, and
    /// [`Insole::end_stance`] was called, or the contact of which the toe off is not confirmed is among them.
    pub fn end<R: Real, const CELLS: usize>(mut self, insole: &Insole<R, CELLS>) -> Vec<(f64, ExclusionReason)> {
        let reason = self.contacts.end(insole);
        self.add(reason);
        self.found
    }

    fn add(&mut self, reason: Option<ExclusionReason>) {
        self.found.extend(reason.filter(ExclusionReason::is_cut_off).map(|reason| (self.contacts.start_s, reason)));
    }
}

/// The reason if the insole rejected a contact between the counts `before` and `now`; otherwise `None`.
fn new_rejection(before: &Rejected, now: &Rejected) -> Option<ExclusionReason> {
    if now.short != before.short {
        Some(ExclusionReason::Short)
    } else if now.long != before.long {
        Some(ExclusionReason::Long)
    } else if now.broken != before.broken {
        Some(ExclusionReason::Broken)
    } else {
        None
    }
}

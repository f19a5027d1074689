//! The contacts of a recording that are no steps, with the reason.

use crate::steps::ExclusionReason;
use plantar::Real;
use plantar::insole::Insole;
use plantar::pipeline::setup::Setup;
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

/// A contact of a recording that is no step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OtherContact {
    /// Time of the first frame, s.
    pub start_s: f64,
    /// Time from the first frame to toe off or to the end of the recording, s.
    pub duration_s: f64,
    /// Largest total force, N.
    pub peak_n: f64,
    /// The reason why it is no step.
    pub reason: ExclusionReason,
    /// True for a contact that is too short because its force does not reach the threshold of toe off.
    pub is_weak: bool,
}

/// The contacts of a recording that are no steps, in the order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OtherContacts {
    /// The contacts.
    pub contacts: Vec<OtherContact>,
    /// Largest total force of the recording, N.
    pub largest_n: f64,
}

/// Collects the contacts of a recording that are no steps, with their durations and forces. [`Contacts`] recognises them.
#[derive(Debug)]
pub struct ContactCollector {
    contacts: Contacts,
    /// Frame period, s.
    period_s: f64,
    /// Time from toe off to the frame that confirms it, s.
    confirmation_s: f64,
    /// The reason why the present contact is no step, if it is none.
    reason: Option<ExclusionReason>,
    /// Largest total force in the present contact, N.
    peak_n: f64,
    /// Time of the last frame, s.
    last_s: f64,
    found: OtherContacts,
}

impl ContactCollector {
    /// Before the first frame of an insole with this configuration.
    pub fn new(setup: &Setup) -> Self {
        // The insole rounds the duration of a swing to whole frames. The frame of toe off is the first frame of the swing.
        let period_s = f64::from(setup.period_us) / 1e6;
        let swing_frames = (f64::from(setup.stance.min_swing_ms) / 1e3 / period_s).round().max(1.0);
        Self {
            contacts: Contacts::default(),
            period_s,
            confirmation_s: (swing_frames - 1.0) * period_s,
            reason: None,
            peak_n: 0.0,
            last_s: 0.0,
            found: OtherContacts::default(),
        }
    }

    /// Evaluates the frame that `insole` processed last, at time `t_s`. `toe_off` is the result of [`Insole::frame`].
    pub fn frame<R: Real, const CELLS: usize>(&mut self, t_s: f64, toe_off: bool, insole: &Insole<R, CELLS>) {
        let (was_on_ground, is_on_ground) = (self.contacts.was_on_ground, insole.on_ground());
        let reason = self.contacts.frame(t_s, toe_off, insole);
        self.last_s = t_s;
        let total_n = insole.total_n().to_f64();
        self.found.largest_n = self.found.largest_n.max(total_n);
        if is_on_ground {
            if !was_on_ground {
                (self.reason, self.peak_n) = (None, 0.0);
            }
            self.peak_n = self.peak_n.max(total_n);
        }
        self.reason = self.reason.or(reason);
        if was_on_ground && !is_on_ground {
            self.complete(self.confirmation_s, insole.stance_frames());
        }
    }

    /// The contacts that were found. `insole` has processed all frames, and [`Insole::end_stance`] was called, or a contact of
    /// which the toe off is not confirmed is among them.
    pub fn end<R: Real, const CELLS: usize>(mut self, insole: &Insole<R, CELLS>) -> OtherContacts {
        let reason = self.contacts.end(insole);
        self.reason = self.reason.or(reason);
        if insole.on_ground() {
            self.complete(0.0, 0);
        }
        self.found
    }

    /// Completes the present contact, if it is no step. Its toe off was `ago_s` before the last frame; if it is too short, it has
    /// `frames` frames.
    fn complete(&mut self, ago_s: f64, frames: u32) {
        let Some(reason) = self.reason.take() else { return };
        let start_s = self.contacts.start_s;
        let duration_s = match reason {
            ExclusionReason::Short => f64::from(frames) * self.period_s,
            _ => (self.last_s - start_s - ago_s).max(0.0),
        };
        let is_weak = reason == ExclusionReason::Short && frames <= 1;
        self.found.contacts.push(OtherContact { start_s, duration_s, peak_n: self.peak_n, reason, is_weak });
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

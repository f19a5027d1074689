//! The contacts that the beginning or the end of a recording cuts off.

use fit::contacts::Contacts;
use fit::steps::ExclusionReason;
use plantar::Real;
use plantar::insole::Insole;
use recording::MAX_CELLS;
use std::path::Path;

/// The contacts that the beginning or the end of a recording cuts off. A contact that the insole rejected is not among them: the
/// insole counts it.
#[derive(Default)]
pub struct CutOff {
    contacts: Contacts,
    /// The time of each contact that was found, s, and the reason why it is no step.
    found: Vec<(f64, ExclusionReason)>,
}

impl CutOff {
    /// Evaluates the frame that `insole` processed last, at time `t_s`. `toe_off` is the result of [`Insole::frame`].
    pub fn frame<R: Real>(&mut self, t_s: f64, toe_off: bool, insole: &Insole<R, MAX_CELLS>) {
        let reason = self.contacts.frame(t_s, toe_off, insole);
        self.add(reason);
    }

    /// Prints a line for each contact of the recording `path` that was found. `insole` has processed all frames, and
    /// [`Insole::end_stance`] was called.
    pub fn print<R: Real>(mut self, insole: &Insole<R, MAX_CELLS>, path: &Path) {
        let reason = self.contacts.end(insole);
        self.add(reason);
        for (at_s, reason) in self.found {
            println!("left out: {} at {at_s:.2} s, {reason}", path.display());
        }
    }

    fn add(&mut self, reason: Option<ExclusionReason>) {
        self.found.extend(reason.filter(ExclusionReason::is_cut_off).map(|reason| (self.contacts.start_s(), reason)));
    }
}

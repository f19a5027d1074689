//! Measurement of the baselines on request.

use super::Insole;
use crate::num::Real;
use crate::pipeline::baseline::{ZERO_S, ZeroResult};

/// The foot was not lifted within [`ZERO_S`] seconds after the request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotLifted;

impl<R: Real, const N: usize> Insole<R, N> {
    /// Requests that the baselines of all cells are measured as soon as the foot is lifted, within [`ZERO_S`] seconds. The
    /// readings then become the baselines at once, as after the start.
    pub fn request_zero(&mut self) {
        self.zero_s = ZERO_S;
        self.detector.request_zero(true);
    }

    /// True from a request until [`Insole::take_zero`] has returned its outcome.
    pub fn is_zero_requested(&self) -> bool {
        self.zero_s > 0
    }

    /// The outcome of a requested measurement; `None` if none was requested, or if the outcome is not known yet. To be called
    /// once a second, because its calls count the seconds of [`ZERO_S`].
    pub fn take_zero(&mut self) -> Option<Result<ZeroResult, NotLifted>> {
        if self.zero_s == 0 {
            return None;
        }
        if !self.detector.is_zero_requested() {
            self.zero_s = 0;
            return Some(Ok(ZeroResult {
                changed: self.detector.zeroed() as u16,
                with_former_baseline: self.faults().with_former_baseline,
                residual_dn: self
                    .residuals
                    .each_ref()
                    .map(|residual| (residual.force.force_n * R::of(10.0)).round_u16()),
            }));
        }
        self.zero_s -= 1;
        (self.zero_s == 0).then(|| {
            self.detector.request_zero(false);
            Err(NotLifted)
        })
    }
}

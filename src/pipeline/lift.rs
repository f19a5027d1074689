//! Lift: recognises a lifted foot by a constant total force, at any residual pressure of the shoe up to the limit of a baseline.
//!
//! The force of a foot on the ground is hardly ever constant to within [`TOLERANCE_N`] for [`super::stance_rule::SETTLE_MS`]
//! while most cells have at most the pressure that a baseline can have, and the others carry little: a foot that carries load has
//! cells with far more, and a foot that is dragged has a force that changes. Exceptions: docs/baseline.md, Limits.

use super::calibrate::{Curve, is_saturated};
use super::cell::InsoleCell;
use crate::num::Real;

/// Largest deviation of a constant force, N, for a wearer with peaks of [`super::stance_rule::REFERENCE_PEAK_N`].
const TOLERANCE_N: f64 = 5.0;

/// At most one in this number of cells of a lifted foot has more pressure than a baseline can have. One eighth is more than a
/// shorted line of the complete matrix (1/16), which therefore does not count as load.
const EXCEEDED_PART: usize = 8;

/// The time for which the total force has been constant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Constancy<R> {
    /// Force of the first frame of this time, N.
    level_n: R,
    /// Number of frames since then.
    frames: u32,
}

impl<R: Real> Constancy<R> {
    pub(crate) const NEW: Self = Self { level_n: R::ZERO, frames: 0 };

    /// Processes the total force of a frame. `scale` is the load of the wearer relative to that of the reference.
    #[inline(always)]
    pub(crate) fn push(&mut self, total_n: R, scale: R) {
        let tolerance_n = scale * R::of(TOLERANCE_N);
        let difference_n = total_n - self.level_n;
        if difference_n < tolerance_n && difference_n > R::ZERO - tolerance_n {
            self.frames = self.frames.saturating_add(1);
        } else {
            *self = Self { level_n: total_n, frames: 0 };
        }
    }

    /// Number of frames for which the force has been constant.
    pub(crate) fn frames(&self) -> u32 {
        self.frames
    }

    /// The constant force, N.
    pub(crate) fn level_n(&self) -> R {
        self.level_n
    }
}

/// True if at most one in [`EXCEEDED_PART`] cells has more pressure than a baseline can have, and these cells together carry less
/// than `most_n`, N: a foot can stand on few cells. A saturated cell does not count as load, because it may be shorted.
pub(crate) fn is_unloaded<R: Real>(cells: &[InsoleCell<R>], codes: &[u16], curve: &Curve, most_n: R) -> bool {
    let (mut exceeded, mut force_n) = (0, R::ZERO);
    for (cell, &code) in cells.iter().zip(codes) {
        if cell.baseline.is_exceeded(code, curve) {
            exceeded += 1;
            if !is_saturated(code.into()) {
                force_n += cell.force_above_zero_n(code, curve);
            }
        }
    }
    EXCEEDED_PART * exceeded <= cells.len() && force_n < most_n
}

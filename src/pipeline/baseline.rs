//! Baseline: the reading of each cell under a lifted foot, which the insole follows by itself.
//!
//! A shoe presses on the insole even when the foot is lifted, and this residual pressure creeps, as the sensor does, and drifts
//! with temperature. After each stance, once the foot is lifted ([`super::lift`]), every cell is read:
//!
//! - A reading below the baseline lowers the baseline at once, because a cell without load cannot read less than its baseline.
//! - A reading above it raises the baseline only as far as the swing before read the same, at most [`GAIT_MS`] earlier; so neither
//!   a foot that rests for a moment, nor a person who sits down and stands up, becomes the baseline. The first reading after the
//!   start is used at once.
//! - A baseline is at most [`MAX_RESIDUAL_KPA`] above zero pressure. A cell that reads more under a lifted foot keeps its
//!   baseline.
//!
//! The pressure of the baseline is subtracted from the pressure of the cell. It is not subtracted from the code, because codes
//! are not proportional to pressure. If the baseline is below the calibrated zero, the zero follows it.

use super::calibrate::{CellCalibration, Curve};
use super::cell::InsoleCell;
use super::contact::ContactRule;
use super::marks::{MAX_LOWERED, NOISE};
use super::region::ForceMoments;
use crate::num::Real;

/// Largest pressure of a baseline, kPa. In-shoe pressures of a lifted foot are below 10 kPa, and a standing foot exceeds this
/// pressure under a large part of its contact.
pub const MAX_RESIDUAL_KPA: f32 = 13.0;

/// Longest time between the readings of two swings that confirm each other, ms: a slow step and its swing.
pub const GAIT_MS: u32 = 5_000;

/// The baseline of one cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Baseline {
    /// Code of the unloaded cell, at least the code at zero pressure.
    pub(crate) code: u16,
    /// Pressure of this code on the sensor curve that all cells share, kPa.
    pub(crate) residual_kpa: f32,
    /// Ratio of the pressure of the cell to the pressure on that curve.
    pub(crate) gain: f32,
}

impl Baseline {
    /// The calibrated zero.
    pub(crate) const fn new(calibration: &CellCalibration) -> Self {
        Self { code: calibration.offset, residual_kpa: 0.0, gain: calibration.gain }
    }

    /// True if the cell at `code` has more pressure than a baseline can have. `zero` is its code at zero pressure.
    pub(crate) fn is_exceeded(&self, code: u16, zero: u16, curve: &Curve) -> bool {
        curve.pressure_kpa::<f32>(i32::from(code.saturating_sub(zero))) * self.gain > MAX_RESIDUAL_KPA
    }
}

/// How far a reading can raise baselines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rise {
    /// By the whole reading: the first one after the start.
    Whole,
    /// By the smaller of this reading and that of the swing before.
    Confirmed,
    /// Not at all.
    None,
}

impl<R: Real> InsoleCell<R> {
    /// Follows the code of the cell under a lifted foot. `before` is the reading of the swing before, codes above the baseline.
    /// Returns the change of the baseline, codes; 0 for a masked cell, and for changes within the noise.
    pub(crate) fn follow(&mut self, code: u16, before: i16, rise: Rise, contact: &ContactRule, curve: &Curve) -> i32 {
        let baseline = i32::from(self.baseline.code);
        let reading = i32::from(code) - baseline;
        let change = match rise {
            _ if reading < 0 => reading,
            Rise::Whole => reading,
            Rise::Confirmed => reading.min(before.into()),
            Rise::None => 0,
        };
        if change.unsigned_abs() <= NOISE.into() || self.marks.is_masked() {
            return 0;
        }
        // The new code is between the former one and `code`.
        let new = (baseline + change) as u16;
        let lowered =
            self.marks.lowered.saturating_add(((self.zero.saturating_sub(new) + NOISE / 2) / NOISE).min(255) as u8);
        if lowered > MAX_LOWERED || self.baseline.is_exceeded(new, self.zero, curve) {
            return 0;
        }
        self.marks.lowered = lowered;
        self.set_baseline(new, contact, curve);
        change
    }
}

/// The force of the baselines of a region's cells, and its moments about the region's reference point.
pub(crate) fn residual<R: Real>(cells: &[InsoleCell<R>]) -> ForceMoments<R> {
    let mut residual = ForceMoments::NONE;
    for cell in cells.iter().filter(|cell| cell.baseline.residual_kpa > 0.0 && !cell.marks.is_masked()) {
        residual.add(&cell.region, R::of_f32(cell.baseline.residual_kpa));
    }
    residual
}

//! Baseline: the reading of each cell under a lifted foot, which the insole follows by itself.
//!
//! A shoe presses on the insole even when the foot is lifted, and this residual pressure creeps, as the sensor does, and drifts
//! with temperature. After each stance, once the foot is lifted (`pipeline/lift.rs`), every cell is read:
//!
//! - A reading below the baseline lowers the baseline at once, because a cell without load cannot read less than its baseline. If
//!   it is also below the zero, it lowers the baseline to the zero, and the zero to the higher of this reading and that of the
//!   previous swing: no later reading raises the zero, so a single disturbed one must not lower it. The zero falls to at most
//!   2,048 codes below the calibrated one: a reading that would lower it farther leaves it unchanged, and may be evidence of a
//!   fault.
//! - A reading above it raises the baseline to the lower of this reading and that of the previous swing, if that swing was at
//!   most [`GAIT_MS`] earlier and a step of walking was between the two; so neither the reading under a foot that rests for a
//!   moment, nor that under the foot of a person who sits down and stands up, becomes the baseline.
//! - The first reading after the start becomes the baseline at once, unless the foot has carried load before; so does the first
//!   one after a host has requested a measurement. It lowers the zero, too.
//! - A baseline is at most [`MAX_RESIDUAL_KPA`] above the zero. The former baseline of a cell that reads more under a
//!   lifted foot remains in force, and the cell is counted in [`Faults::with_former_baseline`](crate::faults::Faults).
//!
//! The pressure of the baseline is subtracted from the pressure of the cell. Subtracting the codes instead would be wrong,
//! because codes are not proportional to pressure. If the baseline is below the calibrated zero, the zero follows it.

use super::calibrate::{CellCalibration, Curve};
use super::marks::{MAX_LOWERED, NOISE};
use serde::{Deserialize, Serialize};

/// Largest pressure of a baseline, kPa. In-shoe pressures of a lifted foot are below 10 kPa, and a standing foot exceeds
/// 13 kPa under a large part of its contact.
pub const MAX_RESIDUAL_KPA: f32 = 13.0;

/// Longest time between the readings of two swings that confirm each other, ms: a slow step and its swing.
pub const GAIT_MS: u32 = 5_000;

/// Time within which the foot must be lifted after a host has requested that the baselines are measured, s.
pub const ZERO_S: u8 = 4;

/// The result of a measurement of the baselines that a host has requested.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ZeroResult {
    /// Number of cells of which the baseline has changed by more than the noise.
    pub changed: u16,
    /// Number of cells of each region that read more than [`MAX_RESIDUAL_KPA`], so that their former baseline remains in force;
    /// 255 stands for 255 or more.
    pub with_former_baseline: [u8; 8],
    /// Force of the baselines of each region, 0.1 N.
    pub residual_dn: [u16; 8],
}

/// The baseline of one cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Baseline {
    /// Code at zero pressure; [`u16::MAX`] for a masked cell.
    pub(crate) zero: u16,
    /// Code of the unloaded cell, at least the code at zero pressure.
    pub(crate) code: u16,
    /// Pressure of this code on the sensor curve that all cells share, kPa.
    pub(crate) residual_kpa: f32,
    /// Ratio of the pressure of the cell to the pressure on that curve.
    pub(crate) gain: f32,
}

impl Baseline {
    /// The baseline at the calibrated zero, without residual pressure.
    pub(crate) const fn new(calibration: &CellCalibration) -> Self {
        Self { zero: calibration.offset, code: calibration.offset, residual_kpa: 0.0, gain: calibration.gain }
    }

    /// The new code of the baseline and the new `lowered`, if the cell reads `code` under the lifted foot; `None` if the baseline
    /// does not change. `lowered` is the distance from the calibrated code at zero pressure down to the present one, in units of
    /// [`NOISE`] codes, and `before` the reading of the previous swing, codes above the baseline. Changes within the noise are
    /// ignored, and so is a code that would bring the zero or the baseline out of its limits.
    pub(crate) fn follow(&self, code: u16, before: i16, rise: Rise, lowered: u8, curve: &Curve) -> Option<(u16, u8)> {
        let reading = i32::from(code) - i32::from(self.code);
        let change = match rise {
            Rise::Whole => reading,
            _ if reading < 0 => reading.max(i32::from(before).min(i32::from(self.zero) - i32::from(self.code))),
            Rise::Confirmed => reading.min(before.into()).max(0),
            Rise::None => 0,
        };
        if change.unsigned_abs() <= NOISE.into() {
            return None;
        }
        // The new code is between the former one and `code`, so it fits.
        let new = (i32::from(self.code) + change) as u16;
        let lowered = lowered.saturating_add(((self.zero.saturating_sub(new) + NOISE / 2) / NOISE).min(255) as u8);
        (lowered <= MAX_LOWERED && !self.is_exceeded(new, curve)).then_some((new, lowered))
    }

    /// True if the cell at `code` has more pressure than a baseline can have.
    pub(crate) fn is_exceeded(&self, code: u16, curve: &Curve) -> bool {
        curve.pressure_kpa::<f32>(i32::from(code.saturating_sub(self.zero))) * self.gain > MAX_RESIDUAL_KPA
    }
}

/// How far a reading can raise baselines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rise {
    /// By the whole reading: the first one after the start, or on request.
    Whole,
    /// By the lower of this reading and that of the previous swing.
    Confirmed,
    /// Not at all.
    None,
}

//! Which cells carry load, and what share of each.
//!
//! Contact is decided on codes, not on pressures: the thresholds are turned into one pair of codes a cell beforehand, so
//! that a device in `f32` and a host in `f64` never disagree about a cell.

use crate::calibrate::{CellCalibration, Curve, FULL_CODE};
use crate::num::Real;
use serde::{Deserialize, Serialize};

/// The rule that turns pressures into contact area. Area depends on where this line is drawn: state it with every result.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ContactRule {
    /// A cell comes into contact at this pressure, kPa.
    pub on_kpa: f32,
    /// and leaves it below this one, kPa; at most `on_kpa`.
    pub off_kpa: f32,
    /// 0: a cell in contact counts whole (the paper's way). Otherwise a cell counts by the share `p / full_kpa`, at most 1:
    /// the weak readings around a contact are those of partly covered cells. The larger this is, the more the area follows
    /// pressure.
    pub full_kpa: f32,
}

impl ContactRule {
    /// Counted cells, 10 kPa on and 7.5 kPa off.
    pub const COUNTED: Self = Self { on_kpa: 10.0, off_kpa: 7.5, full_kpa: 0.0 };

    /// True when the pressures are finite, positive and in order.
    pub fn is_valid(&self) -> bool {
        self.off_kpa > 0.0
            && self.off_kpa <= self.on_kpa
            && self.on_kpa <= 1000.0
            && (self.full_kpa == 0.0 || (self.full_kpa >= self.on_kpa && self.full_kpa <= 2000.0))
    }
}

/// One cell's thresholds as raw codes, and whether it is in contact now.
#[derive(Clone, Copy, Debug)]
pub struct ContactCell {
    on: u16,
    off: u16,
    /// `off` while in contact, else `on`.
    threshold: u16,
}

impl ContactCell {
    /// Thresholds of a cell; all above its offset.
    pub fn new(rule: &ContactRule, curve: &Curve, cell: &CellCalibration) -> Self {
        // One code below the threshold, so that a pressure which was quantised at exactly the threshold is in contact.
        let code_at = |kpa: f32| {
            let code = curve.first_code_at(kpa / cell.gain).saturating_sub(1).max(1);
            code.saturating_add(cell.offset).min(FULL_CODE)
        };
        let on = code_at(rule.on_kpa);
        Self { on, off: code_at(rule.off_kpa), threshold: on }
    }

    /// Takes this frame's raw code and tells whether the cell is in contact.
    #[inline(always)]
    pub fn update(&mut self, code: u16) -> bool {
        let loaded = code >= self.threshold;
        self.threshold = if loaded { self.off } else { self.on };
        loaded
    }
}

/// The share of a cell in contact at `pressure_kpa`, 0 to 1, from the reciprocal of [`ContactRule::full_kpa`].
#[inline(always)]
pub fn share<R: Real>(pressure_kpa: R, per_full_kpa: R) -> R {
    (pressure_kpa * per_full_kpa).min(R::ONE)
}

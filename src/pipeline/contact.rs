//! Contact: the share of each cell that is in contact.
//!
//! Codes, not pressures, are compared with thresholds: the thresholds of each cell are converted to codes in advance, so that a
//! device in `f32` and a host in `f64` have the same cells in contact.

use super::calibrate::{CellCalibration, Curve, FULL_CODE};
use crate::num::Real;
use serde::{Deserialize, Serialize};

/// The rule that determines contact area from pressures. Areas depend on the rule, so each result must state its rule.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ContactRule {
    /// A cell comes into contact at this pressure, kPa, at most 1000.
    pub on_kpa: f32,
    /// A cell loses contact below this pressure, kPa; above 0 and at most `on_kpa`.
    pub off_kpa: f32,
    /// 0: a cell in contact counts with its whole area, as in the paper that [`crate::pipeline::model`] implements. From `on_kpa`
    /// to 2000 kPa: a cell counts with the share `sqrt(p / full_kpa)` of its area, at most 1, where p is its pressure, because a
    /// low reading at the edge of a contact comes from a cell that the foot covers in part. Deformation rises from 0 at the edge
    /// in proportion to the distance from the edge (Eq. 3 of the paper). With a pressure in proportion to the deformation, a cell
    /// of which the share s is covered then reads s^2 times the pressure of a cell that is just fully covered. The larger
    /// `full_kpa` is, the more the area depends on pressure.
    pub full_kpa: f32,
}

impl ContactRule {
    /// *Counted cells*, as in the paper: a cell in contact counts with its whole area. It is in contact from 10 kPa until its
    /// pressure falls below 7.5 kPa.
    pub const COUNTED: Self = Self { on_kpa: 10.0, off_kpa: 7.5, full_kpa: 0.0 };
    /// *Covered shares*: a cell in contact, by the same thresholds, counts with its covered share, and with its whole area from
    /// 150 kPa on. docs/identification.md has the reason for this value.
    pub const COVERED: Self = Self { full_kpa: 150.0, ..Self::COUNTED };

    /// True if the pressures are in range and in order.
    pub fn is_valid(&self) -> bool {
        self.off_kpa > 0.0
            && self.off_kpa <= self.on_kpa
            && self.on_kpa <= 1000.0
            && (self.full_kpa == 0.0 || (self.full_kpa >= self.on_kpa && self.full_kpa <= 2000.0))
    }
}

/// The share of a cell that is entirely in contact. Shares are integers from 0 to this value.
pub const WHOLE: u16 = 256;

/// One cell: its thresholds as raw codes, and its present share in contact.
///
/// ```
/// use plantar::pipeline::calibrate::{CellCalibration, Curve, SensorLaw};
/// use plantar::pipeline::contact::{ContactCell, ContactRule, WHOLE};
///
/// let mut curve = Curve::new();
/// curve.set(&SensorLaw { full_kpa: 1000.0, exponent: 1.0 });
/// let mut cell = ContactCell::new(&ContactRule::COUNTED, &curve, &CellCalibration::IDEAL, 0.0);
/// let mut change = |kpa: f32| cell.update(u32::from(curve.first_code_at(kpa)), 0, kpa);
/// assert_eq!([change(9.0), change(10.0)], [0, i32::from(WHOLE)]);
/// // The cell loses contact below 7.5 kPa.
/// assert_eq!([change(8.0), change(7.0)], [0, -i32::from(WHOLE)]);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ContactCell {
    /// Code at which the cell comes into contact.
    on: u16,
    /// Code below which the cell loses contact.
    off: u16,
    /// Code from which on the cell counts with its whole area; 0 if the rule counts whole cells only.
    full: u16,
    /// Square of the share, in units of 1/[`WHOLE`], per kPa on the common sensor curve of all cells; used only if `full` is
    /// above `off`.
    squared_shares_per_kpa: f32,
    /// The present share, in units of 1/[`WHOLE`].
    share: u16,
    /// The codes from `low` to `low + span - 1` need no [`ContactCell::update`]. All are above the code at zero pressure. The two
    /// numbers have 32 bits each, because one instruction loads two words.
    low: u32,
    span: u32,
}

impl ContactCell {
    /// An unloaded cell. Its thresholds are codes that include its offset. `residual_kpa` is the pressure of its baseline on the
    /// sensor curve, kPa; the pressures of the rule are added to it.
    pub fn new(rule: &ContactRule, curve: &Curve, cell: &CellCalibration, residual_kpa: f32) -> Self {
        // One less than the first code at the pressure, so that a pressure equal to a threshold is in contact after quantisation.
        let code_at = |kpa: f32| {
            let code = curve.first_code_at(kpa / cell.gain + residual_kpa).saturating_sub(1).max(1);
            code.saturating_add(cell.offset).min(FULL_CODE)
        };
        let on = code_at(rule.on_kpa);
        let (full, squared_shares_per_kpa) = match rule.full_kpa {
            0.0 => (0, 0.0),
            full_kpa => (code_at(full_kpa), f32::from(WHOLE) * f32::from(WHOLE) * cell.gain / full_kpa),
        };
        Self { on, off: code_at(rule.off_kpa), full, squared_shares_per_kpa, share: 0, low: 0, span: 0 }
    }

    /// True if [`ContactCell::update`] need not be called: the cell has pressure and remains without contact, in contact in part,
    /// or in contact as a whole, the code is not saturated, and none of the `notify` functions has requested an update for it. If
    /// the rule has covered shares, [`ContactCell::update_part`] must then be called.
    #[inline(always)]
    pub fn is_unchanged(&self, code: u32) -> bool {
        // A code below `low` wraps to a number above any span.
        code.wrapping_sub(self.low) < self.span
    }

    /// Processes a code and returns the change of the share, in units of 1/[`WHOLE`]. `curve_kpa` is the pressure of the code
    /// above the baseline, on the common sensor curve of all cells, kPa, and `zero` is the code at zero pressure.
    ///
    /// The share is computed in single precision and integers on every machine, so that all machines compute the same area.
    pub fn update(&mut self, code: u32, zero: u16, curve_kpa: f32) -> i32 {
        let before = self.share;
        let threshold = if before > 0 { self.off } else { self.on };
        let (share, low, end) = if code < u32::from(threshold) {
            (0, u32::from(zero) + 1, self.on)
        } else if code >= u32::from(self.full) {
            (WHOLE, self.full.max(self.off).into(), FULL_CODE)
        } else {
            (self.part(curve_kpa), self.off.into(), self.full)
        };
        (self.share, self.low, self.span) = (share, low, u32::from(end).saturating_sub(low));
        i32::from(self.share) - i32::from(before)
    }

    /// Updates the share of a cell that is in contact in part; no other share changes. To be called for every code above zero
    /// pressure if the rule has covered shares, after [`ContactCell::update`] if [`ContactCell::is_unchanged`] is false. Returns
    /// the change of the share, as [`ContactCell::update`] does.
    #[inline(always)]
    pub fn update_part(&mut self, curve_kpa: f32) -> i32 {
        let before = self.share;
        // A share of 0 wraps to a number above any other.
        if before.wrapping_sub(1) < WHOLE - 1 {
            self.share = self.part(curve_kpa);
        }
        i32::from(self.share) - i32::from(before)
    }

    /// The share of a cell that is in contact in part, rounded, but less than [`WHOLE`].
    #[inline(always)]
    fn part(&self, curve_kpa: f32) -> u16 {
        let share = Real::sqrt(curve_kpa * self.squared_shares_per_kpa);
        // The clamped number fits into 16 bits. The FPU has an instruction for a conversion to 32 bits.
        ((share + 0.5) as u32).clamp(1, u32::from(WHOLE) - 1) as u16
    }

    /// The present share, in units of 1/[`WHOLE`].
    #[inline(always)]
    pub(crate) fn share(&self) -> u16 {
        self.share
    }

    /// True if the cell is in contact, as a whole or in part.
    pub fn is_loaded(&self) -> bool {
        self.share > 0
    }

    /// The load threshold: the code that is twice as far above the baseline as the code at which the cell comes into contact.
    pub(crate) fn load_threshold(&self, baseline: u16) -> u32 {
        (2 * u32::from(self.on)).saturating_sub(baseline.into())
    }

    /// Requests [`ContactCell::update`] for codes from `code` on, in addition to those that change the share. The next update
    /// ends the request, as it does for those of the following functions.
    pub(crate) fn notify_at(&mut self, code: u32) {
        self.span = code.saturating_sub(self.low).min(self.span);
    }

    /// Requests [`ContactCell::update`] for codes that differ from `code` by more than [`SAME_CODE`].
    pub(crate) fn notify_on_change(&mut self, code: u16) {
        self.low = code.saturating_sub(SAME_CODE).max(self.off).into();
        let end = (u32::from(code) + u32::from(SAME_CODE) + 1).min(FULL_CODE.into());
        self.span = end.saturating_sub(self.low);
    }

    /// Requests [`ContactCell::update`] for any code.
    pub(crate) fn notify_always(&mut self) {
        self.span = 0;
    }

    /// Adopts the thresholds of `new`. The share follows with the next [`ContactCell::update`], which is requested for any code.
    pub(crate) fn rebase(&mut self, new: Self) {
        *self = Self { share: self.share, ..new };
    }
}

/// Largest difference between two codes that count as equal: far less than the changes of a loaded cell.
const SAME_CODE: u16 = 2;

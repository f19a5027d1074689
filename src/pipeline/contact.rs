//! Which cells carry load, and what share of each.
//!
//! Contact is decided on codes, not on pressures: the thresholds are turned into one pair of codes a cell beforehand, so
//! that a device in `f32` and a host in `f64` never disagree about a cell.

use super::calibrate::{CellCalibration, Curve, FULL_CODE};
use crate::num::Real;
use serde::{Deserialize, Serialize};

/// The rule that turns pressures into contact area. Area depends on where this line is drawn: state it with every result.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ContactRule {
    /// A cell comes into contact at this pressure, kPa.
    pub on_kpa: f32,
    /// and leaves it below this one, kPa; at most `on_kpa`.
    pub off_kpa: f32,
    /// 0: a cell in contact counts whole (the paper's way). Otherwise a cell counts by the share `sqrt(p / full_kpa)`, at
    /// most 1: the weak readings around a contact are those of partly covered cells. Deformation rises from 0 at the rim in
    /// proportion to the distance from it (Eq. 3), so a cell of which the share s is covered reads s^2 of what a just covered
    /// one does. The larger `full_kpa` is, the more the area follows pressure.
    pub full_kpa: f32,
}

impl ContactRule {
    /// Counted cells, 10 kPa on and 7.5 kPa off.
    pub const COUNTED: Self = Self { on_kpa: 10.0, off_kpa: 7.5, full_kpa: 0.0 };
    /// The same thresholds, edge cells by their share, whole from 150 kPa: see docs/identification.md for how it was chosen.
    pub const COVERED: Self = Self { full_kpa: 150.0, ..Self::COUNTED };

    /// True when the pressures are finite, positive and in order.
    pub fn is_valid(&self) -> bool {
        self.off_kpa > 0.0
            && self.off_kpa <= self.on_kpa
            && self.on_kpa <= 1000.0
            && (self.full_kpa == 0.0 || (self.full_kpa >= self.on_kpa && self.full_kpa <= 2000.0))
    }
}

/// The share of a cell that is wholly in contact; shares are counted in these units.
pub const WHOLE: u16 = 256;

/// One cell: its thresholds as raw codes, and what share of it is in contact now.
#[derive(Clone, Copy, Debug)]
pub struct ContactCell {
    on: u16,
    off: u16,
    /// From this code on the cell counts whole.
    full: u16,
    /// Squared shares of [`WHOLE`] per kPa on the common curve; unused where `full` is below `off`.
    squared_shares_per_kpa: f32,
    share: u16,
    /// The codes that leave the share as it is: `low` and how many.
    low: u16,
    span: u16,
}

impl ContactCell {
    /// An unloaded cell; its thresholds lie above its offset.
    pub fn new(rule: &ContactRule, curve: &Curve, cell: &CellCalibration) -> Self {
        // One code below the threshold, so that a pressure which was quantised at exactly the threshold is in contact.
        let code_at = |kpa: f32| {
            let code = curve.first_code_at(kpa / cell.gain).saturating_sub(1).max(1);
            code.saturating_add(cell.offset).min(FULL_CODE)
        };
        let on = code_at(rule.on_kpa);
        let (full, squared_shares_per_kpa) = match rule.full_kpa {
            0.0 => (0, 0.0),
            full_kpa => (code_at(full_kpa), f32::from(WHOLE) * f32::from(WHOLE) * cell.gain / full_kpa),
        };
        Self { on, off: code_at(rule.off_kpa), full, squared_shares_per_kpa, share: 0, low: 0, span: on }
    }

    /// True where this code neither changes the share nor is to be reported nor is saturated: [`ContactCell::update`] is not due.
    #[inline(always)]
    pub fn is_unchanged(&self, code: u32) -> bool {
        // A code below `low` wraps to a number above any span.
        code.wrapping_sub(u32::from(self.low)) < u32::from(self.span)
    }

    /// Takes a code, which reads `curve_kpa` on the common curve, and returns the change of the share.
    ///
    /// Single precision and whole shares on every machine: the area is the same number wherever it is computed.
    pub fn update(&mut self, code: u32, curve_kpa: f32) -> i32 {
        let before = self.share;
        let threshold = if before > 0 { self.off } else { self.on };
        let whole_from = self.full.max(self.off);
        (self.share, self.low, self.span) = if code < u32::from(threshold) {
            (0, 0, self.on)
        } else if code >= u32::from(self.full) {
            (WHOLE, whole_from, FULL_CODE.saturating_sub(whole_from))
        } else {
            ((Real::sqrt(curve_kpa * self.squared_shares_per_kpa) as u16).clamp(1, WHOLE), 0, 0)
        };
        i32::from(self.share) - i32::from(before)
    }

    /// True where a part of the cell is in contact.
    pub fn is_loaded(&self) -> bool {
        self.share > 0
    }

    /// The load threshold: twice the code of a contact, above the unloaded cell's.
    pub(crate) fn load_threshold(&self, offset: u16) -> u32 {
        (2 * u32::from(self.on)).saturating_sub(offset.into())
    }

    /// Makes codes from `code` on count as changed, too.
    pub(crate) fn notify_at(&mut self, code: u32) {
        // Not above the span, which fits.
        self.span = code.saturating_sub(self.low.into()).min(self.span.into()) as u16;
    }

    /// Makes every code count as changed that differs from this one by more than [`SAME_CODE`].
    pub(crate) fn notify_on_change(&mut self, code: u16) {
        (self.low, self.span) = (code.saturating_sub(SAME_CODE), 2 * SAME_CODE + 1);
    }

    /// Makes no code count as changed: [`ContactCell::update`] is called in every frame, or never.
    pub(crate) fn disable(&mut self) {
        (self.low, self.span) = (0, u16::MAX);
    }

    /// Moves the thresholds of a cell out of contact with its offset.
    pub(crate) fn shift(&mut self, codes: i16) {
        for threshold in [&mut self.on, &mut self.off, &mut self.full] {
            // A full of 0 stands for counted cells.
            if *threshold > 0 {
                *threshold = threshold.saturating_add_signed(codes).clamp(1, FULL_CODE);
            }
        }
        (self.low, self.span) = (0, self.on);
    }
}

/// Largest difference of two codes that count as the same: far less than the changes of a loaded cell.
const SAME_CODE: u16 = 2;

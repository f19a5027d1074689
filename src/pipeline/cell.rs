//! One cell in the stages calibration, baseline, contact and region, and the evidence of faults that it collects.

use super::baseline::{Baseline, Rise};
use super::calibrate::{CellCalibration, Curve, is_saturated};
use super::contact::{ContactCell, ContactRule};
use super::marks::CellMarks;
use super::region::{AreaMoments, ForceMoments, RegionCell, RegionFrame};
use super::setup::{Division, SetupCell};
use crate::num::Real;

/// The parameters and the state of one cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct InsoleCell<R> {
    /// Code at zero pressure; [`u16::MAX`] for a masked cell.
    pub(crate) zero: u16,
    pub(crate) baseline: Baseline,
    pub(crate) contact: ContactCell,
    pub(crate) region: RegionCell<R>,
    pub(crate) marks: CellMarks,
}

impl<R: Real> InsoleCell<R> {
    /// A cell without contact.
    pub(crate) fn new(cell: &SetupCell, contact: &ContactRule, curve: &Curve, division: &Division) -> Self {
        let SetupCell { cell, calibration, row_column } = cell;
        let (x_mm, y_mm) = division.origins_mm[cell.region as usize];
        Self {
            zero: calibration.offset,
            baseline: Baseline::new(calibration),
            contact: ContactCell::new(contact, curve, calibration, 0.0),
            region: RegionCell::new(cell, calibration.gain, x_mm, y_mm),
            marks: CellMarks::new(*row_column),
        }
    }

    /// Updates contact and region with a code that may change them; returns the change of [`area_units`]. It is not inlined,
    /// because few cells change in a frame.
    #[cold]
    #[inline(never)]
    fn update(&mut self, code: u32, curve: &Curve, frame: &mut RegionFrame<R>) -> i32 {
        let curve_kpa: f32 = curve.pressure_kpa((code as i32 - i32::from(self.zero)).max(0));
        let before = area_units(&frame.area);
        let above_kpa = (curve_kpa - self.baseline.residual_kpa).max(0.0);
        frame.update_contact(&self.region, &mut self.contact, code, above_kpa);
        self.marks.note(code, self.baseline.code, &mut self.contact);
        frame.saturated |= is_saturated(code);
        area_units(&frame.area) - before
    }

    /// Lets the baseline follow a code of the lifted foot; see [`Baseline::follow`]. The contact follows with the next frame. True if
    /// the baseline has changed.
    pub(crate) fn follow(&mut self, code: u16, before: i16, rise: Rise, contact: &ContactRule, curve: &Curve) -> bool {
        let zero = (self.zero, self.marks.lowered);
        let Some((code, lowered)) = self.baseline.follow(code, before, rise, zero, curve) else { return false };
        self.marks.lowered = lowered;
        self.zero = self.zero.min(code);
        self.baseline.code = code;
        self.baseline.residual_kpa = curve.pressure_kpa(i32::from(code - self.zero));
        let calibration = CellCalibration { offset: self.zero, gain: self.baseline.gain };
        self.contact.rebase(ContactCell::new(contact, curve, &calibration, self.baseline.residual_kpa));
        true
    }
}

impl<R> InsoleCell<R> {
    /// Discards the evidence of the last step.
    pub(crate) fn begin_step(&mut self) {
        self.marks.begin_step(self.baseline.code, &mut self.contact);
    }
}

/// Calibrates the cells of a region, sums their forces, and updates the contact area if the contact of a cell changed. Returns the
/// change of [`area_units`]. If no pressure is found near the highest one of the frame before, [`RegionFrame::peak_code`] is 0 and
/// [`find_peak`] must be called. A device spends most of its time in this loop, which has a function of its own so that all registers
/// are available.
#[inline(never)]
pub(crate) fn sum_region<R: Real>(
    curve: &Curve,
    cells: &mut [InsoleCell<R>],
    codes: &[u16],
    frame: &mut RegionFrame<R>,
) -> i32 {
    let (mut force, mut change) = (ForceMoments::NONE, 0);
    // Pressures change little from frame to frame, so few cells must be compared.
    let candidate = frame.peak_code - (frame.peak_code >> 3);
    let mut peak = Peak { kpa: R::ZERO, code: 0 };
    frame.saturated = false;
    for (cell, &code) in cells.iter_mut().zip(codes) {
        let (code, zero) = (u32::from(code), u32::from(cell.zero));
        if !cell.contact.is_unchanged(code) {
            change += cell.update(code, curve, frame);
        }
        let above_zero = code as i32 - zero as i32;
        if above_zero > 0 {
            let curve_kpa = curve.pressure_kpa(above_zero);
            force.add(&cell.region, curve_kpa);
            if above_zero > candidate {
                peak.consider(cell, above_zero, curve_kpa);
            }
        }
    }
    (frame.peak_kpa, frame.peak_code) = (peak.kpa, peak.code);
    frame.force = force;
    change
}

/// The highest cell of a region. Its code is at least seven eighths of every other cell's, so it has the highest pressure as long as
/// the gains of the cells differ by a factor of less than 1.18.
struct Peak<R> {
    /// Pressure above the baseline, kPa.
    kpa: R,
    /// Code above zero pressure.
    code: i32,
}

impl<R: Real> Peak<R> {
    #[inline(always)]
    fn consider(&mut self, cell: &InsoleCell<R>, code: i32, curve_kpa: R) {
        let kpa = (curve_kpa - R::of_f32(cell.baseline.residual_kpa)) * R::of_f32(cell.baseline.gain);
        if kpa > self.kpa {
            *self = Self { kpa, code };
        }
    }
}

/// Finds the highest cell of a region among all cells, after a frame with much higher pressures.
#[cold]
#[inline(never)]
pub(crate) fn find_peak<R: Real>(curve: &Curve, cells: &[InsoleCell<R>], codes: &[u16], frame: &mut RegionFrame<R>) {
    let mut peak = Peak { kpa: R::ZERO, code: 0 };
    for (cell, &code) in cells.iter().zip(codes) {
        let above_zero = i32::from(code) - i32::from(cell.zero);
        if above_zero > 0 {
            peak.consider(cell, above_zero, curve.pressure_kpa(above_zero));
        }
    }
    (frame.peak_kpa, frame.peak_code) = (peak.kpa, peak.code);
}

/// Right shift with which the sum of the area units over all regions fits into 32 bits.
pub(crate) const AREA_SHIFT: u32 = 4;

/// Contact area of a region, in units with which the sum over all regions fits into 32 bits.
#[inline(always)]
pub(crate) fn area_units(moments: &AreaMoments) -> i32 {
    moments.units() >> AREA_SHIFT
}

/// The force of the baselines of a region's cells, and its moments about the region's reference point.
pub(crate) fn residual<R: Real>(cells: &[InsoleCell<R>]) -> ForceMoments<R> {
    let mut residual = ForceMoments::NONE;
    for cell in cells.iter().filter(|cell| cell.baseline.residual_kpa > 0.0 && !cell.marks.is_masked()) {
        residual.add(&cell.region, R::of_f32(cell.baseline.residual_kpa));
    }
    residual
}

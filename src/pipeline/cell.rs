//! One cell in the stages calibration, baseline, contact and region, and the evidence of faults that it collects.

use super::baseline::{Baseline, Rise};
use super::calibrate::{CellCalibration, Curve, is_saturated};
use super::contact::{ContactCell, ContactRule};
use super::marks::CellMarks;
use super::region::{AreaMoments, ContactArea, ForceMoments, RegionCell, RegionFrame};
use super::setup::{Division, SetupCell};
use crate::num::Real;

/// The parameters and the state of one cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct InsoleCell<R> {
    pub(crate) baseline: Baseline,
    pub(crate) contact: ContactCell,
    pub(crate) region: RegionCell<R>,
    pub(crate) marks: CellMarks,
    /// The share in contact in the frame of the largest force of the region since heel strike.
    share_at_peak: u16,
}

impl<R: Real> InsoleCell<R> {
    /// A cell without contact.
    pub(crate) fn new(cell: &SetupCell, contact: &ContactRule, curve: &Curve, division: &Division) -> Self {
        let calibration = &cell.calibration();
        let (x_mm, y_mm) = division.origins_mm[cell.region as usize];
        Self {
            baseline: Baseline::new(calibration),
            contact: ContactCell::new(contact, curve, calibration, 0.0),
            region: RegionCell::new(&cell.cell(), calibration.gain, x_mm, y_mm),
            marks: CellMarks::new(cell.row_column),
            share_at_peak: 0,
        }
    }

    /// Force of the cell at a code, N. It includes the residual pressure, because it is computed from the code above the zero,
    /// not above the baseline. 0 for a masked cell.
    pub(crate) fn force_above_zero_n(&self, code: u16, curve: &Curve) -> R {
        if self.marks.is_masked() {
            return R::ZERO;
        }
        self.region.force_n(curve.pressure_kpa(code.saturating_sub(self.baseline.zero).into()))
    }

    /// Processes a code for which [`ContactCell::is_unchanged`] is false. True if the cell has pressure.
    #[inline(always)]
    fn change(&mut self, code: u32, curve: &Curve, frame: &mut RegionFrame<R>) -> bool {
        let has_pressure = code > self.baseline.zero.into();
        // A cell without contact remains so at zero pressure.
        if has_pressure || self.contact.is_loaded() {
            self.update(code, curve, frame);
        }
        has_pressure
    }

    /// The amount by which the pressure of a code exceeds that of the baseline, on the sensor curve that all cells share, kPa; at
    /// least 0.
    pub(crate) fn above_kpa(&self, code: u32, curve: &Curve) -> f32 {
        let curve_kpa: f32 = curve.pressure_kpa((code as i32 - i32::from(self.baseline.zero)).max(0));
        (curve_kpa - self.baseline.residual_kpa).max(0.0)
    }

    /// Updates contact and region with a code that may change them, unless the cell is masked. It is not inlined, because few
    /// cells change in a frame.
    #[cold]
    #[inline(never)]
    fn update(&mut self, code: u32, curve: &Curve, frame: &mut RegionFrame<R>) {
        if self.marks.is_masked() {
            return;
        }
        let above_kpa = self.above_kpa(code, curve);
        frame.update_contact(&self.region, &mut self.contact, code, self.baseline.zero, above_kpa);
        self.marks.note(code, self.baseline.code, &mut self.contact);
        frame.saturated |= is_saturated(code);
    }

    /// Lets the baseline follow a code of the lifted foot; see [`Baseline::follow`]. The contact follows with the next frame.
    /// True if the baseline has changed.
    pub(crate) fn follow(&mut self, code: u16, before: i16, rise: Rise, contact: &ContactRule, curve: &Curve) -> bool {
        let baseline = &mut self.baseline;
        let Some((code, lowered)) = baseline.follow(code, before, rise, self.marks.lowered, curve) else {
            return false;
        };
        self.marks.lowered = lowered;
        baseline.zero = baseline.zero.min(code);
        baseline.code = code;
        baseline.residual_kpa = curve.pressure_kpa(i32::from(code - baseline.zero));
        let calibration = CellCalibration { offset: baseline.zero, gain: baseline.gain };
        self.contact.rebase(ContactCell::new(contact, curve, &calibration, baseline.residual_kpa));
        true
    }
}

impl<R> InsoleCell<R> {
    /// Discards the evidence of the last step.
    pub(crate) fn begin_step(&mut self) {
        self.marks.begin_step(self.baseline.code, &mut self.contact);
    }

    /// Stores the present share in contact as that of the frame of the largest force.
    pub(crate) fn store_share(&mut self) {
        self.share_at_peak = self.contact.share();
    }
}

/// Area moments of the cells of a region.
pub(crate) fn area_moments<R>(cells: &[InsoleCell<R>]) -> AreaMoments {
    sum_moments(cells, |cell| cell.contact.share())
}

/// Area moments of the cells of a region in the frame of its largest force.
pub(crate) fn area_moments_at_peak<R>(cells: &[InsoleCell<R>]) -> AreaMoments {
    sum_moments(cells, |cell| cell.share_at_peak)
}

fn sum_moments<R>(cells: &[InsoleCell<R>], share: impl Fn(&InsoleCell<R>) -> u16) -> AreaMoments {
    let mut moments = AreaMoments::NONE;
    cells.iter().for_each(|cell| moments.add(&cell.region, share(cell)));
    moments
}

/// Converts the codes of a region's cells to pressures, sums their forces, and updates the contact area. `COVERED` states whether
/// cells can be in contact in part. Returns the code of the *highest cell*, the one with the largest pressure, minus its code at
/// zero pressure; 0 if no cell exceeds [`candidate`] of the [`RegionFrame::peak_code`] of the previous frame. If
/// [`Residual::may_exceed`] is true, another cell may be the highest one, and [`find_peak`] must be called.
#[inline(always)]
pub(crate) fn sum_region<R: Real, const COVERED: bool>(
    curve: &Curve,
    cells: &mut [InsoleCell<R>],
    codes: &[u16],
    frame: &mut RegionFrame<R>,
) -> i32 {
    // Pressures change little from frame to frame, so few cells must be compared.
    let candidate = candidate(frame.peak_code);
    let (force, area_change) = (ForceMoments::NONE, ContactArea::NONE);
    let mut sums = Sums { force, area_change, candidate, peak: Peak { kpa: R::ZERO, code: 0 } };
    (frame.saturated, frame.is_count_changed) = (false, false);
    // The loop is unrolled. In a loop over single cells, a tenth of the instructions of this function would be those of the
    // loop itself.
    let (groups, last_cells) = cells.as_chunks_mut::<UNROLLED>();
    let (code_groups, last_codes) = codes.as_chunks::<UNROLLED>();
    for (group, group_codes) in groups.iter_mut().zip(code_groups) {
        for (cell, code) in group.iter_mut().zip(group_codes) {
            sums.add::<COVERED>(curve, cell, *code, frame);
        }
    }
    for (cell, code) in last_cells.iter_mut().zip(last_codes) {
        sums.add::<COVERED>(curve, cell, *code, frame);
    }
    frame.peak_kpa = sums.peak.kpa;
    frame.force = sums.force;
    frame.area.add(sums.area_change);
    sums.peak.code
}

/// The highest code above zero pressure of the cells that [`sum_region`] does not compare, if the previous frame had this
/// [`RegionFrame::peak_code`].
#[inline(always)]
fn candidate(peak_code: i32) -> i32 {
    peak_code - (peak_code >> 3)
}

/// Number of cells that [`sum_region`] processes in each pass of its unrolled loop.
const UNROLLED: usize = 2;

/// The sums over the cells of a region, and its highest cell so far.
struct Sums<R> {
    force: ForceMoments<R>,
    /// Change of the area of the cells that remain in contact in part.
    area_change: ContactArea,
    /// A cell is compared with the highest cell so far only if its code above zero pressure exceeds this code.
    candidate: i32,
    peak: Peak<R>,
}

impl<R: Real> Sums<R> {
    #[inline(always)]
    fn add<const COVERED: bool>(
        &mut self,
        curve: &Curve,
        cell: &mut InsoleCell<R>,
        code: u16,
        frame: &mut RegionFrame<R>,
    ) {
        let code = u32::from(code);
        if cell.contact.is_unchanged(code) || cell.change(code, curve, frame) {
            let above_zero = code as i32 - i32::from(cell.baseline.zero);
            let curve_kpa = curve.pressure_kpa(above_zero);
            self.force.add(&cell.region, curve_kpa);
            if COVERED {
                let above_kpa = curve.pressure_kpa::<f32>(above_zero) - cell.baseline.residual_kpa;
                self.area_change.change(&cell.region, cell.contact.update_part(above_kpa));
            }
            if above_zero > self.candidate {
                self.peak.consider(cell, above_zero, curve_kpa);
            }
        }
    }
}

/// The highest cell of a region. In [`sum_region`], a cell that was not compared has a code above zero pressure of at most seven
/// eighths of the previous frame's [`RegionFrame::peak_code`]. That value is the code of the highest cell minus
/// [`Residual::code`], because a cell without residual pressure may have a higher pressure at a lower code.
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

/// Finds the highest cell of a region among all cells. Returns its code above zero pressure.
#[cold]
#[inline(never)]
pub(crate) fn find_peak<R: Real>(
    curve: &Curve,
    cells: &[InsoleCell<R>],
    codes: &[u16],
    frame: &mut RegionFrame<R>,
) -> i32 {
    let mut peak = Peak { kpa: R::ZERO, code: 0 };
    for (cell, &code) in cells.iter().zip(codes) {
        let above_zero = i32::from(code) - i32::from(cell.baseline.zero);
        if above_zero > 0 {
            peak.consider(cell, above_zero, curve.pressure_kpa(above_zero));
        }
    }
    frame.peak_kpa = peak.kpa;
    peak.code
}

/// Right shift with which the sum of the area units over all regions fits into 32 bits.
pub(crate) const AREA_SHIFT: u32 = 4;

/// Contact area of a region, in units with which the sum over all regions fits into 32 bits.
#[inline(always)]
pub(crate) fn area_units(area: &ContactArea) -> i32 {
    area.units() >> AREA_SHIFT
}

/// The residual pressure of a region's cells, that is, the pressure of their baselines.
#[derive(Debug)]
pub(crate) struct Residual<R> {
    /// Force of the baselines, and its moments about the region's reference point.
    pub(crate) force: ForceMoments<R>,
    /// The largest difference between the code of a cell's baseline and its code at zero pressure.
    pub(crate) code: i32,
    /// Largest gain of the cells. It is 0 if their gains are equal and no cell has residual pressure: of two cells, the one with
    /// the higher code then always has the higher pressure.
    pub(crate) most_gain: R,
}

impl<R: Real> Residual<R> {
    /// No residual pressure.
    pub(crate) const NONE: Self = Self { force: ForceMoments::NONE, code: 0, most_gain: R::ZERO };

    /// The baselines of these cells, which must be those of one region.
    pub(crate) fn of(cells: &[InsoleCell<R>]) -> Self {
        let mut residual = Self::NONE;
        for cell in cells.iter().filter(|cell| cell.baseline.residual_kpa > 0.0 && !cell.marks.is_masked()) {
            residual.force.add(&cell.region, R::of_f32(cell.baseline.residual_kpa));
            residual.code = residual.code.max(i32::from(cell.baseline.code) - i32::from(cell.baseline.zero));
        }
        let gains = || cells.iter().map(|cell| cell.baseline.gain);
        let most_gain = gains().fold(0.0, f32::max);
        if residual.code > 0 || gains().any(|gain| gain != most_gain) {
            residual.most_gain = R::of_f32(most_gain);
        }
        residual
    }

    /// True if a cell that [`sum_region`] has not compared may have a pressure above `peak_kpa`. `code_before` is the
    /// [`RegionFrame::peak_code`] of the previous frame, and above 0.
    #[inline(always)]
    pub(crate) fn may_exceed(&self, peak_kpa: R, code_before: i32, curve: &Curve) -> bool {
        self.most_gain > R::ZERO && peak_kpa < curve.pressure_kpa::<R>(candidate(code_before)) * self.most_gain
    }
}

//! One insole: connects the stages of the pipeline and the fault detection. Parameters are separate from state and can be
//! replaced while running.

mod alerts;
mod records;
mod set_up;
mod zero;

pub use zero::NotLifted;

use crate::faults::{FaultDetector, Faults, FrameContext, MatrixRows};
use crate::num::Real;
use crate::pipeline::alert::{AlertRules, Alerts, DailyLoad};
use crate::pipeline::calibrate::Curve;
use crate::pipeline::cell::{InsoleCell, Residual, area_moments, area_units, find_peak, sum_region};
use crate::pipeline::cumulative::{CumulativeLoad, LOADED_KPA};
use crate::pipeline::ellipse::Ellipse;
use crate::pipeline::lift::is_unloaded;
use crate::pipeline::live::{LiveModel, RegionLoad};
use crate::pipeline::measures::Extent;
use crate::pipeline::model::ForceLaw;
use crate::pipeline::setup::{Division, Setup};
use crate::pipeline::stance::{BRIDGED_FRAMES, Stance};
use crate::pipeline::stance_rule::{Rejected, StanceLimits};
use crate::pipeline::track::Tracker;
use heapless::Vec;

/// An insole with at most `N` cells: the parameters and the state of all stages between raw codes and steps. The documentation of
/// the crate has an example.
#[derive(Debug)]
pub struct Insole<R, const N: usize> {
    /// [`Setup::period_us`] is 0 until [`Insole::set_up`].
    setup: Setup,
    curve: Curve,
    cells: Vec<InsoleCell<R>, N>,
    division: Division,
    rows: MatrixRows,
    frame_rate_hz: R,
    limits: StanceLimits<R>,
    tissue_id: u32,
    force_laws: [ForceLaw<R>; 8],

    tracker: Tracker<R>,
    live: [LiveModel<R>; 8],
    stance: Stance<R>,
    loads: [RegionLoad<R>; 8],
    /// The baselines of each region.
    residuals: [Residual<R>; 8],
    /// Centre of pressure of the foot, foot coordinates, mm; in a frame without force, that of the last frame with force.
    centre_mm: (R, R),
    extent: Extent,
    detector: FaultDetector,
    /// [`AlertRules::UNSET`] until [`Insole::set_up`].
    alert_rules: AlertRules,
    cumulative: CumulativeLoad<R>,
    alerts: Alerts,
    /// Number of seconds left to lift the foot for a requested measurement of the baselines; 0 without a request.
    zero_s: u8,
    /// The load that was stored before this start.
    earlier: DailyLoad,
    /// Start of the day, minutes after midnight UTC, with which the number of the day of `earlier` was computed: that of the
    /// alert rules ([`AlertRules::day_start_min`]) in the boot that stored it.
    earlier_start_min: u16,
    /// The last frame completed a second of the cumulative load.
    has_ended_second: bool,
    /// Number of the last frame.
    last_seq: Option<u32>,
    /// Number of times that the frame number has wrapped.
    wraps: u32,
    /// Number of the next record.
    next_record: u32,
}

/// The frame, for the fault detection. It is a macro, because a function would borrow the whole insole, with its detector.
macro_rules! frame_context {
    ($insole:ident, $seq:ident, $codes:ident) => {
        FrameContext {
            cells: &mut $insole.cells,
            division: &$insole.division,
            curve: &$insole.curve,
            setup: &$insole.setup,
            rows: &$insole.rows,
            codes: $codes,
            loads: &mut $insole.loads,
            seq: $seq,
            wraps: $insole.wraps,
        }
    };
}

impl<R: Real, const N: usize> Insole<R, N> {
    /// An insole without cells; see [`Insole::set_up`]. All of its bytes are zero, so that a static insole occupies no flash.
    pub const fn new() -> Self {
        const {
            assert!(N <= 4096, "an insole has at most 4096 cells");
        }
        Self {
            setup: Setup::NONE,
            curve: Curve::new(),
            cells: Vec::new(),
            division: Division::NONE,
            rows: MatrixRows::NONE,
            frame_rate_hz: R::ZERO,
            limits: StanceLimits::NONE,
            tissue_id: 0,
            force_laws: [ForceLaw::NONE; 8],
            tracker: Tracker::OFF,
            live: [LiveModel::NEW; 8],
            stance: Stance::new(),
            loads: [RegionLoad::NONE; 8],
            residuals: [const { Residual::NONE }; 8],
            centre_mm: (R::ZERO, R::ZERO),
            extent: Extent { heel_mm: 0.0, toe_mm: 0.0, forefoot_width_mm: 0.0 },
            detector: FaultDetector::new(),
            alert_rules: AlertRules::UNSET,
            cumulative: CumulativeLoad::new(),
            alerts: Alerts::NONE,
            zero_s: 0,
            earlier: DailyLoad::NONE,
            earlier_start_min: 0,
            has_ended_second: false,
            last_seq: None,
            wraps: 0,
            next_record: 0,
        }
    }

    /// Processes frame number `seq` with one raw code for each cell. True if the frame confirms toe off: then
    /// [`Insole::step_region`] and [`Insole::step`] return the step, until the next frame is processed. The call has no effect
    /// before [`Insole::set_up`], or if there are fewer codes than cells. Sequence numbers wrap; a difference of more than 1
    /// between two frames means that frames are missing.
    #[inline(never)]
    pub fn frame(&mut self, seq: u32, codes: &[u16]) -> bool {
        if self.setup().is_none() || codes.len() < self.cells() {
            return false;
        }
        let (mut rate_hz, mut elapsed_frames) = (self.frame_rate_hz, 1);
        if let Some(last) = self.last_seq.replace(seq) {
            elapsed_frames = seq.wrapping_sub(last);
            self.wraps += u32::from(seq < last && elapsed_frames < 1 << 31);
            if elapsed_frames > 1 {
                rate_hz = rate_hz / R::of_u32(elapsed_frames);
            }
        }
        self.sum_cells(seq, codes);
        for ((load, live), &law) in self.loads.iter_mut().zip(&mut self.live).zip(&self.force_laws) {
            load.tissue = live.update(&law, load.frame.area.area_mm2(), rate_hz);
        }
        self.accumulate(if elapsed_frames > 1 { self.represented_frames(elapsed_frames) } else { 1 });
        let centre_mm = self.update_centre();
        let regions = self.loads.each_ref().map(|load| &load.frame);
        let mut is_toe_off = self.stance.push(&self.limits, seq, &regions, centre_mm);
        let at_peak = self.stance.at_peak();
        if at_peak != 0 {
            self.store_shares(at_peak);
        }
        if seq == self.stance.start_seq() {
            self.loads.iter_mut().for_each(|load| load.frame.restart_count());
        }
        if self.stance.has_settled(&self.limits) {
            is_toe_off |= self.confirm_lift(codes);
        }
        if self.stance.is_lifted() {
            self.review_cells(seq, codes);
        } else if self.detector.interrupt_review(self.stance.carries_load()) {
            self.sum_residuals();
        }
        is_toe_off
    }

    /// To be called when the total force has been constant for the settling time. Checks whether the foot is lifted. True if this
    /// confirms toe off.
    #[cold]
    #[inline(never)]
    fn confirm_lift(&mut self, codes: &[u16]) -> bool {
        is_unloaded(&self.cells, codes, &self.curve, self.stance.standing_n()) && self.stance.lift(&self.limits)
    }

    /// Stores the covered share of each cell in the regions with a bit in `at_peak`.
    #[inline(never)]
    fn store_shares(&mut self, at_peak: u8) {
        for region in (0..8).filter(|region| at_peak >> region & 1 != 0) {
            self.cells[self.division.cells(region)].iter_mut().for_each(InsoleCell::store_share);
        }
    }

    /// Number of frames that the first frame after missing ones represents in the cumulative load: under load, itself and at most
    /// as many missing frames as a stance bridges; without load, at most a second of frames, which is longer than the time
    /// between two scans of an insole that is not worn.
    #[cold]
    fn represented_frames(&self, elapsed_frames: u32) -> u32 {
        elapsed_frames.min(if self.is_loaded() { 1 + BRIDGED_FRAMES } else { self.cumulative.second_frames() })
    }

    /// True if the pressure of any cell was at least [`LOADED_KPA`] in the last frame.
    pub fn is_loaded(&self) -> bool {
        let loaded_kpa = R::of_f32(LOADED_KPA);
        self.loads.iter().any(|load| load.frame.peak_kpa >= loaded_kpa)
    }

    /// Time from frame 0 to the recent frame with this number, us; also correct after the number has wrapped.
    pub fn time_us(&self, seq: u32) -> u64 {
        // A frame with a greater number than the last one was before the last wrap.
        let wraps = self.wraps - u32::from(self.wraps > 0 && self.last_seq.is_some_and(|last| seq > last));
        (u64::from(wraps) << 32 | u64::from(seq)) * u64::from(self.setup.period_us)
    }

    /// Adds the wraps of the frame number to `time_us`, which a stage has computed from the frame number alone, us.
    fn unwrapped_us(&self, time_us: u64) -> u64 {
        self.time_us(time_us.checked_div(u64::from(self.setup.period_us)).unwrap_or(0) as u32)
    }

    /// Computes and returns the centre of pressure of the foot; without force, the last one remains.
    fn update_centre(&mut self) -> (R, R) {
        let (mut force_n, mut x_n_mm, mut y_n_mm) = (R::ZERO, R::ZERO, R::ZERO);
        for (load, origin_mm) in self.loads.iter().zip(&self.division.origins_mm) {
            let force = &load.frame.force;
            force_n += force.force_n;
            x_n_mm += force.x_n_mm + force.force_n * R::of_f32(origin_mm.0);
            y_n_mm += force.y_n_mm + force.force_n * R::of_f32(origin_mm.1);
        }
        if force_n > R::ZERO {
            let per_n = R::ONE / force_n;
            self.centre_mm = (x_n_mm * per_n, y_n_mm * per_n);
        }
        self.centre_mm
    }

    /// Measures the baselines of some cells while the foot is lifted, and checks these cells for faults.
    #[cold]
    #[inline(never)]
    fn review_cells(&mut self, seq: u32, codes: &[u16]) {
        let mut frame = frame_context!(self, seq, codes);
        if self.detector.lifted_frame(&mut frame, &mut self.stance.has_walked) {
            self.sum_residuals();
        }
    }

    /// Sums the baselines of each region.
    #[cold]
    #[inline(never)]
    fn sum_residuals(&mut self) {
        for (region, residual) in self.residuals.iter_mut().enumerate() {
            *residual = Residual::of(&self.cells[self.division.cells(region)]);
        }
    }

    /// Sums the cells, then runs the fault detection if this frame needs it.
    fn sum_cells(&mut self, seq: u32, codes: &[u16]) {
        let change = match self.setup.contact.full_kpa > 0.0 {
            true => self.sum_regions::<true>(codes),
            false => self.sum_regions::<false>(codes),
        };
        let is_mostly_in_contact = self.detector.update_contact_area(change);
        // A cell was saturated in the stance that is in progress, or in the last one.
        let is_saturated = self.stance.saturated() != 0;
        if self.detector.has_masks() || is_saturated || !is_mostly_in_contact {
            self.detect_faults(seq, codes, is_saturated);
        }
    }

    /// Sums the cells region by region. `COVERED` states whether cells can be in contact in part. Returns the change of the
    /// contact area, in the units of [`area_units`]. A device spends most of its time in this function, which is not inlined, so
    /// that all registers are available.
    #[inline(never)]
    fn sum_regions<const COVERED: bool>(&mut self, codes: &[u16]) -> i32 {
        let (mut cells, mut codes) = (self.cells.as_mut_slice(), codes);
        let (mut start, mut change) = (0, 0);
        for ((load, residual), &end) in self.loads.iter_mut().zip(&self.residuals).zip(&self.division.ends) {
            // The ends increase, the last end is the number of cells, and `frame` has checked the number of codes.
            let (region_cells, other_cells) = cells.split_at_mut(end - start);
            let (region_codes, other_codes) = codes.split_at(end - start);
            let frame = &mut load.frame;
            let (code_before, area_before) = (frame.peak_code, area_units(&frame.area));
            let mut peak_code = sum_region::<R, COVERED>(&self.curve, region_cells, region_codes, frame);
            change += area_units(&frame.area) - area_before;
            if code_before > 0 && (peak_code == 0 || residual.may_exceed(frame.peak_kpa, code_before, &self.curve)) {
                peak_code = find_peak(&self.curve, region_cells, region_codes, frame);
            }
            frame.force.subtract(&residual.force);
            frame.peak_code = peak_code - residual.code;
            (cells, codes, start) = (other_cells, other_codes, end);
        }
        change
    }

    /// Interpolates masked cells and runs the fault detection. It is not inlined, because a frame with most of the
    /// insole in contact, and without masked or saturated cells, needs neither.
    #[cold]
    #[inline(never)]
    fn detect_faults(&mut self, seq: u32, codes: &[u16], is_saturated: bool) {
        let mut frame = frame_context!(self, seq, codes);
        self.detector.interpolate(&mut frame);
        self.detector.frame(&mut frame, is_saturated);
    }

    /// The faults that were detected since [`Insole::set_up`].
    pub fn faults(&self) -> &Faults {
        self.detector.faults()
    }

    /// Bit i: region i has masked cells.
    pub fn masked(&self) -> u8 {
        self.detector.masked()
    }

    /// Measured and modelled quantities of the regions in the last frame, in the order of [`crate::Region::ALL`].
    pub fn loads(&self) -> &[RegionLoad<R>; 8] {
        &self.loads
    }

    /// Contact ellipse of a region in the last frame, foot coordinates; `None` without contact.
    ///
    /// # Panics
    /// If `region` is not an index of [`crate::Region::ALL`].
    pub fn ellipse(&self, region: usize) -> Option<Ellipse<R>> {
        let moments = area_moments(&self.cells[self.division.cells(region)]);
        Ellipse::from_moments(&moments).map(|ellipse| self.to_foot_coordinates(region, ellipse))
    }

    /// Centre of pressure of a region in the last frame, foot coordinates, mm; `None` without force.
    ///
    /// # Panics
    /// If `region` is not an index of [`crate::Region::ALL`].
    pub fn centre_of_pressure_mm(&self, region: usize) -> Option<(R, R)> {
        let (x_mm, y_mm) = self.loads[region].frame.force.centre_of_pressure_mm()?;
        let origin = self.division.origins_mm[region];
        Some((x_mm + R::of_f32(origin.0), y_mm + R::of_f32(origin.1)))
    }

    /// Centre of pressure of the foot in the last frame, foot coordinates, mm; `None` unless the foot is on the ground.
    pub fn foot_centre_mm(&self) -> Option<(R, R)> {
        self.on_ground().then_some(self.centre_mm)
    }

    /// Converts an ellipse from the coordinates of its region to foot coordinates.
    fn to_foot_coordinates(&self, region: usize, ellipse: Ellipse<R>) -> Ellipse<R> {
        let (x_mm, y_mm) = self.division.origins_mm[region];
        ellipse.moved(R::of_f32(x_mm), R::of_f32(y_mm))
    }

    /// True from heel strike until toe off is confirmed, and during contacts that will not become steps.
    pub fn on_ground(&self) -> bool {
        self.stance.on_ground()
    }

    /// Number of frames from heel strike to toe off of the present or last contact; 1 if the force has not reached the threshold
    /// of toe off. In a contact that does not become a step because it is too long or lacks frames, the number has no meaning.
    pub fn stance_frames(&self) -> u32 {
        self.stance.frames()
    }

    /// Total force in the last frame, N: the sum of the forces of the regions.
    pub fn total_n(&self) -> R {
        self.loads.iter().map(|load| load.frame.force.force_n).sum()
    }

    /// Number of contacts so far that did not become steps.
    pub fn rejected(&self) -> Rejected {
        self.stance.rejected()
    }
}

impl<R: Real, const N: usize> Default for Insole<R, N> {
    fn default() -> Self {
        Self::new()
    }
}

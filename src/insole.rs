//! The whole way of the data for one insole: parameters set once or swapped while running, state kept apart.

use crate::calibrate::{CellCalibration, Curve, SensorLaw, is_saturated};
use crate::contact::{ContactCell, ContactRule};
use crate::ellipse::Ellipse;
use crate::fault::{self, CellWatch, Faults, Seen, Watch};
use crate::live::{LiveModel, LiveTissue};
use crate::model::Gauge;
use crate::num::Real;
use crate::region::{
    Cell, ForceMoments, MAX_CELL_MM2, MAX_REACH_MM, MAX_REGION_MM2, MIN_CELL_MM2, Region, RegionCell, RegionFrame, Side,
};
use crate::stance::{Rejected, Stance, StanceLimits, StanceRule};
use crate::step::{RegionStep, StepRecord};
use crate::wire::{Refusal, checksum, encode};
use core::fmt;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Cells that a device holds; a host may hold more.
pub const DEVICE_CELLS: usize = 256;

/// Shortest and longest time between frames, us: 500 Hz to 20 Hz. Devices run at 50 to 400 Hz, recordings beyond.
pub const PERIOD_US: core::ops::RangeInclusive<u32> = 2_000..=50_000;

/// Cells lie within this distance of the origin along an axis, mm: any sheet, in any unit that was meant.
const FARTHEST_MM: f32 = 10_000.0;

/// Everything that is set about an insole except its cells and its wearer's tissue.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// The foot.
    pub side: Side,
    /// Identifies the layout in every hello.
    pub layout_id: u32,
    /// Time between frames, us, within [`PERIOD_US`].
    pub period_us: u32,
    /// The cells' common law.
    pub sensor: SensorLaw,
    /// What counts as contact.
    pub contact: ContactRule,
    /// What counts as a step.
    pub stance: StanceRule,
}

impl Setup {
    /// All zero.
    const NONE: Self = Self {
        side: Side::Left,
        layout_id: 0,
        period_us: 0,
        sensor: SensorLaw { full_kpa: 0.0, exponent: 0.0 },
        contact: ContactRule { on_kpa: 0.0, off_kpa: 0.0, full_kpa: 0.0 },
        stance: StanceRule { strike_n: 0.0, release_n: 0.0, min_stance_ms: 0, min_swing_ms: 0, max_stance_ms: 0 },
    };
}

/// One cell as it is set up: where it lies and how it reads. Cells come in the order of their codes in a frame, grouped by
/// region in the order of [`Region::ALL`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SetupCell {
    /// Where it lies.
    pub cell: Cell,
    /// How it reads.
    pub calibration: CellCalibration,
    /// Where the matrix reads it, row times 16 and column: faults of a line are told as such. Without meaning in an insole of
    /// more than [`fault::CROSSINGS`] cells.
    pub crossing: u8,
}

/// The wearer's tissue.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Tissue {
    /// Identifies the parameter set in every hello: the checksum of the gauges; 0 for none.
    pub id: u32,
    /// Per region in the order of [`Region::ALL`].
    pub gauges: [Gauge<f32>; 8],
}

impl Tissue {
    /// No parameters: areas and measured forces are valid, deformation and model force 0.
    pub const NONE: Self = Self { id: 0, gauges: [Gauge::NONE; 8] };

    /// A set with its id.
    pub fn new(gauges: [Gauge<f32>; 8]) -> Self {
        // On the wire every number takes its own four bytes, so all fit.
        let mut bytes = [0; size_of::<[Gauge<f32>; 8]>()];
        let id = encode(&gauges, &mut bytes).map_or(0, |bytes| checksum(bytes));
        // 0 stands for no parameters.
        Self { id: id.max(1), gauges }
    }

    /// Finds a damaged or mixed set, and values out of bounds; [`Tissue::NONE`] is no set either.
    pub fn check(&self) -> Result<(), Refusal> {
        if self.id != Self::new(self.gauges).id {
            return Err(Refusal::TissueId);
        }
        let bad = Region::ALL.into_iter().zip(&self.gauges).find(|(_, gauge)| !gauge.is_valid());
        bad.map_or(Ok(()), |(region, _)| Err(Refusal::Tissue(region)))
    }
}

/// Why a set-up was refused; the one before stays in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetupError {
    /// The frame period is outside of [`PERIOD_US`].
    Period,
    /// Sensor law out of range.
    Sensor,
    /// Contact rule out of range or order.
    Contact,
    /// Stance rule out of range or order.
    Stance,
    /// More cells than this device holds.
    TooManyCells,
    /// No cells at all.
    NoCells,
    /// This cell is not finite or metres away, has no or too much area, lies too far from its region, or has a bad calibration.
    Cell(u16),
    /// This cell's region comes before the one of the cell before it.
    RegionOrder(u16),
}

impl fmt::Display for SetupError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Period => write!(f, "frame period outside of {} to {} us", PERIOD_US.start(), PERIOD_US.end()),
            Self::Sensor => f.write_str("sensor law out of range"),
            Self::Contact => f.write_str("contact rule out of range: needs 0 < off_kpa <= on_kpa <= full_kpa"),
            Self::Stance => {
                f.write_str("stance rule out of range: needs 0 < release_n <= strike_n and rising durations")
            }
            Self::TooManyCells => f.write_str("more cells than this device holds"),
            Self::NoCells => f.write_str("no cells"),
            Self::Cell(i) => write!(
                f,
                "cell {i} is not finite, has no or too much area, lies too far from its region, or has a bad calibration"
            ),
            Self::RegionOrder(i) => write!(f, "cell {i} is out of the order of regions"),
        }
    }
}

impl core::error::Error for SetupError {}

/// One region in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegionLoad<R> {
    /// What the cells say.
    pub frame: RegionFrame<R>,
    /// What the model says.
    pub tissue: LiveTissue<R>,
}

impl<R: Real> RegionLoad<R> {
    /// Unloaded.
    pub const NONE: Self = Self { frame: RegionFrame::NONE, tissue: LiveTissue::NONE };
}

/// One cell through the stages: calibrate, contact, region; and what is noted of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct InsoleCell<R> {
    pub(crate) offset: u16,
    pub(crate) contact: ContactCell,
    pub(crate) region: RegionCell<R>,
    pub(crate) watch: CellWatch,
}

impl<R: Real> InsoleCell<R> {
    /// Without contact.
    fn new(cell: &SetupCell, contact: &ContactRule, curve: &Curve, division: &Division) -> Self {
        let SetupCell { cell, calibration, crossing } = cell;
        let (x_mm, y_mm) = division.origins_mm[cell.region as usize];
        Self {
            offset: calibration.offset,
            contact: ContactCell::new(contact, curve, calibration),
            region: RegionCell::new(cell, calibration.gain, x_mm, y_mm),
            watch: CellWatch::new(*crossing),
        }
    }

    /// Brings the region up to date with a code that is not settled, and returns the change of [`fault::area`]. Out of the way:
    /// few cells change in a frame.
    #[cold]
    #[inline(never)]
    fn settle(&mut self, code: u32, curve: &Curve, frame: &mut RegionFrame<R>) -> i32 {
        let curve_kpa = curve.pressure_kpa((code as i32 - i32::from(self.offset)).max(0));
        let before = fault::area(&frame.area);
        frame.area.change(&self.region, self.contact.settle(code, curve_kpa));
        self.watch.note(code, self.offset, &mut self.contact);
        frame.saturated |= is_saturated(code);
        fault::area(&frame.area) - before
    }
}

/// Calibrates a region's cells, adds up their force and, where a cell's contact changed, brings the area up to date; returns
/// the change of [`fault::area`]. The hottest loop of the device, alone in a function so that it has all registers.
#[inline(never)]
fn sum_region<R: Real>(curve: &Curve, cells: &mut [InsoleCell<R>], codes: &[u16], frame: &mut RegionFrame<R>) -> i32 {
    let (mut force, mut change) = (ForceMoments::NONE, 0);
    frame.saturated = false;
    for (cell, &code) in cells.iter_mut().zip(codes) {
        let (code, offset) = (u32::from(code), u32::from(cell.offset));
        if !cell.contact.is_settled(code) {
            change += cell.settle(code, curve, frame);
        }
        let above_offset = code as i32 - offset as i32;
        if above_offset > 0 {
            force.add(&cell.region, curve.pressure_kpa(above_offset));
        }
    }
    frame.force = force;
    change
}

/// An insole with at most `N` cells: parameters, state and the stages between raw codes and steps.
#[derive(Debug)]
pub struct Insole<R, const N: usize> {
    /// Its period is 0 until all is set up.
    setup: Setup,
    curve: Curve,
    cells: Vec<InsoleCell<R>, N>,
    division: Division,
    per_period_s: R,
    limits: StanceLimits<R>,
    tissue_id: u32,
    gauges: [Gauge<R>; 8],

    live: [LiveModel<R>; 8],
    stance: Stance<R>,
    loads: [RegionLoad<R>; 8],
    watch: Watch,
    last_seq: Option<u32>,
    steps: u32,
}

impl<R: Real, const N: usize> Insole<R, N> {
    /// An insole without cells, all zeros, so that a static one takes no flash; see [`Insole::set_up`].
    pub const fn new() -> Self {
        const {
            assert!(N <= 4096, "cells are numbered in u16 and a step is a summary, not an image");
        }
        Self {
            setup: Setup::NONE,
            curve: Curve::new(),
            cells: Vec::new(),
            division: Division::NONE,
            per_period_s: R::ZERO,
            limits: StanceLimits::NONE,
            tissue_id: 0,
            gauges: [Gauge::NONE; 8],
            live: [LiveModel::NEW; 8],
            stance: Stance::new(),
            loads: [RegionLoad::NONE; 8],
            watch: Watch::new(),
            last_seq: None,
            steps: 0,
        }
    }

    /// Replaces geometry, calibration and rules; state starts anew, tissue stays. The iterator is walked twice.
    pub fn set_up<I>(&mut self, setup: Setup, cells: I) -> Result<(), SetupError>
    where
        I: Iterator<Item = SetupCell> + Clone,
    {
        let checks = [
            (PERIOD_US.contains(&setup.period_us), SetupError::Period),
            (setup.sensor.is_valid(), SetupError::Sensor),
            (setup.contact.is_valid(), SetupError::Contact),
            (setup.stance.is_valid(), SetupError::Stance),
        ];
        if let Some(&(_, error)) = checks.iter().find(|(holds, _)| !holds) {
            return Err(error);
        }
        let division = check_cells(cells.clone(), N)?;

        self.division = division;
        self.curve.set(&setup.sensor);
        self.cells.clear();
        for cell in cells {
            // Room for all: `check_cells` counted them.
            let _ = self.cells.push(InsoleCell::new(&cell, &setup.contact, &self.curve, &division));
        }
        self.watch.set_up(&self.cells, setup.period_us);
        self.per_period_s = R::of(1e6 / f64::from(setup.period_us));
        self.limits = StanceLimits::new(&setup.stance, setup.period_us);
        self.live = [LiveModel::NEW; 8];
        self.stance.reset();
        self.loads = [RegionLoad::NONE; 8];
        self.last_seq = None;
        self.setup = setup;
        Ok(())
    }

    /// Replaces the calibrations from cell `first` on of an insole that was set up with `cells`. Before the first frame only: the
    /// cells' contact starts anew. Calibrations that are not valid are passed over.
    pub fn recalibrate(
        &mut self,
        cells: impl Iterator<Item = SetupCell>,
        first: usize,
        calibrations: &[CellCalibration],
    ) {
        let places = self.cells.iter_mut().zip(cells).skip(first);
        for ((place, cell), &calibration) in places.zip(calibrations).filter(|(_, new)| new.is_valid()) {
            let cell = SetupCell { calibration, ..cell };
            *place = InsoleCell::new(&cell, &self.setup.contact, &self.curve, &self.division);
        }
    }

    /// Counts steps from this number on.
    pub fn count_steps_from(&mut self, next: u32) {
        self.steps = next;
    }

    /// Replaces the wearer's parameters from the next frame on; a running stance is evaluated with the new ones.
    pub fn set_tissue(&mut self, tissue: &Tissue) -> Result<(), Refusal> {
        tissue.check()?;
        self.tissue_id = tissue.id;
        for ((gauge, live), new) in self.gauges.iter_mut().zip(&mut self.live).zip(&tissue.gauges) {
            *gauge = Gauge::of(new);
            live.rebase(gauge);
        }
        Ok(())
    }

    /// What was set up; `None` before.
    pub fn setup(&self) -> Option<&Setup> {
        (self.setup.period_us > 0).then_some(&self.setup)
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.cells.len()
    }

    /// Identifies the wearer's parameters; 0 without any.
    pub fn tissue_id(&self) -> u32 {
        self.tissue_id
    }

    /// Takes frame number `seq` of raw codes, one a cell; true when it confirms toe off: then [`Insole::step_region`] and
    /// [`Insole::step`] give the step until the next frame. Without a set-up, or with fewer codes than cells, nothing
    /// happens.
    #[inline(never)]
    pub fn frame(&mut self, seq: u32, codes: &[u16]) -> bool {
        if self.setup().is_none() || codes.len() < self.cells() {
            return false;
        }
        let mut per_s = self.per_period_s;
        if let Some(last) = self.last_seq.replace(seq) {
            let elapsed = seq.wrapping_sub(last);
            if elapsed > 1 {
                per_s = per_s / R::of_u32(elapsed);
            }
        }
        self.sum_cells(seq, codes);
        for ((load, live), gauge) in self.loads.iter_mut().zip(&mut self.live).zip(&self.gauges) {
            load.tissue = live.update(gauge, load.frame.area.area_mm2(), per_s);
        }
        self.stance.push(&self.limits, seq, self.loads.each_ref().map(|load| &load.frame))
    }

    /// The one pass over the cells, region by region, and what comes of faults.
    #[inline(never)]
    fn sum_cells(&mut self, seq: u32, all_codes: &[u16]) {
        let mut change = 0;
        let (mut cells, mut codes) = (self.cells.as_mut_slice(), all_codes);
        let mut start = 0;
        for (load, &end) in self.loads.iter_mut().zip(&self.division.ends) {
            // Ends rise and the last one is the number of cells, of which there are codes.
            let (region_cells, other_cells) = cells.split_at_mut(end - start);
            let (region_codes, other_codes) = codes.split_at(end - start);
            change += sum_region(&self.curve, region_cells, region_codes, &mut load.frame);
            (cells, codes, start) = (other_cells, other_codes, end);
        }
        let foot_is_down = self.watch.foot_is_down(change);
        let saturated = self.stance.saturated() != 0;
        if self.watch.interpolates() || saturated || !foot_is_down {
            self.look_for_faults(seq, all_codes, saturated);
        }
    }

    /// Lets masked cells read, and looks at a frame that leaves time for it. Apart, as a loaded frame does not need it.
    #[cold]
    #[inline(never)]
    fn look_for_faults(&mut self, seq: u32, codes: &[u16], saturated: bool) {
        let mut seen = Seen {
            cells: &mut self.cells,
            ends: &self.division.ends,
            origins_mm: &self.division.origins_mm,
            codes,
            loads: &mut self.loads,
            seq,
            period_us: self.setup.period_us,
        };
        self.watch.interpolate(&self.curve, &mut seen);
        self.watch.frame(&mut seen, saturated);
    }

    /// The faults that were found since the set-up.
    pub fn faults(&self) -> &Faults {
        self.watch.faults()
    }

    /// Bit i: region i has masked cells.
    pub fn masked(&self) -> u8 {
        self.watch.masked()
    }

    /// The regions in the last frame.
    pub fn loads(&self) -> &[RegionLoad<R>; 8] {
        &self.loads
    }

    /// Contact ellipse of region number `region` in the last frame, foot coordinates.
    pub fn ellipse(&self, region: usize) -> Option<Ellipse<R>> {
        Ellipse::from_moments(&self.loads[region].frame.area).map(|e| self.in_foot(region, e))
    }

    /// Centre of pressure of region number `region` in the last frame, foot coordinates, mm.
    pub fn centre_of_pressure_mm(&self, region: usize) -> Option<(R, R)> {
        let (x_mm, y_mm) = self.loads[region].frame.force.centre_of_pressure_mm()?;
        let origin = self.division.origins_mm[region];
        Some((x_mm + R::of_f32(origin.0), y_mm + R::of_f32(origin.1)))
    }

    fn in_foot(&self, region: usize, ellipse: Ellipse<R>) -> Ellipse<R> {
        let (x_mm, y_mm) = self.division.origins_mm[region];
        ellipse.moved(R::of_f32(x_mm), R::of_f32(y_mm))
    }

    /// True from heel strike until toe off is confirmed.
    pub fn on_ground(&self) -> bool {
        self.stance.on_ground()
    }

    /// Contacts so far that did not become steps.
    pub fn rejected(&self) -> Rejected {
        self.stance.rejected()
    }

    /// Curves of region number `region` in the stance that just ended: contact area (mm2), measured force (N), and the time
    /// between samples (s).
    pub fn curves(&self, region: usize) -> (&[R], &[R], R) {
        let (area_mm2, force_n) = self.stance.curves(region);
        (area_mm2, force_n, R::of_u32(self.stance.stride()) / self.per_period_s)
    }

    /// Evaluates region number `region` of the stance that just ended: up to 256 model evaluations, so a device lets other
    /// work run between two regions.
    pub fn step_region(&self, region: usize) -> RegionStep<R> {
        let (area_mm2, force_n, sample_s) = self.curves(region);
        let step =
            RegionStep::new(&self.gauges[region], area_mm2, force_n, sample_s, self.stance.moments_at_peak(region));
        RegionStep {
            ellipse_at_peak: step.ellipse_at_peak.map(|e| self.in_foot(region, e)),
            masked_cells: self.faults().masked_cells[region],
            ..step
        }
    }

    /// The step of the stance that just ended, from its eight regions, and counts it. `None` before any set-up.
    pub fn step(&mut self, regions: [RegionStep<R>; 8]) -> Option<StepRecord<R>> {
        let setup = *self.setup()?;
        let step = self.steps;
        self.steps = self.steps.wrapping_add(1);
        Some(StepRecord {
            side: setup.side,
            step,
            start_us: u64::from(self.stance.start_seq()) * u64::from(setup.period_us),
            duration_us: self.stance.frames() * setup.period_us,
            sample_us: self.stance.stride() * setup.period_us,
            bridged_frames: self.stance.bridged().min(u32::from(u16::MAX)) as u16,
            saturated: self.stance.saturated(),
            contact_rule: setup.contact,
            regions,
        })
    }

    /// The step of the stance that just ended, all at once.
    pub fn whole_step(&mut self) -> Option<StepRecord<R>> {
        let regions = core::array::from_fn(|region| self.step_region(region));
        self.step(regions)
    }
}

impl<R: Real, const N: usize> Default for Insole<R, N> {
    fn default() -> Self {
        Self::new()
    }
}

/// How the cells divide into regions.
#[derive(Clone, Copy, Debug)]
struct Division {
    /// Where each region's cells end.
    ends: [usize; 8],
    /// The middle of each region in foot coordinates, mm: the reference point of its moments.
    origins_mm: [(f32, f32); 8],
}

impl Division {
    const NONE: Self = Self { ends: [0; 8], origins_mm: [(0.0, 0.0); 8] };
}

/// The division of these cells, or what is wrong with them.
fn check_cells(cells: impl Iterator<Item = SetupCell>, capacity: usize) -> Result<Division, SetupError> {
    let mut counts = [0usize; 8];
    let mut areas_mm2 = [0.0f32; 8];
    let mut corners = [((f32::MAX, f32::MAX), (f32::MIN, f32::MIN)); 8];
    let mut last = 0;
    let mut count = 0;
    for SetupCell { cell, calibration, .. } in cells {
        let number = count as u16;
        count += 1;
        if count > capacity {
            return Err(SetupError::TooManyCells);
        }
        let has_area = (MIN_CELL_MM2..=MAX_CELL_MM2).contains(&cell.area_mm2);
        let is_near = cell.x_mm.abs() <= FARTHEST_MM && cell.y_mm.abs() <= FARTHEST_MM;
        if !is_near || !has_area || !calibration.is_valid() {
            return Err(SetupError::Cell(number));
        }
        let region = cell.region as usize;
        if region < last {
            return Err(SetupError::RegionOrder(number));
        }
        last = region;
        counts[region] += 1;
        areas_mm2[region] += cell.area_mm2;
        let (low, high) = &mut corners[region];
        *low = (low.0.min(cell.x_mm), low.1.min(cell.y_mm));
        *high = (high.0.max(cell.x_mm), high.1.max(cell.y_mm));
        let extent_mm = (high.0 - low.0).max(high.1 - low.1);
        if extent_mm > 2.0 * MAX_REACH_MM || areas_mm2[region] > MAX_REGION_MM2 {
            return Err(SetupError::Cell(number));
        }
    }
    if count == 0 {
        return Err(SetupError::NoCells);
    }
    let mut division = Division::NONE;
    let mut end = 0;
    for region in 0..8 {
        end += counts[region];
        division.ends[region] = end;
        if counts[region] > 0 {
            let (low, high) = corners[region];
            division.origins_mm[region] = ((low.0 + high.0) * 0.5, (low.1 + high.1) * 0.5);
        }
    }
    Ok(division)
}

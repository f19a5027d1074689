//! Faults of the sensor, found while walking, and the cells that are masked for them.
//!
//! Two looks, both out of the way of a loaded frame. In stance a cell notes what its contact does, in the rare code that runs
//! when it changes. In swing, when the contact has been small and still for [`SETTLE_MS`], all cells are reviewed a few at a
//! time: what they noted, and their code without load. A fault is one that two steps have shown; docs/faults.md has the rules.
//!
//! A masked cell reads the mean of the nearest healthy cells of its region, or nothing where there are none.

use crate::calibrate::{Curve, FULL_CODE, is_saturated};
use crate::contact::ContactCell;
use crate::insole::{InsoleCell, RegionLoad};
use crate::num::Real;
use crate::region::AreaMoments;
use core::ops::Range;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Faults that are told; further ones are counted and masked.
pub const FAULTS: usize = 16;
/// Masked cells that are interpolated: a line of the matrix and some more. Further ones read nothing.
pub const INTERPOLATED: usize = 24;
/// Cells of the largest matrix whose lines are known, 16 rows of 16 columns.
pub const CROSSINGS: usize = 256;
/// Rows, and columns.
const LINES: usize = 16;

/// A foot is up when the contact has been small and still for this long, ms: the toes' pressure is gone. The review takes as
/// long again, and a swing lasts three times as long.
const SETTLE_MS: u32 = 100;
/// Saturated cells that are looked at in one frame of a region.
const DOUBTS: usize = 4;
/// Codes that an unloaded cell may depart from its zero by, as noise: 0.07 kPa at 1000 kPa full scale.
const NOISE: u16 = 32;
/// Most codes that a zero follows in a swing, and in all: 1 kPa and 13 kPa.
const REZERO_STEP: i16 = 256;
const REZERO_MOST: i32 = 2048;
/// A departure beyond this one is not slow, in codes.
const SLOW: u16 = 1024;
/// A row tells of crosstalk when a cell of it reads so many codes above zero, 31 kPa: it is clean when the least loaded one reads
/// less than this part of that.
const ROW_LOADED: u16 = 4096;
const CROSSTALK: u16 = 32;
/// So many clean looks in a step make a row clean in it; fewer may be none in the next step without a fault.
const CLEAN_LOOKS: u8 = 2;
/// So many looks that are not clean make it suspect.
const SUSPECT_LOOKS: u8 = 3;
/// Each row that is not known to be clean is looked at as often at all frame rates: all of them in this time, us.
const ROUND_US: u32 = 40_000;
/// Cells of a line that tell of it.
const LEAST_OF_LINE: u32 = 4;
/// A saturated cell is believed when its neighbours read this part of it or more in the mean.
const STEEPEST: u32 = 4;

/// What is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FaultKind {
    /// No response to load.
    Open,
    /// Full scale without load.
    Short,
    /// Reads the same whatever happens.
    Stuck,
    /// Full scale where the cells around read little.
    Saturated,
    /// Its zero moves faster or farther than it may be followed.
    Drift,
    /// All cells of a row read a part of its load.
    Crosstalk,
}

impl FaultKind {
    /// All, in the order of the wire.
    pub const ALL: [Self; 6] = [Self::Open, Self::Short, Self::Stuck, Self::Saturated, Self::Drift, Self::Crosstalk];

    /// One word, lower case.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Short => "short",
            Self::Stuck => "stuck",
            Self::Saturated => "saturated",
            Self::Drift => "drift",
            Self::Crosstalk => "crosstalk",
        }
    }
}

/// Where it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Place {
    /// This cell, by its place in a frame.
    Cell(u16),
    /// This row of the matrix.
    Row(u8),
    /// This column of the matrix.
    Column(u8),
}

impl core::fmt::Display for Place {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Cell(cell) => write!(f, "cell {cell}"),
            Self::Row(row) => write!(f, "row {row}"),
            Self::Column(column) => write!(f, "column {column}"),
        }
    }
}

/// One fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fault {
    /// What.
    pub kind: FaultKind,
    /// Where.
    pub place: Place,
    /// When it was found, ms since the first scan.
    pub found_ms: u32,
}

/// What is noted of one cell between two reviews.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CellWatch {
    /// How far the code was above zero in the last swing.
    last: i16,
    /// How far the zero was moved, in [`NOISE`] codes.
    rezeroed: i8,
    /// Row times 16 and column.
    crossing: u8,
    marks: u8,
    /// Counts of up to 3, two bits each; see [`Count`].
    counts: u8,
}

/// Came into contact, came into firm contact, was saturated beyond belief, kept one code since the last review.
const HEARD: u8 = 1;
const FIRM: u8 = 2;
const BEYOND: u8 = 4;
const SAME: u8 = 8;
/// Masked; without contact where it had some; found stuck; found drifting.
const MASKED: u8 = 16;
const SILENT: u8 = 32;
const STUCK: u8 = 64;
const DRIFT: u8 = 128;

/// What is counted over the steps, and its place in [`CellWatch::counts`].
#[derive(Clone, Copy)]
enum Count {
    /// Firm contacts of late.
    Firm = 0,
    /// Steps without a response.
    Silent = 2,
    /// Swings at full scale, or far below zero.
    Off = 4,
    /// Steps in which it was saturated beyond belief.
    Beyond = 6,
}

impl CellWatch {
    pub(crate) const fn new(crossing: u8) -> Self {
        Self { last: 0, rezeroed: 0, crossing, marks: 0, counts: 0 }
    }

    pub(crate) fn is_masked(&self) -> bool {
        self.has(MASKED)
    }

    /// Notes the code of a cell that is not settled, and lets the contact look out for what is to be noted next.
    pub(crate) fn note(&mut self, code: u32, offset: u16, contact: &mut ContactCell) {
        self.marks &= !SAME;
        let firm = contact.firm(offset);
        if code > u32::from(offset) + u32::from(NOISE) {
            self.marks |= if code >= firm { HEARD | FIRM } else { HEARD };
        }
        self.look_out(offset, contact);
    }

    fn look_out(&self, offset: u16, contact: &mut ContactCell) {
        if contact.is_loaded() {
            if !self.has(FIRM) {
                contact.look_at(contact.firm(offset));
            }
        } else if !self.has(HEARD) {
            contact.look_at(u32::from(offset) + u32::from(NOISE) + 1);
        }
    }

    /// Nothing is held against it.
    fn is_sound(&self) -> bool {
        !self.has(MASKED | STUCK | SAME) && self.count(Count::Off) == 0
    }

    fn has(&self, mark: u8) -> bool {
        self.marks & mark != 0
    }

    fn count(&self, count: Count) -> u8 {
        self.counts >> count as u8 & 3
    }

    fn set(&mut self, count: Count, value: u8) {
        self.counts = self.counts & !(3 << count as u8) | value.min(3) << count as u8;
    }

    /// One more where `again`, else from 0.
    fn recount(&mut self, count: Count, again: bool) {
        self.set(count, if again { self.count(count) + 1 } else { 0 });
    }

    fn row(&self) -> usize {
        usize::from(self.crossing) / LINES
    }

    fn column(&self) -> usize {
        usize::from(self.crossing) % LINES
    }

    /// What the steps have shown.
    fn accused_of(&self) -> Option<FaultKind> {
        if self.has(STUCK) {
            Some(FaultKind::Stuck)
        } else if self.has(DRIFT) {
            Some(FaultKind::Drift)
        } else if self.count(Count::Off) >= 2 {
            // Far below zero is not full scale.
            Some(if self.last < 0 { FaultKind::Stuck } else { FaultKind::Short })
        } else if self.count(Count::Beyond) >= 2 {
            Some(FaultKind::Saturated)
        } else if self.count(Count::Silent) >= 2 {
            // An open cell reads its zero.
            Some(if self.last.unsigned_abs() > NOISE { FaultKind::Stuck } else { FaultKind::Open })
        } else {
            None
        }
    }
}

impl<R> InsoleCell<R> {
    /// Forgets what was noted.
    fn begin_anew(&mut self) {
        if self.watch.is_masked() {
            return;
        }
        self.watch.marks &= !(HEARD | FIRM | BEYOND);
        if self.contact.is_loaded() {
            self.watch.marks |= HEARD;
        } else {
            self.watch.look_out(self.offset, &mut self.contact);
        }
    }
}

/// A masked cell and the cells that speak for it.
#[derive(Clone, Copy, Debug)]
struct Mask {
    cell: u16,
    offset: u16,
    /// Cells that read for it; filled up with itself.
    neighbours: [u16; 4],
}

/// Which cells of its region are loaded around a cell.
#[derive(Default)]
struct Around {
    /// Next to it, healthy; of these in contact, and firmly so.
    near: u32,
    heard: u32,
    firm: u32,
    /// The area of the largest of them.
    largest: i32,
    /// Firm ones within [`REACH`] on its sides: medial, lateral, heel, toes.
    sides: [bool; 4],
}

impl Around {
    fn is_between(&self) -> bool {
        let [medial, lateral, heel, toes] = self.sides;
        medial && lateral || heel && toes
    }

    fn is_within(&self) -> bool {
        self.sides == [true; 4]
    }
}

/// How far neighbours lie, in tenths of the side of a cell: the eight around it, and those beyond a second line.
const NEAR: i32 = 16;
const REACH: i32 = 28;

impl Around {
    fn new<R: Real>(seen: &Seen<'_, R>, index: usize) -> Self {
        let mut around = Self::default();
        let this = &seen.cells[index].region;
        let pitch = this.pitch();
        let own = seen.origins_mm[seen.region(index)];
        let mut start = 0;
        for (&end, origin) in seen.ends.iter().zip(seen.origins_mm) {
            let (ox, oy) = (((origin.0 - own.0) * 64.0) as i32, ((origin.1 - own.1) * 64.0) as i32);
            for i in core::mem::replace(&mut start, end)..end {
                let cell = &seen.cells[i];
                let (dx, dy) = cell.region.from(this);
                let (dx, dy) = (dx + ox, dy + oy);
                let far = dx.abs().max(dy.abs()) * 10;
                if i == index || !cell.watch.is_sound() || far > REACH * pitch {
                    continue;
                }
                if far <= NEAR * pitch {
                    around.near += 1;
                    around.largest = around.largest.max(cell.region.whole());
                    around.heard += u32::from(cell.watch.has(HEARD));
                    around.firm += u32::from(cell.watch.has(FIRM));
                }
                if cell.watch.has(FIRM) {
                    let side = if dx.abs() > dy.abs() { usize::from(dx > 0) } else { 2 + usize::from(dy > 0) };
                    around.sides[side] = true;
                }
            }
        }
        around
    }
}

/// Units of contact area are shifted by this many bits to be summed over the regions.
const AREA_SHIFT: u32 = 4;

/// A frame that has passed the cells.
pub(crate) struct Seen<'a, R> {
    pub(crate) cells: &'a mut [InsoleCell<R>],
    /// Where the cells of each region end.
    pub(crate) ends: &'a [usize; 8],
    pub(crate) origins_mm: &'a [(f32, f32); 8],
    /// One a cell.
    pub(crate) codes: &'a [u16],
    pub(crate) loads: &'a mut [RegionLoad<R>; 8],
    pub(crate) seq: u32,
    pub(crate) period_us: u32,
}

impl<R> Seen<'_, R> {
    /// The region of a cell, by its number.
    fn region(&self, index: usize) -> usize {
        self.ends.partition_point(|&end| end <= index)
    }

    /// The cells of that region.
    fn region_of(&self, index: usize) -> Range<usize> {
        let region = self.region(index);
        let start = region.checked_sub(1).map_or(0, |before| self.ends[before]);
        start..self.ends[region]
    }
}

/// True where a cell is on this row or, from [`LINES`] on, column.
fn is_on(watch: &CellWatch, line: usize) -> bool {
    line == watch.row() || line == LINES + watch.column()
}

/// A region's contact in units that the regions' sum fits 32 bits in.
#[inline(always)]
pub(crate) fn area(moments: &AreaMoments) -> i32 {
    moments.units() >> AREA_SHIFT
}

/// What was found since the set-up, as it is told.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Faults {
    /// All faults, in the list or not.
    pub found: u32,
    /// How often a cell's zero was moved.
    pub rezeroed: u32,
    /// Masked cells of each region, 255 for more.
    pub masked_cells: [u8; 8],
    /// The first of them.
    pub list: Vec<Fault, FAULTS>,
}

impl Faults {
    /// Nothing.
    pub const NONE: Self = Self { found: 0, rezeroed: 0, masked_cells: [0; 8], list: Vec::new() };

    /// Bit i: region i has masked cells.
    pub fn masked(&self) -> u8 {
        self.masked_cells.iter().enumerate().fold(0, |bits, (i, &cells)| bits | u8::from(cells > 0) << i)
    }
}

/// The state of the search, and what it found.
#[derive(Debug)]
pub struct Watch {
    /// Area of all cells, in the units of [`area`].
    whole: i32,
    /// Area in contact, but for masked cells.
    area: i32,
    settle_frames: u32,
    has_lines: bool,
    /// Frames since the contact became small and still, 0 with the foot down; and the area then.
    still: u32,
    still_area: i32,
    /// The foot was down since the last review.
    walked: bool,
    /// The foot came down in the middle of the last review.
    was_cut: bool,
    /// The next cell of a running review.
    next: Option<usize>,
    /// Silent cells in it.
    silent: u32,
    /// Rows looked at in a frame, and the first of them; per row the looks in this step and the clean ones; the steps running that
    /// were clean, and those that were not since.
    rows_a_frame: u32,
    turn: u32,
    row_looks: [u8; LINES],
    row_clean: [u8; LINES],
    rows: [(u8, u8); LINES],
    /// Rows with masked cells, which prove nothing.
    row_masked: u16,
    /// Steps in which exactly this line was silent: rows, then columns.
    line_silent: [u8; 2 * LINES],
    masks: Vec<Mask, INTERPOLATED>,
    masked: u8,
    faults: Faults,
}

impl Watch {
    /// Nothing found; all zeros.
    pub(crate) const fn new() -> Self {
        Self {
            whole: 0,
            area: 0,
            settle_frames: 0,
            has_lines: false,
            still: 0,
            still_area: 0,
            walked: false,
            was_cut: false,
            next: None,
            silent: 0,
            rows_a_frame: 0,
            turn: 0,
            row_looks: [0; LINES],
            row_clean: [0; LINES],
            rows: [(0, 0); LINES],
            row_masked: 0,
            line_silent: [0; 2 * LINES],
            masks: Vec::new(),
            masked: 0,
            faults: Faults::NONE,
        }
    }

    /// Starts anew with these cells.
    pub(crate) fn set_up<R: Real>(&mut self, cells: &[InsoleCell<R>], period_us: u32) {
        *self = Self::new();
        self.whole = cells.iter().map(|cell| cell.region.whole() >> AREA_SHIFT).sum();
        self.still = 1;
        self.settle_frames = (SETTLE_MS * 1000).div_ceil(period_us);
        self.has_lines = cells.len() <= CROSSINGS;
        self.rows_a_frame = (LINES as u32 * period_us).div_ceil(ROUND_US).min(LINES as u32);
    }

    /// What was found since the set-up.
    pub fn faults(&self) -> &Faults {
        &self.faults
    }

    /// See [`Faults::masked`].
    pub fn masked(&self) -> u8 {
        self.masked
    }

    /// Takes the change of the regions' [`area`] in sum; true where it is that of a loaded foot, which is all that is to be known of
    /// it.
    #[inline(always)]
    pub(crate) fn foot_is_down(&mut self, change: i32) -> bool {
        self.area += change;
        let is_down = self.area > self.whole / 2;
        if is_down {
            self.still = 0;
        }
        is_down
    }

    /// Takes a frame that has passed the cells, where it is not just that of a loaded foot.
    pub(crate) fn frame<R: Real>(&mut self, seen: &mut Seen<'_, R>, saturated: bool) {
        if saturated {
            Self::doubt(seen);
        }
        if self.area <= self.whole / 2 {
            self.light_frame(seen, self.area);
        }
    }

    /// A frame with most cells unloaded, which leaves time.
    #[inline(never)]
    fn light_frame<R: Real>(&mut self, seen: &mut Seen<'_, R>, area: i32) {
        if area > 0 && self.has_lines {
            self.look_at_rows(seen);
        }
        if self.still == 0 {
            // The foot was down; a review that it cut short is given up.
            self.was_cut |= self.next.is_some();
            (self.walked, self.next) = (true, None);
        }
        if area > self.whole / 4 {
            self.still = 0;
            return;
        }
        if self.still == 0 || (area - self.still_area).abs() > self.whole / 32 {
            (self.still, self.still_area) = (0, area);
        }
        self.still = self.still.saturating_add(1);
        if self.still <= self.settle_frames {
            return;
        }
        if self.walked && self.next.is_none() {
            self.walked = false;
            if core::mem::take(&mut self.was_cut) {
                // Half of the cells have counted what they noted: no step counts twice.
                seen.cells.iter_mut().for_each(InsoleCell::begin_anew);
                return;
            }
            self.silent = 0;
            self.next = Some(0);
        }
        if let Some(first) = self.next {
            self.next = self.review(seen, first);
            if self.next.is_none() {
                self.conclude(seen);
            }
        }
    }

    /// Some rows in turn: whether a cell of theirs is unloaded while another one is loaded. Not those that were clean in this step.
    fn look_at_rows<R: Real>(&mut self, seen: &Seen<'_, R>) {
        let mut rows = 0u16;
        for _ in 0..LINES {
            let row = self.turn as usize % LINES;
            let is_open = self.row_clean[row] < CLEAN_LOOKS && self.row_masked >> row & 1 == 0;
            rows |= u16::from(is_open) << row;
            self.turn += 1;
            if rows.count_ones() == self.rows_a_frame {
                break;
            }
        }
        self.turn %= LINES as u32;
        if rows == 0 {
            return;
        }
        let mut least_most = [(u16::MAX, 0u16, 0u8); LINES];
        for (cell, &code) in seen.cells.iter().zip(seen.codes) {
            let row = cell.watch.row();
            if rows >> row & 1 == 1 {
                let above = code.saturating_sub(cell.offset);
                let (least, most, count) = &mut least_most[row];
                (*least, *most) = ((*least).min(above), (*most).max(above));
                *count = count.saturating_add(1);
            }
        }
        for (row, (least, most, count)) in least_most.into_iter().enumerate() {
            if u32::from(count) >= LEAST_OF_LINE && (ROW_LOADED..FULL_CODE / 2).contains(&most) {
                self.row_looks[row] = self.row_looks[row].saturating_add(1);
                self.row_clean[row] += u8::from(least < most / CROSSTALK);
            }
        }
    }

    /// Looks at saturated cells among ones that read little, a few in a frame, not always the same ones first.
    #[cold]
    #[inline(never)]
    pub(crate) fn doubt<R: Real>(seen: &mut Seen<'_, R>) {
        let (cells, codes) = (&mut *seen.cells, seen.codes);
        let start = seen.seq as usize % cells.len().max(1);
        let is_new = |&i: &usize| is_saturated(codes[i].into()) && !cells[i].watch.has(BEYOND | MASKED);
        let new: Vec<usize, DOUBTS> = (start..cells.len()).chain(0..start).filter(is_new).take(DOUBTS).collect();
        for index in new {
            let region = seen.region_of(index);
            let this = seen.cells[index].region;
            let reach = NEAR * this.pitch();
            let (mut sum, mut count) = (0, 0);
            for i in region.filter(|&i| i != index) {
                let cell = &seen.cells[i];
                let (dx, dy) = cell.region.from(&this);
                if !cell.watch.is_masked() && dx.abs().max(dy.abs()) * 10 <= reach {
                    sum += u32::from(codes[i].saturating_sub(cell.offset));
                    count += 1;
                }
            }
            if count >= 2 && sum / count < u32::from(codes[index]) / STEEPEST {
                seen.cells[index].watch.marks |= BEYOND;
            }
        }
    }

    /// Masked cells read the mean of their neighbours: brings the regions of this frame up to date.
    #[cold]
    #[inline(never)]
    pub(crate) fn interpolate<R: Real>(&self, curve: &Curve, seen: &mut Seen<'_, R>) {
        for mask in &self.masks {
            let (mut sum, mut count) = (0, 0);
            for neighbour in mask.neighbours.into_iter().filter(|&neighbour| neighbour != mask.cell).map(usize::from) {
                sum += u32::from(seen.codes[neighbour].saturating_sub(seen.cells[neighbour].offset));
                count += 1;
            }
            // A mean of 16 bits.
            let above = sum.checked_div(count).unwrap_or(0) as u16;
            let code = u32::from(mask.offset.saturating_add(above));
            let index = usize::from(mask.cell);
            let frame = &mut seen.loads[seen.ends.partition_point(|&end| end <= index)].frame;
            let cell = &mut seen.cells[index];
            frame.area.change(&cell.region, cell.contact.settle(code, curve.pressure_kpa(i32::from(above))));
            cell.contact.mute();
            if above > 0 {
                frame.force.add(&cell.region, curve.pressure_kpa(i32::from(above)));
            }
        }
    }

    /// True where [`Watch::interpolate`] has something to do.
    #[inline(always)]
    pub(crate) fn interpolates(&self) -> bool {
        !self.masks.is_empty()
    }

    /// Reviews some cells from number `first` on; the next one, or none at the end.
    fn review<R: Real>(&mut self, seen: &mut Seen<'_, R>, first: usize) -> Option<usize> {
        let count = seen.cells.len();
        let end = count.min(first + count.div_ceil(self.settle_frames as usize));
        for index in first..end {
            let (cells, code) = (&mut *seen.cells, seen.codes[index]);
            if cells[index].watch.is_masked() {
                continue;
            }
            let needs_look = {
                let watch = &cells[index].watch;
                !watch.has(HEARD) || watch.has(SAME)
            };
            let around = needs_look.then(|| Around::new(seen, index));
            let cell = &mut seen.cells[index];
            self.review_swing(cell, code, around.as_ref());
            self.review_stance(cell, around.as_ref());
        }
        (end < count).then_some(end)
    }

    /// The code without load.
    fn review_swing<R: Real>(&mut self, cell: &mut InsoleCell<R>, code: u16, around: Option<&Around>) {
        let above = i32::from(code) - i32::from(cell.offset);
        let departure = above.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
        let last = core::mem::replace(&mut cell.watch.last, departure);
        let is_low = above < -i32::from(SLOW);
        let is_full = is_saturated(code.into());
        cell.watch.recount(Count::Off, is_low || is_full);
        if cell.contact.is_loaded() && !is_full {
            // A tight shoe presses on cells in swing, and then their code moves with each step.
            let is_firm = u32::from(code) >= cell.contact.firm(cell.offset);
            let same = cell.watch.has(SAME);
            if same && (is_firm || around.is_some_and(|a| a.near >= 2 && 2 * a.firm >= a.near)) {
                cell.watch.marks |= STUCK;
            }
            cell.watch.marks |= SAME;
            cell.contact.look_beside(code);
        } else {
            cell.watch.marks &= !SAME;
        }

        let (size, size_before) = (departure.unsigned_abs(), last.unsigned_abs());
        let goes_on = (departure < 0) == (last < 0)
            && size_before > NOISE / 2
            && size_before <= SLOW
            && size > NOISE
            && size > if size > 8 * NOISE { size_before + size_before / 4 } else { size_before };
        if !goes_on {
            return;
        }
        let step = departure.clamp(-REZERO_STEP, REZERO_STEP);
        let all = i32::from(cell.watch.rezeroed) * i32::from(NOISE) + i32::from(step);
        if size > SLOW || all.abs() > REZERO_MOST {
            cell.watch.marks |= DRIFT;
        } else if !cell.contact.is_loaded() {
            cell.offset = cell.offset.saturating_add_signed(step);
            cell.contact.shift(step);
            cell.watch.last -= step;
            // Within the bound, so within 8 bits; rounded, so that what is left out adds up to nothing.
            cell.watch.rezeroed = ((all + all.signum() * i32::from(NOISE / 2)) / i32::from(NOISE)) as i8;
            self.faults.rezeroed = self.faults.rezeroed.wrapping_add(1);
        }
    }

    /// What was noted in stance.
    fn review_stance<R: Real>(&mut self, cell: &mut InsoleCell<R>, around: Option<&Around>) {
        let watch = &mut cell.watch;
        let was_firm = watch.count(Count::Firm);
        watch.marks &= !SILENT;
        let mut is_alone = false;
        if watch.has(FIRM) {
            watch.set(Count::Firm, was_firm + 1);
        } else if let (false, Some(around)) = (watch.has(HEARD), around) {
            watch.set(Count::Firm, was_firm.saturating_sub(1));
            if was_firm > 1 || around.is_between() {
                watch.marks |= SILENT;
                self.silent += u32::from(was_firm > 1);
            }
            // A hole in a firm contact; a cell at its rim may as well be one that the foot missed.
            // A cell much smaller than those around it, cut by a region's edge, may well be missed by the foot.
            let is_full_size = was_firm > 1 || 2 * cell.region.whole() >= around.largest;
            is_alone = is_full_size && around.is_within() && around.near >= 7 && around.firm == around.near;
        }
        watch.recount(Count::Silent, is_alone);
        let is_beyond = watch.has(BEYOND);
        watch.recount(Count::Beyond, is_beyond);
    }

    /// After all cells: what is a line's fault, then what is a cell's.
    fn conclude<R: Real>(&mut self, seen: &mut Seen<'_, R>) {
        let before = self.faults.found;
        if self.has_lines {
            for line in 0..2 * LINES {
                self.conclude_line(seen, line);
            }
        }
        for index in 0..seen.cells.len() {
            let watch = &seen.cells[index].watch;
            if let (false, Some(kind)) = (watch.is_masked(), watch.accused_of()) {
                self.tell(seen, kind, Place::Cell(index as u16));
                self.mask(seen, index);
            }
            seen.cells[index].begin_anew();
        }
        if self.faults.found == before {
            self.conclude_rows(seen);
        }
        (self.row_looks, self.row_clean) = ([0; LINES], [0; LINES]);
        if self.faults.found != before {
            // Another contact leaves looks at other moments.
            self.rows = [(0, 0); LINES];
            self.choose_neighbours(seen);
        }
    }

    /// One row at a time, the one that was looked at most: what it adds to the contact leaves fewer looks at others.
    fn conclude_rows<R: Real>(&mut self, seen: &mut Seen<'_, R>) {
        let mut worst = None;
        for row in 0..LINES {
            let (looks, clean) = (self.row_looks[row], self.row_clean[row]);
            let (cleans, suspects) = &mut self.rows[row];
            if clean > 0 {
                // What was suspect and is clean again was covered by the foot, and may be so again.
                *cleans = if *suspects == 0 { cleans.saturating_add(u8::from(clean >= CLEAN_LOOKS)) } else { 0 };
                *suspects = 0;
            } else if looks >= SUSPECT_LOOKS && *cleans >= 2 {
                *suspects += 1;
                if *suspects >= 2 {
                    worst = worst.max(Some((looks, row)));
                }
            }
        }
        if let Some((_, row)) = worst {
            self.condemn(seen, FaultKind::Crosstalk, row);
        }
    }

    fn conclude_line<R: Real>(&mut self, seen: &mut Seen<'_, R>, line: usize) {
        let (mut count, mut silent, mut between, mut speaking, mut others) = (0, 0, 0, 0, 0);
        let mut accused = [0u32; FaultKind::ALL.len()];
        for watch in seen.cells.iter().map(|cell| &cell.watch).filter(|watch| is_on(watch, line)) {
            if watch.is_masked() {
                continue;
            }
            let was_firm = watch.count(Count::Firm) > 0;
            silent += u32::from(watch.has(SILENT) && was_firm);
            between += u32::from(watch.has(SILENT));
            speaking += u32::from(!watch.has(SILENT) && was_firm);
            count += 1;
            match watch.accused_of() {
                Some(kind) => accused[kind as usize] += 1,
                None => others += 1,
            }
        }
        // The silence is this line's and of no other cells.
        let is_all = silent >= LEAST_OF_LINE && 4 * self.silent.saturating_sub(silent) <= silent;
        let is_silent = speaking == 0 && (is_all || between > LEAST_OF_LINE && 4 * between >= 3 * count);
        self.line_silent[line] = if is_silent { self.line_silent[line] + 1 } else { 0 };
        if self.line_silent[line] >= 2 {
            self.silent = self.silent.saturating_sub(silent);
            return self.condemn(seen, FaultKind::Open, line);
        }
        if is_silent {
            // The next step asks the same cells.
            for watch in seen.cells.iter_mut().map(|cell| &mut cell.watch).filter(|watch| is_on(watch, line)) {
                if watch.has(SILENT) && watch.count(Count::Firm) > 0 {
                    watch.set(Count::Firm, watch.count(Count::Firm) + 1);
                }
            }
        }
        for kind in [FaultKind::Short, FaultKind::Stuck, FaultKind::Saturated, FaultKind::Drift] {
            let count = accused[kind as usize];
            let rest = others + accused.iter().sum::<u32>() - count;
            if count >= LEAST_OF_LINE && 4 * rest <= count {
                return self.condemn(seen, kind, line);
            }
        }
    }

    /// Tells of a line, rows first, and masks it.
    fn condemn<R: Real>(&mut self, seen: &mut Seen<'_, R>, kind: FaultKind, line: usize) {
        let place = if line < LINES { Place::Row(line as u8) } else { Place::Column((line - LINES) as u8) };
        self.tell(seen, kind, place);
        for index in 0..seen.cells.len() {
            if is_on(&seen.cells[index].watch, line) {
                self.mask(seen, index);
            }
        }
    }

    fn tell<R: Real>(&mut self, seen: &Seen<'_, R>, kind: FaultKind, place: Place) {
        self.faults.found = self.faults.found.wrapping_add(1);
        let found_ms = (u64::from(seen.seq) * u64::from(seen.period_us) / 1000) as u32;
        // Where there is no room it is counted.
        let _ = self.faults.list.push(Fault { kind, place, found_ms });
    }

    fn mask<R: Real>(&mut self, seen: &mut Seen<'_, R>, index: usize) {
        let region = seen.region(index);
        let cell = &mut seen.cells[index];
        if cell.watch.is_masked() {
            return;
        }
        cell.watch.marks = MASKED;
        // It may be the one that showed that this row is clean.
        self.row_masked |= 1 << cell.watch.row();
        let masked_cells = &mut self.faults.masked_cells[region];
        *masked_cells = masked_cells.saturating_add(1);
        self.masked |= 1 << region;
        let mask = Mask { cell: index as u16, offset: cell.offset, neighbours: [index as u16; 4] };
        // From here on the pass over the cells finds nothing in it.
        cell.offset = u16::MAX;
        let share = cell.contact.settle(0, 0.0);
        cell.contact.mute();
        let moments = &mut seen.loads[region].frame.area;
        let before = area(moments);
        moments.change(&cell.region, share);
        self.area += area(moments) - before;
        // Where there is no room the cell reads nothing.
        let _ = self.masks.push(mask);
    }

    /// The up to four nearest healthy cells for each masked one.
    fn choose_neighbours<R: Real>(&mut self, seen: &Seen<'_, R>) {
        for mask in &mut self.masks {
            let index = usize::from(mask.cell);
            let this = &seen.cells[index].region;
            let reach = REACH * this.pitch();
            let mut nearest = [(i64::MAX, mask.cell); 4];
            for i in seen.region_of(index) {
                let cell = &seen.cells[i];
                let (dx, dy) = cell.region.from(this);
                if cell.watch.is_masked() || dx.abs().max(dy.abs()) * 10 > reach {
                    continue;
                }
                let distance = i64::from(dx) * i64::from(dx) + i64::from(dy) * i64::from(dy);
                let at = nearest.iter().position(|&(other, _)| distance < other);
                if let Some(at) = at {
                    nearest[at..].rotate_right(1);
                    nearest[at] = (distance, i as u16);
                }
            }
            mask.neighbours = nearest.map(|(_, cell)| cell);
        }
    }
}

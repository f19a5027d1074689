//! The state of fault detection, and when each part of it runs.

use super::lines::LineSearch;
use super::masking::Masking;
use super::neighbourhood::{ADJACENT, FrameContext};
use super::review::Review;
use super::rows::RowSearch;
use super::{Fault, FaultKind, Faults, MATRIX_CELLS, MIN_LINE_CELLS, Place};
use crate::num::Real;
use crate::pipeline::baseline::{GAIT_MS, Rise};
use crate::pipeline::calibrate::is_saturated;
use crate::pipeline::cell::{AREA_SHIFT, InsoleCell};
use crate::pipeline::marks::{Count, IMPLAUSIBLE_SATURATION, LINES, MASKED};
use crate::pipeline::stance_rule::SETTLE_MS;
use heapless::Vec;

/// Largest number of saturated cells that are compared with their neighbours in one frame.
const SATURATED_PER_FRAME: usize = 4;
/// The saturation of a cell is plausible if the mean reading of its neighbours above their baselines is at least the code of
/// the cell divided by this number.
const PLAUSIBLE_DIVISOR: u32 = 4;

/// The state of the detection, and the detected faults.
#[derive(Debug)]
pub(crate) struct FaultDetector {
    /// Area of all cells, in the units of [`crate::pipeline::cell::area_units`].
    total_area: i32,
    /// Area in contact, without masked cells.
    contact_area: i32,
    /// Number of frames that a review of all cells takes.
    review_frames: u32,
    /// [`GAIT_MS`] in frames.
    gait_frames: u32,
    /// The insole has at most [`MATRIX_CELLS`] cells, so their rows and columns are known.
    has_lines: bool,
    /// The foot was on the ground since the last review began.
    has_stance: bool,
    /// A host has requested that the baselines are measured.
    is_zero_requested: bool,
    /// Number of baselines that the last requested review has changed.
    zeroed: u32,
    /// A stance interrupted the last review.
    is_interrupted: bool,
    /// Number of the frame in which the last review ended; `None` before the first.
    reviewed_seq: Option<u32>,
    /// Index of the next cell of the running review; `None` if no review is running.
    next_cell: Option<usize>,
    review: Review,
    rows: RowSearch,
    lines: LineSearch,
    masking: Masking,
    faults: Faults,
}

impl FaultDetector {
    /// A detector without cells. All of its bytes are zero, so that a static detector occupies no flash.
    pub(crate) const fn new() -> Self {
        Self {
            total_area: 0,
            contact_area: 0,
            review_frames: 0,
            gait_frames: 0,
            has_lines: false,
            has_stance: false,
            is_zero_requested: false,
            zeroed: 0,
            is_interrupted: false,
            reviewed_seq: None,
            next_cell: None,
            review: Review::new(Rise::Whole, false),
            rows: RowSearch::new(),
            lines: LineSearch::new(),
            masking: Masking::new(),
            faults: Faults::NONE,
        }
    }

    /// Resets the detector for an insole with these cells and this time between frames.
    pub(crate) fn set_up<R: Real>(&mut self, cells: &[InsoleCell<R>], period_us: u32) {
        *self = Self::new();
        self.total_area = cells.iter().map(|cell| cell.region.whole() >> AREA_SHIFT).sum();
        self.review_frames = (SETTLE_MS * 1000).div_ceil(period_us);
        self.gait_frames = GAIT_MS * 1000 / period_us;
        self.has_lines = cells.len() <= MATRIX_CELLS;
        self.rows.set_period(period_us);
    }

    /// The faults detected since the set-up.
    pub(crate) fn faults(&self) -> &Faults {
        &self.faults
    }

    /// Bit i: region i has masked cells.
    pub(crate) fn masked(&self) -> u8 {
        self.masking.regions
    }

    /// Adds `change`, in units of [`crate::pipeline::cell::area_units`], to the contact area. True if more than half of the
    /// insole is in contact: then [`FaultDetector::frame`] only checks saturated cells.
    #[inline(always)]
    pub(crate) fn update_contact_area(&mut self, change: i32) -> bool {
        self.contact_area += change;
        self.contact_area > self.total_area / 2
    }

    /// True if there are masked cells to interpolate.
    #[inline(always)]
    pub(crate) fn has_masks(&self) -> bool {
        self.masking.has_masks()
    }

    /// Replaces the readings of masked cells by the mean of their neighbours: updates the region sums of this frame.
    pub(crate) fn interpolate<R: Real>(&self, frame: &mut FrameContext<'_, R>) {
        self.masking.interpolate(frame);
    }

    /// Processes a frame. This function need not be called for a frame with more than half of the insole in contact and without
    /// saturation. `is_saturated` states whether a cell was saturated in the present stance or, in swing, in the last one.
    pub(crate) fn frame<R: Real>(&mut self, frame: &mut FrameContext<'_, R>, is_saturated: bool) {
        if is_saturated {
            check_saturation(frame);
        }
        // With at most half of the insole in contact, the other stages need less time, which leaves time to inspect rows.
        if self.has_lines && self.contact_area > 0 && self.contact_area <= self.total_area / 2 {
            self.rows.inspect(frame);
        }
    }

    /// Processes a frame in which the foot is not lifted, or not for long enough. `carries_load` states whether the foot is on
    /// the ground and the total force has changed since the first frame. True if the frame interrupts a review that has changed
    /// baselines.
    #[inline(always)]
    pub(crate) fn interrupt_review(&mut self, carries_load: bool) -> bool {
        let is_changed = carries_load && self.next_cell.is_some() && self.review.changed_baselines > 0;
        if carries_load {
            // A review that this stance interrupts is abandoned.
            self.is_interrupted |= self.next_cell.is_some();
            (self.has_stance, self.next_cell) = (true, None);
        }
        is_changed
    }

    /// Requests a review that measures the baselines, or cancels the request.
    pub(crate) fn request_zero(&mut self, is_requested: bool) {
        self.is_zero_requested = is_requested;
    }

    /// True until the requested review is complete.
    pub(crate) fn is_zero_requested(&self) -> bool {
        self.is_zero_requested
    }

    /// Number of baselines that the last requested review has changed.
    pub(crate) fn zeroed(&self) -> u32 {
        self.zeroed
    }

    /// Processes a frame in which the foot is lifted: reviews all cells once after the start, after each stance and on request,
    /// a few in each frame. True if baselines have changed or cells were masked. `has_walked` states whether a step of walking
    /// has ended since the last review began; the beginning of a review resets it. After other contacts, such as those of a
    /// seated foot, no fault is concluded: the inspections of rows in them are discarded, and the flags of cells are evaluated
    /// with those of the next step. The readings are no evidence of a fault, either: a foot that rests with a constant force may
    /// count as lifted.
    #[inline(never)]
    pub(crate) fn lifted_frame<R: Real>(&mut self, frame: &mut FrameContext<'_, R>, has_walked: &mut bool) -> bool {
        if self.next_cell.is_none() {
            if !self.has_stance && self.reviewed_seq.is_some() && !self.is_zero_requested {
                return false;
            }
            let has_stance = core::mem::take(&mut self.has_stance);
            let has_walked = core::mem::take(has_walked);
            if core::mem::take(&mut self.is_interrupted) {
                // The cells that were reviewed before the interruption have counted a step already. This review is skipped, so
                // that no step counts twice. Until the first review is complete, `has_stance` remains set: after a stance, the
                // readings must not become the baselines at once.
                self.has_stance = self.reviewed_seq.is_none();
                frame.cells.iter_mut().for_each(InsoleCell::begin_step);
                self.rows.begin_step();
                return false;
            }
            let rise = match self.reviewed_seq {
                _ if self.is_zero_requested => Rise::Whole,
                None if !has_stance => Rise::Whole,
                Some(last_seq) if has_walked && frame.seq.wrapping_sub(last_seq) <= self.gait_frames => Rise::Confirmed,
                _ => Rise::None,
            };
            self.review = Review::new(rise, has_stance && has_walked);
            self.next_cell = Some(0);
        }
        let Some(first) = self.next_cell else { return false };
        self.next_cell = self.review.cells(frame, first, self.review_frames);
        if self.next_cell.is_some() {
            return false;
        }
        self.reviewed_seq = Some(frame.seq);
        if self.is_zero_requested && self.review.rise == Rise::Whole {
            (self.is_zero_requested, self.zeroed) = (false, self.review.changed_baselines);
        }
        let found_before = self.faults.found;
        self.faults.rezeroed = self.faults.rezeroed.wrapping_add(self.review.changed_baselines);
        self.faults.with_former_baseline = self.review.with_former_baseline;
        if self.review.has_stance {
            self.conclude(frame);
        } else {
            // The inspections of rows in a contact that is no step must not count in the next step.
            self.rows.begin_step();
        }
        self.review.changed_baselines > 0 || self.faults.found != found_before
    }

    /// Concludes a review of all cells: reports faults of lines first, then those of single cells, and crosstalk of a row only if
    /// there are no others. Masks the faulty cells, except single ones that are saturated in stance only.
    fn conclude<R: Real>(&mut self, frame: &mut FrameContext<'_, R>) {
        let before = self.faults.found;
        if self.has_lines {
            let suspect_cells = LineSearch::suspect_cells(frame);
            for (line, cells) in suspect_cells.into_iter().enumerate() {
                if cells < MIN_LINE_CELLS {
                    self.lines.clear(line);
                } else if let Some(kind) = self.lines.conclude(frame, line, &mut self.review.unresponsive) {
                    self.mark_line_faulty(frame, kind, line);
                }
            }
        }
        for index in 0..frame.cells.len() {
            let marks = &frame.cells[index].marks;
            if let (false, Some(kind)) = (marks.is_masked(), marks.diagnosis()) {
                // A stone in the shoe or a prominent bone saturates a sound cell in the same way. So the cell remains in use, as
                // a lower bound of the pressure that is flagged as saturated, and is reported in the second of successive steps
                // only.
                let is_in_use = kind == FaultKind::Saturated;
                if !is_in_use || marks.count(Count::ImplausibleSaturation) == 2 {
                    self.report(frame, kind, Place::Cell(index as u16));
                }
                if !is_in_use {
                    self.mask(frame, index);
                }
            }
            frame.cells[index].begin_step();
        }
        if self.faults.found == before
            && let Some(row) = self.rows.conclude(self.review.risen_rows)
        {
            self.mark_line_faulty(frame, FaultKind::Crosstalk, row);
        }
        self.rows.begin_step();
        if self.faults.found != before {
            // Masking changes the contact area, and so the moments at which rows are inspected: earlier steps are not comparable.
            self.rows.forget();
            self.masking.choose_neighbours(frame);
        }
    }

    /// Reports a fault of a line and masks its cells. Lines 0 to 15 are the rows, lines 16 to 31 the columns.
    fn mark_line_faulty<R: Real>(&mut self, frame: &mut FrameContext<'_, R>, kind: FaultKind, line: usize) {
        let place = if line < LINES { Place::Row(line as u8) } else { Place::Column((line - LINES) as u8) };
        self.report(frame, kind, place);
        for index in 0..frame.cells.len() {
            if frame.cells[index].marks.is_on(line) {
                self.mask(frame, index);
            }
        }
    }

    /// Counts a fault and adds it to the list, unless the list is full.
    fn report<R: Real>(&mut self, frame: &FrameContext<'_, R>, kind: FaultKind, place: Place) {
        self.faults.found = self.faults.found.wrapping_add(1);
        let found_us = (u64::from(frame.wraps) << 32 | u64::from(frame.seq)) * u64::from(frame.setup.period_us);
        let found_ms = u32::try_from(found_us / 1000).unwrap_or(u32::MAX);
        let _ = self.faults.list.push(Fault { kind, place, found_ms });
    }

    /// Masks a cell, unless it is masked already.
    fn mask<R: Real>(&mut self, frame: &mut FrameContext<'_, R>, index: usize) {
        if frame.cells[index].marks.is_masked() {
            return;
        }
        self.rows.exclude(frame.cells[index].marks.row());
        let masked_cells = &mut self.faults.masked_cells[frame.region(index)];
        *masked_cells = masked_cells.saturating_add(1);
        self.contact_area += self.masking.mask(frame, index);
    }
}

/// Compares saturated cells with their neighbours: a few in each frame, starting at another cell each time.
#[cold]
#[inline(never)]
fn check_saturation<R: Real>(frame: &mut FrameContext<'_, R>) {
    let (cells, codes) = (&mut *frame.cells, frame.codes);
    let start = frame.seq as usize % cells.len().max(1);
    let is_unmarked =
        |&i: &usize| is_saturated(codes[i].into()) && !cells[i].marks.has(IMPLAUSIBLE_SATURATION | MASKED);
    let unmarked: Vec<usize, SATURATED_PER_FRAME> =
        (start..cells.len()).chain(0..start).filter(is_unmarked).take(SATURATED_PER_FRAME).collect();
    for index in unmarked {
        let region_cells = frame.region_cells(index);
        let own = frame.cells[index].region;
        let reach_tenths = ADJACENT * own.side();
        let (mut sum, mut count) = (0, 0);
        for i in region_cells.filter(|&i| i != index) {
            let cell = &frame.cells[i];
            let (dx, dy) = cell.region.offset_from(&own);
            if !cell.marks.is_masked() && dx.abs().max(dy.abs()) * 10 <= reach_tenths {
                sum += u32::from(codes[i].saturating_sub(cell.baseline.code));
                count += 1;
            }
        }
        if count >= 2 && sum / count < u32::from(codes[index]) / PLAUSIBLE_DIVISOR {
            frame.cells[index].marks.add(IMPLAUSIBLE_SATURATION);
        }
    }
}

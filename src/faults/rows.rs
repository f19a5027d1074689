//! Crosstalk: a row of which every cell reads a part of the row's load.
//!
//! An inspection shows that a row is clean, that is, free of crosstalk, if one of its cells is loaded and another is not. Rows
//! are inspected in turn while the foot is partly in contact. A row that was clean in earlier steps, and then is not clean in
//! [`STEPS`] steps with enough conclusive inspections, has crosstalk.
//!
//! There are two thresholds of pressure. The higher one, [`CONCLUSIVE_KPA`], applies to the evidence of crosstalk, the lower one,
//! [`CLEAN_KPA`], to the evidence that a row is clean. In a healthy row with little pressure, such as one of the midfoot, the
//! pressure may exceed the higher one only while the foot covers all cells. When the foot begins to touch the row, it covers only
//! a part of them, with less pressure. With the higher threshold alone, such a row would be suspect.

use super::MIN_LINE_CELLS;
use super::neighbourhood::FrameContext;
use crate::pipeline::calibrate::FULL_CODE;
use crate::pipeline::marks::LINES;

/// An inspection can be clean if the highest pressure of the row is at least this much above that of the lifted foot, kPa, on
/// the sensor curve that all cells share, without the cell's gain. With less pressure, crosstalk would be hardly larger than
/// the noise. A second condition is that the highest code of the row is below half of full scale.
const CLEAN_KPA: f32 = 10.0;
/// Such an inspection is conclusive, whether it is clean or not, if the highest pressure is at least this much, kPa. With the
/// sensor law of the reference insole, the code of this pressure is one sixteenth of [`FULL_CODE`]. The value was chosen in the
/// same way as [`CLEAN_RATIO`].
const CONCLUSIVE_KPA: f32 = 31.0;
/// An inspection is clean if the lowest pressure of the row is less than the highest one divided by this number: with the
/// sensor law of the reference insole, if its code is less than 1/32 of the highest one. Chosen on the recordings of the tests
/// (docs/faults.md, Limits).
const CLEAN_RATIO: f32 = 76.0;
/// Number of clean inspections after which a row counts as clean in a step. Fewer are not reliable: in the next step, the same
/// healthy row may have no clean inspection.
const CLEAN_INSPECTIONS: u8 = 2;
/// Number of conclusive inspections in a step after which a row without a clean inspection is suspect.
const SUSPECT_INSPECTIONS: u8 = 3;
/// A row is reported if it was clean in this number of steps first, and suspect in this number of steps afterwards, without a
/// clean inspection in between. Steps without enough inspections do not count.
const STEPS: u8 = 2;
/// Time in which every row that is not known to be clean is inspected once, at any frame rate, us.
const ROUND_US: u32 = 40_000;

/// The state of one row, from the present step and the earlier ones.
#[derive(Clone, Copy, Debug)]
struct Row {
    /// Number of conclusive inspections in this step.
    inspections: u8,
    /// Number of clean inspections in this step.
    clean: u8,
    /// Number of clean steps since [`RowSearch::conclude`] or [`RowSearch::forget`] has last reset it.
    clean_steps: u8,
    /// Number of suspect steps since the last clean inspection; steps without enough inspections in between do not count.
    suspect_steps: u8,
    /// The row has masked cells and is not inspected; see [`RowSearch::exclude`].
    is_excluded: bool,
}

impl Row {
    const NEW: Self = Self { inspections: 0, clean: 0, clean_steps: 0, suspect_steps: 0, is_excluded: false };

    /// Inspects the row, which has these cells.
    fn inspect<R>(&mut self, frame: &FrameContext<'_, R>, cells: &[u8]) {
        let (mut least_kpa, mut most_kpa, mut highest_code) = (f32::MAX, 0.0f32, 0);
        for index in cells.iter().map(|&index| usize::from(index)) {
            let (cell, code) = (&frame.cells[index], frame.codes[index]);
            let kpa = |code: u16| frame.curve.pressure_kpa::<f32>(code.saturating_sub(cell.baseline.zero).into());
            // A residual pressure that is not yet part of the baseline is in all cells of the row, as crosstalk would be.
            let lifted = cell.baseline.code.saturating_add_signed(cell.marks.swing_reading.max(0));
            let above_kpa = kpa(code) - kpa(lifted);
            (least_kpa, most_kpa) = (least_kpa.min(above_kpa), most_kpa.max(above_kpa));
            highest_code = highest_code.max(code);
        }
        if cells.len() >= MIN_LINE_CELLS as usize && most_kpa >= CLEAN_KPA && highest_code < FULL_CODE / 2 {
            self.inspections = self.inspections.saturating_add(u8::from(most_kpa >= CONCLUSIVE_KPA));
            self.clean += u8::from(least_kpa < most_kpa / CLEAN_RATIO);
        }
    }
}

/// The search for crosstalk.
#[derive(Debug)]
pub(super) struct RowSearch {
    rows: [Row; LINES],
    rows_per_frame: u32,
    /// The next row to inspect.
    next: usize,
}

impl RowSearch {
    pub(super) const fn new() -> Self {
        Self { rows: [Row::NEW; LINES], rows_per_frame: 0, next: 0 }
    }

    pub(super) fn set_period(&mut self, period_us: u32) {
        self.rows_per_frame = (LINES as u32 * period_us).div_ceil(ROUND_US).min(LINES as u32);
    }

    /// Inspects some of the rows, in turn. Rows that are already clean in this step, or excluded, are skipped.
    pub(super) fn inspect<R>(&mut self, frame: &FrameContext<'_, R>) {
        let mut inspected = 0;
        for _ in 0..LINES {
            let index = self.next;
            self.next = (index + 1) % LINES;
            let row = &mut self.rows[index];
            if row.clean < CLEAN_INSPECTIONS && !row.is_excluded {
                row.inspect(frame, frame.rows.cells(index));
                inspected += 1;
                if inspected == self.rows_per_frame {
                    break;
                }
            }
        }
    }

    /// Ends a step: returns the row with crosstalk that had the most conclusive inspections. Only one row is returned, because
    /// the crosstalk of one row enlarges the contact and leaves fewer inspections of other rows. The inspections of the rows
    /// with a bit in `unknown_rows` are no evidence of crosstalk.
    pub(super) fn conclude(&mut self, unknown_rows: u16) -> Option<usize> {
        let mut worst = None;
        for (index, row) in self.rows.iter_mut().enumerate() {
            if row.clean > 0 {
                // A suspect row that is clean again had no crosstalk: the foot covered all of its cells, which can happen again.
                // Its clean steps are counted from 0.
                let is_clean = u8::from(row.clean >= CLEAN_INSPECTIONS);
                row.clean_steps = if row.suspect_steps == 0 { row.clean_steps.saturating_add(is_clean) } else { 0 };
                row.suspect_steps = 0;
            } else if row.inspections >= SUSPECT_INSPECTIONS
                && row.clean_steps >= STEPS
                && unknown_rows >> index & 1 == 0
            {
                row.suspect_steps += 1;
                if row.suspect_steps >= STEPS {
                    worst = worst.max(Some((row.inspections, index)));
                }
            }
        }
        worst.map(|(_, index)| index)
    }

    /// Discards the inspections of the last step.
    pub(super) fn begin_step(&mut self) {
        for row in &mut self.rows {
            (row.inspections, row.clean) = (0, 0);
        }
    }

    /// Discards the results of all earlier steps.
    pub(super) fn forget(&mut self) {
        for row in &mut self.rows {
            (row.clean_steps, row.suspect_steps) = (0, 0);
        }
    }

    /// Excludes a row with a masked cell from the search: this cell may be the one that showed that the row is clean.
    pub(super) fn exclude(&mut self, row: usize) {
        if let Some(row) = self.rows.get_mut(row) {
            row.is_excluded = true;
        }
    }
}

//! The review of single cells in swing.

use super::FaultKind;
use super::neighbourhood::{FrameContext, Neighbourhood};
use crate::num::Real;
use crate::pipeline::baseline::Rise;
use crate::pipeline::calibrate::is_saturated;
use crate::pipeline::cell::InsoleCell;
use crate::pipeline::marks::{
    CellMarks, Count, DRIFT, IMPLAUSIBLE_SATURATION, LOADED, MAX_LOWERED, NO_RESPONSE, NOISE, RESPONDED, STUCK,
    UNCHANGED,
};

/// Largest deviation from the baseline in swing that can be a slow drift, codes.
const MAX_SLOW: u16 = 1024;

/// Rise of a reading from one swing to the next, codes, above which the step between them is no evidence of crosstalk in the
/// cell's row.
const MAX_RISE: i16 = 2 * NOISE as i16;

/// A running review of all cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Review {
    /// How far the readings can raise the baselines.
    pub(super) rise: Rise,
    /// A step of walking has ended since the last review began, so the cells have evidence of a stance.
    pub(super) has_stance: bool,
    /// Number of cells that carried load in recent steps and did not respond in this step.
    pub(super) unresponsive: u32,
    /// Number of baselines that this review has changed; added to [`Faults::rezeroed`](super::Faults::rezeroed).
    pub(super) changed_baselines: u32,
    /// See [`Faults::with_former_baseline`](super::Faults::with_former_baseline).
    pub(super) with_former_baseline: [u8; 8],
    /// Bit i: the reading of a cell of row i has risen by more than [`MAX_RISE`] since the last swing, so its residual pressure
    /// in the step between was not known.
    pub(super) risen_rows: u16,
}

impl Review {
    pub(super) const fn new(rise: Rise, has_stance: bool) -> Self {
        Self { rise, has_stance, unresponsive: 0, changed_baselines: 0, with_former_baseline: [0; 8], risen_rows: 0 }
    }

    /// Reviews some cells from index `first` on, as many as it takes to review all cells in `frames` frames. Returns the index of
    /// the next cell, or `None` after the last one.
    pub(super) fn cells<R: Real>(
        &mut self,
        frame: &mut FrameContext<'_, R>,
        first: usize,
        frames: u32,
    ) -> Option<usize> {
        let count = frame.cells.len();
        let end = count.min(first + count.div_ceil(frames as usize));
        for index in first..end {
            let code = frame.codes[index];
            let marks = &frame.cells[index].marks;
            if marks.is_masked() {
                continue;
            }
            let last_reading = marks.swing_reading;
            let is_risen = reading(&frame.cells[index], code) > last_reading.max(0).saturating_add(MAX_RISE);
            self.risen_rows |= u16::from(is_risen) << marks.row();
            let is_exceeded = frame.cells[index].baseline.is_exceeded(code, frame.curve);
            if self.has_stance {
                let needs_neighbourhood = !marks.has(RESPONDED) || marks.has(UNCHANGED) || is_exceeded;
                let neighbours = needs_neighbourhood.then(|| Neighbourhood::new(frame, index));
                let cell = &mut frame.cells[index];
                review_swing(cell, code, neighbours.as_ref(), is_exceeded);
                self.unresponsive += u32::from(review_stance(cell, neighbours.as_ref()));
            }
            let cell = &mut frame.cells[index];
            let is_changed = cell.follow(code, last_reading, self.rise, &frame.setup.contact, frame.curve);
            cell.marks.swing_reading = reading(cell, code);
            self.changed_baselines += u32::from(is_changed);
            if is_exceeded {
                let cells = &mut self.with_former_baseline[frame.region(index)];
                *cells = cells.saturating_add(1);
            }
        }
        (end < count).then_some(end)
    }
}

/// The reading of a cell above its baseline, codes.
fn reading<R>(cell: &InsoleCell<R>, code: u16) -> i16 {
    let above = i32::from(code) - i32::from(cell.baseline.code);
    above.clamp(i16::MIN.into(), i16::MAX.into()) as i16
}

/// Reviews the unloaded reading of a cell: the reading can be at full scale, far below the baseline or stuck, or drift farther
/// than the baseline follows. `neighbours` is `None` if their state was not determined; `is_exceeded` states that the cell has
/// more pressure than a baseline can have.
fn review_swing<R>(cell: &mut InsoleCell<R>, code: u16, neighbours: Option<&Neighbourhood>, is_exceeded: bool) {
    let (reading, reading_before) = (reading(cell, code), cell.marks.swing_reading);
    let (size, size_before) = (reading.unsigned_abs(), reading_before.unsigned_abs());
    // The baseline follows a smaller shift.
    let lowered = u16::from(cell.marks.lowered) + cell.baseline.zero.saturating_sub(code) / NOISE;
    let is_far_below = reading < 0 && size > MAX_SLOW && lowered > MAX_LOWERED.into();
    let is_full = is_saturated(code.into());
    cell.marks.count_if(Count::OffScale, is_far_below || is_full);
    if cell.contact.is_loaded() && !is_full {
        // A tight shoe presses on cells in swing too, but then their code changes from step to step.
        let is_loaded = u32::from(code) >= cell.contact.load_threshold(cell.baseline.code);
        if cell.marks.has(UNCHANGED) && (is_loaded || neighbours.is_some_and(Neighbourhood::is_mostly_loaded)) {
            cell.marks.add(STUCK);
        }
        cell.marks.add(UNCHANGED);
        cell.contact.notify_on_change(code);
    } else {
        cell.marks.clear(UNCHANGED);
    }

    // A drift grows from swing to swing. A reading far from the baseline, by more than 8 times the noise, must grow by more than
    // a quarter, because a nearly constant reading is a residual load.
    let least_size = if size > 8 * NOISE { size_before + size_before / 4 } else { size_before };
    let is_drift =
        (reading < 0) == (reading_before < 0) && size_before > NOISE && size_before <= MAX_SLOW && size > least_size;
    let is_beyond_baseline = if reading < 0 {
        u16::from(cell.marks.lowered) + size / NOISE > MAX_LOWERED.into()
    } else {
        // A shoe that is laced tighter, and toes that rest on the insole, press on several cells; a sensor drifts alone.
        is_exceeded && neighbours.is_some_and(|neighbours| neighbours.highest < i32::from(reading) / 4)
    };
    if is_drift && is_beyond_baseline {
        cell.marks.add(DRIFT);
    }
}

/// Reviews the evidence of the stance. True if the cell carried load in recent steps and did not respond in this step.
fn review_stance<R: Real>(cell: &mut InsoleCell<R>, neighbours: Option<&Neighbourhood>) -> bool {
    let marks = &mut cell.marks;
    let loaded_steps = marks.count(Count::Loaded);
    marks.clear(NO_RESPONSE);
    let (mut is_evidence, mut carried_load) = (false, false);
    if marks.has(LOADED) {
        marks.set_count(Count::Loaded, loaded_steps + 1);
    } else if let (false, Some(neighbours)) = (marks.has(RESPONDED), neighbours) {
        marks.set_count(Count::Loaded, loaded_steps.saturating_sub(1));
        carried_load = loaded_steps > 1;
        if carried_load || neighbours.is_between_loaded() {
            marks.add(NO_RESPONSE);
        }
        // An unresponsive cell is evidence of a fault only if there are at least seven of the eight adjacent cells and all of
        // them are loaded: at the edge of the contact the foot may not have touched the cell. The foot may also miss a cell that
        // a region's boundary made much smaller than its neighbours, so a small cell counts only if it carried load before.
        let is_full_size = carried_load || 2 * cell.region.whole() >= neighbours.largest;
        let is_hole =
            neighbours.is_surrounded() && neighbours.adjacent >= 7 && neighbours.loaded == neighbours.adjacent;
        is_evidence = is_full_size && is_hole;
    }
    marks.count_if(Count::NoResponse, is_evidence);
    let is_implausible = marks.has(IMPLAUSIBLE_SATURATION);
    marks.count_if(Count::ImplausibleSaturation, is_implausible);
    carried_load
}

impl CellMarks {
    /// The fault that the evidence shows; `None` without a fault.
    pub(super) fn diagnosis(&self) -> Option<FaultKind> {
        if self.has(STUCK) {
            Some(FaultKind::Stuck)
        } else if self.has(DRIFT) {
            Some(FaultKind::Drift)
        } else if self.count(Count::OffScale) >= 2 {
            // The reading is at full scale, or far below its baseline; the latter is a stuck code.
            Some(if self.swing_reading < 0 { FaultKind::Stuck } else { FaultKind::Short })
        } else if self.count(Count::ImplausibleSaturation) >= 2 {
            Some(FaultKind::Saturated)
        } else if self.count(Count::NoResponse) >= 2 {
            // An open cell reads its baseline.
            Some(if self.swing_reading.unsigned_abs() > NOISE { FaultKind::Stuck } else { FaultKind::Open })
        } else {
            None
        }
    }
}

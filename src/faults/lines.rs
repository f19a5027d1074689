//! Faults of whole rows and columns, concluded from their cells.
//!
//! Here, cells that *did not respond* are those of which a response was expected in this step ([`NO_RESPONSE`]): they carried
//! load in recent steps ([`Count::Loaded`]), or lie between loaded cells. Other cells without a response are no evidence.

use super::neighbourhood::FrameContext;
use super::{FaultKind, MIN_LINE_CELLS};
use crate::pipeline::marks::{Count, LINES, NO_RESPONSE};

/// Number of successive steps in which a line must be open before it is reported.
const STEPS: u8 = 2;

/// The state of the search for faulty lines.
#[derive(Debug)]
pub(super) struct LineSearch {
    /// For each line, rows first: the number of successive steps in which it did not respond.
    open_steps: [u8; 2 * LINES],
}

impl LineSearch {
    pub(super) const fn new() -> Self {
        Self { open_steps: [0; 2 * LINES] }
    }

    /// Number of unmasked cells of each line that did not respond or have a diagnosis.
    pub(super) fn suspect_cells<R>(frame: &FrameContext<'_, R>) -> [u32; 2 * LINES] {
        let mut counts = [0; 2 * LINES];
        for marks in frame.cells.iter().map(|cell| &cell.marks) {
            if !marks.is_masked() && (marks.has(NO_RESPONSE) || marks.diagnosis().is_some()) {
                marks.lines().into_iter().for_each(|line| counts[line] += 1);
            }
        }
        counts
    }

    /// Records that line number `line` has no fault in this step.
    pub(super) fn clear(&mut self, line: usize) {
        self.open_steps[line] = 0;
    }

    /// Returns the fault of a line after all cells were reviewed. `line` is its number: the rows come first, then the columns.
    /// `unresponsive_loaded` is the number of cells on all lines that carried load in recent steps and did not respond in this
    /// step; if the line is reported as open, its cells are subtracted from that number.
    pub(super) fn conclude<R>(
        &mut self,
        frame: &mut FrameContext<'_, R>,
        line: usize,
        unresponsive_loaded: &mut u32,
    ) -> Option<FaultKind> {
        let evidence = LineEvidence::new(frame, line);
        let is_open = evidence.is_open(*unresponsive_loaded);
        let open_steps = &mut self.open_steps[line];
        *open_steps = if is_open { *open_steps + 1 } else { 0 };
        if *open_steps >= STEPS {
            *unresponsive_loaded = unresponsive_loaded.saturating_sub(evidence.unresponsive_loaded);
            return Some(FaultKind::Open);
        }
        if is_open {
            // The review has lowered the count of loaded steps of these cells. It is restored, so that the next step counts the
            // same cells again.
            for marks in frame.cells.iter_mut().map(|cell| &mut cell.marks).filter(|marks| marks.is_on(line)) {
                if marks.has(NO_RESPONSE) && marks.count(Count::Loaded) > 0 {
                    marks.set_count(Count::Loaded, marks.count(Count::Loaded) + 1);
                }
            }
        }
        evidence.common_diagnosis()
    }
}

/// The evidence of the unmasked cells of a line.
#[derive(Default)]
struct LineEvidence {
    /// Number of unmasked cells.
    cells: u32,
    /// Number of cells that did not respond.
    unresponsive: u32,
    /// Number of cells that did not respond and carried load in recent steps.
    unresponsive_loaded: u32,
    /// Number of cells that responded and carried load in recent steps, including this step.
    responsive_loaded: u32,
    /// Number of cells with each diagnosis, in the order of [`FaultKind::ALL`].
    diagnosed: [u32; FaultKind::ALL.len()],
    /// Number of cells without a diagnosis, whether or not they responded.
    undiagnosed: u32,
}

impl LineEvidence {
    fn new<R>(frame: &FrameContext<'_, R>, line: usize) -> Self {
        let mut evidence = Self::default();
        let marks = frame.cells.iter().map(|cell| &cell.marks);
        for marks in marks.filter(|marks| marks.is_on(line) && !marks.is_masked()) {
            let carried_load = marks.count(Count::Loaded) > 0;
            let is_unresponsive = marks.has(NO_RESPONSE);
            evidence.cells += 1;
            evidence.unresponsive += u32::from(is_unresponsive);
            evidence.unresponsive_loaded += u32::from(is_unresponsive && carried_load);
            evidence.responsive_loaded += u32::from(!is_unresponsive && carried_load);
            match marks.diagnosis() {
                Some(kind) => evidence.diagnosed[kind as usize] += 1,
                None => evidence.undiagnosed += 1,
            }
        }
        evidence
    }

    /// True if the line did not respond. `unresponsive_loaded` is the number of cells on all lines that carried load in recent
    /// steps and did not respond.
    fn is_open(&self, unresponsive_loaded: u32) -> bool {
        let others = unresponsive_loaded.saturating_sub(self.unresponsive_loaded);
        // At least four in five of the unresponsive cells that carried load are on this line.
        let is_only_here = self.unresponsive_loaded >= MIN_LINE_CELLS && 4 * others <= self.unresponsive_loaded;
        // At least three in four cells of the line did not respond. If even more cells outside of the line did not respond
        // although they carried load in recent steps, this part of the foot was not loaded, as in steps on the forefoot.
        let is_most = self.unresponsive > MIN_LINE_CELLS
            && 4 * self.unresponsive >= 3 * self.cells
            && others <= self.unresponsive;
        self.responsive_loaded == 0 && (is_only_here || is_most)
    }

    /// The fault (short, stuck, saturated or drift) that at least four in five unmasked cells of the line show, and at least
    /// [`MIN_LINE_CELLS`] cells.
    fn common_diagnosis(&self) -> Option<FaultKind> {
        let all = self.undiagnosed + self.diagnosed.iter().sum::<u32>();
        [FaultKind::Short, FaultKind::Stuck, FaultKind::Saturated, FaultKind::Drift].into_iter().find(|&kind| {
            let count = self.diagnosed[kind as usize];
            count >= MIN_LINE_CELLS && 4 * (all - count) <= count
        })
    }
}

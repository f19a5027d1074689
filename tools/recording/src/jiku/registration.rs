//! Registration of steps: the shift by whole cells with the best overlap of the footprints.

use super::native::{NativeCell, Step};
use std::collections::BTreeMap;

/// Largest shift along an axis, cells. A few cells suffice, because the footprints are roughly centred in the stored images.
const MAX_SHIFT: isize = 6;

/// A translation of a step's cells.
#[derive(Clone, Copy)]
pub struct Shift {
    rows: isize,
    columns: isize,
}

impl Shift {
    /// The shifted position of a cell.
    pub fn apply(self, (row, column): NativeCell) -> (isize, isize) {
        (row as isize + self.rows, column as isize + self.columns)
    }
}

/// The shift of each step relative to the first, which is not shifted.
pub fn shifts(steps: &[Step]) -> Vec<Shift> {
    let mut common = BTreeMap::<(isize, isize), f64>::new();
    let mut shifts = Vec::with_capacity(steps.len());
    for step in steps {
        let footprint = footprint(step);
        let shift = best_shift(&footprint, &common);
        for &(cell, weight) in &footprint {
            *common.entry(shift.apply(cell)).or_default() += weight;
        }
        shifts.push(shift);
    }
    shifts
}

/// The loaded cells with their weights. The weight is the square root of the peak of the cell, so that not only the highest
/// peaks but also the outline of the foot determines the shift.
fn footprint(step: &Step) -> Vec<(NativeCell, f64)> {
    step.loaded_cells()
        .map(|cell| {
            let peak = step.series(cell).iter().copied().max().unwrap_or(0);
            (cell, f64::from(peak).sqrt())
        })
        .collect()
}

/// The shift with which the footprint has the largest overlap with the previous steps. `common` contains, for each cell, the
/// sum of its weights in the previous steps.
fn best_shift(footprint: &[(NativeCell, f64)], common: &BTreeMap<(isize, isize), f64>) -> Shift {
    let overlap = |shift: Shift| -> f64 {
        footprint.iter().filter_map(|&(cell, weight)| Some(weight * common.get(&shift.apply(cell))?)).sum()
    };
    let mut best = Shift { rows: 0, columns: 0 };
    let mut most = overlap(best);
    for rows in -MAX_SHIFT..=MAX_SHIFT {
        for columns in -MAX_SHIFT..=MAX_SHIFT {
            let shift = Shift { rows, columns };
            let here = overlap(shift);
            if here > most {
                (best, most) = (shift, here);
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shifted_step_is_aligned_with_the_first() {
        let at = |row: usize, column: usize| {
            let mut units = vec![0; 20 * 20];
            for (r, c, peak) in [(0, 0, 90), (1, 0, 400), (1, 1, 250), (4, 2, 30)] {
                units[(row + r) * 20 + column + c] = peak;
            }
            Step::new(20, 1, units)
        };
        let steps = [at(8, 8), at(11, 4), at(8, 8)];
        let shifted = shifts(&steps)
            .into_iter()
            .zip(&steps)
            .map(|(shift, step)| step.loaded_cells().map(|p| shift.apply(p)).collect())
            .collect::<Vec<Vec<_>>>();
        assert_eq!(shifted[0][0], (8, 8));
        assert!(shifted[1] == shifted[0] && shifted[2] == shifted[0]);
    }
}

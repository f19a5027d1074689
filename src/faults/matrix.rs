//! The cells of each row of the sensor matrix.

use super::MATRIX_CELLS;
use crate::pipeline::cell::InsoleCell;
use crate::pipeline::marks::LINES;

/// The cells of each row of the matrix. They are listed once, so that an inspection need not search all cells for those of a row.
#[derive(Debug)]
pub(crate) struct MatrixRows {
    /// The indices of the cells, ordered by their rows.
    cells: [u8; MATRIX_CELLS],
    /// One past the last cell of each row in `cells`.
    ends: [u16; LINES],
}

impl MatrixRows {
    pub(crate) const NONE: Self = Self { cells: [0; MATRIX_CELLS], ends: [0; LINES] };

    /// Lists the cells of an insole. Cells after the first [`MATRIX_CELLS`] are omitted: a larger insole is not searched for
    /// faulty lines.
    pub(crate) fn set<R>(&mut self, cells: &[InsoleCell<R>]) {
        let mut len = 0;
        for (row, end) in self.ends.iter_mut().enumerate() {
            for (index, cell) in cells.iter().take(MATRIX_CELLS).enumerate() {
                if cell.marks.row() == row {
                    self.cells[len] = index as u8;
                    len += 1;
                }
            }
            *end = len as u16;
        }
    }

    /// The indices of the cells of a row.
    pub(super) fn cells(&self, row: usize) -> &[u8] {
        let start = row.checked_sub(1).map_or(0, |previous| self.ends[previous]);
        &self.cells[usize::from(start)..usize::from(self.ends[row])]
    }
}

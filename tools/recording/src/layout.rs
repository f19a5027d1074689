//! The cells of a sensor sheet or pressure plate.

use crate::grid::MAX_LINES;
use crate::names;
use plantar::Region;
use serde::{Deserialize, Serialize};

/// Largest number of cells in a recording.
pub const MAX_CELLS: usize = 4096;

/// One pressure sensor in foot coordinates: x points to the lateral side, y from heel to toes, and the origin is at the back of
/// the heel on the medial edge. These coordinates are the same for left and right feet.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Centroid, mm from the medial edge.
    pub x_mm: f64,
    /// Centroid, mm from the back of the heel.
    pub y_mm: f64,
    /// Sensitive area, mm².
    pub area_mm2: f64,
    /// Plantar region of the cell. Files contain its [`Region::name`].
    #[serde(with = "names::region")]
    pub region: Region,
}

impl Cell {
    /// Half of the side of a square with the area of the cell, mm. The cell is assumed to extend this far from its centroid.
    pub(crate) fn half_side_mm(&self) -> f64 {
        self.area_mm2.sqrt() / 2.0
    }
}

/// The cells of a sensor sheet or pressure plate, in the order of the values of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Layout {
    /// Name. Its beginning identifies the layouts of insoles and of computed recordings.
    pub name: String,
    /// The cells, at most [`MAX_CELLS`].
    pub cells: Vec<Cell>,
    /// The place under the foot of the matrix sensor to which the cells belong; `None` if the cells are not those of an insole in
    /// rows and columns, or if cells were merged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sheet: Option<Sheet>,
}

/// The place of the matrix sensor of an insole under the foot, in foot coordinates. The row and the column of each cell follow
/// from it. Seen from above, rows are numbered from the toes, and columns from the left, both from 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sheet {
    /// Centroid of the sensor in row 0 and column 0, mm from the medial edge.
    pub x_mm: f64,
    /// Centroid of the sensor in row 0 and column 0, mm from the back of the heel.
    pub y_mm: f64,
    /// Step along y from a row to the next one, mm. It is negative, because the toes are in the first row.
    pub row_mm: f64,
    /// Step along x from a column to the next one, mm. It is negative in the left foot.
    pub column_mm: f64,
}

impl Sheet {
    /// The row and the column of a cell; `None` if the cell is in none.
    pub(crate) fn row_and_column(&self, cell: &Cell) -> Option<(usize, usize)> {
        /// Largest deviation of a cell from its place, as a fraction of the step. Only rounding causes one.
        const DEVIATION: f64 = 1e-3;
        let index = |distance_mm: f64, step_mm: f64| {
            let index = (distance_mm / step_mm).round();
            let is_exact = (distance_mm / step_mm - index).abs() < DEVIATION;
            (is_exact && (0.0..MAX_LINES as f64).contains(&index)).then_some(index as usize)
        };
        Some((index(cell.y_mm - self.y_mm, self.row_mm)?, index(cell.x_mm - self.x_mm, self.column_mm)?))
    }
}

/// The beginning of the name of an insole's layout, in front of its identifier.
const INSOLE: &str = "insole 0x";
/// The beginning of the name of the layout of computed recordings.
const COMPUTED: &str = "synthetic insole";

impl Layout {
    /// The layout of an insole of this project.
    pub(crate) fn of_insole(layout_id: u32, cells: Vec<Cell>) -> Self {
        Self { name: format!("{INSOLE}{layout_id:08x}"), cells, sheet: None }
    }

    /// The layout of computed recordings.
    pub(crate) fn computed(cells: Vec<Cell>) -> Self {
        Self { name: format!("{COMPUTED}, EU 42, {} cells", cells.len()), cells, sheet: None }
    }

    /// True if the pressures were computed from sensor codes by this project's law: those of insoles and of computed recordings.
    /// The zero of a cell is then an offset of its code, and in any other recording an offset of its pressure.
    pub(crate) fn has_code_offsets(&self) -> bool {
        [INSOLE, COMPUTED].iter().any(|beginning| self.name.starts_with(beginning))
    }

    /// True if the recording is of an insole of this project, so its times are those of the insole's own clock.
    pub fn is_of_insole(&self) -> bool {
        self.name.starts_with(INSOLE)
    }

    /// Force on all cells, N: the sum of pressure times area. `pressure_kpa` has one value for each cell.
    pub fn force_n(&self, pressure_kpa: &[f32]) -> f64 {
        // 1 kPa on 1 mm² is 1 mN.
        pressure_kpa.iter().zip(&self.cells).map(|(&kpa, cell)| f64::from(kpa) * cell.area_mm2).sum::<f64>() * 1e-3
    }
}

//! The cells of a sensor sheet or pressure plate.

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
}

/// The beginning of the name of an insole's layout, in front of its identifier.
const INSOLE: &str = "insole 0x";
/// The beginning of the name of the layout of computed recordings.
const COMPUTED: &str = "synthetic insole";

impl Layout {
    /// The layout of an insole of this project.
    pub(crate) fn of_insole(layout_id: u32, cells: Vec<Cell>) -> Self {
        Self { name: format!("{INSOLE}{layout_id:08x}"), cells }
    }

    /// The layout of computed recordings.
    pub(crate) fn computed(cells: Vec<Cell>) -> Self {
        Self { name: format!("{COMPUTED}, EU 42, {} cells", cells.len()), cells }
    }

    /// True if the pressures were computed from the codes of a sensor by this project's law: those of an insole, or computed
    /// ones. The reading of an unloaded cell is then an offset of its code; that of any other sensor is an offset of its pressure.
    pub(crate) fn is_of_codes(&self) -> bool {
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

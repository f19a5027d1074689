use crate::names;
use plantar::Region;
use serde::{Deserialize, Serialize};

/// The most cells one recording may have.
pub const MAX_CELLS: usize = 4096;

/// One pressure sensor in foot coordinates: x to the lateral side, y from heel to toes, origin at the
/// back of the heel on the medial edge. Left and right feet therefore share one frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Centroid, mm from the medial edge.
    pub x_mm: f64,
    /// Centroid, mm from the back of the heel.
    pub y_mm: f64,
    /// Area, mm².
    pub area_mm2: f64,
    /// The plantar region the cell belongs to; its snake-case name in files.
    #[serde(with = "names::region")]
    pub region: Region,
}

impl Cell {
    /// Half the side of a square of the cell's area, mm: how far the cell reaches from its centroid.
    pub(crate) fn half_side_mm(&self) -> f64 {
        self.area_mm2.sqrt() / 2.0
    }
}

/// The cells of one sensor sheet, in the order of a frame's values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Layout {
    /// The sheet's name, for people.
    pub name: String,
    /// The cells, at most [`MAX_CELLS`].
    pub cells: Vec<Cell>,
}

impl Layout {
    /// The force of these pressures, kPa, one a cell, on all cells, N: the sum of pressure times area.
    pub fn force_n(&self, pressure_kpa: &[f32]) -> f64 {
        // 1 kPa on 1 mm² is 1 mN.
        pressure_kpa.iter().zip(&self.cells).map(|(&kpa, cell)| f64::from(kpa) * cell.area_mm2).sum::<f64>() * 1e-3
    }
}

//! Assigns regions to the cells of a source that names none, by fitting [`plantar::pipeline::template`] to the extent of the
//! cells.

use crate::Cell;
use plantar::pipeline::template::region_at;

/// The band across the foot in which the width of the heel is measured. A band lies between two fractions of the foot's length,
/// measured from the back of the heel.
pub(crate) const HEEL: [f64; 2] = [0.05, 0.25];
/// The band in which the width of the forefoot is measured.
pub(crate) const FOREFOOT: [f64; 2] = [0.60, 0.78];

/// Assigns each cell its region by [`region_at`]. The length of the foot is the extent of the cells. The edges of the foot are
/// straight lines from the edges of the heel to the edges of the forefoot, so that a foot may lie obliquely on its sensor
/// sheet. Behind the heel and in front of the forefoot the width is constant.
///
/// `cells` must be the cells under the foot, in foot coordinates; their regions are replaced. An empty slice is allowed.
pub fn assign(cells: &mut [Cell]) {
    let under_foot = vec![true; cells.len()];
    assign_within(cells, &under_foot);
}

/// As [`assign`], for cells that are not all under the foot: the extent of the foot is that of the cells for which
/// `under_foot` is true. A cell outside of this extent has the region of the nearest position within it.
pub(crate) fn assign_within(cells: &mut [Cell], under_foot: &[bool]) {
    let foot: Vec<Cell> =
        cells.iter().zip(under_foot).filter(|(_, is_under)| **is_under).map(|(cell, _)| *cell).collect();
    let length = extent(&foot, |c| c.y_mm);
    let y_frac = |y_mm: f64| (y_mm - length.low_mm) / (length.high_mm - length.low_mm);
    let edges = |band: [f64; 2]| {
        let within: Vec<Cell> =
            foot.iter().filter(|c| (band[0]..=band[1]).contains(&y_frac(c.y_mm))).copied().collect();
        // A layout without cells in the band is treated as a rectangle.
        extent(if within.is_empty() { &foot } else { &within }, |c| c.x_mm)
    };
    let (heel, forefoot) = (edges(HEEL), edges(FOREFOOT));
    let middle = |band: [f64; 2]| (band[0] + band[1]) / 2.0;
    let (heel_y, forefoot_y) = (middle(HEEL), middle(FOREFOOT));
    for cell in cells {
        let y = y_frac(cell.y_mm);
        let toward_forefoot = (y - heel_y) / (forefoot_y - heel_y);
        let centre_mm = heel.centre_mm() + (forefoot.centre_mm() - heel.centre_mm()) * toward_forefoot;
        let width_mm = heel.width_mm() + (forefoot.width_mm() - heel.width_mm()) * toward_forefoot.clamp(0.0, 1.0);
        cell.region = region_at(((cell.x_mm - centre_mm) / width_mm + 0.5) as f32, y as f32);
    }
}

/// The extent of cells along one axis.
struct Extent {
    low_mm: f64,
    high_mm: f64,
}

impl Extent {
    fn centre_mm(&self) -> f64 {
        (self.low_mm + self.high_mm) / 2.0
    }

    fn width_mm(&self) -> f64 {
        self.high_mm - self.low_mm
    }
}

/// The extent of cells along the axis of `along`, including half of the side of each cell.
fn extent(cells: &[Cell], along: fn(&Cell) -> f64) -> Extent {
    let empty = Extent { low_mm: f64::INFINITY, high_mm: f64::NEG_INFINITY };
    cells.iter().fold(empty, |extent, cell| Extent {
        low_mm: extent.low_mm.min(along(cell) - cell.half_side_mm()),
        high_mm: extent.high_mm.max(along(cell) + cell.half_side_mm()),
    })
}

//! The ellipse over which a region is loaded in computed recordings.

use crate::{Cell, Layout};
use plantar::Region;

/// The covered share of a cell is the share of the points of a regular grid that lie in the ellipse. The grid has this number
/// of points along each side of the cell.
const POINTS: usize = 8;

/// The ellipse of one region at full size, and the positions of the cells of the region relative to this ellipse.
pub struct LoadEllipse {
    centre_mm: [f64; 2],
    radii_mm: [f64; 2],
    /// The cells of the region.
    pub cells: Vec<EllipseCell>,
}

/// A cell of a [`LoadEllipse`].
pub struct EllipseCell {
    /// Index in the layout.
    pub index: usize,
    /// Squared distance of its centroid from the centre of the ellipse, in units of the radii.
    pub centre_distance2: f64,
    /// Squared distances of the grid points in the cell, in the same units, ascending.
    point_distances2: Vec<f64>,
}

impl LoadEllipse {
    /// The ellipse of a region of `layout`.
    pub fn of(layout: &Layout, region: Region) -> Self {
        let own = || layout.cells.iter().filter(|cell| cell.region == region);
        let area_mm2: f64 = own().map(|cell| cell.area_mm2).sum();
        let mean = |of: &dyn Fn(&Cell) -> f64| own().map(|cell| of(cell) * cell.area_mm2).sum::<f64>() / area_mm2;
        let centre_mm = [mean(&|c| c.x_mm), mean(&|c| c.y_mm)];
        // The variance within a square cell, which is added to that of the centres. The width of a uniform rectangle is 3.46
        // standard deviations, so an ellipse with radii of 1.5 standard deviations lies inside.
        let within_cell = mean(&|c| c.area_mm2 / 12.0);
        let radius = |variance: f64| 1.5 * (variance + within_cell).sqrt();
        let radii_mm =
            [radius(mean(&|c| (c.x_mm - centre_mm[0]).powi(2))), radius(mean(&|c| (c.y_mm - centre_mm[1]).powi(2)))];
        let mut ellipse = Self { centre_mm, radii_mm, cells: Vec::new() };
        for (index, cell) in layout.cells.iter().enumerate() {
            if cell.region == region {
                ellipse.cells.push(EllipseCell {
                    index,
                    centre_distance2: ellipse.squared_distance(cell.x_mm, cell.y_mm),
                    point_distances2: ellipse.point_distances2(cell),
                });
            }
        }
        ellipse
    }

    /// Squared distance of a point from the centre, in units of the radii. It is 1 on the ellipse at full size.
    fn squared_distance(&self, x_mm: f64, y_mm: f64) -> f64 {
        ((x_mm - self.centre_mm[0]) / self.radii_mm[0]).powi(2)
            + ((y_mm - self.centre_mm[1]) / self.radii_mm[1]).powi(2)
    }

    /// The squared distances of the grid points in a cell, in units of the radii, ascending.
    fn point_distances2(&self, cell: &Cell) -> Vec<f64> {
        let side_mm = cell.area_mm2.sqrt();
        let offset = |i: usize| ((i as f64 + 0.5) / POINTS as f64 - 0.5) * side_mm;
        let mut distances2: Vec<f64> = (0..POINTS * POINTS)
            .map(|i| self.squared_distance(cell.x_mm + offset(i % POINTS), cell.y_mm + offset(i / POINTS)))
            .collect();
        distances2.sort_by(f64::total_cmp);
        distances2
    }
}

impl EllipseCell {
    /// The share of the cell that lies in an ellipse with `size` times the area of the ellipse at full size.
    pub fn covered(&self, size: f64) -> f64 {
        let covered = self.point_distances2.partition_point(|&distance2| distance2 < size);
        covered as f64 / self.point_distances2.len() as f64
    }
}

/// The pressures of one frame in which every cell carries load, kPa.
pub fn loaded_frame(layout: &Layout) -> Vec<f32> {
    let ellipses = Region::ALL.map(|region| LoadEllipse::of(layout, region));
    layout
        .cells
        .iter()
        .map(|cell| (200.0 / (1.0 + ellipses[cell.region as usize].squared_distance(cell.x_mm, cell.y_mm))) as f32)
        .collect()
}

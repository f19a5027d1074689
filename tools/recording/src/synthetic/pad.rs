//! The ellipse over which a region is loaded.

use crate::{Cell, Layout};
use plantar::Region;

/// A cell's covered share is counted on this many points squared.
const POINTS: usize = 8;

/// The ellipse of one region at full size, and the position of its cells within it.
pub struct Pad {
    centre_mm: [f64; 2],
    radii_mm: [f64; 2],
    /// The cells of the region.
    pub cells: Vec<PadCell>,
}

/// A cell of a [`Pad`].
pub struct PadCell {
    /// Index in the layout.
    pub index: usize,
    /// [`Pad::distance`] of the centroid.
    pub centre: f64,
    /// [`Pad::distance`] of points spread over the cell, ascending.
    points: Vec<f64>,
}

impl Pad {
    /// The pad of a region of `layout`.
    pub fn of(layout: &Layout, region: Region) -> Self {
        let own = || layout.cells.iter().filter(|cell| cell.region == region);
        let area_mm2: f64 = own().map(|cell| cell.area_mm2).sum();
        let mean = |of: &dyn Fn(&Cell) -> f64| own().map(|cell| of(cell) * cell.area_mm2).sum::<f64>() / area_mm2;
        let centre_mm = [mean(&|c| c.x_mm), mean(&|c| c.y_mm)];
        // The variance over the cells' squares. A uniform box is 3.46 deviations wide, so a radius of 1.5 fits inside.
        let within_cell = mean(&|c| c.area_mm2 / 12.0);
        let radius = |variance: f64| 1.5 * (variance + within_cell).sqrt();
        let radii_mm =
            [radius(mean(&|c| (c.x_mm - centre_mm[0]).powi(2))), radius(mean(&|c| (c.y_mm - centre_mm[1]).powi(2)))];
        let mut pad = Self { centre_mm, radii_mm, cells: Vec::new() };
        for (index, cell) in layout.cells.iter().enumerate() {
            if cell.region == region {
                pad.cells.push(PadCell { index, centre: pad.distance(cell.x_mm, cell.y_mm), points: pad.points(cell) });
            }
        }
        pad
    }

    /// Squared distance from the centre in units of the radii: 1 on the ellipse at full size.
    fn distance(&self, x_mm: f64, y_mm: f64) -> f64 {
        ((x_mm - self.centre_mm[0]) / self.radii_mm[0]).powi(2)
            + ((y_mm - self.centre_mm[1]) / self.radii_mm[1]).powi(2)
    }

    fn points(&self, cell: &Cell) -> Vec<f64> {
        let side_mm = cell.area_mm2.sqrt();
        let offset = |i: usize| ((i as f64 + 0.5) / POINTS as f64 - 0.5) * side_mm;
        let mut points: Vec<f64> = (0..POINTS * POINTS)
            .map(|i| self.distance(cell.x_mm + offset(i % POINTS), cell.y_mm + offset(i / POINTS)))
            .collect();
        points.sort_by(f64::total_cmp);
        points
    }
}

impl PadCell {
    /// The share of the cell within an ellipse of `size`, its area relative to full size.
    pub fn covered(&self, size: f64) -> f64 {
        let points = self.points.partition_point(|&point| point < size);
        points as f64 / self.points.len() as f64
    }
}

/// One frame in which every cell carries load, kPa.
pub fn loaded_frame(layout: &Layout) -> Vec<f32> {
    let pads = Region::ALL.map(|region| Pad::of(layout, region));
    layout
        .cells
        .iter()
        .map(|cell| (200.0 / (1.0 + pads[cell.region as usize].distance(cell.x_mm, cell.y_mm))) as f32)
        .collect()
}

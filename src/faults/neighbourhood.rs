//! The cells around a cell, and the frame in which they are inspected.

use super::matrix::MatrixRows;
use crate::num::Real;
use crate::pipeline::calibrate::Curve;
use crate::pipeline::cell::InsoleCell;
use crate::pipeline::live::RegionLoad;
use crate::pipeline::marks::LOADED;
use crate::pipeline::region::PER_MM;
use crate::pipeline::setup::{Division, Setup};
use core::ops::Range;

/// Largest distance of an adjacent cell along an axis, in tenths of the side of a cell: the eight cells around it.
pub(super) const ADJACENT: i32 = 16;
/// Largest distance of a nearby cell, in the same unit. It includes the cells behind the adjacent ones, and so the cells on the
/// far side of a line that is faulty as a whole.
pub(super) const NEARBY: i32 = 28;

/// One frame, after the cells were summed.
pub(crate) struct FrameContext<'a, R> {
    pub(crate) cells: &'a mut [InsoleCell<R>],
    pub(crate) division: &'a Division,
    pub(crate) curve: &'a Curve,
    pub(crate) setup: &'a Setup,
    pub(crate) rows: &'a MatrixRows,
    /// One code for each cell.
    pub(crate) codes: &'a [u16],
    /// The loads of the regions in this frame.
    pub(crate) loads: &'a mut [RegionLoad<R>; 8],
    /// Number of the frame.
    pub(crate) seq: u32,
    /// Number of times that the frame number has wrapped.
    pub(crate) wraps: u32,
}

impl<R> FrameContext<'_, R> {
    /// The region of a cell, by its index.
    pub(super) fn region(&self, index: usize) -> usize {
        self.division.region(index)
    }

    /// The cells of the region of a cell.
    pub(super) fn region_cells(&self, index: usize) -> Range<usize> {
        self.division.cells(self.region(index))
    }
}

/// The cells around a cell that are sound ([`crate::pipeline::marks::CellMarks::is_sound`]), in all regions.
#[derive(Default)]
pub(super) struct Neighbourhood {
    /// Number of adjacent cells.
    pub(super) adjacent: u32,
    /// Number of adjacent cells that exceeded the load threshold since the last review.
    pub(super) loaded: u32,
    /// Area of the largest adjacent cell, in the units of [`crate::pipeline::region::RegionCell::whole`].
    pub(super) largest: i32,
    /// Highest reading of an adjacent cell above its baseline in this frame, codes; 0 if none is above.
    pub(super) highest: i32,
    /// Whether a nearby cell on the medial, lateral, heel or toe side exceeded the load threshold since the last review.
    loaded_sides: [bool; 4],
}

impl Neighbourhood {
    pub(super) fn new<R: Real>(frame: &FrameContext<'_, R>, index: usize) -> Self {
        let mut neighbours = Self::default();
        let this = &frame.cells[index].region;
        let [adjacent, nearby] = [ADJACENT, NEARBY].map(|tenths| tenths * this.side() / 10);
        let (own_x, own_y) = this.position();
        let Division { origins_mm, extents_mm, .. } = frame.division;
        let own_origin = origins_mm[frame.region(index)];
        for (region, (origin, extent)) in origins_mm.iter().zip(extents_mm).enumerate() {
            // Position of the reference point of the region relative to the cell.
            let origin_x = ((origin.0 - own_origin.0) * PER_MM) as i32 - own_x;
            let origin_y = ((origin.1 - own_origin.1) * PER_MM) as i32 - own_y;
            // The nearby positions along the axes, relative to the reference point of the region.
            let nearby_x = -nearby - origin_x..nearby - origin_x + 1;
            let nearby_y = -nearby - origin_y..nearby - origin_y + 1;
            // Most regions are too far away to have a nearby cell.
            if !overlaps(&nearby_x, extent.0) || !overlaps(&nearby_y, extent.1) {
                continue;
            }
            let cells = frame.division.cells(region);
            for (i, cell) in cells.clone().zip(&frame.cells[cells]) {
                let (x, y) = cell.region.position();
                let is_nearby = nearby_y.contains(&y) && nearby_x.contains(&x);
                if !is_nearby || i == index || !cell.marks.is_sound() {
                    continue;
                }
                let (dx, dy) = (origin_x + x, origin_y + y);
                let distance = dx.abs().max(dy.abs());
                if distance <= adjacent {
                    neighbours.adjacent += 1;
                    neighbours.largest = neighbours.largest.max(cell.region.whole());
                    neighbours.loaded += u32::from(cell.marks.has(LOADED));
                    let reading = i32::from(frame.codes[i]) - i32::from(cell.baseline.code);
                    neighbours.highest = neighbours.highest.max(reading);
                }
                if cell.marks.has(LOADED) {
                    let side = if dx.abs() > dy.abs() { usize::from(dx > 0) } else { 2 + usize::from(dy > 0) };
                    neighbours.loaded_sides[side] = true;
                }
            }
        }
        neighbours
    }

    /// True if cells on two opposite sides were loaded.
    pub(super) fn is_between_loaded(&self) -> bool {
        let [medial, lateral, heel, toes] = self.loaded_sides;
        medial && lateral || heel && toes
    }

    /// True if cells on all four sides were loaded.
    pub(super) fn is_surrounded(&self) -> bool {
        self.loaded_sides == [true; 4]
    }

    /// True if at least two adjacent cells exist and half of them or more were loaded.
    pub(super) fn is_mostly_loaded(&self) -> bool {
        self.adjacent >= 2 && 2 * self.loaded >= self.adjacent
    }
}

/// True if an interval of positions overlaps a region with this extent around its reference point.
fn overlaps(interval: &Range<i32>, extent_mm: f32) -> bool {
    // One unit is added, because positions are rounded.
    let half = (extent_mm * (PER_MM / 2.0)) as i32 + 1;
    interval.start <= half && interval.end > -half
}

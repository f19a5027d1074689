//! The cells around a cell, and the frame in which they are inspected.

use crate::num::Real;
use crate::pipeline::cell::InsoleCell;
use crate::pipeline::live::RegionLoad;
use crate::pipeline::marks::LOADED;
use core::ops::Range;

/// Largest distance of an adjacent cell along an axis, in tenths of the side of a cell: the eight cells around it.
pub(super) const ADJACENT: i32 = 16;
/// Largest distance of a nearby cell, in the same unit. It includes the cells behind the adjacent ones, and so the cells on the
/// far side of a line that is faulty as a whole.
pub(super) const NEARBY: i32 = 28;

/// One frame, after the cells were summed.
pub(crate) struct FrameContext<'a, R> {
    pub(crate) cells: &'a mut [InsoleCell<R>],
    /// One past the last cell of each region.
    pub(crate) ends: &'a [usize; 8],
    /// Reference point of each region, foot coordinates, mm.
    pub(crate) origins_mm: &'a [(f32, f32); 8],
    /// One code for each cell.
    pub(crate) codes: &'a [u16],
    /// The loads of the regions in this frame.
    pub(crate) loads: &'a mut [RegionLoad<R>; 8],
    /// Number of the frame.
    pub(crate) seq: u32,
    /// Time between frames, us.
    pub(crate) period_us: u32,
}

impl<R> FrameContext<'_, R> {
    /// The region of a cell, by its index.
    pub(super) fn region(&self, index: usize) -> usize {
        self.ends.partition_point(|&end| end <= index)
    }

    /// The cells of the region of a cell.
    pub(super) fn region_cells(&self, index: usize) -> Range<usize> {
        let region = self.region(index);
        let start = region.checked_sub(1).map_or(0, |before| self.ends[before]);
        start..self.ends[region]
    }
}

/// The healthy cells around a cell, in all regions.
#[derive(Default)]
pub(super) struct Neighbourhood {
    /// Number of adjacent cells.
    pub(super) adjacent: u32,
    /// Number of adjacent cells that exceeded the load threshold since the last review.
    pub(super) loaded: u32,
    /// Area of the largest adjacent cell, in the units of [`crate::pipeline::region::RegionCell::whole`].
    pub(super) largest: i32,
    /// Whether a nearby cell on the medial, lateral, heel or toe side exceeded the load threshold since the last review.
    loaded_sides: [bool; 4],
}

impl Neighbourhood {
    pub(super) fn new<R: Real>(frame: &FrameContext<'_, R>, index: usize) -> Self {
        let mut around = Self::default();
        let this = &frame.cells[index].region;
        let side = this.side();
        let own_origin = frame.origins_mm[frame.region(index)];
        let mut start = 0;
        for (&end, origin) in frame.ends.iter().zip(frame.origins_mm) {
            // `offset_from` counts 64 units in 1 mm.
            let region_dx = ((origin.0 - own_origin.0) * 64.0) as i32;
            let region_dy = ((origin.1 - own_origin.1) * 64.0) as i32;
            for i in core::mem::replace(&mut start, end)..end {
                let cell = &frame.cells[i];
                let (dx, dy) = cell.region.offset_from(this);
                let (dx, dy) = (dx + region_dx, dy + region_dy);
                let distance = dx.abs().max(dy.abs()) * 10;
                if i == index || !cell.marks.is_sound() || distance > NEARBY * side {
                    continue;
                }
                if distance <= ADJACENT * side {
                    around.adjacent += 1;
                    around.largest = around.largest.max(cell.region.whole());
                    around.loaded += u32::from(cell.marks.has(LOADED));
                }
                if cell.marks.has(LOADED) {
                    let side = if dx.abs() > dy.abs() { usize::from(dx > 0) } else { 2 + usize::from(dy > 0) };
                    around.loaded_sides[side] = true;
                }
            }
        }
        around
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

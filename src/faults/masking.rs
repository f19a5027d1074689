//! The masking of faulty cells, and the interpolation of their readings.

use super::MAX_INTERPOLATED;
use super::neighbourhood::{FrameContext, NEARBY};
use crate::num::Real;
use crate::pipeline::cell::area_units;
use heapless::Vec;

/// A masked cell, and the cells from which its reading is interpolated.
#[derive(Clone, Copy, Debug)]
struct Mask {
    /// Index of the masked cell.
    cell: u16,
    /// Its code at zero pressure, before it was masked.
    zero: u16,
    /// Indices of the nearest healthy cells. If there are fewer than four, the index of the masked cell fills the rest.
    neighbours: [u16; 4],
}

/// The masked cells that are interpolated, and the regions that have masked cells.
#[derive(Debug)]
pub(super) struct Masking {
    masks: Vec<Mask, MAX_INTERPOLATED>,
    /// Bit i: region i has masked cells.
    pub(super) regions: u8,
}

impl Masking {
    pub(super) const fn new() -> Self {
        Self { masks: Vec::new(), regions: 0 }
    }

    #[inline(always)]
    pub(super) fn has_masks(&self) -> bool {
        !self.masks.is_empty()
    }

    /// Masks a cell; returns the change of the region's contact area, in [`area_units`]. Only the first [`MAX_INTERPOLATED`]
    /// masked cells are interpolated.
    pub(super) fn mask<R: Real>(&mut self, frame: &mut FrameContext<'_, R>, index: usize) -> i32 {
        let region = frame.region(index);
        let cell = &mut frame.cells[index];
        cell.marks.set_masked();
        self.regions |= 1 << region;
        let mask = Mask { cell: index as u16, zero: cell.baseline.zero, neighbours: [index as u16; 4] };
        // With this zero, the pass over the cells adds no force of this cell.
        cell.baseline.zero = u16::MAX;
        let load = &mut frame.loads[region].frame;
        let before = area_units(&load.area);
        load.update_contact(&cell.region, &mut cell.contact, 0, cell.baseline.zero, 0.0);
        cell.contact.notify_always();
        let _ = self.masks.push(mask);
        area_units(&load.area) - before
    }

    /// Replaces the readings of masked cells by the mean of their neighbours: updates the region sums of this frame.
    #[cold]
    #[inline(never)]
    pub(super) fn interpolate<R: Real>(&self, frame: &mut FrameContext<'_, R>) {
        for mask in &self.masks {
            // These sums have single precision even if `R` is f64, so that device and host compute the same area.
            let (mut sum_kpa, mut count) = (0.0f32, 0.0f32);
            for neighbour in mask.neighbours.into_iter().filter(|&neighbour| neighbour != mask.cell).map(usize::from) {
                let cell = &frame.cells[neighbour];
                sum_kpa += cell.baseline.gain * cell.above_kpa(frame.codes[neighbour].into(), frame.curve);
                count += 1.0;
            }
            let index = usize::from(mask.cell);
            let region = frame.region(index);
            let (cell, load) = (&mut frame.cells[index], &mut frame.loads[region].frame);
            // The pressure of the masked cell above its baseline, on the sensor curve that all cells share.
            let above_kpa = if count > 0.0 { sum_kpa / count / cell.baseline.gain } else { 0.0 };
            let code = frame.curve.first_code_at(above_kpa + cell.baseline.residual_kpa);
            let code = u32::from(code) + u32::from(mask.zero);
            load.update_contact(&cell.region, &mut cell.contact, code, cell.baseline.zero, above_kpa);
            cell.contact.notify_always();
            if above_kpa > 0.0 {
                load.force.add(&cell.region, R::of_f32(above_kpa));
            }
        }
    }

    /// Chooses the nearest healthy cells of the same region, at most four, for each masked cell.
    pub(super) fn choose_neighbours<R: Real>(&mut self, frame: &FrameContext<'_, R>) {
        for mask in &mut self.masks {
            let index = usize::from(mask.cell);
            let own = &frame.cells[index].region;
            let reach_tenths = NEARBY * own.side();
            // Squared distance and index of each cell; the masked cell stands for none.
            let mut nearest = [(i64::MAX, mask.cell); 4];
            for i in frame.region_cells(index) {
                let cell = &frame.cells[i];
                let (dx, dy) = cell.region.offset_from(own);
                if cell.marks.is_masked() || dx.abs().max(dy.abs()) * 10 > reach_tenths {
                    continue;
                }
                let distance_squared = i64::from(dx) * i64::from(dx) + i64::from(dy) * i64::from(dy);
                let rank = nearest.iter().position(|&(other_squared, _)| distance_squared < other_squared);
                if let Some(rank) = rank {
                    nearest[rank..].rotate_right(1);
                    nearest[rank] = (distance_squared, i as u16);
                }
            }
            mask.neighbours = nearest.map(|(_, cell)| cell);
        }
    }
}

//! Steps and load bouts: their evaluation, and the numbers of all records.

use super::Insole;
use crate::num::Real;
use crate::pipeline::bout::BoutRecord;
use crate::pipeline::cell::area_moments_at_peak;
use crate::pipeline::measures::{FootMeasures, RegionMeasures};
use crate::pipeline::region::AreaMoments;
use crate::pipeline::step::{RegionStep, StepRecord};

impl<R: Real, const N: usize> Insole<R, N> {
    /// Sets the number of the next record. Steps, load bouts and alerts are numbered together.
    pub fn set_next_record_number(&mut self, next: u32) {
        self.next_record = next;
    }

    /// The curves of a region in the stance that ended with the last frame: contact area (mm2), measured force (N), and the time
    /// between samples (s).
    ///
    /// # Panics
    /// If `region` is not an index of [`crate::Region::ALL`].
    pub fn curves(&self, region: usize) -> (&[R], &[R], R) {
        let curves = self.stance.curves();
        (curves.area_mm2(region), curves.force_n(region), self.sample_s())
    }

    /// Time between samples of the curves, s.
    fn sample_s(&self) -> R {
        R::of_u32(self.stance.curves().stride()) / self.frame_rate_hz
    }

    /// Evaluates a region of the stance that ended with the last frame. This takes up to 256 evaluations of the model, so a
    /// device should let other tasks run between two regions.
    ///
    /// # Panics
    /// If `region` is not an index of [`crate::Region::ALL`].
    pub fn step_region(&self, region: usize) -> RegionStep<R> {
        let (area_mm2, force_n, sample_s) = self.curves(region);
        let at_peak = match self.stance.region_peak_n(region) > R::ZERO {
            true => area_moments_at_peak(&self.cells[self.division.cells(region)]),
            false => AreaMoments::NONE,
        };
        let step = RegionStep::new(&self.force_laws[region], area_mm2, force_n, sample_s, &at_peak);
        let mut step = RegionStep {
            ellipse_at_peak: step.ellipse_at_peak.map(|ellipse| self.to_foot_coordinates(region, ellipse)),
            counted_peak_mm2: match self.setup.contact.full_kpa > 0.0 {
                true => self.loads[region].frame.counted_peak_mm2(),
                false => step.area_peak_mm2,
            },
            masked_cells: self.faults().masked_cells[region],
            measures: RegionMeasures {
                residual_n: self.residuals[region].force.force_n,
                ..RegionMeasures::new(self.stance.curves(), region, sample_s)
            },
            ..step
        };
        // The largest force may be in a frame that is not a sample of the curves.
        if let Some(between) = self.stance.curves().between(region) {
            step.include(between.force_n, R::of_u32(between.force_frame.into()) / self.frame_rate_hz);
        }
        step
    }

    /// Assembles the step of the stance that ended with the last frame from its eight regions, and increments the record
    /// number. If the parameters are tracked, they are adapted to the step, and used from the next frame on. `None` before
    /// [`Insole::set_up`].
    pub fn step(&mut self, mut regions: [RegionStep<R>; 8]) -> Option<StepRecord<R>> {
        let setup = *self.setup()?;
        for (i, (region, law)) in regions.iter_mut().zip(&mut self.force_laws).enumerate() {
            let is_reliable = region.has_valid_area() && self.stance.saturated() >> i & 1 == 0;
            region.stiffness_change = self.tracker.adapt(i, law, region, is_reliable);
        }
        let step = self.next_record;
        self.next_record = self.next_record.wrapping_add(1);
        self.cumulative.totals.steps = self.cumulative.totals.steps.saturating_add(1);
        Some(StepRecord {
            side: setup.side,
            step,
            start_us: self.time_us(self.stance.start_seq()),
            duration_us: self.stance.frames() * setup.period_us,
            sample_us: self.stance.curves().stride() * setup.period_us,
            bridged_frames: self.stance.bridged().min(u32::from(u16::MAX)) as u16,
            saturated: self.stance.saturated(),
            contact_rule: setup.contact,
            foot: FootMeasures::new(self.stance.curves(), self.sample_s(), &self.extent),
            regions,
        })
    }

    /// The load bout that was completed by the last frame, if there is one: the load of a time that was not part of a step. It is
    /// returned once.
    pub fn take_bout(&mut self) -> Option<BoutRecord<R>> {
        let bout = self.stance.take_bout(self.setup.side, self.next_record)?;
        self.next_record = self.next_record.wrapping_add(1);
        Some(BoutRecord { start_us: self.unwrapped_us(bout.start_us), ..bout })
    }

    /// Confirms toe off at the end of a recording, if the foot was off the ground in the last frame. True if this completes a
    /// step, which [`Insole::step_region`] and [`Insole::step`] then return.
    pub fn end_stance(&mut self) -> bool {
        self.stance.end_stance(&self.limits)
    }

    /// Completes and returns the load bout in progress, at the end of a recording. To be called until it returns `None`.
    pub fn end_bout(&mut self) -> Option<BoutRecord<R>> {
        self.stance.end_bout();
        self.take_bout()
    }

    /// Evaluates all regions and assembles the step, as [`Insole::step_region`] and [`Insole::step`] do.
    pub fn whole_step(&mut self) -> Option<StepRecord<R>> {
        let regions = core::array::from_fn(|region| self.step_region(region));
        self.step(regions)
    }
}

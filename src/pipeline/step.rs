//! A finished stance to a step: the paper's per-step pipeline on the area curves, and the model scored against the cells.

use super::contact::ContactRule;
use super::ellipse::Ellipse;
use super::model::ForceLaw;
use super::region::{AreaMoments, Side};
use super::smooth;
use super::stance::STANCE_SAMPLES;
use crate::num::Real;

/// One region's part in a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegionStep<R> {
    /// Largest force that the cells measured in a sample of the curve (every frame up to 256 of them, see
    /// [`StepRecord::sample_us`]), N.
    pub measured_peak_n: R,
    /// Largest model force, N.
    pub model_peak_n: R,
    /// Force-time integral of the measured force, N s.
    pub measured_integral_n_s: R,
    /// Force-time integral of the model force, N s.
    pub model_integral_n_s: R,
    /// Largest contact area in a sample of the curve, unsmoothed, mm2.
    pub area_peak_mm2: R,
    /// Largest tissue deformation of the model, m.
    pub deformation_peak_m: R,
    /// Largest loading rate of the deformation, m/s.
    pub deformation_rate_peak_m_s: R,
    /// From the region's first to its last frame in contact, s.
    pub contact_s: R,
    /// From its first frame in contact to its largest measured force, s.
    pub time_to_peak_s: R,
    /// Contact ellipse in the frame of the largest measured force, foot coordinates; `None` without contact then.
    pub ellipse_at_peak: Option<Ellipse<R>>,
    /// Root mean square of model minus measured (unsmoothed) force over the contact, over the largest measured force
    /// (Eq. 20); 0.1 is 10 %.
    pub model_error: R,
    /// The smoothed area exceeded pi A B somewhere: deformation and model force are cut there.
    pub clamped: bool,
    /// Cells that were masked at toe off; 255 for more.
    pub masked_cells: u8,
}

/// A step with the rule that its areas were counted by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepRecord<R> {
    /// The foot.
    pub side: Side,
    /// Counts steps from 0 since start.
    pub step: u32,
    /// Time of the first loaded frame since the first scan, us.
    pub start_us: u64,
    /// Heel strike to toe off, us.
    pub duration_us: u32,
    /// Time between samples of the curves, us.
    pub sample_us: u32,
    /// Frames that were missing and bridged.
    pub bridged_frames: u16,
    /// Bit i: a cell of region i was saturated: its forces are lower bounds.
    pub saturated: u8,
    /// The rule that areas were counted by.
    pub contact_rule: ContactRule,
    /// The regions, in the order of [`crate::Region::ALL`].
    pub regions: [RegionStep<R>; 8],
}

impl<R: Real> RegionStep<R> {
    /// The paper's pipeline on one region: `area_mm2` and `force_n` are the stance's curves of equal length (at most
    /// [`STANCE_SAMPLES`]) with `sample_s` between samples; `at_peak` are the moments in foot coordinates.
    ///
    /// Area: three-point mean, polynomial of 5th order over the contact phase, cut at 0; deformation by Eq. 14, its rate by
    /// Eq. 16, force by Eq. 13 cut at 0.
    pub fn new(law: &ForceLaw<R>, area_mm2: &[R], force_n: &[R], sample_s: R, at_peak: &AreaMoments) -> Self {
        let in_contact = |&area: &R| area > R::ZERO;
        let (Some(first), Some(last)) = (area_mm2.iter().position(in_contact), area_mm2.iter().rposition(in_contact))
        else {
            return Self::default();
        };
        let (raw_area_mm2, measured_n) = (&area_mm2[first..=last], &force_n[first..=last]);

        let mut scratch = [R::ZERO; STANCE_SAMPLES];
        let g = &mut scratch[..raw_area_mm2.len()];
        g.copy_from_slice(raw_area_mm2);
        smooth::moving_average(g);
        smooth::polynomial(g);
        let mut step = Self { clamped: false, ..Self::default() };
        for area in g.iter_mut() {
            let ratio = law.area_ratio(*area * R::of(1e-6));
            step.clamped |= ratio.clamped;
            *area = ratio.normalised_deformation();
        }

        let per_sample = R::ONE / sample_s;
        let (mut squares, mut peak_at) = (R::ZERO, 0u32);
        let mut rate_per_s = R::ZERO;
        for (i, (&g_here, &measured)) in g.iter().zip(measured_n).enumerate() {
            // Eq. 16 looks forward; the last sample keeps the rate before it.
            if let Some(&next) = g.get(i + 1) {
                rate_per_s = (next - g_here) * per_sample;
            }
            let model = law.force_n(g_here, rate_per_s);
            step.model_peak_n = step.model_peak_n.max(model);
            step.model_integral_n_s += model;
            step.measured_integral_n_s += measured;
            if measured > step.measured_peak_n {
                step.measured_peak_n = measured;
                peak_at = i as u32;
            }
            step.area_peak_mm2 = step.area_peak_mm2.max(raw_area_mm2[i]);
            step.deformation_peak_m = step.deformation_peak_m.max(law.c_m * g_here);
            step.deformation_rate_peak_m_s = step.deformation_rate_peak_m_s.max(law.c_m * rate_per_s);
            squares += (model - measured) * (model - measured);
        }
        step.model_integral_n_s = step.model_integral_n_s * sample_s;
        step.measured_integral_n_s = step.measured_integral_n_s * sample_s;
        let samples = R::of_u32(g.len() as u32);
        step.contact_s = samples * sample_s;
        step.time_to_peak_s = R::of_u32(peak_at) * sample_s;
        if step.measured_peak_n > R::ZERO {
            step.model_error = (squares / samples).sqrt() / step.measured_peak_n;
        }
        step.ellipse_at_peak = Ellipse::from_moments(at_peak);
        step
    }
}

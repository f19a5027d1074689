//! Step evaluation: after a stance, smooths the area curves as in the paper, evaluates the model, and compares it with the
//! measured force.

use super::contact::ContactRule;
use super::ellipse::Ellipse;
use super::model::ForceLaw;
use super::region::{AreaMoments, Side};
use super::smooth;
use super::stance::STANCE_SAMPLES;
use crate::num::Real;

/// One region in a step.
///
/// ```
/// use plantar::pipeline::model::ForceLaw;
/// use plantar::pipeline::region::AreaMoments;
/// use plantar::pipeline::step::RegionStep;
///
/// // 200 N on 400 mm2 for 50 samples at 100 Hz, without parameters of the tissue.
/// let step = RegionStep::<f64>::new(&ForceLaw::NONE, &[400.0; 50], &[200.0; 50], 0.01, &AreaMoments::NONE);
/// assert_eq!((step.measured_peak_n, step.area_peak_mm2, step.contact_s), (200.0, 400.0, 0.5));
/// assert!((step.measured_integral_n_s - 100.0).abs() < 1e-9);
/// // The model force is 0, so the error (Eq. 20) is 100 %.
/// assert_eq!((step.model_peak_n, step.model_error), (0.0, 1.0));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegionStep<R> {
    /// Largest measured force in the samples of the curve, N. A sample is a frame in stances of up to 256 frames; see
    /// [`StepRecord::sample_us`].
    pub measured_peak_n: R,
    /// Largest model force, N.
    pub model_peak_n: R,
    /// Force-time integral of the measured force, N s.
    pub measured_integral_n_s: R,
    /// Force-time integral of the model force, N s.
    pub model_integral_n_s: R,
    /// Largest contact area in the samples of the curve, not smoothed, mm2.
    pub area_peak_mm2: R,
    /// Largest tissue deformation of the model, m.
    pub deformation_peak_m: R,
    /// Largest deformation rate of the model, m/s.
    pub deformation_rate_peak_m_s: R,
    /// Time from the first to the last sample of the region in contact, s.
    pub contact_s: R,
    /// Time from the first sample in contact to the largest measured force, s.
    pub time_to_peak_s: R,
    /// Contact ellipse in the sample of the largest measured force; `None` without contact. [`RegionStep::new`] returns its centre
    /// relative to the reference point of the region; [`Insole::step_region`](crate::insole::Insole::step_region) returns it in
    /// foot coordinates.
    pub ellipse_at_peak: Option<Ellipse<R>>,
    /// NRMSE (Eq. 20): root mean square of model minus measured force over the contact, divided by the largest measured force.
    /// The measured force is not smoothed. 0.1 is 10 %.
    pub model_error: R,
    /// The smoothed area exceeded pi A B in some samples, in which deformation and model force are lower bounds.
    pub clamped: bool,
    /// Number of cells that were masked at toe off, at most 255.
    pub masked_cells: u8,
}

/// A step, with the contact rule of its areas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepRecord<R> {
    /// The foot.
    pub side: Side,
    /// Number of the step; see [`Insole::count_steps_from`](crate::insole::Insole::count_steps_from).
    pub step: u32,
    /// Time of heel strike, us: the number of the frame of heel strike times the time between frames.
    pub start_us: u64,
    /// Stance time, from heel strike to toe off, us.
    pub duration_us: u32,
    /// Time between samples of the curves, us.
    pub sample_us: u32,
    /// Number of frames that were missing and bridged.
    pub bridged_frames: u16,
    /// Bit i: a cell of region i was saturated, so that its forces are lower bounds.
    pub saturated: u8,
    /// The contact rule.
    pub contact_rule: ContactRule,
    /// The regions, in the order of [`crate::Region::ALL`].
    pub regions: [RegionStep<R>; 8],
}

impl<R: Real> RegionStep<R> {
    /// Evaluates a region. `area_mm2` and `force_n` are the curves of the stance. They have the same number of samples, at most
    /// [`STANCE_SAMPLES`], and the time `sample_s` between samples. `at_peak` are the area moments at the largest measured force,
    /// about the reference point of the region; so the centre of [`RegionStep::ellipse_at_peak`] is relative to this point.
    ///
    /// The area is smoothed over the contact phase by a three-point mean and a polynomial of 5th order. The deformation follows
    /// from Eq. 14, its rate from Eq. 16, and the force from Eq. 13. Negative areas and forces are replaced by 0.
    ///
    /// # Panics
    /// If `force_n` is shorter than the contact, or a curve is longer than [`STANCE_SAMPLES`].
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
            // Eq. 16 is a forward difference; the last sample has the rate of the previous one.
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

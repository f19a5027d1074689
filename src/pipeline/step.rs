//! Step evaluation: after a stance, evaluates the model on the area curves, and compares it with the measured force.
//!
//! Equation numbers are those of the paper that [`super::model`] implements.
//!
//! The area is not smoothed. The paper smooths it by a polynomial over the whole contact, which flattens a fast heel strike: the
//! force is then predicted less accurately, with counted cells and with covered shares (docs/identification.md). The deformation
//! rate is the difference over about 20 ms instead of that of Eq. 16 over one sample, because jumps of the area by single cells
//! would dominate the latter.

use super::contact::ContactRule;
use super::curves::{STANCE_SAMPLES, whole_samples};
use super::ellipse::Ellipse;
use super::measures::{FootMeasures, RegionMeasures};
use super::model::ForceLaw;
use super::region::{AreaMoments, Side};
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
    /// Largest measured force from the first to the last sample in contact, N. In a long stance this includes the frames
    /// between the samples, of which [`RegionStep::new`] does not know.
    pub measured_peak_n: R,
    /// Largest model force, N.
    pub model_peak_n: R,
    /// Force-time integral of the measured force, N s.
    pub measured_integral_n_s: R,
    /// Force-time integral of the model force, N s.
    pub model_integral_n_s: R,
    /// Largest contact area in the samples of the curve, not smoothed, mm2.
    pub area_peak_mm2: R,
    /// Largest contact area in the frames of the step if every cell in contact counts with its whole area, mm2.
    /// [`RegionStep::new`] returns 0.
    pub counted_peak_mm2: R,
    /// Largest tissue deformation of the model, m.
    pub deformation_peak_m: R,
    /// Largest deformation rate of the model, m/s.
    pub deformation_rate_peak_m_s: R,
    /// Number of samples from the first to the last in contact, times the time between samples, s.
    pub contact_s: R,
    /// Time from the first sample in contact to the largest measured force, s.
    pub time_to_peak_s: R,
    /// Contact ellipse in the frame of the largest measured force; `None` without contact. [`RegionStep::new`] returns its
    /// centre relative to the reference point of the region; [`Insole::step_region`](crate::insole::Insole::step_region) returns
    /// it in foot coordinates.
    pub ellipse_at_peak: Option<Ellipse<R>>,
    /// NRMSE (Eq. 20): root mean square of model minus measured force over the contact, divided by the largest measured force.
    /// The measured force is not smoothed. 0.1 is 10 %.
    pub model_error: R,
    /// The area exceeded pi A B in some samples, in which the deformation was limited to C: it is a lower bound, and the model
    /// force is that at this limit.
    pub clamped: bool,
    /// Number of cells that were masked at toe off, at most 255.
    pub masked_cells: u8,
    /// Relative change of the stiffness K since the identification; 0 without tracking ([`super::track`]). [`RegionStep::new`]
    /// returns 0.
    pub stiffness_change: R,
    /// The standard measures. [`RegionStep::new`] returns zeros.
    pub measures: RegionMeasures<R>,
    /// The sums by which the force law is adapted.
    pub(crate) sums: StepSums<R>,
}

impl<R: Real> RegionStep<R> {
    /// True if no cell is masked and no area is beyond the ellipsoid. The caller also checks for saturated cells, of which a
    /// region has no record.
    pub(crate) fn has_valid_area(&self) -> bool {
        self.masked_cells == 0 && !self.clamped
    }
}

/// Largest number of samples of a curve that contribute to [`StepSums`]. Neighbouring samples differ little, and the number of
/// instructions is proportional to the number of samples.
const SUMMED: usize = 8;
/// The minimal detectable change of the tracked K, 1.96 sqrt(2) SEM, in the order of [`crate::Region::ALL`], relative to K. It
/// was computed by `cargo run --release -p bench --bin typical` for the ten barefoot walkers of docs/identification.md: K was
/// identified from one half of a session and tracked through the other half.
pub const STIFFNESS_MDC: [f64; 8] = [0.12, 0.07, 0.10, 0.16, 0.07, 0.22, 0.17, 0.14];
/// Change of K beyond which the wearer's parameters should be identified again, relative to [`STIFFNESS_MDC`]. With this limit,
/// one in twenty steps of an unchanged wearer exceeds the limit in at least one of its eight regions by chance (Sidak's
/// correction, 2.73 instead of 1.96 standard deviations).
pub const REFIT_PER_MDC: f64 = 1.4;

/// The sums of one step over the samples of a region: products of the elastic force e, the viscous force v and the measured force
/// f.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepSums<R> {
    pub(super) ee: R,
    pub(super) ev: R,
    pub(super) vv: R,
    pub(super) ef: R,
    pub(super) vf: R,
}

impl<R: Real> StepSums<R> {
    /// No samples.
    pub(super) const NONE: Self = Self { ee: R::ZERO, ev: R::ZERO, vv: R::ZERO, ef: R::ZERO, vf: R::ZERO };

    /// Adds a sample with these forces, N.
    fn add(&mut self, elastic: R, viscous: R, measured: R) {
        self.ee += elastic * elastic;
        self.ev += elastic * viscous;
        self.vv += viscous * viscous;
        self.ef += elastic * measured;
        self.vf += viscous * measured;
    }
}

/// A step, with the contact rule of its areas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepRecord<R> {
    /// The foot.
    pub side: Side,
    /// Number of the step; steps, load bouts and alerts are numbered together; see
    /// [`Insole::set_next_record_number`](crate::insole::Insole::set_next_record_number).
    pub step: u32,
    /// Time of heel strike, us: the number of the frame of heel strike times the time between frames.
    pub start_us: u64,
    /// Stance time, from heel strike to toe off, us.
    pub duration_us: u32,
    /// Time between samples of the curves, us: that between frames, or a multiple of it if more than [`STANCE_SAMPLES`] frames
    /// passed until toe off was confirmed.
    pub sample_us: u32,
    /// Number of frames that were missing and bridged.
    pub bridged_frames: u16,
    /// Bit i: a cell of region i was saturated, so that its forces are lower bounds.
    pub saturated: u8,
    /// The contact rule.
    pub contact_rule: ContactRule,
    /// The measures of the foot.
    pub foot: FootMeasures<R>,
    /// The regions, in the order of [`crate::Region::ALL`].
    pub regions: [RegionStep<R>; 8],
}

impl<R: Real> StepRecord<R> {
    /// Bit i: K of region i has changed by so much since the identification that the wearer's parameters should be identified
    /// again.
    pub fn refit(&self) -> u8 {
        let is_due = |(i, limit): (usize, f64)| {
            let change = self.regions[i].stiffness_change;
            u8::from(change.max(-change) > R::of(REFIT_PER_MDC * limit)) << i
        };
        STIFFNESS_MDC.into_iter().enumerate().map(is_due).sum()
    }
}

impl<R: Real> RegionStep<R> {
    /// Evaluates a region. `area_mm2` and `force_n` are the curves of the stance. They have the same number of samples, at most
    /// [`STANCE_SAMPLES`], and the time `sample_s` between samples. `at_peak` are the area moments at the largest measured force,
    /// about the reference point of the region; so the centre of [`RegionStep::ellipse_at_peak`] is relative to this point.
    ///
    /// The deformation follows from Eq. 14, its rate from the difference between the samples that [`rate_samples`] returns, and
    /// the force from Eq. 13. A tensile force is replaced by 0.
    ///
    /// # Panics
    /// If the contact continues after the end of `force_n`, or has more than [`STANCE_SAMPLES`] samples.
    pub fn new(law: &ForceLaw<R>, area_mm2: &[R], force_n: &[R], sample_s: R, at_peak: &AreaMoments) -> Self {
        let in_contact = |&area: &R| area > R::ZERO;
        // The force of cells that are not in contact counts, too, so that the integrals of all regions add up to that of the
        // foot.
        let measured_integral_n_s = force_n.iter().copied().sum::<R>() * sample_s;
        let (Some(first), Some(last)) = (area_mm2.iter().position(in_contact), area_mm2.iter().rposition(in_contact))
        else {
            return Self { measured_integral_n_s, ..Self::default() };
        };
        let (raw_area_mm2, measured_n) = (&area_mm2[first..=last], &force_n[first..=last]);

        // The normalised deformation, deformation over C, of each sample.
        let mut scratch = [R::ZERO; STANCE_SAMPLES];
        let g = &mut scratch[..raw_area_mm2.len()];
        let mut step = Self { clamped: false, measured_integral_n_s, ..Self::default() };
        for (g, &area_mm2) in g.iter_mut().zip(raw_area_mm2) {
            let ratio = law.area_ratio(area_mm2 * R::of(1e-6));
            step.clamped |= ratio.clamped;
            *g = ratio.normalised_deformation();
        }

        let (span, section_m2) = (rate_span(sample_s), law.section_m2());
        let stride = g.len().div_ceil(SUMMED);
        let (mut squares, mut peak_at) = (R::ZERO, 0u32);
        for (i, (&g_here, &measured)) in g.iter().zip(measured_n).enumerate() {
            let (earlier, later) = rate_samples(i, g.len(), span);
            let rate_per_s = match later - earlier {
                0 => R::ZERO,
                samples => (g[later] - g[earlier]) / (R::of_u32(samples as u32) * sample_s),
            };
            let (elastic_pa, viscous_pa) = law.terms_pa(g_here, rate_per_s);
            let model = (section_m2 * (elastic_pa + viscous_pa)).max(R::ZERO);
            if i % stride == 0 && model > R::ZERO {
                step.sums.add(section_m2 * elastic_pa, section_m2 * viscous_pa, measured);
            }
            step.model_peak_n = step.model_peak_n.max(model);
            step.model_integral_n_s += model;
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
        let samples = R::of_u32(g.len() as u32);
        step.contact_s = samples * sample_s;
        step.time_to_peak_s = R::of_u32(peak_at) * sample_s;
        if step.measured_peak_n > R::ZERO {
            step.model_error = (squares / samples).sqrt() / step.measured_peak_n;
        }
        step.ellipse_at_peak = Ellipse::from_moments(at_peak);
        step
    }

    /// Takes the largest force of the frames between the samples into account, N, and its time from heel strike, s.
    #[cold]
    pub(crate) fn include(&mut self, force_n: R, t_s: R) {
        if self.measured_peak_n > R::ZERO && force_n > self.measured_peak_n {
            self.model_error = self.model_error * self.measured_peak_n / force_n;
            self.measured_peak_n = force_n;
            self.time_to_peak_s = (t_s - self.measures.contact_start_s).max(R::ZERO);
        }
    }
}

/// Half of the time between the two samples from which the deformation rate is computed, us.
const RATE_HALF_US: u32 = 10_000;

/// The deformation rate of a sample is computed from the samples that are this number of samples before and after it: 10 ms, and
/// at least one sample. `sample_s` is the time between samples, s.
pub fn rate_span<R: Real>(sample_s: R) -> usize {
    whole_samples(RATE_HALF_US, sample_s).max(1)
}

/// Indices of the earlier and the later sample from which the deformation rate of sample `i` is computed, in a contact of
/// `samples` samples. `span` is the result of [`rate_span`]; the span is shorter at both ends of the contact.
pub fn rate_samples(i: usize, samples: usize, span: usize) -> (usize, usize) {
    (i.saturating_sub(span), (i + span).min(samples.saturating_sub(1)))
}

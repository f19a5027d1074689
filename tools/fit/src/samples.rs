//! The data of a fit: the contact phases of one region. The area is filtered as on the device, or as in the paper; the force is
//! not filtered, except for the paper's search.

use crate::smooth;
use crate::{Filter, RegionCurves};
use plantar::pipeline::model::ForceLaw;
use plantar::pipeline::step::{rate_samples, rate_span};
use std::ops::Range;

/// Placeholder for the index of the unloaded tissue, which is known once all steps are added.
const UNLOADED: u32 = u32::MAX;

/// The samples of one region over the contact phases of some steps. Residuals of the force are weighted, so that all steps
/// count equally: the sum of the squared residuals is the sum of the squared NRMSE (Eq. 20) of the steps.
#[derive(Clone, Debug)]
pub struct Samples {
    /// The larger of the largest filtered and the largest unfiltered area, m2. pi A B is at least this area.
    pub area_max_m2: f64,
    /// Filtered area divided by [`Samples::area_max_m2`], 0 to 1. There is one value more than in `force_n`: the last value is 0
    /// and stands for the unloaded tissue before contact.
    pub(crate) share: Vec<f64>,
    /// For each sample, the indices in `share` of the later and the earlier value from which its deformation rate is computed.
    pub(crate) difference: Vec<(u32, u32)>,
    /// The reciprocal of the time between these two values, 1/s.
    pub(crate) per_s: Vec<f64>,
    /// Measured force, N.
    pub force_n: Vec<f64>,
    /// Weight of the residual of a sample, 1/N: 1 / (peak force of the step, N, times the square root of its number of
    /// samples). For one step, the weighted sum of squares is Eq. 18 up to a constant factor.
    /// A step that counts several times has the square root of this number as a factor ([`Samples::repeated`]).
    pub(crate) weight: Vec<f64>,
    /// Measured force times weight; without a unit.
    pub(crate) target: Vec<f64>,
    /// Unfiltered area, m2.
    pub raw_area_m2: Vec<f64>,
    /// The range of samples of each step.
    pub steps: Vec<Range<usize>>,
}

impl Samples {
    /// The samples of the `curves` of one region, with the area filtered by `filter`. Steps without contact add no samples.
    pub fn new<'c>(curves: impl IntoIterator<Item = &'c RegionCurves>, filter: Filter) -> Self {
        Self::repeated(curves.into_iter().map(|curve| (curve, 1)), filter)
    }

    /// As [`Samples::new`], with the number of times that each step counts. A step that counts more than once has the samples of
    /// one step with the square root of this number as a factor of their weight, so that the sum of squares is that of its
    /// repetitions.
    pub(crate) fn repeated<'c>(curves: impl IntoIterator<Item = (&'c RegionCurves, u32)>, filter: Filter) -> Self {
        let mut samples = Self {
            area_max_m2: 0.0,
            share: Vec::new(),
            difference: Vec::new(),
            per_s: Vec::new(),
            force_n: Vec::new(),
            weight: Vec::new(),
            target: Vec::new(),
            raw_area_m2: Vec::new(),
            steps: Vec::new(),
        };
        for (curve, count) in curves {
            samples.push(curve, count, filter);
        }
        let areas = samples.share.iter().chain(&samples.raw_area_m2);
        samples.area_max_m2 = areas.fold(0.0, |most, &area| area.max(most));
        if samples.area_max_m2 > 0.0 {
            for share in &mut samples.share {
                *share /= samples.area_max_m2;
            }
        }
        samples.share.push(0.0);
        let unloaded = samples.force_n.len() as u32;
        for (_, earlier) in &mut samples.difference {
            if *earlier == UNLOADED {
                *earlier = unloaded;
            }
        }
        samples
    }

    /// Adds the contact phase of one step. Until all steps are added, `share` is in m2 and [`UNLOADED`] stands for the index of
    /// the unloaded tissue. The step counts `times` times.
    fn push(&mut self, curve: &RegionCurves, times: u32, filter: Filter) {
        let loaded = |&area: &f64| area > 0.0;
        let (area_mm2, force_n, sample_s) = curve.of(filter);
        let (Some(first), Some(last)) = (area_mm2.iter().position(loaded), area_mm2.iter().rposition(loaded)) else {
            return;
        };
        let start = self.force_n.len();
        let end = start + last + 1 - first;
        let mut filtered = area_mm2[first..=last].to_vec();
        let count = end - start;
        match filter {
            Filter::Direct => {
                let span = rate_span(sample_s);
                for i in 0..count {
                    let (earlier, later) = rate_samples(i, count, span);
                    self.difference.push(((start + later) as u32, (start + earlier) as u32));
                    self.per_s.push(1.0 / ((later - earlier).max(1) as f64 * sample_s));
                }
            }
            Filter::Smoothed => {
                smooth::moving_average(&mut filtered);
                smooth::polynomial(&mut filtered);
                // As in Eq. 16, the rate of a sample is the difference to the next sample. The last sample has no next sample;
                // its rate is that of the sample before.
                let forward = (start..end).map(|i| if i + 1 < end { (i + 1, i) } else { (i, i.max(start + 1) - 1) });
                self.difference.extend(forward.map(|(later, earlier)| (later as u32, earlier as u32)));
                self.per_s.extend(std::iter::repeat_n(1.0 / sample_s, count));
            }
            Filter::Live => {
                for (i, area) in filtered.iter_mut().enumerate() {
                    let at = |back: usize| (first + i).checked_sub(back).map_or(0.0, |i| area_mm2[i]);
                    *area = (at(2) + at(1) + at(0)) / 3.0;
                }
                // In the live stream, the rate of a sample is the difference to the sample before. Before the first sample, the
                // region was unloaded.
                let backward = (start..end).map(|i| (i as u32, if i > start { (i - 1) as u32 } else { UNLOADED }));
                self.difference.extend(backward);
                self.per_s.extend(std::iter::repeat_n(1.0 / sample_s, count));
            }
        }
        self.share.extend(filtered.iter().map(|area| area.max(0.0) * 1e-6));
        self.raw_area_m2.extend(area_mm2[first..=last].iter().map(|area| area * 1e-6));
        self.force_n.extend(&force_n[first..=last]);
        let peak_n = force_n[first..=last].iter().copied().fold(0.0, f64::max);
        let weight = if peak_n > 0.0 { f64::from(times).sqrt() / (peak_n * (count as f64).sqrt()) } else { 0.0 };
        self.target.extend(force_n[first..=last].iter().map(|force| force * weight));
        self.weight.extend(std::iter::repeat_n(weight, count));
        self.steps.push(start..end);
    }

    /// The same samples with the target of the paper: the force of each step, smoothed by a polynomial of 5th order.
    #[cfg(feature = "paper")]
    pub fn with_smoothed_force(mut self) -> Self {
        for step in &self.steps {
            smooth::polynomial(&mut self.force_n[step.clone()]);
        }
        self.target = self.force_n.iter().zip(&self.weight).map(|(force, weight)| force * weight).collect();
        self
    }

    /// Number of samples of force.
    pub fn len(&self) -> usize {
        self.force_n.len()
    }

    /// True if there are no samples.
    pub fn is_empty(&self) -> bool {
        self.force_n.is_empty()
    }

    /// Normalised deformation g and its rate (1/s) of each sample, by the formulas of the device.
    pub(crate) fn deformation(&self, law: &ForceLaw<f64>) -> impl Iterator<Item = (f64, f64)> {
        let g: Vec<f64> =
            self.share.iter().map(|s| law.area_ratio(s * self.area_max_m2).normalised_deformation()).collect();
        (0..self.len()).map(move |i| {
            let (later, earlier) = self.difference[i];
            (g[i], (g[later as usize] - g[earlier as usize]) * self.per_s[i])
        })
    }

    /// One row for each sample: the filtered area (m2), the indices of the later and the earlier sample from which its rate is
    /// computed, the reciprocal of the time between these two samples (1/s), and the measured force (N). An index beyond the last
    /// sample denotes the unloaded tissue before contact.
    pub fn table(&self) -> impl Iterator<Item = [f64; 5]> {
        (0..self.len()).map(|i| {
            let (later, earlier) = self.difference[i];
            let area_m2 = self.share[i] * self.area_max_m2;
            [area_m2, f64::from(later), f64::from(earlier), self.per_s[i], self.force_n[i]]
        })
    }

    /// Correlation between neighbouring residuals of a step. `residuals` contains one residual for each sample.
    pub(crate) fn autocorrelation(&self, residuals: &[f64]) -> f64 {
        let (mut products, mut squares) = (0.0, 0.0);
        for step in &self.steps {
            let residuals = &residuals[step.clone()];
            products += residuals.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>();
            squares += residuals.iter().map(|r| r * r).sum::<f64>();
        }
        if squares > 0.0 { products / squares } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bounded::Residuals;
    use crate::identify::NonNegativeForce;
    use crate::synthetic::{Noise, curves};

    #[test]
    fn a_step_that_counts_three_times_has_the_sum_of_squares_of_three_equal_steps() {
        let mut noise = Noise::new(1);
        let [a, b] = [0.9, 1.0].map(|size| curves(0, 100.0, Filter::Direct, size, 0.05, &mut noise));
        let squares = |samples: &Samples| {
            let mut law = NonNegativeForce::new(samples);
            law.set(&[0.7, 1.0, 0.5, 4e5, 1e4]);
            let slopes: Vec<f64> = (0..5).map(|i| law.derivative(i).dot(&law.residuals())).collect();
            (law.residuals().norm_squared(), slopes)
        };
        let (all, all_slopes) = squares(&Samples::new([&a, &b, &a, &a], Filter::Direct));
        let (few, few_slopes) = squares(&Samples::repeated([(&a, 3), (&b, 1)], Filter::Direct));
        assert!(all > 0.0 && (few / all - 1.0).abs() < 1e-12, "{few} {all}");
        assert!(few_slopes.iter().zip(&all_slopes).all(|(few, all)| (few / all - 1.0).abs() < 1e-9), "{few_slopes:?}");
    }
}

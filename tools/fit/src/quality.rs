//! The errors of identified parameters. The force is computed as on the device.

use crate::{Filter, RegionCurves, Samples, smooth};
use plantar::pipeline::model::ForceLaw;

/// An area of at least this fraction of the largest area in the step counts as the largest area.
const AT_LARGEST: f64 = 0.97;
/// A force that is below the peak force by more than this fraction of the peak force counts as well below the peak.
const BELOW_PEAK: f64 = 0.35;

/// The errors of the model force of a region with its parameters. Each error is the mean over the steps. NRMSE (Eq. 20) is a
/// fraction: 0.1 is 10 %.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// NRMSE of the steps with the parameters that were fitted to all steps, against the measured force.
    pub fitted: f64,
    /// As `fitted`, but against the measured force smoothed by the paper's polynomial of 5th order.
    pub fitted_smoothed: f64,
    /// NRMSE of each step with parameters that were fitted to it alone, against the measured force; of 200 evenly spaced steps if
    /// there are more. A prior draws these parameters strongly, because one step contains little, so `own` can exceed
    /// `predicted`.
    pub own: f64,
    /// As `own`, but against the smoothed force.
    pub own_smoothed: f64,
    /// NRMSE of each step with parameters that were fitted to other steps ([`crate::RegionFit::predicted_nrmse`]), against the
    /// measured force. `None` for a single step.
    pub predicted: Option<f64>,
    /// NRMSE of the non-decreasing function of area that fits the force of each step best. No force law without damping has a
    /// smaller error; a law with damping may have one.
    pub floor: f64,
    /// Largest model force divided by largest measured force, minus 1.
    pub peak_bias: f64,
    /// Fraction of the contact time in which the area is at its largest although the force is well below its peak.
    pub saturated: f64,
}

impl Quality {
    /// Computes the errors. `fitted` contains the steps evaluated with the parameters that were fitted to all steps, and `own`
    /// the steps evaluated with parameters that were fitted to each step alone. `predicted` contains the NRMSE of each step with
    /// parameters that were fitted to the other steps.
    pub(crate) fn new(fitted: &[Evaluated], own: &[Evaluated], predicted: &[f64]) -> Self {
        let mean = |error: fn(&Evaluated) -> f64, steps: &[Evaluated]| {
            steps.iter().map(error).sum::<f64>() / steps.len() as f64
        };
        Self {
            fitted: mean(Evaluated::nrmse, fitted),
            fitted_smoothed: mean(Evaluated::nrmse_smoothed, fitted),
            own: mean(Evaluated::nrmse, own),
            own_smoothed: mean(Evaluated::nrmse_smoothed, own),
            predicted: (!predicted.is_empty()).then(|| predicted.iter().sum::<f64>() / predicted.len() as f64),
            floor: mean(Evaluated::floor, fitted),
            peak_bias: mean(Evaluated::peak_bias, fitted),
            saturated: saturated(fitted),
        }
    }
}

/// See [`Quality::saturated`].
fn saturated(steps: &[Evaluated]) -> f64 {
    let (mut saturated, mut all) = (0usize, 0usize);
    for step in steps {
        let (area, force) = (largest(&step.filtered_mm2), largest(&step.measured_n));
        let samples = step.filtered_mm2.iter().zip(&step.measured_n);
        saturated += samples.filter(|(a, f)| **a >= AT_LARGEST * area && **f < (1.0 - BELOW_PEAK) * force).count();
        all += step.measured_n.len();
    }
    saturated as f64 / (all as f64).max(1.0)
}

/// The measured curves and the model curve of one region in one step, over the contact phase of the region.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluated {
    /// Time between samples, s.
    pub sample_s: f64,
    /// Contact area as measured, mm2.
    pub area_mm2: Vec<f64>,
    /// Filtered contact area, mm2.
    pub filtered_mm2: Vec<f64>,
    /// Measured force, N.
    pub measured_n: Vec<f64>,
    /// Measured force smoothed by the paper's polynomial of 5th order, N.
    pub smoothed_n: Vec<f64>,
    /// Model force, N.
    pub model_n: Vec<f64>,
}

impl Evaluated {
    /// Evaluates the model in one step. Returns `None` if the region was never in contact.
    pub fn new(curves: &RegionCurves, filter: Filter, law: &ForceLaw<f64>) -> Option<Self> {
        let samples = Samples::new([curves], filter);
        let range = samples.steps.first()?.clone();
        let mut smoothed_n = samples.force_n.clone();
        smooth::polynomial(&mut smoothed_n);
        Some(Self {
            sample_s: curves.of(filter).2,
            area_mm2: samples.raw_area_m2.iter().map(|area| area * 1e6).collect(),
            filtered_mm2: samples.share[range].iter().map(|s| s * samples.area_max_m2 * 1e6).collect(),
            model_n: samples.deformation(law).map(|(g, rate_per_s)| law.force_n(g, rate_per_s)).collect(),
            smoothed_n,
            measured_n: samples.force_n,
        })
    }

    /// NRMSE: root mean square of model minus measured force, divided by the largest measured force (Eq. 20).
    pub fn nrmse(&self) -> f64 {
        nrmse(&self.model_n, &self.measured_n)
    }

    /// As [`Evaluated::nrmse`], but against the smoothed force.
    pub fn nrmse_smoothed(&self) -> f64 {
        nrmse(&self.model_n, &self.smoothed_n)
    }

    /// NRMSE of the non-decreasing function of the filtered area that fits the measured force best. No force law without damping
    /// has a smaller error; a law with damping may have one.
    pub fn floor(&self) -> f64 {
        nrmse(&best_non_decreasing(&self.filtered_mm2, &self.measured_n), &self.measured_n)
    }

    /// Largest model force divided by largest measured force, minus 1.
    pub fn peak_bias(&self) -> f64 {
        largest(&self.model_n) / largest(&self.measured_n) - 1.0
    }
}

/// Root mean square difference, divided by the largest value of `measured`.
fn nrmse(model: &[f64], measured: &[f64]) -> f64 {
    let squares: f64 = model.iter().zip(measured).map(|(a, b)| (a - b) * (a - b)).sum();
    (squares / measured.len() as f64).sqrt() / largest(measured)
}

/// The largest value; 0 if no value is positive.
pub(crate) fn largest(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

/// The values, at each `x`, of the non-decreasing function of `x` that fits `y` best by least squares. This isotonic regression
/// uses the pool-adjacent-violators algorithm.
fn best_non_decreasing(x: &[f64], y: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..x.len()).collect();
    // For equal x the largest y comes first, so that these samples are pooled.
    order.sort_by(|&a, &b| x[a].total_cmp(&x[b]).then(y[b].total_cmp(&y[a])));
    // The mean of y, and the indices of the samples that are pooled to it.
    let mut pools: Vec<(f64, Vec<usize>)> = Vec::new();
    for i in order {
        pools.push((y[i], vec![i]));
        while let [.., (before, _), (after, _)] = &pools[..] {
            if before < after {
                break;
            }
            // The pattern in the loop condition guarantees two pools.
            let Some((mean, members)) = pools.pop() else { break };
            let Some((pooled_mean, pooled)) = pools.last_mut() else { break };
            let (count, more) = (pooled.len() as f64, members.len() as f64);
            *pooled_mean = (*pooled_mean * count + mean * more) / (count + more);
            pooled.extend(members);
        }
    }
    let mut best = vec![0.0; x.len()];
    for (mean, members) in pools {
        for i in members {
            best[i] = mean;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_floor_is_the_best_non_decreasing_function() {
        // The expected values were computed by hand. In the first case, 3 and 1 decrease, so both are replaced by their mean, 2.
        // Equal areas must have equal values.
        assert_eq!(best_non_decreasing(&[1.0, 2.0, 3.0, 4.0], &[0.0, 3.0, 1.0, 5.0]), [0.0, 2.0, 2.0, 5.0]);
        assert_eq!(best_non_decreasing(&[2.0, 1.0, 2.0], &[4.0, 1.0, 6.0]), [5.0, 1.0, 5.0]);
        assert_eq!(best_non_decreasing(&[1.0, 2.0, 3.0], &[6.0, 3.0, 0.0]), [3.0, 3.0, 3.0]);
        assert_eq!(best_non_decreasing(&[1.0, 2.0, 2.0], &[5.0, 1.0, 20.0]), [5.0, 10.5, 10.5]);
    }
}

//! The errors of a set of parameters, evaluated as the device does.

use crate::{Filter, RegionCurves, Samples};
use plantar::pipeline::model::ForceLaw;
use plantar::pipeline::smooth;

/// An area of at least this fraction of the largest one in the step counts as the largest.
const AT_LARGEST: f64 = 0.97;
/// A force that is below its peak by more than this fraction counts as different from the peak.
const CHANGED: f64 = 0.35;

/// The errors of the parameters of a region, mean over its steps. NRMSE (Eq. 20) as a fraction: 0.1 is 10 %.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// NRMSE of all steps with the parameters that were fitted to all, against the measured force.
    pub fitted: f64,
    /// The same against the measured force, smoothed by the polynomial of 5th order of the paper.
    pub fitted_smoothed: f64,
    /// NRMSE of each step with parameters that were fitted to it alone, against the measured force.
    pub own: f64,
    /// The same against the smoothed force.
    pub own_smoothed: f64,
    /// NRMSE of each step with parameters that were fitted to the other steps, against the measured force. `None` for a single
    /// step.
    pub predicted: Option<f64>,
    /// NRMSE of the best non-decreasing function of the area of each step. No law without damping has a smaller error; a law with
    /// damping may.
    pub floor: f64,
    /// Largest model force divided by largest measured force, minus 1.
    pub peak_bias: f64,
    /// Fraction of the contact in which the area is at its largest while the force changes.
    pub saturated: f64,
}

impl Quality {
    /// Computes the errors from the steps, evaluated with the parameters that were fitted to all (`fitted`) and to each step
    /// alone (`own`), and from the NRMSE of the steps with parameters that were fitted to the other steps (`predicted`).
    pub(crate) fn new(fitted: &[Evaluated], own: &[Evaluated], predicted: &[f64]) -> Self {
        let mean = |of: fn(&Evaluated) -> f64, all: &[Evaluated]| all.iter().map(of).sum::<f64>() / all.len() as f64;
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

/// Fraction of the contact in which the area is at its largest while the force is well below its peak.
fn saturated(steps: &[Evaluated]) -> f64 {
    let (mut at_largest, mut all) = (0usize, 0usize);
    for step in steps {
        let (area, force) = (largest(&step.filtered_mm2), largest(&step.measured_n));
        let flat = step.filtered_mm2.iter().zip(&step.measured_n);
        at_largest += flat.filter(|(a, f)| **a >= AT_LARGEST * area && **f < (1.0 - CHANGED) * force).count();
        all += step.measured_n.len();
    }
    at_largest as f64 / (all as f64).max(1.0)
}

/// The curves of one region in one step, measured and of the model, over the contact phase of the region.
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
    /// Measured force, smoothed by the polynomial of 5th order of the paper, N.
    pub smoothed_n: Vec<f64>,
    /// Model force, N.
    pub model_n: Vec<f64>,
}

impl Evaluated {
    /// Evaluates the model in one step; `None` without contact.
    pub fn new(curves: &RegionCurves, filter: Filter, law: &ForceLaw<f64>) -> Option<Self> {
        let samples = Samples::new([curves], filter);
        let range = samples.steps.first()?.clone();
        let mut smoothed_n = samples.force_n.clone();
        smooth::polynomial(&mut smoothed_n);
        Some(Self {
            sample_s: 1.0 / samples.per_s.first()?,
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

    /// The same against the smoothed force.
    pub fn nrmse_smoothed(&self) -> f64 {
        nrmse(&self.model_n, &self.smoothed_n)
    }

    /// The same for the best non-decreasing function of the filtered area. No law without damping has a smaller error; a law with
    /// damping may.
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

/// The largest value; 0 without a positive one.
pub(crate) fn largest(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

/// The non-decreasing function of `x` with the least squares to `y`, at each x (isotonic regression by pooling adjacent
/// violators).
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
            // The pattern guarantees two pools.
            let Some((mean, members)) = pools.pop() else { break };
            let Some((below, all)) = pools.last_mut() else { break };
            let (count, more) = (all.len() as f64, members.len() as f64);
            *below = (*below * count + mean * more) / (count + more);
            all.extend(members);
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
        // By hand: 3 and 1 decrease and are pooled to 2; equal areas have one value.
        assert_eq!(best_non_decreasing(&[1.0, 2.0, 3.0, 4.0], &[0.0, 3.0, 1.0, 5.0]), [0.0, 2.0, 2.0, 5.0]);
        assert_eq!(best_non_decreasing(&[2.0, 1.0, 2.0], &[4.0, 1.0, 6.0]), [5.0, 1.0, 5.0]);
        assert_eq!(best_non_decreasing(&[1.0, 2.0, 3.0], &[6.0, 3.0, 0.0]), [3.0, 3.0, 3.0]);
        assert_eq!(best_non_decreasing(&[1.0, 2.0, 2.0], &[5.0, 1.0, 20.0]), [5.0, 10.5, 10.5]);
    }
}

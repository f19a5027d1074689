//! How sure the five parameters are: from the Jacobian at the minimum, and from fitting resampled steps again.

use crate::bounded::Residuals;
use crate::identify::{Bounds, Cut, Identified, refine};
use crate::{Options, RegionCurves, Samples};
use nalgebra::{Matrix5, Vector5};
use rayon::prelude::*;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// The five, in this order everywhere: A B (m2), K (Pa), G (Pa s), n, m.
pub const FIVE: [&str; 5] = ["A B", "K", "G", "n", "m"];

/// A parameter with its 95 % intervals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The estimate.
    pub value: f64,
    /// From the Jacobian: what the scatter of force around the model leaves open, given those others that are at a bound.
    pub jacobian: [f64; 2],
    /// From resampled steps: what one step differs from the next; needs [`RESAMPLED_STEPS`].
    pub bootstrap: Option<[f64; 2]>,
    /// The estimate lies at a bound.
    pub at_bound: bool,
    /// Force says something of it; of m it does not where G is 0.
    pub told: bool,
}

/// The intervals and how the estimates hang together.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncertainty {
    /// In the order of [`FIVE`].
    pub intervals: [Interval; 5],
    /// Correlation of the estimates (of A B, K, G in logarithms); 0 with a parameter at a bound or that force says nothing of.
    pub correlation: [[f64; 5]; 5],
}

/// Steps that it takes to resample them.
pub const RESAMPLED_STEPS: usize = 10;
/// Enough resamples for the ends of 95 %.
pub const RESAMPLES: u64 = 200;

/// The five from a fit to samples of this largest area.
pub fn five(identified: &Identified, area_max_m2: f64) -> [f64; 5] {
    let Identified { shape, stiffness_pa, damping_pa_s, .. } = *identified;
    [shape.ab_m2(area_max_m2), stiffness_pa, damping_pa_s, shape.n, shape.m]
}

/// Intervals from the Jacobian.
pub fn from_jacobian(samples: &Samples, bounds: &Bounds, identified: &Identified) -> Uncertainty {
    let mut law = Cut::new(samples);
    let x = identified.x();
    law.set(&x);
    // Order of the search: reach, n, m, K, G; by ln A B, ln K, ln G, n, m instead. ln A B = constant - ln reach.
    let by = |i: usize| law.derivative(i);
    let columns = [-by(0) * x[0], by(3) * x[3], by(4) * if x[4] > 0.0 { x[4] } else { 1.0 }, by(1), by(2)];
    let norms = Vector5::from_fn(|i, _| columns[i].norm());
    let told = |i: usize| norms[i] > 1e-9 * norms.max();
    let (order, ends) = ([0, 3, 4, 1, 2], crate::identify::limits(bounds));
    let at_bound = |i: usize| x[order[i]] <= ends[0][order[i]] || x[order[i]] >= ends[1][order[i]];
    let gram = Matrix5::from_fn(|i, j| columns[i].dot(&columns[j]) / (norms[i] * norms[j]));
    // A parameter at a bound is held there for the others, and freed for its own interval.
    let covariance = |freed: Option<usize>| {
        let is_free = |i: usize| told(i) && (!at_bound(i) || freed == Some(i));
        let free = Matrix5::from_fn(|i, j| match is_free(i) && is_free(j) {
            true => gram[(i, j)],
            false => f64::from(u8::from(i == j)),
        });
        free.pseudo_inverse(1e-13).unwrap_or(Matrix5::identity() * f64::INFINITY)
    };
    // Neighbouring residuals are alike where the model misses: so many fewer are independent.
    // A fit of five parameters makes them look less alike, by five over their number less five.
    let likeness = samples.likeness(law.residuals().as_slice()) + 5.0 / (samples.len() as f64 - 5.0).max(5.0);
    let likeness = likeness.clamp(0.0, 0.99);
    let independent = samples.len() as f64 * (1.0 - likeness) / (1.0 + likeness);
    let freedom = (independent - 5.0).max(1.0);
    let variance = identified.squares / freedom;
    let quantile = StudentsT::new(0.0, 1.0, freedom).map_or(f64::INFINITY, |t| t.inverse_cdf(0.975));
    let half = |i: usize| match told(i) {
        true => quantile * (covariance(Some(i))[(i, i)].max(0.0) * variance).sqrt() / norms[i],
        false => f64::INFINITY,
    };
    let values = five(identified, samples.area_max_m2);
    let limits = limits(bounds, samples.area_max_m2);
    let interval = |i: usize| {
        let (value, half, [least, most]) = (values[i], half(i), limits[i]);
        // A B and K are positive and skew, and so is G where it is told well.
        let raw = match i < 2 || (i == 2 && value > 0.0 && half < 1.0) {
            true => [value * (-half).exp(), value * half.exp()],
            false => {
                let half = if i == 2 && value > 0.0 { half * value } else { half };
                [value - half, value + half]
            }
        };
        Interval {
            value,
            jacobian: [raw[0].clamp(least, most), raw[1].clamp(least, most)],
            bootstrap: None,
            told: told(i),
            at_bound: at_bound(i),
        }
    };
    let together = covariance(None);
    let correlation = |i: usize, j: usize| together[(i, j)] / (together[(i, i)] * together[(j, j)]).sqrt();
    Uncertainty {
        intervals: std::array::from_fn(interval),
        correlation: std::array::from_fn(|i| std::array::from_fn(|j| correlation(i, j))),
    }
}

fn limits(bounds: &Bounds, area_max_m2: f64) -> [[f64; 2]; 5] {
    let ab = |reach: f64| crate::law::Shape { reach, n: 0.0, m: 0.0 }.ab_m2(area_max_m2);
    [[ab(bounds.reach[1]), ab(bounds.reach[0])], bounds.stiffness_pa, bounds.damping_pa_s, bounds.n, bounds.m]
}

/// Puts the middle 95 % of fits to resampled steps beside; the same steps give the same numbers.
pub fn add_bootstrap(
    uncertainty: &mut Uncertainty,
    curves: &[&RegionCurves],
    options: &Options,
    identified: &Identified,
    area_max_m2: f64,
) {
    if curves.len() < RESAMPLED_STEPS || options.resamples == 0 {
        return;
    }
    let fits: Vec<[f64; 5]> = (0..options.resamples)
        .into_par_iter()
        .map(|seed| {
            let mut chance = fastrand::Rng::with_seed(seed);
            let drawn = (0..curves.len()).map(|_| curves[chance.usize(..curves.len())]);
            let samples = Samples::new(drawn, options.filter);
            let near = identified.rebased(area_max_m2, samples.area_max_m2, &options.bounds);
            five(&refine(&samples, &options.bounds, &near), samples.area_max_m2)
        })
        .collect();
    for (i, interval) in uncertainty.intervals.iter_mut().enumerate() {
        let mut values: Vec<f64> = fits.iter().map(|fit| fit[i]).collect();
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values[(share * (values.len() - 1) as f64).round() as usize];
        interval.bootstrap = Some([at(0.025), at(0.975)]);
    }
}

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
    /// From the Jacobian: what the scatter of force around the model leaves open.
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
    /// Correlation of the estimates (of A B, K, G in logarithms); 0 with a parameter that force says nothing of here.
    pub correlation: [[f64; 5]; 5],
}

/// Steps that it takes to resample them.
pub const RESAMPLED_STEPS: usize = 5;
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
    // Order of the search: g_max, n, m, K, G; by ln A B, K, G, n, m instead.
    let by = |i: usize| law.derivative(i);
    let ln_ab_rate = identified.shape.ln_ab_rate();
    // At g_max 1 the area is as large as pi A B and ln A B rises with the square of the distance only.
    let ln_ab_rate = if ln_ab_rate.abs() < 0.05 { -0.05 } else { ln_ab_rate };
    let by_g = if x[4] > 0.0 { by(4) * x[4] } else { by(4) };
    let columns = [by(0) / ln_ab_rate, by(3) * x[3], by_g, by(1), by(2)];
    let norms = Vector5::from_fn(|i, _| columns[i].norm());
    let told = |i: usize| norms[i] > 1e-9 * norms.max();
    let gram = Matrix5::from_fn(|i, j| match (told(i), told(j)) {
        (true, true) => columns[i].dot(&columns[j]) / (norms[i] * norms[j]),
        _ => f64::from(u8::from(i == j)),
    });
    let freedom = (samples.len() as f64 - 5.0).max(1.0);
    let variance = identified.squares / freedom;
    let covariance = gram.pseudo_inverse(1e-13).unwrap_or(Matrix5::identity() * f64::INFINITY);
    let quantile = StudentsT::new(0.0, 1.0, freedom).map_or(f64::INFINITY, |t| t.inverse_cdf(0.975));
    let half = |i: usize| match told(i) {
        true => quantile * (covariance[(i, i)].max(0.0) * variance).sqrt() / norms[i],
        false => f64::INFINITY,
    };
    let values = five(identified, samples.area_max_m2);
    let limits = limits(bounds, samples.area_max_m2);
    let (order, ends) = ([0, 3, 4, 1, 2], crate::identify::limits(bounds));
    let interval = |i: usize| {
        let (value, half, [least, most]) = (values[i], half(i), limits[i]);
        // A B, K and G are positive and skew.
        let raw = if i < 3 && value > 0.0 {
            [value * (-half).exp(), value * half.exp()]
        } else {
            [value - half, value + half]
        };
        Interval {
            value,
            jacobian: [raw[0].clamp(least, most), raw[1].clamp(least, most)],
            bootstrap: None,
            told: told(i),
            at_bound: x[order[i]] <= ends[0][order[i]] || x[order[i]] >= ends[1][order[i]],
        }
    };
    let correlation = |i: usize, j: usize| match (told(i), told(j)) {
        (true, true) => covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt(),
        _ => f64::from(u8::from(i == j)),
    };
    Uncertainty {
        intervals: std::array::from_fn(interval),
        correlation: std::array::from_fn(|i| std::array::from_fn(|j| correlation(i, j))),
    }
}

fn limits(bounds: &Bounds, area_max_m2: f64) -> [[f64; 2]; 5] {
    let ab = |g_max: f64| crate::law::Shape { g_max, n: 0.0, m: 0.0 }.ab_m2(area_max_m2);
    [[ab(bounds.g_max[1]), ab(bounds.g_max[0])], bounds.stiffness_pa, bounds.damping_pa_s, bounds.n, bounds.m]
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

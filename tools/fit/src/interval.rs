//! Confidence intervals of the five parameters: from the Jacobian at the minimum, and from fits to resampled steps (bootstrap).

use crate::Samples;
use crate::bounded::Residuals;
use crate::identify::{Bounds, Identified, NonNegativeForce};
use crate::prior::{self, Prior};
use nalgebra::{Matrix5, Vector5};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// The names of the five identifiable parameters, in the order of all intervals: A B (m2), K (Pa), G (Pa s), n, m.
pub const FIVE: [&str; 5] = ["A B", "K", "G", "n", "m"];

/// A parameter with its 95 % intervals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The estimate, in the unit of [`FIVE`].
    pub value: f64,
    /// The interval from the Jacobian and, with a prior, the distribution among people. It describes the uncertainty due to the
    /// scatter of the force about the model. Without a prior, other parameters that are at a bound are held there.
    pub jacobian: [f64; 2],
    /// The interval from resampled steps, which includes the differences between steps. `None` for fewer than
    /// [`MIN_BOOTSTRAP_STEPS`] steps, or without resamples.
    pub bootstrap: Option<[f64; 2]>,
    /// True if the estimate is at a bound of the search.
    pub at_bound: bool,
    /// True if the force determines the parameter. Without a prior, it is false for a parameter on which the force does not
    /// depend, such as m if G is 0; with a prior, for one that the force leaves nearly as uncertain as it is among people, and
    /// for an A B, K or G of which the ends of `jacobian` differ by more than a factor of 100.
    pub is_identifiable: bool,
}

/// The intervals and the correlation of the estimates.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncertainty {
    /// The intervals in the order of [`FIVE`].
    pub intervals: [Interval; 5],
    /// Correlation matrix of the estimates, in the order of [`FIVE`]. For A B, K and G it is the correlation of their logarithms.
    /// Without a prior, it is 0 between any other parameter and one that is at a bound or does not affect the force.
    pub correlation: [[f64; 5]; 5],
}

/// Smallest number of steps for a bootstrap.
pub const MIN_BOOTSTRAP_STEPS: usize = 10;
/// Number of resamples that suffices for 95 % intervals.
pub const RESAMPLES: u64 = 200;

/// The indices of `count` steps, drawn with replacement from as many steps. Equal seeds result in equal steps.
pub(crate) fn drawn(seed: u64, count: usize) -> impl Iterator<Item = usize> + Clone {
    let mut random = fastrand::Rng::with_seed(seed);
    (0..count).map(move |_| random.usize(..count))
}

/// The five parameters of a fit to samples with this largest area, in the order of [`FIVE`].
pub fn five(identified: &Identified, area_max_m2: f64) -> [f64; 5] {
    let Identified { shape, stiffness_pa, damping_pa_s, .. } = *identified;
    [shape.ab_m2(area_max_m2), stiffness_pa, damping_pa_s, shape.n, shape.m]
}

/// The scatter of the force about the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Variance of an independent residual. Residuals are weighted as in [`Samples`].
    pub variance: f64,
    /// Degrees of freedom of this estimate.
    pub degrees_of_freedom: f64,
}

impl Noise {
    /// No noise.
    #[cfg(feature = "paper")]
    pub const NONE: Self = Self { variance: 0.0, degrees_of_freedom: 1.0 };

    /// Half of the width of a 95 % interval, in standard deviations.
    pub(crate) fn quantile(&self) -> f64 {
        StudentsT::new(0.0, 1.0, self.degrees_of_freedom).map_or(f64::INFINITY, |t| t.inverse_cdf(0.975))
    }
}

/// The noise of a fit. If the model has a systematic error, neighbouring residuals are correlated, so that fewer of them are
/// independent.
pub fn noise(samples: &Samples, identified: &Identified) -> Noise {
    let mut law = NonNegativeForce::new(samples);
    law.set(&identified.x());
    // The fit of five parameters lowers the estimated autocorrelation by about 5 / (samples - 5), which is therefore added.
    let autocorrelation =
        samples.autocorrelation(law.residuals().as_slice()) + 5.0 / (samples.len() as f64 - 5.0).max(5.0);
    let autocorrelation = autocorrelation.clamp(0.0, 0.99);
    let independent = samples.len() as f64 * (1.0 - autocorrelation) / (1.0 + autocorrelation);
    let degrees_of_freedom = (independent - 5.0).max(1.0);
    Noise { variance: identified.squares / degrees_of_freedom, degrees_of_freedom }
}

/// The covariance matrix of the coordinates ([`prior::Coordinates`]) at the most probable parameters, in Laplace's
/// approximation. `variance` is that of the noise.
pub fn covariance(samples: &Samples, prior: &Prior, identified: &Identified, variance: f64) -> Matrix5<f64> {
    let mut law = NonNegativeForce::new(samples);
    law.set(&identified.x());
    let columns = prior::derivatives(&law, &prior::coordinates(identified));
    let gram = Matrix5::from_fn(|i, j| columns[i].dot(&columns[j]));
    prior::inverse(&(gram + prior.precision() * variance)) * variance
}

/// A coordinate whose standard deviation is more than this fraction of that among people is not determined by the force.
const UNDETERMINED: f64 = 0.8;
/// An A B, K or G is not determined by the force if the ratio of the ends of its interval is above this value.
const WIDEST_RATIO: f64 = 100.0;
/// An n or a logit of `max_ratio` counts as at its lower bound if it exceeds the bound by less than this value, and an n or m as
/// at its upper bound if ln(n + 0.95) or ln m is below that of the bound by less than this value. A `max_ratio` counts as at its
/// upper bound, 1, if it is below 1 by less than a hundredth of this value.
const AT_BOUND: f64 = 0.005;

/// The index of each of the parameters [`FIVE`] among the variables of the search and among the coordinates of the prior.
const SEARCHED: [usize; 5] = [0, 3, 4, 1, 2];

/// Intervals of the most probable parameters, `identified`, from the `covariance` matrix of their coordinates. `area_max_m2` is
/// the largest area of the samples.
pub fn from_posterior(
    area_max_m2: f64,
    prior: &Prior,
    identified: &Identified,
    noise: &Noise,
    covariance: &Matrix5<f64>,
) -> Uncertainty {
    let at = prior::coordinates(identified);
    let quantile = noise.quantile();
    let coordinate = SEARCHED;
    let values = five(identified, area_max_m2);
    let [.., damping_variance] = prior::shape_variances(covariance);
    let interval = |i: usize| {
        let half = quantile * covariance[(coordinate[i], coordinate[i])].max(0.0).sqrt();
        let end = |direction: f64| {
            let mut moved = at;
            moved[coordinate[i]] += direction * half;
            five(&prior::parameters(&moved, 0.0, 0), area_max_m2)[i]
        };
        let ends = [end(-1.0), end(1.0)];
        // The prior leaves K free, and states G only relative to K.
        let deviation_of_prior = match i {
            1 => f64::INFINITY,
            2 => prior.deviation[3],
            _ => prior.deviation[coordinate[i]],
        };
        let variance = if i == 2 { damping_variance } else { covariance[(coordinate[i], coordinate[i])] };
        let [low, high] = [ends[0].min(ends[1]), ends[0].max(ends[1])];
        // An n or m has no ratio, because n can be negative.
        let is_too_wide = i < 3 && high > WIDEST_RATIO * low;
        Interval {
            value: values[i],
            jacobian: [low, high],
            bootstrap: None,
            at_bound: match i {
                0 => identified.shape.max_ratio > 1.0 - 0.01 * AT_BOUND || at[0] < prior::LEAST_LOGIT + AT_BOUND,
                3 => values[3] < Bounds::LEAST_N + AT_BOUND || at[1] > prior::LN_LARGEST_EXPONENT - AT_BOUND,
                4 => at[2] > prior::LN_LARGEST_EXPONENT - AT_BOUND,
                _ => false,
            },
            is_identifiable: variance.sqrt() < UNDETERMINED * deviation_of_prior && !is_too_wide,
        }
    };
    // ln A B decreases with the coordinate of `max_ratio`.
    let sign = |i: usize| if i == 0 { -1.0 } else { 1.0 };
    let correlation = |i: usize, j: usize| {
        let (a, b) = (coordinate[i], coordinate[j]);
        sign(i) * sign(j) * covariance[(a, b)] / (covariance[(a, a)] * covariance[(b, b)]).sqrt()
    };
    Uncertainty {
        intervals: std::array::from_fn(interval),
        correlation: std::array::from_fn(|i| std::array::from_fn(|j| correlation(i, j))),
    }
}

/// Intervals of a fit without a prior, from the Jacobian at the minimum.
pub fn from_jacobian(samples: &Samples, bounds: &Bounds, identified: &Identified) -> Uncertainty {
    let mut law = NonNegativeForce::new(samples);
    let x = identified.x();
    law.set(&x);
    // The derivatives with respect to max_ratio, n, m, K and G are converted to derivatives with respect to ln A B, ln K, ln G, n
    // and m. Here ln A B is a constant minus ln max_ratio. If G is 0, the derivative with respect to G itself is used.
    let by = |i: usize| law.derivative(i);
    let columns = [-by(0) * x[0], by(3) * x[3], by(4) * if x[4] > 0.0 { x[4] } else { 1.0 }, by(1), by(2)];
    let norms = Vector5::from_fn(|i, _| columns[i].norm());
    let is_identifiable = |i: usize| norms[i] > 1e-9 * norms.max();
    let (order, ends) = (SEARCHED, crate::identify::limits(bounds));
    let at_bound = |i: usize| x[order[i]] <= ends[0][order[i]] || x[order[i]] >= ends[1][order[i]];
    let gram = Matrix5::from_fn(|i, j| columns[i].dot(&columns[j]) / (norms[i] * norms[j]));
    // A parameter at a bound is held there for the intervals of the others, and released for its own.
    let covariance = |freed: Option<usize>| {
        let is_free = |i: usize| is_identifiable(i) && (!at_bound(i) || freed == Some(i));
        let free = Matrix5::from_fn(|i, j| match is_free(i) && is_free(j) {
            true => gram[(i, j)],
            false => f64::from(u8::from(i == j)),
        });
        free.pseudo_inverse(1e-13).unwrap_or(Matrix5::identity() * f64::INFINITY)
    };
    let noise = noise(samples, identified);
    let (variance, quantile) = (noise.variance, noise.quantile());
    let half_width = |i: usize| match is_identifiable(i) {
        true => quantile * (covariance(Some(i))[(i, i)].max(0.0) * variance).sqrt() / norms[i],
        false => f64::INFINITY,
    };
    let values = five(identified, samples.area_max_m2);
    let limits = limits(bounds, samples.area_max_m2);
    let interval = |i: usize| {
        let (value, half, [least, most]) = (values[i], half_width(i), limits[i]);
        // The distributions of A B and K are skewed towards large values, so their intervals are symmetric in logarithms. The
        // same applies to G if its uncertainty is small.
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
            is_identifiable: is_identifiable(i),
            at_bound: at_bound(i),
        }
    };
    let all_held = covariance(None);
    let correlation = |i: usize, j: usize| all_held[(i, j)] / (all_held[(i, i)] * all_held[(j, j)]).sqrt();
    Uncertainty {
        intervals: std::array::from_fn(interval),
        correlation: std::array::from_fn(|i| std::array::from_fn(|j| correlation(i, j))),
    }
}

/// The bounds in the order of [`FIVE`].
fn limits(bounds: &Bounds, area_max_m2: f64) -> [[f64; 2]; 5] {
    let ab = |max_ratio: f64| crate::law::Shape { max_ratio, n: 0.0, m: 0.0 }.ab_m2(area_max_m2);
    [[ab(bounds.max_ratio[1]), ab(bounds.max_ratio[0])], bounds.stiffness_pa, bounds.damping_pa_s, bounds.n, bounds.m]
}

/// Adds the bootstrap intervals to `uncertainty`: the middle 95 % of the `resampled` parameters, which are in the order of
/// [`FIVE`].
pub fn add_bootstrap(uncertainty: &mut Uncertainty, resampled: &[[f64; 5]]) {
    for (i, interval) in uncertainty.intervals.iter_mut().enumerate() {
        interval.bootstrap = middle(resampled.iter().map(|five| five[i]));
    }
}

/// The middle 95 % of values; `None` without values.
pub(crate) fn middle(values: impl IntoIterator<Item = f64>) -> Option<[f64; 2]> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[(share * (values.len() - 1) as f64).round() as usize];
    (!values.is_empty()).then(|| [at(0.025), at(0.975)])
}

//! What is known about the parameters of a region before any step is recorded: their distribution among people.
//!
//! The five parameters of a force law cannot be determined from every region: the data of a region with a peak force of a few
//! newtons, or of a few steps, leave the shape of its force law open, and least squares then ends at a bound. The identification
//! therefore maximises the posterior density: the residuals are weighed against the deviation of the shape from that of a cohort
//! of walkers (empirical Bayes). The scale of the force, K, is left to the data: it depends on the sensor, the shoe and the
//! person, and one loaded sample suffices to determine it.

use crate::bounded::Residuals;
use crate::identify::{Bounds, Identified, NonNegativeForce, REFINE_TOLERANCE, identify};
use crate::law::Shape;
use crate::screen::usable;
use crate::{Options, Samples, Step, interval, parallel};
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DVector, Dyn, Matrix5, OMatrix, Owned, U5, Vector5};

/// The parameters in coordinates without bounds: logit of `max_ratio`, ln(n + 0.95), ln m, ln K (Pa) and ln G (Pa s).
pub type Coordinates = Vector5<f64>;

/// The shape of the force law in coordinates without bounds: logit of `max_ratio`, ln(n + 0.95), ln m, and ln of G / K (s).
pub type ShapeCoordinates = [f64; 4];

/// The distribution of the shape of the force law of one region among people. The coordinates are independent and normally
/// distributed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Mean.
    pub mean: ShapeCoordinates,
    /// Standard deviation.
    pub deviation: ShapeCoordinates,
}

/// A parameter at a bound has no finite coordinate. A search therefore starts from coordinates of `max_ratio`, n and m of at
/// most this absolute value, where the force still depends on them. The start of ln(G / K) is at least minus this value, which
/// is a G / K of 2.5 ms.
const INSIDE: f64 = 6.0;
/// Smallest logit of `max_ratio`: that of a `max_ratio` of 0.12, which is also the lower bound of the least-squares fit.
/// With a smaller `max_ratio`, the force law is nearly a power of the area, and for steps without noise the product A B and the
/// radius C would grow without limit.
pub(crate) const LEAST_LOGIT: f64 = -2.0;
/// Largest absolute value of a coordinate.
const FAR: f64 = 30.0;
/// Largest ln(n + 0.95) and ln m: exponents of about 9 and 10. An insole accepts exponents up to 10.
pub(crate) const LN_LARGEST_EXPONENT: f64 = 2.3;
/// Relative tolerance of a fit that yields reported parameters. That of [`Prior::refine`] is [`REFINE_TOLERANCE`].
const FIT_TOLERANCE: f64 = 1e-10;

/// The coordinates of parameters. The coordinate of a parameter at a bound is limited to plus or minus [`FAR`].
pub fn coordinates(identified: &Identified) -> Coordinates {
    let Identified { shape, stiffness_pa, damping_pa_s, .. } = identified;
    let coordinates = Coordinates::new(
        (shape.max_ratio / (1.0 - shape.max_ratio)).ln(),
        (shape.n - Bounds::LEAST_N).ln(),
        shape.m.ln(),
        stiffness_pa.ln(),
        damping_pa_s.ln(),
    );
    coordinates.map(|coordinate| if coordinate.is_nan() { -FAR } else { coordinate.clamp(-FAR, FAR) })
}

/// The coordinates from which a search starts.
fn start(identified: &Identified) -> Coordinates {
    let at = coordinates(identified);
    let inside = |i: usize| at[i].clamp(-INSIDE, INSIDE);
    Coordinates::new(inside(0), inside(1), inside(2), at[3], at[4].max(at[3] - INSIDE))
}

/// The parameters at coordinates. `squares` and `evaluations` are those of the search.
pub fn parameters(at: &Coordinates, squares: f64, evaluations: usize) -> Identified {
    // A search may try points far away, at which the force would not be finite.
    let within = |i: usize| at[i].clamp(-FAR, FAR);
    Identified {
        shape: Shape {
            max_ratio: 1.0 / (1.0 + (-within(0).max(LEAST_LOGIT)).exp()),
            n: Bounds::LEAST_N + within(1).min(LN_LARGEST_EXPONENT).exp(),
            m: within(2).min(LN_LARGEST_EXPONENT).exp(),
        },
        stiffness_pa: within(3).exp(),
        damping_pa_s: within(4).exp(),
        squares,
        evaluations,
    }
}

/// The inverse of the matrix of second derivatives with respect to the coordinates. Rows and columns are scaled, because G may
/// have almost no influence while K determines the force.
pub(crate) fn inverse(curvature: &Matrix5<f64>) -> Matrix5<f64> {
    let scale = Vector5::from_fn(|i, _| curvature[(i, i)].sqrt().recip());
    let scaled = Matrix5::from_fn(|i, j| curvature[(i, j)] * scale[i] * scale[j]);
    let inverse = scaled.pseudo_inverse(1e-13).unwrap_or(Matrix5::identity() * f64::INFINITY);
    Matrix5::from_fn(|i, j| inverse[(i, j)] * scale[i] * scale[j])
}

/// The variances of the shape coordinates, from the covariance matrix of the coordinates.
pub(crate) fn shape_variances(covariance: &Matrix5<f64>) -> ShapeCoordinates {
    let ln_g_over_k = covariance[(3, 3)] + covariance[(4, 4)] - 2.0 * covariance[(3, 4)];
    [covariance[(0, 0)], covariance[(1, 1)], covariance[(2, 2)], ln_g_over_k]
}

impl Prior {
    /// The distribution from which [`learn`] starts. It is broad enough for every plausible shape.
    pub const BROAD: Self = Self { mean: [0.5, -1.5, 0.0, -4.5], deviation: [1.5, 1.0, 0.7, 1.5] };

    /// The distribution of the shapes of people, for each of whom the most probable coordinates and their covariance matrix are
    /// given.
    fn of(people: &[(Coordinates, Matrix5<f64>)]) -> Self {
        let count = people.len() as f64;
        let shapes: Vec<ShapeCoordinates> = people.iter().map(|(at, _)| Self::shape(at)).collect();
        let mean: ShapeCoordinates = std::array::from_fn(|i| shapes.iter().map(|shape| shape[i]).sum::<f64>() / count);
        let deviation = std::array::from_fn(|i| {
            let between = shapes.iter().map(|shape| (shape[i] - mean[i]).powi(2)).sum::<f64>() / count;
            let within = people.iter().map(|(_, covariance)| shape_variances(covariance)[i]).sum::<f64>() / count;
            (between + within).sqrt().clamp(LEAST_DEVIATION, Self::BROAD.deviation[i])
        });
        Self { mean, deviation }
    }

    /// The shape coordinates of parameters.
    pub fn shape(at: &Coordinates) -> ShapeCoordinates {
        [at[0], at[1], at[2], at[4] - at[3]]
    }

    /// The rows that the prior adds to the least-squares problem: the deviations of the shape from the mean, divided by the
    /// standard deviations.
    fn rows(&self, at: &Coordinates) -> [f64; 4] {
        let shape = Self::shape(at);
        std::array::from_fn(|i| (shape[i] - self.mean[i]) / self.deviation[i])
    }

    /// The derivative of the rows with respect to coordinate `i`.
    fn derivative(&self, i: usize) -> [f64; 4] {
        let mut column = [0.0; 4];
        match i {
            3 => column[3] = -1.0 / self.deviation[3],
            4 => column[3] = 1.0 / self.deviation[3],
            _ => column[i] = 1.0 / self.deviation[i],
        }
        column
    }

    /// The inverse of the covariance matrix of the coordinates; singular, because K is free.
    pub fn precision(&self) -> Matrix5<f64> {
        let columns: [[f64; 4]; 5] = std::array::from_fn(|i| self.derivative(i));
        Matrix5::from_fn(|i, j| columns[i].iter().zip(columns[j]).map(|(a, b)| a * b).sum())
    }

    /// Half of the derivative of the sum of the squared rows with respect to the coordinates.
    pub(crate) fn slope(&self, at: &Coordinates) -> Vector5<f64> {
        let rows = self.rows(at);
        Vector5::from_fn(|i, _| rows.iter().zip(self.derivative(i)).map(|(row, by)| row * by).sum())
    }

    /// The coordinates of the mean shape, with the K that fits the samples best.
    fn mean_at(&self, samples: &Samples) -> Coordinates {
        let [logit, ln_n, ln_m, ln_tau] = self.mean;
        let mut law = NonNegativeForce::new(samples);
        law.set(&parameters(&Coordinates::new(logit, ln_n, ln_m, 0.0, ln_tau), 0.0, 0).x());
        let (mut ff, mut ft) = (0.0, 0.0);
        for (force, target) in law.force().iter().zip(&samples.target) {
            ff += force * force;
            ft += force * target;
        }
        let ln_k = (ft / ff).max(f64::MIN_POSITIVE).ln();
        Coordinates::new(logit, ln_n, ln_m, ln_k, ln_k + ln_tau)
    }

    /// The most probable parameters. `noise` is the variance of an independent residual. One of the two searches starts from
    /// `unconstrained`, the least-squares fit, and the other from the mean shape.
    pub fn identify(&self, samples: &Samples, unconstrained: &Identified, noise: f64) -> Identified {
        let near = self.search(samples, start(unconstrained), noise, FIT_TOLERANCE);
        let far = self.search(samples, self.mean_at(samples), noise, FIT_TOLERANCE);
        let evaluations = unconstrained.evaluations + near.evaluations + far.evaluations + 1;
        let better = if near.objective <= far.objective { near } else { far };
        parameters(&better.at, better.squares, evaluations)
    }

    /// The most probable parameters close to `near`. `noise` is the variance of an independent residual.
    pub fn refine(&self, samples: &Samples, near: &Identified, noise: f64) -> Identified {
        self.search_near(samples, near, noise, REFINE_TOLERANCE)
    }

    /// As [`Prior::refine`], with the accuracy of [`Prior::identify`].
    pub(crate) fn converge(&self, samples: &Samples, near: &Identified, noise: f64) -> Identified {
        self.search_near(samples, near, noise, FIT_TOLERANCE)
    }

    fn search_near(&self, samples: &Samples, near: &Identified, noise: f64, tolerance: f64) -> Identified {
        let end = self.search(samples, start(near), noise, tolerance);
        parameters(&end.at, end.squares, end.evaluations)
    }

    fn search(&self, samples: &Samples, start: Coordinates, noise: f64, tolerance: f64) -> SearchEnd {
        let posterior = Posterior::new(self, samples, noise, start);
        let (end, report) =
            LevenbergMarquardt::new().with_tol(tolerance).with_gtol(tolerance).with_patience(20).minimize(posterior);
        // Evaluated again, so that the result is that of the accepted point however the search has ended.
        let end = Posterior::new(self, samples, noise, end.at);
        let residuals = end.law.residuals();
        let squares = residuals.norm_squared();
        SearchEnd {
            at: end.at,
            squares,
            objective: squares + noise * self.rows(&end.at).iter().map(|row| row * row).sum::<f64>(),
            evaluations: report.number_of_evaluations + 1,
        }
    }
}

/// The end of a search.
struct SearchEnd {
    at: Coordinates,
    /// Sum of the squared residuals of the force.
    squares: f64,
    /// The minimised sum: `squares` plus the squares of the rows of the prior times the variance of the noise.
    objective: f64,
    evaluations: usize,
}

/// The least-squares problem: the residuals of the force, and the rows of the prior times the standard deviation of the noise.
struct Posterior<'s> {
    prior: &'s Prior,
    law: NonNegativeForce<'s>,
    /// Number of samples.
    samples: usize,
    /// Standard deviation of an independent residual.
    root_noise: f64,
    at: Coordinates,
}

impl<'s> Posterior<'s> {
    fn new(prior: &'s Prior, samples: &'s Samples, noise: f64, at: Coordinates) -> Self {
        let mut law = NonNegativeForce::new(samples);
        law.set(&parameters(&at, 0.0, 0).x());
        Self { prior, law, samples: samples.len(), root_noise: noise.sqrt(), at }
    }
}

/// The derivatives of the weighted force of all samples with respect to the coordinates.
pub(crate) fn derivatives(law: &NonNegativeForce, at: &Coordinates) -> [DVector<f64>; 5] {
    let x = parameters(at, 0.0, 0).x();
    let [max_ratio, n, m, k, g] = x;
    // The derivatives of the parameters with respect to their coordinates.
    let by_logit = if at[0] > LEAST_LOGIT { max_ratio * (1.0 - max_ratio) } else { 0.0 };
    // At its limit, an exponent does not change with its coordinate.
    let by_n = if at[1] < LN_LARGEST_EXPONENT { n - Bounds::LEAST_N } else { 0.0 };
    let by_m = if at[2] < LN_LARGEST_EXPONENT { m } else { 0.0 };
    let chain = [by_logit, by_n, by_m, k, g];
    std::array::from_fn(|i| law.derivative(i) * chain[i])
}

impl LeastSquaresProblem<f64, Dyn, U5> for Posterior<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, U5>;
    type ParameterStorage = Owned<f64, U5>;

    fn set_params(&mut self, at: &Coordinates) {
        self.at = *at;
        self.law.set(&parameters(at, 0.0, 0).x());
    }

    fn params(&self) -> Coordinates {
        self.at
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        let force = self.law.residuals();
        let rows = self.prior.rows(&self.at).map(|row| row * self.root_noise);
        Some(DVector::from_iterator(self.samples + 4, force.iter().copied().chain(rows)))
    }

    fn jacobian(&self) -> Option<OMatrix<f64, Dyn, U5>> {
        let force = derivatives(&self.law, &self.at);
        let mut jacobian = OMatrix::<f64, Dyn, U5>::zeros(self.samples + 4);
        for (i, column) in force.iter().enumerate() {
            jacobian.view_mut((0, i), (self.samples, 1)).copy_from(column);
            for (row, value) in self.prior.derivative(i).into_iter().enumerate() {
                jacobian[(self.samples + row, i)] = value * self.root_noise;
            }
        }
        Some(jacobian)
    }
}

/// Number of rounds of [`learn`], after which the distribution changes by less than a tenth of its standard deviations.
const ROUNDS: usize = 8;

/// The distribution of the shape among people, in the order of [`plantar::Region::ALL`]. `people` contains the steps of each
/// person. A region to which the steps of fewer than three people can be fitted has the distribution [`Prior::BROAD`].
///
/// The fits of the people and the distribution, which is the prior of the fits, are computed in turn: the EM algorithm of a
/// normal hierarchical model, in Laplace's approximation.
pub fn learn(people: &[&[Step]], options: &Options) -> [Prior; 8] {
    let priors = parallel::map(8, |region| learn_region(people, region, options));
    std::array::from_fn(|region| priors[region])
}

/// See [`learn`].
fn learn_region(people: &[&[Step]], region: usize, options: &Options) -> Prior {
    let mut prior = Prior::BROAD;
    let mut fits: Vec<(Samples, f64, Identified)> = Vec::new();
    for steps in people {
        let Ok(used) = usable(steps, region, options.filter) else { continue };
        let samples = Samples::new(used.iter().map(|&i| &steps[i].regions[region]), options.filter);
        let unconstrained = identify(&samples, &options.bounds);
        let noise = interval::noise(&samples, &unconstrained).variance;
        let identified = prior.identify(&samples, &unconstrained, noise);
        fits.push((samples, noise, identified));
    }
    if fits.len() < 3 {
        return prior;
    }
    for _ in 0..ROUNDS {
        let people: Vec<(Coordinates, Matrix5<f64>)> = fits
            .iter()
            .map(|(samples, noise, at)| (coordinates(at), interval::covariance(samples, &prior, at, *noise)))
            .collect();
        prior = Prior::of(&people);
        for (samples, noise, identified) in &mut fits {
            *identified = prior.refine(samples, identified, *noise);
        }
    }
    prior
}

/// Smallest standard deviation of a coordinate: other people may differ more than the members of a cohort of some ten people
/// do. The largest standard deviation is that of [`Prior::BROAD`].
const LEAST_DEVIATION: f64 = 0.3;

/// The distribution among ten barefoot walkers on a plate (data set SpeedPP2DS), with the contact rule
/// [`plantar::pipeline::contact::ContactRule::COVERED`], in the order of [`plantar::Region::ALL`].
pub const WALKERS: [Prior; 8] = [
    Prior { mean: [2.01, -0.55, -0.14, -2.60], deviation: [1.50, 0.30, 0.49, 1.08] },
    Prior { mean: [0.92, -4.47, -1.19, -4.26], deviation: [1.50, 1.00, 0.70, 1.13] },
    Prior { mean: [1.69, -3.60, 0.56, -5.95], deviation: [1.50, 1.00, 0.70, 1.37] },
    Prior { mean: [-0.82, -0.73, 0.56, -5.50], deviation: [1.21, 0.30, 0.70, 1.50] },
    Prior { mean: [-0.29, -1.56, 0.53, -5.49], deviation: [1.34, 0.40, 0.70, 1.50] },
    Prior { mean: [0.91, -0.86, 1.00, -4.02], deviation: [1.50, 0.49, 0.70, 1.50] },
    Prior { mean: [0.69, -1.88, 0.41, -5.26], deviation: [1.45, 0.30, 0.61, 1.15] },
    Prior { mean: [0.73, -2.35, 0.62, -5.73], deviation: [0.71, 0.30, 0.67, 1.37] },
];

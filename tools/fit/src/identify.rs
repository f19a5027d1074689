//! Identification of the five parameters that a force trace determines, by variable projection.
//!
//! The parameters are those of [`ForceLaw`]. For a given shape (the exponents n and m, and `max_ratio`, the largest area divided
//! by pi A B) the force is linear in K and G, and the best values of K and G within bounds follow from a 2 x 2 system. The
//! identification has three stages. The first evaluates a grid over the shape. The second searches over the shape, from the best
//! points of the grid. The third searches over all five parameters, and sets tensile force to 0 as the device does. The result
//! is deterministic.

use crate::bounded::{self, Residuals};
use crate::law::{Column, Deformation, Shape};
use crate::samples::Samples;
use nalgebra::DVector;
use plantar::pipeline::model::ForceLaw;

/// Bounds of the parameters. They are this project's choice, because those of the paper (its Appendix A) are not published.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Largest area divided by pi A B, above 0 and below 1.
    pub max_ratio: [f64; 2],
    /// K, Pa.
    pub stiffness_pa: [f64; 2],
    /// G, Pa s.
    pub damping_pa_s: [f64; 2],
    /// Stiffness exponent.
    pub n: [f64; 2],
    /// Damping exponent.
    pub m: [f64; 2],
}

impl Bounds {
    /// Smallest bound of the stiffness exponent. With an exponent of -1 or less, pressure would not approach 0 as the
    /// contact vanishes.
    pub const LEAST_N: f64 = -0.95;

    /// Bounds for a comparison with the paper, in which the exponents are positive; it does not state its bounds. They allow pi A
    /// B to be 1 to 8.3 times the largest area. If it were larger, the ellipsoid would be so flat that force is nearly a power of
    /// area, and A B and K could not be separated.
    pub const PAPER: Self = Self {
        max_ratio: [0.12, 0.999_999],
        stiffness_pa: [1e4, 1e7],
        damping_pa_s: [0.0, 1e6],
        n: [0.0, 5.0],
        m: [0.0, 5.0],
    };

    /// The default bounds: n may be negative, down to [`Bounds::LEAST_N`], because measured force often grows more slowly than
    /// the square of the area. A negative n then means that the area is no measure of the indentation, not that tissue becomes
    /// softer.
    pub const USUAL: Self = Self { n: [Self::LEAST_N, 5.0], ..Self::PAPER };
}

/// The identified parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Identified {
    /// `max_ratio`, n and m.
    pub shape: Shape,
    /// K, Pa.
    pub stiffness_pa: f64,
    /// G, Pa s.
    pub damping_pa_s: f64,
    /// Sum of the squared NRMSE (Eq. 20) of the steps: see [`Samples`].
    pub squares: f64,
    /// Number of evaluations of the model over all samples.
    pub evaluations: usize,
}

impl Identified {
    /// The parameters in the order in which the search uses them: `max_ratio`, n, m, K, G.
    pub(crate) fn x(&self) -> [f64; 5] {
        [self.shape.max_ratio, self.shape.n, self.shape.m, self.stiffness_pa, self.damping_pa_s]
    }

    fn from(minimum: &bounded::Minimum, evaluations: usize) -> Self {
        let x = &minimum.x;
        Self {
            shape: Shape { max_ratio: x[0], n: x[1], m: x[2] },
            stiffness_pa: x[3],
            damping_pa_s: x[4],
            squares: minimum.squares,
            evaluations: evaluations + minimum.evaluations,
        }
    }

    /// The same A B, K, G, n and m, for samples whose largest area is `to_m2` instead of `from_m2`, m2. Only `max_ratio`
    /// differs. If `max_ratio` is limited to its upper bound, A B becomes larger.
    pub(crate) fn rebased(&self, from_m2: f64, to_m2: f64) -> Self {
        let max_ratio = (to_m2 / from_m2 * self.shape.max_ratio).min(Bounds::USUAL.max_ratio[1]);
        Self { shape: Shape { max_ratio, ..self.shape }, ..*self }
    }

    /// The force law that a device evaluates. `c_m` is the radius C, m, which only scales the displayed deformation.
    pub fn law(&self, area_max_m2: f64, c_m: f64) -> ForceLaw<f64> {
        ForceLaw {
            ab_m2: self.shape.ab_m2(area_max_m2),
            c_m,
            stiffness_pa: self.stiffness_pa,
            damping_pa_s: self.damping_pa_s,
            n: self.shape.n,
            m: self.shape.m,
        }
    }
}

/// The grid over the shape: values of `max_ratio`, and for the exponents positions between their bounds, from 0 to 1.
const MAX_RATIO_GRID: [f64; 5] = [0.28, 0.64, 0.88, 0.98, 0.999];
/// See [`MAX_RATIO_GRID`].
const N_GRID: [f64; 5] = [0.0, 0.1, 0.25, 0.5, 0.8];
/// See [`MAX_RATIO_GRID`].
const M_GRID: [f64; 3] = [0.05, 0.25, 0.6];
/// Number of points of the grid from which searches over the shape start.
const STARTS: usize = 3;

/// Relative tolerance of a fit that yields reported parameters.
const FIT_TOLERANCE: f64 = 1e-12;
/// Relative tolerance of a fit that starts from a fit to almost the same data: see [`refine`] and
/// [`crate::prior::Prior::refine`].
pub(crate) const REFINE_TOLERANCE: f64 = 1e-6;

/// Identifies the parameters of one region.
pub fn identify(samples: &Samples, bounds: &Bounds) -> Identified {
    let (starts, mut evaluations) = grid(samples, bounds);
    let mut projected = ProjectedForce::new(samples, bounds);
    let [least, most] = limits(bounds);
    let mut best: Option<bounded::Minimum> = None;
    for start in starts {
        let x = [start.max_ratio, start.n, start.m];
        let minimum = bounded::minimise(&mut projected, &x, &least[..3], &most[..3], FIT_TOLERANCE);
        evaluations += minimum.evaluations;
        if best.as_ref().is_none_or(|best| minimum.squares < best.squares) {
            best = Some(minimum);
        }
    }
    // The grid always has a best point.
    let shape = best.map_or(vec![0.5, 1.0, 1.0], |best| best.x);
    projected.set(&shape);
    let x = [shape[0], shape[1], shape[2], projected.linear[0], projected.linear[1]];
    search_all(samples, bounds, x, FIT_TOLERANCE, evaluations + 1)
}

/// The third stage, the search over all five parameters from `x`. `evaluations` is the number of evaluations of the model in the
/// stages before it.
fn search_all(samples: &Samples, bounds: &Bounds, x: [f64; 5], tolerance: f64, evaluations: usize) -> Identified {
    let [least, most] = limits(bounds);
    let minimum = bounded::minimise(&mut NonNegativeForce::new(samples), &x, &least, &most, tolerance);
    Identified::from(&minimum, evaluations)
}

/// Performs only the third stage, from parameters that are close to the minimum.
pub(crate) fn converge(samples: &Samples, bounds: &Bounds, near: &Identified) -> Identified {
    search_all(samples, bounds, near.x(), FIT_TOLERANCE, 0)
}

/// Performs only the third stage, the search over all five parameters, from one point. It is for comparison with [`identify`],
/// and may end in a local minimum. `start` contains numbers between 0, the lower bound, and 1, the upper bound, in the order
/// `max_ratio`, n, m, K, G. The scale of K is logarithmic.
pub fn identify_from(samples: &Samples, bounds: &Bounds, start: [f64; 5]) -> Identified {
    let [least, most] = limits(bounds);
    let at = |i: usize| match i {
        3 => least[i] * (most[i] / least[i]).powf(start[i]),
        _ => least[i] + start[i] * (most[i] - least[i]),
    };
    search_all(samples, bounds, std::array::from_fn(at), FIT_TOLERANCE, 0)
}

/// Refines parameters that are already close to the minimum, without a prior.
pub(crate) fn refine(samples: &Samples, bounds: &Bounds, near: &Identified) -> Identified {
    search_all(samples, bounds, near.x(), REFINE_TOLERANCE, 0)
}

/// Lower and upper bounds in the order of the search: `max_ratio`, n, m, K, G.
pub(crate) fn limits(bounds: &Bounds) -> [[f64; 5]; 2] {
    [0, 1].map(|i| [bounds.max_ratio[i], bounds.n[i], bounds.m[i], bounds.stiffness_pa[i], bounds.damping_pa_s[i]])
}

/// The best points of the grid over the shape, and the number of points of the grid.
fn grid(samples: &Samples, bounds: &Bounds) -> (Vec<Shape>, usize) {
    let at = |range: [f64; 2], share: f64| range[0] + share * (range[1] - range[0]);
    let mut deformation = Deformation::default();
    let mut elastic: [Column; N_GRID.len()] = Default::default();
    let mut viscous: [Column; M_GRID.len()] = Default::default();
    let mut points = Vec::new();
    for max_ratio in MAX_RATIO_GRID {
        deformation.set(samples, max_ratio);
        for (column, share) in elastic.iter_mut().zip(N_GRID) {
            deformation.elastic(at(bounds.n, share), column);
        }
        for (column, share) in viscous.iter_mut().zip(M_GRID) {
            deformation.viscous(at(bounds.m, share), column);
        }
        for (elastic, n) in elastic.iter().zip(N_GRID) {
            for (viscous, m) in viscous.iter().zip(M_GRID) {
                let (_, squares) = linear(&elastic.force, &viscous.force, &samples.target, bounds);
                points.push((squares, Shape { max_ratio, n: at(bounds.n, n), m: at(bounds.m, m) }));
            }
        }
    }
    let count = points.len();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    // No two starts have the same `max_ratio`, because starts that differ only in the exponents lead to the same minimum.
    let mut starts: Vec<Shape> = Vec::new();
    for (_, point) in points {
        if starts.len() < STARTS && starts.iter().all(|start| start.max_ratio != point.max_ratio) {
            starts.push(point);
        }
    }
    (starts, count)
}

/// The K and G within their bounds for which the sum of squares is smallest, and this sum. They are the unconstrained solution
/// if it is within the bounds, otherwise the best point at a bound. `elastic` is the elastic term of the force for K = 1 Pa,
/// `viscous` the viscous term for G = 1 Pa s, and `target` the measured force; all three are weighted.
fn linear(elastic: &[f64], viscous: &[f64], target: &[f64], bounds: &Bounds) -> ([f64; 2], f64) {
    let (mut ee, mut ev, mut vv, mut ef, mut vf, mut ff) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for ((&e, &v), &f) in elastic.iter().zip(viscous).zip(target) {
        ee += e * e;
        ev += e * v;
        vv += v * v;
        ef += e * f;
        vf += v * f;
        ff += f * f;
    }
    let squares = |k: f64, g: f64| ff - 2.0 * (k * ef + g * vf) + k * k * ee + 2.0 * k * g * ev + g * g * vv;
    let [k_range, g_range] = [bounds.stiffness_pa, bounds.damping_pa_s];
    let clamp =
        |value: f64, range: [f64; 2]| if value.is_finite() { value.clamp(range[0], range[1]) } else { range[0] };
    let determinant = ee * vv - ev * ev;
    let k = (ef * vv - vf * ev) / determinant;
    let g = (vf * ee - ef * ev) / determinant;
    if determinant > 0.0 && k == clamp(k, k_range) && g == clamp(g, g_range) {
        return ([k, g], squares(k, g));
    }
    let on_k = k_range.map(|k| [k, clamp((vf - k * ev) / vv, g_range)]);
    let on_g = g_range.map(|g| [clamp((ef - g * ev) / ee, k_range), g]);
    let candidates = on_k.into_iter().chain(on_g).map(|[k, g]| ([k, g], squares(k, g)));
    candidates.fold(([k_range[0], g_range[0]], f64::INFINITY), |best, next| if next.1 < best.1 { next } else { best })
}

/// The force as a function of the shape. For each shape, K and G have their best values. Tensile force is not set to 0.
struct ProjectedForce<'s> {
    samples: &'s Samples,
    bounds: &'s Bounds,
    deformation: Deformation,
    elastic: Column,
    viscous: Column,
    /// The best K and G for the current shape.
    linear: [f64; 2],
}

impl<'s> ProjectedForce<'s> {
    fn new(samples: &'s Samples, bounds: &'s Bounds) -> Self {
        Self {
            samples,
            bounds,
            deformation: Deformation::default(),
            elastic: Column::default(),
            viscous: Column::default(),
            linear: [0.0; 2],
        }
    }
}

impl Residuals for ProjectedForce<'_> {
    fn set(&mut self, x: &[f64]) {
        self.deformation.set(self.samples, x[0]);
        self.deformation.elastic(x[1], &mut self.elastic);
        self.deformation.viscous(x[2], &mut self.viscous);
        (self.linear, _) = linear(&self.elastic.force, &self.viscous.force, &self.samples.target, self.bounds);
    }

    fn residuals(&self) -> DVector<f64> {
        let [k, g] = self.linear;
        let force = self.elastic.force.iter().zip(&self.viscous.force).map(|(e, v)| k * e + g * v);
        DVector::from_iterator(self.samples.len(), force.zip(&self.samples.target).map(|(f, measured)| f - measured))
    }

    /// The derivative in Kaufman's approximation: the derivative at constant K and G, without the part that a change of K and G
    /// compensates.
    fn derivative(&self, i: usize) -> DVector<f64> {
        let [k, g] = self.linear;
        let mut column: Vec<f64> = match i {
            0 => self.elastic.by_max_ratio.iter().zip(&self.viscous.by_max_ratio).map(|(e, v)| k * e + g * v).collect(),
            1 => self.elastic.by_exponent.iter().map(|e| k * e).collect(),
            _ => self.viscous.by_exponent.iter().map(|v| g * v).collect(),
        };
        let is_free = |value: f64, range: [f64; 2]| value > range[0] && value < range[1];
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (e, v) = (&self.elastic.force[..], &self.viscous.force[..]);
        let (ec, vc) = (dot(e, &column), dot(v, &column));
        let (ee, ev, vv) = (dot(e, e), dot(e, v), dot(v, v));
        let [along_e, along_v] = match (is_free(k, self.bounds.stiffness_pa), is_free(g, self.bounds.damping_pa_s)) {
            (true, true) => {
                let determinant = ee * vv - ev * ev;
                [(ec * vv - vc * ev) / determinant, (vc * ee - ec * ev) / determinant]
            }
            (true, false) => [ec / ee, 0.0],
            (false, true) => [0.0, vc / vv],
            (false, false) => [0.0, 0.0],
        };
        if along_e.is_finite() && along_v.is_finite() {
            for ((column, e), v) in column.iter_mut().zip(e).zip(v) {
                *column -= along_e * e + along_v * v;
            }
        }
        DVector::from_vec(column)
    }
}

/// The force as a function of all five parameters. As on the device, tensile force is set to 0.
pub(crate) struct NonNegativeForce<'s> {
    samples: &'s Samples,
    deformation: Deformation,
    elastic: Column,
    viscous: Column,
    x: [f64; 5],
    force: Vec<f64>,
}

impl<'s> NonNegativeForce<'s> {
    /// The weighted force of each sample.
    pub fn force(&self) -> &[f64] {
        &self.force
    }

    /// Creates the function without parameters; [`Residuals::set`] sets them.
    pub fn new(samples: &'s Samples) -> Self {
        Self {
            samples,
            deformation: Deformation::default(),
            elastic: Column::default(),
            viscous: Column::default(),
            x: [0.0; 5],
            force: Vec::new(),
        }
    }
}

impl Residuals for NonNegativeForce<'_> {
    fn set(&mut self, x: &[f64]) {
        self.x.copy_from_slice(x);
        self.deformation.set(self.samples, x[0]);
        self.deformation.elastic(x[1], &mut self.elastic);
        self.deformation.viscous(x[2], &mut self.viscous);
        self.force.clear();
        let sum = self.elastic.force.iter().zip(&self.viscous.force).map(|(e, v)| (x[3] * e + x[4] * v).max(0.0));
        self.force.extend(sum);
    }

    fn residuals(&self) -> DVector<f64> {
        let difference = self.force.iter().zip(&self.samples.target).map(|(f, measured)| f - measured);
        DVector::from_iterator(self.samples.len(), difference)
    }

    fn derivative(&self, i: usize) -> DVector<f64> {
        let [_, _, _, k, g] = self.x;
        let (e, v) = (&self.elastic, &self.viscous);
        let value = |j: usize| match i {
            0 => k * e.by_max_ratio[j] + g * v.by_max_ratio[j],
            1 => k * e.by_exponent[j],
            2 => g * v.by_exponent[j],
            3 => e.force[j],
            _ => v.force[j],
        };
        let derivative = |j: usize| if self.force[j] > 0.0 { value(j) } else { 0.0 };
        DVector::from_iterator(self.samples.len(), (0..self.samples.len()).map(derivative))
    }
}

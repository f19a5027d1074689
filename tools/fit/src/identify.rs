//! The five parameters that a force trace can tell, by variable projection.
//!
//! For a given shape (reach, n, m) the force is linear in K and G: their best values within bounds follow from a two by two
//! system. A grid over the shape, then a search over it from the best points, then one over all five with the law as the
//! device evaluates it, tensile force cut. Nothing is random.

use crate::bounded::{self, Residuals};
use crate::law::{Column, Deformation, Shape};
use crate::samples::Samples;
use nalgebra::DVector;
use plantar::pipeline::model::ForceLaw;

/// Within what the parameters are sought. Ours: the paper's own (its Appendix A) are not published.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Largest area over pi A B, below 1.
    pub reach: [f64; 2],
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
    /// The least stiffness exponent at all: below -1 force would not vanish with contact.
    pub const LEAST_N: f64 = -0.95;

    /// The usual ones. pi A B is at least the largest area and at most 8.3 times that: towards a flatter ellipsoid force becomes
    /// a power of area, in which A B and K cannot be told apart any more.
    pub const USUAL: Self = Self {
        reach: [0.12, 0.999_999],
        stiffness_pa: [1e4, 1e7],
        damping_pa_s: [0.0, 1e6],
        n: [0.0, 5.0],
        m: [0.0, 5.0],
    };
}

/// What was identified.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Identified {
    /// reach, n and m.
    pub shape: Shape,
    /// K, Pa.
    pub stiffness_pa: f64,
    /// G, Pa s.
    pub damping_pa_s: f64,
    /// Sum over the steps of their squared NRMSE (Eq. 18 over the peak force, see [`Samples`]).
    pub squares: f64,
    /// How often the model was evaluated over all samples.
    pub evaluations: usize,
}

impl Identified {
    pub(crate) fn x(&self) -> [f64; 5] {
        [self.shape.reach, self.shape.n, self.shape.m, self.stiffness_pa, self.damping_pa_s]
    }

    fn from(minimum: &bounded::Minimum, evaluations: usize) -> Self {
        let x = &minimum.x;
        Self {
            shape: Shape { reach: x[0], n: x[1], m: x[2] },
            stiffness_pa: x[3],
            damping_pa_s: x[4],
            squares: minimum.squares,
            evaluations: evaluations + minimum.evaluations,
        }
    }

    /// The same A B for samples of another largest area.
    pub(crate) fn rebased(&self, from_m2: f64, to_m2: f64, bounds: &Bounds) -> Self {
        let reach = (to_m2 / from_m2 * self.shape.reach).clamp(bounds.reach[0], bounds.reach[1]);
        Self { shape: Shape { reach, ..self.shape }, ..*self }
    }

    /// What a device evaluates; `c_m` only scales the deformation that it shows.
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

const REACH_GRID: [f64; 5] = [0.28, 0.64, 0.88, 0.98, 0.999];
/// Shares of the bounds.
const N_GRID: [f64; 5] = [0.0, 0.1, 0.25, 0.5, 0.8];
const M_GRID: [f64; 3] = [0.05, 0.25, 0.6];
/// Points of the grid from which the shape is sought on.
const STARTS: usize = 3;

/// Relative tolerances of a search.
const EXACT: f64 = 1e-12;
const REFINED: f64 = 1e-6;

/// Fits one region.
pub fn identify(samples: &Samples, bounds: &Bounds) -> Identified {
    let (starts, mut evaluations) = grid(samples, bounds);
    let mut projected = Projected::new(samples, bounds);
    let [least, most] = limits(bounds);
    let mut best: Option<bounded::Minimum> = None;
    for start in starts {
        let x = [start.reach, start.n, start.m];
        let minimum = bounded::minimise(&mut projected, &x, &least[..3], &most[..3], EXACT);
        evaluations += minimum.evaluations;
        if best.as_ref().is_none_or(|best| minimum.squares < best.squares) {
            best = Some(minimum);
        }
    }
    // There is always a start.
    let shape = best.map_or(vec![0.5, 1.0, 1.0], |best| best.x);
    projected.set(&shape);
    let x = [shape[0], shape[1], shape[2], projected.linear[0], projected.linear[1]];
    let minimum = bounded::minimise(&mut Cut::new(samples), &x, &least, &most, EXACT);
    Identified::from(&minimum, evaluations + 1)
}

/// The search over all five alone, from one point within the bounds: `start` are shares of them, 0 to 1, in the order reach,
/// n, m, K, G; K in logarithms. It may end in a lesser minimum: for comparison.
pub fn identify_from(samples: &Samples, bounds: &Bounds, start: [f64; 5]) -> Identified {
    let [least, most] = limits(bounds);
    let at = |i: usize| match i {
        3 => least[i] * (most[i] / least[i]).powf(start[i]),
        _ => least[i] + start[i] * (most[i] - least[i]),
    };
    let x: [f64; 5] = std::array::from_fn(at);
    let minimum = bounded::minimise(&mut Cut::new(samples), &x, &least, &most, EXACT);
    Identified::from(&minimum, 0)
}

/// Goes on from parameters that are near already.
pub(crate) fn refine(samples: &Samples, bounds: &Bounds, near: &Identified) -> Identified {
    let [least, most] = limits(bounds);
    let minimum = bounded::minimise(&mut Cut::new(samples), &near.x(), &least, &most, REFINED);
    Identified::from(&minimum, 0)
}

pub(crate) fn limits(bounds: &Bounds) -> [[f64; 5]; 2] {
    [0, 1].map(|i| [bounds.reach[i], bounds.n[i], bounds.m[i], bounds.stiffness_pa[i], bounds.damping_pa_s[i]])
}

/// The best points of a grid over the shape, and how many there were.
fn grid(samples: &Samples, bounds: &Bounds) -> (Vec<Shape>, usize) {
    let at = |range: [f64; 2], share: f64| range[0] + share * (range[1] - range[0]);
    let mut deformation = Deformation::default();
    let mut elastic: [Column; N_GRID.len()] = Default::default();
    let mut viscous: [Column; M_GRID.len()] = Default::default();
    let mut points = Vec::new();
    for reach in REACH_GRID {
        deformation.set(samples, reach);
        for (column, share) in elastic.iter_mut().zip(N_GRID) {
            deformation.elastic(at(bounds.n, share), column);
        }
        for (column, share) in viscous.iter_mut().zip(M_GRID) {
            deformation.viscous(at(bounds.m, share), column);
        }
        for (elastic, n) in elastic.iter().zip(N_GRID) {
            for (viscous, m) in viscous.iter().zip(M_GRID) {
                let (_, squares) = linear(&elastic.force, &viscous.force, &samples.target, bounds);
                points.push((squares, Shape { reach, n: at(bounds.n, n), m: at(bounds.m, m) }));
            }
        }
    }
    let count = points.len();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    // One start a reach: points that differ only in the exponents end in the same place.
    let mut starts: Vec<Shape> = Vec::new();
    for (_, point) in points {
        if starts.len() < STARTS && starts.iter().all(|start| start.reach != point.reach) {
            starts.push(point);
        }
    }
    (starts, count)
}

/// K and G within bounds with the least squares, and the squares: the free solution, or the best on the bounds' edges.
fn linear(elastic: &[f64], viscous: &[f64], force_n: &[f64], bounds: &Bounds) -> ([f64; 2], f64) {
    let (mut ee, mut ev, mut vv, mut ef, mut vf, mut ff) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for ((&e, &v), &f) in elastic.iter().zip(viscous).zip(force_n) {
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

/// The force as the formula gives it, over the shape, with K and G projected out.
struct Projected<'s> {
    samples: &'s Samples,
    bounds: &'s Bounds,
    deformation: Deformation,
    elastic: Column,
    viscous: Column,
    linear: [f64; 2],
}

impl<'s> Projected<'s> {
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

impl Residuals for Projected<'_> {
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

    /// Kaufman's form: what K and G would take up at once is taken out.
    fn derivative(&self, i: usize) -> DVector<f64> {
        let [k, g] = self.linear;
        let mut column: Vec<f64> = match i {
            0 => self.elastic.by_reach.iter().zip(&self.viscous.by_reach).map(|(e, v)| k * e + g * v).collect(),
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

/// The force as the device gives it, over all five parameters: tensile force is cut to 0.
pub(crate) struct Cut<'s> {
    samples: &'s Samples,
    deformation: Deformation,
    elastic: Column,
    viscous: Column,
    x: [f64; 5],
    force: Vec<f64>,
}

impl<'s> Cut<'s> {
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

impl Residuals for Cut<'_> {
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
            0 => k * e.by_reach[j] + g * v.by_reach[j],
            1 => k * e.by_exponent[j],
            2 => g * v.by_exponent[j],
            3 => e.force[j],
            _ => v.force[j],
        };
        let uncut = |j: usize| if self.force[j] > 0.0 { value(j) } else { 0.0 };
        DVector::from_iterator(self.samples.len(), (0..self.samples.len()).map(uncut))
    }
}

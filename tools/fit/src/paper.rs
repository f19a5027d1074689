//! The identification of the paper, for comparison. A general solver searches eight variables within bounds from several random
//! starts. It minimises the sum of Eq. 18 with the penalty of Eq. 19.
//!
//! The bounds of the paper and its penalty factor P are not published; the values here are this project's choice. The
//! logarithms of k and c are searched instead of k and c, because otherwise the solver rarely converges. The constraint that
//! pi A B exceeds every contact area is not stated in the paper and is not enforced here. If a result violates it, the device
//! flags the step as clamped.

use crate::Samples;
use crate::fixed::{FixedParameters, Scale};
use plantar::pipeline::model::{Ellipsoid, ForceLaw};
use std::cell::Cell;

/// Number of random starts. The result is the best of the minima.
pub const STARTS: u64 = 10;

/// Bounds of A, B, C and d0 (in metres), ln k, the exponent n, ln c and the exponent m, for the European size 42. The lengths
/// are scaled to the size, as the bounds of the paper depend on the insole size.
const BOUNDS: [(f64, f64); 8] = [
    (0.002, 0.08),
    (0.002, 0.08),
    (0.002, 0.03),
    (0.004, 0.025),
    (11.5, 25.3), // 1e5 to 1e11 N/m3
    (0.0, 5.0),
    (6.9, 23.0), // 1e3 to 1e10 N s/m3
    (0.0, 5.0),
];
/// The factor P of Eq. 19, 1/N.
const PENALTY_PER_N: f64 = 1.0;
/// Largest number of points that a search evaluates, those of its line searches included. The evaluations for the finite
/// differences do not count.
const MAX_POINTS: usize = 200;
/// Relative change of the sum of squares below which a search ends.
const TOLERANCE: f64 = 1e-9;
/// Step of the finite differences, as a fraction of the range of a variable.
const DIFFERENCE: f64 = 1e-7;

type Constraint = fn(&[f64], Option<&mut [f64]>, &mut ()) -> f64;
/// The solver also accepts constraints, but only bounds are used.
const UNCONSTRAINED: &[Constraint] = &[];

/// The bounds for a foot. `size_scale` is its length divided by that of a foot of size 42.
fn bounds(size_scale: f64) -> [(f64, f64); 8] {
    let mut bounds = BOUNDS;
    for (least, most) in &mut bounds[..4] {
        *least *= size_scale;
        *most *= size_scale;
    }
    bounds
}

/// The best ellipsoid, and the number of evaluations of the model. `size_scale` is the length of the foot divided by that of a
/// foot of size 42.
pub fn identify(samples: &Samples, size_scale: f64) -> (Ellipsoid<f64>, usize) {
    let bounds = bounds(size_scale);
    let evaluations = Cell::new(0);
    let objective = |x: &[f64]| {
        evaluations.set(evaluations.get() + 1);
        squares(samples, &ellipsoid(x))
    };
    let with_gradient = |x: &[f64], gradient: Option<&mut [f64]>, _: &mut ()| {
        let here = objective(x);
        if let Some(gradient) = gradient {
            for i in 0..x.len() {
                let mut neighbour = x.to_vec();
                let step = DIFFERENCE * (bounds[i].1 - bounds[i].0);
                neighbour[i] += if x[i] + step > bounds[i].1 { -step } else { step };
                gradient[i] = (objective(&neighbour) - here) / (neighbour[i] - x[i]);
            }
        }
        here
    };
    let mut best = (f64::INFINITY, bounds.map(|(least, most)| (least + most) / 2.0).to_vec());
    for seed in 0..STARTS {
        let mut random = fastrand::Rng::with_seed(seed);
        let start = bounds.map(|(least, most)| least + random.f64() * (most - least));
        let tolerances = slsqp::StopTols { ftol_rel: TOLERANCE, ..Default::default() };
        let ended = slsqp::minimize(with_gradient, &start, &bounds, UNCONSTRAINED, (), MAX_POINTS, Some(tolerances));
        // A search that fails, for example because of rounding errors, returns its best point, too.
        let (x, value) = match ended {
            Ok((_, x, value)) => (x, value),
            Err((_, x, value)) => (x, value),
        };
        if value < best.0 {
            best = (value, x);
        }
    }
    (ellipsoid(&best.1), evaluations.get())
}

/// The ellipsoid of a point in the space of [`BOUNDS`].
fn ellipsoid(x: &[f64]) -> Ellipsoid<f64> {
    Ellipsoid { a_m: x[0], b_m: x[1], c_m: x[2], d0_m: x[3], k: x[4].exp(), n: x[5], c: x[6].exp(), m: x[7] }
}

/// The sum of Eq. 18 with the penalty of Eq. 19 exactly as printed, although this reduces the magnitude of a small negative
/// force (docs/identification.md). Each residual is multiplied by its weight, see [`Samples`].
fn squares(samples: &Samples, ellipsoid: &Ellipsoid<f64>) -> f64 {
    let mut sum = 0.0;
    for (i, (g, rate_per_s)) in samples.deformation(&ellipsoid.force_law()).enumerate() {
        let force_n = ellipsoid.force_n(ellipsoid.c_m * g, ellipsoid.c_m * rate_per_s);
        let force_n = if force_n < 0.0 { force_n + PENALTY_PER_N * force_n * force_n } else { force_n };
        let residual = (force_n - samples.force_n[i]) * samples.weight[i];
        sum += residual * residual;
    }
    sum
}

/// The values of A/B, C and d0 of an ellipsoid of which all eight parameters were searched. `law` is its force law, and `g_max`
/// its largest normalised deformation.
pub(crate) fn fixed_parameters(ellipsoid: &Ellipsoid<f64>, law: &ForceLaw<f64>, g_max: f64) -> FixedParameters {
    FixedParameters {
        aspect: ellipsoid.a_m / ellipsoid.b_m,
        thickness_m: ellipsoid.d0_m,
        is_thickness_measured: false,
        scale: Scale::Searched(law.c_m * g_max / ellipsoid.d0_m),
    }
}

//! Least squares within bounds. The Levenberg-Marquardt method searches over the free parameters, while the other parameters are
//! held at their bounds.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned};

/// A least-squares problem: residuals and their derivatives at a point.
pub(crate) trait Residuals {
    /// Sets the parameters to `x`, which is within the bounds.
    fn set(&mut self, x: &[f64]);
    /// The residuals at these parameters, one for each sample.
    fn residuals(&self) -> DVector<f64>;
    /// The derivatives of the residuals with respect to parameter `i`, one for each sample.
    fn derivative(&self, i: usize) -> DVector<f64>;
}

/// The result of a search.
#[derive(Clone, Debug)]
pub(crate) struct Minimum {
    /// The parameters.
    pub x: Vec<f64>,
    /// Sum of the squared residuals.
    pub squares: f64,
    /// Number of evaluations of the residuals.
    pub evaluations: usize,
}

/// Largest number of rounds. A round ends at the minimum over its free parameters. After each round, parameters that reached a
/// bound are held there, and held parameters may be released. Two or three rounds usually suffice.
const ROUNDS: usize = 8;

/// Searches from `x` until an iteration changes the parameters or the sum of squares by less than the relative `tolerance`.
/// `least` and `most` are the bounds of the parameters. The result is deterministic.
pub(crate) fn minimise(
    problem: &mut impl Residuals,
    x: &[f64],
    least: &[f64],
    most: &[f64],
    tolerance: f64,
) -> Minimum {
    let mut x: Vec<f64> = (0..x.len()).map(|i| x[i].clamp(least[i], most[i])).collect();
    let mut free = vec![true; x.len()];
    let mut evaluations = 0;
    let search = LevenbergMarquardt::new().with_tol(tolerance).with_gtol(tolerance).with_patience(20);
    let mut squares = f64::INFINITY;
    problem.set(&x);
    evaluations += 1;
    for _ in 0..ROUNDS {
        let round = Round { problem, x: x.clone(), unclamped: x.clone(), free: free.clone(), least, most };
        let (round, report) = search.minimize(round);
        evaluations += report.number_of_evaluations;
        let end = round.x;
        // Evaluated again, so that the result is that of the accepted point however the search has ended.
        problem.set(&end);
        evaluations += 1;
        let residuals = problem.residuals();
        let before = std::mem::replace(&mut squares, residuals.norm_squared());
        x = end;
        let mut changed = false;
        for i in 0..x.len() {
            let will_be_free = if x[i] > least[i] && x[i] < most[i] {
                true
            } else {
                // A parameter at a bound is released if the sum of squares decreases towards the inside of the bounds.
                let slope = problem.derivative(i).dot(&residuals);
                if x[i] <= least[i] { slope < 0.0 } else { slope > 0.0 }
            };
            changed |= will_be_free != free[i];
            free[i] = will_be_free;
        }
        if !changed || (before - squares).abs() <= tolerance * squares {
            break;
        }
    }
    Minimum { x, squares, evaluations }
}

/// A round of the search over the free parameters. A parameter that exceeds a bound is evaluated at the bound.
struct Round<'p, P> {
    problem: &'p mut P,
    /// The parameters at which the problem is evaluated, which are within the bounds.
    x: Vec<f64>,
    /// The parameters as the search sets them, which may exceed the bounds.
    unclamped: Vec<f64>,
    free: Vec<bool>,
    least: &'p [f64],
    most: &'p [f64],
}

impl<P> Round<'_, P> {
    /// The indices of the free parameters.
    fn free(&self) -> impl Iterator<Item = usize> {
        (0..self.free.len()).filter(|&i| self.free[i])
    }
}

impl<P: Residuals> LeastSquaresProblem<f64, Dyn, Dyn> for Round<'_, P> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, free: &DVector<f64>) {
        let indices: Vec<usize> = self.free().collect();
        for (&i, &value) in indices.iter().zip(free.iter()) {
            self.unclamped[i] = value;
            self.x[i] = value.clamp(self.least[i], self.most[i]);
        }
        self.problem.set(&self.x);
    }

    fn params(&self) -> DVector<f64> {
        DVector::from_iterator(self.free().count(), self.free().map(|i| self.unclamped[i]))
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        Some(self.problem.residuals())
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let columns: Vec<_> = self
            .free()
            .map(|i| {
                let column = self.problem.derivative(i);
                // Beyond a bound, the residuals do not depend on the parameter.
                if self.unclamped[i] == self.x[i] { column } else { column * 0.0 }
            })
            .collect();
        Some(DMatrix::from_columns(&columns))
    }
}

//! Fits to hundreds or thousands of steps, as of an hour of walking. Results that further steps would not make more accurate are
//! computed from [`MANY`] of the steps, and fits to resampled steps follow from sums over each step.

use crate::Samples;
use crate::bounded::Residuals;
use crate::identify::{Identified, NonNegativeForce};
use crate::prior::{self, Coordinates, Prior};
use nalgebra::{Matrix5, Vector5};

/// With more steps than this number, the methods of this module are used. The page for a phone, which collects about 30 steps of
/// each foot, is compiled without the feature `parallel` and does not use them.
pub(crate) const MANY: usize = if cfg!(feature = "parallel") { 200 } else { usize::MAX };

/// At most [`MANY`] of these elements, evenly spaced, in their order.
pub(crate) fn spread<T: Copy>(all: &[T]) -> Vec<T> {
    let count = all.len().min(MANY);
    (0..count).map(|i| all[i * all.len() / count]).collect()
}

/// The slope and the curvature of the sum of squares of one step, or of the prior, at the fit to all steps.
#[derive(Clone, Copy)]
struct Sums {
    slope: Vector5<f64>,
    curvature: Matrix5<f64>,
}

/// The fit to all steps, from which a fit to resampled steps follows by one iteration of the Gauss-Newton method. The error of
/// the latter is of second order in the difference between the two fits, which is small if there are many steps.
pub(crate) struct Linearised {
    at: Coordinates,
    prior: Sums,
    steps: Vec<Sums>,
}

impl Linearised {
    /// `identified` are the most probable parameters for all samples, and `noise` is the variance of an independent residual.
    pub fn new(samples: &Samples, prior: &Prior, identified: &Identified, noise: f64) -> Self {
        let at = prior::coordinates(identified);
        let mut law = NonNegativeForce::new(samples);
        law.set(&identified.x());
        let residuals = law.residuals();
        let columns = prior::derivatives(&law, &at);
        let sums = samples.steps.iter().map(|step| {
            let column = |i: usize| columns[i].rows(step.start, step.len());
            let residuals = residuals.rows(step.start, step.len());
            Sums {
                slope: Vector5::from_fn(|i, _| column(i).dot(&residuals)),
                curvature: Matrix5::from_fn(|i, j| column(i).dot(&column(j))),
            }
        });
        let steps = sums.collect();
        // At its limit, a coordinate has no influence on the force, and remains there.
        let slope = prior.slope(&at) * noise;
        let slope = Vector5::from_fn(|i, _| if columns[i].iter().all(|by| *by == 0.0) { 0.0 } else { slope[i] });
        Self { at, prior: Sums { slope, curvature: prior.precision() * noise }, steps }
    }

    /// The most probable parameters if each step counts as many times as `times` states. The steps are those of the samples.
    pub fn fitted(&self, times: &[u32]) -> Identified {
        let Sums { mut slope, mut curvature } = self.prior;
        for (step, &times) in self.steps.iter().zip(times) {
            slope += step.slope * f64::from(times);
            curvature += step.curvature * f64::from(times);
        }
        prior::parameters(&(self.at - prior::inverse(&curvature) * slope), 0.0, 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Filter;
    use crate::identify::{Bounds, identify};
    use crate::interval::{drawn, noise};
    use crate::synthetic::{Noise, curves};

    /// Resamples of 240 steps, fitted by a search and by one step of Gauss and Newton. The scatter of the fits, of which the
    /// intervals are a multiple, is large compared with their differences.
    #[test]
    fn fits_to_resampled_steps_are_close_to_those_of_a_search() {
        const STEPS: usize = 240;
        for region in [0, 3, 6] {
            let mut source = Noise::new(region as u64 + 1);
            let size = |i: usize| 0.9 + 0.1 * (i % 7) as f64 / 6.0;
            let steps: Vec<_> =
                (0..STEPS).map(|i| curves(region, 100.0, Filter::Direct, size(i), 0.05, &mut source)).collect();
            let samples = Samples::new(&steps, Filter::Direct);
            let prior = &prior::WALKERS[region];
            let unconstrained = identify(&samples, &Bounds::USUAL);
            let noise = noise(&samples, &unconstrained).variance;
            let identified = prior.identify(&samples, &unconstrained, noise);
            let linearised = Linearised::new(&samples, prior, &identified, noise);
            let (mut scatter, mut differences) = (Coordinates::zeros(), Coordinates::zeros());
            for seed in 0..40 {
                let mut times = vec![0; STEPS];
                drawn(seed, STEPS).for_each(|i| times[i] += 1);
                let repeated = steps.iter().zip(times.iter().copied()).filter(|(_, times)| *times > 0);
                let resample = Samples::repeated(repeated, Filter::Direct);
                let near = identified.rebased(samples.area_max_m2, resample.area_max_m2);
                let searched = prior.converge(&resample, &near, noise);
                let searched = searched.rebased(resample.area_max_m2, samples.area_max_m2);
                let [searched, fitted] = [searched, linearised.fitted(&times)].map(|found| prior::coordinates(&found));
                let square = |x: Coordinates| x.component_mul(&x);
                scatter += square(searched - prior::coordinates(&identified));
                differences += square(fitted - searched);
            }
            for i in 0..5 {
                let ratio = (differences[i] / scatter[i]).sqrt();
                assert!(scatter[i] > 0.0 && ratio < 0.15, "region {region}, coordinate {i}: {ratio}");
            }
        }
    }

    #[test]
    fn spread_steps_are_in_order_and_end_near_the_last_one() {
        let all: Vec<usize> = (0..3600).collect();
        let few = spread(&all);
        assert!(few.len() == MANY && few.windows(2).all(|pair| pair[1] - pair[0] == 18), "{few:?}");
        assert_eq!(spread(&all[..MANY]), all[..MANY]);
    }
}

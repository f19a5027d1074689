//! The most probable parameters: they are at the maximum of the posterior density, agree with the true parameters of steps
//! without noise, and can be used from a single step on.

use fit::identify::{Bounds, identify};
use fit::measures::Quantity;
use fit::prior::{self, Coordinates, Prior, WALKERS};
use fit::synthetic::{Noise, curves, law, walk};
use fit::{Filter, Options, RegionCurves, Samples, interval};
use nalgebra::Matrix5;
use plantar::pipeline::model::ForceLaw;
use std::f64::consts::PI;

/// The negative logarithm of the posterior density, up to a constant, times 2 `noise`, by the force law of the insole. `noise`
/// is the variance of an independent residual.
fn objective(samples: &Samples, prior: &Prior, noise: f64, at: &Coordinates) -> f64 {
    let law: ForceLaw<f64> = prior::parameters(at, 0.0, 0).law(samples.area_max_m2, 0.01);
    let rows: Vec<[f64; 5]> = samples.table().collect();
    let g = |i: usize| {
        // An index beyond the last sample denotes the unloaded tissue.
        rows.get(i).map_or(0.0, |row| law.area_ratio(row[0]).normalised_deformation())
    };
    let mut squares = 0.0;
    for step in &samples.steps {
        let peak_n = rows[step.clone()].iter().map(|row| row[4]).fold(0.0, f64::max);
        let step_squares = rows[step.clone()].iter().enumerate().map(|(i, &[_, later, earlier, per_s, force_n])| {
            let rate_per_s = (g(later as usize) - g(earlier as usize)) * per_s;
            (law.force_n(g(step.start + i), rate_per_s) - force_n).powi(2)
        });
        squares += step_squares.sum::<f64>() / (peak_n * peak_n * step.len() as f64);
    }
    let shape = Prior::shape(at);
    let deviations = (0..4).map(|i| ((shape[i] - prior.mean[i]) / prior.deviation[i]).powi(2));
    squares + noise * deviations.sum::<f64>()
}

#[test]
fn no_point_nearby_or_far_away_is_more_probable() {
    let mut random = fastrand::Rng::with_seed(1);
    for (region, prior) in WALKERS.iter().enumerate() {
        let curves = curves(region, 100.0, Filter::Direct, 1.0, 0.05, &mut Noise::autocorrelated(7, 0.8));
        let samples = Samples::new([&curves], Filter::Direct);
        let unconstrained = identify(&samples, &Bounds::USUAL);
        let noise = interval::noise(&samples, &unconstrained).variance;
        let found = prior.identify(&samples, &unconstrained, noise);
        let at = prior::coordinates(&found);
        let least = objective(&samples, prior, noise, &at);
        for _ in 0..300 {
            let scale = 10f64.powf(-4.0 * random.f64());
            let other = at.map(|coordinate| coordinate + scale * 4.0 * (random.f64() - 0.5));
            let objective = objective(&samples, prior, noise, &other);
            assert!(objective >= least * (1.0 - 1e-7), "region {region}: {objective} < {least} at {other}, not {at}");
        }
    }
}

#[test]
fn exact_steps_overrule_the_prior() {
    for (region, prior) in WALKERS.iter().enumerate() {
        let curves = curves(region, 100.0, Filter::Direct, 1.0, 0.0, &mut Noise::new(1));
        let samples = Samples::new([&curves], Filter::Direct);
        let unconstrained = identify(&samples, &Bounds::USUAL);
        let noise = interval::noise(&samples, &unconstrained).variance;
        let found = interval::five(&prior.identify(&samples, &unconstrained, noise), samples.area_max_m2);
        let truth = law(region);
        let truth = [truth.ab_m2, truth.stiffness_pa, truth.damping_pa_s, truth.n, truth.m];
        for (found, truth) in found.into_iter().zip(truth) {
            assert!((found / truth - 1.0).abs() < 1e-4, "region {region}: {found} is not {truth}");
        }
    }
}

/// The forces follow, without noise, from the known law of a region, or from an ellipsoid whose pi A B is a hundred times the
/// largest area. The latter is beyond the bound of the search, at which pi A B is 1 + e^2 times the largest area.
#[test]
fn a_fit_that_ends_at_the_largest_ellipsoid_is_marked() {
    let options = Options::usual([0.012; 8]);
    let mut marked = [0; 2];
    for region in 0..8 {
        let mut step = walk(1, 100.0, Filter::Direct, 0.0, 1).remove(0);
        for marked in &mut marked {
            let fits = fit::fit_each_step(std::slice::from_ref(&step), region, &options);
            let [Ok(fit)] = &fits[..] else { panic!("no fit: {fits:?}") };
            let at_bound = fit.uncertainty.as_ref().expect("intervals").intervals[0].at_bound;
            let ratio = PI * fit.law.ab_m2 / fit.area_max_m2;
            assert_eq!(at_bound, ratio > 0.99 * (1.0 + 2f64.exp()), "region {region}: {ratio}");
            let is_named = |warning: &String| warning.starts_with("at a bound of the search: A B");
            assert_eq!(at_bound, fit.warnings.iter().any(is_named), "region {region}: {:?}", fit.warnings);
            *marked += usize::from(at_bound);

            let flat = ForceLaw { ab_m2: 100.0 * fit.area_max_m2 / PI, ..law(region) };
            replace_forces(&mut step.regions[region], &flat);
        }
    }
    assert!(marked[0] == 0 && marked[1] > 0, "{marked:?}");
}

/// Replaces the forces of a region by those of a law, with a peak of 100 N.
fn replace_forces(curves: &mut RegionCurves, law: &ForceLaw<f64>) {
    curves.force_n = fit::synthetic::forces(curves, Filter::Direct, law);
    let peak_n = curves.force_n.iter().copied().fold(0.0, f64::max);
    curves.force_n.iter_mut().for_each(|force_n| *force_n *= 100.0 / peak_n);
}

/// The forces follow, without noise, from a law with an exponent of 30. This is beyond the bound of the search, at which n is
/// e^2.3 more than its least value, and m is e^2.3.
#[test]
fn a_fit_that_ends_at_the_largest_exponent_is_marked() {
    let options = Options::usual([0.012; 8]);
    let bounds = [(3, "n", Bounds::LEAST_N + 2.3f64.exp()), (4, "m", 2.3f64.exp())];
    for (i, name, largest) in bounds {
        let mut marked = 0;
        for region in 0..8 {
            let mut step = walk(1, 100.0, Filter::Direct, 0.0, 1).remove(0);
            let steep = match name {
                "n" => ForceLaw { n: 30.0, ..law(region) },
                _ => ForceLaw { m: 30.0, ..law(region) },
            };
            replace_forces(&mut step.regions[region], &steep);
            let fits = fit::fit_each_step(std::slice::from_ref(&step), region, &options);
            let [Ok(fit)] = &fits[..] else { panic!("no fit: {fits:?}") };
            let interval = fit.uncertainty.as_ref().expect("intervals").intervals[i];
            assert_eq!(
                interval.at_bound,
                interval.value > 0.99 * largest,
                "{name}, region {region}: {}",
                interval.value
            );
            marked += usize::from(interval.at_bound);
        }
        assert!(marked > 0, "no fit ends at the largest {name}");
    }
}

/// With the standard deviations 0.1 and 0.2 of the logarithms and one degree of freedom, the ends of the intervals of K and G
/// differ by the factors 12.7 and 161.
#[test]
fn a_k_or_g_that_is_uncertain_by_a_factor_of_more_than_100_is_not_determined() {
    let prior = &WALKERS[0];
    let identified = prior::parameters(&Coordinates::new(2.0, -0.5, 0.0, 10.0, 7.0), 0.0, 0);
    let noise = interval::Noise { variance: 1.0, degrees_of_freedom: 1.0 };
    for (deviation, is_determined) in [(0.1_f64, true), (0.2, false)] {
        let covariance = Matrix5::identity() * deviation.powi(2);
        let uncertainty = interval::from_posterior(1e-3, prior, &identified, &noise, &covariance);
        for interval in &uncertainty.intervals[1..3] {
            assert_eq!(interval.is_identifiable, is_determined, "{interval:?}");
        }
    }
}

/// Each region is fitted to one step, and its quantities are less certain than with twenty steps.
#[test]
fn one_step_is_usable_and_less_certain() {
    let steps = walk(20, 100.0, Filter::Direct, 0.05, 3);
    let options = Options::usual([0.012; 8]);
    let [one, all] = [&steps[..1], &steps[..]].map(|steps| fit::fit(steps, &options, &|_| ()));
    for (region, (one, all)) in one.iter().zip(&all).enumerate() {
        let width = |fit: &Result<fit::RegionFit, fit::NotFitted>, quantity: Quantity| {
            let fit = fit.as_ref().expect("a fit");
            let measure = fit.measure(quantity).expect("a quantity");
            let [low, high] = measure.interval?;
            assert!(low <= measure.value && measure.value <= high, "region {region}: {measure:?}");
            Some(high / low)
        };
        let widths = |quantity| [one, all].map(|fit| width(fit, quantity));
        for quantity in [Quantity::AreaAtFixedForce(10.0), Quantity::SecantStiffness] {
            let [Some(one), Some(all)] = widths(quantity) else { panic!("{region}: {quantity:?} without interval") };
            assert!(one.is_finite() && one > all, "{region}: {one}, {all}");
        }
        // How much the largest area and the peak force differ between steps is unknown with one step.
        for quantity in [Quantity::ForceAtArea, Quantity::AreaAtForce(0.5)] {
            assert!(matches!(widths(quantity), [None, Some(_)]), "{region}: {:?}", widths(quantity));
        }
    }
}

/// People are drawn from a known distribution, and the distribution is estimated from their steps.
#[test]
fn the_distribution_of_a_cohort_is_learnt_from_its_steps() {
    let truth = Prior { mean: [0.5, -0.7, 0.0, -3.0], deviation: [0.4, 0.3, 0.3, 0.4] };
    let mut random = Noise::new(5);
    let cohort: Vec<Vec<fit::Step>> = (0..24)
        .map(|person| {
            let [logit, ln_n, ln_m, ln_tau]: [f64; 4] =
                std::array::from_fn(|i| truth.mean[i] + truth.deviation[i] * random.normal());
            let ln_k = 12.5 + 0.3 * random.normal();
            let at = Coordinates::new(logit, ln_n, ln_m, ln_k, ln_k + ln_tau);
            let mut steps = walk(6, 100.0, Filter::Direct, 0.0, person);
            let mut noise = Noise::new(1000 + person);
            // All regions have the same `max_ratio`, n, m, K and G. A B follows from the largest area of the region.
            for region in 0..8 {
                let curves: Vec<_> = steps.iter().map(|step| &step.regions[region]).collect();
                let area_max_m2 = Samples::new(curves, Filter::Direct).area_max_m2;
                let law = prior::parameters(&at, 0.0, 0).law(area_max_m2, 0.01);
                for step in &mut steps {
                    let curves = &mut step.regions[region];
                    let mut force_n = fit::synthetic::forces(curves, Filter::Direct, &law);
                    let peak_n = force_n.iter().copied().fold(0.0, f64::max);
                    force_n.iter_mut().for_each(|force| *force += 0.01 * peak_n * noise.normal());
                    curves.force_n = force_n;
                }
            }
            steps
        })
        .collect();
    let people: Vec<&[fit::Step]> = cohort.iter().map(Vec::as_slice).collect();
    for learnt in prior::learn(&people, &Options::usual([0.012; 8])) {
        for i in 0..4 {
            // The mean may differ by four standard errors of a mean of 24 people, and the standard deviation by a factor of
            // 0.6 to 1.6.
            let error = (learnt.mean[i] - truth.mean[i]).abs();
            assert!(error < 4.0 * truth.deviation[i] / 24f64.sqrt(), "{i}: {learnt:?}");
            let ratio = learnt.deviation[i] / truth.deviation[i];
            assert!((0.6..1.6).contains(&ratio), "{i}: {learnt:?}");
        }
    }
}

//! Identification from computed steps, whose true parameters are known.

use fit::identify::{Bounds, identify, identify_from};
use fit::interval::{five, from_jacobian};
use fit::quality::Evaluated;
use fit::synthetic::{Noise, curves, law};
use fit::{Filter, Samples};
use plantar::Region;

#[test]
fn parameters_of_exact_steps_are_recovered() {
    let mut most_evaluations = 0;
    for filter in [Filter::Direct, Filter::Live] {
        for rate_hz in [50.0, 100.0, 200.0, 400.0] {
            for region in 0..8 {
                let curves = curves(region, rate_hz, filter, 1.0, 0.0, &mut Noise::new(1));
                let samples = Samples::new([&curves], filter);
                let found = identify(&samples, &Bounds::USUAL);
                let truth = law(region);
                let expected = [truth.ab_m2, truth.stiffness_pa, truth.damping_pa_s, truth.n, truth.m];
                let got = five(&found, samples.area_max_m2);
                let place = format!("{filter:?}, {rate_hz} Hz, region {region}: {got:?} for {expected:?}");
                for (got, expected) in got.iter().zip(expected) {
                    assert!((got / expected - 1.0).abs() < 1e-6, "{place}");
                }
                let law = found.law(samples.area_max_m2, 0.01);
                let error = Evaluated::new(&curves, filter, &law).expect("contact").nrmse();
                assert!(error < 1e-8, "{place}: {error}");
                most_evaluations = most_evaluations.max(found.evaluations);
            }
        }
    }
    println!("at most {most_evaluations} evaluations");
    assert!(most_evaluations <= 150, "{most_evaluations}");
}

/// Number of noisy steps of a region, each of which is fitted alone.
const REPEATS: u64 = 200;

/// For each parameter, the number of repeats in which the interval from the Jacobian contains the true value. `autocorrelation`
/// is the correlation of the noise between neighbouring samples.
fn covered(region: usize, autocorrelation: f64) -> [u32; 5] {
    let truth = law(region);
    let expected = [truth.ab_m2, truth.stiffness_pa, truth.damping_pa_s, truth.n, truth.m];
    let mut covered = [0; 5];
    for seed in 0..REPEATS {
        let curves =
            curves(region, 100.0, Filter::Direct, 1.0, 0.01, &mut Noise::autocorrelated(seed, autocorrelation));
        let samples = Samples::new([&curves], Filter::Direct);
        let found = identify(&samples, &Bounds::USUAL);
        let uncertainty = from_jacobian(&samples, &Bounds::USUAL, &found);
        for ((interval, expected), covered) in uncertainty.intervals.iter().zip(expected).zip(&mut covered) {
            let [low, high] = interval.jacobian;
            *covered += u32::from(low <= expected && expected <= high);
        }
    }
    covered
}

#[test]
fn intervals_contain_the_truth() {
    for (region, name) in Region::ALL.iter().enumerate() {
        let covered = covered(region, 0.0);
        println!("{}: {covered:?} of {REPEATS}", name.name());
        assert!(covered.iter().all(|covered| (180..=198).contains(covered)), "{}: {covered:?}", name.name());
    }
}

/// The residuals of a model with a systematic error are correlated. Intervals that assumed independent residuals would contain
/// the true value in only half of the repeats.
#[test]
fn intervals_account_for_the_correlation_of_residuals() {
    for (autocorrelation, least) in [(0.5, 160), (0.8, 160)] {
        for (region, name) in Region::ALL.iter().enumerate() {
            let covered = covered(region, autocorrelation);
            let place = format!("{}, correlation {autocorrelation}", name.name());
            println!("{place}: {covered:?} of {REPEATS}");
            assert!(covered.iter().all(|covered| *covered >= least), "{place}: {covered:?}");
        }
    }
}

/// The NRMSE is at most a thousandth of a percentage point above the best of 60 searches over all five parameters, which start at
/// random points.
#[test]
fn a_fit_to_noisy_steps_is_as_good_as_the_best_of_sixty_random_starts() {
    for filter in [Filter::Direct, Filter::Live] {
        for region in 0..8 {
            let curves = curves(region, 100.0, filter, 1.0, 0.01, &mut Noise::new(9));
            let samples = Samples::new([&curves], filter);
            let found = identify(&samples, &Bounds::USUAL);
            let mut random = fastrand::Rng::with_seed(region as u64);
            let best =
                (0..60).map(|_| identify_from(&samples, &Bounds::USUAL, std::array::from_fn(|_| random.f64())).squares);
            let best = best.fold(f64::INFINITY, f64::min);
            // For one step, the sum of squares is the squared NRMSE.
            let worse = 100.0 * (found.squares.sqrt() - best.sqrt());
            assert!(worse <= 0.001, "{filter:?}, region {region}: {worse} percentage points");
        }
    }
}

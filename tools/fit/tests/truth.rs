//! Identification against parameters that are known.

mod common;

use common::{Noise, curves, gauge, walk};
use fit::identify::{Bounds, identify};
use fit::interval::{five, from_jacobian};
use fit::{Filter, Method, Options, Samples, fit, quality::Evaluated};

const OPTIONS: Options = Options {
    filter: Filter::Step,
    method: Method::Projection,
    bounds: Bounds::USUAL,
    thickness_m: [0.012; 8],
    compression: 0.457,
};

#[test]
fn exact_steps_give_their_parameters_back() {
    let mut most_evaluations = 0;
    for filter in [Filter::Step, Filter::Live] {
        for rate_hz in [50.0, 100.0, 200.0, 400.0] {
            for region in 0..8 {
                let curves = curves(region, rate_hz, filter, 1.0, 0.0, &mut Noise::new(1));
                let samples = Samples::new([&curves], filter);
                let found = identify(&samples, &Bounds::USUAL);
                let truth = gauge(region);
                let expected = [truth.ab_m2, truth.stiffness_pa, truth.damping_pa_s, truth.n, truth.m];
                let got = five(&found, samples.area_max_m2);
                let place = format!("{filter:?}, {rate_hz} Hz, region {region}: {got:?} for {expected:?}");
                for (got, expected) in got.iter().zip(expected) {
                    assert!((got / expected - 1.0).abs() < 1e-4, "{place}");
                }
                let gauge = found.gauge(samples.area_max_m2, 0.01);
                let error = Evaluated::new(&curves, filter, &gauge).expect("contact").nrmse();
                assert!(error < 1e-4, "{place}: {error}");
                most_evaluations = most_evaluations.max(found.evaluations);
            }
        }
    }
    println!("at most {most_evaluations} evaluations");
    assert!(most_evaluations <= 600, "{most_evaluations}");
}

#[test]
fn intervals_hold_the_truth() {
    const REPEATS: u64 = 200;
    let mut held = [[0; 5]; 8];
    for region in 0..8 {
        let truth = gauge(region);
        let expected = [truth.ab_m2, truth.stiffness_pa, truth.damping_pa_s, truth.n, truth.m];
        for seed in 0..REPEATS {
            let curves = curves(region, 100.0, Filter::Step, 1.0, 0.01, &mut Noise::new(seed));
            let samples = Samples::new([&curves], Filter::Step);
            let found = identify(&samples, &Bounds::USUAL);
            let uncertainty = from_jacobian(&samples, &Bounds::USUAL, &found);
            for (i, interval) in uncertainty.intervals.iter().enumerate() {
                let [low, high] = interval.jacobian;
                held[region][i] += u32::from(low <= expected[i] && expected[i] <= high);
            }
        }
    }
    println!("{held:?}");
}

#[test]
fn noisy_steps_are_fitted_as_well_as_by_any_start() {
    let steps = walk(6, 100.0, Filter::Step, 0.01, 5);
    let fits = fit(&steps, &OPTIONS, &|_| ());
    for fit in &fits {
        println!("{:?}", fit.as_ref().map(|f| (f.quality, &f.verdict, &f.warnings, f.evaluations)));
    }
}

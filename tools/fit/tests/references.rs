//! The intervals of quantities that are defined relative to the steps (force at a share of the largest area, area at a share of
//! the peak force) include the variation of these references between steps.

use fit::measures::Quantity;
use fit::synthetic::{Noise, curves, law, walk};
use fit::{Filter, Options, RegionCurves, Step, interval};
use std::f64::consts::PI;

/// Standard deviation of the size of the steps. Its distribution is symmetric, so that its median is 1.
const SIZE_DEVIATION: f64 = 0.05;
/// Standard deviation of the noise of the force, relative to the peak force. It is so small that the largest force of a step is
/// hardly larger than its peak without noise, and that the uncertainty of the force law is small.
const FORCE_NOISE: f64 = 0.005;
/// Number of walks in each region.
const WALKS: u64 = 60;
/// The regions that are tested.
const REGIONS: [usize; 3] = [0, 3, 5];

/// Steps that load one region, with random sizes.
fn steps(count: usize, region: usize, seed: u64) -> Vec<Step> {
    let mut steps = walk(count, 100.0, Filter::Direct, 0.0, seed);
    let mut sizes = Noise::new(2 * seed);
    let mut noise = Noise::autocorrelated(2 * seed + 1, 0.8);
    for step in &mut steps {
        let size = 1.0 + SIZE_DEVIATION * sizes.normal();
        step.regions = std::array::from_fn(|_| RegionCurves::default());
        step.regions[region] = curves(region, 100.0, Filter::Direct, size, FORCE_NOISE, &mut noise);
    }
    steps
}

/// The quantity of the true force law at the true medians, which are those of a step of median size.
fn truth(region: usize, quantity: Quantity) -> f64 {
    let law = law(region);
    let median = curves(region, 100.0, Filter::Direct, 1.0, 0.0, &mut Noise::new(0));
    let largest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    let elastic_n = |area_mm2: f64| law.force_n(law.area_ratio(area_mm2 * 1e-6).normalised_deformation(), 0.0);
    match quantity {
        Quantity::ForceAtArea => elastic_n(0.7 * largest(&median.area_mm2)),
        Quantity::AreaAtForce(share) => {
            let force_n = share * largest(&median.force_n);
            let (mut low, mut high) = (0.0, PI * law.ab_m2 * 1e6);
            for _ in 0..60 {
                let middle = (low + high) / 2.0;
                if elastic_n(middle) < force_n { low = middle } else { high = middle }
            }
            low
        }
        _ => unreachable!("the test has no other quantities"),
    }
}

/// The quantities that are tested.
const QUANTITIES: [Quantity; 3] = [Quantity::ForceAtArea, Quantity::AreaAtForce(0.25), Quantity::AreaAtForce(0.5)];

/// Fits walks with this number of steps, and asserts that more than 88 % of the 95 % intervals of each quantity contain the true
/// value: with 180 intervals, four standard errors of this share are 6.5 %.
fn assert_coverage(count: usize, resamples: u64) {
    let options = Options { resamples, ..Options::usual([0.012; 8]) };
    let mut contained = [0; QUANTITIES.len()];
    for region in REGIONS {
        let truth = QUANTITIES.map(|quantity| truth(region, quantity));
        for seed in 0..WALKS {
            let fits = fit::fit(&steps(count, region, seed), &options, &|_| ());
            let fit = fits[region].as_ref().expect("a fit");
            for ((quantity, truth), contained) in QUANTITIES.into_iter().zip(truth).zip(&mut contained) {
                let measure = fit.measure(quantity).expect("a quantity");
                let [low, high] = measure.interval.expect("an interval");
                *contained += usize::from(low <= truth && truth <= high);
            }
        }
    }
    let shares = contained.map(|contained| contained as f64 / (WALKS as usize * REGIONS.len()) as f64);
    assert!(shares.iter().all(|share| *share > 0.88), "{count} steps, {resamples} resamples: {shares:?}");
}

#[test]
fn resampled_intervals_contain_the_truth_although_the_references_vary() {
    assert_coverage(interval::MIN_BOOTSTRAP_STEPS + 2, interval::RESAMPLES);
}

#[test]
fn intervals_without_resampled_fits_contain_the_truth_although_the_references_vary() {
    assert_coverage(2, 0);
    assert_coverage(5, 0);
    assert_coverage(20, 0);
}

/// The quantities at the reference strain of 20 % have no value if the steps never compress the tissue as far: the force law
/// would have to be extrapolated.
#[test]
fn a_strain_that_no_step_reaches_has_no_stiffness() {
    let steps = steps(4, 0, 1);
    let at_strain = [
        Quantity::SecantStiffness,
        Quantity::TangentStiffness,
        Quantity::SecantModulus,
        Quantity::TangentModulus,
        Quantity::ViscousModulus,
    ];
    for (compression, has_value) in [(0.457, true), (0.21, true), (0.19, false), (0.1, false)] {
        let options = Options { compression, ..Options::usual([0.012; 8]) };
        let fits = fit::fit(&steps, &options, &|_| ());
        let fit = fits[0].as_ref().expect("a fit");
        for quantity in at_strain {
            assert_eq!(fit.measure(quantity).is_some(), has_value, "{quantity:?} at a compression of {compression}");
        }
        assert!(fit.measure(Quantity::ForceAtArea).is_some());
    }
}

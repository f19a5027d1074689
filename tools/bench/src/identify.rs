//! Measures the accuracy, the model evaluations and the time of the identification on computed steps with known parameters, and
//! compares them with the paper's search.

use crate::python;
use anyhow::{Result, bail};
use bench::{Figures, raise};
use fit::identify::{Bounds, Identified, identify};
use fit::interval::{self, five};
use fit::prior::{self, Coordinates, Prior, WALKERS};
use fit::quality::Evaluated;
use fit::synthetic::{Noise, curves, forces, law};
use fit::{Filter, Samples, paper};
use std::path::Path;
use std::time::Instant;

/// Samples per second of the computed steps.
const RATE_HZ: f64 = 100.0;
/// Standard deviation of the independent noise, relative to the peak force.
const NOISE: f64 = 0.01;
/// Number of runs. The fastest one is reported, because other processes slow the others down.
const RUNS: usize = 20;
/// Standard deviation of the correlated noise, relative to the peak force.
const CORRELATED_NOISE: f64 = 0.03;
/// Correlation of successive values of the correlated noise.
const AUTOCORRELATION: f64 = 0.8;
/// Number of computed steps of each region for the coverage of the intervals.
const COVERAGE_REPEATS: u64 = 200;
/// The paper's search counts as successful if its NRMSE is less than the sum of that of this identification and this value.
const SUCCESS: f64 = 0.001;

/// Measures all figures of the identification; `python` is an interpreter with NumPy and SciPy.
pub fn measure(python: &Path, figures: &mut Figures) -> Result<()> {
    exact(figures);
    coverage(figures);
    let noisy: Vec<_> =
        (0..8).map(|r| curves(r, RATE_HZ, Filter::Direct, 1.0, NOISE, &mut Noise::new(r as u64))).collect();
    let samples: Vec<_> = noisy.iter().map(|c| Samples::new([c], Filter::Direct)).collect();
    let mut found = Vec::new();
    let mut best_s = [f64::INFINITY; 8];
    for _ in 0..RUNS {
        found.clear();
        for (samples, best_s) in samples.iter().zip(&mut best_s) {
            let start = Instant::now();
            found.push(most_probable(samples, &WALKERS[found.len()]).0);
            *best_s = best_s.min(start.elapsed().as_secs_f64());
        }
    }
    let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
    let evaluations = most(&mut found.iter().map(|f| f.evaluations as f64));
    figures.add(
        "fit_evaluations",
        evaluations,
        "at most 600: model evaluations for one region and step, largest of eight regions",
    );
    let fit_ms = most(&mut best_s.iter().map(|s| s * 1e3));
    figures.add(
        "fit_ms",
        round(fit_ms, 3),
        "at most 2: time of the identification of one region and step on one core, ms, largest of eight regions",
    );

    // For a single step, the sum of squares is the square of the NRMSE.
    let own_nrmse: Vec<f64> = found.iter().map(|f| f.squares.sqrt()).collect();
    let own_s: f64 = best_s.iter().sum::<f64>() / 8.0;
    let scipy = scipy(python, &samples)?;
    figures.add(
        "paper_evaluations",
        scipy.evaluations,
        "model evaluations of the paper's search (SciPy's SLSQP, ten starts), mean of eight regions",
    );
    let succeeded = scipy.nrmse.iter().zip(&own_nrmse).filter(|(nrmse, own)| **nrmse < *own + SUCCESS).count();
    figures.add(
        "paper_success",
        succeeded,
        "regions in which the NRMSE of the paper's search is below this identification's + 0.1 percentage points",
    );
    let ratio = scipy.seconds / (succeeded as f64) / own_s;
    figures.add(
        "fit_over_paper",
        round(ratio, 1),
        "at least 100: time of the paper's search for each successful region, relative to this identification",
    );

    let start = Instant::now();
    let compiled = samples.iter().map(|s| {
        let (ellipsoid, _) = paper::identify(s, 1.0);
        ellipsoid.force_law()
    });
    let compiled: Vec<_> = compiled.collect();
    let seconds = start.elapsed().as_secs_f64();
    let nrmse = noisy.iter().zip(&compiled).map(|(curves, force_law)| {
        Evaluated::new(curves, Filter::Direct, force_law).map_or(f64::INFINITY, |e| e.nrmse())
    });
    let succeeded = nrmse.zip(&own_nrmse).filter(|(nrmse, own)| *nrmse < **own + SUCCESS).count();
    figures.add(
        "fit_over_paper_compiled",
        round(seconds / succeeded as f64 / own_s, 1),
        &format!("the same for the paper's search in Rust (--method paper), successful in {succeeded} of 8 regions"),
    );
    Ok(())
}

/// Measures the errors for steps without noise. Their parameters should be found exactly.
fn exact(figures: &mut Figures) {
    let (mut nrmse, mut parameters) = (0.0f64, 0.0f64);
    for (region, prior) in WALKERS.iter().enumerate() {
        let curves = curves(region, RATE_HZ, Filter::Direct, 1.0, 0.0, &mut Noise::new(1));
        let samples = Samples::new([&curves], Filter::Direct);
        let (found, _) = most_probable(&samples, prior);
        raise(&mut nrmse, found.squares.sqrt());
        let law = law(region);
        let truth = [law.ab_m2, law.stiffness_pa, law.damping_pa_s, law.n, law.m];
        for (value, truth) in five(&found, samples.area_max_m2).into_iter().zip(truth) {
            raise(&mut parameters, (value / truth - 1.0).abs());
        }
    }
    figures.add(
        "fit_exact_nrmse",
        nrmse * 100.0,
        "below 0.01: NRMSE for steps without noise, %, largest of eight regions",
    );
    figures.add(
        "fit_exact_parameters",
        parameters,
        "below 1e-4: relative error of the five parameters for steps without noise, largest of eight regions",
    );
}

/// The parameters by the default method, and the scatter of the force about the model.
fn most_probable(samples: &Samples, prior: &Prior) -> (Identified, interval::Noise) {
    let unconstrained = identify(samples, &Bounds::USUAL);
    let noise = interval::noise(samples, &unconstrained);
    (prior.identify(samples, &unconstrained, noise.variance), noise)
}

/// Measures the fraction of computed steps for which a true value lies in its 95 % interval. The true K of a region is that of
/// [`law`]; the other true parameters of each step are drawn from their distribution among people ([`WALKERS`]). Successive
/// residuals are correlated.
fn coverage(figures: &mut Figures) {
    let mut least = 1.0f64;
    let mut mean = 0.0;
    for (region, prior) in WALKERS.iter().enumerate() {
        let mut covered = [0.0; 5];
        for seed in 0..COVERAGE_REPEATS {
            let mut noise = Noise::autocorrelated(seed, AUTOCORRELATION);
            let [logit, ln_shifted_n, ln_m, ln_tau]: [f64; 4] =
                std::array::from_fn(|i| prior.mean[i] + prior.deviation[i] * noise.independent());
            let ln_k = law(region).stiffness_pa.ln();
            let mut curves = curves(region, RATE_HZ, Filter::Direct, 1.0, 0.0, &mut Noise::new(seed));
            let area_max_m2 = Samples::new([&curves], Filter::Direct).area_max_m2;
            let truth = prior::parameters(&Coordinates::new(logit, ln_shifted_n, ln_m, ln_k, ln_k + ln_tau), 0.0, 0);
            // The radius C, here 10 mm, does not affect the force.
            curves.force_n = forces(&curves, Filter::Direct, &truth.law(area_max_m2, 0.01));
            let peak_n = curves.force_n.iter().copied().fold(0.0, f64::max);
            for (force_n, area_mm2) in curves.force_n.iter_mut().zip(&curves.area_mm2) {
                if *area_mm2 > 0.0 {
                    *force_n += CORRELATED_NOISE * peak_n * noise.normal();
                }
            }
            let samples = Samples::new([&curves], Filter::Direct);
            let (found, noise) = most_probable(&samples, prior);
            let covariance = interval::covariance(&samples, prior, &found, noise.variance);
            let uncertainty = interval::from_posterior(samples.area_max_m2, prior, &found, &noise, &covariance);
            let truth = five(&truth, area_max_m2);
            for ((interval, truth), covered) in uncertainty.intervals.iter().zip(truth).zip(&mut covered) {
                let [low, high] = interval.jacobian;
                *covered += f64::from(u8::from((low..=high).contains(&truth))) / COVERAGE_REPEATS as f64;
            }
        }
        least = covered.into_iter().fold(least, f64::min);
        // The mean over eight regions with five parameters each.
        mean += covered.iter().sum::<f64>() / 40.0;
    }
    figures.add(
        "fit_coverage",
        round(mean, 4),
        "0.90 to 0.99: fraction of true values inside their 95 % interval, correlated residuals, all regions",
    );
    figures.add(
        "fit_coverage_least",
        round(least, 4),
        "fraction of true values inside their 95 % interval, parameter and region with the least coverage",
    );
}

/// The results of the paper's search through SciPy.
struct Scipy {
    /// Time for all regions, s.
    seconds: f64,
    /// Model evaluations, mean of the regions.
    evaluations: f64,
    /// The least NRMSE for each region.
    nrmse: Vec<f64>,
}

/// Runs the paper's search through SciPy; `samples` has one step of each region.
fn scipy(python: &Path, samples: &[Samples]) -> Result<Scipy> {
    let directory = tempfile::tempdir()?;
    for (region, samples) in samples.iter().enumerate() {
        let mut data = vec![samples.len() as f64];
        data.extend(samples.table().flatten());
        // The area before contact, to which an index beyond the last sample refers.
        data.push(0.0);
        let bytes: Vec<u8> = data.into_iter().flat_map(f64::to_le_bytes).collect();
        std::fs::write(directory.path().join(format!("{region}.f64")), bytes)?;
    }
    let mut scipy = Scipy { seconds: 0.0, evaluations: 0.0, nrmse: Vec::new() };
    for numbers in python::run(python, "identify_scipy.py", directory.path(), &[])? {
        let [seconds, evaluations, nrmse] = numbers[..] else {
            bail!("identify_scipy.py printed an unexpected line: {numbers:?}")
        };
        scipy.seconds += seconds;
        scipy.evaluations += evaluations / samples.len() as f64;
        scipy.nrmse.push(nrmse);
    }
    Ok(scipy)
}

/// Rounds a value to this number of decimal places.
fn round(value: f64, digits: i32) -> f64 {
    let scale = 10f64.powi(digits);
    (value * scale).round() / scale
}

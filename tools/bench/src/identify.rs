//! Measures the accuracy, the model evaluations and the time of the identification on computed steps with known parameters, and
//! compares them with the paper's search.

use crate::python;
use anyhow::{Result, bail};
use bench::Figures;
use fit::identify::{Bounds, identify};
use fit::interval::{five, from_jacobian};
use fit::quality::Evaluated;
use fit::synthetic::{Noise, curves, law};
use fit::{Filter, Samples, paper};
use std::path::Path;
use std::time::Instant;

/// Samples per second of the computed steps.
const RATE_HZ: f64 = 100.0;
/// Standard deviation of the noise, relative to the peak force.
const NOISE: f64 = 0.01;
/// Number of runs. The fastest one is reported, because other processes slow the others down.
const RUNS: usize = 20;
/// Number of computed steps of each region for the coverage of the intervals.
const COVERAGE_REPEATS: u64 = 200;
/// A search counts as successful if its NRMSE exceeds that of this identification by less than this.
const SUCCESS: f64 = 0.001;

/// Measures all figures; `python` is an interpreter with NumPy and SciPy.
pub fn measure(python: &Path, figures: &mut Figures) -> Result<()> {
    exact(figures);
    coverage(figures);
    let noisy: Vec<_> =
        (0..8).map(|r| curves(r, RATE_HZ, Filter::Step, 1.0, NOISE, &mut Noise::new(r as u64))).collect();
    let samples: Vec<_> = noisy.iter().map(|c| Samples::new([c], Filter::Step)).collect();
    let mut found = Vec::new();
    let mut best_s = [f64::INFINITY; 8];
    for _ in 0..RUNS {
        found.clear();
        for (samples, best_s) in samples.iter().zip(&mut best_s) {
            let start = Instant::now();
            found.push(identify(samples, &Bounds::USUAL));
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
    figures.add("fit_ms", round(fit_ms, 3), "at most 2: time of this on one core, ms, largest of eight regions");

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
        "of 8 regions: the NRMSE of the paper's search is less than 0.1 percentage points above this identification's",
    );
    let ratio = scipy.seconds / (succeeded as f64) / own_s;
    figures.add(
        "fit_over_paper",
        round(ratio, 1),
        "at least 100: time of the paper's search for each successful region, relative to this identification",
    );

    let start = Instant::now();
    let compiled = samples.iter().map(|s| {
        let (ellipsoid, _) = paper::identify(s);
        ellipsoid.force_law()
    });
    let compiled: Vec<_> = compiled.collect();
    let seconds = start.elapsed().as_secs_f64();
    let nrmse = noisy.iter().zip(&compiled).map(|(curves, force_law)| {
        Evaluated::new(curves, Filter::Step, force_law).map_or(f64::INFINITY, |e| e.nrmse())
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
    for region in 0..8 {
        let curves = curves(region, RATE_HZ, Filter::Step, 1.0, 0.0, &mut Noise::new(1));
        let samples = Samples::new([&curves], Filter::Step);
        let found = identify(&samples, &Bounds::USUAL);
        nrmse = nrmse.max(found.squares.sqrt());
        let t = law(region);
        let truth = [t.ab_m2, t.stiffness_pa, t.damping_pa_s, t.n, t.m];
        let errors =
            five(&found, samples.area_max_m2).into_iter().zip(truth).map(|(got, truth)| (got / truth - 1.0).abs());
        parameters = errors.fold(parameters, f64::max);
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

/// Measures the fraction of noisy steps for which a true value lies in its 95 % interval.
fn coverage(figures: &mut Figures) {
    let mut least = 1.0f64;
    let mut all = 0.0;
    for region in 0..8 {
        let t = law(region);
        let truth = [t.ab_m2, t.stiffness_pa, t.damping_pa_s, t.n, t.m];
        let mut covered = [0.0; 5];
        for seed in 0..COVERAGE_REPEATS {
            let curves = curves(region, RATE_HZ, Filter::Step, 1.0, NOISE, &mut Noise::new(seed));
            let samples = Samples::new([&curves], Filter::Step);
            let found = identify(&samples, &Bounds::USUAL);
            let uncertainty = from_jacobian(&samples, &Bounds::USUAL, &found);
            for ((interval, truth), covered) in uncertainty.intervals.iter().zip(truth).zip(&mut covered) {
                let [low, high] = interval.jacobian;
                *covered += f64::from(u8::from((low..=high).contains(&truth))) / COVERAGE_REPEATS as f64;
            }
        }
        least = covered.into_iter().fold(least, f64::min);
        all += covered.iter().sum::<f64>() / 40.0;
    }
    figures.add(
        "fit_coverage",
        round(all, 4),
        "0.90 to 0.99: fraction of true values inside their 95 % interval, noisy steps, all regions",
    );
    figures.add("fit_coverage_least", round(least, 4), "the same for the parameter and region with the least coverage");
}

/// The results of the paper's search through SciPy.
struct Scipy {
    /// Time for all regions.
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

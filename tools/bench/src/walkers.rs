//! Measures the errors of the identification for ten barefoot walkers on a pressure plate (SpeedPP2DS): each step is predicted
//! from the walker's other steps, and the quantities of the two halves of a session are compared. The prior of a walker is learnt
//! from the other nine.

use anyhow::{Context, Result};
use bench::studies::{self, mean_percent};
use bench::{Figures, raise};
use fit::measures::Quantity;
use fit::quality::Evaluated;
use fit::trials::Trial;
use fit::variable::Variable;
use fit::{RegionFit, Step, Study, agreement};
use plantar::pipeline::contact::ContactRule;
use plantar::{Region, Side};
use rayon::prelude::*;
use std::path::Path;

/// Number of steps in each fit of [`few_steps`].
const FEW_STEPS: usize = 4;
/// Number of these fits for each walker and region.
const FEW_FITS: usize = 5;
/// A 95 % interval counts as narrow if both of its ends differ from the value by at most this fraction of it.
const NARROW: f64 = 0.3;

/// Measures the errors of each region with covered shares, which are the default, and with counted cells.
pub fn measure(data: &Path, figures: &mut Figures) -> Result<()> {
    let walks = studies::walks(data)?;
    let covered = studies::fitted(&walks, ContactRule::COVERED)?;
    let counted = studies::fitted(&walks, ContactRule::COUNTED)?;
    errors(&covered, &counted, figures);
    few_steps(&covered, figures);
    shares(&covered, figures);
    repeatability(&covered, figures)
}

/// Measures the NRMSE of each region, and its means over the regions.
fn errors(covered: &[Study], counted: &[Study], figures: &mut Figures) {
    let steps: usize = covered.iter().map(|study| study.steps.len()).sum();
    let predicted = |fit: &RegionFit| fit.quality.predicted;
    let mut worst = 0.0f64;
    let mut means = [0.0; 2];
    for (i, region) in Region::ALL.iter().enumerate() {
        let name = region.name();
        let of_covered = mean_percent(covered, i, predicted);
        let of_counted = mean_percent(counted, i, predicted);
        raise(&mut worst, of_covered);
        means[0] += of_covered / 8.0;
        means[1] += of_counted / 8.0;
        let walkers = covered.iter().filter(|study| study.fits[i].is_ok()).count();
        figures.add(
            &format!("nrmse.{name}.predicted"),
            round(of_covered),
            &format!("at most 13: NRMSE, %, of each step predicted from the walker's other steps, {walkers} walkers"),
        );
        figures.add(
            &format!("nrmse.{name}.own"),
            round(mean_percent(covered, i, |fit| Some(fit.quality.own))),
            "NRMSE, %, of each step with parameters fitted to it alone",
        );
        figures.add(
            &format!("nrmse.{name}.floor"),
            round(mean_percent(covered, i, |fit| Some(fit.quality.floor))),
            "least NRMSE, %, of any force law without damping for the measured areas",
        );
        figures.add(&format!("nrmse.{name}.counted"), round(of_counted), "predicted NRMSE, %, with counted cells");
    }
    figures.add(
        "nrmse.mean.predicted",
        round(means[0]),
        &format!("at most 9.5: mean of the predicted NRMSE over the regions, %, {steps} steps"),
    );
    figures.add("nrmse.worst.predicted", round(worst), "predicted NRMSE of the worst region, %");
    figures.add(
        "nrmse.mean.counted",
        round(means[1]),
        "mean of the predicted NRMSE over the regions with counted cells, %",
    );
}

/// Measures how much larger the predicted error is if only four steps are fitted.
fn few_steps(studies: &[Study], figures: &mut Figures) {
    let ratio = |region: usize| {
        let (mut few, mut all) = (Vec::new(), Vec::new());
        for (walker, study) in studies.iter().enumerate() {
            let Ok(fit) = &study.fits[region] else { continue };
            if fit.steps.len() < 2 * FEW_STEPS {
                continue;
            }
            let mut random = fastrand::Rng::with_seed(walker as u64);
            for _ in 0..FEW_FITS {
                let mut chosen = fit.steps.clone();
                random.shuffle(&mut chosen);
                let (fitted, others) = chosen.split_at(FEW_STEPS);
                let steps: Vec<Step> = fitted.iter().map(|&i| study.steps[i].clone()).collect();
                let Ok(law) = fit::fit_force_law(&steps, region, &study.options) else { continue };
                let errors = others.iter().filter_map(|&i| {
                    Some(Evaluated::new(&study.steps[i].regions[region], study.options.filter, &law)?.nrmse())
                });
                let errors: Vec<f64> = errors.collect();
                few.push(errors.iter().sum::<f64>() / errors.len() as f64);
                all.push(fit.quality.predicted.unwrap_or(f64::NAN));
            }
        }
        few.iter().sum::<f64>() / all.iter().sum::<f64>()
    };
    let ratios: Vec<f64> = (0..8).into_par_iter().map(ratio).collect();
    let ratio = ratios.iter().sum::<f64>() / ratios.len() as f64;
    figures.add(
        "nrmse.mean.four_steps",
        round(ratio),
        "at most 1.15: predicted NRMSE with parameters of four steps, relative to that with all steps, mean of the regions",
    );
}

/// Measures the share of fits at a bound, and of quantities with a narrow interval.
fn shares(studies: &[Study], figures: &mut Figures) {
    let fits: Vec<&RegionFit> = studies.iter().flat_map(|study| study.fits.iter().flatten()).collect();
    let is_at_bound = |fit: &&&RegionFit| {
        fit.uncertainty.as_ref().is_some_and(|uncertainty| uncertainty.intervals.iter().any(|i| i.at_bound))
    };
    figures.add(
        "fit_at_bound",
        round(fits.iter().filter(is_at_bound).count() as f64 / fits.len() as f64),
        "at most 0.05: share of region fits with a parameter at a bound",
    );
    let measures: Vec<_> = fits.iter().flat_map(|fit| &fit.measures).collect();
    let narrow = measures.iter().filter(|measure| measure.is_within(NARROW)).count();
    figures.add(
        "fit_determined",
        round(narrow as f64 / measures.len() as f64),
        "at least 0.75: share of the mechanical quantities whose 95 % interval is within 30 % of the value",
    );
}

/// Measures the ICC of quantities between the first and the second half of each walker's steps: the median of the regions.
fn repeatability(studies: &[Study], figures: &mut Figures) -> Result<()> {
    let shown = [
        ("force_at_area", Quantity::ForceAtArea, "at least 0.9"),
        ("area_at_force", Quantity::AreaAtForce(0.5), "at least 0.85"),
        ("stiffness", Quantity::SecantStiffness, "at least 0.8"),
    ];
    let halves = |study: &Study| {
        let (first, second) = study.steps.split_at(study.steps.len() / 2);
        // All steps of the data set are imported as right feet.
        [first, second]
            .map(|steps| Trial::of(String::new(), Side::Right, steps, &fit::fit(steps, &study.options, &|_| ())))
    };
    let trials: Vec<_> = studies.par_iter().map(halves).collect();
    let people: Vec<(&str, &[Trial])> = trials.iter().map(|trials| ("a walker", &trials[..])).collect();
    let (feet, _) = agreement::repeatability(&people, 2);
    let foot = feet.first().context("the walkers have no repeated trials")?;
    for (key, quantity, limit) in shown {
        let row = foot.rows.iter().find(|row| row.variable == Variable::Quantity(quantity));
        let icc = row.and_then(|row| row.median(|agreement| agreement.icc)).context("no region has this quantity")?;
        figures.add(
            &format!("repeat.icc.{key}"),
            round(icc),
            &format!("{limit}: ICC(2,1) of two halves of a session, median of the regions"),
        );
    }
    Ok(())
}

/// Rounds to three decimal places.
fn round(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

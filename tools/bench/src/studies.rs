//! The studies of the ten barefoot walkers on a pressure plate (SpeedPP2DS). The prior of a walker is learnt from the other nine.

use anyhow::Result;
use fit::{Options, RegionFit, Step, Study, prior};
use parameters::InsoleSize;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use rayon::prelude::*;
use recording::{Recording, VirtualInsole, jiku};
use std::path::Path;

/// Interval, in steps, of the steps from which a prior is learnt: every third step of each of the other walkers.
const LEARNING_INTERVAL: usize = 3;

/// The recordings of all walkers, from the folder SpeedPP2DS of the Python package jiku-data.
pub fn walks(data: &Path) -> Result<Vec<Recording>> {
    let walkers = (0..jiku::WALKERS).into_par_iter();
    walkers.map(|walker| Ok(jiku::import(data, walker, 0..jiku::TRIALS, &mut |_, _| ())?)).collect()
}

/// The fitted studies of all walkers with this contact rule.
pub fn fitted(walks: &[Recording], contact: ContactRule) -> Result<Vec<Study>> {
    let options = Options::usual(InsoleSize::default().thickness_m());
    let study = |walk: &Recording| {
        let mut study = Study::new(String::new(), contact, options);
        study.add(String::new(), walk, &VirtualInsole::new(walk, contact, StanceRule::ADAPTIVE), &mut |_| ())?;
        Ok(study)
    };
    let mut studies: Vec<Study> = walks.par_iter().map(study).collect::<Result<_>>()?;
    let samples: Vec<Vec<Step>> =
        studies.iter().map(|study| study.steps.iter().step_by(LEARNING_INTERVAL).cloned().collect()).collect();
    studies.par_iter_mut().enumerate().for_each(|(i, study)| {
        let others = samples.iter().enumerate().filter(|(other, _)| *other != i);
        let others: Vec<&[Step]> = others.map(|(_, steps)| &steps[..]).collect();
        study.options.prior = Some(prior::learn(&others, &options));
        study.fit(&|_| ());
    });
    Ok(studies)
}

/// The mean, %, of the fraction that `fraction` returns, over the walkers with a fit of the region for which it has a value.
pub fn mean_percent(studies: &[Study], region: usize, fraction: fn(&RegionFit) -> Option<f64>) -> f64 {
    let values: Vec<f64> = studies.iter().filter_map(|study| fraction(study.fits[region].as_ref().ok()?)).collect();
    values.iter().sum::<f64>() / values.len() as f64 * 100.0
}

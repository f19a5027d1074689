//! Measures the errors of the identification for ten barefoot walkers on a pressure plate (SpeedPP2DS). Each step is predicted
//! from the walker's other steps.

use anyhow::Result;
use bench::Figures;
use fit::{Options, Quality, Study};
use parameters::InsoleSize;
use plantar::Region;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance::StanceRule;
use recording::{Recording, VirtualInsole, jiku};
use std::path::Path;

/// Limits: the NRMSE of each region, %, in the best of the analyses of these steps that preceded this identification.
const REFERENCE: [f64; 8] = [13.6, 23.5, 23.5, 26.5, 27.2, 18.4, 21.0, 19.5];

/// Measures the errors of each region with counted cells and with covered shares.
pub fn measure(data: &Path, figures: &mut Figures) -> Result<()> {
    let mut counted = Vec::new();
    let mut covered = Vec::new();
    let mut steps = 0;
    for walker in 0..jiku::WALKERS {
        let walk = jiku::import(data, walker, 0..jiku::TRIALS, &mut |_, _| ())?;
        let (qualities, count) = qualities(&walk, ContactRule::COUNTED)?;
        steps += count;
        counted.push(qualities);
        covered.push(self::qualities(&walk, ContactRule::COVERED)?.0);
    }
    let mut totals = [0.0; 2];
    for (i, region) in Region::ALL.iter().enumerate() {
        let mean = |all: &[[Option<Quality>; 8]], of: fn(&Quality) -> Option<f64>| {
            let values: Vec<f64> = all.iter().filter_map(|walker| of(walker[i].as_ref()?)).collect();
            (values.iter().sum::<f64>() / values.len() as f64 * 1e4).round() / 100.0
        };
        let walkers = counted.iter().filter(|walker| walker[i].is_some()).count();
        let name = region.name();
        let predicted = mean(&counted, |q| q.predicted);
        figures.add(
            &format!("nrmse.{name}.own"),
            mean(&counted, |q| Some(q.own)),
            "NRMSE, %, of each step with parameters fitted to it alone, counted cells",
        );
        figures.add(
            &format!("nrmse.{name}.predicted"),
            predicted,
            &format!(
                "at most {}: NRMSE, %, of each step predicted from the walker's other steps, {walkers} walkers",
                REFERENCE[i]
            ),
        );
        figures.add(
            &format!("nrmse.{name}.floor"),
            mean(&counted, |q| Some(q.floor)),
            "least NRMSE, %, of any force law without damping for the measured areas",
        );
        let predicted_covered = mean(&covered, |q| q.predicted);
        figures.add(
            &format!("nrmse.{name}.covered"),
            predicted_covered,
            "NRMSE, %, of each step predicted from the walker's other steps, covered shares (150 kPa)",
        );
        totals[0] += predicted / 8.0;
        totals[1] += predicted_covered / 8.0;
    }
    let [counted, covered] = totals;
    figures.add(
        "nrmse.mean.predicted",
        (counted * 100.0).round() / 100.0,
        &format!("mean of the predicted NRMSE over the regions, %, {steps} steps"),
    );
    figures.add("nrmse.mean.covered", (covered * 100.0).round() / 100.0, "the same with covered shares");
    let reduction = (1.0 - covered / counted) * 100.0;
    figures.add(
        "nrmse.mean.less",
        (reduction * 10.0).round() / 10.0,
        "at least 15: relative reduction of this mean by covered shares, %",
    );
    Ok(())
}

/// The errors in each region of a walk, and the number of steps, with this contact rule.
fn qualities(walk: &Recording, contact: ContactRule) -> Result<([Option<Quality>; 8], usize)> {
    let options = Options::usual(InsoleSize::default().thickness_m());
    let mut study = Study::new(String::new(), contact, options);
    study.add(String::new(), walk, &VirtualInsole::new(walk, contact, StanceRule::WALKING), &mut |_| ())?;
    study.fit(&|_| ());
    let quality = |i: usize| study.fits[i].as_ref().ok().map(|fit| fit.quality);
    Ok((std::array::from_fn(quality), study.steps.len()))
}

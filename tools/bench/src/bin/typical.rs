//! Computes three constants from the ten walkers of SpeedPP2DS, and prints them as Rust source: the distribution of the shape of
//! force laws among people (`fit::prior::WALKERS`), the typical parameters (`parameters::defaults`), and the minimal detectable
//! change of the tracked stiffness (`plantar::pipeline::step::STIFFNESS_MDC`).

use anyhow::Result;
use clap::Parser;
use fit::repeat::within_person;
use fit::{Options, RegionCurves, Step, Study, prior};
use parameters::InsoleSize;
use plantar::Region;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::model::ForceLaw;
use plantar::pipeline::region::AreaMoments;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::step::RegionStep;
use plantar::pipeline::track::Tracker;
use recording::{VirtualInsole, jiku};
use std::path::PathBuf;

/// Learns the distribution of the parameters among walkers, their typical parameters, and how the tracked stiffness varies.
#[derive(Parser)]
struct Arguments {
    /// The folder SpeedPP2DS of the Python package jiku-data.
    #[arg(long)]
    jiku: PathBuf,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let mut options = Options::usual(InsoleSize::default().thickness_m());
    let mut walkers = Vec::new();
    for walker in 0..jiku::WALKERS {
        let walk = jiku::import(&arguments.jiku, walker, 0..jiku::TRIALS, &mut |_, _| ())?;
        let mut study = Study::new(String::new(), ContactRule::COVERED, options);
        let insole = VirtualInsole::new(&walk, ContactRule::COVERED, StanceRule::ADAPTIVE);
        study.add(String::new(), &walk, &insole, &mut |_| ())?;
        walkers.push(study);
    }
    let people: Vec<&[Step]> = walkers.iter().map(|study| &study.steps[..]).collect();
    let priors = prior::learn(&people, &options);
    println!("pub const WALKERS: [Prior; 8] = [");
    for prior in priors {
        println!("    Prior {{ mean: {:.2?}, deviation: {:.2?} }},", prior.mean, prior.deviation);
    }
    println!("];\n");
    options.prior = Some(priors);
    for study in &mut walkers {
        study.options = options;
        study.fit(&|_| ());
    }
    typical(&walkers, &options);
    stiffness_mdc(&walkers, &options);
    Ok(())
}

/// Prints the minimal detectable change of the stiffness K that an insole tracks. K is identified from one half of a walker's
/// steps and tracked through the other half, in both orders; the wearer does not change, so every change that the insole
/// reports is an error.
fn stiffness_mdc(walkers: &[Study], options: &Options) {
    let mdc = |region: usize| {
        let of_walker = |study: &Study| {
            let (first, second) = study.steps.split_at(study.steps.len() / 2);
            [(first, second), (second, first)]
                .into_iter()
                .flat_map(|(identified, walked)| changes(identified, walked, region, options))
                .collect::<Vec<_>>()
        };
        // Each pair counts as two trials of one person: the identified K, of which the change is 0, and the tracked K.
        let trials: Vec<Vec<f64>> = walkers.iter().flat_map(of_walker).map(|change| vec![0.0, change]).collect();
        // NaN does not occur, because ten walkers load every region.
        within_person(&trials).map_or(f64::NAN, |(_, mdc)| mdc)
    };
    let mdcs: [f64; 8] = std::array::from_fn(mdc);
    println!("\npub const STIFFNESS_MDC: [f64; 8] = {mdcs:.2?};");
}

/// The changes of K that the insole reports in the steps `walked`, with parameters identified from the steps `identified`.
fn changes(identified: &[Step], walked: &[Step], region: usize, options: &Options) -> Vec<f64> {
    let Ok(mut law) = fit::fit_force_law(identified, region, options) else { return Vec::new() };
    let mut laws = [ForceLaw::NONE; 8];
    laws[region] = law;
    let mut tracker = Tracker::OFF;
    tracker.start(&laws, u8::MAX);
    let changes = walked.iter().map(|step| {
        let RegionCurves { area_mm2, force_n, sample_s, saturated, .. } = &step.regions[region];
        let evaluated = RegionStep::new(&law, area_mm2, force_n, *sample_s, &AreaMoments::NONE);
        tracker.adapt(region, &mut law, &evaluated, !saturated && !evaluated.clamped)
    });
    // The change is 0 until the tracking has collected enough steps.
    changes.filter(|change| *change != 0.0).collect()
}

/// Prints the parameters that are fitted to every third step of all walkers together, and two ranges of these steps, from the
/// 1 % to the 99 % quantile: of the largest area, and of the largest force divided by the largest area.
fn typical(walkers: &[Study], options: &Options) {
    let pooled: Vec<Step> = walkers.iter().flat_map(|study| study.steps.iter().step_by(3).cloned()).collect();
    println!("const SIZE_42: [Typical; 8] = [");
    for (region, fit) in fit::fit(&pooled, &Options { resamples: 0, ..*options }, &|_| ()).into_iter().enumerate() {
        // Every region is fitted, because ten walkers load every region.
        let Ok(fit) = fit else { continue };
        let (law, e) = (&fit.law, &fit.ellipsoid);
        let peaks: Vec<[f64; 2]> = pooled
            .iter()
            .map(|step| &step.regions[region])
            .map(|curves| {
                let area_mm2 = curves.area_mm2.iter().copied().fold(0.0, f64::max);
                let force_n = curves.force_n.iter().copied().fold(0.0, f64::max);
                [area_mm2, force_n / area_mm2 * 1e3]
            })
            .filter(|peak| peak[1].is_finite())
            .collect();
        let quantile = |i: usize, share: f64| {
            let mut values: Vec<f64> = peaks.iter().map(|peak| peak[i]).collect();
            values.sort_by(f64::total_cmp);
            values[(share * (values.len() - 1) as f64).round() as usize]
        };
        println!(
            "    // {}: error {:.0} %, spread of force {:.2}",
            Region::ALL[region].name(),
            fit.quality.fitted * 100.0,
            spread(walkers, region, law, fit.area_max_m2)
        );
        println!(
            "    typical([{:.1}, {:.1}, {:.1}], {:.1}, [{:.1}, {:.2}, {:.2}, {:.2}], [{:.1}, {:.1}], [{:.1}, {:.1}]),",
            e.a_m * 1e3,
            e.b_m * 1e3,
            e.c_m * 1e3,
            e.d0_m * 1e3,
            law.stiffness_pa * 1e-3,
            law.damping_pa_s * 1e-3,
            law.n,
            law.m,
            quantile(0, 0.01),
            quantile(0, 0.99),
            quantile(1, 0.01),
            quantile(1, 0.99),
        );
    }
    println!("];");
}

/// The factor by which the elastic forces of the walkers differ from the pooled law at half of the largest area, one standard
/// deviation.
fn spread(walkers: &[Study], region: usize, pooled: &ForceLaw<f64>, area_max_m2: f64) -> f64 {
    let force_n = |law: &ForceLaw<f64>| law.force_n(law.area_ratio(0.5 * area_max_m2).normalised_deformation(), 0.0);
    let ratios: Vec<f64> = walkers
        .iter()
        .filter_map(|study| Some((force_n(&study.fits[region].as_ref().ok()?.law) / force_n(pooled)).ln()))
        .collect();
    (ratios.iter().map(|ratio| ratio * ratio).sum::<f64>() / ratios.len() as f64).sqrt().exp()
}

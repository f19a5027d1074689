//! `plantar fit`: identifies personal parameters from recordings.

use crate::replay::progress;
use crate::setup::{self, ContactArgs, ZeroArgs, rule_in_words};
use crate::summary;
use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use fit::interval::{FIVE, Interval, RESAMPLES};
use fit::pins::COMPRESSION;
use fit::{Bounds, Filter, Method, Options, RegionFit, Study};
use parameters::{Identified, InsoleSize, Parameters, Thickness};
use plantar::checksum::crc32;
use plantar::{Region, Side};
use recording::Recording;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Identifies a person's tissue parameters from recordings of walking.
///
/// Give any number of recordings of one person: several trials, both feet. Complete steps are extracted with the insole's own
/// code, and each region is fitted separately. Send the resulting file to an insole with `plantar params push`, and use it in
/// `plantar replay` and `plantar emulate` with --params.
///
/// Exit status: 0 where all eight regions were fitted, 3 where some were, 1 where none was.
#[derive(Args)]
pub struct Fit {
    /// The recordings.
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// The parameter file to write.
    #[arg(long, value_name = "FILE", default_value = "params.toml")]
    out: PathBuf,
    /// Write a report with pictures to this file: .html, which loads nothing from a network.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Write the pictures of the report to this file: .png.
    #[cfg(feature = "png")]
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    /// Write all results to this file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Name of the person [default: the name of the first recording].
    #[arg(long, value_name = "NAME")]
    participant: Option<String>,
    /// Fit only to these steps of every recording, counted from 0: N or N-M.
    #[arg(long, value_name = "STEPS")]
    steps: Option<StepRange>,
    #[command(flatten)]
    search: Search,
    #[command(flatten)]
    contact: ContactArgs,
    #[command(flatten)]
    zero: ZeroArgs,
}

/// Filter, method and bounds of the identification.
#[derive(Clone, Args)]
pub struct Search {
    /// Which of the insole's filters to use: that of the step record or that of the live stream.
    #[arg(long, value_enum, default_value_t = FilterName::Step)]
    filter: FilterName,
    /// The method: five parameters by variable projection or, for comparison, the paper's eight from ten starts.
    #[arg(long, value_enum, default_value_t = MethodName::Projection)]
    method: MethodName,
    /// Allow a negative stiffness exponent, down to -0.95. The paper does not, but many regions fit better with it.
    #[arg(long)]
    negative_n: bool,
    /// Tissue thickness in mm, a TOML file with lines such as `heel = 17.5`; other regions have the value of the table.
    #[arg(long, value_name = "FILE")]
    pub(crate) thickness: Option<PathBuf>,
    /// European shoe size, 35 to 46, which selects the tissue thickness from the table.
    #[arg(long, default_value_t)]
    pub(crate) size: InsoleSize,
    /// Largest compression of the tissue as a fraction of its thickness; it determines C.
    #[arg(long, value_name = "FRACTION", default_value_t = COMPRESSION)]
    compression: f64,
}

#[derive(Clone, Copy, ValueEnum)]
enum FilterName {
    Step,
    Live,
}

#[derive(Clone, Copy, ValueEnum)]
enum MethodName {
    Projection,
    Paper,
}

/// First and last step.
#[derive(Clone, Copy)]
struct StepRange(u32, u32);

impl FromStr for StepRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (first, last) = text.split_once('-').unwrap_or((text, text));
        match (first.parse(), last.parse()) {
            (Ok(first), Ok(last)) if first <= last => Ok(Self(first, last)),
            _ => Err("steps are N or N-M, counted from 0".into()),
        }
    }
}

impl Search {
    /// The library's options.
    pub fn options(&self, resamples: u64) -> Result<Options> {
        if !(0.05..=0.95).contains(&self.compression) {
            bail!("--compression {}: a fraction of the thickness, 0.05 to 0.95", self.compression);
        }
        let mut thickness_m = self.size.thickness_m();
        if let Some(path) = &self.thickness {
            Thickness::read(path)?.apply(&mut thickness_m);
        }
        let mut bounds = Bounds::USUAL;
        if self.negative_n {
            bounds.n[0] = Bounds::LEAST_N;
        }
        Ok(Options {
            filter: match self.filter {
                FilterName::Step => Filter::Step,
                FilterName::Live => Filter::Live,
            },
            method: match self.method {
                MethodName::Projection => Method::Projection,
                MethodName::Paper => Method::Paper,
            },
            bounds,
            thickness_m,
            compression: self.compression,
            resamples,
        })
    }
}

impl Fit {
    /// Runs the command. Returns true where all regions were fitted.
    pub fn run(&self) -> Result<bool> {
        let participant = self.participant.clone().unwrap_or_else(|| stem(&self.recordings[0]));
        let mut study = Study::new(participant, self.contact.rule(None)?, self.search.options(RESAMPLES)?);
        let mut known = Vec::new();
        for path in &self.recordings {
            add(&mut study, path, &self.zero, &mut known)?;
        }
        if let Some(StepRange(first, last)) = self.steps {
            let most = study.steps.iter().map(|step| step.number).max();
            study.steps.retain(|step| (first..=last).contains(&step.number));
            if let (true, Some(most)) = (study.steps.is_empty(), most) {
                bail!("--steps {first}-{last}: the recordings have steps 0 to {most}");
            }
        }
        let bar = progress(8, "regions");
        study.fit(&|_| bar.inc(1));
        bar.finish_and_clear();

        print(&study);
        let fitted = study.fits.iter().flatten().count();
        if fitted > 0 {
            write(&self.out, to_toml(&study, self.search.size).as_bytes())?;
        }
        if let Some(path) = &self.json {
            let text = serde_json::to_string_pretty(&to_json(&study))? + "\n";
            write(path, text.as_bytes())?;
        }
        if let Some(path) = &self.report {
            write(path, report::html(&study).as_bytes())?;
        }
        #[cfg(feature = "png")]
        if let Some(path) = &self.png {
            write(path, &report::png(&study)?)?;
        }
        if fitted == 0 {
            bail!("no region could be fitted; {} is not written", self.out.display());
        }
        println!("wrote {}: {fitted} of 8 regions identified", self.out.display());
        Ok(fitted == 8)
    }
}

/// Adds the steps of a recording. `known` are the checksums of the previous ones: with a recording given twice, a step would be
/// predicted from itself.
fn add(study: &mut Study, path: &Path, zero: &ZeroArgs, known: &mut Vec<u32>) -> Result<()> {
    let recording = Recording::read(path)?;
    let sum = crc32(&recording.pressure_kpa.iter().flat_map(|kpa| kpa.to_le_bytes()).collect::<Vec<_>>());
    if let Some(before) = known.iter().position(|known| *known == sum) {
        bail!("{} is the same recording as {}: give each once", path.display(), study.sources[before].name);
    }
    known.push(sum);
    let mut insole = setup::insole(&recording, study.contact)?;
    zero.apply(&mut insole)?;
    let bar = progress(recording.frames() as u64, "frames");
    study
        .add(path.display().to_string(), &recording, &insole, &mut |done| bar.set_position(done as u64))
        .with_context(|| format!("{}: the insole is not valid", path.display()))?;
    bar.finish_and_clear();
    Ok(())
}

/// The name of a file without folder and extension.
pub fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    std::fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

fn print(study: &Study) {
    println!(
        "{}: {} steps of {} recordings, {} filter, {}",
        study.participant,
        study.steps.len(),
        study.sources.len(),
        study.options.filter.name(),
        rule_in_words(&study.contact)
    );
    for contact in &study.left_out {
        println!("left out: {} at {:.2} s, {}", study.sources[contact.recording].name, contact.at_s, contact.why);
    }
    let mut table = summary::table();
    table.set_header(["region", "steps", "A B mm2", "K kPa", "G kPa s", "n", "m", "error %", "unseen %", "floor %"]);
    for (region, fit) in Region::ALL.iter().zip(&study.fits) {
        let mut row = vec![region.name().to_string()];
        match fit {
            Ok(fit) => {
                row.push(fit.steps.len().to_string());
                row.extend(five_in_words(fit));
                let percent = |share: f64| format!("{:.1}", share * 100.0);
                row.extend([percent(fit.quality.fitted), fit.quality.predicted.map_or("-".into(), percent)]);
                row.push(percent(fit.quality.floor));
            }
            Err(_) => row.extend(std::iter::repeat_n("-".to_string(), 9)),
        }
        table.add_row(row);
    }
    summary::align(&mut table);
    println!("{table}");
    println!(
        "Error: NRMSE of the model against the measured force (Eq. 20), mean of the steps; unseen: each step predicted from the"
    );
    println!(
        "others; floor: the least error of any elastic law of this area. In brackets: 95 % intervals. !: at a bound."
    );
    for (region, fit) in Region::ALL.iter().zip(&study.fits) {
        match fit {
            Ok(fit) => {
                println!("{}: {}", region.name(), fit.verdict);
                fit.warnings.iter().for_each(|warning| println!("    {warning}"));
            }
            Err(reason) => println!("{}: NOT FITTED, {reason}", region.name()),
        }
    }
}

/// A B (mm2), K (kPa), G (kPa s), n, m, each with the wider interval.
fn five_in_words(fit: &RegionFit) -> Vec<String> {
    let g = &fit.law;
    let units = [1e6, 1e-3, 1e-3, 1.0, 1.0];
    match &fit.uncertainty {
        Some(uncertainty) => uncertainty
            .intervals
            .iter()
            .zip(units)
            .map(|(interval, unit)| {
                if !interval.told {
                    return "-".into();
                }
                let [low, high] = widest(interval).map(|end| summary::significant(end * unit));
                let mark = if interval.at_bound { "!" } else { "" };
                format!("{}{mark} ({low}..{high})", summary::significant(interval.value * unit))
            })
            .collect(),
        None => {
            let values = [g.ab_m2, g.stiffness_pa, g.damping_pa_s, g.n, g.m];
            values.iter().zip(units).map(|(value, unit)| summary::significant(value * unit)).collect()
        }
    }
}

/// The wider one of the intervals from the Jacobian and from resampled steps.
fn widest(interval: &Interval) -> [f64; 2] {
    let width = |[low, high]: [f64; 2]| high - low;
    interval.bootstrap.filter(|b| width(*b) > width(interval.jacobian)).unwrap_or(interval.jacobian)
}

/// The parameter file. A region that was not fitted has typical values, with a comment.
fn to_toml(study: &Study, size: InsoleSize) -> String {
    let mut parameters = Parameters::typical(size);
    parameters.subject.clone_from(&study.participant);
    parameters.personal = true;
    let has = |side: Side| study.steps.iter().any(|step| step.side == side);
    let side = match (has(Side::Left), has(Side::Right)) {
        (true, true) => "both",
        (true, false) => Side::Left.name(),
        _ => Side::Right.name(),
    };
    parameters.identified = Some(Identified {
        filter: study.options.filter.name().into(),
        contact: study.contact,
        side: side.into(),
        steps: study.steps.len() as u32,
    });
    for (slot, fit) in parameters.regions.iter_mut().zip(&study.fits) {
        if let Ok(fit) = fit {
            *slot = fit.ellipsoid;
        }
    }
    parameters.to_toml_with(&|region, name| Some(note(&study.fits[region as usize], name, study.options.method)))
}

/// The comment on a value: how it was determined.
fn note(fit: &Result<RegionFit, fit::Unfit>, name: &str, method: Method) -> String {
    let fit = match fit {
        Ok(fit) => fit,
        Err(reason) if name == "a_mm" => return format!("typical, NOT identified: {reason}"),
        Err(_) => return "typical".into(),
    };
    let Some(uncertainty) = fit.uncertainty.as_ref().filter(|_| method == Method::Projection) else {
        return "identified, all eight together (the paper's search)".into();
    };
    let identified = |i: usize, scale: f64| {
        let interval = &uncertainty.intervals[i];
        if !interval.told {
            return "NOT identifiable from force: G is 0".into();
        }
        let [low, high] = widest(interval).map(|end| summary::significant(end * scale));
        let bound = if interval.at_bound { ", at a bound of the search" } else { "" };
        format!("{low} to {high} (95 %){bound}")
    };
    let pins = &fit.pins;
    match name {
        "a_mm" => format!("A B identified, {} mm2; A / B measured, {:.2}", identified(0, 1e6), pins.aspect),
        "b_mm" => "as a_mm".into(),
        "c_mm" => format!("pinned: largest compression {:.1} % of d0", pins.compression * 100.0),
        "d0_mm" => "pinned: given or from the table".into(),
        "k_n_m3" => format!("identified: K = k C^(n+1) / d0^n, {} Pa", identified(1, 1.0)),
        "c_n_s_m3" => format!("identified: G = c C^(m+1) / d0^m, {} Pa s", identified(2, 1.0)),
        "n" => format!("identified, {}", identified(3, 1.0)),
        _ => format!("identified, {}", identified(4, 1.0)),
    }
}

fn to_json(study: &Study) -> Value {
    let regions: Map<String, Value> =
        Region::ALL.iter().zip(&study.fits).map(|(region, fit)| (region.name().into(), fit_to_json(fit))).collect();
    json!({
        "participant": study.participant,
        "recordings": study.sources.iter().map(|s| json!({
            "name": s.name, "side": s.side.name(),
            "rate_hz": s.rate_hz, "cells": s.layout.cells.len(), "origin": s.origin,
        })).collect::<Vec<_>>(),
        "contact_rule": {
            "on_kpa": study.contact.on_kpa, "off_kpa": study.contact.off_kpa, "full_kpa": study.contact.full_kpa,
        },
        "filter": study.options.filter.name(),
        "method": study.options.method.name(),
        "steps": study.steps.iter().map(|s| json!({
            "recording": s.recording, "number": s.number, "start_s": s.start_s, "duration_s": s.duration_s,
            "peak_force_n": s.peak_n,
        })).collect::<Vec<_>>(),
        "left_out": study.left_out.iter().map(|c| json!({
            "recording": c.recording, "at_s": c.at_s, "why": c.why.to_string(),
        })).collect::<Vec<_>>(),
        "regions": regions,
    })
}

fn fit_to_json(fit: &Result<RegionFit, fit::Unfit>) -> Value {
    let fit = match fit {
        Ok(fit) => fit,
        Err(reason) => return json!({ "fitted": false, "reason": reason.to_string() }),
    };
    let (g, e, q) = (&fit.law, &fit.ellipsoid, &fit.quality);
    let intervals = fit.uncertainty.as_ref().map(|uncertainty| {
        let names = ["ab_m2", "stiffness_pa", "damping_pa_s", "n", "m"];
        let of = |i: &Interval| json!({ "jacobian": i.jacobian, "bootstrap": i.bootstrap, "at_bound": i.at_bound, "told": i.told });
        let all: Map<String, Value> =
            names.iter().zip(&uncertainty.intervals).map(|(name, i)| ((*name).into(), of(i))).collect();
        json!({ "order": FIVE, "intervals_95": all, "correlation": uncertainty.correlation })
    });
    json!({
        "fitted": true,
        "steps": fit.steps,
        "area_max_mm2": fit.area_max_m2 * 1e6,
        "identified": {
            "ab_m2": g.ab_m2, "stiffness_pa": g.stiffness_pa, "damping_pa_s": g.damping_pa_s, "n": g.n, "m": g.m,
        },
        "uncertainty": intervals,
        "ellipsoid": {
            "a_mm": e.a_m * 1e3, "b_mm": e.b_m * 1e3, "c_mm": e.c_m * 1e3, "d0_mm": e.d0_m * 1e3,
            "k_n_m3": e.k, "n": e.n, "c_n_s_m3": e.c, "m": e.m,
        },
        "pinned": { "aspect": fit.pins.aspect, "d0_mm": fit.pins.thickness_m * 1e3, "compression": fit.pins.compression },
        "nrmse_percent": {
            "fitted": q.fitted * 100.0, "fitted_smoothed": q.fitted_smoothed * 100.0,
            "own": q.own * 100.0, "own_smoothed": q.own_smoothed * 100.0,
            "predicted": q.predicted.map(|p| p * 100.0), "floor": q.floor * 100.0,
        },
        "peak_bias_percent": q.peak_bias * 100.0,
        "saturated_share": q.saturated,
        "unseen_percent": fit.unseen.iter().map(|share| share * 100.0).collect::<Vec<_>>(),
        "area_levels": fit.area_levels,
        "recordings_ratio": fit.recordings_ratio,
        "evaluations": fit.evaluations,
        "verdict": fit.verdict,
        "warnings": fit.warnings,
    })
}

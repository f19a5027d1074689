//! The fit of one region: search, pins, intervals and quality.

use crate::identify::{Identified, identify as identify_by_projection, refine};
use crate::interval::{self, Uncertainty};
use crate::pins::Pins;
use crate::quality::{Evaluated, Quality};
use crate::screen::{NotFitted, usable};
use crate::steps::MeanEllipse;
use crate::{Method, Options, RegionCurves, Samples, Step, paper, steps, verdict};
use plantar::Side;
use plantar::pipeline::model::{Ellipsoid, ForceLaw, LENGTH_M, is_within};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// The result of one region.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionFit {
    /// Indices of the steps that were used.
    pub steps: Vec<usize>,
    /// Largest area in these steps, filtered or not, m2.
    pub area_max_m2: f64,
    /// The force law that a device evaluates.
    pub law: ForceLaw<f64>,
    /// The paper's eight parameters.
    pub ellipsoid: Ellipsoid<f64>,
    /// The values that pinned three of the eight.
    pub pins: Pins,
    /// Confidence intervals of the five identifiable parameters; `None` for [`Method::Paper`].
    pub uncertainty: Option<Uncertainty>,
    /// Errors.
    pub quality: Quality,
    /// NRMSE of each step with parameters that were fitted to the other steps, as a fraction; empty for a single step.
    pub unseen: Vec<f64>,
    /// Number of different areas in a step, median of the steps.
    pub area_levels: usize,
    /// Median error of one recording's steps predicted from the other recordings, divided by the error predicted from itself; the
    /// largest of all recordings. `None` without ten steps in each of two recordings of a foot.
    pub recordings_ratio: Option<f64>,
    /// Number of evaluations of the model over all samples in the fit to all steps.
    pub evaluations: usize,
    /// Assessment of the fit, in a sentence.
    pub verdict: String,
    /// Limitations of the fit, in sentences.
    pub warnings: Vec<String>,
}

/// Fits one region to one step alone, as the paper does before it averages.
///
/// # Errors
/// The reason if the region cannot be fitted to the step.
pub fn fit_step(step: &Step, region: usize, options: &Options) -> Result<(RegionFit, Evaluated), NotFitted> {
    let steps = std::slice::from_ref(step);
    let used = usable(steps, region, options.filter)?;
    let curves = &steps[used[0]].regions[region];
    let best = search([curves], options);
    let pins = best.pins(pins_of(&[curves], region, options));
    let evaluated = Evaluated::new(curves, options.filter, &best.law).ok_or(NotFitted::NeverLoaded)?;
    let one = std::slice::from_ref(&evaluated);
    let quality = Quality::new(one, one, &[]);
    let uncertainty = best.identified.map(|i| interval::from_jacobian(&best.samples, &options.bounds, &i));
    Ok((best.into_fit(used, pins, uncertainty, quality)?, evaluated))
}

/// Fits one region to all steps that pass the screening.
///
/// # Errors
/// The reason if no step passes or the result is out of range.
pub(crate) fn fit_region(steps: &[Step], region: usize, options: &Options) -> Result<RegionFit, NotFitted> {
    let used = usable(steps, region, options.filter)?;
    let curves: Vec<&RegionCurves> = used.iter().map(|&i| &steps[i].regions[region]).collect();
    let recordings: Vec<_> = used.iter().map(|&i| (steps[i].recording, steps[i].side)).collect();
    let best = search(curves.iter().copied(), options);
    let recordings_ratio = recordings_ratio(&curves, &recordings, &best, options);
    let pins = best.pins(pins_of(&curves, region, options));

    let uncertainty = best.identified.map(|identified| {
        let mut uncertainty = interval::from_jacobian(&best.samples, &options.bounds, &identified);
        let area_max_m2 = best.samples.area_max_m2;
        interval::add_bootstrap(&mut uncertainty, &curves, options, &identified, area_max_m2);
        uncertainty
    });
    let evaluate = |curves: &RegionCurves, law: &ForceLaw<f64>| Evaluated::new(curves, options.filter, law);
    let fitted: Vec<_> = curves.iter().filter_map(|c| evaluate(c, &best.law)).collect();
    let own: Vec<_> = curves.par_iter().filter_map(|c| evaluate(c, &search([*c], options).law)).collect();
    let unseen = cross_validate(&curves, &best, options);
    let quality = Quality::new(&fitted, &own, &unseen);
    let fit = best.into_fit(used, pins, uncertainty, quality)?;
    Ok(RegionFit { unseen, recordings_ratio, ..fit })
}

/// Cross-validation leaves out each step individually, up to this number of steps.
const LEFT_OUT_ALONE: usize = 60;
/// With more steps, cross-validation leaves them out in this number of groups.
const GROUPS: usize = 20;

/// The NRMSE of each step with parameters that were fitted to the other steps; empty for a single step.
fn cross_validate(curves: &[&RegionCurves], near: &SearchResult, options: &Options) -> Vec<f64> {
    let groups = match curves.len() {
        0 | 1 => return Vec::new(),
        count if count <= LEFT_OUT_ALONE => count,
        _ => GROUPS,
    };
    let force_laws: Vec<_> = (0..groups)
        .into_par_iter()
        .map(|group| {
            refit(curves.iter().enumerate().filter(|(i, _)| i % groups != group).map(|(_, c)| *c), near, options)
        })
        .collect();
    let evaluated = curves.iter().enumerate().map(|(i, c)| Evaluated::new(c, options.filter, &force_laws[i % groups]));
    evaluated.map(|evaluated| evaluated.map_or(f64::NAN, |e| e.nrmse())).collect()
}

/// The result of a search.
struct SearchResult {
    samples: Samples,
    law: ForceLaw<f64>,
    identified: Option<Identified>,
    /// All eight parameters, where the search of the paper found them.
    ellipsoid: Option<Ellipsoid<f64>>,
    evaluations: usize,
}

/// C, m, before it is pinned. Any value is possible, because the force does not depend on it.
const ANY_C_M: f64 = 0.01;

/// Searches the parameters with the method of the options.
fn search<'c>(curves: impl IntoIterator<Item = &'c RegionCurves>, options: &Options) -> SearchResult {
    let samples = Samples::new(curves, options.filter);
    match options.method {
        Method::Projection => {
            let identified = identify_by_projection(&samples, &options.bounds);
            let law = identified.law(samples.area_max_m2, ANY_C_M);
            let evaluations = identified.evaluations;
            SearchResult { samples, law, identified: Some(identified), ellipsoid: None, evaluations }
        }
        Method::Paper => {
            let (ellipsoid, evaluations) = paper::identify(&samples);
            SearchResult {
                samples,
                law: ellipsoid.force_law(),
                identified: None,
                ellipsoid: Some(ellipsoid),
                evaluations,
            }
        }
    }
}

/// Fits to a part of the steps, starting from the fit to all of them.
fn refit<'c>(
    curves: impl IntoIterator<Item = &'c RegionCurves>,
    near: &SearchResult,
    options: &Options,
) -> ForceLaw<f64> {
    let Some(identified) = &near.identified else { return search(curves, options).law };
    let samples = Samples::new(curves, options.filter);
    let start = identified.rebased(near.samples.area_max_m2, samples.area_max_m2, &options.bounds);
    refine(&samples, &options.bounds, &start).law(samples.area_max_m2, ANY_C_M)
}

impl SearchResult {
    /// Normalised deformation at the largest area.
    fn g_max(&self) -> f64 {
        self.law.area_ratio(self.samples.area_max_m2).normalised_deformation()
    }

    /// `pinned`, or the values that correspond to an ellipsoid that was searched directly.
    fn pins(&self, pinned: Pins) -> Pins {
        self.ellipsoid.map_or(pinned, |ellipsoid| paper::pins(&ellipsoid, &self.law, self.g_max()))
    }

    fn into_fit(
        self,
        steps: Vec<usize>,
        pins: Pins,
        uncertainty: Option<Uncertainty>,
        quality: Quality,
    ) -> Result<RegionFit, NotFitted> {
        let law = ForceLaw { c_m: pins.c_m(self.g_max()), ..self.law };
        let ellipsoid = self.ellipsoid.unwrap_or_else(|| pins.ellipsoid(&law));
        let lengths = [ellipsoid.a_m, ellipsoid.b_m, ellipsoid.c_m, ellipsoid.d0_m];
        if !law.is_valid() || !lengths.iter().all(|&length| is_within(length, &LENGTH_M)) {
            return Err(NotFitted::OutOfRange);
        }
        let levels = self.samples.steps.iter().map(|step| {
            let areas: BTreeSet<u64> = self.samples.raw_area_m2[step.clone()].iter().map(|a| a.to_bits()).collect();
            areas.len() as f64
        });
        let mut fit = RegionFit {
            area_levels: steps::median(levels) as usize,
            steps,
            area_max_m2: self.samples.area_max_m2,
            law,
            ellipsoid,
            pins,
            uncertainty,
            quality,
            unseen: Vec::new(),
            recordings_ratio: None,
            evaluations: self.evaluations,
            verdict: String::new(),
            warnings: Vec::new(),
        };
        fit.verdict = verdict::verdict(&fit);
        fit.warnings = verdict::warnings(&fit);
        Ok(fit)
    }
}

/// The pins from the contact ellipses of the steps and from the options.
fn pins_of(curves: &[&RegionCurves], region: usize, options: &Options) -> Pins {
    let aspect = MeanEllipse::of_steps(curves.iter().copied()).map_or(1.0, |e| e.r_a_mm / e.r_b_mm);
    Pins { aspect, thickness_m: options.thickness_m[region], compression: options.compression }
}

/// Smallest number of steps in a recording for a comparison. With fewer steps, recordings of one person differ by chance.
const COMPARED_STEPS: usize = 10;

/// Median error of a recording's steps predicted from the other recordings of the same foot, divided by the error predicted from
/// itself; the largest of all recordings, `None` if none can be compared. `recordings` has the recording and the foot of each
/// curve.
fn recordings_ratio(
    curves: &[&RegionCurves],
    recordings: &[(usize, Side)],
    near: &SearchResult,
    options: &Options,
) -> Option<f64> {
    let groups: BTreeMap<usize, Side> = recordings.iter().copied().collect();
    let ratios = groups.into_iter().filter_map(|(group, side)| {
        let of = |wanted: bool| {
            let pairs = curves.iter().zip(recordings);
            let pairs = pairs.filter(move |(_, (r, s))| (*r == group) == wanted && *s == side);
            pairs.map(|(c, _)| *c).collect::<Vec<&RegionCurves>>()
        };
        let (own, others) = (of(true), of(false));
        if own.len() < COMPARED_STEPS || others.len() < COMPARED_STEPS {
            return None;
        }
        let error = |law: &ForceLaw<f64>| {
            let errors = own.iter().filter_map(|c| Some(Evaluated::new(c, options.filter, law)?.nrmse()));
            steps::median(errors)
        };
        let from_own = error(&refit(own.iter().copied(), near, options));
        Some(error(&refit(others, near, options)) / from_own)
    });
    ratios.max_by(f64::total_cmp)
}

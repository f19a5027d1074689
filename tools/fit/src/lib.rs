//! Identifies a person's viscoelastic ellipsoids from recorded steps (the paper's section 2.5), without any I/O.
//!
//! [`steps::isolate`] takes steps out of recordings with the insole's own code; [`fit`] finds the five parameters that force
//! can tell in every region ([`identify`]), pins the other three of the paper's eight ([`pins`]), and says how sure
//! ([`interval`]) and how good ([`quality`]) they are. [`paper`] is the paper's own search, for comparison.

pub mod identify;
pub mod interval;
pub mod law;
pub mod paper;
pub mod pins;
pub mod quality;
pub mod steps;
pub mod study;
pub mod synthetic;

mod bounded;
mod samples;
mod verdict;

pub use identify::Bounds;
pub use samples::Samples;
pub use steps::{Filter, RegionCurves, Step};
pub use study::Study;

use identify::{Identified, identify as project, refine};
use interval::Uncertainty;
use pins::Pins;
use plantar::Region;
use plantar::model::{Ellipsoid, Gauge};
use quality::Evaluated;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::fmt;

/// How to search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Five parameters, variable projection, no random start.
    Projection,
    /// The paper's: eight variables, ten starts.
    Paper,
}

/// What to fit through and within.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// The filter that the device will run.
    pub filter: Filter,
    /// How to search.
    pub method: Method,
    /// Within what; not used by [`Method::Paper`].
    pub bounds: Bounds,
    /// Per region, in the order of [`Region::ALL`]: thickness of the unloaded tissue, m.
    pub thickness_m: [f64; 8],
    /// Largest deformation over thickness.
    pub compression: f64,
    /// How often steps are resampled for the second kind of interval; 0 for not at all, [`interval::RESAMPLES`] for good.
    pub resamples: u64,
}

/// Fewer samples in contact than this do not carry five parameters.
pub const LEAST_SAMPLES: usize = 12;
/// A region that never carries more, N, counts as unloaded: the force below which a whole foot does.
pub const LEAST_FORCE_N: f64 = 20.0;
/// An area that stays at its largest for this share of the contact tells nothing of how force grows with it.
const SATURATED_SHARE: f64 = 0.8;
/// Recordings that predict each other this much worse than themselves in [`MIXED_REGIONS`] regions are of two people: so it
/// is for eight of ten pairs of the walkers of SpeedPP2DS, and for none of ten walkers' own halves.
const MIXED_RATIO: f64 = 1.8;
/// See [`MIXED_RATIO`].
const MIXED_REGIONS: usize = 2;
/// An area this close to the largest is at it.
const SATURATED_AREA: f64 = 0.98;

/// Why a region could not be fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unfit {
    /// No step at all.
    NoSteps,
    /// No cell of the region was ever in contact.
    NeverLoaded,
    /// In contact but without force.
    ZeroForce,
    /// The largest force of any step, N, is below [`LEAST_FORCE_N`].
    HardlyLoaded(f64),
    /// The longest contact has this many samples, fewer than [`LEAST_SAMPLES`].
    TooFewFrames(usize),
    /// A cell was at the end of its scale in every step.
    Clipped,
    /// The area never changes.
    ConstantArea,
    /// The area is at its largest for this share of the contact.
    SaturatedArea(f64),
    /// The recordings disagree: error of one predicted from the other over that predicted from itself.
    MixedPeople(f64),
}

impl fmt::Display for Unfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSteps => f.write_str("no whole step: record a walk of several steps"),
            Self::NeverLoaded => {
                f.write_str("never loaded: no cell of it came into contact; check layout and threshold")
            }
            Self::ZeroForce => f.write_str("in contact but without force: check calibration and zero"),
            Self::HardlyLoaded(peak_n) => {
                write!(f, "hardly loaded: at most {peak_n:.1} N in any step, {LEAST_FORCE_N} N are needed")
            }
            Self::TooFewFrames(samples) => {
                write!(f, "too few frames: {samples} in contact, {LEAST_SAMPLES} are needed; record at a higher rate")
            }
            Self::Clipped => {
                f.write_str("clipped: a cell was at the end of its scale in every step; use a sensor of a higher range")
            }
            Self::ConstantArea => f.write_str("constant area: contact never grows or shrinks, so nothing can be told"),
            Self::SaturatedArea(share) => write!(
                f,
                "saturated area: all of it is in contact for {:.0} % of the time; use smaller cells or --contact-full",
                share * 100.0
            ),
            Self::MixedPeople(ratio) => write!(
                f,
                "the recordings disagree: one predicts the other {ratio:.1} times worse than itself; are they of one person?"
            ),
        }
    }
}

impl std::error::Error for Unfit {}

/// How well the parameters do; NRMSE (Eq. 20) as a share, mean over the steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// All steps with the parameters that were fitted to all, against the raw force.
    pub fitted: f64,
    /// The same against the force through the paper's quintic.
    pub fitted_smoothed: f64,
    /// Every step with parameters fitted to it alone, against the raw force.
    pub own: f64,
    /// The same against the smoothed force.
    pub own_smoothed: f64,
    /// Every step with parameters fitted to the others, against the raw force; needs two steps.
    pub predicted: Option<f64>,
    /// Best rising function of area, each step alone: no elastic law of this area does better.
    pub floor: f64,
    /// Largest model over largest measured force, less 1.
    pub peak_bias: f64,
    /// Share of the contact in which area is at its largest while force still changes.
    pub saturated: f64,
}

/// One region's result.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionFit {
    /// Which of the steps were used, by their place.
    pub steps: Vec<usize>,
    /// The largest area of them, filtered or not, m2.
    pub area_max_m2: f64,
    /// What a device evaluates.
    pub gauge: Gauge<f64>,
    /// The paper's eight.
    pub ellipsoid: Ellipsoid<f64>,
    /// What pinned three of them.
    pub pins: Pins,
    /// Intervals of the five; none for [`Method::Paper`].
    pub uncertainty: Option<Uncertainty>,
    /// How good.
    pub quality: Quality,
    /// Median error of one recording's steps predicted from the other recordings, over that from itself: the worst of them.
    /// `None` without three steps in each of two recordings.
    pub recordings_ratio: Option<f64>,
    /// How often the model was evaluated over all samples in the fit to all steps.
    pub evaluations: usize,
    /// What to do with it, in a sentence.
    pub verdict: String,
    /// What else to know, in sentences.
    pub warnings: Vec<String>,
}

/// Fits every region, in the order of [`Region::ALL`]. `progress` is told the regions that are done, in any order.
pub fn fit(steps: &[Step], options: &Options, progress: &(dyn Fn(Region) + Sync)) -> [Result<RegionFit, Unfit>; 8] {
    let mut fits: Vec<_> = (0..8)
        .into_par_iter()
        .map(|region| {
            let fit = fit_region(steps, region, options);
            progress(Region::ALL[region]);
            fit
        })
        .collect();
    let differs = |fit: &RegionFit| fit.recordings_ratio.filter(|ratio| *ratio > MIXED_RATIO);
    if fits.iter().flatten().filter_map(differs).count() >= MIXED_REGIONS {
        for fit in &mut fits {
            if let Some(ratio) = fit.as_ref().ok().and_then(differs) {
                *fit = Err(Unfit::MixedPeople(ratio));
            }
        }
    }
    std::array::from_fn(|_| fits.remove(0))
}

/// The parameters of one region in one step alone: the paper's way, to be averaged.
pub fn fit_step(step: &Step, region: usize, options: &Options) -> Result<(RegionFit, Evaluated), Unfit> {
    let steps = std::slice::from_ref(step);
    let used = usable(steps, region, options)?;
    let curves = &steps[used[0]].regions[region];
    let best = search([curves], options);
    let pins = best.pins(pins_of(&[curves], region, options));
    let evaluated = Evaluated::new(curves, options.filter, &best.gauge).ok_or(Unfit::NeverLoaded)?;
    let quality = Quality {
        fitted: evaluated.nrmse(),
        fitted_smoothed: evaluated.nrmse_smoothed(),
        own: evaluated.nrmse(),
        own_smoothed: evaluated.nrmse_smoothed(),
        predicted: None,
        floor: evaluated.floor(),
        peak_bias: evaluated.peak_bias(),
        saturated: verdict::saturated(&[&evaluated]),
    };
    let uncertainty = best.identified.map(|i| interval::from_jacobian(&best.samples, &options.bounds, &i));
    Ok((best.into_fit(used, pins, uncertainty, quality, None), evaluated))
}

fn fit_region(steps: &[Step], region: usize, options: &Options) -> Result<RegionFit, Unfit> {
    let used = usable(steps, region, options)?;
    let curves: Vec<&RegionCurves> = used.iter().map(|&i| &steps[i].regions[region]).collect();
    let recordings: Vec<usize> = used.iter().map(|&i| steps[i].recording).collect();
    let best = search(curves.iter().copied(), options);
    let recordings_ratio = recordings_ratio(&curves, &recordings, &best, options);
    let pins = best.pins(pins_of(&curves, region, options));

    let uncertainty = best.identified.map(|identified| {
        let mut uncertainty = interval::from_jacobian(&best.samples, &options.bounds, &identified);
        let area_max_m2 = best.samples.area_max_m2;
        interval::add_bootstrap(&mut uncertainty, &curves, options, &identified, area_max_m2);
        uncertainty
    });
    let evaluate = |curves: &RegionCurves, gauge: &Gauge<f64>| Evaluated::new(curves, options.filter, gauge);
    let fitted: Vec<_> = curves.iter().filter_map(|c| evaluate(c, &best.gauge)).collect();
    let own: Vec<_> = curves.par_iter().filter_map(|c| evaluate(c, &search([*c], options).gauge)).collect();
    let predicted: Vec<f64> = (0..curves.len())
        .into_par_iter()
        .filter(|_| curves.len() > 1)
        .filter_map(|left_out| {
            let others = curves.iter().enumerate().filter(|(i, _)| *i != left_out).map(|(_, c)| *c);
            Some(evaluate(curves[left_out], &again(others, &best, options))?.nrmse())
        })
        .collect();
    let mean = |of: &dyn Fn(&Evaluated) -> f64, all: &[Evaluated]| all.iter().map(of).sum::<f64>() / all.len() as f64;
    let quality = Quality {
        fitted: mean(&Evaluated::nrmse, &fitted),
        fitted_smoothed: mean(&Evaluated::nrmse_smoothed, &fitted),
        own: mean(&Evaluated::nrmse, &own),
        own_smoothed: mean(&Evaluated::nrmse_smoothed, &own),
        predicted: (!predicted.is_empty()).then(|| predicted.iter().sum::<f64>() / predicted.len() as f64),
        floor: mean(&Evaluated::floor, &fitted),
        peak_bias: mean(&Evaluated::peak_bias, &fitted),
        saturated: verdict::saturated(&fitted.iter().collect::<Vec<_>>()),
    };
    Ok(best.into_fit(used, pins, uncertainty, quality, recordings_ratio))
}

/// The steps in which a region carries enough to be fitted, or why none does.
fn usable(steps: &[Step], region: usize, options: &Options) -> Result<Vec<usize>, Unfit> {
    if steps.is_empty() {
        return Err(Unfit::NoSteps);
    }
    // A later reason is the more telling one: the best step got furthest.
    let mut reasons = Vec::new();
    let mut used = Vec::new();
    for (i, step) in steps.iter().enumerate() {
        match check(&step.regions[region], options.filter) {
            Ok(()) => used.push(i),
            Err(reason) => reasons.push(reason),
        }
    }
    let rank = |reason: &Unfit| match reason {
        Unfit::NeverLoaded => (0, 0.0),
        Unfit::ZeroForce => (1, 0.0),
        Unfit::HardlyLoaded(peak_n) => (2, *peak_n),
        Unfit::TooFewFrames(samples) => (3, *samples as f64),
        Unfit::ConstantArea => (4, 0.0),
        Unfit::SaturatedArea(share) => (5, -share),
        _ => (6, 0.0),
    };
    let furthest =
        reasons.into_iter().max_by(|a, b| rank(a).partial_cmp(&rank(b)).unwrap_or(std::cmp::Ordering::Equal));
    if used.is_empty() { Err(furthest.unwrap_or(Unfit::NoSteps)) } else { Ok(used) }
}

fn check(curves: &RegionCurves, filter: Filter) -> Result<(), Unfit> {
    let samples = Samples::new([curves], filter);
    let area = &samples.raw_area_m2;
    if samples.is_empty() {
        return Err(Unfit::NeverLoaded);
    }
    let peak_n = quality::largest(&samples.force_n);
    if peak_n <= 0.0 {
        return Err(Unfit::ZeroForce);
    }
    if peak_n < LEAST_FORCE_N {
        return Err(Unfit::HardlyLoaded(peak_n));
    }
    if samples.len() < LEAST_SAMPLES {
        return Err(Unfit::TooFewFrames(samples.len()));
    }
    if curves.saturated {
        return Err(Unfit::Clipped);
    }
    let most = quality::largest(area);
    let least = area.iter().copied().fold(f64::INFINITY, f64::min);
    if least > 0.999 * most {
        return Err(Unfit::ConstantArea);
    }
    let at_most = area.iter().filter(|&&a| a >= SATURATED_AREA * most).count() as f64 / area.len() as f64;
    if at_most >= SATURATED_SHARE { Err(Unfit::SaturatedArea(at_most)) } else { Ok(()) }
}

/// What a search found.
struct Found {
    samples: Samples,
    gauge: Gauge<f64>,
    identified: Option<Identified>,
    /// The paper's search finds all eight.
    ellipsoid: Option<Ellipsoid<f64>>,
    evaluations: usize,
}

/// C is pinned later: the force does not depend on it.
const ANY_C_M: f64 = 0.01;

fn search<'c>(curves: impl IntoIterator<Item = &'c RegionCurves>, options: &Options) -> Found {
    let samples = Samples::new(curves, options.filter);
    match options.method {
        Method::Projection => {
            let identified = project(&samples, &options.bounds);
            let gauge = identified.gauge(samples.area_max_m2, ANY_C_M);
            let evaluations = identified.evaluations;
            Found { samples, gauge, identified: Some(identified), ellipsoid: None, evaluations }
        }
        Method::Paper => {
            let (ellipsoid, evaluations) = paper::identify(&samples);
            Found { samples, gauge: ellipsoid.gauge(), identified: None, ellipsoid: Some(ellipsoid), evaluations }
        }
    }
}

/// A fit to nearly the same steps.
fn again<'c>(curves: impl IntoIterator<Item = &'c RegionCurves>, near: &Found, options: &Options) -> Gauge<f64> {
    let Some(identified) = &near.identified else { return search(curves, options).gauge };
    let samples = Samples::new(curves, options.filter);
    let start = identified.rebased(near.samples.area_max_m2, samples.area_max_m2, &options.bounds);
    refine(&samples, &options.bounds, &start).gauge(samples.area_max_m2, ANY_C_M)
}

impl Found {
    fn g_max(&self) -> f64 {
        self.gauge.area_ratio(self.samples.area_max_m2).gauge()
    }

    fn pins(&self, pinned: Pins) -> Pins {
        self.ellipsoid.map_or(pinned, |ellipsoid| paper::pins(&ellipsoid, &self.gauge, self.g_max()))
    }

    fn into_fit(
        self,
        steps: Vec<usize>,
        pins: Pins,
        uncertainty: Option<Uncertainty>,
        quality: Quality,
        recordings_ratio: Option<f64>,
    ) -> RegionFit {
        let gauge = Gauge { c_m: pins.c_m(self.g_max()), ..self.gauge };
        let mut fit = RegionFit {
            steps,
            area_max_m2: self.samples.area_max_m2,
            gauge,
            ellipsoid: self.ellipsoid.unwrap_or_else(|| pins.ellipsoid(&gauge)),
            pins,
            uncertainty,
            quality,
            recordings_ratio,
            evaluations: self.evaluations,
            verdict: String::new(),
            warnings: Vec::new(),
        };
        fit.verdict = verdict::verdict(&fit);
        fit.warnings = verdict::warnings(&fit);
        fit
    }
}

fn pins_of(curves: &[&RegionCurves], region: usize, options: &Options) -> Pins {
    let (mut ln_aspect, mut weight) = (0.0, 0.0);
    for curve in curves {
        let Some(ellipse) = &curve.ellipse else { continue };
        let force = quality::largest(&curve.force_n);
        ln_aspect += force * (ellipse.r_a_mm / ellipse.r_b_mm).ln();
        weight += force;
    }
    let aspect = if weight > 0.0 { (ln_aspect / weight).exp() } else { 1.0 };
    Pins { aspect, thickness_m: options.thickness_m[region], compression: options.compression }
}

/// Steps of each recording that it takes to compare recordings.
const COMPARED_STEPS: usize = 3;

/// How much worse a recording's steps are predicted from the other recordings than from themselves, the worst of them;
/// `None` where there is nothing to compare.
fn recordings_ratio(curves: &[&RegionCurves], recordings: &[usize], near: &Found, options: &Options) -> Option<f64> {
    let groups: BTreeSet<usize> = recordings.iter().copied().collect();
    let ratios = groups.into_iter().filter_map(|group| {
        let of = |wanted: bool| {
            let pairs = curves.iter().zip(recordings).filter(move |(_, r)| (**r == group) == wanted);
            pairs.map(|(c, _)| *c).collect::<Vec<&RegionCurves>>()
        };
        let (own, others) = (of(true), of(false));
        if own.len() < COMPARED_STEPS || others.len() < COMPARED_STEPS {
            return None;
        }
        let error = |gauge: &Gauge<f64>| {
            let errors = own.iter().filter_map(|c| Some(Evaluated::new(c, options.filter, gauge)?.nrmse()));
            steps::median(errors)
        };
        let from_own = error(&again(own.iter().copied(), near, options));
        Some(error(&again(others, near, options)) / from_own)
    });
    ratios.max_by(f64::total_cmp)
}

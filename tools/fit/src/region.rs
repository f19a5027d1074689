//! The fit of one region: the search for the five parameters that force and area determine; the other three (A/B, C and d0),
//! which follow from other data; confidence intervals and errors.

use crate::compare::{Change, Group};
use crate::fixed::{FixedParameters, Scale};
use crate::identify::{Bounds, Identified, converge, identify as identify_by_projection, refine};
use crate::interval::{self, Noise, Uncertainty};
use crate::many::{Linearised, MANY, spread};
use crate::measures::{self, Basis, Measure, Peaks, Quantity, Resample, ScaleEffect};
#[cfg(feature = "paper")]
use crate::paper;
use crate::prior::{self, Prior};
use crate::quality::{Evaluated, Quality, largest};
use crate::scale::{Contradiction, FittedRegion};
use crate::screen::{NotFitted, usable};
use crate::steps::FootEllipse;
use crate::{Method, Options, RegionCurves, Samples, Step, parallel, steps, verdict};
use nalgebra::Matrix5;
use plantar::pipeline::model::{Ellipsoid, ForceLaw, LENGTH_M, is_within};
use std::collections::BTreeSet;
use std::ops::Range;

/// The result of one region.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionFit {
    /// Indices of the steps that were used.
    pub steps: Vec<usize>,
    /// The larger of the largest filtered and the largest unfiltered area in these steps, m2.
    pub area_max_m2: f64,
    /// The force law that a device evaluates.
    pub law: ForceLaw<f64>,
    /// The paper's eight parameters.
    pub ellipsoid: Ellipsoid<f64>,
    /// A/B, C and d0: force and area do not determine them, so other data fix them.
    pub fixed: FixedParameters,
    /// How C and the quantities that depend on it change with the value that determines C; `None` for the paper's method.
    pub scale_effect: Option<ScaleEffect>,
    /// Confidence intervals of the five identifiable parameters; `None` for the paper's method.
    pub uncertainty: Option<Uncertainty>,
    /// Mechanical quantities, which can be compared between recordings and people.
    pub measures: Vec<Measure>,
    /// The errors of the model force with these parameters, against the measured force.
    pub quality: Quality,
    /// NRMSE of each step, as a fraction, with parameters that were fitted to other steps: to all others or, with more than 60
    /// steps, to those of the other 19 groups (4 groups with more than 200 steps). Empty if there is only one step.
    pub predicted_nrmse: Vec<f64>,
    /// Area of the contact ellipse divided by the contact area, minus 1. In each step, it is the mean over the stance weighted
    /// by force or, for a live stream, the value at the peak force. 0 if the contact is an ellipse. `None` without contact
    /// ellipses.
    pub ellipse_misfit: Option<f64>,
    /// Number of different areas in a step, median over the steps.
    pub area_levels: usize,
    /// How much worse a recording is predicted by parameters from the other recordings of the same foot than by its own: the
    /// median error of its steps with parameters fitted to the other recordings, divided by their median error with parameters
    /// fitted to the recording itself. The value is the largest ratio of all recordings. A recording counts only if it has at
    /// least ten steps, and the others together have at least ten; `None` if no recording counts.
    pub recordings_ratio: Option<f64>,
    /// The difference between the two halves of a recording; `None` if it is not significant in any recording.
    pub change: Option<Change>,
    /// Number of evaluations of the model over all samples in the fit to all steps.
    pub evaluations: usize,
    /// Assessment of the fit, in a sentence.
    pub verdict: String,
    /// Limitations of the fit, in sentences.
    pub warnings: Vec<String>,
    /// The reasons why a part of the result is missing or must not be used, in sentences that name the remedy. Empty if the
    /// result is complete and usable.
    pub defects: Vec<String>,
}

impl RegionFit {
    /// A mechanical quantity; `None` if the region does not have it.
    pub fn measure(&self, quantity: Quantity) -> Option<&Measure> {
        measures::find(&self.measures, quantity)
    }
}

/// Fits one region to each step of a recording alone, as the paper does before it averages. Whether measurements of the tissue
/// contradict each other is determined from all steps together, so that the same measurement determines C in all of them.
/// The result of a step that cannot be fitted is the reason.
pub fn fit_each_step(steps: &[Step], region: usize, options: &Options) -> Vec<Result<RegionFit, NotFitted>> {
    let contradiction = contradiction(steps, region, options);
    steps.iter().map(|step| fit_step(step, region, options, contradiction)).collect()
}

/// The contradiction between the measurements of a region, from all steps that pass the screening.
fn contradiction(steps: &[Step], region: usize, options: &Options) -> Option<Contradiction> {
    // Nothing can contradict a peak strain alone.
    if options.measured[region].curvature_m == [None; 2] {
        return None;
    }
    let used = usable(steps, region, options.filter).ok()?;
    let curves: Vec<_> = used.iter().map(|&i| &steps[i].regions[region]).collect();
    search(curves.iter().copied(), region, options).fixed_parameters(&curves, region, options).1
}

/// Fits one region to one step alone.
fn fit_step(
    step: &Step,
    region: usize,
    options: &Options,
    contradiction: Option<Contradiction>,
) -> Result<RegionFit, NotFitted> {
    let used = usable(std::slice::from_ref(step), region, options.filter)?;
    let curves = &step.regions[region];
    let best = search([curves], region, options);
    let fixed = best.fixed_parameters_with(&[curves], region, options, contradiction.is_some());
    let evaluated = Evaluated::new(curves, options.filter, &best.law).ok_or(NotFitted::NeverLoaded)?;
    let one = [evaluated];
    let quality = Quality::new(&one, &one, &[]);
    let covariance = best.covariance();
    let uncertainty = best.uncertainty(covariance.as_ref());
    let measures = best.measures(&[curves], &fixed, covariance.as_ref(), &[]);
    let mut fit = best.into_fit(used, fixed, uncertainty, measures, quality)?;
    fit.ellipse_misfit = steps::ellipse_misfit([curves]);
    fit.defects.extend(contradiction.map(|contradiction| contradiction.to_string()));
    fit.defects.extend(verdict::masked(&[curves]));
    Ok(fit)
}

/// The force law of one region, fitted to all steps that pass the screening, without quality and intervals. Its C is a
/// placeholder, or that of the search with the paper's method.
///
/// # Errors
/// Returns the reason if no step passes the screening.
pub fn fit_force_law(steps: &[Step], region: usize, options: &Options) -> Result<ForceLaw<f64>, NotFitted> {
    let used = usable(steps, region, options.filter)?;
    Ok(search(used.iter().map(|&i| &steps[i].regions[region]), region, options).law)
}

/// Fits one region to all steps that pass the screening.
///
/// # Errors
/// Returns the reason if no step passes the screening or the result is out of range.
pub(crate) fn fit_region(steps: &[Step], region: usize, options: &Options) -> Result<RegionFit, NotFitted> {
    let used = usable(steps, region, options.filter)?;
    let group = Group::new(steps, &used, region);
    let curves = &group.curves;
    let best = search(curves.iter().copied(), region, options);
    let recordings_ratio = group.recordings_ratio(&best, region, options);
    let change = group.change(&best, region, options);
    let (fixed, contradiction) = best.fixed_parameters(curves, region, options);

    let resampled = resample(curves, &best, options);
    let covariance = best.covariance();
    let mut uncertainty = best.uncertainty(covariance.as_ref());
    if let Some(uncertainty) = &mut uncertainty {
        let five = |Resample { law, .. }: &Resample| [law.ab_m2, law.stiffness_pa, law.damping_pa_s, law.n, law.m];
        interval::add_bootstrap(uncertainty, &resampled.iter().map(five).collect::<Vec<_>>());
    }
    let measures = best.measures(curves, &fixed, covariance.as_ref(), &resampled);
    let evaluate = |curves: &RegionCurves, law: &ForceLaw<f64>| Evaluated::new(curves, options.filter, law);
    let fitted: Vec<_> = curves.iter().filter_map(|c| evaluate(c, &best.law)).collect();
    let some = spread(curves);
    let own = parallel::map(some.len(), |i| evaluate(some[i], &search([some[i]], region, options).law));
    let own: Vec<_> = own.into_iter().flatten().collect();
    let predicted_nrmse = cross_validate(curves, &best, region, options);
    let quality = Quality::new(&fitted, &own, &predicted_nrmse);
    // A recording that repeats one step has no meaningful intervals and predicted errors.
    let all_steps_equal = curves.len() > 1 && curves.windows(2).all(|pair| pair[0] == pair[1]);
    let mut fit = best.into_fit(used, fixed, uncertainty, measures, quality)?;
    fit.ellipse_misfit = steps::ellipse_misfit(curves.iter().copied());
    fit.defects.extend(contradiction.map(|contradiction| contradiction.to_string()));
    fit.defects.extend(change.map(|change| change.to_string()));
    fit.defects.extend(verdict::masked(curves));
    fit.defects.extend(verdict::defects(fit.steps.len(), all_steps_equal));
    Ok(RegionFit { predicted_nrmse, recordings_ratio, change, ..fit })
}

/// Up to this number of steps, cross-validation leaves out one step at a time. The limit bounds the computing time: each step or
/// group that is left out requires a fit.
const LEFT_OUT_ALONE: usize = 60;
/// With more steps, cross-validation divides them into this number of groups and leaves out one group at a time.
const GROUPS: usize = 20;
/// As [`GROUPS`], with more than [`MANY`] steps.
const GROUPS_OF_MANY: usize = 5;

/// The fits to resampled steps: as many steps as there are, drawn with replacement. With more than [`MANY`] steps and a prior,
/// they are computed by [`Linearised`]. The same steps always result in the same fits. Empty for fewer than
/// [`interval::MIN_BOOTSTRAP_STEPS`] steps, and for the paper's method, which has no intervals.
fn resample(curves: &[&RegionCurves], fit_to_all: &SearchResult, options: &Options) -> Vec<Resample> {
    let Some(identified) = &fit_to_all.identified else { return Vec::new() };
    if curves.len() < interval::MIN_BOOTSTRAP_STEPS {
        return Vec::new();
    }
    let peaks = fit_to_all.peaks();
    let samples = &fit_to_all.samples;
    let linearised = fit_to_all.prior.as_ref().filter(|_| curves.len() > MANY);
    let linearised = linearised.map(|prior| Linearised::new(samples, prior, identified, fit_to_all.noise.variance));
    parallel::map(options.resamples as usize, |seed| {
        let drawn = interval::drawn(seed as u64, curves.len());
        // A step that is drawn several times is evaluated once: about a third of the draws are repetitions.
        let mut times = vec![0u32; curves.len()];
        drawn.clone().for_each(|i| times[i] += 1);
        let law = match &linearised {
            Some(linearised) => linearised.fitted(&times).law(samples.area_max_m2, ANY_C_M),
            None => {
                let drawn = curves.iter().zip(times).filter(|(_, times)| *times > 0);
                let samples = Samples::repeated(drawn.map(|(curves, times)| (*curves, times)), options.filter);
                refit_samples(&samples, fit_to_all, identified, options)
            }
        };
        Resample { reference: Peaks::median(drawn.map(|i| peaks[i])), law }
    })
}

/// See [`RegionFit::predicted_nrmse`]. `fit_to_all` is the fit to all steps, from which the other fits start.
pub(crate) fn cross_validate(
    curves: &[&RegionCurves],
    fit_to_all: &SearchResult,
    region: usize,
    options: &Options,
) -> Vec<f64> {
    let groups = match curves.len() {
        0 | 1 => return Vec::new(),
        count if count <= LEFT_OUT_ALONE => count,
        count if count <= MANY => GROUPS,
        _ => GROUPS_OF_MANY,
    };
    let force_laws = parallel::map(groups, |group| {
        let others = curves.iter().enumerate().filter(|(i, _)| i % groups != group).map(|(_, c)| *c);
        refit(others, fit_to_all, region, options)
    });
    let evaluated = curves.iter().enumerate().map(|(i, c)| Evaluated::new(c, options.filter, &force_laws[i % groups]));
    evaluated.map(|evaluated| evaluated.map_or(f64::NAN, |e| e.nrmse())).collect()
}

/// The result of a search.
pub(crate) struct SearchResult {
    samples: Samples,
    law: ForceLaw<f64>,
    /// The five parameters, unless the method of the paper was used.
    identified: Option<Identified>,
    /// The prior that the search used.
    prior: Option<Prior>,
    bounds: Bounds,
    noise: Noise,
    /// All eight parameters if the method of the paper was used; otherwise `None`.
    ellipsoid: Option<Ellipsoid<f64>>,
    evaluations: usize,
}

/// Placeholder for the C, m, of a force law before C is determined. Any value will do, because the force does not depend on C.
const ANY_C_M: f64 = 0.01;

/// The parameters that were found for some samples.
struct Found {
    /// The least-squares fit.
    unconstrained: Identified,
    noise: Noise,
    /// The most probable parameters or, without a prior, those of the least-squares fit.
    identified: Identified,
}

impl Found {
    /// Searches the whole range of the parameters.
    fn new(samples: &Samples, prior: Option<&Prior>, bounds: &Bounds) -> Self {
        let unconstrained = identify_by_projection(samples, bounds);
        let noise = interval::noise(samples, &unconstrained);
        let identified = prior.map_or(unconstrained, |prior| prior.identify(samples, &unconstrained, noise.variance));
        Self { unconstrained, noise, identified }
    }

    /// Finds the parameters for all samples from those for `few` of them, which are close.
    fn of_many(samples: &Samples, few: &Samples, prior: Option<&Prior>, bounds: &Bounds) -> Self {
        let near = Self::new(few, prior, bounds);
        let rebased = |identified: &Identified| identified.rebased(few.area_max_m2, samples.area_max_m2);
        let unconstrained = converge(samples, bounds, &rebased(&near.unconstrained));
        let noise = interval::noise(samples, &unconstrained);
        let identified = prior.map_or(unconstrained, |prior| {
            let found = prior.converge(samples, &rebased(&near.identified), noise.variance);
            Identified { evaluations: unconstrained.evaluations + found.evaluations, ..found }
        });
        Self { unconstrained, noise, identified }
    }
}

/// Searches the parameters of a region with the method of the options. With more than [`MANY`] steps, the whole range of the
/// parameters is searched for some of the steps only.
pub(crate) fn search<'c>(
    curves: impl IntoIterator<Item = &'c RegionCurves>,
    region: usize,
    options: &Options,
) -> SearchResult {
    let curves: Vec<&RegionCurves> = curves.into_iter().collect();
    let samples = Samples::new(curves.iter().copied(), options.filter);
    let prior = options.prior.map(|regions| regions[region]);
    let bounds = options.bounds;
    match options.method {
        Method::Projection => {
            let Found { noise, identified, .. } = if curves.len() > MANY {
                let few = Samples::new(spread(&curves), options.filter);
                Found::of_many(&samples, &few, prior.as_ref(), &bounds)
            } else {
                Found::new(&samples, prior.as_ref(), &bounds)
            };
            let law = identified.law(samples.area_max_m2, ANY_C_M);
            let evaluations = identified.evaluations;
            let identified = Some(identified);
            SearchResult { samples, law, identified, prior, bounds, noise, ellipsoid: None, evaluations }
        }
        #[cfg(feature = "paper")]
        Method::Paper => {
            let (ellipsoid, evaluations) = paper::identify(&samples.clone().with_smoothed_force(), options.size_scale);
            SearchResult {
                samples,
                law: ellipsoid.force_law(),
                identified: None,
                prior: None,
                bounds,
                noise: Noise::NONE,
                ellipsoid: Some(ellipsoid),
                evaluations,
            }
        }
    }
}

/// The force law fitted to some of the steps. The search starts from `fit_to_all`, the fit to all steps, and C is a placeholder.
/// The paper's method searches all parameters from its random starts.
pub(crate) fn refit<'c>(
    curves: impl IntoIterator<Item = &'c RegionCurves>,
    fit_to_all: &SearchResult,
    region: usize,
    options: &Options,
) -> ForceLaw<f64> {
    let Some(identified) = &fit_to_all.identified else { return search(curves, region, options).law };
    let samples = Samples::new(curves, options.filter);
    let start = identified.rebased(fit_to_all.samples.area_max_m2, samples.area_max_m2);
    let unconstrained = refine(&samples, &options.bounds, &start);
    // The noise determines the weight of the prior. It is that of these steps alone: with that of all steps, the force law would
    // depend on the steps that it is to predict.
    let found = match &fit_to_all.prior {
        Some(prior) => prior.refine(&samples, &start, interval::noise(&samples, &unconstrained).variance),
        None => unconstrained,
    };
    found.law(samples.area_max_m2, ANY_C_M)
}

/// The force law fitted to these samples, with the noise of `fit_to_all`. `identified` are the parameters of `fit_to_all`.
fn refit_samples(
    samples: &Samples,
    fit_to_all: &SearchResult,
    identified: &Identified,
    options: &Options,
) -> ForceLaw<f64> {
    let start = identified.rebased(fit_to_all.samples.area_max_m2, samples.area_max_m2);
    let found = match &fit_to_all.prior {
        Some(prior) => prior.refine(samples, &start, fit_to_all.noise.variance),
        None => refine(samples, &options.bounds, &start),
    };
    found.law(samples.area_max_m2, ANY_C_M)
}

impl SearchResult {
    /// The covariance matrix of the parameters in the coordinates of [`prior::Coordinates`]; `None` without a prior.
    pub(crate) fn covariance(&self) -> Option<Matrix5<f64>> {
        let (prior, identified) = (self.prior.as_ref()?, self.identified.as_ref()?);
        Some(interval::covariance(&self.samples, prior, identified, self.noise.variance))
    }

    /// The intervals of the five parameters; `None` for the method of the paper.
    fn uncertainty(&self, covariance: Option<&Matrix5<f64>>) -> Option<Uncertainty> {
        let identified = self.identified.as_ref()?;
        Some(match (&self.prior, covariance) {
            (Some(prior), Some(covariance)) => {
                interval::from_posterior(self.samples.area_max_m2, prior, identified, &self.noise, covariance)
            }
            _ => interval::from_jacobian(&self.samples, &self.bounds, identified),
        })
    }

    /// The largest area and the peak force of each step.
    fn peaks(&self) -> Vec<Peaks> {
        let samples = &self.samples;
        let of_step = |step: &Range<usize>| Peaks {
            area_m2: largest(&samples.raw_area_m2[step.clone()]),
            force_n: largest(&samples.force_n[step.clone()]),
        };
        samples.steps.iter().map(of_step).collect()
    }

    /// The data from which the mechanical quantities follow. `steps` is the result of [`Self::peaks`].
    fn basis<'b>(&self, steps: &'b [Peaks], fixed: &'b FixedParameters) -> Basis<'b> {
        let reference = Peaks::median(steps.iter().copied());
        Basis { area_max_m2: self.samples.area_max_m2, steps, reference, fixed }
    }

    /// The mechanical quantities of the result. `covariance` is that of [`Self::covariance`], and `resampled` are fits to
    /// resampled steps.
    pub(crate) fn measures(
        &self,
        curves: &[&RegionCurves],
        fixed: &FixedParameters,
        covariance: Option<&Matrix5<f64>>,
        resampled: &[Resample],
    ) -> Vec<Measure> {
        let steps = self.peaks();
        let basis = self.basis(&steps, fixed);
        let mut measures = match (&self.identified, covariance) {
            (Some(identified), Some(covariance)) => {
                basis.measures(&prior::coordinates(identified), covariance, &self.noise, resampled)
            }
            _ => basis.values(&self.law),
        };
        let law = self.law_with_c(fixed);
        measures.extend(measures::energies(curves, &law));
        measures
    }

    /// The force law with the C that other data fix.
    fn law_with_c(&self, fixed: &FixedParameters) -> ForceLaw<f64> {
        ForceLaw { c_m: fixed.c_m(&self.law, self.samples.area_max_m2), ..self.law }
    }

    /// The fixed parameters of the result, from the contact ellipses of the steps and from the options. If measurements
    /// contradict each other, or a curvature contradicts the thickness, the assumed compression determines C. If all eight
    /// parameters were searched, the values of A/B, C and d0 are those of the search.
    pub(crate) fn fixed_parameters(
        &self,
        curves: &[&RegionCurves],
        region: usize,
        options: &Options,
    ) -> (FixedParameters, Option<Contradiction>) {
        // The method of the paper uses no measurements.
        let contradiction = match self.ellipsoid {
            None => self.fitted_region(curves, region, options).contradiction(&options.measured[region]),
            Some(_) => None,
        };
        (self.fixed_parameters_with(curves, region, options, contradiction.is_some()), contradiction)
    }

    /// As [`Self::fixed_parameters`], if it is known whether measurements contradict each other.
    fn fixed_parameters_with(
        &self,
        curves: &[&RegionCurves],
        region: usize,
        options: &Options,
        is_contradictory: bool,
    ) -> FixedParameters {
        #[cfg(feature = "paper")]
        if let Some(ellipsoid) = &self.ellipsoid {
            let g_max = self.law.area_ratio(self.samples.area_max_m2).normalised_deformation();
            return paper::fixed_parameters(ellipsoid, &self.law, g_max);
        }
        let FittedRegion { aspect, thickness_m, .. } = self.fitted_region(curves, region, options);
        let measured = &options.measured[region];
        let is_thickness_measured = measured.has_thickness;
        let scale = if is_contradictory { None } else { measured.scale(aspect) };
        let scale = scale.unwrap_or(Scale::Assumed(options.compression));
        FixedParameters { aspect, thickness_m, is_thickness_measured, scale }
    }

    /// The data from which C follows.
    fn fitted_region(&self, curves: &[&RegionCurves], region: usize, options: &Options) -> FittedRegion<'_> {
        FittedRegion {
            law: &self.law,
            area_max_m2: self.samples.area_max_m2,
            thickness_m: options.thickness_m[region],
            aspect: FootEllipse::of_steps(curves.iter().copied()).map_or(1.0, |e| e.r_a_mm / e.r_b_mm),
        }
    }

    /// The fit with these fixed parameters, without cross-validation and without a comparison of recordings. `steps` are the
    /// indices of the steps that were used.
    ///
    /// # Errors
    /// Fails if the parameters are outside of the range that an insole accepts.
    fn into_fit(
        self,
        steps: Vec<usize>,
        fixed: FixedParameters,
        uncertainty: Option<Uncertainty>,
        measures: Vec<Measure>,
        quality: Quality,
    ) -> Result<RegionFit, NotFitted> {
        let law = self.law_with_c(&fixed);
        let scale_effect = self.identified.is_some().then(|| self.basis(&self.peaks(), &fixed).scale_effect(&law));
        let ellipsoid = self.ellipsoid.unwrap_or_else(|| fixed.ellipsoid(&law));
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
            fixed,
            scale_effect,
            uncertainty,
            measures,
            quality,
            predicted_nrmse: Vec::new(),
            recordings_ratio: None,
            change: None,
            ellipse_misfit: None,
            evaluations: self.evaluations,
            verdict: String::new(),
            warnings: Vec::new(),
            defects: Vec::new(),
        };
        fit.verdict = verdict::verdict(&fit);
        fit.warnings = verdict::warnings(&fit);
        Ok(fit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Filter;
    use crate::synthetic::{Noise, curves};

    /// The largest step is not among the steps for which the whole range of the parameters is searched.
    #[test]
    fn many_steps_have_the_parameters_of_a_search_over_all_of_them() {
        const STEPS: usize = MANY + 40;
        const LARGEST: usize = 5;
        assert!(!spread(&(0..STEPS).collect::<Vec<_>>()).contains(&LARGEST));
        for region in 0..8 {
            let mut source = Noise::new(region as u64 + 1);
            let size = |i: usize| if i == LARGEST { 1.2 } else { 0.9 + 0.1 * (i % 7) as f64 / 6.0 };
            let steps: Vec<_> =
                (0..STEPS).map(|i| curves(region, 100.0, Filter::Direct, size(i), 0.05, &mut source)).collect();
            let prior = Some(&prior::WALKERS[region]);
            let samples = Samples::new(&steps, Filter::Direct);
            let few = Samples::new(spread(&steps.iter().collect::<Vec<_>>()), Filter::Direct);
            let of_all = Found::new(&samples, prior, &Bounds::USUAL);
            let of_many = Found::of_many(&samples, &few, prior, &Bounds::USUAL);
            let deviations =
                interval::covariance(&samples, &prior::WALKERS[region], &of_all.identified, of_all.noise.variance);
            let [a, b] = [of_all.identified, of_many.identified].map(|found| prior::coordinates(&found));
            for i in 0..5 {
                let error = (a[i] - b[i]).abs() / deviations[(i, i)].sqrt();
                assert!(error < 0.05, "region {region}, coordinate {i}: {} instead of {}", b[i], a[i]);
            }
            assert!((of_many.noise.variance / of_all.noise.variance - 1.0).abs() < 1e-3);
        }
    }
}

//! How the main results depend on the choices of the method: contact rule, filter and steps.

use crate::measures::{self, Measure, Quantity};
use crate::region::{SearchResult, cross_validate, search};
use crate::screen::usable;
use crate::{Filter, Method, Options, RegionCurves, RegionFit, Step, Study, parallel};
use plantar::pipeline::contact::ContactRule;
use std::fmt;

/// Contact thresholds, kPa.
const THRESHOLDS_KPA: [f32; 3] = [5.0, 10.0, 20.0];
/// Pressures from which a cell in contact counts with its whole area, kPa; with 0, every cell in contact does.
const AREA_SCALES_KPA: [f32; 4] = [75.0, 150.0, 300.0, 0.0];
/// Number of groups into which the steps are divided: each group is every fourth step, from another step on. One group at a time
/// is left out.
const GROUPS: usize = 4;
/// The first step of each group, in words.
const ORDINALS: [&str; GROUPS] = ["first", "second", "third", "fourth"];
/// With fewer steps, none are left out.
const LEAST_STEPS: usize = 8;

/// A choice that differs from that of the fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Choice {
    /// The contact threshold of the rule; the release threshold is the same fraction of it as in the fit.
    Threshold(ContactRule),
    /// The pressure from which a cell counts with its whole area ([`ContactRule::full_kpa`]).
    AreaScale(ContactRule),
    /// The filter of the area.
    Filter(Filter),
    /// All steps except every fourth one. The first step that is left out has this index.
    LeftOut(usize),
}

impl Choice {
    /// Name of what is chosen, as in JSON.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Threshold(_) => "contact_threshold",
            Self::AreaScale(_) => "area_scale",
            Self::Filter(_) => "filter",
            Self::LeftOut(_) => "left_out_steps",
        }
    }

    fn contact(&self) -> Option<ContactRule> {
        match self {
            Self::Threshold(rule) | Self::AreaScale(rule) => Some(*rule),
            _ => None,
        }
    }

    /// True unless this is a contact rule that is not valid.
    fn is_valid(&self) -> bool {
        self.contact().is_none_or(|rule| rule.is_valid())
    }
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Threshold(rule) => write!(f, "contact from {} kPa", rule.on_kpa),
            Self::AreaScale(rule) if rule.full_kpa == 0.0 => f.write_str("area: cells counted whole"),
            Self::AreaScale(rule) => write!(f, "area: whole cell from {} kPa", rule.full_kpa),
            Self::Filter(filter) => write!(f, "filter {}", filter.name()),
            Self::LeftOut(group) => {
                write!(f, "without every fourth of the steps, from the {} on", ORDINALS[*group])
            }
        }
    }
}

/// The main results of a region; `None` for one that the region does not have.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MainResults {
    /// Elastic force at the reference area, N.
    pub force_at_area_n: Option<f64>,
    /// Area at half of the peak force, mm2.
    pub area_at_half_force_mm2: Option<f64>,
    /// Secant stiffness at the reference strain, N/mm.
    pub secant_stiffness_n_mm: Option<f64>,
    /// NRMSE, as a fraction, of steps that are predicted from the other steps: see [`crate::Quality::predicted`].
    pub predicted_nrmse: Option<f64>,
}

impl MainResults {
    /// The results of a fit.
    pub fn of(fit: &RegionFit) -> Self {
        Self::new(&fit.measures, fit.quality.predicted)
    }

    fn new(measures: &[Measure], predicted_nrmse: Option<f64>) -> Self {
        let value = |quantity| measures::find(measures, quantity).map(|m| m.value);
        Self {
            force_at_area_n: value(Quantity::ForceAtArea),
            area_at_half_force_mm2: value(Quantity::AreaAtForce(0.5)),
            secant_stiffness_n_mm: value(Quantity::SecantStiffness),
            predicted_nrmse,
        }
    }
}

/// The main results with another choice.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    /// The choice.
    pub choice: Choice,
    /// The results in the order of [`plantar::Region::ALL`]; `None` for a region that cannot be fitted with this choice.
    pub regions: [Option<MainResults>; 8],
}

/// The main results with all other choices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sensitivity {
    /// The results.
    pub variants: Vec<Variant>,
    /// Sentences that state which choices were not varied, and why.
    pub skipped: Vec<String>,
}

/// Extracts the steps with another contact rule.
pub type StepsBy<'s> = &'s (dyn Fn(&ContactRule) -> Result<Vec<Step>, String> + Sync);

/// The choices that differ from those of the study; none with the method of the paper. Contact rules that are not valid are
/// omitted ([`Sensitivity::skipped`] names them), and without the cells, the contact rule cannot be varied.
pub fn choices(study: &Study, has_cells: bool) -> Vec<Choice> {
    if study.options.method != Method::Projection {
        return Vec::new();
    }
    let contacts = contacts(study.contact).filter(|choice| has_cells && choice.is_valid());
    let filters = [Filter::Direct, Filter::Live, Filter::Smoothed].into_iter().filter(|f| *f != study.options.filter);
    let groups = if study.steps.len() < LEAST_STEPS { 0 } else { GROUPS };
    contacts.chain(filters.map(Choice::Filter)).chain((0..groups).map(Choice::LeftOut)).collect()
}

/// The contact rules that differ from `rule`, valid or not.
fn contacts(rule: ContactRule) -> impl Iterator<Item = Choice> {
    let threshold = move |on_kpa| ContactRule { on_kpa, off_kpa: rule.off_kpa / rule.on_kpa * on_kpa, ..rule };
    let scale = move |full_kpa| ContactRule { full_kpa, ..rule };
    // Only the varied values are compared, because rounding can change the release threshold.
    let is_other = move |other: &ContactRule| (other.on_kpa, other.full_kpa) != (rule.on_kpa, rule.full_kpa);
    let thresholds = THRESHOLDS_KPA.into_iter().map(threshold).filter(is_other).map(Choice::Threshold);
    thresholds.chain(AREA_SCALES_KPA.into_iter().map(scale).filter(is_other).map(Choice::AreaScale))
}

/// NRMSE, as a fraction, of steps that are predicted from the other steps, for each region in the order of
/// [`plantar::Region::ALL`]. `None` for a region that cannot be fitted, and for a single step.
pub fn predicted_nrmse(steps: &[Step], options: &Options) -> [Option<f64>; 8] {
    let all = parallel::map(8, |region| main_results(steps, region, options)?.predicted_nrmse);
    std::array::from_fn(|region| all[region])
}

impl Sensitivity {
    /// Fits the regions with each of the other [`choices`]. `steps_by` is `None` if the sources do not contain the cells, so
    /// that the steps cannot be extracted with another contact rule. `progress` is called after each fit of a region.
    pub fn of(study: &Study, steps_by: Option<StepsBy>, progress: &(dyn Fn() + Sync)) -> Self {
        let mut skipped = Vec::new();
        if study.options.method != Method::Projection {
            skipped.push("The method of the paper is too slow to be repeated with other choices.".into());
            return Self { variants: Vec::new(), skipped };
        }
        if steps_by.is_none() {
            skipped.push("The contact rule was not varied, because a live stream does not contain the cells.".into());
        }
        if study.steps.len() < LEAST_STEPS {
            skipped.push(format!("No steps were left out, because this requires at least {LEAST_STEPS} steps."));
        }
        for choice in contacts(study.contact).filter(|choice| steps_by.is_some() && !choice.is_valid()) {
            skipped.push(format!(
                "The fit with {choice} was not possible: contact cannot begin above the pressure from which a cell \
                 counts with its whole area."
            ));
        }
        let choices = choices(study, steps_by.is_some());
        let steps = parallel::map(choices.len(), |i| match (choices[i], choices[i].contact(), steps_by) {
            (_, Some(rule), Some(steps_by)) => steps_by(&rule),
            (Choice::LeftOut(group), ..) => {
                let others = study.steps.iter().enumerate().filter(|(i, _)| i % GROUPS != group);
                Ok(others.map(|(_, step)| step.clone()).collect())
            }
            _ => Ok(study.steps.clone()),
        });
        let options = |choice: &Choice| match choice {
            Choice::Filter(filter) => Options { filter: *filter, ..study.options },
            _ => study.options,
        };
        let results = parallel::map(choices.len() * 8, |task| {
            let choice = &choices[task / 8];
            let results =
                steps[task / 8].as_ref().ok().and_then(|steps| main_results(steps, task % 8, &options(choice)));
            progress();
            results
        });
        let mut variants = Vec::new();
        for (i, (choice, steps)) in choices.into_iter().zip(steps).enumerate() {
            match steps {
                Ok(_) => {
                    variants.push(Variant { choice, regions: std::array::from_fn(|region| results[8 * i + region]) })
                }
                Err(problem) => skipped.push(format!("The fit with {choice} was not possible: {problem}.")),
            }
        }
        Self { variants, skipped }
    }
}

/// Fits a region without intervals. `None` if it cannot be fitted.
fn main_results(steps: &[Step], region: usize, options: &Options) -> Option<MainResults> {
    let used = usable(steps, region, options.filter).ok()?;
    let curves: Vec<&RegionCurves> = used.iter().map(|&i| &steps[i].regions[region]).collect();
    let best: SearchResult = search(curves.iter().copied(), region, options);
    // A/B, C and d0, which the force does not determine.
    let (fixed, _) = best.fixed_parameters(&curves, region, options);
    let errors = cross_validate(&curves, &best, region, options);
    let predicted = (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64);
    Some(MainResults::new(&best.measures(&curves, &fixed, best.covariance().as_ref(), &[]), predicted))
}

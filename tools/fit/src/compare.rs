//! Comparison of groups of steps that should have the same parameters: the recordings of one person, and the two halves of a
//! recording.

use crate::quality::{Evaluated, largest};
use crate::region::{SearchResult, refit};
use crate::{Options, RegionCurves, Step, steps};
use plantar::Side;
use plantar::pipeline::model::ForceLaw;
use std::collections::BTreeMap;
use std::fmt;

/// Recordings with fewer steps are not compared, because recordings of one person would differ by chance.
const COMPARED_STEPS: usize = 10;
/// The halves of a recording are compared if each has at least this number of steps.
const HALF_STEPS: usize = 5;
/// The halves differ if the error with the parameters of the other half exceeds this multiple of the error with their own.
const CHANGED_ERROR: f64 = 2.5;
/// The halves differ if the region's share of the load differs by more than this factor, and its interquartile ranges in the two
/// halves do not overlap.
const CHANGED_LOAD: f64 = 1.5;

/// The steps to which a region is fitted.
pub(crate) struct Group<'s> {
    /// The curves of the region.
    pub curves: Vec<&'s RegionCurves>,
    /// The steps of these curves.
    pub steps: Vec<&'s Step>,
}

impl<'s> Group<'s> {
    /// The steps with the indices `used`.
    pub fn new(steps: &'s [Step], used: &[usize], region: usize) -> Self {
        Self {
            curves: used.iter().map(|&i| &steps[i].regions[region]).collect(),
            steps: used.iter().map(|&i| &steps[i]).collect(),
        }
    }

    /// See [`crate::RegionFit::recordings_ratio`]. `fit_to_all` is the fit to all steps, from which the other fits start.
    pub fn recordings_ratio(&self, fit_to_all: &SearchResult, region: usize, options: &Options) -> Option<f64> {
        let recordings: BTreeMap<usize, Side> = self.steps.iter().map(|step| (step.recording, step.side)).collect();
        let ratios = recordings.into_iter().filter_map(|(recording, side)| {
            let curves_of = |this_recording: bool| {
                let pairs = self.curves.iter().zip(&self.steps);
                let pairs = pairs.filter(move |(_, s)| (s.recording == recording) == this_recording && s.side == side);
                pairs.map(|(c, _)| *c).collect::<Vec<&RegionCurves>>()
            };
            let (own, others) = (curves_of(true), curves_of(false));
            if own.len() < COMPARED_STEPS || others.len() < COMPARED_STEPS {
                return None;
            }
            Some(error_ratio(&own, &others, fit_to_all, region, options))
        });
        ratios.max_by(f64::total_cmp)
    }

    /// The change of the region between the two halves of the recording in which it changes most; `None` if it does not change
    /// significantly in any recording.
    pub fn change(&self, fit_to_all: &SearchResult, region: usize, options: &Options) -> Option<Change> {
        let mut recordings: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (i, step) in self.steps.iter().enumerate() {
            recordings.entry(step.recording).or_default().push(i);
        }
        let changes = recordings.into_values().filter_map(|indices| {
            let (first, second) = indices.split_at(indices.len() / 2);
            if first.len() < HALF_STEPS {
                return None;
            }
            let curves = |half: &[usize]| half.iter().map(|&i| self.curves[i]).collect::<Vec<_>>();
            let (before, after) = (curves(first), curves(second));
            let error_ratio = error_ratio(&before, &after, fit_to_all, region, options)
                .max(error_ratio(&after, &before, fit_to_all, region, options));
            let load = |half: &[usize]| -> Vec<f64> {
                half.iter().map(|&i| largest(&self.curves[i].force_n) / self.steps[i].peak_n).collect()
            };
            Change { load_ratio: load_ratio(load(first), load(second)), error_ratio }.significant()
        });
        changes.max_by(|a, b| a.size().total_cmp(&b.size()))
    }
}

/// How much worse the steps `own` are predicted by parameters fitted to `others` than by parameters fitted to `own`: the ratio
/// of the median errors.
fn error_ratio(
    own: &[&RegionCurves],
    others: &[&RegionCurves],
    fit_to_all: &SearchResult,
    region: usize,
    options: &Options,
) -> f64 {
    let error = |law: &ForceLaw<f64>| {
        let errors = own.iter().filter_map(|c| Some(Evaluated::new(c, options.filter, law)?.nrmse()));
        steps::median(errors)
    };
    let fitted_to = |curves: &[&RegionCurves]| error(&refit(curves.iter().copied(), fit_to_all, region, options));
    fitted_to(others) / fitted_to(own)
}

/// The median of `after` divided by that of `before`; 1 if their interquartile ranges overlap.
fn load_ratio(mut before: Vec<f64>, mut after: Vec<f64>) -> f64 {
    let ratio = steps::median(after.iter().copied()) / steps::median(before.iter().copied());
    let quartiles = |values: &mut [f64]| {
        values.sort_by(f64::total_cmp);
        let last = values.len() - 1;
        [values[last / 4], values[last - last / 4]]
    };
    let ([low, high], [low_after, high_after]) = (quartiles(&mut before), quartiles(&mut after));
    if low_after <= high && low <= high_after { 1.0 } else { ratio }
}

/// The difference between the first and the second half of the steps of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// The region's peak force, relative to that of the whole foot, in the second half divided by that in the first half; 1 if
    /// the difference is within the scatter of the steps.
    pub load_ratio: f64,
    /// Error of a half with the parameters of the other half, divided by its error with its own; the larger of the two ratios.
    pub error_ratio: f64,
}

impl Change {
    fn has_other_load(&self) -> bool {
        self.load_ratio.ln().abs() > CHANGED_LOAD.ln()
    }

    fn significant(self) -> Option<Self> {
        (self.error_ratio > CHANGED_ERROR || self.has_other_load()).then_some(self)
    }

    /// The larger of the two changes, in logarithms relative to its threshold: above 1 if the change is significant.
    fn size(&self) -> f64 {
        (self.error_ratio.ln() / CHANGED_ERROR.ln()).max(self.load_ratio.ln().abs() / CHANGED_LOAD.ln())
    }
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the region changes within the recording: ")?;
        if self.has_other_load() {
            write!(
                f,
                "its share of the load in the second half of the steps is {:.2} times that in the first",
                self.load_ratio
            )?;
        } else {
            write!(
                f,
                "with the parameters of the other half of the steps, the error of a half is {:.1} times that with its own",
                self.error_ratio
            )?;
        }
        f.write_str("; the insole may have shifted: check its position and record again, or select steps with `plantar fit --steps`")
    }
}

//! The values of all variables in a trial, and means over trials. A trial is one recording of one foot.

use crate::steps::Step;
use crate::variable::Variable;
use crate::{NotFitted, RegionFit};
use plantar::Side;

/// The values of one region, in the order of [`crate::variable::Variable::all`]. `None` is a variable without a value.
pub type Values = Vec<Option<f64>>;

/// The values of a trial.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Name of the recording.
    pub name: String,
    /// The foot.
    pub side: Side,
    /// The values of the regions, in the order of [`plantar::Region::ALL`]. A region that was not fitted has only the measured
    /// loads.
    pub regions: [Values; 8],
}

impl Trial {
    /// The trial of a recording, from its steps and the fits of its regions.
    pub fn of(name: String, side: Side, steps: &[Step], fits: &[Result<RegionFit, NotFitted>; 8]) -> Self {
        let values = |region: usize| {
            let records = || steps.iter().map(|step| &step.regions[region].record);
            Variable::all().map(|variable| variable.of(records(), fits[region].as_ref().ok())).collect()
        };
        Self { name, side, regions: std::array::from_fn(values) }
    }

    /// True if at least one region was fitted.
    pub fn is_fitted(&self) -> bool {
        self.regions.iter().any(is_fitted)
    }

    /// True if both trials have the same values: noise makes the values of two measurements different, so one of the recordings
    /// is a copy of the other one.
    pub fn is_copy_of(&self, other: &Self) -> bool {
        self.side == other.side && self.regions == other.regions && self.is_fitted()
    }
}

/// True if the region with these values was fitted.
pub fn is_fitted(values: &Values) -> bool {
    values[Variable::nrmse().index()].is_some()
}

/// The mean of each variable over those of `all` that have a value of it.
pub fn means<'v>(all: impl IntoIterator<Item = &'v Values>) -> Values {
    let all: Vec<&Values> = all.into_iter().collect();
    let mean = |i| Moments::of(all.iter().filter_map(|values| values[i])).map(|m| m.mean);
    (0..Variable::all().count()).map(mean).collect()
}

/// Mean and standard deviation of some values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// Number of values.
    pub count: usize,
    /// Arithmetic mean.
    pub mean: f64,
    /// Standard deviation with the divisor n - 1; `None` for a single value.
    pub deviation: Option<f64>,
}

impl Moments {
    /// The moments of values; `None` without values.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let values: Vec<f64> = values.into_iter().collect();
        let count = values.len();
        let mean = values.iter().sum::<f64>() / count as f64;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        let deviation = (count > 1).then(|| (squares / (count as f64 - 1.0)).sqrt());
        (count > 0).then_some(Self { count, mean, deviation })
    }
}

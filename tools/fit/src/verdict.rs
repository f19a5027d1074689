//! Assessment of a fit in sentences.

use crate::interval::{FIVE, Interval};
use crate::measures::{self, Quantity};
use crate::{RegionCurves, RegionFit};

/// Two parameters cannot be separated if the absolute correlation of their estimates is larger than this.
const INSEPARABLE: f64 = 0.95;

/// If C is more than this multiple of d0, the ellipsoid does not resemble the fat pad of a foot.
const TALL: f64 = 2.0;

/// With fewer different areas in a step, the curve of the area is too coarse.
const FEW_AREAS: usize = 8;

/// The area saturates if [`crate::Quality::saturated`] exceeds this fraction.
const SATURATES: f64 = 0.2;
/// The model follows the force if the NRMSE of prediction is below this fraction.
const FOLLOWS: f64 = 0.1;
/// The steps differ if the NRMSE of prediction exceeds this multiple of the NRMSE with parameters fitted to each step alone.
const STEPS_DIFFER: f64 = 1.5;
/// The contact area limits the fit if [`crate::Quality::floor`] exceeds this fraction of the NRMSE of prediction, and the
/// condition of [`AT_FLOOR`] is met.
const NEAR_FLOOR: f64 = 0.6;
/// Second condition of [`NEAR_FLOOR`]: the NRMSE with parameters fitted to each step alone exceeds this fraction of the floor.
const AT_FLOOR: f64 = 0.9;

/// A sentence that states how well the model predicts the force, and what limits it.
pub(crate) fn verdict(fit: &RegionFit) -> String {
    let q = &fit.quality;
    let predicted = q.predicted.unwrap_or(q.own);
    let steps = if q.predicted.is_some() { "steps that were not used for the fit" } else { "the only step" };
    let error = format!("error {:.0} % on {steps}", predicted * 100.0);
    if q.saturated > SATURATES {
        return format!(
            "the contact area stays at its largest value while the force changes, so the model cannot follow the force there \
             ({error}); use the measured force instead"
        );
    }
    if predicted < FOLLOWS {
        return format!("follows the force: {error}");
    }
    if predicted > STEPS_DIFFER * q.own {
        return format!(
            "steps differ: {error}, {:.0} % with parameters of each step alone; compare means over steps, not single steps",
            q.own * 100.0
        );
    }
    if q.floor > NEAR_FLOOR * predicted && q.own > AT_FLOOR * q.floor {
        return format!(
            "limited by the contact area: {error}, and {:.0} % for the best non-decreasing function of area; smaller cells would \
             reduce it, and so would covered shares if the cells were counted, but other parameters would not",
            q.floor * 100.0
        );
    }
    format!("approximate: {error}, and {:.0} % for the best non-decreasing function of area", q.floor * 100.0)
}

/// The defect of a result that follows from its steps: there is only one step, or all steps are equal. `None` if neither is the
/// case.
pub(crate) fn defects(steps: usize, all_steps_equal: bool) -> Option<String> {
    if steps == 1 {
        return Some(
            "only one step could be used: the error of new steps, and how much steps differ, are unknown; record at least ten \
             steps"
                .into(),
        );
    }
    all_steps_equal.then(|| {
        "all steps are equal, so that intervals and predicted errors have no meaning: check that the recording does not repeat one \
         step"
            .into()
    })
}

/// The defect of a result that follows from faulty cells in its steps; `None` without any. Steps from before a fault was found
/// are not counted.
pub(crate) fn masked(curves: &[&RegionCurves]) -> Option<String> {
    let cells = curves.iter().map(|curves| curves.record.masked_cells).max().filter(|&cells| cells > 0)?;
    let steps = curves.iter().filter(|curves| curves.record.masked_cells > 0).count();
    let steps = if curves.len() > 1 { format!(" in {steps} of {} steps", curves.len()) } else { String::new() };
    Some(format!(
        "the readings of faulty cells (up to {cells}) were replaced by those of neighbouring cells{steps}; steps before \
         the fault was found may still contain faulty readings, so area, force and all results of the region are \
         affected; repair or replace the sensor, and record again"
    ))
}

/// The limitations of a fit, in sentences.
pub(crate) fn warnings(fit: &RegionFit) -> Vec<String> {
    let mut warnings = Vec::new();
    let Some(uncertainty) = &fit.uncertainty else { return warnings };
    let undamped = fit.law.damping_pa_s == 0.0;
    if undamped {
        warnings.push("no damping was identified: G is 0, and m has no meaning".into());
    }
    let is_limited = |(interval, name): &(&Interval, &str)| interval.at_bound && !(undamped && *name == "G");
    let at_bound: Vec<_> = uncertainty.intervals.iter().zip(FIVE).filter(is_limited).map(|(_, name)| name).collect();
    if !at_bound.is_empty() {
        warnings.push(format!(
            "at a bound of the search: {}. The best value lies beyond the bound, so the estimate is the bound",
            at_bound.join(", ")
        ));
    }
    if fit.area_levels < FEW_AREAS {
        warnings.push(format!(
            "the contact area has only {} different values: the cells are too large for this region, and the intervals too narrow",
            fit.area_levels
        ));
    }
    let height = fit.law.c_m / fit.fixed.thickness_m;
    if height > TALL {
        warnings.push(format!(
            "C is {height:.1} times the thickness of the tissue, so the ellipsoid does not resemble a fat pad: A, B and C \
             are parameters of the model here, not anatomical dimensions"
        ));
    }
    if let Some(energy) = measures::find(&fit.measures, Quantity::DissipatedEnergy)
        && energy.interval.is_some_and(|[_, high]| high < 0.0)
    {
        warnings.push(
            "the energy dissipated per step is negative: tissue cannot return more energy than it received, so the damping is \
             not that of the tissue"
                .into(),
        );
    }
    let is_correlated = |i: usize| (0..FIVE.len()).any(|j| j != i && uncertainty.correlation[i][j].abs() > INSEPARABLE);
    let correlated: Vec<_> = (0..FIVE.len()).filter(|&i| is_correlated(i)).map(|i| FIVE[i]).collect();
    if !correlated.is_empty() {
        warnings.push(format!(
            "{} compensate each other (absolute correlation above {INSEPARABLE}): compare the resulting force, not single parameters",
            correlated.join(", ")
        ));
    }
    let wider = uncertainty.intervals.iter().zip(FIVE).filter(|(interval, _)| {
        let width = |[low, high]: [f64; 2]| high - low;
        interval.bootstrap.is_some_and(|bootstrap| width(bootstrap) > 2.0 * width(interval.jacobian))
    });
    let wider: Vec<_> = wider.map(|(_, name)| name).collect();
    if !wider.is_empty() {
        warnings.push(format!(
            "{}: steps differ by more than the scatter within them explains; use the interval from resampled steps",
            wider.join(", ")
        ));
    }
    warnings
}

//! Assessment of a fit in plain words.

use crate::RegionFit;
use crate::interval::{FIVE, Interval};

/// Estimates with a larger absolute correlation cannot be separated.
const INSEPARABLE: f64 = 0.95;

/// Ratio of C to d0 above which the ellipsoid does not resemble a fat pad.
const FLAT: f64 = 2.0;

/// Smallest number of different areas in a step. With fewer, the curve of the area is too coarse.
const FEW_AREAS: usize = 8;

/// The area saturates if it is at its largest for more than this fraction of the contact.
const SATURATES: f64 = 0.2;
/// The model follows the force if its error is below this fraction.
const FOLLOWS: f64 = 0.1;
/// The steps differ if the predicted error exceeds this multiple of the error of parameters fitted to each step alone.
const STEPS_DIFFER: f64 = 1.5;
/// The contact area limits the fit if the floor is above this fraction of the predicted error, and [`AT_FLOOR`] holds.
const NEAR_FLOOR: f64 = 0.6;
/// See [`NEAR_FLOOR`]: the error of parameters fitted to each step alone is above this fraction of the floor.
const AT_FLOOR: f64 = 0.9;

/// States whether and for which purpose the parameters can be used.
pub(crate) fn verdict(fit: &RegionFit) -> String {
    let q = &fit.quality;
    let predicted = q.predicted.unwrap_or(q.own);
    let of = if q.predicted.is_some() { "steps that were not used for the fit" } else { "the only step" };
    let error = format!("error {:.0} % on {of}", predicted * 100.0);
    if q.saturated > SATURATES {
        return format!(
            "the contact area saturates, so the model cannot follow push-off ({error}); use the measured force instead"
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
            "limited by the contact area: {error}, and {:.0} % for the best non-decreasing function of area; smaller cells or a \
             finer contact rule would reduce it, other parameters would not",
            q.floor * 100.0
        );
    }
    format!("approximate: {error}, and {:.0} % for the best non-decreasing function of area", q.floor * 100.0)
}

/// Limitations of a fit.
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
            "{} at a bound of the search: the best value lies beyond it, so the estimate is the bound",
            at_bound.join(", ")
        ));
    }
    if fit.area_levels < FEW_AREAS {
        warnings.push(format!(
            "the contact area has only {} different values: the cells are too large for this region, and the intervals too narrow",
            fit.area_levels
        ));
    }
    let flatness = fit.law.c_m / fit.pins.thickness_m;
    if flatness > FLAT {
        warnings.push(format!(
            "C is {flatness:.1} times the thickness of the tissue: force depends on area as under a nearly flat body; A, B and C \
             are parameters of the model here, not anatomical dimensions"
        ));
    }
    let is_correlated = |i: usize| (0..FIVE.len()).any(|j| j != i && uncertainty.correlation[i][j].abs() > INSEPARABLE);
    let correlated: Vec<_> = (0..FIVE.len()).filter(|&i| is_correlated(i)).map(|i| FIVE[i]).collect();
    if !correlated.is_empty() {
        warnings.push(format!(
            "{} compensate each other (correlation above {INSEPARABLE}): compare the resulting force, not single parameters",
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

//! Figures in plain words.

use crate::RegionFit;
use crate::interval::{FIVE, Interval};

/// Estimates with a stronger correlation make up for each other.
const INSEPARABLE: f64 = 0.95;

/// C over d0 from which an ellipsoid is no image of a fat pad any more.
const FLAT: f64 = 2.0;

/// Fewer different areas than this in a step hardly draw a curve.
const FEW_AREAS: usize = 8;

/// Where the sentences of a verdict begin, by what a reader would call them: area is flat for this share of the contact; the
/// error is this small; unseen steps err by so many times each one's own; the floor is this share of the error, and each
/// step's own error this share of the floor.
const SATURATES: f64 = 0.2;
const FOLLOWS: f64 = 0.1;
const STEPS_DIFFER: f64 = 1.5;
const NEAR_FLOOR: f64 = 0.6;
const AT_FLOOR: f64 = 0.9;

/// What to do with a fit.
pub(crate) fn verdict(fit: &RegionFit) -> String {
    let q = &fit.quality;
    let predicted = q.predicted.unwrap_or(q.own);
    let percent = predicted * 100.0;
    let errs = if q.predicted.is_some() { "steps it has not seen err" } else { "its own step errs" };
    if q.saturated > SATURATES {
        return format!(
            "area saturates: the model cannot follow push-off here ({errs} by {percent:.0} %); take forces from the cells"
        );
    }
    if predicted < FOLLOWS {
        return format!("follows the force: {errs} by {percent:.0} %");
    }
    if predicted > STEPS_DIFFER * q.own {
        return format!(
            "steps differ: {errs} by {percent:.0} %, each alone by {:.0} %; compare means over steps, not single ones",
            q.own * 100.0
        );
    }
    if q.floor > NEAR_FLOOR * predicted && q.own > AT_FLOOR * q.floor {
        return format!(
            "as good as this area allows ({errs} by {percent:.0} %, the best rising function of area by {:.0} %): smaller cells \
             or a finer contact rule would help, other parameters hardly",
            q.floor * 100.0
        );
    }
    format!(
        "a rough guide: {errs} by {percent:.0} %, where a rising function of area could err by {:.0} %",
        q.floor * 100.0
    )
}

/// What else to know.
pub(crate) fn warnings(fit: &RegionFit) -> Vec<String> {
    let mut warnings = Vec::new();
    let Some(uncertainty) = &fit.uncertainty else { return warnings };
    let undamped = fit.law.damping_pa_s == 0.0;
    if undamped {
        warnings.push("no damping was found: G is 0, and m means nothing".into());
    }
    let beyond = |(interval, name): &(&Interval, &str)| interval.at_bound && !(undamped && *name == "G");
    let at_bound: Vec<_> = uncertainty.intervals.iter().zip(FIVE).filter(beyond).map(|(_, name)| name).collect();
    if !at_bound.is_empty() {
        warnings.push(format!(
            "{} at a bound of the search: the data would go on beyond it, so the value says where the bound is",
            at_bound.join(", ")
        ));
    }
    if fit.area_levels < FEW_AREAS {
        warnings.push(format!(
            "area took {} values only: the cells are too large for this region, and intervals too narrow",
            fit.area_levels
        ));
    }
    let flatness = fit.law.c_m / fit.pins.thickness_m;
    if flatness > FLAT {
        warnings.push(format!(
            "C is {flatness:.1} times the tissue's thickness: force follows area as under a nearly flat body; A, B and C are the \
             model's numbers here, not anatomy"
        ));
    }
    let tied = |i: usize| (0..FIVE.len()).any(|j| j != i && uncertainty.correlation[i][j].abs() > INSEPARABLE);
    let tied: Vec<_> = (0..FIVE.len()).filter(|&i| tied(i)).map(|i| FIVE[i]).collect();
    if !tied.is_empty() {
        warnings.push(format!(
            "{} make up for each other (correlation above {INSEPARABLE}): compare the force they give, not each alone",
            tied.join(", ")
        ));
    }
    let wider = uncertainty.intervals.iter().zip(FIVE).filter(|(interval, _)| {
        let width = |[low, high]: [f64; 2]| high - low;
        interval.bootstrap.is_some_and(|bootstrap| width(bootstrap) > 2.0 * width(interval.jacobian))
    });
    let wider: Vec<_> = wider.map(|(_, name)| name).collect();
    if !wider.is_empty() {
        warnings.push(format!(
            "{}: steps differ by more than their scatter tells; trust the interval from resampled steps",
            wider.join(", ")
        ));
    }
    warnings
}

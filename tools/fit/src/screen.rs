//! Which steps a region can be fitted to, and why none.

use crate::{Filter, RegionCurves, Samples, Step, quality};
use std::cmp::Ordering;
use std::fmt;

/// Fewer samples in contact than this do not carry five parameters.
pub const LEAST_SAMPLES: usize = 12;
/// A region that never carries more, N, counts as unloaded: the force below which a whole foot does.
pub const LEAST_FORCE_N: f64 = 20.0;
/// An area that stays at its largest for this share of the contact tells nothing of how force grows with it.
const SATURATED_SHARE: f64 = 0.8;
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
    /// What was found is beyond what an insole takes: see [`plantar::pipeline::model::ForceLaw::is_valid`].
    OutOfRange,
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
            Self::OutOfRange => f.write_str(
                "out of range: what was found is beyond what an insole takes; check thickness and compression",
            ),
            Self::MixedPeople(ratio) => write!(
                f,
                "the recordings disagree: one predicts the other {ratio:.1} times worse than itself; are they of one person, in the same \
                 shoes, on the same kind of sensor?"
            ),
        }
    }
}

impl std::error::Error for Unfit {}

/// The steps in which a region carries enough to be fitted, or why none does.
pub(crate) fn usable(steps: &[Step], region: usize, filter: Filter) -> Result<Vec<usize>, Unfit> {
    if steps.is_empty() {
        return Err(Unfit::NoSteps);
    }
    // A later reason is the more telling one: the best step got furthest.
    let mut reasons = Vec::new();
    let mut used = Vec::new();
    for (i, step) in steps.iter().enumerate() {
        match check(&step.regions[region], filter) {
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
    let furthest = reasons.into_iter().max_by(|a, b| rank(a).partial_cmp(&rank(b)).unwrap_or(Ordering::Equal));
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

//! Screening: selects the steps to which a region can be fitted, or determines why no step qualifies.

use crate::{Filter, RegionCurves, Samples, Step, quality};
use std::cmp::Ordering;
use std::fmt;

/// Smallest number of samples in contact. Fewer samples cannot determine five parameters.
pub const MIN_SAMPLES: usize = 12;
/// Smallest peak force of a region, N: that of a few cells of an insole at the contact threshold. With a smaller force, the
/// contact area is that of single cells.
pub const MIN_FORCE_N: f64 = 3.0;
/// The area must be below its maximum for some of the contact time. If it is at its maximum for at least this fraction, force
/// cannot be related to area.
const SATURATED_SHARE: f64 = 0.8;
/// An area of at least this fraction of the maximum counts as the maximum.
const SATURATED_AREA: f64 = 0.98;

/// The reason why a region could not be fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NotFitted {
    /// There is no step.
    NoSteps,
    /// No cell of the region was ever in contact.
    NeverLoaded,
    /// The region has a single cell, of which the area follows from the force.
    SingleCell,
    /// The region was in contact, but its force was 0.
    ZeroForce,
    /// The largest force of all steps, N, is below [`MIN_FORCE_N`].
    HardlyLoaded(f64),
    /// The longest contact with sufficient force has this number of samples, fewer than [`MIN_SAMPLES`].
    TooFewFrames(usize),
    /// A cell was saturated in at least one step, and no other step qualifies.
    SaturatedCell,
    /// The area never changes.
    ConstantArea,
    /// The force never changes.
    ConstantForce,
    /// The area is at its maximum for this fraction of the contact time.
    SaturatedArea(f64),
    /// The force law ([`plantar::pipeline::model::ForceLaw::is_valid`]) or a length of the ellipsoid is outside of the range that
    /// an insole accepts.
    OutOfRange,
    /// The recordings disagree, probably because they are of several people. The value is the
    /// [`recordings_ratio`](crate::RegionFit::recordings_ratio).
    MixedPeople(f64),
}

impl fmt::Display for NotFitted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSteps => f.write_str(
                "no whole step: record a walk of several steps, each with the foot in the air before and after it",
            ),
            Self::NeverLoaded => {
                f.write_str("never loaded: no cell came into contact; check the layout and the contact threshold")
            }
            Self::SingleCell => f.write_str(
                "a single cell: its area follows from its force, and not from the tissue; use a sensor with several cells \
                 here",
            ),
            Self::ZeroForce => f.write_str("in contact but without force: check the calibration and the baseline"),
            Self::HardlyLoaded(peak_n) => {
                write!(
                    f,
                    "hardly loaded: at most {peak_n:.2} N in any step, at least {MIN_FORCE_N} N are needed; check the calibration"
                )
            }
            Self::TooFewFrames(samples) => {
                write!(
                    f,
                    "too few frames: {samples} in contact, at least {MIN_SAMPLES} are needed; record at a higher rate"
                )
            }
            Self::SaturatedCell => f.write_str(
                "saturated: a cell reached the end of its scale, and no other step qualifies; use a sensor with a larger range",
            ),
            Self::ConstantArea => f.write_str(
                "constant area: the contact area never changes, so force cannot be related to it; use smaller cells",
            ),
            Self::ConstantForce => f.write_str(
                "constant force: the force never changes during contact; check the sensor and its calibration",
            ),
            Self::SaturatedArea(share) => write!(
                f,
                "saturated area: the area is at its maximum for {:.0} % of the contact; use smaller cells, or a larger \
                 --contact-full, or one above 0 if cells count whole",
                share * 100.0
            ),
            Self::OutOfRange => f.write_str(
                "out of range: the parameters exceed the range that an insole accepts; check thickness and compression",
            ),
            Self::MixedPeople(ratio) => write!(
                f,
                "the recordings disagree: with parameters from the other recordings, the error of a recording is {ratio:.1} times \
                 the error with its own; check that all are of one person, in the same shoes and on the same kind of sensor"
            ),
        }
    }
}

impl std::error::Error for NotFitted {}

/// The indices of the steps to which the region with index `region` can be fitted.
///
/// # Errors
/// If no step qualifies, returns the reason of the step that came closest to passing all checks.
pub(crate) fn usable(steps: &[Step], region: usize, filter: Filter) -> Result<Vec<usize>, NotFitted> {
    if steps.is_empty() {
        return Err(NotFitted::NoSteps);
    }
    let mut reasons = Vec::new();
    let mut used = Vec::new();
    for (i, step) in steps.iter().enumerate() {
        match check(&step.regions[region], filter) {
            Ok(()) => used.push(i),
            Err(reason) => reasons.push(reason),
        }
    }
    // A step ranks higher if it failed a later check, but a step with a saturated cell, or of a region with a single cell, ranks
    // highest. For equal reasons, the step that came closer to passing the check ranks higher.
    let rank = |reason: &NotFitted| match reason {
        NotFitted::NeverLoaded => (0, 0.0),
        NotFitted::ZeroForce => (1, 0.0),
        NotFitted::HardlyLoaded(peak_n) => (2, *peak_n),
        NotFitted::TooFewFrames(samples) => (3, *samples as f64),
        NotFitted::ConstantForce => (4, 0.0),
        NotFitted::ConstantArea => (5, 0.0),
        NotFitted::SaturatedArea(share) => (6, -share),
        _ => (7, 0.0),
    };
    let furthest = reasons.into_iter().max_by(|a, b| rank(a).partial_cmp(&rank(b)).unwrap_or(Ordering::Equal));
    if used.is_empty() { Err(furthest.unwrap_or(NotFitted::NoSteps)) } else { Ok(used) }
}

/// Checks whether a region can be fitted to one step.
fn check(curves: &RegionCurves, filter: Filter) -> Result<(), NotFitted> {
    let samples = Samples::new([curves], filter);
    let area = &samples.raw_area_m2;
    if samples.is_empty() {
        return Err(NotFitted::NeverLoaded);
    }
    if curves.has_single_cell {
        return Err(NotFitted::SingleCell);
    }
    let peak_n = quality::largest(&samples.force_n);
    if peak_n <= 0.0 {
        return Err(NotFitted::ZeroForce);
    }
    if peak_n < MIN_FORCE_N {
        return Err(NotFitted::HardlyLoaded(peak_n));
    }
    if samples.len() < MIN_SAMPLES {
        return Err(NotFitted::TooFewFrames(samples.len()));
    }
    if curves.saturated {
        return Err(NotFitted::SaturatedCell);
    }
    if samples.force_n.iter().all(|&force| force > 0.999 * peak_n) {
        return Err(NotFitted::ConstantForce);
    }
    let most = quality::largest(area);
    let least = area.iter().copied().fold(f64::INFINITY, f64::min);
    if least > 0.999 * most {
        return Err(NotFitted::ConstantArea);
    }
    let share_at_max = area.iter().filter(|&&a| a >= SATURATED_AREA * most).count() as f64 / area.len() as f64;
    if share_at_max >= SATURATED_SHARE { Err(NotFitted::SaturatedArea(share_at_max)) } else { Ok(()) }
}

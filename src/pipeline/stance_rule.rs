//! The rule that determines stance: its parameters, how its thresholds adapt to the wearer, and the contacts that it rejects.

use crate::num::Real;
use serde::{Deserialize, Serialize};

/// Peak of the total force in a step to which the thresholds of an adaptive [`StanceRule`] refer, N: an adult of 65 kg who walks.
pub const REFERENCE_PEAK_N: f64 = 700.0;
/// Range of the peaks to which thresholds are proportional, relative to [`REFERENCE_PEAK_N`]: from a child of 13 kg who walks
/// to a person of 70 kg who runs, or of 130 kg who walks.
const SCALE: (f64, f64) = (0.2, 2.0);
/// A step of walking has at least this peak, relative to the usual one.
const WALKING: f64 = 0.5;
/// A step with less than this peak, relative to the usual one, may be a press of a seated foot. When a runner begins to walk,
/// the steps still have a higher peak than this.
const WEAK: f64 = 0.3;
/// A contact with less than this stance time, relative to the usual one, is brief.
const BRIEF: f64 = 1.0 / 3.0;
/// Weight of a step in the usual peak and in the usual stance time.
const WEIGHT: f64 = 0.5;
/// Weight of a weak step after the first step of walking. It is small, because some presses of a seated foot must not become the
/// usual steps, and above 0, because a person who has begun to unload an injured foot takes many weak steps.
const WEAK_WEIGHT: f64 = 1.0 / 16.0;

/// Time for which the total force must be constant before the foot counts as lifted, ms. After this time the toes are unloaded.
/// The review of all cells that follows takes the same time; a swing lasts about 300 ms or longer, so both fit into it.
pub(crate) const SETTLE_MS: u32 = 100;

/// The rule that determines stance from the total force.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StanceRule {
    /// Heel strike: the total force reaches this value, N, above 0 and at most 1000.
    pub strike_n: f32,
    /// Toe off: the total force falls below this value, N, above 0 and at most 1000. If `release_n` is above `strike_n`, the
    /// force after toe off must first fall below `strike_n`; until then, only a force of at least `release_n` is a heel strike.
    /// So a force that fades after toe off is not taken for one.
    pub release_n: f32,
    /// Shorter contacts are not steps, ms; below `max_stance_ms`.
    pub min_stance_ms: u16,
    /// Shorter gaps do not end a stance, ms; above 0.
    pub min_swing_ms: u16,
    /// Longer contacts are standing, not steps, ms.
    pub max_stance_ms: u16,
    /// True: the forces are those for steps with a peak of [`REFERENCE_PEAK_N`]. They are proportional to the running mean of the
    /// step peaks, with a factor of 0.2 to 2, and apply to the force above that of the lifted foot. False: they are absolute.
    pub is_adaptive: bool,
}

impl StanceRule {
    /// For children and adults who walk or run, barefoot or in a shoe. Heel strike and toe off agree with those in the reports
    /// of another vendor's insoles for walks in shoes (docs/baseline.md). The threshold of toe off is the higher one, because
    /// sensors in a shoe still read some load when the toes have left the ground.
    pub const ADAPTIVE: Self = Self {
        strike_n: 35.0,
        release_n: 70.0,
        min_stance_ms: 90,
        min_swing_ms: 50,
        max_stance_ms: 2500,
        is_adaptive: true,
    };
    /// Fixed thresholds of this project, as in version 0.2; the paper ([`super::model`]) does not state how it isolates a step.
    /// The threshold of toe off is lower than that of [`StanceRule::ADAPTIVE`], and the force seldom falls below it within a
    /// stance, so a shorter gap ends the stance.
    pub const ABSOLUTE: Self =
        Self { strike_n: 30.0, release_n: 20.0, min_swing_ms: 40, is_adaptive: false, ..Self::ADAPTIVE };

    /// True if forces and times are in range and in order.
    pub fn is_valid(&self) -> bool {
        self.release_n > 0.0
            && self.release_n <= 1000.0
            && self.strike_n > 0.0
            && self.strike_n <= 1000.0
            && self.min_swing_ms > 0
            && self.min_stance_ms < self.max_stance_ms
    }
}

/// Number of contacts that did not become steps, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rejected {
    /// Shorter than [`StanceRule::min_stance_ms`], or a scuff: the weak, brief contact of a foot in swing.
    pub short: u32,
    /// Longer than [`StanceRule::max_stance_ms`].
    pub long: u32,
    /// Interrupted by more than [`super::stance::BRIDGED_FRAMES`] missing frames, or begun while they were missing.
    pub broken: u32,
}

/// A [`StanceRule`] with durations in frames.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StanceLimits<R> {
    pub(super) strike_n: R,
    pub(super) release_n: R,
    pub(super) min_stance_frames: u32,
    pub(super) min_swing_frames: u32,
    pub(super) max_stance_frames: u32,
    /// [`SETTLE_MS`] in frames.
    pub(super) settle_frames: u32,
    pub(super) is_adaptive: bool,
}

impl<R: Real> StanceLimits<R> {
    pub(crate) const NONE: Self = Self {
        strike_n: R::ZERO,
        release_n: R::ZERO,
        min_stance_frames: 0,
        min_swing_frames: 0,
        max_stance_frames: 0,
        settle_frames: 0,
        is_adaptive: false,
    };

    /// The rule at a frame period, us. Its durations are rounded to whole frames, at least one; the settling time is rounded up.
    pub fn new(rule: &StanceRule, period_us: u32) -> Self {
        let frames = |ms: u16| ((u32::from(ms) * 1000 + period_us / 2) / period_us).max(1);
        Self {
            strike_n: R::of_f32(rule.strike_n),
            release_n: R::of_f32(rule.release_n),
            min_stance_frames: frames(rule.min_stance_ms),
            min_swing_frames: frames(rule.min_swing_ms),
            max_stance_frames: frames(rule.max_stance_ms),
            settle_frames: (SETTLE_MS * 1000).div_ceil(period_us),
            is_adaptive: rule.is_adaptive,
        }
    }

    /// Largest number of frames from heel strike to the confirmed toe off of a step without missing frames. With missing frames,
    /// the number can be up to [`super::stance::BRIDGED_FRAMES`] larger, bridged frames included.
    pub fn longest_step_frames(&self) -> u32 {
        self.max_stance_frames + self.min_swing_frames
    }

    /// Factor of the thresholds: the mean peak of the recent steps, `recent_peak_n`, relative to [`REFERENCE_PEAK_N`], within
    /// [`SCALE`]; 1 before the first step, when `recent_peak_n` is 0, and for a rule that is not adaptive.
    pub(super) fn scale(&self, recent_peak_n: R) -> R {
        if self.is_adaptive && recent_peak_n > R::ZERO {
            (recent_peak_n * R::of(1.0 / REFERENCE_PEAK_N)).max(R::of(SCALE.0)).min(R::of(SCALE.1))
        } else {
            R::ONE
        }
    }

    /// The usual peak of the wearer's steps, N: the mean of the recent ones, or [`REFERENCE_PEAK_N`] before the first step, when
    /// `recent_peak_n` is 0.
    pub(super) fn usual_peak_n(recent_peak_n: R) -> R {
        if recent_peak_n > R::ZERO { recent_peak_n } else { R::of(REFERENCE_PEAK_N) }
    }
}

/// Peak of the total force and duration of the wearer's recent steps.
#[derive(Clone, Copy, Debug)]
pub(super) struct UsualSteps<R> {
    /// Running mean of the recent peaks, N; 0 before the first step.
    pub(super) recent_n: R,
    /// Running mean of the stance times of the steps of walking, frames; 0 before the first one.
    stance_frames: R,
    /// A step of walking has ended. Until then, the mean may be far above the steps of a light wearer.
    has_walked: bool,
}

impl<R: Real> UsualSteps<R> {
    /// Before the first step.
    pub(super) const NONE: Self = Self { recent_n: R::ZERO, stance_frames: R::ZERO, has_walked: false };

    /// True for a contact of a foot that touches the ground in swing: it is weak, with this peak, N, and brief, with this number
    /// of frames. The steps of a person who unloads an injured foot are weak, but not brief.
    pub(super) fn is_scuff(&self, peak_n: R, frames: u32) -> bool {
        peak_n < self.recent_n * R::of(WEAK) && R::of_u32(frames) < self.stance_frames * R::of(BRIEF)
    }

    /// Adds a step with `peak_n`, N, and this number of frames. True if it is a step of walking, and not a contact of a seated
    /// foot.
    pub(super) fn add(&mut self, peak_n: R, frames: u32) -> bool {
        let before_n = StanceLimits::usual_peak_n(self.recent_n);
        let is_walking = peak_n >= before_n * R::of(WALKING);
        self.has_walked |= is_walking;
        let is_weak = self.has_walked && peak_n < before_n * R::of(WEAK);
        let weight = R::of(if is_weak { WEAK_WEIGHT } else { WEIGHT });
        self.recent_n = before_n + (peak_n - before_n) * weight;
        if is_walking {
            let frames = R::of_u32(frames);
            let before = if self.stance_frames > R::ZERO { self.stance_frames } else { frames };
            self.stance_frames = before + (frames - before) * R::of(WEIGHT);
        }
        is_walking
    }
}

//! Heel strike and toe off from the total force, and the curves of the stance between them.

use super::region::{AreaMoments, RegionFrame};
use crate::num::Real;
use serde::{Deserialize, Serialize};

/// Samples that a stance keeps. A longer one keeps every second, then every fourth frame, and so on.
pub const STANCE_SAMPLES: usize = 256;

/// Frames that may be missing in a row within a stance; they are bridged by straight lines. More spoil the step.
pub const BRIDGED_FRAMES: u32 = 5;

/// When a foot is taken to be on the ground.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StanceRule {
    /// Heel strike: the total force reaches this, N.
    pub strike_n: f32,
    /// Toe off: it falls below this, N; at most `strike_n`.
    pub release_n: f32,
    /// Shorter contacts are no steps, ms.
    pub min_stance_ms: u16,
    /// Shorter gaps do not end a stance, ms.
    pub min_swing_ms: u16,
    /// Longer contacts are standing, not steps, ms.
    pub max_stance_ms: u16,
}

impl StanceRule {
    /// Barefoot or in a shoe, from slow to fast walking.
    pub const WALKING: Self =
        Self { strike_n: 30.0, release_n: 20.0, min_stance_ms: 150, min_swing_ms: 40, max_stance_ms: 2500 };

    /// True when forces and times are finite, positive and in order.
    pub fn is_valid(&self) -> bool {
        self.release_n > 0.0
            && self.release_n <= self.strike_n
            && self.strike_n <= 1000.0
            && self.min_swing_ms > 0
            && self.min_stance_ms < self.max_stance_ms
    }
}

/// Contacts that did not become steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rejected {
    /// Shorter than [`StanceRule::min_stance_ms`].
    pub short: u32,
    /// Longer than [`StanceRule::max_stance_ms`].
    pub long: u32,
    /// Broken by more than [`BRIDGED_FRAMES`] missing frames.
    pub broken: u32,
}

/// A [`StanceRule`] at a frame rate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StanceLimits<R> {
    strike_n: R,
    release_n: R,
    min_stance_frames: u32,
    min_swing_frames: u32,
    max_stance_frames: u32,
}

impl<R: Real> StanceLimits<R> {
    pub(crate) const NONE: Self =
        Self { strike_n: R::ZERO, release_n: R::ZERO, min_stance_frames: 0, min_swing_frames: 0, max_stance_frames: 0 };

    /// The rule for frames `period_us` apart; durations are rounded to whole frames, at least one.
    pub fn new(rule: &StanceRule, period_us: u32) -> Self {
        let frames = |ms: u16| ((u32::from(ms) * 1000 + period_us / 2) / period_us).max(1);
        Self {
            strike_n: R::of_f32(rule.strike_n),
            release_n: R::of_f32(rule.release_n),
            min_stance_frames: frames(rule.min_stance_ms),
            min_swing_frames: frames(rule.min_swing_ms),
            max_stance_frames: frames(rule.max_stance_ms),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Before the first frame.
    Unknown,
    Swing,
    Stance,
    /// A contact that will not become a step, until it ends.
    Ignored,
    /// Toe off is confirmed; the curves wait to be read.
    Ended,
}

/// The state of stance detection and the curves of the running or last stance.
#[derive(Debug)]
pub struct Stance<R> {
    phase: Phase,
    start_seq: u32,
    last_seq: u32,
    /// Frames stored since heel strike, and the one after the last loaded frame.
    pushed: u32,
    loaded: u32,
    /// Frames bridged since heel strike, and up to the last loaded frame.
    bridged_so_far: u32,
    bridged: u32,
    /// Every how many frames one is kept, and how many were.
    stride: u32,
    len: usize,
    area_mm2: [[R; STANCE_SAMPLES]; 8],
    force_n: [[R; STANCE_SAMPLES]; 8],
    last: [(R, R); 8],
    at_peak: [(R, AreaMoments); 8],
    saturated: u8,
    rejected: Rejected,
}

impl<R: Real> Stance<R> {
    /// Before the first frame.
    pub const fn new() -> Self {
        Self {
            phase: Phase::Unknown,
            start_seq: 0,
            last_seq: 0,
            pushed: 0,
            loaded: 0,
            bridged_so_far: 0,
            bridged: 0,
            stride: 0,
            len: 0,
            area_mm2: [[R::ZERO; STANCE_SAMPLES]; 8],
            force_n: [[R::ZERO; STANCE_SAMPLES]; 8],
            last: [(R::ZERO, R::ZERO); 8],
            at_peak: [(R::ZERO, AreaMoments::NONE); 8],
            saturated: 0,
            rejected: Rejected { short: 0, long: 0, broken: 0 },
        }
    }

    /// As new, in place: the curves are large and need no clearing.
    pub fn reset(&mut self) {
        self.phase = Phase::Unknown;
        self.len = 0;
        self.rejected = Rejected::default();
    }

    /// Takes frame number `seq`; true when it confirms toe off. The curves then stay until the next frame is pushed.
    pub fn push(&mut self, limits: &StanceLimits<R>, seq: u32, regions: [&RegionFrame<R>; 8]) -> bool {
        let total_n: R = regions.iter().map(|r| r.force.force_n).sum();
        let missing = seq.wrapping_sub(self.last_seq).wrapping_sub(1);
        self.last_seq = seq;
        match self.phase {
            // A foot that is on the ground already has no heel strike to start from.
            Phase::Unknown if total_n >= limits.release_n => {
                self.ignore();
                false
            }
            // Nor has one whose heel strike is among many missing frames.
            Phase::Swing | Phase::Ended if missing > BRIDGED_FRAMES && total_n >= limits.release_n => {
                self.rejected.broken += 1;
                self.ignore();
                false
            }
            Phase::Unknown | Phase::Swing | Phase::Ended => {
                self.phase = Phase::Swing;
                if total_n >= limits.strike_n {
                    self.begin(seq);
                    self.store(&regions);
                    self.loaded = 1;
                }
                false
            }
            Phase::Ignored => {
                self.pushed += 1;
                if total_n >= limits.release_n {
                    self.loaded = self.pushed;
                } else if self.pushed - self.loaded >= limits.min_swing_frames {
                    self.phase = Phase::Swing;
                }
                false
            }
            Phase::Stance if missing > BRIDGED_FRAMES => {
                self.rejected.broken += 1;
                self.ignore();
                false
            }
            Phase::Stance => {
                self.bridge(missing, &regions);
                self.store(&regions);
                if total_n >= limits.release_n {
                    (self.loaded, self.bridged) = (self.pushed, self.bridged_so_far);
                }
                if self.loaded > limits.max_stance_frames {
                    self.rejected.long += 1;
                    self.ignore();
                    return false;
                }
                if self.pushed - self.loaded < limits.min_swing_frames {
                    return false;
                }
                if self.loaded < limits.min_stance_frames {
                    self.rejected.short += 1;
                    self.phase = Phase::Swing;
                    return false;
                }
                self.len = self.loaded.div_ceil(self.stride) as usize;
                self.phase = Phase::Ended;
                true
            }
        }
    }

    fn begin(&mut self, seq: u32) {
        self.phase = Phase::Stance;
        self.start_seq = seq;
        (self.pushed, self.loaded, self.bridged_so_far, self.bridged) = (0, 0, 0, 0);
        (self.stride, self.len) = (1, 0);
        self.at_peak = [(R::ZERO, AreaMoments::NONE); 8];
        self.saturated = 0;
    }

    fn ignore(&mut self) {
        self.phase = Phase::Ignored;
        (self.pushed, self.loaded) = (0, 0);
    }

    /// Straight lines across missing frames.
    fn bridge(&mut self, missing: u32, regions: &[&RegionFrame<R>; 8]) {
        let from = self.last;
        for i in 1..=missing {
            let part = R::of_u32(i) / R::of_u32(missing + 1);
            self.keep(|region| {
                let (area, force) = from[region];
                let to = regions[region];
                (area + (to.area.area_mm2::<R>() - area) * part, force + (to.force.force_n - force) * part)
            });
            self.bridged_so_far += 1;
        }
    }

    fn store(&mut self, regions: &[&RegionFrame<R>; 8]) {
        let kept = self.keep(|region| (regions[region].area.area_mm2(), regions[region].force.force_n));
        for (i, (region, peak)) in regions.iter().zip(&mut self.at_peak).enumerate() {
            if kept && region.force.force_n > peak.0 {
                *peak = (region.force.force_n, region.area);
            }
            self.saturated |= u8::from(region.saturated) << i;
        }
    }

    /// Keeps one frame of area and force, or passes over it by the stride; true where it is kept.
    fn keep(&mut self, sample: impl Fn(usize) -> (R, R)) -> bool {
        if self.len == STANCE_SAMPLES {
            for curve in self.area_mm2.iter_mut().chain(&mut self.force_n) {
                for i in 0..STANCE_SAMPLES / 2 {
                    curve[i] = curve[2 * i];
                }
            }
            self.len = STANCE_SAMPLES / 2;
            self.stride *= 2;
        }
        let kept = self.pushed.is_multiple_of(self.stride);
        for region in 0..8 {
            let (area, force) = sample(region);
            self.last[region] = (area, force);
            if kept {
                self.area_mm2[region][self.len] = area;
                self.force_n[region][self.len] = force;
            }
        }
        self.len += usize::from(kept);
        self.pushed += 1;
        kept
    }

    /// True from heel strike until toe off is confirmed, also in a contact that will not become a step.
    pub fn on_ground(&self) -> bool {
        matches!(self.phase, Phase::Stance | Phase::Ignored)
    }

    /// The stance's curve of contact area (mm2) and of measured force (N) of region number `region`, one sample every
    /// [`Stance::stride`] frames.
    pub fn curves(&self, region: usize) -> (&[R], &[R]) {
        (&self.area_mm2[region][..self.len], &self.force_n[region][..self.len])
    }

    /// Area moments of region number `region` in the frame of its largest measured force.
    pub fn moments_at_peak(&self, region: usize) -> &AreaMoments {
        &self.at_peak[region].1
    }

    /// Sequence number of the first loaded frame.
    pub fn start_seq(&self) -> u32 {
        self.start_seq
    }

    /// Frames from heel strike to toe off.
    pub fn frames(&self) -> u32 {
        self.loaded
    }

    /// Frames among them that were missing and bridged.
    pub fn bridged(&self) -> u32 {
        self.bridged
    }

    /// Frames between two samples of the curves.
    pub fn stride(&self) -> u32 {
        self.stride
    }

    /// Bit i: a cell of region i was saturated during the stance.
    pub fn saturated(&self) -> u8 {
        self.saturated
    }

    /// Contacts so far that did not become steps.
    pub fn rejected(&self) -> Rejected {
        self.rejected
    }
}

impl<R: Real> Default for Stance<R> {
    fn default() -> Self {
        Self::new()
    }
}

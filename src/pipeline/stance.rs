//! Stance detection: heel strike and toe off from the total force, and the curves of the stance between them.
//!
//! By an adaptive rule, the thresholds are above the force that remains while the foot is lifted, and in proportion to the peaks
//! of the wearer's steps. So a child and a heavy person, barefoot or in a tight shoe, have the same strides.

use super::lift::Constancy;
use super::region::{AreaMoments, RegionFrame};
use super::stance_rule::StanceLimits;
use crate::num::Real;
use serde::{Deserialize, Serialize};

/// Largest number of samples of a curve. In a longer stance only every second frame is stored, then every fourth, and so on.
pub const STANCE_SAMPLES: usize = 256;

/// Largest number of successive frames that may be missing within a stance. They are bridged by linear interpolation. With more
/// missing frames the contact does not become a step.
pub const BRIDGED_FRAMES: u32 = 5;

/// Number of contacts that did not become steps, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rejected {
    /// Shorter than [`StanceRule::min_stance_ms`].
    pub short: u32,
    /// Longer than [`StanceRule::max_stance_ms`].
    pub long: u32,
    /// Interrupted by more than [`BRIDGED_FRAMES`] missing frames.
    pub broken: u32,
}

/// The phase of gait.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Before the first frame.
    Unknown,
    Swing,
    Stance,
    /// A contact that will not become a step.
    Ignored,
    /// Toe off is confirmed, and the curves are valid.
    Ended,
}

/// The state of stance detection and the curves of the present or last stance.
///
/// ```
/// use plantar::pipeline::region::{ForceMoments, RegionFrame};
/// use plantar::pipeline::stance::Stance;
/// use plantar::pipeline::stance_rule::{StanceLimits, StanceRule};
///
/// let limits = StanceLimits::<f64>::new(&StanceRule::ADAPTIVE, 10_000);
/// let mut stance = Stance::new();
/// // 600 N under one region from frame 50 to frame 109, at 100 Hz.
/// let toe_off = (0..200).find(|&seq| {
///     let force_n = if (50..110).contains(&seq) { 600.0 } else { 0.0 };
///     let loaded = RegionFrame { force: ForceMoments { force_n, ..ForceMoments::NONE }, ..RegionFrame::NONE };
///     let regions = [loaded, RegionFrame::NONE];
///     stance.push(&limits, seq, core::array::from_fn(|region| &regions[region.min(1)]))
/// });
/// // Toe off is confirmed after 40 ms.
/// assert_eq!((toe_off, stance.start_seq(), stance.frames()), (Some(113), 50, 60));
/// assert_eq!(stance.curves(0).1, [600.0; 60]);
/// ```
#[derive(Debug)]
pub struct Stance<R> {
    phase: Phase,
    /// Number of the frame of heel strike.
    start_seq: u32,
    /// Number of the last frame.
    last_seq: u32,
    /// Number of frames since heel strike, including bridged frames.
    pushed: u32,
    /// Number of these frames up to the last frame with the foot on the ground.
    loaded: u32,
    /// Number of bridged frames since heel strike.
    bridged_so_far: u32,
    /// Number of bridged frames up to the last frame with the foot on the ground.
    bridged: u32,
    /// Number of frames from one sample of the curves to the next one.
    stride: u32,
    /// Number of samples of the curves.
    len: usize,
    /// Contact area of each region, mm2.
    area_mm2: [[R; STANCE_SAMPLES]; 8],
    /// Measured force of each region, N.
    force_n: [[R; STANCE_SAMPLES]; 8],
    /// Area, mm2, and force, N, of each region in the last frame.
    last: [(R, R); 8],
    /// Largest measured force of each region, N, and its area moments in that frame.
    at_peak: [(R, AreaMoments); 8],
    saturated: u8,
    rejected: Rejected,
    /// Largest total force since heel strike, N.
    peak_n: R,
    /// Mean peak of the recent steps, N; 0 before the first step.
    recent_peak_n: R,
    /// Force of the lifted foot, N.
    lifted_n: R,
    constancy: Constancy<R>,
    is_lifted: bool,
    /// The total force has changed since the first frame.
    has_moved: bool,
}

impl<R: Real> Stance<R> {
    /// The state before the first frame.
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
            peak_n: R::ZERO,
            recent_peak_n: R::ZERO,
            lifted_n: R::ZERO,
            constancy: Constancy::NEW,
            is_lifted: false,
            has_moved: false,
        }
    }

    /// Returns to the state before the first frame, in place: the curves are large and need not be cleared.
    pub fn reset(&mut self) {
        self.phase = Phase::Unknown;
        self.len = 0;
        self.rejected = Rejected::default();
        self.recent_peak_n = R::ZERO;
        self.lifted_n = R::ZERO;
        self.constancy = Constancy::NEW;
        self.is_lifted = false;
        self.has_moved = false;
    }

    /// Processes frame number `seq`. True if it confirms toe off; then the curves are valid until the next call. Sequence numbers
    /// wrap, and a difference of more than 1 between two frames means that frames are missing.
    pub fn push(&mut self, limits: &StanceLimits<R>, seq: u32, regions: [&RegionFrame<R>; 8]) -> bool {
        let total_n: R = regions.iter().map(|r| r.force.force_n).sum();
        let missing = seq.wrapping_sub(self.last_seq).wrapping_sub(1);
        self.last_seq = seq;
        let scale = limits.scale(self.recent_peak_n);
        self.constancy.push(total_n, scale);
        let has_changed = self.constancy.frames() == 0;
        self.has_moved |= has_changed && self.phase != Phase::Unknown;
        self.is_lifted &= !has_changed;
        // Without the foot, there is only the force of the shoe.
        self.lifted_n = self.lifted_n.min(total_n);
        let strike_n = self.lifted_n + limits.strike_n * scale;
        let release_n = self.lifted_n + limits.release_n * scale;
        match self.phase {
            // The foot was on the ground before the first frame, so the heel strike is unknown.
            Phase::Unknown if total_n >= release_n => {
                self.ignore();
                false
            }
            // The heel strike is within a gap that is too long to be bridged.
            Phase::Swing | Phase::Ended if missing > BRIDGED_FRAMES && total_n >= release_n => {
                self.rejected.broken += 1;
                self.ignore();
                false
            }
            Phase::Unknown | Phase::Swing | Phase::Ended => {
                self.phase = Phase::Swing;
                if total_n >= strike_n {
                    self.begin(seq);
                    self.store(&regions);
                    self.peak_n = total_n;
                    self.loaded = 1;
                }
                false
            }
            Phase::Ignored => {
                self.pushed += 1;
                if total_n >= release_n {
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
                self.peak_n = self.peak_n.max(total_n);
                if total_n >= release_n {
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
                self.end(limits)
            }
        }
    }

    /// True in the frame with which the total force has been constant long enough for a lifted foot. Then [`Stance::lift`] must be
    /// called if the foot is lifted.
    pub(crate) fn has_settled(&self, limits: &StanceLimits<R>) -> bool {
        self.constancy.frames() == limits.settle_frames
    }

    /// The foot is lifted, and the present force is that of the shoe. True if this ends a stance; see [`Stance::push`].
    #[cold]
    pub(crate) fn lift(&mut self, limits: &StanceLimits<R>) -> bool {
        self.is_lifted = true;
        if !limits.is_adaptive {
            return false;
        }
        self.lifted_n = self.constancy.level_n();
        match self.phase {
            Phase::Swing | Phase::Ended => false,
            Phase::Unknown | Phase::Ignored => {
                self.phase = Phase::Swing;
                false
            }
            Phase::Stance => {
                // The shoe presses more than before this stance, so its end was not recognised.
                let release_n = self.lifted_n + limits.release_n * limits.scale(self.recent_peak_n);
                let total_n = |sample: &usize| self.force_n.iter().map(|force_n| force_n[*sample]).sum::<R>();
                let last = (0..self.len).rev().find(|sample| total_n(sample) >= release_n);
                self.loaded = last.map_or(0, |last| (last as u32 + 1) * self.stride).min(self.pushed);
                self.end(limits)
            }
        }
    }

    /// True while the foot is lifted and the total force is constant.
    pub(crate) fn is_lifted(&self) -> bool {
        self.is_lifted
    }

    /// True if the foot has carried load since the first frame. A constant force since the first frame may be that of the shoe.
    pub(crate) fn has_loaded(&self) -> bool {
        self.has_moved && self.on_ground()
    }

    /// Ends the stance. True if it is a step.
    fn end(&mut self, limits: &StanceLimits<R>) -> bool {
        if self.loaded < limits.min_stance_frames {
            self.rejected.short += 1;
            self.phase = Phase::Swing;
            return false;
        }
        self.recent_peak_n = StanceLimits::recent_peak_n(self.recent_peak_n, self.peak_n - self.lifted_n);
        self.len = self.loaded.div_ceil(self.stride) as usize;
        self.phase = Phase::Ended;
        true
    }

    /// Begins a stance with its heel strike in frame `seq`.
    fn begin(&mut self, seq: u32) {
        self.phase = Phase::Stance;
        self.start_seq = seq;
        (self.pushed, self.loaded, self.bridged_so_far, self.bridged) = (0, 0, 0, 0);
        (self.stride, self.len) = (1, 0);
        self.at_peak = [(R::ZERO, AreaMoments::NONE); 8];
        self.saturated = 0;
    }

    /// Ignores the present contact, which will not become a step.
    fn ignore(&mut self) {
        self.phase = Phase::Ignored;
        (self.pushed, self.loaded) = (0, 0);
    }

    /// Adds linearly interpolated frames for the `missing` frames between the last one and `regions`.
    fn bridge(&mut self, missing: u32, regions: &[&RegionFrame<R>; 8]) {
        let from = self.last;
        for i in 1..=missing {
            let part = R::of_u32(i) / R::of_u32(missing + 1);
            self.store_sample(|region| {
                let (area, force) = from[region];
                let to = regions[region];
                (area + (to.area.area_mm2::<R>() - area) * part, force + (to.force.force_n - force) * part)
            });
            self.bridged_so_far += 1;
        }
    }

    /// Adds a measured frame.
    fn store(&mut self, regions: &[&RegionFrame<R>; 8]) {
        let is_stored = self.store_sample(|region| (regions[region].area.area_mm2(), regions[region].force.force_n));
        for (i, (region, peak)) in regions.iter().zip(&mut self.at_peak).enumerate() {
            if is_stored && region.force.force_n > peak.0 {
                *peak = (region.force.force_n, region.area);
            }
            self.saturated |= u8::from(region.saturated) << i;
        }
    }

    /// Stores area and force of a frame, unless the stride skips it. True if the frame is stored.
    fn store_sample(&mut self, sample: impl Fn(usize) -> (R, R)) -> bool {
        if self.len == STANCE_SAMPLES {
            for curve in self.area_mm2.iter_mut().chain(&mut self.force_n) {
                for i in 0..STANCE_SAMPLES / 2 {
                    curve[i] = curve[2 * i];
                }
            }
            self.len = STANCE_SAMPLES / 2;
            self.stride *= 2;
        }
        let is_stored = self.pushed.is_multiple_of(self.stride);
        for region in 0..8 {
            let (area, force) = sample(region);
            self.last[region] = (area, force);
            if is_stored {
                self.area_mm2[region][self.len] = area;
                self.force_n[region][self.len] = force;
            }
        }
        self.len += usize::from(is_stored);
        self.pushed += 1;
        is_stored
    }

    /// True from heel strike until toe off is confirmed, and during contacts that will not become steps.
    pub fn on_ground(&self) -> bool {
        matches!(self.phase, Phase::Stance | Phase::Ignored)
    }

    /// The curves of contact area (mm2) and measured force (N) of a region over the stance, one sample every [`Stance::stride`]
    /// frames.
    ///
    /// # Panics
    /// If `region` is not an index of [`crate::Region::ALL`].
    pub fn curves(&self, region: usize) -> (&[R], &[R]) {
        (&self.area_mm2[region][..self.len], &self.force_n[region][..self.len])
    }

    /// Area moments of a region, about its reference point, in the stored frame of its largest measured force.
    ///
    /// # Panics
    /// If `region` is not an index of [`crate::Region::ALL`].
    pub fn moments_at_peak(&self, region: usize) -> &AreaMoments {
        &self.at_peak[region].1
    }

    /// Sequence number of the frame of heel strike.
    pub fn start_seq(&self) -> u32 {
        self.start_seq
    }

    /// Number of frames from heel strike to toe off.
    pub fn frames(&self) -> u32 {
        self.loaded
    }

    /// Number of frames from heel strike to toe off that were missing and bridged.
    pub fn bridged(&self) -> u32 {
        self.bridged
    }

    /// Number of frames from one sample of the curves to the next one, a power of 2.
    pub fn stride(&self) -> u32 {
        self.stride
    }

    /// Bit i: a cell of region i was saturated during the stance.
    pub fn saturated(&self) -> u8 {
        self.saturated
    }

    /// Number of contacts so far that did not become steps.
    pub fn rejected(&self) -> Rejected {
        self.rejected
    }
}

impl<R: Real> Default for Stance<R> {
    fn default() -> Self {
        Self::new()
    }
}

//! Stance detection: heel strike and toe off from the total force, and the curves of the stance between them.
//!
//! With an adaptive rule, the thresholds apply to the force above that of the lifted foot, and are proportional to the peaks of
//! the wearer's steps. So the steps of a child and of a heavy person, barefoot or in a tight shoe, begin and end at the same
//! phase of gait.

use super::bout::{BoutRecord, Bouts};
use super::curves::Curves;
use super::lift::Constancy;
use super::region::{RegionFrame, Side};
use super::stance_rule::{Rejected, StanceLimits, UsualSteps};
use super::window::STANDING;
use crate::num::Real;

/// Largest number of successive frames that may be missing within a stance. They are bridged by linear interpolation. With more
/// missing frames the contact does not become a step.
pub const BRIDGED_FRAMES: u32 = 5;

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
///     stance.push(&limits, seq, &core::array::from_fn(|region| &regions[region.min(1)]), (0.0, 0.0))
/// });
/// // Toe off is confirmed after 50 ms.
/// assert_eq!((toe_off, stance.start_seq(), stance.frames()), (Some(114), 50, 60));
/// assert_eq!(stance.curves().force_n(0), [600.0; 60]);
/// ```
#[derive(Debug)]
pub struct Stance<R> {
    phase: Phase,
    /// Number of the frame of heel strike.
    start_seq: u32,
    /// Number of the last frame.
    last_seq: u32,
    /// Number of frames since the contact was ignored, in [`Phase::Ignored`].
    ignored: u32,
    /// Number of frames since heel strike, including bridged frames, up to the last one in which the total force reached the
    /// threshold of toe off; 1 before it has reached this threshold. In [`Phase::Ignored`], the frames are counted since the
    /// contact was ignored, and the number is 0 before the force reaches the threshold again.
    loaded: u32,
    /// Number of bridged frames since heel strike.
    bridged_so_far: u32,
    /// Number of bridged frames up to the last frame in which the force reached the threshold of toe off; [`Stance::lift`] does
    /// not change it.
    bridged: u32,
    curves: Curves<R>,
    bouts: Bouts<R>,
    /// Largest measured force of each region, N.
    region_peaks_n: [R; 8],
    /// Bit i: the last frame has the largest measured force of region i since heel strike, and is not after toe off.
    at_peak: u8,
    /// Bit i: a cell of region i was saturated since heel strike.
    saturated: u8,
    rejected: Rejected,
    /// Largest total force since heel strike, N.
    peak_n: R,
    /// Peak and duration of the wearer's usual steps.
    usual_steps: UsualSteps<R>,
    /// Force of the lifted foot, N.
    lifted_n: R,
    constancy: Constancy<R>,
    /// The total force was below the threshold of heel strike after the last contact began or was ignored, and after the force
    /// last reached both thresholds.
    is_unloaded: bool,
    is_lifted: bool,
    /// The total force has changed since the first frame.
    has_moved: bool,
    /// A step of walking has ended; see [`UsualSteps::add`]. The review of the lifted foot resets it.
    pub(crate) has_walked: bool,
}

impl<R: Real> Stance<R> {
    /// The state before the first frame.
    pub const fn new() -> Self {
        Self {
            phase: Phase::Unknown,
            start_seq: 0,
            last_seq: 0,
            ignored: 0,
            loaded: 0,
            bridged_so_far: 0,
            bridged: 0,
            curves: Curves::EMPTY,
            bouts: Bouts::new(),
            region_peaks_n: [R::ZERO; 8],
            at_peak: 0,
            saturated: 0,
            rejected: Rejected { short: 0, long: 0, broken: 0 },
            peak_n: R::ZERO,
            usual_steps: UsualSteps::NONE,
            lifted_n: R::ZERO,
            constancy: Constancy::NEW,
            is_unloaded: false,
            is_lifted: false,
            has_moved: false,
            has_walked: false,
        }
    }

    /// Returns to the state before the first frame, in place, because the curves are large. `period_us` is the time between
    /// frames.
    pub fn reset(&mut self, period_us: u32) {
        self.phase = Phase::Unknown;
        self.curves.clear();
        self.bouts.set_up(period_us);
        self.rejected = Rejected::default();
        self.usual_steps = UsualSteps::NONE;
        self.lifted_n = R::ZERO;
        self.constancy = Constancy::NEW;
        (self.is_lifted, self.is_unloaded) = (false, false);
        (self.has_moved, self.has_walked) = (false, false);
    }

    /// Processes frame number `seq`; `centre_mm` is the centre of pressure of the foot, mm. True if the frame confirms the toe
    /// off of a step; then the curves are valid until the next call. Sequence numbers wrap, and a difference of more than 1
    /// between two frames means that frames are missing.
    pub fn push(
        &mut self,
        limits: &StanceLimits<R>,
        seq: u32,
        regions: &[&RegionFrame<R>; 8],
        centre_mm: (R, R),
    ) -> bool {
        self.at_peak = 0;
        let total_n: R = regions.iter().map(|region| region.force.force_n).sum();
        let missing = if self.phase == Phase::Unknown { 0 } else { seq.wrapping_sub(self.last_seq).wrapping_sub(1) };
        self.last_seq = seq;
        let scale = limits.scale(self.usual_steps.recent_n);
        self.constancy.push(total_n, scale);
        let has_changed = self.constancy.frames() == 0;
        self.has_moved |= has_changed && self.phase != Phase::Unknown;
        self.is_lifted &= !has_changed;
        // The shoe presses in each frame, so the force of the lifted foot is at most the present total force.
        self.lifted_n = self.lifted_n.min(total_n);
        let release_n = self.lifted_n + limits.release_n * scale;
        let mut strike_n = self.lifted_n + limits.strike_n * scale;
        // After toe off the force may still fade. Until it has fallen below the threshold of heel strike, only a force that
        // reaches both thresholds is a heel strike. A force below it earlier in the stance does not count: `is_unloaded` becomes
        // false again when the force reaches both thresholds.
        self.is_unloaded = total_n < strike_n || (self.is_unloaded && total_n < release_n);
        if !self.is_unloaded {
            strike_n = strike_n.max(release_n);
        }
        let is_toe_off = match self.phase {
            // The foot was on the ground before the first frame, so the heel strike is unknown.
            Phase::Unknown if total_n >= release_n => {
                self.ignore();
                false
            }
            // The heel strike is within a gap that is too long to be bridged.
            Phase::Swing | Phase::Ended if missing > BRIDGED_FRAMES && total_n >= strike_n.min(release_n) => {
                self.rejected.broken += 1;
                self.ignore();
                false
            }
            Phase::Unknown | Phase::Swing | Phase::Ended => {
                self.phase = Phase::Swing;
                if total_n >= strike_n {
                    self.begin(seq);
                    self.store(regions, centre_mm);
                    self.peak_n = total_n;
                    return false;
                }
                false
            }
            Phase::Ignored => {
                self.ignored += 1;
                if total_n >= release_n {
                    self.loaded = self.ignored;
                } else if self.ignored - self.loaded >= limits.min_swing_frames {
                    self.phase = Phase::Swing;
                }
                false
            }
            Phase::Stance if missing > BRIDGED_FRAMES => {
                self.rejected.broken += 1;
                self.bouts.contact(&self.curves, self.start_seq);
                self.ignore();
                false
            }
            Phase::Stance => {
                if missing > 0 {
                    self.curves.bridge(missing, regions, centre_mm, self.loaded);
                    self.bridged_so_far += missing;
                }
                if total_n >= release_n {
                    (self.loaded, self.bridged) = (self.curves.frames() + 1, self.bridged_so_far);
                }
                self.store(regions, centre_mm);
                self.peak_n = self.peak_n.max(total_n);
                if self.loaded > limits.max_stance_frames {
                    self.rejected.long += 1;
                    self.bouts.contact(&self.curves, self.start_seq);
                    self.ignore();
                    return false;
                }
                // The frame is stored in the curves, from which the bouts receive it if it is not part of a step.
                return self.curves.frames() - self.loaded >= limits.min_swing_frames && self.end(limits);
            }
        };
        self.bouts.frame(seq, 1 + missing.min(BRIDGED_FRAMES), regions, self.on_ground());
        is_toe_off
    }

    /// True in the one frame in which the total force has been constant for exactly the settling time of `limits`. If the cells
    /// show a lifted foot, [`Stance::lift`] must then be called.
    pub(crate) fn has_settled(&self, limits: &StanceLimits<R>) -> bool {
        self.constancy.frames() == limits.settle_frames
    }

    /// Records that the foot is lifted: the present force is that of the shoe. True if this confirms the toe off of a step; then
    /// the curves are valid until the next call of [`Stance::push`].
    #[cold]
    pub(crate) fn lift(&mut self, limits: &StanceLimits<R>) -> bool {
        self.is_lifted = true;
        if !limits.is_adaptive {
            return false;
        }
        self.lifted_n = self.constancy.level_n();
        match self.phase {
            Phase::Swing | Phase::Ended => {}
            Phase::Unknown | Phase::Ignored => self.phase = Phase::Swing,
            Phase::Stance => {
                // The shoe presses more than before this stance, so the end of the stance was not recognised.
                let release_n = self.lifted_n + limits.release_n * limits.scale(self.usual_steps.recent_n);
                self.loaded = self.curves.frames_above(release_n);
                return self.end(limits);
            }
        }
        false
    }

    /// Smallest force of a standing foot, N.
    pub(crate) fn standing_n(&self) -> R {
        StanceLimits::usual_peak_n(self.usual_steps.recent_n) * R::of(STANDING)
    }

    /// True while the foot is lifted and the total force is constant.
    pub(crate) fn is_lifted(&self) -> bool {
        self.is_lifted
    }

    /// True if the foot is on the ground and the total force has changed since the first frame. A force that has been constant
    /// since the first frame may be that of the shoe.
    pub(crate) fn carries_load(&self) -> bool {
        self.has_moved && self.on_ground()
    }

    /// Ends the stance. True if the stance is a step.
    fn end(&mut self, limits: &StanceLimits<R>) -> bool {
        let peak_n = self.peak_n - self.lifted_n;
        if self.loaded < limits.min_stance_frames || self.usual_steps.is_scuff(peak_n, self.loaded) {
            self.rejected.short += 1;
            self.bouts.contact(&self.curves, self.start_seq);
            self.phase = Phase::Swing;
            return false;
        }
        self.has_walked |= self.usual_steps.add(peak_n, self.loaded);
        let samples = self.curves.samples_in(self.loaded);
        self.bouts.after_step(&self.curves, self.start_seq, samples, self.usual_steps.recent_n);
        self.curves.end_after(samples);
        self.phase = Phase::Ended;
        true
    }

    /// Takes the bout that the last frame has completed, as a record with this side and number.
    pub(crate) fn take_bout(&mut self, side: Side, number: u32) -> Option<BoutRecord<R>> {
        self.bouts.take(side, number)
    }

    /// Confirms toe off at the end of a recording, if the foot was off the ground in the last frame. True if this completes a
    /// step; then the curves are valid until the next call of [`Stance::push`].
    pub(crate) fn end_stance(&mut self, limits: &StanceLimits<R>) -> bool {
        self.phase == Phase::Stance && self.curves.frames() > self.loaded && self.end(limits)
    }

    /// Completes the bout in progress, at the end of a recording. A stance in progress is part of it.
    pub(crate) fn end_bout(&mut self) {
        if self.phase == Phase::Stance {
            self.bouts.contact(&self.curves, self.start_seq);
            self.ignore();
        }
        self.bouts.end();
    }

    /// Begins a stance with its heel strike in frame `seq`.
    fn begin(&mut self, seq: u32) {
        self.phase = Phase::Stance;
        self.is_unloaded = false;
        self.start_seq = seq;
        (self.loaded, self.bridged_so_far, self.bridged) = (1, 0, 0);
        self.curves.clear();
        self.region_peaks_n = [R::ZERO; 8];
        self.saturated = 0;
    }

    /// Ignores the present contact, which will not become a step.
    fn ignore(&mut self) {
        self.phase = Phase::Ignored;
        self.is_unloaded = false;
        (self.ignored, self.loaded) = (0, 0);
    }

    /// Adds a measured frame to the curves, and updates the largest forces and the saturated regions. A frame after toe off has
    /// no largest force; `loaded` is 1 as long as the force has not reached the threshold of toe off.
    fn store(&mut self, regions: &[&RegionFrame<R>; 8], centre_mm: (R, R)) {
        let is_after_toe_off = self.loaded > 1 && self.curves.frames() >= self.loaded;
        self.curves.push(regions, centre_mm, self.loaded);
        let (mut at_peak, mut saturated) = (0, 0);
        for (i, (region, peak_n)) in regions.iter().zip(&mut self.region_peaks_n).enumerate() {
            if region.force.force_n > *peak_n && !is_after_toe_off {
                *peak_n = region.force.force_n;
                at_peak |= 1 << i;
            }
            saturated |= u8::from(region.saturated) << i;
        }
        self.at_peak = at_peak;
        self.saturated |= saturated;
    }

    /// True from heel strike until toe off is confirmed, and during contacts that will not become steps.
    pub fn on_ground(&self) -> bool {
        matches!(self.phase, Phase::Stance | Phase::Ignored)
    }

    /// The curves of the stance.
    pub fn curves(&self) -> &Curves<R> {
        &self.curves
    }

    /// Bit i: the last frame has the largest measured force of region i since heel strike.
    pub fn at_peak(&self) -> u8 {
        self.at_peak
    }

    /// Largest measured force of a region since heel strike, N.
    ///
    /// # Panics
    /// If `region` is not an index of [`crate::Region::ALL`].
    pub fn region_peak_n(&self, region: usize) -> R {
        self.region_peaks_n[region]
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

    /// Bit i: a cell of region i was saturated during the stance.
    pub fn saturated(&self) -> u8 {
        self.saturated
    }

    /// Number of rejected contacts so far, by reason. Contacts that began before the first frame are not counted.
    pub fn rejected(&self) -> Rejected {
        self.rejected
    }
}

impl<R: Real> Default for Stance<R> {
    fn default() -> Self {
        Self::new()
    }
}

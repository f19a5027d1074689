//! Load bouts: the load that is not part of a step, so that each newton-second is part of one record.
//!
//! The load outside steps is collected in windows of two seconds, and each window has a kind. A bout ends when two successive
//! windows are not of its kind, so that a single movement does not divide a time of standing. The next bout has the kind of the
//! second window, because the first window may be the transition. The force between the steps of a walk, below the threshold of
//! heel strike, is collected in one long, unclassified bout.

use super::curves::Curves;
use super::region::{RegionFrame, Side};
use super::stance_rule::StanceLimits;
pub use super::window::BoutKind;
use super::window::{LIGHT, Load, STANDING, Window};
use crate::num::Real;

/// Time outside steps after which a window ends, ms.
const WINDOW_MS: u32 = 2_000;
/// A window that is shorter than [`WINDOW_MS`] divided by this number, because the foot left or touched the ground, is too short
/// to be classified: it joins the bout around it. One with load from between steps or from a short contact does not: however
/// short it is, it has the kind [`BoutKind::Unclassified`].
const LEAST_PART: u32 = 2;
/// A bout ends with the window in which it reaches this duration, s.
const LONGEST_S: u32 = 60;
/// The duration that replaces [`LONGEST_S`] for a bout with a mean force below [`LIGHT`], s.
const LONGEST_LIGHT_S: u32 = 3_600;

/// A bout has at least this force-time integral, N s. A smaller one is added to the next bout.
const LEAST_N_S: f64 = 1.0;

/// The load of one region in a bout.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BoutRegion<R> {
    /// Force-time integral of the measured force, N s.
    pub integral_n_s: R,
    /// Time integral of the largest cell pressure, kPa s.
    pub pressure_integral_kpa_s: R,
    /// Largest pressure of a cell, kPa.
    pub peak_pressure_kpa: R,
}

/// A load bout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoutRecord<R> {
    /// The foot.
    pub side: Side,
    /// Number of the record; steps, bouts and alerts are numbered together.
    pub number: u32,
    /// The kind.
    pub kind: BoutKind,
    /// Time from frame 0 to the first frame of the bout, us.
    pub start_us: u64,
    /// Time from the first frame to the end of the last one, a period after its scan, or, if the next bout begins after a step,
    /// to the beginning of that bout, us. The bout can span steps; their load is not part of it.
    pub duration_us: u32,
    /// The regions, in the order of [`crate::Region::ALL`].
    pub regions: [BoutRegion<R>; 8],
}

/// A bout, or a window that may become part of the next bout: its load and its kind.
#[derive(Clone, Copy, Debug)]
struct Part<R> {
    kind: BoutKind,
    /// A load without frames means that there is no such part.
    load: Load<R>,
}

impl<R: Real> Part<R> {
    const NONE: Self = Self { kind: BoutKind::Unclassified, load: Load::NONE };

    fn is_none(&self) -> bool {
        self.load.frames == 0
    }

    fn take(&mut self) -> Self {
        core::mem::replace(self, Self::NONE)
    }
}

/// The load outside steps that is not part of a complete bout yet, and the bout that was completed last.
#[derive(Debug)]
pub(crate) struct Bouts<R> {
    /// Time between frames, us.
    period_us: u32,
    /// [`WINDOW_MS`] in frames.
    window_frames: u32,
    /// Running mean of the peaks of the total force in the wearer's recent steps, N; 0 before the first step.
    peak_n: R,
    /// Number of the last frame.
    last_seq: u32,
    window: Window<R>,
    /// The bout in progress.
    bout: Part<R>,
    /// The window after the bout in progress, if this window is of another kind.
    next: Part<R>,
    /// The complete bout.
    complete: Part<R>,
    /// Number of the frame after the complete bout.
    end_seq: u32,
}

impl<R: Real> Bouts<R> {
    pub(crate) const fn new() -> Self {
        Self {
            period_us: 0,
            window_frames: 0,
            peak_n: R::ZERO,
            last_seq: 0,
            window: Window::NEW,
            bout: Part::NONE,
            next: Part::NONE,
            complete: Part::NONE,
            end_seq: 0,
        }
    }

    /// Discards all load, for frames with this time between them, us.
    pub(crate) fn set_up(&mut self, period_us: u32) {
        *self = Self { period_us, ..Self::new() };
        self.window_frames = self.frames_in(WINDOW_MS);
    }

    /// Adds frame number `seq`, which is not part of a stance. `frames` is the number of frames that it stands for, more than 1
    /// after missing ones.
    #[inline(never)]
    pub(crate) fn frame(&mut self, seq: u32, frames: u32, regions: &[&RegionFrame<R>; 8], is_on_ground: bool) {
        if is_on_ground != self.window.is_on_ground {
            // The window, and with it perhaps the bout, has ended with the previous frame.
            self.end_window();
            self.window.is_on_ground = is_on_ground;
        }
        self.last_seq = seq;
        self.window.add(seq, frames, |region| (regions[region].force.force_n, regions[region].peak_kpa));
        if self.window.load.frames >= self.window_frames {
            self.end_window();
            self.window.is_on_ground = is_on_ground;
        }
    }

    /// Adds the samples of a stance from `first` on, after the end of a step. `peak_n` is the running mean of the
    /// peaks of the wearer's recent steps, N.
    pub(crate) fn after_step(&mut self, curves: &Curves<R>, start_seq: u32, first: usize, peak_n: R) {
        self.peak_n = peak_n;
        self.add(curves, start_seq, first);
        self.window.is_between_steps = true;
    }

    /// Adds a whole contact that began with frame `start_seq` and is not a step.
    pub(crate) fn contact(&mut self, curves: &Curves<R>, start_seq: u32) {
        let has_kind = self.is_long(curves.frames());
        if has_kind {
            self.end_window();
        }
        self.add(curves, start_seq, 0);
        for region in 0..8 {
            if let Some(between) = curves.between(region) {
                let peak_kpa = &mut self.window.load.peak_kpa[region];
                *peak_kpa = peak_kpa.max(R::of_u32(between.pressure_dkpa.into()) * R::of(0.1));
            }
        }
        if has_kind {
            self.end_window();
            self.window.is_on_ground = true;
        } else {
            self.window.is_between_steps = true;
        }
    }

    /// Adds the samples from `first` on to the window. Frame `start_seq` is sample 0.
    fn add(&mut self, curves: &Curves<R>, start_seq: u32, first: usize) {
        for sample in first..curves.samples() {
            let seq = start_seq.wrapping_add(sample as u32 * curves.stride());
            // The frames up to the next sample or, after the last one, up to the end.
            let frames = (curves.frames() - sample as u32 * curves.stride()).min(curves.stride());
            self.window.add(seq, frames, |region| {
                let peak_kpa = R::of_u32(curves.pressure_dkpa(region)[sample].into()) * R::of(0.1);
                (curves.force_n(region)[sample], peak_kpa)
            });
            self.last_seq = seq;
        }
    }

    fn frames_in(&self, ms: u32) -> u32 {
        (u64::from(ms) * 1000 / u64::from(self.period_us.max(1))) as u32
    }

    /// True if a window of this number of frames is long enough to have a kind of its own.
    fn is_long(&self, frames: u32) -> bool {
        LEAST_PART * frames >= self.window_frames
    }

    /// Ends the window: decides which bout it is part of.
    fn end_window(&mut self) {
        let window = core::mem::replace(&mut self.window, Window::NEW);
        if window.load.frames == 0 {
            return;
        }
        let peak_n = StanceLimits::usual_peak_n(self.peak_n);
        let part = Part { kind: window.kind(peak_n), load: window.load };
        let has_kind = self.is_long(window.load.frames) || window.is_between_steps;
        if !self.next.is_none() && (part.kind != self.bout.kind || !has_kind) {
            self.next.load.append(&part.load);
            if has_kind {
                self.next.kind = part.kind;
                let next = self.next.take();
                let ended = core::mem::replace(&mut self.bout, next);
                self.complete(ended, next.load.start_seq);
            }
        } else {
            // A single window of another kind is part of the bout.
            let single = self.next.take();
            self.bout.load.append(&single.load);
            let is_light_kind = matches!(self.bout.kind, BoutKind::Sitting | BoutKind::Unclassified);
            if !single.is_none() && is_light_kind && self.bout.load.has_mean(STANDING, peak_n) {
                // Slow steps are windows of load between those of swing, which are no bout of sitting.
                self.bout.kind = single.kind;
            }
            if self.bout.is_none() {
                self.bout.kind = part.kind;
            }
            if self.bout.is_none() || part.kind == self.bout.kind || !has_kind {
                self.bout.load.append(&part.load);
            } else {
                self.next = part;
            }
        }
        let is_light = !self.bout.load.has_mean(LIGHT, peak_n);
        let longest_ms = if is_light { LONGEST_LIGHT_S } else { LONGEST_S } * 1000;
        let end_seq = if self.next.is_none() { self.last_seq.wrapping_add(1) } else { self.next.load.start_seq };
        if end_seq.wrapping_sub(self.bout.load.start_seq) >= self.frames_in(longest_ms) {
            let next = self.next.take();
            let ended = core::mem::replace(&mut self.bout, next);
            self.complete(ended, end_seq);
        }
    }

    /// Completes a bout that ended before frame `end_seq`. A bout with little load is added to the one in progress.
    fn complete(&mut self, bout: Part<R>, end_seq: u32) {
        let least_n = R::of(LEAST_N_S * 1e6) / R::of_u32(self.period_us.max(1));
        if !bout.is_none() && bout.load.total_n() >= least_n {
            // Two bouts can be completed in one frame, or at the end of a recording. They become one record.
            let mut first = self.complete.take();
            if first.is_none() {
                first.kind = bout.kind;
            }
            first.load.append(&bout.load);
            (self.complete, self.end_seq) = (first, end_seq);
        } else {
            self.bout.load.append(&Load { frames: 0, ..bout.load });
        }
    }

    /// Completes the bout in progress, at the end of a recording. The last windows are part of it, unless they end it.
    pub(crate) fn end(&mut self) {
        self.end_window();
        if !self.complete.is_none() {
            // The bout that is already complete is returned first; another call of this function completes the rest.
            return;
        }
        let next = self.next.take();
        let mut bout = core::mem::replace(&mut self.bout, Part::NONE);
        bout.load.append(&next.load);
        self.complete(bout, self.last_seq.wrapping_add(1));
    }

    /// Returns the complete bout as the record with this number; `None` if there is none.
    pub(crate) fn take(&mut self, side: Side, number: u32) -> Option<BoutRecord<R>> {
        if self.complete.is_none() {
            return None;
        }
        let Part { kind, load } = self.complete.take();
        let frame_s = R::of_u32(self.period_us) / R::of(1e6);
        Some(BoutRecord {
            side,
            number,
            kind,
            start_us: u64::from(load.start_seq) * u64::from(self.period_us),
            duration_us: self.end_seq.wrapping_sub(load.start_seq).saturating_mul(self.period_us),
            regions: core::array::from_fn(|region| BoutRegion {
                integral_n_s: load.force_n[region] * frame_s,
                pressure_integral_kpa_s: load.pressure_kpa[region] * frame_s,
                peak_pressure_kpa: load.peak_kpa[region],
            }),
        })
    }
}

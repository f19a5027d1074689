//! Segmentation of a standing trial: sit with both feet lifted, stand still, sit and lift both feet again (DeBerardinis et al.
//! 2019, section 2.4: 5, 10 and 5 seconds).
//!
//! People do not follow the times exactly, and unloaded cells do not read zero, so neither the times nor the forces are known
//! in advance. The segmentation relies on two facts: while the person stands, the force is constant and highest; while the feet
//! are lifted, before and after standing, it is constant and lowest. If the feet rest on the floor instead, throughout the
//! trial, this cannot be recognised from the force alone.

use crate::{Error, Recording, Result};
use std::ops::Range;

/// Shortest time for which the person stands still, s.
const STAND_S: f64 = 5.0;
/// Shortest total lifted time, sum of the intervals before and after standing, s.
const LIFTED_S: f64 = 3.0;
/// Shortest duration of each of the two lifted intervals, s.
const LIFTED_EACH_S: f64 = 1.0;
/// Time that is omitted at both ends of each part, s, because the foot is still moving.
const GUARD_S: f64 = 0.5;
/// Window of the moving average that is applied to the force, s.
const SMOOTH_S: f64 = 0.1;

/// Smallest difference between the forces on one foot while standing and while lifted, N.
const MIN_SPAN_N: f64 = 50.0;
// The following constants are fractions of the actual difference, `span_n`.
/// Largest deviation from the mean force while standing, due to sway.
const SWAY: f64 = 0.25;
/// Standing begins with the first frame, and ends with the last frame, in which the force is this close to its mean.
const SETTLED: f64 = 0.03;
/// While a foot is lifted, its force is at most this much above its lowest force. A foot that rests on the floor while the
/// person sits carries 10 to 20 % of the difference.
const LIFTED: f64 = 0.05;
/// Largest difference between the lowest forces before and after standing.
const DRIFT: f64 = 0.1;

/// The remedy for a recording that is not a standing trial.
const REMEDY: &str =
    "record the trial again: sit and lift both feet for 5 s, stand still for 10 s, sit and lift both feet for 5 s";

/// The parts of one foot's standing trial as ranges of frames. Transitions belong to no part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StandingTrial {
    /// The foot is lifted, before and after standing.
    pub lifted: [Range<usize>; 2],
    /// The person stands still.
    pub standing: Range<usize>,
}

impl StandingTrial {
    /// Finds the parts of a trial. `name` is the name of the recording in messages.
    ///
    /// # Errors
    /// Fails if the foot is not lifted for at least 3 s in total and 1 s each time, or does not stand still for at least 5 s in
    /// between. Half a second at both ends of each part does not count.
    pub fn find(recording: &Recording, name: &str) -> Result<Self> {
        let wrong = |problem: String| Error::content(name, problem, REMEDY);
        let force = Force::of(recording);
        let (frames, frames_in) = (recording.frames(), |s: f64| ((s * recording.rate_hz).round() as usize).max(1));
        let seconds = |frames: usize| frames as f64 / recording.rate_hz;
        let guarded = |part: Range<usize>| {
            let guard = frames_in(GUARD_S);
            let start = part.start + guard;
            start..part.end.saturating_sub(guard).max(start)
        };
        if frames < frames_in(STAND_S + LIFTED_S) {
            return Err(wrong(format!("{:.1} s are too short for a standing trial", seconds(frames))));
        }

        // These means are over times that are long enough to suppress the peaks of steps, stumbles and jumps.
        let low_n = force.means_n(0..frames, frames_in(LIFTED_EACH_S)).fold(f64::INFINITY, f64::min);
        let high_n = force.means_n(0..frames, frames_in(STAND_S)).fold(0.0, f64::max);
        let span_n = high_n - low_n;
        if span_n < MIN_SPAN_N {
            return Err(wrong(format!(
                "lifted and standing cannot be distinguished: apart from short peaks, the force on the foot is {low_n:.0} to \
                 {high_n:.0} N"
            )));
        }

        let smooth_n = |i: usize| force.around_n(i, frames_in(SMOOTH_S) / 2);
        let swaying = longest_run(0..frames, |i| (smooth_n(i) - high_n).abs() <= SWAY * span_n);
        let level_n = force.mean_n(swaying.clone());
        let is_settled = |&i: &usize| (smooth_n(i) - level_n).abs() <= SETTLED * span_n;
        let stand_start = swaying.clone().find(is_settled).unwrap_or(swaying.end);
        let stand_end = swaying.clone().rfind(is_settled).map_or(stand_start, |last| last + 1);
        let standing = guarded(stand_start..stand_end);
        if standing.len() < frames_in(STAND_S) {
            return Err(wrong(format!(
                "the longest interval of standing still lasts {:.1} s; at least {STAND_S} s are needed",
                seconds(standing.len())
            )));
        }

        let find_lifted = |within: Range<usize>, when: &str| {
            let least_frames = frames_in(LIFTED_EACH_S);
            let lowest_n = force.means_n(within.clone(), least_frames).fold(f64::INFINITY, f64::min);
            let lifted = guarded(longest_run(within, |i| smooth_n(i) <= lowest_n + LIFTED * span_n));
            // If `within` is shorter than a second, the lowest mean is infinite.
            if lowest_n <= low_n + DRIFT * span_n && lifted.len() >= least_frames {
                return Ok(lifted);
            }
            let (from_s, to_s) = (recording.t_s[stand_start], recording.t_s[stand_end - 1]);
            Err(wrong(format!("no lifted foot {when} standing, which lasts from {from_s:.1} s to {to_s:.1} s")))
        };
        let lifted = [find_lifted(0..stand_start, "before")?, find_lifted(stand_end..frames, "after")?];
        let lifted_frames = lifted[0].len() + lifted[1].len();
        if lifted_frames < frames_in(LIFTED_S) {
            return Err(wrong(format!(
                "the foot is lifted for {:.1} s in total; at least {LIFTED_S} s are needed",
                seconds(lifted_frames)
            )));
        }
        Ok(Self { lifted, standing })
    }
}

/// The force on the foot as cumulative sums, for means over any range of frames.
struct Force {
    /// Element `i` is the sum of the forces in the frames before frame `i`, N. The last element is the sum over all frames.
    sums_n: Vec<f64>,
}

impl Force {
    fn of(recording: &Recording) -> Self {
        let mut sum_n = 0.0;
        let sums = (0..recording.frames()).map(|i| {
            sum_n += recording.force_n(i);
            sum_n
        });
        Self { sums_n: std::iter::once(0.0).chain(sums).collect() }
    }

    /// Mean force in a range of frames, N.
    fn mean_n(&self, frames: Range<usize>) -> f64 {
        (self.sums_n[frames.end] - self.sums_n[frames.start]) / frames.len() as f64
    }

    /// Mean force in frame `i` and up to `neighbours` frames on each side of it, N.
    fn around_n(&self, i: usize, neighbours: usize) -> f64 {
        self.mean_n(i.saturating_sub(neighbours)..(i + neighbours + 1).min(self.sums_n.len() - 1))
    }

    /// Mean force in each run of `length` successive frames in `within`, N.
    fn means_n(&self, within: Range<usize>, length: usize) -> impl Iterator<Item = f64> {
        (within.start..(within.end + 1).saturating_sub(length)).map(move |i| self.mean_n(i..i + length))
    }
}

/// The longest run of successive frames in `within` for which `holds` returns true. If several runs are equally long, the
/// first.
fn longest_run(within: Range<usize>, holds: impl Fn(usize) -> bool) -> Range<usize> {
    let mut longest = within.start..within.start;
    let mut start = within.start;
    for i in within {
        if !holds(i) {
            start = i + 1;
        } else if i + 1 - start > longest.len() {
            longest = start..i + 1;
        }
    }
    longest
}

//! Finds the parts of a standing trial: sit with both feet lifted, stand still, sit and lift both feet again (DeBerardinis
//! et al. 2019, section 2.4: 5, 10 and 5 seconds).
//!
//! People are late and unloaded cells do not read zero, so neither times nor forces are known beforehand. What is known is
//! that the force rests at its highest while standing and at its lowest, before and after, while the feet are lifted. The
//! force alone does not tell lifted feet from feet that rest on the floor all the time.

use crate::{Error, Recording, Result};
use std::ops::Range;

/// Standing still lasts at least this long, s.
const STAND_S: f64 = 5.0;
/// Both times with lifted feet last together at least this long, s.
const LIFTED_S: f64 = 3.0;
/// and each at least this long, s.
const LIFTED_ONCE_S: f64 = 1.0;
/// Left out at both ends of every part, s: the foot is still moving.
const GUARD_S: f64 = 0.5;
/// The force is averaged over this time before it is compared, s.
const SMOOTH_S: f64 = 0.1;

/// Standing and lifted feet differ by at least this force on one foot, N.
const LEAST_SPAN_N: f64 = 50.0;
// The rest as fractions of that difference.
/// Sway, about the mean force of standing.
const SWAY: f64 = 0.25;
/// Standing begins and ends this close to its mean force.
const SETTLED: f64 = 0.03;
/// A lifted foot's force stays this close above its lowest; a foot resting on the floor while sitting takes two to four
/// times as much.
const LIFTED: f64 = 0.05;
/// The two times with lifted feet agree to this.
const DRIFT: f64 = 0.1;

const REMEDY: &str = "record it again: sit and lift both feet for 5 s, stand still for 10 s, sit and lift both for 5 s";

/// The frames of one foot's standing trial by what the foot does; transitions belong to none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StandingTrial {
    /// The foot is lifted: before and after standing.
    pub lifted: [Range<usize>; 2],
    /// The person stands still.
    pub standing: Range<usize>,
}

impl StandingTrial {
    /// Finds the parts of a trial; `place` names the recording in messages.
    ///
    /// # Errors
    /// When the foot is not lifted for at least 3 s in all, 1 s each time, or does not stand still for at least 5 s between,
    /// besides 0.5 s at the ends of each.
    pub fn find(recording: &Recording, place: &str) -> Result<Self> {
        let wrong = |problem: String| Error::content(place, problem, REMEDY);
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

        // Means over so long that no step, stumble or jump decides.
        let low_n = force.means_n(0..frames, frames_in(LIFTED_ONCE_S)).fold(f64::INFINITY, f64::min);
        let high_n = force.means_n(0..frames, frames_in(STAND_S)).fold(0.0, f64::max);
        let span_n = high_n - low_n;
        if span_n < LEAST_SPAN_N {
            return Err(wrong(format!(
                "no difference between lifted and standing: apart from brief moments the foot reads {low_n:.0} to {high_n:.0} N"
            )));
        }

        let smooth_n = |i: usize| force.around_n(i, frames_in(SMOOTH_S) / 2);
        let swaying = longest_run(0..frames, |i| (smooth_n(i) - high_n).abs() <= SWAY * span_n);
        let level_n = force.mean_n(swaying.clone());
        let is_settled = |&i: &usize| (smooth_n(i) - level_n).abs() <= SETTLED * span_n;
        let start = swaying.clone().find(is_settled).unwrap_or(swaying.end);
        let end = swaying.clone().rfind(is_settled).map_or(start, |last| last + 1);
        let standing = guarded(start..end);
        if standing.len() < frames_in(STAND_S) {
            return Err(wrong(format!(
                "the longest time of standing still has {:.1} s, and {STAND_S} s are needed",
                seconds(standing.len())
            )));
        }

        let find_lifted = |within: Range<usize>, when: &str| {
            let once = frames_in(LIFTED_ONCE_S);
            let lowest_n = force.means_n(within.clone(), once).fold(f64::INFINITY, f64::min);
            let lifted = guarded(longest_run(within, |i| smooth_n(i) <= lowest_n + LIFTED * span_n));
            // Without a whole second the lowest mean is infinite.
            if lowest_n <= low_n + DRIFT * span_n && lifted.len() >= once {
                return Ok(lifted);
            }
            let (from_s, to_s) = (recording.t_s[start], recording.t_s[end - 1]);
            Err(wrong(format!("no lifted foot {when} standing, which lasts from {from_s:.1} s to {to_s:.1} s")))
        };
        let lifted = [find_lifted(0..start, "before")?, find_lifted(end..frames, "after")?];
        let lifted_frames = lifted[0].len() + lifted[1].len();
        if lifted_frames < frames_in(LIFTED_S) {
            return Err(wrong(format!(
                "the foot is lifted for {:.1} s in all, and {LIFTED_S} s are needed",
                seconds(lifted_frames)
            )));
        }
        Ok(Self { lifted, standing })
    }
}

/// The force on the foot, ready for means over any frames.
struct Force {
    /// The sum over all frames before each, N.
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

    fn mean_n(&self, frames: Range<usize>) -> f64 {
        (self.sums_n[frames.end] - self.sums_n[frames.start]) / frames.len() as f64
    }

    /// The mean over up to `reach` frames on both sides of frame `i`.
    fn around_n(&self, i: usize, reach: usize) -> f64 {
        self.mean_n(i.saturating_sub(reach)..(i + reach + 1).min(self.sums_n.len() - 1))
    }

    /// The means over every `length` successive frames of `within`.
    fn means_n(&self, within: Range<usize>, length: usize) -> impl Iterator<Item = f64> {
        (within.start..(within.end + 1).saturating_sub(length)).map(move |i| self.mean_n(i..i + length))
    }
}

/// The first of the longest stretches of frames that all hold.
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

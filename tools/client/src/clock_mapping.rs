//! Estimates an insole's clock relative to the host's, so that several insoles share one time axis.

use plantar::protocol::LoadRecord;
use std::collections::VecDeque;

/// Length of a window, us: of the requests within a window, only the one with the least delay is used.
const WINDOW_US: u64 = 5_000_000;
/// Number of windows in use: five minutes in total.
const WINDOWS: usize = 60;
/// Largest plausible drift, us per us: that between two crystals with a tolerance of 50 ppm.
const MAX_DRIFT: f64 = 100e-6;
/// If all recent samples, at least [`FAR_SAMPLES`], are above the line by more than this, us, the clock of the host was set back,
/// and the line is not used. Even on a slow link, the least delay of several requests within [`RECENT_US`] is shorter than this.
const FAR_US: f64 = 40e3;
/// Least number of recent samples from which it is concluded that the clock of the host was set back: a page in the background
/// sends so few requests that the only recent one may be delayed by more than [`FAR_US`].
const FAR_SAMPLES: usize = 3;
/// A request is recent if it arrived at most this time before the last one, us. If no line is plausible, for example because the
/// drift exceeds [`MAX_DRIFT`], as that of an insole without a running crystal, only recent requests are used, without drift: a
/// drift of 500 ppm is 15 ms in this time.
const RECENT_US: u64 = 30_000_000;
/// Longest time before the first or after the last request in use, us, at which the times of two insoles can be compared: within
/// it, two clocks that differ by [`MAX_DRIFT`] drift apart by 10 ms.
const COMPARABLE_US: u64 = 100_000_000;
/// Number of steps of a foot that suffices to compare it with the other foot.
const COMPARED_STEPS: usize = 10;

/// True if `comparable` of the `steps` steps of a foot have times that can be compared (see
/// [`ClockMapping::is_start_comparable`]), and these are enough to compare the feet: at least 10, or at least half of the steps,
/// and not none.
pub fn are_feet_comparable(comparable: usize, steps: usize) -> bool {
    comparable > 0 && comparable >= COMPARED_STEPS.min(steps.saturating_sub(comparable))
}

/// Offset and drift of an insole's clock, from [`plantar::protocol::ToDevice::GetTime`] and its answers.
///
/// A request that is sent at host time `a` arrives at the insole when the clock of the insole shows `d`: `d - a` is the offset of
/// the clock plus the delay of the request. The delay is never negative, so the line that lies closest below all `d - a` is an
/// estimate of the clock's offset (Moon, Skelly and Towsley 1999, "Estimation and removal of clock skew from network delay
/// measurements"). The delay of the answers has no influence. The least delay of the requests remains as an error, which is about
/// the same for all insoles on links of the same kind.
#[derive(Clone, Debug, Default)]
pub struct ClockMapping {
    /// The request with the least delay in each window, oldest first.
    samples: VecDeque<Sample>,
    /// The line below all samples that is closest at their mean time.
    line: Option<Line>,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    /// The insole's clock when the request arrived.
    device_us: u64,
    /// That time minus the host's clock when the request was sent.
    offset_us: i64,
}

/// Offset of the insole's clock: `offset_us` at the insole's time `device_us`, and `drift` more in each microsecond after it.
#[derive(Clone, Copy, Debug)]
struct Line {
    device_us: u64,
    offset_us: i64,
    drift: f64,
    /// Times since `device_us`, us, between which the drift holds: those of the samples, and as long before and after them as
    /// they span. A drift that was measured in seconds says nothing about hours.
    drifting_us: [f64; 2],
}

impl Line {
    /// The drift of the offset from `device_us` to `since_us` after it, us.
    fn drifted_us(&self, since_us: f64) -> f64 {
        let [first_us, last_us] = self.drifting_us;
        self.drift * since_us.clamp(first_us, last_us)
    }
}

impl ClockMapping {
    /// A mapping before the first answer.
    pub const fn new() -> Self {
        Self { samples: VecDeque::new(), line: None }
    }

    /// Adds an answer to a request that was sent at the host's time `host_us` and arrived at the insole's time `device_us`.
    pub fn answer(&mut self, host_us: u64, device_us: u64) {
        let sample = Sample { device_us, offset_us: device_us.wrapping_sub(host_us) as i64 };
        match self.samples.back_mut() {
            // A clock that runs backwards belongs to an insole that restarted.
            Some(last) if device_us < last.device_us => self.samples.clear(),
            Some(last) if device_us / WINDOW_US == last.device_us / WINDOW_US => {
                if sample.offset_us < last.offset_us {
                    *last = sample;
                }
                self.line = line_below(&self.samples);
                return;
            }
            _ => {}
        }
        if self.samples.len() == WINDOWS {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
        self.line = line_below(&self.samples);
    }

    /// The host's time, us, when the insole's clock shows `device_us`; `None` before the first answer.
    pub fn host_us(&self, device_us: u64) -> Option<u64> {
        let line = self.line?;
        let since_us = device_us.wrapping_sub(line.device_us) as i64 as f64;
        let offset_us = line.offset_us.wrapping_add(line.drifted_us(since_us).round() as i64);
        Some(device_us.wrapping_sub(offset_us as u64))
    }

    /// True if [`Self::host_us`] of this time is exact enough to compare it with that of another insole: the requests in use
    /// began at most 100 s after it, and ended at most 100 s before it. The drift of the clock at other times is not known.
    /// False before the first answer.
    pub fn is_comparable(&self, device_us: u64) -> bool {
        let (Some(first), Some(last)) = (self.samples.front(), self.samples.back()) else { return false };
        let begin_us = first.device_us.saturating_sub(COMPARABLE_US);
        (begin_us..=last.device_us.saturating_add(COMPARABLE_US)).contains(&device_us)
    }

    /// The host's time at the start of a load record (a step, a load bout or an alert), us; `None` before the first answer.
    /// For a record of an earlier boot it is the time of the insole's own wall clock; `None` if that clock was not set.
    pub fn start_us(&self, record: &LoadRecord) -> Option<u64> {
        let (boots_since, start_us, start_unix_us) = record.start();
        if boots_since == 0 { self.host_us(start_us) } else { start_unix_us }
    }

    /// True if [`Self::start_us`] is exact enough to compare the record with those of another insole; see
    /// [`Self::is_comparable`]. It never is for a record of an earlier boot, because the wall clock of the insole is not exact
    /// enough.
    pub fn is_start_comparable(&self, record: &LoadRecord) -> bool {
        let (boots_since, start_us, _) = record.start();
        boots_since == 0 && self.is_comparable(start_us)
    }

    /// The time on the insole's clock at `host_us`; `None` before the first answer.
    pub fn device_us(&self, host_us: u64) -> Option<u64> {
        let line = self.line?;
        let line_host_us = line.device_us.wrapping_sub(line.offset_us as u64);
        let since_us = host_us.wrapping_sub(line_host_us) as i64 as f64;
        let drifted_us = line.drifted_us(since_us / (1.0 - line.drift));
        Some(line.device_us.wrapping_add((since_us + drifted_us).round() as i64 as u64))
    }
}

/// The line below all samples that is closest to them at their mean time: an edge of their lower convex hull.
fn line_below(samples: &VecDeque<Sample>) -> Option<Line> {
    let (first, last) = (samples.front()?, samples.back()?);
    let point = |q: &Sample| ((q.device_us - first.device_us) as f64, q.offset_us.wrapping_sub(first.offset_us) as f64);
    let slope = |a: &Sample, b: &Sample| (point(b).1 - point(a).1) / (point(b).0 - point(a).0);
    let mut hull: Vec<&Sample> = Vec::new();
    for sample in samples {
        while let [.., a, b] = hull[..]
            && slope(a, b) >= slope(b, sample)
        {
            hull.pop();
        }
        hull.push(sample);
    }
    let mean_us = samples.iter().map(|q| point(q).0).sum::<f64>() / samples.len() as f64;
    // The hull's edge at the mean time of the samples.
    let edge = hull.windows(2).find(|edge| point(edge[1]).0 >= mean_us);
    let edge = edge.map(|edge| (edge[0], slope(edge[0], edge[1])));
    let recent = || samples.iter().filter(|q| last.device_us - q.device_us <= RECENT_US);
    // The slope can be implausible for samples within a short time. If several samples are recent, and all of them are far above
    // the line, the clock of the host was set back.
    let is_plausible = |(from, drift): &(&Sample, f64)| {
        let above_us = |q: &Sample| point(q).1 - point(from).1 - drift * (point(q).0 - point(from).0);
        let is_near = || recent().count() < FAR_SAMPLES || recent().any(|q| above_us(q) <= FAR_US);
        drift.abs() <= MAX_DRIFT && is_near()
    };
    let (on_line, drift) = match edge.filter(is_plausible) {
        Some(edge) => edge,
        // There is only one sample, or no plausible line: assume no drift.
        None => (recent().min_by_key(|q| q.offset_us)?, 0.0),
    };
    let since_us = |q: &Sample| point(q).0 - point(on_line).0;
    let span_us = point(last).0;
    Some(Line {
        device_us: on_line.device_us,
        offset_us: on_line.offset_us,
        drift,
        drifting_us: [since_us(first) - span_us, since_us(last) + span_us],
    })
}

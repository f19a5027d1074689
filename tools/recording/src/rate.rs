//! The frame rate of a recording, and resampling.

use crate::check::{self, At};
use crate::gaps::{is_filled, longest_filled_s, median_interval_s};
use crate::{Error, Recording, Result};

/// Lowest plausible rate, Hz. At a lower rate, a stance of half a second would have at most one frame, so the times must be in
/// another unit, such as ms.
pub(crate) const MIN_HZ: f64 = 2.0;
/// Largest distance of a frame from its place at the mean rate, in frames: this fraction of the number of frames, or
/// [`LINE_FRAMES`] if this is more.
const LINE_SHARE: f64 = 0.01;
/// See [`LINE_SHARE`].
const LINE_FRAMES: f64 = 3.0;

/// Largest relative difference of two rates that count as equal: a stated rate may be rounded.
const EQUAL_SHARE: f64 = 0.01;

/// A computed time, rounded to 1 ns, so that rounding errors do not appear in the decimals of text files.
pub fn rounded_s(t_s: f64) -> f64 {
    (t_s * 1e9).round() / 1e9
}

/// True if two recordings with these rates, Hz, can be compared frame by frame.
pub fn is_same_rate(first_hz: f64, second_hz: f64) -> bool {
    (first_hz / second_hz - 1.0).abs() <= EQUAL_SHARE
}

/// The mean frame rate, Hz, of frames at these times. `place` converts the part of the recording that violates a rule to text
/// for the message.
///
/// # Errors
/// Fails if there are fewer than two times, the times do not increase, an interval differs by more than half from the median
/// interval, the rate changes, or the times cannot be seconds.
pub fn of(t_s: &[f64], place: &dyn Fn(At) -> String) -> Result<f64> {
    check::times(t_s, place)?;
    check::intervals(t_s, 1.0 / median_s(t_s, place)?, place)?;
    let rate_hz = mean_hz(t_s, place)?;
    // With one rate, the times are on a straight line over the index of the frame. With two rates, the mean rate would change the
    // duration of every step.
    let most = (LINE_SHARE * t_s.len() as f64).max(LINE_FRAMES);
    let off_line = |i: usize| ((t_s[i] - t_s[0]) * rate_hz - i as f64).abs();
    // Where the rate changes, the distance from the line is largest.
    let farthest = (0..t_s.len()).max_by(|&a, &b| off_line(a).total_cmp(&off_line(b)));
    if let Some(i) = farthest.filter(|&i| off_line(i) > most) {
        return Err(Error::content(
            place(At::Frame(i)),
            format!("the frame is {:.0} frames from its place at the mean rate of {rate_hz:.2} Hz", off_line(i)),
            format!("the rate changes: split the recording where it does, or {}", check::RESAMPLE),
        ));
    }
    Ok(rate_hz)
}

/// As [`of`], for frames that are resampled: the intervals between the times, which increase, may differ, but none may be longer
/// than a gap that the importers of other formats fill.
///
/// # Errors
/// Fails if there are fewer than two times, an interval is too long, or the times cannot be seconds.
pub fn of_uneven(t_s: &[f64], place: &dyn Fn(At) -> String) -> Result<f64> {
    check::times(t_s, place)?;
    let median_s = median_s(t_s, place)?;
    let is_too_long = |pair: &[f64]| !is_filled(pair[1] - pair[0], median_s);
    if let Some(i) = t_s.windows(2).position(is_too_long) {
        return Err(Error::content(
            place(At::Frame(i + 1)),
            format!(
                "{:.6} s after the frame before, at most {:.2} s can be interpolated",
                t_s[i + 1] - t_s[i],
                longest_filled_s(median_s)
            ),
            "split the recording at this frame, as plantar import does with --from and --to",
        ));
    }
    mean_hz(t_s, place)
}

/// The median interval between frames at these times, s.
fn median_s(t_s: &[f64], place: &dyn Fn(At) -> String) -> Result<f64> {
    median_interval_s(t_s).ok_or_else(|| {
        let problem = match t_s.len() {
            0 => "no frames",
            _ => "a single frame has no rate",
        };
        Error::content(place(At::Whole), problem, "record at least two frames")
    })
}

/// The mean rate of frames at these increasing times, of which there are at least two, Hz.
fn mean_hz(t_s: &[f64], place: &dyn Fn(At) -> String) -> Result<f64> {
    // If the times are rounded, for example to whole milliseconds, the mean interval is still exact; the median is not.
    let rate_hz = (t_s.len() - 1) as f64 / (t_s[t_s.len() - 1] - t_s[0]);
    if rate_hz < MIN_HZ {
        let problem = format!("a frame every {:.3} s", 1.0 / rate_hz);
        return Err(Error::content(place(At::Whole), problem, "give times in seconds"));
    }
    check::rate(rate_hz, place)?;
    Ok(rate_hz)
}

/// See [`Recording::at_rate`].
pub fn at_rate(recording: &Recording, rate_hz: f64) -> Result<Recording> {
    let t_s = &recording.t_s;
    let span_s = match (t_s.first(), t_s.last()) {
        (Some(first_s), Some(last_s)) => last_s - first_s,
        _ => {
            return Err(Error::content("resampling", "no frames", "record at least one frame"));
        }
    };
    // The small addend includes a last frame that would lie after the end only because of rounding.
    let intervals = (span_s * rate_hz + 1e-6).floor();
    if !(rate_hz > 0.0 && rate_hz <= check::MAX_HZ && intervals < f64::from(u32::MAX)) {
        return Err(Error::content(
            "resampling",
            format!("cannot resample to {rate_hz} Hz"),
            format!("choose a positive rate of at most {} Hz that results in at most 2^32 - 1 frames", check::MAX_HZ),
        ));
    }
    let frames = intervals as usize + 1;
    if check::value_count(frames as u64, recording.cells(), "resampling").is_err() {
        return Err(Error::content(
            "resampling",
            format!("{frames} frames of {} cells, more than this program can hold in memory", recording.cells()),
            "choose a lower rate, or split the recording",
        ));
    }
    let mut resampled_s = Vec::with_capacity(frames);
    let mut pressure_kpa = Vec::with_capacity(frames * recording.cells());
    let mut before = 0;
    for k in 0..frames {
        let now_s = t_s[0] + k as f64 / rate_hz;
        while before + 2 < t_s.len() && t_s[before + 1] <= now_s {
            before += 1;
        }
        let after = (before + 1).min(t_s.len() - 1);
        let gap_s = t_s[after] - t_s[before];
        let share = if gap_s > 0.0 { ((now_s - t_s[before]) / gap_s).min(1.0) as f32 } else { 0.0 };
        resampled_s.push(rounded_s(now_s));
        pressure_kpa
            .extend(recording.frame(before).iter().zip(recording.frame(after)).map(|(a, b)| a + (b - a) * share));
    }
    Ok(Recording {
        rate_hz,
        source: format!("{} Resampled linearly from {:.6} Hz to {rate_hz:.6} Hz.", recording.source, recording.rate_hz),
        t_s: resampled_s,
        pressure_kpa,
        side: recording.side,
        layout: recording.layout.clone(),
    })
}

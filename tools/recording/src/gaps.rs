//! Gaps in an export, where the measuring system lost frames. An imported recording has no gaps: short ones are filled, and if
//! there are longer ones, only the longest part between them is imported. [`crate::pedar`] and [`crate::csv`] instead refuse an
//! export with gaps; if the frames will be resampled, [`crate::csv`] refuses only the longer ones.

use crate::text::{seconds, significant};
use std::ops::Range;

/// Longest gap that is filled by interpolation, s, unless the rate is low; see [`longest_filled_s`]. A heel strike takes about
/// this time, so that a longer gap may hide the beginning of a step.
const LONGEST_FILLED_S: f64 = 0.1;
/// If the time between two frames is longer than this number of median intervals, frames between them were lost.
pub const GAP_INTERVALS: f64 = 1.5;
/// Shortest median interval with which gaps are filled, s; with a shorter one, the number of frames in a gap would have no limit.
/// It is between the interval at 1000 Hz, with which gaps are filled, and that at 2000 Hz, because the times of an export are
/// rounded.
const SHORTEST_FILLED_PERIOD_S: f64 = 7e-4;

/// Fills gaps of up to [`longest_filled_s`] by linear interpolation. In a longer gap the load is unknown, so the recording is
/// divided there, and only the part with the most frames remains. `kpa` contains the pressures of `cells` cells for each time.
/// Returns sentences with the numbers of frames that were interpolated and left out, and with the times of the parts, so that
/// another one can be selected; `None` without a gap.
///
/// Nothing is changed if the median interval is below [`SHORTEST_FILLED_PERIOD_S`]. Times that do not increase are left as they
/// are; [`crate::rate::of`] rejects them.
pub fn fill(t_s: &mut Vec<f64>, kpa: &mut Vec<f32>, cells: usize) -> Option<String> {
    let (period_s, part) = part_to_fill(t_s)?;
    let left_out = (part.len() < t_s.len()).then(|| left_out(t_s, &part, period_s));
    let (old_s, old_kpa) = (t_s[part.clone()].to_vec(), kpa[part.start * cells..part.end * cells].to_vec());
    t_s.clear();
    kpa.clear();
    for (i, &now_s) in old_s.iter().enumerate() {
        let frame = |i: usize| &old_kpa[i * cells..(i + 1) * cells];
        if let Some(before_s) = i.checked_sub(1).map(|before| old_s[before]) {
            let intervals = intervals(now_s - before_s, period_s);
            for k in 1..intervals {
                let share = k as f64 / intervals as f64;
                t_s.push(before_s + share * (now_s - before_s));
                kpa.extend(frame(i - 1).iter().zip(frame(i)).map(|(a, b)| a + (b - a) * share as f32));
            }
        }
        t_s.push(now_s);
        kpa.extend(frame(i));
    }
    let filled = t_s.len() - old_s.len();
    let filled = (filled > 0).then(|| format!("Lost frames that were interpolated linearly: {filled}."));
    Some(filled.into_iter().chain(left_out).collect::<Vec<_>>().join(" "))
}

/// Sentences about the frames that are left out if only this part of the frames remains.
fn left_out(t_s: &[f64], part: &Range<usize>, period_s: f64) -> String {
    /// Shorter parts are not listed.
    const LEAST_LISTED_S: f64 = 1.0;
    /// The largest number of parts that are listed.
    const MOST_LISTED: usize = 6;
    let duration_s = |part: &Range<usize>| t_s[part.end - 1] - t_s[part.start];
    let in_words = |part: &Range<usize>| format!("{} to {}", seconds(t_s[part.start]), seconds(t_s[part.end - 1]));
    let mut others = parts(t_s, period_s);
    others.retain(|other| other != part && duration_s(other) >= LEAST_LISTED_S);
    let count = others.len();
    let listed: Vec<_> = others.iter().take(MOST_LISTED).map(in_words).collect();
    let others = match count {
        0 => String::new(),
        _ => format!(
            " With --from and --to, {} can be imported: {} s{}.",
            if count == 1 { "the other part" } else { "one of the other parts" },
            listed.join(", "),
            match count.saturating_sub(MOST_LISTED) {
                0 => String::new(),
                more => format!(", and {more} more"),
            }
        ),
    };
    format!(
        "Frames are missing for more than {:.2} s: only the longest part without such a gap was imported, {} s. Frames that were \
         left out: {}.{others}",
        longest_filled_s(period_s),
        in_words(part),
        t_s.len() - part.len()
    )
}

/// The number of frames after [`fill`].
pub fn frames_after_fill(t_s: &[f64]) -> usize {
    let Some((period_s, part)) = part_to_fill(t_s) else { return t_s.len() };
    1 + t_s[part].windows(2).map(|pair| intervals(pair[1] - pair[0], period_s)).sum::<usize>()
}

/// The median interval, s, and the range of the frames that remain after [`fill`]; `None` if it changes nothing.
fn part_to_fill(t_s: &[f64]) -> Option<(f64, Range<usize>)> {
    let period_s = median_interval_s(t_s)?;
    let has_gap = || t_s.windows(2).any(|pair| intervals(pair[1] - pair[0], period_s) > 1);
    (period_s >= SHORTEST_FILLED_PERIOD_S && has_gap()).then(|| (period_s, longest_part(t_s, period_s)))
}

/// The number of intervals between two successive frames after [`fill`]; 1 if no frame was lost between them. `period_s` is the
/// median interval.
fn intervals(interval_s: f64, period_s: f64) -> usize {
    if interval_s > GAP_INTERVALS * period_s { (interval_s / period_s).round().max(2.0) as usize } else { 1 }
}

/// The longest gap that is filled, s, between frames with the median interval `period_s`.
pub fn longest_filled_s(period_s: f64) -> f64 {
    // At a low rate, the usual intervals exceed `LONGEST_FILLED_S`, and must not divide the recording.
    LONGEST_FILLED_S.max(GAP_INTERVALS * period_s)
}

/// True if an interval between two frames is at most [`longest_filled_s`] long, apart from the rounding of the times.
pub fn is_filled(interval_s: f64, period_s: f64) -> bool {
    /// Because times are rounded, the longest gap may appear longer, by at most this fraction of the median interval.
    const ROUNDING: f64 = 0.25;
    interval_s <= longest_filled_s(period_s) + ROUNDING * period_s
}

/// Sentences with the number of intervals that are longer than usual, and the longest one, for frames that are resampled; `None`
/// if there are none.
pub fn long_intervals(t_s: &[f64]) -> Option<String> {
    let usual_s = GAP_INTERVALS * median_interval_s(t_s)?;
    let mut long_s: Vec<f64> = t_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    long_s.retain(|interval_s| *interval_s > usual_s);
    let longest_s = long_s.iter().copied().reduce(f64::max)?;
    Some(format!(
        "Intervals longer than {GAP_INTERVALS} times the median one, in which frames were interpolated linearly: {}. The longest \
         one is {} s.",
        long_s.len(),
        significant(longest_s)
    ))
}

/// The median interval between these times, s; of an even number of intervals, the lower of the two in the middle. `None` for
/// fewer than two times.
pub fn median_interval_s(t_s: &[f64]) -> Option<f64> {
    let mut intervals_s: Vec<f64> = t_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let middle = intervals_s.len().checked_sub(1)? / 2;
    Some(*intervals_s.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The range of frames with the most frames of the [`parts`]; the first of several.
fn longest_part(t_s: &[f64], period_s: f64) -> Range<usize> {
    parts(t_s, period_s).into_iter().rev().max_by_key(Range::len).unwrap_or_default()
}

/// The ranges of the frames between the intervals that are too long to be filled. `period_s` is the median interval.
fn parts(t_s: &[f64], period_s: f64) -> Vec<Range<usize>> {
    let (mut parts, mut start) = (Vec::new(), 0);
    for end in 1..=t_s.len() {
        if end == t_s.len() || !is_filled(t_s[end] - t_s[end - 1], period_s) {
            parts.push(start..end);
            start = end;
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_gap_is_filled_on_the_line_between_its_neighbours() {
        let (mut t_s, mut kpa) = (vec![0.0, 0.01, 0.04, 0.05], vec![0.0, 10.0, 40.0, 50.0]);
        let note = fill(&mut t_s, &mut kpa, 1).expect("a gap");
        assert_eq!(note, "Lost frames that were interpolated linearly: 2.");
        for (i, (t_s, kpa)) in t_s.iter().zip(&kpa).enumerate() {
            assert!((t_s - i as f64 * 0.01).abs() < 1e-12 && (kpa - i as f32 * 10.0).abs() < 1e-4);
        }
        assert_eq!(t_s.len(), 6);
    }

    /// As numbers in double precision, 1.1 and 1 differ by slightly more than 0.1.
    #[test]
    fn the_longest_gap_is_filled_although_the_times_are_rounded() {
        for lost in [9, 10] {
            let frames = || (0..300u16).filter(|i| !(101..101 + lost).contains(i));
            let mut t_s: Vec<f64> = frames().map(|i| f64::from(i) / 100.0).collect();
            let mut kpa: Vec<f32> = frames().map(f32::from).collect();
            let note = fill(&mut t_s, &mut kpa, 1).expect("a gap");
            let is_filled = note == "Lost frames that were interpolated linearly: 9.";
            assert_eq!((t_s.len(), is_filled), if lost == 9 { (300, true) } else { (189, false) }, "{note}");
        }
    }

    /// As numbers in double precision, 1.001 and 1 differ by slightly less than 0.001.
    #[test]
    fn a_gap_at_1000_hz_is_filled_although_the_times_are_rounded() {
        let frames = || (0..10u16).filter(|i| *i != 5);
        let mut t_s: Vec<f64> = frames().map(|i| 1.0 + 1e-3 * f64::from(i)).collect();
        let mut kpa: Vec<f32> = frames().map(f32::from).collect();
        assert!(median_interval_s(&t_s).is_some_and(|median_s| median_s < 1e-3));
        let note = fill(&mut t_s, &mut kpa, 1).expect("a gap");
        assert_eq!(note, "Lost frames that were interpolated linearly: 1.");
        assert!((t_s[5] - 1.005).abs() < 1e-9 && (kpa[5] - 5.0).abs() < 1e-4, "{} s, {} kPa", t_s[5], kpa[5]);
    }

    #[test]
    fn after_a_long_gap_only_the_longest_part_remains() {
        let mut t_s: Vec<f64> = (0..10).map(|i| 0.01 * f64::from(i)).collect();
        t_s.extend((0..20).map(|i| 1.0 + 0.01 * f64::from(i)));
        let mut kpa: Vec<f32> = (0..60).map(|i| i as f32).collect();
        let note = fill(&mut t_s, &mut kpa, 2).expect("a gap");
        assert!(note.contains("left out: 10"), "{note}");
        assert_eq!((t_s.len(), t_s[0], kpa[0], kpa.len()), (20, 1.0, 20.0, 40));
    }

    #[test]
    fn the_other_parts_are_listed_with_their_times() {
        let at_20_hz = |start_s: f64, frames: u16| (0..frames).map(move |i| start_s + 0.05 * f64::from(i));
        let mut t_s: Vec<f64> = at_20_hz(0.0, 31).chain(at_20_hz(2.0, 41)).chain([5.0, 5.05]).collect();
        let mut kpa = vec![0.0; t_s.len()];
        let note = fill(&mut t_s, &mut kpa, 1).expect("a gap");
        assert!(note.contains("imported, 2 to 4 s. Frames that were left out: 33."), "{note}");
        // The last part is too short for a step.
        assert!(note.ends_with("With --from and --to, the other part can be imported: 0 to 1.5 s."), "{note}");
    }

    #[test]
    fn the_frames_after_filling_are_counted_in_advance() {
        for t_s in [
            vec![0.0, 0.01, 0.04, 0.05],
            vec![0.0, 0.01, 0.02, 1.0, 1.01, 1.03, 1.04],
            vec![0.0, 0.011, 0.02, 0.031],
            vec![0.0, 1e-73, 2e-73, 0.01],
            vec![],
        ] {
            let (mut filled_s, mut kpa) = (t_s.clone(), vec![1.0; t_s.len()]);
            fill(&mut filled_s, &mut kpa, 1);
            assert_eq!(frames_after_fill(&t_s), filled_s.len(), "{t_s:?}");
        }
    }

    /// Without the limit, the gap would be filled with 1e71 frames.
    #[test]
    fn gaps_between_implausibly_close_times_are_not_filled() {
        let mut t_s = vec![0.0, 1e-73, 2e-73, 0.01];
        assert_eq!(fill(&mut t_s, &mut vec![1.0; 4], 1), None);
        assert_eq!(t_s.len(), 4);
    }

    #[test]
    fn frames_without_gaps_are_unchanged() {
        let (mut t_s, mut kpa) = (vec![0.0, 0.011, 0.02, 0.031], vec![1.0; 4]);
        assert_eq!(fill(&mut t_s, &mut kpa, 1), None);
        assert_eq!(t_s, [0.0, 0.011, 0.02, 0.031]);
        assert_eq!(fill(&mut vec![], &mut vec![], 1), None);
    }
}

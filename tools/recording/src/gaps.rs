//! Frames that a system lost on the way. A recording has none: short gaps are filled, and a long one ends it.

/// Longest gap that is filled by interpolation, s. A heel strike takes about this time, so that a longer gap may hide the
/// beginning of a step.
const LONGEST_FILLED_S: f64 = 0.1;
/// An interval of more than this number of median intervals has lost frames.
const LOST: f64 = 1.5;

/// Fills gaps of up to [`LONGEST_FILLED_S`] linearly. After a longer gap, the load is unknown: only the longest part without one
/// remains. `kpa` has the same number of cells for each time. Returns a sentence about what was filled or left out.
///
/// Times that do not increase are left as they are; [`crate::rate::of`] refuses them.
pub fn fill(t_s: &mut Vec<f64>, kpa: &mut Vec<f32>, cells: usize) -> Option<String> {
    let mut intervals_s: Vec<f64> = t_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let middle = intervals_s.len().checked_sub(1)? / 2;
    let (_, &mut period_s, _) = intervals_s.select_nth_unstable_by(middle, f64::total_cmp);
    let is_gap = |before_s: f64, after_s: f64| after_s - before_s > LOST * period_s;
    if period_s <= 0.0 || !t_s.windows(2).any(|pair| is_gap(pair[0], pair[1])) {
        return None;
    }
    let part = longest_part(t_s, LONGEST_FILLED_S.max(LOST * period_s));
    let left_out = t_s.len() - part.len();
    let (old_s, old_kpa) = (t_s[part.clone()].to_vec(), kpa[part.start * cells..part.end * cells].to_vec());
    let mut filled = 0;
    t_s.clear();
    kpa.clear();
    for (i, &now_s) in old_s.iter().enumerate() {
        let frame = |i: usize| &old_kpa[i * cells..(i + 1) * cells];
        if let Some(before_s) = i.checked_sub(1).map(|before| old_s[before])
            && is_gap(before_s, now_s)
        {
            let intervals = ((now_s - before_s) / period_s).round().max(2.0) as usize;
            filled += intervals - 1;
            for k in 1..intervals {
                let share = k as f64 / intervals as f64;
                t_s.push(before_s + share * (now_s - before_s));
                kpa.extend(frame(i - 1).iter().zip(frame(i)).map(|(a, b)| a + (b - a) * share as f32));
            }
        }
        t_s.push(now_s);
        kpa.extend(frame(i));
    }
    let mut note = format!("{filled} lost frames were filled linearly.");
    if left_out > 0 {
        note += &format!(
            " Frames are missing for more than {LONGEST_FILLED_S} s: only the longest part without such a gap \
             was imported, and {left_out} frames were left out."
        );
    }
    Some(note)
}

/// The longest range of times without an interval of more than `most_s`.
fn longest_part(t_s: &[f64], most_s: f64) -> std::ops::Range<usize> {
    let (mut longest, mut start) = (0..0, 0);
    for i in 0..t_s.len() {
        if i > 0 && t_s[i] - t_s[i - 1] > most_s {
            start = i;
        }
        if i + 1 - start > longest.len() {
            longest = start..i + 1;
        }
    }
    longest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_gap_is_filled_on_the_line_between_its_neighbours() {
        let (mut t_s, mut kpa) = (vec![0.0, 0.01, 0.04, 0.05], vec![0.0, 10.0, 40.0, 50.0]);
        let note = fill(&mut t_s, &mut kpa, 1).expect("a gap");
        assert!(note.starts_with("2 lost frames"), "{note}");
        for (i, (t_s, kpa)) in t_s.iter().zip(&kpa).enumerate() {
            assert!((t_s - i as f64 * 0.01).abs() < 1e-12 && (kpa - i as f32 * 10.0).abs() < 1e-4);
        }
        assert_eq!(t_s.len(), 6);
    }

    #[test]
    fn after_a_long_gap_only_the_longest_part_remains() {
        let mut t_s: Vec<f64> = (0..10).map(|i| 0.01 * f64::from(i)).collect();
        t_s.extend((0..20).map(|i| 1.0 + 0.01 * f64::from(i)));
        let mut kpa: Vec<f32> = (0..60).map(|i| i as f32).collect();
        let note = fill(&mut t_s, &mut kpa, 2).expect("a gap");
        assert!(note.contains("10 frames were left out"), "{note}");
        assert_eq!((t_s.len(), t_s[0], kpa[0], kpa.len()), (20, 1.0, 20.0, 40));
    }

    #[test]
    fn frames_without_gaps_are_unchanged() {
        let (mut t_s, mut kpa) = (vec![0.0, 0.011, 0.02, 0.031], vec![1.0; 4]);
        assert_eq!(fill(&mut t_s, &mut kpa, 1), None);
        assert_eq!(t_s, [0.0, 0.011, 0.02, 0.031]);
        assert_eq!(fill(&mut vec![], &mut vec![], 1), None);
    }
}

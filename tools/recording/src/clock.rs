//! The clock of an export that numbers its frames and states the time of day of each.

/// Largest difference between the stated times and a uniform clock, s: for times with fractions of a second, and for whole
/// seconds, which are rounded down by up to one second.
const LARGEST_RESIDUAL_S: [f64; 2] = [0.1, 1.1];
/// Least number of frames at which the second changes, if no time has a fraction. The first and the last of them are at least 4 s
/// apart, so that the period is exact to one frame in 4 s.
const LEAST_CHANGES: usize = 5;
/// Seconds of a day.
const DAY_S: f64 = 86_400.0;

/// The time of day in `text`, s: hours, minutes and seconds, such as `08:21:17.982` or `8:21:17 PM`, or a number of seconds.
/// `None` if it is none of these.
pub fn time_of_day_s(text: &str) -> Option<f64> {
    let upper = text.trim().to_uppercase();
    let (digits, is_afternoon) = match upper.strip_suffix("PM").or_else(|| upper.strip_suffix("P.M.")) {
        Some(digits) => (digits, Some(true)),
        None => match upper.strip_suffix("AM").or_else(|| upper.strip_suffix("A.M.")) {
            Some(digits) => (digits, Some(false)),
            None => (upper.as_str(), None),
        },
    };
    let parts: Vec<&str> = digits.trim().split(':').collect();
    if !matches!(parts.len(), 1 | 3) {
        return None;
    }
    let mut seconds = 0.0;
    for part in parts {
        let value = crate::text::parse_number(part)?;
        seconds = seconds * 60.0 + value;
    }
    Some(match is_afternoon {
        Some(true) if seconds < DAY_S / 2.0 => seconds + DAY_S / 2.0,
        Some(false) if seconds >= DAY_S / 2.0 => seconds - DAY_S / 2.0,
        _ => seconds,
    })
}

/// The times of frames, s from the first one. `stated_s` are their times of day, s, and `numbers` the numbers of those frames
/// that have one.
///
/// Times of day come from the clock of a computer: they jitter, and some programs state whole seconds. If every frame has a
/// number, the numbers increase, and the times are near a straight line over them, the frames are on this line. Otherwise the
/// stated times are returned. They are also returned if they are whole seconds that change fewer than [`LEAST_CHANGES`] times:
/// such times repeat, and the importer refuses them.
pub fn times_s(numbers: &[u64], stated_s: &[f64]) -> Vec<f64> {
    let mut passed_s = Vec::with_capacity(stated_s.len());
    let mut days_s = 0.0;
    for (i, &now_s) in stated_s.iter().enumerate() {
        if i > 0 && now_s < stated_s[i - 1] - DAY_S / 2.0 {
            days_s += DAY_S;
        }
        passed_s.push(now_s + days_s - stated_s[0]);
    }
    let is_numbered = numbers.len() == passed_s.len() && numbers.windows(2).all(|pair| pair[0] < pair[1]);
    if !is_numbered || numbers.len() < 3 {
        return passed_s;
    }
    let count = |i: usize| (numbers[i] - numbers[0]) as f64;
    let is_fractional = stated_s.iter().any(|time_s| time_s.fract() != 0.0);
    let line = match is_fractional {
        true => Some(least_squares(numbers, &passed_s)),
        false => through_changes(numbers, &passed_s),
    };
    let Some((period_s, first_s)) = line else { return passed_s };
    let largest_s = LARGEST_RESIDUAL_S[usize::from(!is_fractional)];
    let is_uniform =
        (passed_s.iter().enumerate()).all(|(i, time_s)| (time_s - first_s - period_s * count(i)).abs() <= largest_s);
    if !is_uniform || period_s <= 0.0 {
        return passed_s;
    }
    (0..numbers.len()).map(|i| period_s * count(i)).collect()
}

/// The period, s, and the time of the first frame, s, of the line of least squares through the times.
fn least_squares(numbers: &[u64], passed_s: &[f64]) -> (f64, f64) {
    let n = numbers.len() as f64;
    let count = |i: usize| (numbers[i] - numbers[0]) as f64;
    let mean_count = (0..numbers.len()).map(count).sum::<f64>() / n;
    let mean_s = passed_s.iter().sum::<f64>() / n;
    let (mut product, mut square) = (0.0, 0.0);
    for (i, time_s) in passed_s.iter().enumerate() {
        product += (count(i) - mean_count) * (time_s - mean_s);
        square += (count(i) - mean_count).powi(2);
    }
    let period_s = product / square;
    (period_s, mean_s - period_s * mean_count)
}

/// As [`least_squares`], from whole seconds: the line through the first and the last frame at which the second changes. `None` if
/// it changes too rarely.
///
/// The rounding of whole seconds is a sawtooth, which biases a line of least squares through few seconds. A frame at which the
/// second changes is less than one period later than the change, so that the error of the period is less than one period in the
/// frames between the two changes. After missing frames, the change may be earlier: it is not used.
fn through_changes(numbers: &[u64], passed_s: &[f64]) -> Option<(f64, f64)> {
    // An export can have every second frame only.
    let interval = numbers.windows(2).map(|pair| pair[1] - pair[0]).min().unwrap_or(1);
    let is_change = |i: &usize| numbers[*i] - numbers[*i - 1] == interval && passed_s[*i] > passed_s[*i - 1];
    let changes: Vec<usize> = (1..numbers.len()).filter(is_change).collect();
    if changes.len() < LEAST_CHANGES {
        return None;
    }
    let (first, last) = (changes[0], changes[changes.len() - 1]);
    let period_s = (passed_s[last] - passed_s[first]) / (numbers[last] - numbers[first]) as f64;
    Some((period_s, passed_s[first] - period_s * (numbers[first] - numbers[0]) as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_day_are_read_in_both_notations() {
        assert_eq!(time_of_day_s(" 08:21:17.5"), Some(8.0 * 3600.0 + 21.0 * 60.0 + 17.5));
        assert_eq!(time_of_day_s("1:00:02 PM"), Some(13.0 * 3600.0 + 2.0));
        assert_eq!(time_of_day_s("12:00:02 AM"), Some(2.0));
        assert_eq!(time_of_day_s("12.25"), Some(12.25));
        for text in ["noon", "8:21 PM", "1:2:3:4"] {
            assert_eq!(time_of_day_s(text), None, "{text}");
        }
    }

    #[test]
    fn every_second_frame_with_whole_seconds_becomes_a_uniform_clock() {
        let numbers: Vec<u64> = (0..3000).map(|i| 2 * i + 1).collect();
        let uniform = times_s(&numbers, &whole_seconds(20_000, 0, 60));
        for pair in uniform.windows(2) {
            assert!(((pair[1] - pair[0]) / 0.02 - 1.0).abs() < 0.01, "{pair:?}");
        }
    }

    #[test]
    fn jitter_and_whole_seconds_become_a_uniform_clock() {
        let numbers: Vec<u64> = (10..210).collect();
        let jitter: Vec<f64> = (0..200).map(|i| 100.0 + 0.01 * f64::from(i) + 0.004 * f64::from(i % 3)).collect();
        let whole: Vec<f64> = (0..200).map(|i| (100.0 + 0.05 * f64::from(i)).floor()).collect();
        for (stated, period_s) in [(jitter, 0.01), (whole, 0.05)] {
            let uniform = times_s(&numbers, &stated);
            for pair in uniform.windows(2) {
                assert!(((pair[1] - pair[0]) / period_s - 1.0).abs() < 0.01, "{pair:?}");
            }
        }
    }

    /// The times of the frames within `duration_s`, rounded down to whole seconds. The first frame is `phase_us` after a whole
    /// second. The times are computed in integers, because the rounding error of a floating-point number could place a frame in
    /// the second before.
    fn whole_seconds(period_us: u64, phase_us: u64, duration_s: u64) -> Vec<f64> {
        let frames = duration_s * 1_000_000 / period_us;
        (0..frames).map(|i| (100 + (phase_us + i * period_us) / 1_000_000) as f64).collect()
    }

    #[test]
    fn the_period_of_whole_seconds_is_exact_to_a_frame_between_changes() {
        for period_us in [10_000, 9_700, 10_300] {
            for duration_s in [6, 10] {
                for phase_us in [0, 1, 3_000, 250_000, 500_000, 777_777, 999_999] {
                    let stated = whole_seconds(period_us, phase_us, duration_s);
                    let numbers: Vec<u64> = (7..).take(stated.len()).collect();
                    let uniform = times_s(&numbers, &stated);
                    let period_s = period_us as f64 * 1e-6;
                    // The time from the first to the last change is at least the duration minus two seconds.
                    let between = (duration_s - 2) as f64 / period_s - 1.0;
                    for pair in uniform.windows(2) {
                        let error = ((pair[1] - pair[0]) / period_s - 1.0).abs();
                        assert!(error < 1.0 / between, "{period_us} us, {duration_s} s, from {phase_us} us: {error}");
                    }
                }
            }
        }
    }

    #[test]
    fn whole_seconds_that_change_too_rarely_are_left_as_they_are() {
        let stated = whole_seconds(10_000, 500_000, 3);
        let numbers: Vec<u64> = (0..).take(stated.len()).collect();
        let times_s = times_s(&numbers, &stated);
        assert!(times_s.iter().zip(&stated).all(|(time_s, stated_s)| *time_s == stated_s - 100.0));
    }

    /// After missing frames, the second has changed earlier than at the next frame.
    #[test]
    fn a_change_of_the_second_within_a_gap_is_not_used() {
        let stated = whole_seconds(10_000, 500_000, 8);
        let is_present = |i: &usize| !(45..95).contains(i);
        let numbers: Vec<u64> = (0..stated.len()).filter(is_present).map(|i| i as u64).collect();
        let present_s: Vec<f64> = (0..stated.len()).filter(is_present).map(|i| stated[i]).collect();
        let uniform = times_s(&numbers, &present_s);
        assert!(((uniform[1] - uniform[0]) / 0.01 - 1.0).abs() < 1e-9, "{}", uniform[1]);
        assert!((uniform[45] - uniform[44] - 0.51).abs() < 1e-6, "{}", uniform[45] - uniform[44]);
    }

    #[test]
    fn a_missing_number_is_a_gap_and_midnight_is_not() {
        let stated = [86_399.98, 86_399.99, 0.0, 0.03, 0.04];
        let uniform = times_s(&[1, 2, 3, 6, 7], &stated);
        assert!((uniform[3] - uniform[2] - 0.03).abs() < 1e-3, "{uniform:?}");
        assert!((uniform[4] - 0.06).abs() < 1e-3);
    }

    #[test]
    fn a_pause_without_missing_numbers_remains_a_gap() {
        let uniform = times_s(&[1, 2, 3, 4], &[0.01, 0.02, 5.03, 5.04]);
        assert!((uniform[2] - uniform[1] - 5.01).abs() < 1e-9);
    }
}

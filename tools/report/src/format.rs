//! Formatting of numbers and text.

/// Stands for a missing number.
pub const NONE: &str = "–";

/// Three significant digits; with a power of ten for very large and very small numbers.
pub fn number(value: f64) -> String {
    if !value.is_finite() {
        return NONE.into();
    }
    if value == 0.0 {
        return "0".into();
    }
    let rounded = format!("{value:.2e}");
    let (digits, exponent) = rounded.split_once('e').unwrap_or((&rounded, "0"));
    let text = match exponent.parse::<i32>().unwrap_or(0) {
        // The number of decimals, 2 - exponent, is 0 to 5 here.
        exponent @ -3..=2 => format!("{value:.*}", (2 - exponent) as usize),
        3..=5 => format!("{:.0}", rounded.parse().unwrap_or(value)),
        _ => format!("{digits}\u{a0}×\u{a0}10{}", superscript(exponent)),
    };
    text.replace('-', "−")
}

fn superscript(exponent: &str) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    exponent.chars().map(|c| c.to_digit(10).map_or('⁻', |digit| DIGITS[digit as usize])).collect()
}

/// A round number for an axis: with a power of ten from 10 000 on and below 0.001.
pub fn round_number(value: f64) -> String {
    // Ticks are multiples of a step, and thus have rounding errors.
    let trimmed = |value: f64| format!("{value:.4}").trim_end_matches('0').trim_end_matches('.').replace('-', "−");
    let exponent = value.abs().log10().floor() as i32;
    if value == 0.0 || (-3..4).contains(&exponent) {
        return trimmed(value);
    }
    let factor = match trimmed(value / 10f64.powi(exponent)) {
        one if one == "1" => String::new(),
        factor => factor + "·",
    };
    format!("{factor}10{}", superscript(&exponent.to_string()))
}

/// A fraction in percent with one decimal, without the sign %.
pub fn percent(share: f64) -> String {
    if share.is_finite() { format!("{:.1}", share * 100.0) } else { NONE.into() }
}

/// As [`percent`], with a plus sign for positive numbers.
pub fn signed_percent(share: f64) -> String {
    if share.is_finite() { format!("{:+.1}", share * 100.0).replace('-', "−") } else { NONE.into() }
}

/// A count with its noun in singular or plural: `1 step`, `2 steps`.
pub fn count(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// Breaks text between words into lines of at most `most` characters; a longer word has a line of its own.
pub fn lines(text: &str, most: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) if line.chars().count() + 1 + word.chars().count() <= most => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.into()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_any_size_have_three_significant_digits() {
        let cases = [
            (0.0, "0"),
            (0.001234, "0.00123"),
            (0.9996, "1.00"),
            (-12.34, "−12.3"),
            (999.6, "1000"),
            (123_456.0, "123000"),
            (5.314e7, "5.31\u{a0}×\u{a0}10⁷"),
            (2e-5, "2.00\u{a0}×\u{a0}10⁻⁵"),
            (f64::NAN, NONE),
        ];
        for (value, text) in cases {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn round_numbers_are_short() {
        let cases = [
            (0.0, "0"),
            (0.25, "0.25"),
            (-0.5, "−0.5"),
            (5000.0, "5000"),
            (1e5, "10⁵"),
            (2e7, "2·10⁷"),
            (1e-4, "10⁻⁴"),
        ];
        for (value, text) in cases {
            assert_eq!(round_number(value), text);
        }
    }

    #[test]
    fn lines_break_between_words() {
        assert_eq!(lines("never loaded: no cell", 12), ["never", "loaded: no", "cell"].map(String::from));
        assert_eq!(lines("", 5), [""]);
    }
}

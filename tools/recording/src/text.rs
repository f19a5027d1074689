//! Text in the encodings that vendors' programs write, and numbers in it.

use crate::table::at_line;
use crate::{Error, Result};
use plantar::Side;
use std::path::Path;

/// Decodes a file in UTF-8, in UTF-16 with a byte-order mark, or else in Latin-1. The text has no byte-order mark, and its
/// lines end with `\n`.
///
/// # Errors
/// Fails if the file is empty or is not text.
pub fn decode(bytes: &[u8], path: &Path) -> Result<String> {
    let utf16 = |rest: &[u8], unit: fn([u8; 2]) -> u16| {
        let units = rest.as_chunks().0.iter().map(|&pair| unit(pair));
        char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
    };
    let compressed = match bytes {
        [0x1f, 0x8b, ..] => Some("compressed by gzip"),
        [b'P', b'K', 3, 4, ..] => Some("a zip archive or a workbook (.xlsx)"),
        _ => None,
    };
    if let Some(problem) = compressed {
        return Err(Error::content(
            path.display().to_string(),
            problem,
            "unpack it, and name the text file in it; of a workbook, export the text",
        ));
    }
    let text: String = match bytes {
        [0xff, 0xfe, rest @ ..] => utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => utf16(rest, u16::from_be_bytes),
        [0xef, 0xbb, 0xbf, rest @ ..] => String::from_utf8_lossy(rest).into_owned(),
        _ => match std::str::from_utf8(bytes) {
            Ok(text) => text.to_owned(),
            Err(_) => bytes.iter().copied().map(char::from).collect(),
        },
    };
    if text.trim().is_empty() {
        return Err(Error::content(path.display().to_string(), "the file is empty", "export the measurement again"));
    }
    if let Some(at) = text.find('\0') {
        let line = text[..at].matches('\n').count() as u64 + 1;
        return Err(Error::content(
            at_line(path, line),
            "not text: a byte is zero",
            "name the text file that the vendor's program exports, not its own recording",
        ));
    }
    let mut text = text.replace("\r\n", "\n");
    if !text.contains('\n') {
        // Old programs end lines with a carriage return alone.
        text = text.replace('\r', "\n");
    }
    if !text.ends_with('\n') {
        text.push('\n');
    }
    Ok(text)
}

/// The rest of a line that begins with `name`. Blanks before the name and capitals do not matter.
pub fn strip_name<'a>(row: &'a str, name: &str) -> Option<&'a str> {
    let (start, rest) = row.trim_start().split_at_checked(name.len())?;
    start.eq_ignore_ascii_case(name).then_some(rest)
}

/// The date and the time in the line with the name of the file in a header of novel's programs, such as `file name: a.sol
/// date/time 25.04.23 10.49`; `None` if it has none.
pub fn novel_time(row: &str) -> Option<&str> {
    let (_, time) = strip_name(row, "file name:")?.split_once("date/time")?;
    Some(time.trim_matches([' ', '\t', ':'])).filter(|time| !time.is_empty())
}

/// Parses a finite number with a decimal point or a decimal comma.
pub fn parse_number(field: &str) -> Option<f64> {
    let field = field.trim();
    let value = field.parse().or_else(|_| match field.contains('.') {
        false => field.replacen(',', ".", 1).parse(),
        true => field.parse(),
    });
    value.ok().filter(|value: &f64| value.is_finite())
}

/// As [`parse_number`], for a field that must be a number. Messages begin with `place` and name `what`.
pub fn number(field: &str, what: &str, place: &dyn Fn() -> String) -> Result<f64> {
    parse_number(field).ok_or_else(|| {
        Error::content(
            place(),
            format!("{what} is `{}`, expected a number", shortened(field)),
            "export the measurement again, and do not edit the file",
        )
    })
}

/// A text of a file for a message or a name: cut off after 60 characters, and with blanks instead of control characters, which
/// would have an effect on the terminal on which the text is printed.
pub fn shortened(text: &str) -> String {
    const LONGEST: usize = 60;
    let (shown, end) = match text.char_indices().nth(LONGEST) {
        Some((end, _)) => (&text[..end], "..."),
        None => (text, ""),
    };
    shown.replace(char::is_control, " ") + end
}

/// A number for a message, with at least three significant digits; very small and very large ones in scientific notation.
pub fn significant(value: f64) -> String {
    match (1e-3..1e6).contains(&value.abs()) {
        true => format!("{value:.*}", (2.0 - value.abs().log10().floor()).max(0.0) as usize),
        false => format!("{value:.2e}"),
    }
}

/// A time for a message, s, rounded to 0.1 ms; very short and very long ones in scientific notation.
pub fn seconds(value_s: f64) -> String {
    match value_s == 0.0 || (1e-3..1e6).contains(&value_s.abs()) {
        true => ((value_s * 1e4).round() / 1e4).to_string(),
        false => format!("{value_s:e}"),
    }
}

/// The first number in a text. A sign before it is ignored.
pub fn first_number(text: &str) -> Option<f64> {
    let start = text.find(|c: char| c.is_ascii_digit())?;
    let rest = &text[start..];
    let end = rest.find(|c: char| !(c.is_ascii_digit() || c == '.' || c == ',')).unwrap_or(rest.len());
    parse_number(rest[..end].trim_end_matches(['.', ',']))
}

/// The foot that the end of a file's name states: L, R, left or right, as a word of its own. In `walkL`, the capital letter
/// is a word of its own; in `normal`, the last letter is not.
pub fn side_of(name: &str) -> Option<Side> {
    let stem = name.rsplit(['\\', '/']).next()?;
    let stem = stem.rsplit_once('.').map_or(stem, |(stem, _)| stem);
    let lower = stem.to_ascii_lowercase();
    let is_word = |word: &str| {
        let Some((before, last)) = stem.len().checked_sub(word.len()).and_then(|at| stem.split_at_checked(at)) else {
            return false;
        };
        let begins_word = |before: char| {
            !before.is_alphabetic() || (before.is_lowercase() && last.starts_with(|first: char| first.is_uppercase()))
        };
        lower.ends_with(word) && before.chars().next_back().is_none_or(begins_word)
    };
    let words = [("left", Side::Left), ("right", Side::Right), ("l", Side::Left), ("r", Side::Right)];
    words.into_iter().find(|(word, _)| is_word(word)).map(|(_, side)| side)
}

//! Detection of thousands separators in pressures and forces.
//!
//! `1,028` is 1028 if the comma separates thousands, and 1.028 if it is a decimal comma. The number alone does not show which,
//! but the other numbers of the table do: see [`Separators`].

use crate::table::at_line;
use crate::{Error, Result};
use std::path::Path;

/// The separators in all pressures or forces of a file. They separate thousands if both conditions hold:
///
/// - Every number with a separator has one to three digits before it, the first of which is not 0, and exactly three after it.
/// - At least one other number is a whole number from 100 to 999.
///
/// A program that writes three decimals writes them in every number, or writes numbers below 1, which begin with 0.
#[derive(Default)]
pub struct Separators {
    /// The first number with a separator, and its line.
    first: Option<(String, u64)>,
    has_decimals: bool,
    has_hundreds: bool,
}

impl Separators {
    /// Adds a number of the file. Text that is not a number has no effect.
    pub fn add(&mut self, field: &str, line: u64) {
        if self.has_decimals {
            return;
        }
        let is_whole = |digits: &str| !digits.starts_with('0') && digits.bytes().all(|byte| byte.is_ascii_digit());
        let stated = field.trim();
        let field = stated.strip_prefix(['-', '+']).unwrap_or(stated);
        match field.split_once(['.', ',']) {
            None => self.has_hundreds |= field.len() == 3 && is_whole(field),
            Some((before, after)) => {
                let is_group = (1..=3).contains(&before.len())
                    && is_whole(before)
                    && after.len() == 3
                    && after.bytes().all(|byte| byte.is_ascii_digit());
                self.has_decimals = !is_group;
                self.first.get_or_insert_with(|| (stated.to_owned(), line));
            }
        }
    }

    /// Checks that the separators do not separate thousands.
    pub fn check(&self, path: &Path) -> Result<()> {
        match &self.first {
            Some((field, line)) if !self.has_decimals && self.has_hundreds => Err(Error::content(
                at_line(path, *line),
                format!(
                    "the separator in `{field}` seems to separate thousands: other numbers are whole, and every separator is \
                     followed by three digits"
                ),
                "export the measurement without thousands separators, or with decimals in all numbers",
            )),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_separators_among_whole_numbers_separate_thousands() {
        let is_refused = |fields: &[&str]| {
            let mut separators = Separators::default();
            fields.iter().for_each(|field| separators.add(field, 1));
            separators.check(Path::new("walk.asc")).is_err()
        };
        assert!(is_refused(&["0", "17", "999", "1,028"]));
        assert!(is_refused(&["1.028", "B", "250"]));
        assert!(is_refused(&["-1,028", "999", "1,028"]));
        // Three decimals in all numbers, in a number below 1, or another number of decimals.
        assert!(!is_refused(&["0.000", "1.028", "12.000"]));
        assert!(!is_refused(&["0", "250", "1.028", "0.125"]));
        assert!(!is_refused(&["0", "250", "1.028", "2.5"]));
        // Without a whole number from 100 to 999, the separators may be decimal ones.
        assert!(!is_refused(&["0", "7", "1.028"]));
        assert!(!is_refused(&["100", "999"]));
    }
}

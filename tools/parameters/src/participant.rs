//! Data of a participant of a study.

use crate::{Error, InsoleSize, message};
use serde::{Deserialize, Deserializer, de};
use std::fmt;
use std::ops::RangeInclusive;
use std::path::{Component, Path, PathBuf};
use toml::Value;

/// The content of a `participant.toml`. All entries are optional.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Participant {
    /// European shoe size.
    #[serde(default, deserialize_with = "size")]
    pub size: Option<InsoleSize>,
    /// Age, 1 to 120 years.
    #[serde(default, deserialize_with = "age_years")]
    pub age_years: Option<f64>,
    /// Sex: `female`, `male` or `other`.
    #[serde(default, deserialize_with = "sex")]
    pub sex: Option<Sex>,
    /// Body mass, 10 to 300 kg.
    #[serde(default, deserialize_with = "mass_kg")]
    pub mass_kg: Option<f64>,
    /// Body height, 50 to 250 cm.
    #[serde(default, deserialize_with = "height_cm")]
    pub height_cm: Option<f64>,
    /// Path of the file with the zeros (unloaded readings) of the insoles, as `plantar zero` writes it.
    #[serde(default, deserialize_with = "file")]
    pub zero: Option<PathBuf>,
    /// Path of the file with measurements of the tissue; see [`crate::TissueMeasurements`]. The entry is named `tissue`, like the
    /// option `--tissue`, or `thickness`, as earlier.
    #[serde(alias = "thickness", default, deserialize_with = "file")]
    pub tissue: Option<PathBuf>,
}

/// Sex of a participant, as in Table 1 of the paper (DeBerardinis et al. 2019), with a third value for everyone whom the first
/// two do not describe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sex {
    /// Female.
    Female,
    /// Male.
    Male,
    /// Neither of the two.
    Other,
}

impl Sex {
    /// All values.
    pub const ALL: [Self; 3] = [Self::Female, Self::Male, Self::Other];

    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Female => "female",
            Self::Male => "male",
            Self::Other => "other",
        }
    }
}

impl fmt::Display for Sex {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Participant {
    /// Reads a file and checks all values. Paths in the file are relative to its folder.
    ///
    /// # Errors
    /// If the file cannot be read, is not TOML of this form, or a value is out of range.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::Io(path.into(), e))?;
        Self::parse(&text, path)
    }

    /// As [`Participant::read`], from text. Messages name `path`, and paths in the text are relative to its folder.
    ///
    /// # Errors
    /// As [`Participant::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let form = |e| Error::Form { file: path.into(), problem: message(&e) };
        let mut participant: Self = toml::from_str(text).map_err(form)?;
        for file in [&mut participant.zero, &mut participant.tissue].into_iter().flatten() {
            *file = path.with_file_name(&file);
        }
        Ok(participant)
    }
}

/// The text of a value in a message; for a list or a table, only its type.
fn in_words(value: &Value) -> String {
    match value {
        Value::String(text) => format!("{text:?}"),
        Value::Integer(number) => number.to_string(),
        Value::Float(number) => number.to_string(),
        Value::Boolean(flag) => flag.to_string(),
        Value::Datetime(time) => time.to_string(),
        Value::Array(_) => "a list".into(),
        Value::Table(_) => "a table".into(),
    }
}

fn size<'de, D: Deserializer<'de>>(from: D) -> Result<Option<InsoleSize>, D::Error> {
    let text = in_words(&Value::deserialize(from)?);
    text.parse().map(Some).map_err(|problem| de::Error::custom(format!("size = {problem}")))
}

fn age_years<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
    within(from, "age_years", "the age of the person in years", 1.0..=120.0)
}

fn mass_kg<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
    within(from, "mass_kg", "the mass of the person in kg", 10.0..=300.0)
}

fn height_cm<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
    within(from, "height_cm", "the height of the person in cm", 50.0..=250.0)
}

/// A number within a range. The message of the error names the key, the value and the range.
fn within<'de, D: Deserializer<'de>>(
    from: D,
    key: &str,
    meaning: &str,
    range: RangeInclusive<f64>,
) -> Result<Option<f64>, D::Error> {
    let value = Value::deserialize(from)?;
    let number = value.as_float().or(value.as_integer().map(|number| number as f64));
    number.filter(|number| range.contains(number)).map(Some).ok_or_else(|| {
        let (low, high) = (range.start(), range.end());
        de::Error::custom(format!("{key} = {}: expected {meaning}, {low} to {high}", in_words(&value)))
    })
}

fn sex<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Sex>, D::Error> {
    let value = Value::deserialize(from)?;
    let known = Sex::ALL.into_iter().find(|sex| value.as_str() == Some(sex.name()));
    known.map(Some).ok_or_else(|| {
        let value = in_words(&value);
        de::Error::custom(format!("sex = {value}: expected the sex of the person, \"female\", \"male\" or \"other\""))
    })
}

fn file<'de, D: Deserializer<'de>>(from: D) -> Result<Option<PathBuf>, D::Error> {
    let value = Value::deserialize(from)?;
    // The path is printed in messages. A study folder from elsewhere must not lead to a device or to another computer: on
    // Windows, a path such as `\\server\file` would send this user's credentials there.
    let path = value.as_str().filter(|path| !path.contains(char::is_control)).map(PathBuf::from);
    let is_relative =
        |path: &PathBuf| !path.has_root() && !matches!(path.components().next(), Some(Component::Prefix(_)));
    path.filter(is_relative).map(Some).ok_or_else(|| {
        let value = in_words(&value);
        de::Error::custom(format!(
            "{value}: expected the path of a file, relative to the folder of this file, in quotation marks"
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Participant, String> {
        Participant::parse(text, Path::new("study/ann/participant.toml")).map_err(|error| error.to_string())
    }

    #[test]
    fn all_entries_are_read_and_optional() {
        let text = "size = 37\nage_years = 24.5\nsex = 'female'\nmass_kg = 55\nheight_cm = 158.5\nzero = 'zero.toml'\n\
                    thickness = '../tissue.toml'";
        let found = parse(text).expect("valid");
        assert_eq!((found.age_years, found.sex), (Some(24.5), Some(Sex::Female)));
        assert_eq!((found.mass_kg, found.height_cm), (Some(55.0), Some(158.5)));
        assert_eq!(found.zero.as_deref(), Some(Path::new("study/ann/zero.toml")));
        assert_eq!(found.tissue.as_deref(), Some(Path::new("study/ann/../tissue.toml")));
        assert_eq!(found.size.map(InsoleSize::eur), Some(37));
        assert_eq!(parse(""), Ok(Participant::default()));
    }

    #[test]
    fn the_file_with_measurements_of_the_tissue_has_two_names() {
        let [tissue, thickness] = ["tissue", "thickness"].map(|name| parse(&format!("{name} = 'ann.toml'")));
        assert_eq!(tissue.as_ref().expect("valid").tissue.as_deref(), Some(Path::new("study/ann/ann.toml")));
        assert_eq!(tissue, thickness);
        let both = parse("tissue = 'a.toml'\nthickness = 'b.toml'").expect_err("two files");
        assert!(both.contains("duplicate"), "{both}");
    }

    #[test]
    fn errors_name_the_file_the_value_and_the_accepted_values() {
        for (text, words) in [
            ("age_years = 0", ["age_years = 0", "1 to 120"]),
            ("age_years = 121", ["age_years = 121", "1 to 120"]),
            ("mass_kg = nan", ["mass_kg = NaN", "10 to 300"]),
            ("height_cm = 1.66", ["height_cm = 1.66", "cm, 50 to 250"]),
            ("sex = 'F'", ["sex = \"F\"", "\"female\", \"male\" or \"other\""]),
            ("size = 19", ["size = 19", "a European shoe size is required, a whole number from 20 to 52"]),
            ("size = 41.5", ["size = 41.5", "a European shoe size is required, a whole number from 20 to 52"]),
            ("size = 'M'", ["size = \"M\"", "a European shoe size is required, a whole number from 20 to 52"]),
            ("age_years = 'old'", ["age_years = \"old\"", "1 to 120"]),
            ("mass_kg = true", ["mass_kg = true", "10 to 300"]),
            ("sex = 1", ["sex = 1", "\"female\", \"male\" or \"other\""]),
            ("zero = 3", ["zero = 3", "3: expected the path of a file"]),
            ("zero = '/dev/zero'", ["/dev/zero", "relative to the folder of this file"]),
            ("zero = '\u{1b}'", ["line 1", "zero"]),
            ("zero = \"\\u001b\"", ["line 1", "\\u{1b}\": expected the path of a file"]),
            ("\"\\u001b[2J\" = 1", ["line 1", "unknown field ` [2J`"]),
            ("thickness = [17]", ["thickness = [17]", "a list: expected the path of a file"]),
        ] {
            let message = parse(text).expect_err(text);
            assert!(message.starts_with("study/ann/participant.toml: "), "{message}");
            assert!(words.iter().all(|words| message.contains(words)), "{words:?}: {message}");
            assert!(!message.contains("invalid type"), "{message}");
        }
    }
}

//! Data of a participant of a study.

use crate::{Error, InsoleSize};
use serde::{Deserialize, Deserializer, de};
use std::path::{Path, PathBuf};

/// The content of a `participant.toml`. All entries are optional.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Participant {
    /// European shoe size.
    pub size: Option<InsoleSize>,
    /// Body mass, 10 to 300 kg.
    #[serde(default, deserialize_with = "mass_kg")]
    pub mass_kg: Option<f64>,
    /// Path of the file with the baselines (unloaded readings) of the insoles, as `plantar zero` writes it.
    pub zero: Option<PathBuf>,
    /// Path of the file with the measured tissue thickness.
    pub thickness: Option<PathBuf>,
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
        let mut participant: Self = toml::from_str(text)
            .map_err(|e| Error::Form { file: path.into(), problem: e.to_string().trim_end().into() })?;
        for file in [&mut participant.zero, &mut participant.thickness].into_iter().flatten() {
            *file = path.with_file_name(&file);
        }
        Ok(participant)
    }
}

fn mass_kg<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
    match f64::deserialize(from)? {
        kg if (10.0..=300.0).contains(&kg) => Ok(Some(kg)),
        kg => Err(de::Error::custom(format!("mass_kg = {kg}: expected the mass of the person in kg, 10 to 300"))),
    }
}

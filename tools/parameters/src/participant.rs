//! What is known of a person who takes part in a study.

use crate::{Error, InsoleSize};
use serde::{Deserialize, Deserializer, de};
use std::path::{Path, PathBuf};

/// A `participant.toml`; every line of it may be missing.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Participant {
    /// Shoe size.
    pub size: Option<InsoleSize>,
    /// Body mass, kg.
    #[serde(default, deserialize_with = "mass_kg")]
    pub mass_kg: Option<f64>,
    /// What their unloaded cells read, a file.
    pub zero: Option<PathBuf>,
    /// Their measured tissue thickness, a file.
    pub thickness: Option<PathBuf>,
}

impl Participant {
    /// Reads a file and checks every value. Paths in it are relative to it.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::Io(path.into(), e))?;
        Self::parse(&text, path)
    }

    /// As [`Participant::read`], from text; `path` is for messages and for paths in it.
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
        kg => Err(de::Error::custom(format!("{kg}: the person's mass in kg, 10 to 300, is needed"))),
    }
}

//! The figures of a run. They are printed as they are measured, and written to a file as one JSON object with a number for each
//! key.

use anyhow::{Context, Result};
use serde_json::{Map, Value};
use std::path::Path;

/// The figures of a run, in the order in which they were measured.
#[derive(Default)]
pub struct Figures(Map<String, Value>);

impl Figures {
    /// Adds a figure and prints it with its meaning.
    pub fn add(&mut self, key: &str, value: impl Into<Value>, meaning: &str) {
        let value = value.into();
        println!("{key:<28} {:>14}  {meaning}", value.to_string());
        self.0.insert(key.into(), value);
    }

    /// Writes all figures as JSON.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(&self.0)? + "\n";
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
    }
}

/// Raises `worst` to `value`. `f64::max` would ignore NaN, which is therefore replaced by the largest number.
pub fn raise(worst: &mut f64, value: f64) {
    *worst = f64::max(*worst, if value.is_nan() { f64::MAX } else { value });
}

//! Figures of a run: printed as they are measured, and written to a file as one flat object.

use anyhow::{Context, Result};
use serde_json::{Map, Value};
use std::path::Path;

/// What was measured, in the order of printing.
#[derive(Default)]
pub struct Figures(Map<String, Value>);

impl Figures {
    /// Prints and keeps a figure.
    pub fn add(&mut self, key: &str, value: impl Into<Value>, meaning: &str) {
        let value = value.into();
        println!("{key:<28} {:>14}  {meaning}", value.to_string());
        self.0.insert(key.into(), value);
    }

    /// Writes all of them as JSON.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(&self.0)? + "\n";
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
    }
}

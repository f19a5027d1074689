//! The measured tissue thickness of a person.

use crate::Error;
use plantar::Region;
use std::collections::BTreeMap;
use std::path::Path;

/// Accepted thickness of the tissue under a foot, mm.
const THICKNESS_MM: std::ops::RangeInclusive<f64> = 2.0..=40.0;

/// Thickness of the unloaded tissue in some or all regions: a TOML file with one line for each region, in mm, such as
/// `heel = 17.5`.
#[derive(Clone, Debug, PartialEq)]
pub struct Thickness([Option<f64>; 8]);

impl Thickness {
    /// Reads a file and checks all values.
    ///
    /// # Errors
    /// If the file cannot be read, is not TOML of this form, names an unknown region, or a thickness is not 2 to 40 mm.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::Io(path.into(), e))?;
        Self::parse(&text, path)
    }

    /// As [`Thickness::read`], from text; messages name `path`.
    ///
    /// # Errors
    /// As [`Thickness::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let form = |problem: String| Error::Form { file: path.into(), problem };
        let lines: BTreeMap<String, f64> = toml::from_str(text).map_err(|e| form(e.to_string().trim_end().into()))?;
        let mut thickness = Self([None; 8]);
        for (name, mm) in lines {
            let Some(region) = Region::from_name(&name) else {
                let names: Vec<_> = Region::ALL.iter().map(|r| r.name()).collect();
                return Err(form(format!("{name} is not a region; the regions are {}", names.join(", "))));
            };
            if !THICKNESS_MM.contains(&mm) {
                let (least, most) = (THICKNESS_MM.start(), THICKNESS_MM.end());
                return Err(form(format!("{name} = {mm}: expected a thickness in mm, {least} to {most}")));
            }
            thickness.0[region as usize] = Some(mm * 1e-3);
        }
        Ok(thickness)
    }

    /// Replaces the values in `thickness_m` (m, in the order of [`Region::ALL`]) by the measured ones; regions without a measured
    /// value are not changed.
    pub fn apply(&self, thickness_m: &mut [f64; 8]) {
        for (slot, known) in thickness_m.iter_mut().zip(self.0) {
            *slot = known.unwrap_or(*slot);
        }
    }
}

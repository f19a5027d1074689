//! A person's measured tissue thickness.

use crate::Error;
use plantar::Region;
use std::collections::BTreeMap;
use std::path::Path;

/// Thicknesses that tissue under a foot has, mm.
const THICKNESS_MM: std::ops::RangeInclusive<f64> = 2.0..=40.0;

/// Thickness of the unloaded tissue in some regions: a TOML file with one line a region in mm, such as `heel = 17.5`.
#[derive(Clone, Debug, PartialEq)]
pub struct Thickness([Option<f64>; 8]);

impl Thickness {
    /// Reads a file and checks every value.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::Io(path.into(), e))?;
        Self::parse(&text, path)
    }

    /// As [`Thickness::read`], from text; `path` is for messages.
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let form = |problem: String| Error::Form { file: path.into(), problem };
        let lines: BTreeMap<String, f64> = toml::from_str(text).map_err(|e| form(e.to_string().trim_end().into()))?;
        let mut thickness = Self([None; 8]);
        for (name, mm) in lines {
            let Some(region) = Region::from_name(&name) else {
                let names: Vec<_> = Region::ALL.iter().map(|r| r.name()).collect();
                return Err(form(format!("{name} is no region; the regions are {}", names.join(", "))));
            };
            if !THICKNESS_MM.contains(&mm) {
                let (least, most) = (THICKNESS_MM.start(), THICKNESS_MM.end());
                return Err(form(format!("{name} = {mm}: a thickness in mm is needed, {least} to {most}")));
            }
            thickness.0[region as usize] = Some(mm * 1e-3);
        }
        Ok(thickness)
    }

    /// Puts what is known into `thickness_m`, in the order of [`Region::ALL`].
    pub fn apply(&self, thickness_m: &mut [f64; 8]) {
        for (slot, known) in thickness_m.iter_mut().zip(self.0) {
            *slot = known.unwrap_or(*slot);
        }
    }
}

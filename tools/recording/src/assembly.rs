//! The last steps of every import of a vendor's export.

use crate::footprint::capitalised;
use crate::{Cell, Layout, Recording, Result, check, gaps, rate};
use plantar::Side;
use std::path::Path;

/// The parts of a recording. Frames may be missing.
pub struct Parts {
    pub side: Side,
    pub cells: Vec<Cell>,
    /// Increasing times, s.
    pub t_s: Vec<f64>,
    /// All cells of the first frame, then those of the second one, and so on.
    pub pressure_kpa: Vec<f32>,
    /// Name of the layout.
    pub name: String,
    /// Provenance, in sentences.
    pub source: String,
}

impl Parts {
    /// The recording, in which missing frames are filled. A sentence about them is added to `remarks`.
    ///
    /// # Errors
    /// Fails if the frames or the cells violate a rule of recordings. Messages name `path`.
    pub fn recording(self, path: &Path, remarks: &mut Vec<String>) -> Result<Recording> {
        let Self { side, cells, mut t_s, mut pressure_kpa, name, source } = self;
        let file = path.display().to_string();
        let source = match gaps::fill(&mut t_s, &mut pressure_kpa, cells.len()) {
            None => source,
            Some(note) => {
                remarks.push(format!("{} foot: {note}", capitalised(side)));
                format!("{source} {note}")
            }
        };
        let rate_hz = rate::of(&t_s, &|_| file.clone())?;
        let layout = Layout { name, cells };
        check::geometry(&layout, &file)?;
        check::pressures(&pressure_kpa, layout.cells.len(), &|_| file.clone())?;
        Ok(Recording { side, layout, rate_hz, source, t_s, pressure_kpa })
    }
}

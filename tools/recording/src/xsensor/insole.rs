//! One insole of an export: its description, its frames, and its recording.

use crate::assembly::ParsedExport;
use crate::earlier::EarlierRecording;
use crate::footprint::capitalised;
use crate::grid::{Foot, Frames, Grid, MAX_CELL_MM, MAX_LINES, Toes};
use crate::table::file_name;
use crate::text::shortened;
use crate::totals::Totals;
use crate::{Error, Result, units};
use plantar::Side;
use std::path::Path;

/// One insole in all frames.
#[derive(Default)]
pub struct Insole {
    pub rows: Option<usize>,
    pub columns: Option<usize>,
    /// Size of a cell across the foot, mm.
    pub cell_width_mm: Option<f64>,
    /// Size of a cell along the foot, mm.
    pub cell_height_mm: Option<f64>,
    /// For each frame of this insole, its index in the frames of the file.
    pub indices: Vec<usize>,
    /// The frames, with their indices instead of times.
    pub frames: Frames,
    /// The vendor's load of the last frame, N.
    pub stated_force_n: Option<f64>,
    /// The vendor's contact area of the last frame, mm2.
    pub stated_area_mm2: Option<f64>,
    /// The comparison of load and contact area in each frame with the vendor's values.
    pub totals: Totals,
    /// The sum of the pressures of the last frame, kPa.
    pub pressure_sum_kpa: f64,
    /// The number of loaded cells of the last frame.
    pub loaded_cells: usize,
    /// Number of fields in all frames that do not contain a pressure of at least 0, but a negative number, nothing or a
    /// placeholder such as `-`. Fields outside of the insole are among them. They are read as 0.
    pub without_pressure: usize,
}

impl Insole {
    /// Adds the recording of this insole, and the remarks about it, to `export`.
    pub fn add_to(
        mut self,
        side: Side,
        t_s: &[f64],
        earlier: &[EarlierRecording],
        path: &Path,
        export: &mut ParsedExport,
    ) -> Result<()> {
        let (width_mm, height_mm) = (self.cell_width_mm.unwrap_or(1.0), self.cell_height_mm.unwrap_or(1.0));
        self.frames.t_s = self.indices.iter().map(|&i| t_s[i]).collect();
        export.remarks.extend(self.totals.remark(side));
        if self.without_pressure > 0 {
            export.remarks.push(format!(
                "{} foot: {} fields in all frames together are empty, negative or placeholders, as those outside of the \
                 insole are; they are read as 0.",
                capitalised(side),
                self.without_pressure
            ));
        }
        let foot = Foot {
            side: Some(side),
            named: None,
            grid: Grid { row_mm: height_mm, column_mm: width_mm, toes: Toes::Top },
            earlier,
            frames: self.frames,
            name: format!("XSENSOR insole, {} x {} cells", self.rows.unwrap_or(0), self.columns.unwrap_or(0)),
            source: format!("XSENSOR measurement {}, {} insole, regions by template.", file_name(path), side.name()),
        };
        export.feet.push(foot.recording(path, &mut export.remarks)?);
        Ok(())
    }
}

/// Sets a property of a sensor, which must be the same in each frame.
pub fn check_equal<T: PartialEq + Copy>(property: &mut Option<T>, value: T, name: &str, place: &str) -> Result<()> {
    if property.is_some_and(|before| before != value) {
        let problem = format!("`{name}` differs from that of the previous frames");
        return Err(Error::content(place, problem, "import measurements of different insoles separately"));
    }
    *property = Some(value);
    Ok(())
}

/// Reads the number of rows or columns; `name` is the label of the value.
pub fn count(value: &str, name: &str, place: &str) -> Result<usize> {
    let count = value.parse().ok().filter(|count| (1..=MAX_LINES).contains(count));
    count.ok_or_else(|| {
        let problem = format!("`{}` {name}, expected 1 to {MAX_LINES}", shortened(value));
        Error::content(place, problem, "export the measurement again, and do not edit the file")
    })
}

/// Converts the size of a cell to mm; without a unit, it is in cm.
pub fn size_mm(value: f64, unit: &str, place: &str) -> Result<f64> {
    let mm = value * units::mm(if unit.is_empty() { "cm" } else { unit }, &|| place.to_owned())?;
    if mm > 0.0 && mm <= MAX_CELL_MM {
        return Ok(mm);
    }
    let problem = format!("a cell of {mm} mm");
    Err(Error::content(
        place,
        problem,
        format!("a cell is larger than 0 and at most {MAX_CELL_MM} mm: export the measurement again"),
    ))
}

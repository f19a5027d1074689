//! The layout of an earlier recording, which an import uses instead of fitting one to the frames of the export. The sensors of
//! repeated trials then have the same places, areas and regions, and the zero of one trial applies to the others.

use crate::grid::Grid;
use crate::table::file_name;
use crate::{Error, Layout, Recording, RecordingReader, Result};
use plantar::Side;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The description of an earlier recording: its foot and its layout.
pub struct EarlierRecording {
    path: PathBuf,
    head: Recording,
}

/// The remedy for an earlier recording without the data that an import needs.
const IMPORT_AGAIN: &str =
    "import that measurement again with this version, without --cells, and use the new recording";

impl EarlierRecording {
    /// Opens a recording: a file, or a folder with its parts. Its frames are not read.
    ///
    /// # Errors
    /// Fails if a file cannot be read or is not a recording.
    pub fn open(path: &Path) -> Result<Self> {
        Ok(Self { path: path.into(), head: RecordingReader::open(path)?.head })
    }

    /// The path of the file or of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The recording of the foot `side`; `None` if `earlier` is empty.
    ///
    /// # Errors
    /// Fails if all of them are of the other foot. The message names `export`, the file that is imported.
    pub(crate) fn of<'a>(earlier: &'a [Self], side: Side, export: &Path) -> Result<Option<&'a Self>> {
        let found = earlier.iter().find(|earlier| earlier.head.side == side);
        match earlier {
            [other, ..] if found.is_none() => Err(Error::content(
                export.display().to_string(),
                format!(
                    "a measurement of the {} foot, but {}, which --like names, is a recording of the {} foot",
                    side.name(),
                    other.path.display(),
                    other.head.side.name()
                ),
                "name a recording of the same foot; for an export of both feet, name NAME.parquet for NAME.left.parquet and \
                 NAME.right.parquet, or select one foot with --side",
            )),
            _ => Ok(found),
        }
    }

    /// The foot.
    pub(crate) fn side(&self) -> Side {
        self.head.side
    }

    /// The layout.
    pub(crate) fn layout(&self) -> &Layout {
        &self.head.layout
    }

    /// The name of the file or of the folder, for remarks.
    pub(crate) fn name(&self) -> String {
        file_name(&self.path)
    }

    /// Checks that the recording is of a sensor with this name of its layout.
    ///
    /// # Errors
    /// Fails if it is of another one. The message names the recording.
    pub(crate) fn check_sensor(&self, name: &str) -> Result<()> {
        let found = &self.head.layout.name;
        if found == name {
            return Ok(());
        }
        // The reduction to fewer cells appends their number.
        let is_reduced = found.strip_prefix(name).is_some_and(|rest| rest.starts_with(", "));
        Err(self.refused(
            format!("its sensor is `{found}`, that of the export is `{name}`"),
            match is_reduced {
                true => IMPORT_AGAIN,
                false => "name a recording of the same foot on the same insole, or leave out --like",
            },
        ))
    }

    /// For each row and column of the matrix sensor `grid`, the index of its cell in the layout. Other sensors have no cell.
    ///
    /// # Errors
    /// Fails if the recording does not state the rows and columns, or is of a sensor with another distance between them. The
    /// message names the recording.
    pub(crate) fn sensors(&self, grid: &Grid) -> Result<BTreeMap<(usize, usize), usize>> {
        /// Largest difference, as a fraction, between two statements of the same distance, which may be rounded or in another
        /// unit.
        const ROUNDING: f64 = 2e-3;
        let Layout { cells, sheet, .. } = &self.head.layout;
        let Some(sheet) = sheet else {
            let problem = "it does not state the rows and columns of its cells, because it was imported by an earlier version, \
                           or its cells were merged";
            return Err(self.refused(problem, IMPORT_AGAIN));
        };
        let distances_mm =
            [(sheet.row_mm.abs(), grid.row_mm, "rows"), (sheet.column_mm.abs(), grid.column_mm, "columns")];
        for (found_mm, expected_mm, lines) in distances_mm {
            if (found_mm / expected_mm - 1.0).abs() > ROUNDING {
                return Err(self.refused(
                    format!("its {lines} have a distance of {found_mm:.3} mm, those of the export one of {expected_mm:.3} mm"),
                    "name a recording of the same foot on the same insole, or leave out --like",
                ));
            }
        }
        let sensors: Option<BTreeMap<_, _>> =
            cells.iter().enumerate().map(|(index, cell)| Some((sheet.row_and_column(cell)?, index))).collect();
        sensors
            .filter(|sensors| sensors.len() == cells.len())
            .ok_or_else(|| self.refused("its cells are not in the rows and columns that it states", IMPORT_AGAIN))
    }

    /// Checks that the recording has this number of cells.
    ///
    /// # Errors
    /// Fails if it has another one. The message names the recording.
    pub(crate) fn check_cells(&self, count: usize) -> Result<()> {
        let found = self.head.cells();
        if found == count {
            return Ok(());
        }
        Err(self.refused(format!("it has {found} cells, the insole of the export has {count}"), IMPORT_AGAIN))
    }

    /// The refusal of this recording.
    fn refused(&self, problem: impl Into<String>, remedy: &str) -> Error {
        Error::content(self.path.display().to_string(), problem, remedy)
    }
}

/// The refusal of an earlier layout for an export of a plate or mat, `export`.
pub(crate) fn refuse_plate(export: &Path) -> Error {
    Error::content(
        export.display().to_string(),
        "the export is of a plate or mat, on which the foot has another place in each contact, so the layout of an earlier \
         recording does not apply",
        "leave out --like",
    )
}

/// The refusal of an earlier layout for an export of a system with one layout for all recordings, `export`.
pub(crate) fn refuse_fixed(export: &Path) -> Error {
    Error::content(
        export.display().to_string(),
        "the layout is not fitted to the export: it is the same in all recordings of this system",
        "leave out --like",
    )
}

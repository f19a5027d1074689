//! The formats of tables, and the writing of tables.

use anyhow::{Result, bail};
use plantar::Region;
use plantar::protocol::Step;
use recording::output;
use std::io;
use std::path::Path;
use study::records::{step_columns, step_row};
use study::table::{Row, Value, to_parquet};

/// Number of steps of which the rows are a row group of a Parquet file.
const STEPS_PER_GROUP: usize = 1024;

/// The format of a table.
#[derive(Clone, Copy)]
pub enum Format {
    Csv,
    Parquet,
}

impl Format {
    /// The format that the extension of `path` selects.
    ///
    /// # Errors
    /// If `path` cannot name a file, or has another extension than .csv or .parquet.
    pub fn of(path: &Path) -> Result<Self> {
        output::check_file_name(path)?;
        match path.extension().and_then(|e| e.to_str()) {
            Some("csv") => Ok(Self::Csv),
            Some("parquet") => Ok(Self::Parquet),
            _ => bail!("{}: use the extension .csv or .parquet", path.display()),
        }
    }
}

/// Checks that none of these files, which are written as JSON, has the extension of a table. `table` is the option that writes
/// their content as a table, if there is one.
///
/// # Errors
/// If a file has the extension .csv or .parquet. The message names the file and `table`.
pub fn check_json(written: &[Option<&Path>], table: Option<&str>) -> Result<()> {
    for path in written.iter().flatten() {
        if Format::of(path).is_ok() {
            let table = table.map_or(String::new(), |option| format!("; {option} writes a table"));
            bail!("{}: this file would be JSON: use the extension .json{table}", path.display());
        }
    }
    Ok(())
}

/// Writes a table with one row for each region of each step, with the columns of [`step_row`]. `starts_s` has the heel strikes
/// on the clock of the recording.
pub fn write_steps(path: &Path, steps: &[Step], starts_s: &[f64]) -> Result<()> {
    let steps: Vec<(&Step, f64)> = steps.iter().zip(starts_s.iter().copied()).collect();
    let rows = |steps: &[(&Step, f64)]| -> Vec<Row> {
        let of_step = |&(step, start_s)| (0..Region::ALL.len()).map(move |region| timed_row(step, start_s, region));
        steps.iter().flat_map(of_step).collect()
    };
    write_rows(path, &step_columns(), steps.chunks(STEPS_PER_GROUP).map(rows))
}

/// Writes groups of rows as a table, in the format of the extension of `path`. All rows have the columns of `columns`, of which
/// only the names and types are used. In Parquet, each group is a row group.
pub fn write_rows(path: &Path, columns: &Row, groups: impl IntoIterator<Item = Vec<Row>>) -> Result<()> {
    let format = Format::of(path)?;
    Ok(output::file(path, |to| match format {
        Format::Csv => {
            let mut file = csv::Writer::from_writer(to);
            file.write_record(columns.iter().map(|(name, _)| name))?;
            for row in groups.into_iter().flatten() {
                file.write_record(row.iter().map(|(_, value)| value.to_field()))?;
            }
            file.flush()
        }
        Format::Parquet => to_parquet(to, None, columns, groups).map(|_| ()).map_err(io::Error::other),
    })?)
}

/// The row of a region in a step, with the start on the clock of the recording, to the microsecond.
fn timed_row(step: &Step, start_s: f64, region: usize) -> Row {
    let mut row = step_row(step, region);
    if let Some((_, start)) = row.iter_mut().find(|(name, _)| *name == "start_s") {
        *start = Value::Real(Some((start_s * 1e6).round() / 1e6));
    }
    row
}

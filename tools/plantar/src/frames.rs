//! Writes the live values of every frame as a table, in CSV or Parquet. The table has one row per frame; the field of an
//! absent value is empty.

use crate::tables::Format;
use anyhow::{Context, Result};
use parquet::basic::{Compression, Repetition, Type as Physical};
use parquet::data_type::DoubleType;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use plantar::Real;
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use recording::output;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use study::frames;

/// Number of rows in a row group of a Parquet file.
const ROWS_PER_GROUP: usize = 16_384;

/// Writes the live values of successive frames.
pub struct FrameWriter {
    path: PathBuf,
    rule: ContactRule,
    table: Table,
    /// Declared after `table`, because fields are dropped in this order, and some systems cannot remove an open file.
    incomplete: Incomplete,
    row: Vec<Option<f64>>,
}

/// The path of the file until it is complete. On drop, an incomplete file is removed.
struct Incomplete(PathBuf);

impl Drop for Incomplete {
    fn drop(&mut self) {
        // A complete file was renamed, so there is nothing to remove. A device or a pipe is not removed.
        if self.0.is_file() {
            let _ = fs::remove_file(&self.0);
        }
    }
}

/// The file in one of the two formats. `columns` contains the values of the rows that are not written yet.
enum Table {
    Csv(Box<csv::Writer<File>>),
    Parquet { file: Box<SerializedFileWriter<File>>, columns: Vec<Vec<Option<f64>>> },
}

impl FrameWriter {
    /// Creates a file; the extension of `path`, .csv or .parquet, selects the format. The file has another name until
    /// [`FrameWriter::finish`] renames it to `path`, so that an interruption leaves an existing file as it is. A device or a pipe
    /// is written directly.
    pub fn create(path: &Path, rule: ContactRule) -> Result<Self> {
        let format = Format::of(path)?;
        let names = frames::column_names();
        let (target, incomplete) = output::paths(path);
        let create = || File::create(&incomplete).with_context(|| format!("cannot write {}", path.display()));
        let table = match format {
            Format::Csv => {
                let mut file = csv::Writer::from_writer(create()?);
                file.write_record(&names)?;
                Table::Csv(Box::new(file))
            }
            Format::Parquet => {
                let field = |name: &String| {
                    Type::primitive_type_builder(name, Physical::DOUBLE).with_repetition(Repetition::OPTIONAL).build()
                };
                let fields = names.iter().map(|name| field(name).map(Arc::new)).collect::<Result<_, _>>()?;
                let schema = Arc::new(Type::group_type_builder("frame").with_fields(fields).build()?);
                let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
                let file = SerializedFileWriter::new(create()?, schema, Arc::new(properties))?;
                Table::Parquet { file: Box::new(file), columns: vec![Vec::new(); names.len()] }
            }
        };
        let row = Vec::with_capacity(names.len());
        Ok(Self { path: target, rule, table, incomplete: Incomplete(incomplete), row })
    }

    /// Writes the values of the insole's last frame, at time `t_s`.
    pub fn push<R: Real, const N: usize>(&mut self, t_s: f64, insole: &Insole<R, N>) -> Result<()> {
        self.row.clear();
        frames::push_row(&mut self.row, t_s, insole, self.rule);
        self.write_row().with_context(|| format!("cannot write {}", self.path.display()))
    }

    fn write_row(&mut self) -> Result<()> {
        let row = &self.row;
        match &mut self.table {
            Table::Csv(file) => {
                let fields = row.iter().map(|value| value.map(|v| v.to_string()).unwrap_or_default());
                file.write_record(fields)?;
            }
            Table::Parquet { file, columns } => {
                for (column, &value) in columns.iter_mut().zip(row.iter()) {
                    column.push(value);
                }
                if columns.first().is_some_and(|column| column.len() >= ROWS_PER_GROUP) {
                    write_group(file, columns)?;
                }
            }
        }
        Ok(())
    }

    /// Writes the remaining rows and closes the file.
    pub fn finish(self) -> Result<()> {
        let Self { path, table, incomplete, .. } = self;
        let closed: Result<()> = match table {
            Table::Csv(mut file) => file.flush().and_then(|()| output::sync(file.get_ref())).map_err(Into::into),
            Table::Parquet { mut file, mut columns } => {
                write_group(&mut file, &mut columns).and_then(|()| Ok(output::sync(&file.into_inner()?)?))
            }
        };
        let renamed = closed.and_then(|()| match incomplete.0 == path {
            true => Ok(()),
            false => Ok(fs::rename(&incomplete.0, &path)?),
        });
        renamed.with_context(|| format!("cannot write {}", path.display()))
    }
}

/// Writes the columns as one row group and empties them. Without rows, no group is written.
fn write_group(file: &mut SerializedFileWriter<File>, columns: &mut [Vec<Option<f64>>]) -> Result<()> {
    if columns.first().is_none_or(Vec::is_empty) {
        return Ok(());
    }
    let mut group = file.next_row_group()?;
    for column in columns {
        // The schema has the same number of columns, so there is a next column.
        let Some(mut writer) = group.next_column()? else { break };
        let values: Vec<f64> = column.iter().flatten().copied().collect();
        let defined: Vec<i16> = column.iter().map(|value| i16::from(value.is_some())).collect();
        writer.typed::<DoubleType>().write_batch(&values, Some(&defined), None)?;
        writer.close()?;
        column.clear();
    }
    group.close()?;
    Ok(())
}

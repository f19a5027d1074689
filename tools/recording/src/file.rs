//! The Parquet file of one foot. It has one column for the time and one column for each cell. All other fields of a recording
//! are stored as JSON in the metadata of the file.

use crate::{Error, Layout, Recording, Result, names, output};
use parquet::basic::{Compression, Repetition, Type as PhysicalType};
use parquet::data_type::{DoubleType, FloatType};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{SchemaDescriptor, Type};
use plantar::Side;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;

/// The key under which the metadata of the file contains the JSON.
pub const METADATA_KEY: &str = "plantar";
/// Version of the JSON and of the columns.
const VERSION: u32 = 1;
/// Number of frames in a row group. A reader needs memory for one group at a time.
const FRAMES_PER_GROUP: usize = 16_384;

/// The JSON in the metadata of the file.
#[derive(Serialize, Deserialize)]
pub struct Metadata<'a> {
    version: u32,
    #[serde(with = "names::side")]
    side: Side,
    rate_hz: f64,
    source: Cow<'a, str>,
    layout: Cow<'a, Layout>,
}

/// The field `version`, which the JSON of every version of the format has.
#[derive(Deserialize)]
struct Version {
    version: u32,
}

/// See [`Recording::write`]. The file is written under a temporary name and renamed when it is complete, so that an
/// interruption does not damage an existing file.
pub fn write(recording: &Recording, path: &Path) -> Result<()> {
    recording.check(&path.display().to_string())?;
    let metadata = Metadata {
        version: VERSION,
        side: recording.side,
        rate_hz: recording.rate_hz,
        source: Cow::Borrowed(&recording.source),
        layout: Cow::Borrowed(&recording.layout),
    };
    let json = serde_json::to_string(&metadata).expect("numbers and strings can be written as JSON");
    output::check_file_name(path)?;
    if path.exists() && !path.is_file() {
        return Err(Error::content(path.display().to_string(), "not a regular file", "name another file"));
    }
    output::at(path, |incomplete| {
        let file = write_columns(recording, json, File::create(incomplete)?).map_err(io::Error::other)?;
        output::sync(&file)
    })
}

/// Writes the columns, and `json` to the metadata.
fn write_columns(recording: &Recording, json: String, file: File) -> std::result::Result<File, ParquetError> {
    // The statistics state the largest value of each column in a row group, because a reader needs the largest pressure before
    // it reads the first frame.
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_statistics_enabled(EnabledStatistics::Chunk)
        .set_offset_index_disabled(true)
        .set_key_value_metadata(Some(vec![KeyValue::new(METADATA_KEY.to_owned(), json)]))
        .build();
    let schema = Arc::new(schema(recording.cells())?);
    let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties))?;
    let cells = recording.cells();
    let mut column_kpa = Vec::new();
    for (times, rows) in
        recording.t_s.chunks(FRAMES_PER_GROUP).zip(recording.pressure_kpa.chunks(FRAMES_PER_GROUP * cells))
    {
        let mut group = writer.next_row_group()?;
        let mut index = 0;
        while let Some(mut column) = group.next_column()? {
            if index == 0 {
                column.typed::<DoubleType>().write_batch(times, None, None)?;
            } else {
                column_kpa.clear();
                column_kpa.extend(rows.iter().skip(index - 1).step_by(cells));
                column.typed::<FloatType>().write_batch(&column_kpa, None, None)?;
            }
            column.close()?;
            index += 1;
        }
        group.close()?;
    }
    writer.into_inner()
}

/// The columns of a recording with this number of cells.
fn schema(cells: usize) -> std::result::Result<Type, ParquetError> {
    let fields = (0..=cells)
        .map(|index| {
            let physical = if index == 0 { PhysicalType::DOUBLE } else { PhysicalType::FLOAT };
            Type::primitive_type_builder(&column_name(index), physical)
                .with_repetition(Repetition::REQUIRED)
                .build()
                .map(Arc::new)
        })
        .collect::<std::result::Result<Vec<_>, _>>()?;
    Type::group_type_builder("recording").with_fields(fields).build()
}

impl Metadata<'static> {
    /// Reads the JSON of a file.
    pub fn parse(json: &str, file: &str) -> Result<Self> {
        let broken = |error: serde_json::Error| {
            Error::content(
                file,
                format!("the metadata `{METADATA_KEY}` cannot be understood ({error})"),
                "import the measurement again",
            )
        };
        let Version { version } = serde_json::from_str(json).map_err(broken)?;
        if version > VERSION {
            return Err(Error::content(
                file,
                format!("version {version} of the format is unknown; this program reads up to version {VERSION}"),
                "update plantar",
            ));
        }
        serde_json::from_str(json).map_err(broken)
    }

    /// The recording without its frames.
    pub fn head(self) -> Recording {
        // A file may come from anywhere. Control characters would have an effect on the terminal on which a text is printed.
        let printable = |text: String| text.replace(char::is_control, " ");
        let Layout { name, cells, sheet } = self.layout.into_owned();
        Recording {
            side: self.side,
            layout: Layout { name: printable(name), cells, sheet },
            rate_hz: self.rate_hz,
            source: printable(self.source.into_owned()),
            t_s: Vec::new(),
            pressure_kpa: Vec::new(),
        }
    }
}

/// Name of the column at `index`. Column 0 is the time; column `i + 1` is cell `i`.
pub fn column_name(index: usize) -> String {
    match index {
        0 => "t_s".to_owned(),
        _ => format!("c{}_kpa", index - 1),
    }
}

/// Checks that the file has the columns of a recording with this number of cells.
pub fn check_columns(schema: &SchemaDescriptor, cells: usize, file: &str) -> Result<()> {
    let reimport = "import the measurement again";
    if schema.num_columns() != cells + 1 {
        return Err(Error::content(
            file,
            format!("{} columns, the layout of {cells} cells requires {}", schema.num_columns(), cells + 1),
            reimport,
        ));
    }
    for (index, column) in schema.columns().iter().enumerate() {
        let (physical, cast) = match index {
            0 => (PhysicalType::DOUBLE, "cast the column to float64"),
            _ => (PhysicalType::FLOAT, "cast the column to float32"),
        };
        let name = column_name(index);
        let is_other_column = column.path().string() != name || column.max_rep_level() != 0;
        if is_other_column || column.physical_type() != physical {
            return Err(Error::content(
                format!("{file}: column {}", index + 1),
                format!(
                    "`{}` of type {}, expected `{name}` of type {physical}",
                    column.path().string(),
                    column.physical_type()
                ),
                if is_other_column { reimport } else { cast },
            ));
        }
    }
    Ok(())
}

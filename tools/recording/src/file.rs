//! The Parquet file of one foot. It has one column for the time and one column for each cell. All other fields of a recording
//! are stored as JSON in the metadata of the file.

use crate::check::{self, At};
use crate::pages::CheckedPages;
use crate::{Error, Layout, Recording, Result, names};
use bytes::Bytes;
use parquet::basic::{Compression, Repetition, Type as PhysicalType};
use parquet::column::reader::ColumnReaderImpl;
use parquet::data_type::{DataType, DoubleType, FloatType};
use parquet::errors::ParquetError;
use parquet::file::metadata::{KeyValue, RowGroupMetaData};
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::reader::{FileReader, RowGroupReader};
use parquet::file::serialized_reader::SerializedFileReader;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{SchemaDescriptor, Type};
use plantar::Side;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fs::{self, File};
use std::path::Path;
use std::sync::Arc;

/// The key under which the metadata of the file contains the JSON.
const KEY: &str = "plantar";
/// First and last bytes of a Parquet file.
const MAGIC: &[u8] = b"PAR1";
/// Version of the JSON and of the columns.
const VERSION: u32 = 1;
/// Number of frames in a row group. A reader needs memory for one group at a time.
const FRAMES_PER_GROUP: usize = 16_384;
/// Number of columns that are transposed to rows at a time. In a row, their f32 values fill one cache line of 64 bytes.
const COLUMNS_PER_BLOCK: usize = 16;

#[derive(Serialize, Deserialize)]
struct Metadata<'a> {
    version: u32,
    #[serde(with = "names::side")]
    side: Side,
    rate_hz: f64,
    source: Cow<'a, str>,
    layout: Cow<'a, Layout>,
}

/// The version, which the JSON of every version of the format contains.
#[derive(Deserialize)]
struct Version {
    version: u32,
}

/// See [`Recording::write`].
pub fn write(recording: &Recording, path: &Path) -> Result<()> {
    check::recording(recording, &|at| match at {
        At::Whole => path.display().to_string(),
        At::Frame(frame) => format!("{}: frame {frame}", path.display()),
        At::Value { frame, cell } => format!("{}: frame {frame}, cell {cell}", path.display()),
    })?;
    let metadata = Metadata {
        version: VERSION,
        side: recording.side,
        rate_hz: recording.rate_hz,
        source: Cow::Borrowed(&recording.source),
        layout: Cow::Borrowed(&recording.layout),
    };
    let json = serde_json::to_string(&metadata).expect("numbers and strings can be written as JSON");
    let file = File::create(path).map_err(Error::io(path))?;
    write_columns(recording, json, file).map_err(|e| Error::io(path)(std::io::Error::other(e)))
}

/// Writes the columns, and `json` to the metadata.
fn write_columns(recording: &Recording, json: String, file: File) -> std::result::Result<(), ParquetError> {
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_statistics_enabled(EnabledStatistics::None)
        .set_offset_index_disabled(true)
        .set_key_value_metadata(Some(vec![KeyValue::new(KEY.to_owned(), json)]))
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
    writer.close()?;
    Ok(())
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

/// Name of the column at `index`. Column 0 is the time; column `i + 1` is cell `i`.
fn column_name(index: usize) -> String {
    match index {
        0 => "t_s".to_owned(),
        _ => format!("c{}_kpa", index - 1),
    }
}

/// See [`Recording::read`].
pub fn read(path: &Path) -> Result<Recording> {
    parse(fs::read(path).map_err(Error::io(path))?, path)
}

/// See [`Recording::parse`].
pub fn parse(bytes: Vec<u8>, path: &Path) -> Result<Recording> {
    let bytes = Bytes::from(bytes);
    // The Parquet library panics on some damaged files.
    std::panic::catch_unwind(|| decode(bytes, path)).unwrap_or_else(|_| {
        let file = path.display().to_string();
        Err(Error::content(file, "the file is damaged", "copy it again, or import the measurement again"))
    })
}

/// See [`Recording::parse`]. The Parquet library may panic.
fn decode(bytes: Bytes, path: &Path) -> Result<Recording> {
    let file = path.display().to_string();
    let has_start = bytes.starts_with(MAGIC);
    let has_end = bytes.ends_with(MAGIC);
    let reader = SerializedFileReader::new(bytes).map_err(|error| match (has_start, has_end) {
        (true, false) => Error::content(
            &file,
            "the file is cut off, its end is missing",
            "copy it again, or import the measurement again",
        ),
        _ => Error::content(
            &file,
            format!("not a Parquet file ({error})"),
            "create a recording with `plantar import csv`",
        ),
    })?;
    let metadata = metadata(&reader, &file)?;
    let cells = metadata.layout.cells.len();
    check::cell_count(cells, &file)?;
    check_columns(reader.metadata().file_metadata().schema_descr(), cells, &file)?;
    let (t_s, pressure_kpa) = read_columns(&reader, cells, &file)?;
    let recording = Recording {
        side: metadata.side,
        layout: metadata.layout.into_owned(),
        rate_hz: metadata.rate_hz,
        source: metadata.source.into_owned(),
        t_s,
        pressure_kpa,
    };
    check::recording(&recording, &|at| match at {
        At::Whole => file.clone(),
        At::Frame(frame) => format!("{file}: row {}, column t_s", frame + 1),
        At::Value { frame, cell } => {
            format!("{file}: row {}, column {}", frame + 1, column_name(cell + 1))
        }
    })?;
    Ok(recording)
}

/// Reads the JSON in the metadata of the file.
fn metadata(reader: &SerializedFileReader<Bytes>, file: &str) -> Result<Metadata<'static>> {
    let json = reader
        .metadata()
        .file_metadata()
        .key_value_metadata()
        .into_iter()
        .flatten()
        .find(|entry| entry.key == KEY)
        .and_then(|entry| entry.value.as_deref())
        .ok_or_else(|| {
            Error::content(
                file,
                format!("Parquet, but without the metadata `{KEY}` that describes the cells"),
                "create a recording with `plantar import csv`",
            )
        })?;
    let broken = |error: serde_json::Error| {
        Error::content(
            file,
            format!("the metadata `{KEY}` cannot be understood ({error})"),
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

/// Checks that the file has the columns of a recording with this number of cells.
fn check_columns(schema: &SchemaDescriptor, cells: usize, file: &str) -> Result<()> {
    let reimport = "import the measurement again";
    if schema.num_columns() != cells + 1 {
        return Err(Error::content(
            file,
            format!("{} columns, the layout of {cells} cells requires {}", schema.num_columns(), cells + 1),
            reimport,
        ));
    }
    for (index, column) in schema.columns().iter().enumerate() {
        let physical = match index {
            0 => PhysicalType::DOUBLE,
            _ => PhysicalType::FLOAT,
        };
        let name = column_name(index);
        if column.path().string() != name || column.physical_type() != physical || column.max_rep_level() != 0 {
            return Err(Error::content(
                format!("{file}: column {}", index + 1),
                format!("`{}` of type {}, expected `{name}` of type {physical}", column.path(), column.physical_type()),
                reimport,
            ));
        }
    }
    Ok(())
}

/// Reads the times, s, and the pressures, kPa. The pressures are stored frame by frame.
fn read_columns(reader: &SerializedFileReader<Bytes>, cells: usize, file: &str) -> Result<(Vec<f64>, Vec<f32>)> {
    let damaged = |error: ParquetError| {
        Error::content(file, format!("damaged Parquet data ({error})"), "copy or import the file again")
    };
    let frames = reader.metadata().row_groups().iter().fold(0u64, |sum, group| sum.saturating_add(rows(group) as u64));
    check::value_count(frames, cells, file)?;
    let mut t_s = Vec::new();
    let mut pressure_kpa = Vec::new();
    for index in 0..reader.num_row_groups() {
        let group = reader.get_row_group(index).map_err(damaged)?;
        let first_row = t_s.len();
        let frames = column::<DoubleType>(&*group, 0, &mut t_s, file, first_row)?;
        pressure_kpa.resize((first_row + frames) * cells, 0.0);
        let rows = &mut pressure_kpa[first_row * cells..];
        let mut columns_kpa = vec![Vec::new(); COLUMNS_PER_BLOCK.min(cells)];
        for start in (0..cells).step_by(COLUMNS_PER_BLOCK) {
            let block = &mut columns_kpa[..COLUMNS_PER_BLOCK.min(cells - start)];
            for (offset, values) in block.iter_mut().enumerate() {
                values.clear();
                column::<FloatType>(&*group, 1 + start + offset, values, file, first_row)?;
            }
            for (frame, row) in rows.chunks_exact_mut(cells).enumerate() {
                for (values, kpa) in block.iter().zip(&mut row[start..]) {
                    *kpa = values[frame];
                }
            }
        }
    }
    Ok((t_s, pressure_kpa))
}

/// Number of rows of a group. A damaged group may claim a negative number, which counts as 0.
fn rows(group: &RowGroupMetaData) -> usize {
    group.num_rows().max(0) as usize
}

/// Appends column `index` of a row group to `values` and returns the number of its rows. Messages name `file` and count rows
/// from `first_row`, the number of rows in the previous groups.
fn column<T: DataType>(
    group: &dyn RowGroupReader,
    index: usize,
    values: &mut Vec<T::T>,
    file: &str,
    first_row: usize,
) -> Result<usize> {
    let place = || format!("{file}: column {}", column_name(index));
    let damaged = |error: ParquetError| {
        Error::content(place(), format!("damaged Parquet data ({error})"), "copy or import the file again")
    };
    let rows = rows(group.metadata());
    let pages = group.get_column_page_reader(index).map_err(damaged)?;
    let pages = CheckedPages { pages, rows, value_bytes: size_of::<T::T>() };
    let column = group.metadata().column(index).column_descr_ptr();
    let mut reader = ColumnReaderImpl::<T>::new(column, Box::new(pages));
    let before = values.len();
    let mut levels = Vec::new();
    while values.len() - before < rows {
        let missing = rows - (values.len() - before);
        levels.clear();
        let (records, read, _) = reader.read_records(missing, Some(&mut levels), None, values).map_err(damaged)?;
        if read < records {
            let row = first_row + values.len() - before - read;
            let null = levels.iter().position(|&level| level == 0).unwrap_or(0);
            return Err(Error::content(
                format!("{}, row {}", place(), row + null + 1),
                "no value",
                "provide a pressure for each cell in each frame",
            ));
        }
        if records == 0 {
            return Err(Error::content(
                place(),
                format!("{} values for {rows} rows", values.len() - before),
                "copy or import the file again",
            ));
        }
    }
    Ok(rows)
}

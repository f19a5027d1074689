//! Reads the columns of a recording's Parquet file, one row group at a time.

use crate::check::{self, At};
use crate::error::caught;
use crate::file::{METADATA_KEY, Metadata, check_columns, column_name};
use crate::pages::CheckedPages;
use crate::source::Source;
use crate::{Error, Recording, Result};
use bytes::Bytes;
use parquet::basic::CompressionCodec;
use parquet::column::reader::ColumnReaderImpl;
use parquet::data_type::{DataType, DoubleType, FloatType};
use parquet::errors::ParquetError;
use parquet::file::metadata::RowGroupMetaData;
use parquet::file::reader::{FileReader, Length, RowGroupReader};
use parquet::file::serialized_reader::SerializedFileReader;
use parquet::file::statistics::Statistics;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// The threads that decode files. They are not rayon's global threads, because a task on a global thread may wait until a file
/// is decoded: if all global threads waited, nothing would be decoded.
pub static DECODERS: LazyLock<ThreadPool> =
    LazyLock::new(|| ThreadPoolBuilder::new().build().expect("the system can start threads"));

/// First and last bytes of a Parquet file.
const MAGIC: &[u8] = b"PAR1";

/// A Parquet file of a recording. Its metadata and the types of its columns are valid.
pub struct ColumnFile {
    path: PathBuf,
    reader: SerializedFileReader<Source>,
    cells: usize,
}

impl ColumnFile {
    /// Opens a file, and reads the description of the recording: a recording without frames.
    pub fn open(path: &Path) -> Result<(Recording, Self)> {
        Self::new(Source::open(path).map_err(Error::io(path))?, path)
    }

    /// As [`ColumnFile::open`], from the content of the file `path`.
    pub fn parse(bytes: Vec<u8>, path: &Path) -> Result<(Recording, Self)> {
        Self::new(Source::Memory(Bytes::from(bytes)), path)
    }

    fn new(source: Source, path: &Path) -> Result<(Recording, Self)> {
        let file = path.display().to_string();
        caught(&file, COPY_AGAIN, || {
            let is_cut_off = source.has(0, MAGIC) && !source.has(source.len().saturating_sub(4), MAGIC);
            let reader = SerializedFileReader::new(source).map_err(|error| match is_cut_off {
                true => Error::content(
                    &file,
                    "the file is cut off, its end is missing",
                    "copy it again, or import the measurement again",
                ),
                false => Error::content(
                    &file,
                    format!("not a Parquet file ({error})"),
                    "create a recording with `plantar import auto` or `plantar import csv`",
                ),
            })?;
            let head = metadata(&reader, &file)?.head();
            let cells = head.cells();
            check::layout(&head.layout, &file)?;
            check_columns(reader.metadata().file_metadata().schema_descr(), cells, &file)?;
            check_compression(&reader, &file)?;
            Ok((head, Self { path: path.into(), reader, cells }))
        })
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.reader.metadata().row_groups().iter().map(rows).fold(0, usize::saturating_add)
    }

    /// Time of the first frame, s; `None` without frames.
    pub fn first_s(&self) -> Result<Option<f64>> {
        let Some(group) = (0..self.groups()).find(|&group| self.rows(group) > 0) else { return Ok(None) };
        Ok(self.times(group, 0)?.first().copied())
    }

    /// Time of the last frame, s; `None` without frames.
    pub fn last_s(&self) -> Result<Option<f64>> {
        let Some(group) = (0..self.groups()).rfind(|&group| self.rows(group) > 0) else { return Ok(None) };
        Ok(self.times(group, self.frames().saturating_sub(self.rows(group)))?.last().copied())
    }

    /// Number of row groups.
    pub fn groups(&self) -> usize {
        self.reader.num_row_groups()
    }

    /// Number of rows of a row group.
    pub fn rows(&self, group: usize) -> usize {
        rows(self.reader.metadata().row_group(group))
    }

    /// The largest pressure of a row group by the statistics of its columns, kPa; `None` if they do not state it.
    pub fn stated_largest_kpa(&self, group: usize) -> Option<f32> {
        let group = self.reader.metadata().row_group(group);
        let mut columns_kpa = (0..self.cells).map(|cell| stated_kpa(group, cell));
        columns_kpa.try_fold(0.0, |largest_kpa: f32, kpa| Some(largest_kpa.max(kpa?)))
    }

    /// A place in the file, for messages. Frames are counted from the first one of the file.
    pub fn place(&self, at: At) -> String {
        let file = self.path.display();
        match at {
            At::Whole => file.to_string(),
            At::Frame(frame) => format!("{file}: row {}, column t_s", frame + 1),
            At::Value { frame, cell } => format!("{file}: row {}, column {}", frame + 1, column_name(cell + 1)),
        }
    }

    /// The times of a row group, s, not checked. `first_row` is the number of rows in the groups before it.
    pub fn times(&self, group: usize, first_row: usize) -> Result<Vec<f64>> {
        self.read(group, |group| self.column::<DoubleType>(group, 0, first_row))
    }

    /// The pressures of each cell in a row group, kPa, converted by `convert`, which also receives the index of the cell. All
    /// columns are decoded in parallel. `first_row` is the number of rows in the groups before it.
    pub fn pressures<T: Send>(
        &self,
        group: usize,
        first_row: usize,
        convert: &(dyn Fn(usize, Vec<f32>) -> Vec<T> + Sync),
    ) -> Result<Vec<Vec<T>>> {
        self.read(group, |group| {
            let cell = |cell| {
                let pressure_kpa = self.column::<FloatType>(group, cell + 1, first_row)?;
                let place = |frame| self.place(At::Value { frame: first_row + frame, cell });
                // The values of a column are checked as those of one long frame.
                check::pressures(&pressure_kpa, pressure_kpa.len().max(1), &|at| match at {
                    At::Value { cell: frame, .. } => place(frame),
                    other => self.place(other),
                })?;
                // The full scale of a virtual sensor follows from the statistics, so no pressure may exceed them.
                if let Some(stated_kpa) = stated_kpa(group.metadata(), cell)
                    && pressure_kpa.iter().fold(false, |any, &kpa| any | (kpa > stated_kpa))
                    && let Some(frame) = pressure_kpa.iter().position(|&kpa| kpa > stated_kpa)
                {
                    return Err(Error::content(
                        place(frame),
                        format!(
                            "{} kPa, but the statistics of the column state at most {stated_kpa} kPa",
                            pressure_kpa[frame]
                        ),
                        "copy or import the file again",
                    ));
                }
                Ok(convert(cell, pressure_kpa))
            };
            DECODERS.install(|| (0..self.cells).into_par_iter().map(cell).collect())
        })
    }

    /// Calls `read` with a row group.
    fn read<T>(&self, group: usize, read: impl FnOnce(&dyn RowGroupReader) -> Result<T>) -> Result<T> {
        let file = self.path.display().to_string();
        let group = caught(&file, COPY_AGAIN, || {
            let group = self.reader.get_row_group(group).map_err(|error| damaged(&file, &error))?;
            check::value_count(rows(group.metadata()) as u64, self.cells, &file)?;
            Ok(group)
        })?;
        read(&*group)
    }

    /// Column `index` of a row group. `first_row`, the number of rows in the groups before it, is for messages only.
    fn column<T: DataType>(&self, group: &dyn RowGroupReader, index: usize, first_row: usize) -> Result<Vec<T::T>> {
        // The panic hook depends on the thread, so a panic is caught in the thread that decodes the column.
        let file = self.path.display().to_string();
        caught(&file, COPY_AGAIN, || self.decode::<T>(group, index, first_row))
    }

    /// As [`ColumnFile::column`], but panics on some damaged files.
    fn decode<T: DataType>(&self, group: &dyn RowGroupReader, index: usize, first_row: usize) -> Result<Vec<T::T>> {
        let place = || format!("{}: column {}", self.path.display(), column_name(index));
        let rows = rows(group.metadata());
        let pages = group.get_column_page_reader(index).map_err(|error| damaged(&place(), &error))?;
        let pages = CheckedPages { pages, rows, value_bytes: size_of::<T::T>() };
        let column = group.metadata().column(index).column_descr_ptr();
        let mut reader = ColumnReaderImpl::<T>::new(column, Box::new(pages));
        let (mut values, mut levels) = (Vec::new(), Vec::new());
        while values.len() < rows {
            levels.clear();
            let (records, read, _) = reader
                .read_records(rows - values.len(), Some(&mut levels), None, &mut values)
                .map_err(|error| damaged(&place(), &error))?;
            if read < records {
                let null = levels.iter().position(|&level| level == 0).unwrap_or(0);
                return Err(Error::content(
                    format!("{}, row {}", place(), first_row + values.len() - read + null + 1),
                    "no value",
                    "provide a value in each row of each column",
                ));
            }
            if records == 0 {
                return Err(Error::content(
                    place(),
                    format!("{} values for {rows} rows", values.len()),
                    "copy or import the file again",
                ));
            }
        }
        Ok(values)
    }
}

/// The remedy for a damaged Parquet file.
const COPY_AGAIN: &str = "copy it again, or import the measurement again";

fn damaged(place: &str, error: &ParquetError) -> Error {
    Error::content(place, format!("damaged Parquet data ({error})"), "copy or import the file again")
}

/// Checks that all columns are compressed by a method that this program supports.
fn check_compression(reader: &SerializedFileReader<Source>, file: &str) -> Result<()> {
    let columns = reader.metadata().row_groups().iter().flat_map(RowGroupMetaData::columns);
    let is_supported = |codec: &_| matches!(codec, CompressionCodec::UNCOMPRESSED | CompressionCodec::SNAPPY);
    match columns.map(|column| column.compression_codec()).find(|codec| !is_supported(codec)) {
        Some(codec) => Err(Error::content(
            file,
            format!("compressed with {}, which is not supported", format!("{codec:?}").to_lowercase()),
            "write it with snappy or without compression",
        )),
        None => Ok(()),
    }
}

/// The largest pressure of a cell in a row group by the statistics of its column, kPa, if they state a possible one.
fn stated_kpa(group: &RowGroupMetaData, cell: usize) -> Option<f32> {
    match group.column(cell + 1).statistics()? {
        Statistics::Float(of) => of.max_opt().copied().filter(|kpa| (0.0..=check::MAX_KPA).contains(kpa)),
        _ => None,
    }
}

/// Number of rows of a group. A damaged group may claim a negative number, which counts as 0.
fn rows(group: &RowGroupMetaData) -> usize {
    group.num_rows().max(0) as usize
}

/// Reads the JSON in the metadata of the file.
fn metadata(reader: &SerializedFileReader<Source>, file: &str) -> Result<Metadata<'static>> {
    let entries = reader.metadata().file_metadata().key_value_metadata().into_iter().flatten();
    let mut values = entries.filter(|entry| entry.key == METADATA_KEY).filter_map(|entry| entry.value.as_deref());
    let json = values.next().ok_or_else(|| {
        Error::content(
            file,
            format!("Parquet, but without the metadata `{METADATA_KEY}` that describes the cells"),
            "create a recording with `plantar import auto` or `plantar import csv`",
        )
    })?;
    Metadata::parse(json, file)
}

//! Reads the rows of a table: a Parquet file with one row for each record.

use crate::error::caught;
use crate::pages::CheckedPages;
use crate::source::Source;
use crate::{Error, Result};
use bytes::Bytes;
use parquet::bloom_filter::Sbbf;
use parquet::column::page::PageReader;
use parquet::errors::{self, ParquetError};
use parquet::file::metadata::RowGroupMetaData;
use parquet::file::reader::{FileReader, RowGroupReader};
use parquet::file::serialized_reader::SerializedFileReader;
use parquet::record::Field;
use parquet::record::reader::{ReaderIter, RowIter, TreeBuilder};
use parquet::schema::types::{SchemaDescPtr, SchemaDescriptor, Type};
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

/// Largest size of all texts in the rows of a file, bytes. Without this limit, a small file could exhaust the memory, because a
/// long text that many rows have is stored once in the file.
const MAX_TEXT_BYTES: usize = if cfg!(fuzzing) { 1 << 24 } else { 1 << 30 };

/// The rows of a table, each of which maps the names of its columns to their values. A file of which the columns do not have the
/// stated number of rows is refused or has null for the missing values.
pub struct Rows {
    file: String,
    remedy: &'static str,
    reader: SerializedFileReader<Source>,
    /// The columns that are read.
    columns: SchemaDescPtr,
    row_count: usize,
    /// The row group after that of `rows`.
    next_group: usize,
    rows: Option<ReaderIter>,
    text_bytes: usize,
}

impl Rows {
    /// Opens a file. Only columns with a name for which `is_needed` returns true are read. `remedy` is the remedy for a file that
    /// cannot be used.
    ///
    /// # Errors
    /// Fails if the file cannot be read, is no Parquet file, is damaged, or has more than `max_rows` rows. The message names the
    /// file.
    pub fn open(path: &Path, is_needed: impl Fn(&str) -> bool, max_rows: usize, remedy: &'static str) -> Result<Self> {
        Self::new(Source::open(path).map_err(Error::io(path))?, path, is_needed, max_rows, remedy)
    }

    /// As [`Rows::open`], from the content of the file `path`.
    ///
    /// # Errors
    /// Fails in the same cases as [`Rows::open`].
    pub fn parse(
        bytes: Vec<u8>,
        path: &Path,
        is_needed: impl Fn(&str) -> bool,
        max_rows: usize,
        remedy: &'static str,
    ) -> Result<Self> {
        Self::new(Source::Memory(Bytes::from(bytes)), path, is_needed, max_rows, remedy)
    }

    fn new(
        source: Source,
        path: &Path,
        is_needed: impl Fn(&str) -> bool,
        max_rows: usize,
        remedy: &'static str,
    ) -> Result<Self> {
        let file = path.display().to_string();
        caught(&file, remedy, || {
            let damaged = |error| damaged(&file, &error, remedy);
            let reader = SerializedFileReader::new(source).map_err(damaged)?;
            // A damaged group may claim a negative number of rows, of which the library would read rows without end.
            let mut groups = reader.metadata().row_groups().iter();
            let row_count = groups.try_fold(0, |sum: usize, group| sum.checked_add(rows(group)?));
            let row_count = row_count.filter(|&row_count| row_count <= max_rows).ok_or_else(|| {
                Error::content(&file, format!("more than the {max_rows} rows that still fit into memory"), remedy)
            })?;
            let schema = reader.metadata().file_metadata().schema();
            let fields = schema.get_fields().iter().filter(|field| is_needed(field.name())).cloned().collect();
            let columns = Type::group_type_builder(schema.name()).with_fields(fields).build().map_err(damaged)?;
            let columns = Arc::new(SchemaDescriptor::new(Arc::new(columns)));
            Ok(Self {
                file: file.clone(),
                remedy,
                reader,
                columns,
                row_count,
                next_group: 0,
                rows: None,
                text_bytes: 0,
            })
        })
    }

    /// True if the file has this column, and it is read.
    pub fn has_column(&self, name: &str) -> bool {
        self.columns.root_schema().get_fields().iter().any(|field| field.name() == name)
    }

    /// Number of rows of the file.
    pub fn row_count(&self) -> usize {
        self.row_count
    }

    /// The value of a key in the metadata of the file.
    pub fn metadata(&self, key: &str) -> Option<&str> {
        let mut entries = self.reader.metadata().file_metadata().key_value_metadata().into_iter().flatten();
        entries.find(|entry| entry.key == key)?.value.as_deref()
    }

    fn next_row(&mut self) -> Result<Option<HashMap<String, Field>>> {
        let Self { file, remedy, reader, columns, next_group, rows, text_bytes, .. } = self;
        caught(file, remedy, || {
            let damaged = |error| damaged(file, &error, remedy);
            let row = loop {
                if let Some(row) = rows.as_mut().and_then(Iterator::next) {
                    break row.map_err(damaged)?;
                }
                if *next_group == reader.num_row_groups() {
                    return Ok(None);
                }
                let group = CheckedGroup(reader.get_row_group(*next_group).map_err(damaged)?);
                *next_group += 1;
                *rows = Some(TreeBuilder::new().as_iter(columns.clone(), &group).map_err(damaged)?);
            };
            let row: HashMap<_, _> = row.into_columns().into_iter().collect();
            let texts = row.values().map(|value| if let Field::Str(text) = value { text.len() } else { 0 });
            *text_bytes += texts.sum::<usize>();
            if *text_bytes > MAX_TEXT_BYTES {
                let problem = format!("the texts have more than {MAX_TEXT_BYTES} bytes, which do not fit into memory");
                return Err(Error::content(&*file, problem, *remedy));
            }
            Ok(Some(row))
        })
    }
}

impl Iterator for Rows {
    type Item = Result<HashMap<String, Field>>;

    fn next(&mut self) -> Option<Self::Item> {
        self.next_row().transpose()
    }
}

/// Number of rows of a group; `None` if it claims a negative number.
fn rows(group: &RowGroupMetaData) -> Option<usize> {
    group.num_rows().try_into().ok()
}

fn damaged(file: &str, error: &ParquetError, remedy: &str) -> Error {
    Error::content(file, format!("not a Parquet file, or damaged ({error})"), remedy)
}

/// The size of the smallest values that a dictionary contains, bytes: integers, and texts, which begin with their length.
const LEAST_VALUE_BYTES: usize = 4;

/// A row group of which the pages are checked before they are decoded.
struct CheckedGroup<'f>(Box<dyn RowGroupReader + 'f>);

impl RowGroupReader for CheckedGroup<'_> {
    fn metadata(&self) -> &RowGroupMetaData {
        self.0.metadata()
    }

    fn num_columns(&self) -> usize {
        self.0.num_columns()
    }

    fn get_column_page_reader(&self, index: usize) -> errors::Result<Box<dyn PageReader>> {
        let (pages, rows) = (self.0.get_column_page_reader(index)?, rows(self.metadata()).unwrap_or(0));
        Ok(Box::new(CheckedPages { pages, rows, value_bytes: LEAST_VALUE_BYTES }))
    }

    fn get_column_bloom_filter(&self, index: usize) -> Option<&Sbbf> {
        self.0.get_column_bloom_filter(index)
    }

    fn get_row_iter(&self, columns: Option<Type>) -> errors::Result<RowIter<'_>> {
        RowIter::from_row_group(columns, self)
    }
}

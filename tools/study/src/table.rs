//! Writes rows of values as a Parquet file.

use anyhow::{Context, Result};
use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int32Type};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::Type;
use recording::output;
use std::fs::{self, File};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// The columns of a row with their values.
pub type Row<Name = &'static str> = Vec<(Name, Value)>;

/// A value of one of the types that columns have; `None` is null.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A text.
    Text(Option<String>),
    /// A count, or the number of a record such as a step.
    Integer(Option<i32>),
    /// A real number.
    Real(Option<f64>),
    /// True or false.
    Flag(Option<bool>),
}

impl Value {
    fn text(&self) -> Option<ByteArray> {
        if let Self::Text(Some(value)) = self { Some(value.as_str().into()) } else { None }
    }

    fn integer(&self) -> Option<i32> {
        if let Self::Integer(value) = self { *value } else { None }
    }

    fn real(&self) -> Option<f64> {
        if let Self::Real(value) = self { *value } else { None }
    }

    fn flag(&self) -> Option<bool> {
        if let Self::Flag(value) = self { *value } else { None }
    }

    /// The field of a CSV file; empty for null.
    pub fn to_field(&self) -> String {
        match self {
            Self::Text(value) => value.clone(),
            Self::Integer(value) => value.map(|value| value.to_string()),
            Self::Real(value) => value.map(|value| value.to_string()),
            Self::Flag(value) => value.map(|value| value.to_string()),
        }
        .unwrap_or_default()
    }
}

impl From<&str> for Value {
    fn from(value: &str) -> Self {
        Self::Text(Some(value.into()))
    }
}

impl From<f64> for Value {
    fn from(value: f64) -> Self {
        Self::Real(Some(value))
    }
}

impl From<bool> for Value {
    fn from(value: bool) -> Self {
        Self::Flag(Some(value))
    }
}

impl From<i32> for Value {
    fn from(value: i32) -> Self {
        Self::Integer(Some(value))
    }
}

/// Writes rows as a Parquet file. There must be at least one row, and all rows must have the same columns. An existing file is
/// replaced only when the new one is complete. `metadata` is a key and its value for the metadata of the file.
///
/// # Errors
/// Fails if the file cannot be written.
///
/// # Panics
/// Panics if there are no rows.
pub fn write<Name: AsRef<str>>(path: &Path, metadata: Option<(&str, &str)>, rows: &[Row<Name>]) -> Result<()> {
    // The name of the unfinished file begins with a dot, because programs that read a folder as a table ignore such files. It
    // contains the number of this process, because another one may write the same table at the same time.
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let temporary = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
    let written = || -> Result<()> {
        fs::create_dir_all(path.parent().unwrap_or(Path::new(".")))?;
        output::sync(&to_parquet(File::create(&temporary)?, metadata, &rows[0], [rows])?)?;
        fs::rename(&temporary, path)?;
        // The new name is also synchronised. Windows has no such request for a folder.
        #[cfg(unix)]
        {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
            output::sync(&File::open(folder)?)?;
        }
        Ok(())
    };
    let written = written().inspect_err(|_| {
        // The file may not exist.
        let _ = fs::remove_file(&temporary);
    });
    written.with_context(|| format!("cannot write {}: check its permissions and the free disk space", path.display()))
}

/// Writes groups of rows as Parquet to `to`, and returns it. All rows must have the columns of `columns`, of which only the names
/// and types are used; there may be no rows at all. `metadata` is a key and its value for the metadata of the file.
///
/// # Errors
/// Fails if `to` cannot be written.
///
/// # Panics
/// Panics if a row has fewer columns than `columns`.
pub fn to_parquet<W: Write + Send, Name: AsRef<str>>(
    to: W,
    metadata: Option<(&str, &str)>,
    columns: &Row<Name>,
    groups: impl IntoIterator<Item = impl AsRef<[Row<Name>]>>,
) -> Result<W> {
    let field = |(name, value): &(Name, Value)| {
        let (physical, logical) = match value {
            Value::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            Value::Integer(_) => (Physical::INT32, None),
            Value::Real(_) => (Physical::DOUBLE, None),
            Value::Flag(_) => (Physical::BOOLEAN, None),
        };
        Type::primitive_type_builder(name.as_ref(), physical)
            .with_repetition(Repetition::OPTIONAL)
            .with_logical_type(logical)
            .build()
            .map(Arc::new)
    };
    let fields = columns.iter().map(field).collect::<Result<_, _>>()?;
    let schema = Arc::new(Type::group_type_builder("row").with_fields(fields).build()?);
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(metadata.map(|(key, value)| vec![KeyValue::new(key.to_owned(), value.to_owned())]))
        .build();
    let mut file = SerializedFileWriter::new(to, schema, Arc::new(properties))?;
    for rows in groups {
        let mut group = file.next_row_group()?;
        let mut index = 0;
        while let Some(mut column) = group.next_column()? {
            let values = rows.as_ref().iter().map(|row| &row[index].1);
            match &columns[index].1 {
                Value::Text(_) => write_column::<ByteArrayType>(&mut column, values.map(Value::text)),
                Value::Integer(_) => write_column::<Int32Type>(&mut column, values.map(Value::integer)),
                Value::Real(_) => write_column::<DoubleType>(&mut column, values.map(Value::real)),
                Value::Flag(_) => write_column::<BoolType>(&mut column, values.map(Value::flag)),
            }?;
            column.close()?;
            index += 1;
        }
        group.close()?;
    }
    Ok(file.into_inner()?)
}

/// Writes the values of a column; `None` is null.
fn write_column<T: DataType>(
    column: &mut SerializedColumnWriter,
    values: impl Iterator<Item = Option<T::T>>,
) -> Result<()> {
    let values: Vec<_> = values.collect();
    let defined: Vec<i16> = values.iter().map(|value| i16::from(value.is_some())).collect();
    let values: Vec<_> = values.into_iter().flatten().collect();
    column.typed::<T>().write_batch(&values, Some(&defined), None)?;
    Ok(())
}

/// The name of a participant's folder in the table of a study. Programs that read the table split this name at `=` into a key and
/// a value, so special characters are encoded as in Hive.
pub fn partition(participant: &str) -> String {
    let encode = |c: char| match c.is_ascii_control() || "\"#%'*/:=?\\{[]^".contains(c) {
        true => format!("%{:02X}", c as u32),
        false => c.into(),
    };
    format!("participant={}", participant.chars().map(encode).collect::<String>())
}

/// The name of the file in each participant's folder of the table.
pub const STEPS_FILE: &str = "steps.parquet";

//! Rows of values as Arrow tables, which Python receives without a copy.

use crate::exception;
use arrow_array::{ArrayRef, BooleanArray, Float64Array, Int32Array, RecordBatch, StringArray};
use arrow_pyarrow::PyArrowType;
use arrow_schema::{DataType, Field, Schema};
use pyo3::PyResult;
use std::sync::Arc;
use study::table::{Row, Value};

/// A table for Python.
pub type Table = PyArrowType<RecordBatch>;

/// The schema of a table with the columns of this row; every column can have nulls.
fn schema<Name: AsRef<str>>(columns: &Row<Name>) -> Schema {
    let field = |(name, value): &(Name, Value)| {
        let data_type = match value {
            Value::Text(_) => DataType::Utf8,
            Value::Integer(_) => DataType::Int32,
            Value::Real(_) => DataType::Float64,
            Value::Flag(_) => DataType::Boolean,
        };
        Field::new(name.as_ref(), data_type, true)
    };
    Schema::new(columns.iter().map(field).collect::<Vec<_>>())
}

/// A table of `rows`. `columns` is a row with the names and types of the columns, because `rows` may be empty.
pub fn table<Name: AsRef<str>>(columns: &Row<Name>, rows: &[Row<Name>]) -> PyResult<RecordBatch> {
    // All rows have the same columns with the same types.
    let array = |(index, (_, value)): (usize, &(Name, Value))| -> ArrayRef {
        let values = rows.iter().map(|row| &row[index].1);
        match value {
            Value::Text(_) => Arc::new(StringArray::from_iter(values.map(|v| match v {
                Value::Text(text) => text.as_deref(),
                _ => None,
            }))),
            Value::Integer(_) => Arc::new(Int32Array::from_iter(values.map(|v| match v {
                Value::Integer(value) => *value,
                _ => None,
            }))),
            Value::Real(_) => Arc::new(Float64Array::from_iter(values.map(|v| match v {
                Value::Real(value) => *value,
                _ => None,
            }))),
            Value::Flag(_) => Arc::new(BooleanArray::from_iter(values.map(|v| match v {
                Value::Flag(value) => *value,
                _ => None,
            }))),
        }
    };
    let arrays = columns.iter().enumerate().map(array).collect();
    RecordBatch::try_new(Arc::new(schema(columns)), arrays).map_err(exception)
}

/// A table of numbers, NaN without a value. `names` has the name of each of the `columns`.
pub fn numbers(names: &[String], columns: Vec<Vec<f64>>) -> PyResult<RecordBatch> {
    let fields: Vec<_> = names.iter().map(|name| Field::new(name, DataType::Float64, false)).collect();
    let arrays = columns.into_iter().map(|values| Arc::new(Float64Array::from(values)) as ArrayRef).collect();
    RecordBatch::try_new(Arc::new(Schema::new(fields)), arrays).map_err(exception)
}

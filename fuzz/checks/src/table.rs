//! A table of `plantar record` or `plantar cohort`: the rows are as many as the file states, and no more than are allowed, or the
//! file is refused. Panics of the package `parquet` are tolerated, because `Rows` catches them.

use recording::{Result, Rows};
use std::path::Path;

/// Largest number of rows that are read: few enough for many executions per second.
const MAX_ROWS: usize = 1_000;

/// Checks one input.
pub fn check(data: &[u8]) {
    let Ok(rows) = Rows::parse(data.to_vec(), Path::new("fuzz.parquet"), |_| true, MAX_ROWS, "remove it") else {
        return;
    };
    let row_count = rows.row_count();
    assert!(row_count <= MAX_ROWS);
    if let Ok(read) = rows.collect::<Result<Vec<_>>>() {
        assert_eq!(read.len(), row_count);
    }
}

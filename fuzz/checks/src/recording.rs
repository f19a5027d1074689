//! The Parquet file of a recording: the recording is consistent, or the file is refused. Panics of the package `parquet` are
//! tolerated, because `Recording::parse` catches them.

use crate::check_recording;
use recording::Recording;
use std::path::Path;

/// Checks one input.
pub fn check(data: &[u8]) {
    if let Ok(recording) = Recording::parse(data.to_vec(), Path::new("fuzz.parquet")) {
        check_recording(&recording);
    }
}

//! The Parquet file of a recording: the recording is consistent, or the file is refused. Panics of the package `parquet` are
//! tolerated, because `Recording::parse` catches them.
#![no_main]

use libfuzzer_sys::fuzz_target;
use plantar_fuzz::{check_recording, tolerate_panics_of};
use recording::Recording;
use std::path::Path;

fuzz_target!(
    init: tolerate_panics_of("/parquet-"),
    |data: &[u8]| {
        if let Ok(recording) = Recording::parse(data.to_vec(), Path::new("fuzz.parquet")) {
            check_recording(&recording);
        }
    }
);

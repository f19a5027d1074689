#![no_main]

use fuzz_checks::{table, tolerate_panics_of};

libfuzzer_sys::fuzz_target!(
    init: tolerate_panics_of(&["/parquet-"]),
    |data: &[u8]| table::check(data)
);

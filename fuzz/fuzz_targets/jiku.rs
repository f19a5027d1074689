#![no_main]

use fuzz_checks::{jiku, tolerate_panics_of};

// A product that overflows panics in the standard library, whichever package computes it.
libfuzzer_sys::fuzz_target!(
    init: tolerate_panics_of(&["/hdf5-reader-", "/iter/traits/accum.rs"]),
    |data: &[u8]| jiku::check(data)
);

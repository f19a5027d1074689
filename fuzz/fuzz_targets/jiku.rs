#![no_main]

use fuzz_checks::{jiku, tolerate_panics_of};

// An overflow in `Iterator::product`, which the HDF5 reader calls, panics in `iter/traits/accum.rs` of the standard library.
libfuzzer_sys::fuzz_target!(
    init: tolerate_panics_of(&["/hdf5-reader-", "/iter/traits/accum.rs"]),
    |data: &[u8]| jiku::check(data)
);

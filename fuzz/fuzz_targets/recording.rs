#![no_main]

use libfuzzer_sys::fuzz_target;
use std::panic::{set_hook, take_hook};

fuzz_target!(
    init: tolerate_panics_of("/parquet-"),
    |data: &[u8]| fuzz_checks::recording::check(data)
);

/// Lets panics in sources whose paths contain `name` unwind: the code under test catches them, and reports the file as damaged.
/// Any other panic still aborts the process, as libFuzzer requires.
fn tolerate_panics_of(name: &'static str) {
    let abort = take_hook();
    set_hook(Box::new(move |panic| {
        if !panic.location().is_some_and(|place| place.file().contains(name)) {
            abort(panic);
        }
    }));
}

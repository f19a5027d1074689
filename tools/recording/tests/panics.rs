//! Panics of the Parquet library on damaged files. This is the only test of its program, because it replaces the panic hook.

use recording::Recording;
use recording::synthetic::{self, SyntheticWalk};
use std::panic::{catch_unwind, set_hook};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

#[test]
fn the_hook_of_the_program_is_called_for_other_panics_only() {
    static CALLS: AtomicUsize = AtomicUsize::new(0);
    set_hook(Box::new(|_| {
        CALLS.fetch_add(1, Ordering::Relaxed);
    }));
    let calls = || CALLS.load(Ordering::Relaxed);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("walk.parquet");
    let walk = synthetic::walk(&SyntheticWalk { steps: 1, cells: 8, ..SyntheticWalk::default() });
    walk.recording.write(&path).expect("written");
    let bytes = std::fs::read(&path).expect("a file");
    let mut caught = 0;
    for at in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1 << (at % 8);
        let read = Recording::parse(damaged, &path);
        caught += usize::from(read.is_err_and(|error| error.to_string().contains("the file is damaged")));
    }
    assert!(caught > 0, "the library panics on none of the damaged files");
    assert_eq!(calls(), 0);
    assert!(catch_unwind(|| panic!("another panic")).is_err());
    assert_eq!(calls(), 1);
    assert!(thread::spawn(|| panic!("another panic")).join().is_err());
    assert_eq!(calls(), 2);
    assert!(Recording::parse(bytes, &path).is_ok());
}

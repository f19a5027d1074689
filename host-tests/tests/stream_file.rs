//! Steps, load bouts and alerts in a stream file are synchronised with the disk, and a failure of this is an error; live frames
//! are not synchronised.
#![cfg(unix)]

use client::StreamFile;
use plantar::protocol::ToHost;
use std::fs;
use std::io::Read;
use std::process::{self, Command};

/// A pipe accepts every byte, but cannot be synchronised: a step in it must not count as stored, because it would be
/// acknowledged, and the insole would delete it.
#[test]
fn a_step_that_cannot_be_synchronised_is_not_stored() {
    let path = std::env::temp_dir().join(format!("plantar-pipe-{}", process::id()));
    assert!(Command::new("mkfifo").arg(&path).status().expect("mkfifo starts").success());
    let reader = path.clone();
    let reading = std::thread::spawn(move || {
        let mut bytes = Vec::new();
        fs::File::open(reader).expect("the pipe opens").read_to_end(&mut bytes).expect("the pipe is read");
        bytes.len()
    });
    let mut file = StreamFile::create(&path).expect("the pipe counts as an empty file");
    file.write(0, &ToHost::Live(testkit::live(0))).expect("a live frame need not survive a loss of power");
    let error = file.write(0, &ToHost::Step(testkit::step(0))).expect_err("a pipe cannot be synchronised");
    assert_eq!(error.kind(), std::io::ErrorKind::InvalidInput, "{error}");
    drop(file);
    assert!(reading.join().expect("no panic") > 0);
    fs::remove_file(path).expect("the pipe is removed");
}

//! The check of each fuzz target passes for its seeds and for random variations of them. libFuzzer, which `cargo xtask fuzz`
//! runs, finds more: it knows which code an input reaches.

use proptest::prelude::*;
use proptest::sample::{Index, select};
use proptest::test_runner::TestRunner;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// The folder with seeds and entry points.
const FUZZ: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// A change to an input, at a place that is chosen separately.
#[derive(Clone, Copy, Debug)]
enum Change {
    Replace(u8),
    Insert(u8),
    Remove { len: usize },
    Truncate,
}

fn change() -> impl Strategy<Value = Change> {
    prop_oneof![
        4 => any::<u8>().prop_map(Change::Replace),
        2 => any::<u8>().prop_map(Change::Insert),
        1 => (1..=16_usize).prop_map(|len| Change::Remove { len }),
        1 => Just(Change::Truncate),
    ]
}

/// The input after these changes.
fn changed(mut input: Vec<u8>, changes: &[(Index, Change)]) -> Vec<u8> {
    for (place, change) in changes {
        let at = place.index(input.len() + 1);
        match *change {
            Change::Replace(byte) => input.iter_mut().skip(at).take(1).for_each(|replaced| *replaced = byte),
            Change::Insert(byte) => input.insert(at, byte),
            Change::Remove { len } => drop(input.drain(at..input.len().min(at + len))),
            Change::Truncate => input.truncate(at),
        }
    }
    input
}

/// Checks all seeds of a target, and this number of variations.
fn check_target(target: &str, check: fn(&[u8]), variations: u32) {
    let folder = Path::new(FUZZ).join("corpus").join(target);
    let files = fs::read_dir(folder).expect("the target has a folder with seeds");
    let seed = |path: PathBuf| {
        let seed = fs::read(&path).expect("the seed can be read");
        // If a seed fails, its name is the last one in the output of the test.
        println!("seed {}", path.display());
        check(&seed);
        seed
    };
    let seeds: Vec<_> = files.map(|file| seed(file.expect("the folder can be read").path())).collect();
    let inputs = (select(seeds), prop::collection::vec((any::<Index>(), change()), 1..=4))
        .prop_map(|(seed, changes)| changed(seed, &changes));
    let config = ProptestConfig { cases: variations, failure_persistence: None, ..ProptestConfig::default() };
    let result = TestRunner::new(config).run(&inputs, |input| {
        check(&input);
        Ok(())
    });
    result.unwrap_or_else(|failure| panic!("{failure}"));
}

macro_rules! targets {
    ($($target:ident: $variations:literal),* $(,)?) => {
        $(#[test]
        fn $target() {
            check_target(stringify!($target), fuzz_checks::$target::check, $variations);
        })*

        /// The names of all targets.
        const TARGETS: &[&str] = &[$(stringify!($target)),*];
    };
}

// Targets whose check takes longer, such as those that replay or fit a walk, check fewer variations.
targets! {
    client: 10_000,
    deframe: 10_000,
    fragments: 10_000,
    frames: 1_000,
    identify: 200,
    image: 10_000,
    jiku: 1_000,
    layout: 1_000,
    link: 10_000,
    management: 10_000,
    parameters: 1_000,
    pedar: 1_000,
    phone: 10_000,
    plateaus: 1_000,
    recording: 1_000,
    set_up: 1_000,
    stream: 1_000,
    table: 1_000,
    vendor: 1_000,
    wire: 10_000,
}

#[test]
fn every_entry_point_is_tested() {
    let files = fs::read_dir(Path::new(FUZZ).join("fuzz_targets")).expect("the folder exists");
    let names = files.map(|file| {
        let path = file.expect("the folder can be read").path();
        path.file_stem().expect("a file has a name").to_string_lossy().into_owned()
    });
    assert_eq!(names.collect::<BTreeSet<_>>(), TARGETS.iter().map(|&name| name.to_owned()).collect());
}

//! Every test runs. Cargo reports neither a file beside `tests/all.rs` that is not a module of it, nor a test in the sources of a
//! package whose `Cargo.toml` excludes tests with `test = false`.

use crate::listed::all_sources;
use std::fs;
use std::path::Path;

/// The attributes of tests, in two parts each, so that the test does not find itself.
const ATTRIBUTES: [&str; 2] = [concat!("#[", "test]"), concat!("#[", "rstest]")];

#[test]
fn every_file_beside_a_list_of_modules_is_in_the_list() {
    let lists: Vec<_> = all_sources().into_iter().filter(|file| file.ends_with("tests/all.rs")).collect();
    assert!(!lists.is_empty(), "no package has a file tests/all.rs");
    for list in lists {
        let text = fs::read_to_string(&list).expect("the list can be read");
        let files = fs::read_dir(list.parent().expect("a file is in a folder")).expect("the folder can be read");
        for file in files.map(|file| file.expect("the folder can be read").path()).filter(|file| *file != list) {
            let Some(name) = file.file_name().and_then(|name| name.to_str()?.strip_suffix(".rs")) else { continue };
            let is_module = text.lines().any(|line| line == format!("mod {name};"));
            assert!(is_module, "the tests in {} do not run: add `mod {name};` to all.rs beside it", file.display());
        }
    }
}

#[test]
fn no_test_is_in_a_package_that_declares_its_sources_free_of_tests() {
    let excludes_tests = |package: &Path| {
        let manifest = fs::read_to_string(package.join("Cargo.toml"));
        manifest.is_ok_and(|manifest| manifest.lines().any(|line| line == "test = false"))
    };
    let mut checked = 0;
    for file in all_sources() {
        let Some(package) = file.ancestors().find(|folder| folder.join("Cargo.toml").exists()) else { continue };
        if !file.starts_with(package.join("src")) || !excludes_tests(package) {
            continue;
        }
        let text = fs::read_to_string(&file).expect("the source can be read");
        assert!(
            !ATTRIBUTES.iter().any(|attribute| text.contains(attribute)),
            "{}: Cargo.toml excludes tests in `src`: remove `test = false`",
            file.display()
        );
        checked += 1;
    }
    assert!(checked > 0, "no package declares that its sources have no tests");
}

//! Collects the licences of the libraries that the programs of a release contain.

use crate::command::root;
use crate::{BOARDS, TARGET, build, setup};
use anyhow::{Context, Result, ensure};
use serde_json::Value;
use spdx::{Expression, LicenseId, Licensee, ParseMode};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The targets of the command line and of the Python package in a release, as in `.github/workflows/release.yml`.
const HOST_TARGETS: [&str; 5] = [
    "aarch64-apple-darwin",
    "aarch64-unknown-linux-gnu",
    "x86_64-apple-darwin",
    "x86_64-pc-windows-msvc",
    "x86_64-unknown-linux-gnu",
];

/// The file with the licences of all libraries but Rust's standard library.
const THIRD_PARTY: &str = "THIRD-PARTY.txt";
/// The file with the licences of Rust's standard library.
const RUST_LIBRARY: &str = "RUST-LIBRARY.html";

/// The beginning of [`THIRD_PARTY`].
const INTRODUCTION: &str = "\
Licences of third-party libraries in Plantar

The firmware, the command line, the Python package and the page contain the libraries of this list; each entry names
the parts of Plantar that contain the library. Plantar uses all libraries without changes. Their sources are at
https://crates.io/crates/NAME/VERSION. If an expression offers a choice that includes a licence of GNU, Plantar uses
the library under another licence of the choice. The texts of the licences follow the list. A library whose authors
distribute it without the text of its licence has the standard text; its copyright is that of its authors. The file
RUST-LIBRARY.html has the licences of Rust's standard library, which all parts contain.

On Linux, the command line contains libdbus, of which the crate libdbus-sys has the source. Plantar uses libdbus under
the Academic Free License 2.1, not under the GNU General Public License.

The firmware of the board nrf52840 contains libraries of Nordic Semiconductor, which are part of the crates
nrf-sdc-sys and nrf-mpsl-sys. They must only be used with integrated circuits of Nordic Semiconductor, and must not be
decompiled or modified.
";

/// Folders within a crate with code that is not compiled into programs, so that licences there do not apply to them.
const SKIPPED_FOLDERS: [&str; 5] = ["cmake", "contrib", "examples", "programs", "tests"];

/// The licences under which Plantar uses crates that contain no text of their licence, the preferred one first.
const STANDARD_LICENCES: [&str; 4] = ["Apache-2.0", "MIT", "BSD-3-Clause", "Zlib"];

/// Name and version of a crate.
type Crate = (String, String);

/// Writes the files with the licences to the folder `out`.
pub fn write(out: &Path) -> Result<()> {
    check_page()?;
    let text = third_party(&crates()?)?;
    fs::create_dir_all(out).with_context(|| format!("cannot create {}", out.display()))?;
    let notices = setup::sysroot()?.join("share/doc/rust/COPYRIGHT-library.html");
    fs::copy(&notices, out.join(RUST_LIBRARY)).with_context(|| {
        format!("cannot copy {} to {}: it is part of rustup's component rustc", notices.display(), out.display())
    })?;
    fs::write(out.join(THIRD_PARTY), text)?;
    [THIRD_PARTY, RUST_LIBRARY].into_iter().for_each(|file| println!("{}", out.join(file).display()));
    Ok(())
}

/// Fails if the page contains npm packages, because this module does not collect their licences.
fn check_page() -> Result<()> {
    let package: Value = serde_json::from_str(&fs::read_to_string(root().join("tools/phone/package.json"))?)?;
    ensure!(
        package.get("dependencies").is_none(),
        "tools/phone/package.json has dependencies, which become part of the page: extend licences.rs, so \
         that it also writes their licences to {THIRD_PARTY}"
    );
    Ok(())
}

/// Finds all crates that are linked into programs of a release, each with the parts of Plantar that contain it. Macros and build
/// scripts, which only run during compilation, are not included.
fn crates() -> Result<BTreeMap<Crate, Vec<&'static str>>> {
    let firmware = BOARDS.iter().flat_map(|board| [(*board).into(), build::bootloader(board)]).collect();
    let packages = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
    let parts: [(_, Vec<String>, &[&str]); 4] = [
        ("firmware", firmware, &[TARGET]),
        ("command line", packages(&["plantar-cli"]), &HOST_TARGETS),
        ("Python package", packages(&["plantar-python"]), &HOST_TARGETS),
        ("page", packages(&["phone-wire", "phone-identify"]), &["wasm32-unknown-unknown"]),
    ];
    let mut crates = BTreeMap::<Crate, Vec<&'static str>>::new();
    for (part, packages, targets) in parts {
        let options = ["tree", "--locked", "--edges", "normal,no-proc-macro", "--prefix", "none", "--format", "{p}"];
        let packages = packages.iter().flat_map(|package| ["--package", package]);
        let targets = targets.iter().flat_map(|target| ["--target", target]);
        let tree = cargo(&options.into_iter().chain(packages).chain(targets).collect::<Vec<_>>())?;
        for line in tree.lines() {
            // A line is `name v1.2.3`, and has the folder of the package in addition if the package is part of this workspace.
            let mut words = line.split(' ');
            let (Some(name), Some(version)) = (words.next(), words.next()) else { continue };
            let parts = crates.entry((name.into(), version.trim_start_matches('v').into())).or_default();
            if parts.last() != Some(&part) {
                parts.push(part);
            }
        }
    }
    Ok(crates)
}

/// Returns the text of [`THIRD_PARTY`]: a list of these crates, except those of this workspace, and the texts of their licences.
fn third_party(crates: &BTreeMap<Crate, Vec<&'static str>>) -> Result<String> {
    let metadata: Value = serde_json::from_str(&cargo(&["metadata", "--locked", "--format-version", "1"])?)?;
    let packages = metadata["packages"].as_array().context("the output of cargo metadata has no packages")?;
    let word = |package: &Value, key: &str| package[key].as_str().map(str::to_owned);
    let packages: BTreeMap<Crate, &Value> = packages
        .iter()
        // Only the packages of this workspace have no source.
        .filter(|package| !package["source"].is_null())
        .filter_map(|package| Some(((word(package, "name")?, word(package, "version")?), package)))
        .collect();
    // Each text with its number and the files that have it.
    let mut texts = BTreeMap::<String, (usize, Vec<String>)>::new();
    let mut list = String::new();
    for (named, parts) in crates {
        let Some(package) = packages.get(named) else { continue };
        let (name, version) = named;
        let manifest = word(package, "manifest_path").context("a package without the path of its manifest")?;
        let folder = Path::new(&manifest).parent().context("a manifest without a folder")?;
        let mut files = BTreeSet::new();
        find_licences(folder, false, &mut files)?;
        files.extend(word(package, "license_file").map(|file| folder.join(file)));
        let mut numbers = BTreeSet::new();
        let mut add = |text: &str, origin: String| {
            // Texts that differ only in the ends of their lines are equal.
            let text: Vec<_> = text.lines().map(str::trim_end).collect();
            let next = texts.len() + 1;
            let (number, having) = texts.entry(text.join("\n").trim_matches('\n').into()).or_insert((next, Vec::new()));
            numbers.insert(*number);
            having.push(format!("{name} {version}: {origin}"));
        };
        let expression = word(package, "license");
        if files.is_empty() {
            let standard = standard_licences(expression.as_deref().unwrap_or_default())
                .with_context(|| format!("{name} {version} contains no text of its licence"))?;
            standard.iter().for_each(|licence| add(licence.text(), format!("standard text of {}", licence.name)));
        }
        for file in files {
            let text = fs::read(&file).with_context(|| format!("cannot read {}", file.display()))?;
            add(&String::from_utf8_lossy(&text), file.strip_prefix(folder)?.display().to_string());
        }
        let expression = expression.unwrap_or_else(|| "see its text".into());
        let authors = package["authors"].as_array().into_iter().flatten().filter_map(Value::as_str);
        let authors = authors.collect::<Vec<_>>().join(", ");
        let numbers = numbers.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
        writeln!(list, "\n{name} {version}: {expression}\n    part of: {}", parts.join(", "))?;
        if !authors.is_empty() {
            writeln!(list, "    authors: {authors}")?;
        }
        writeln!(list, "    texts: {numbers}")?;
    }
    let mut text = format!("{INTRODUCTION}\n\nLIBRARIES\n{list}\n\nTEXTS\n");
    let mut texts: Vec<_> = texts.into_iter().map(|(text, (number, files))| (number, text, files)).collect();
    texts.sort_unstable();
    for (number, licence, files) in texts {
        writeln!(text, "\n{}\nText {number}\n    {}\n\n{licence}", "-".repeat(100), files.join("\n    "))?;
    }
    Ok(text)
}

/// Selects those of [`STANDARD_LICENCES`] that fulfil an expression.
fn standard_licences(expression: &str) -> Result<Vec<LicenseId>> {
    let accepted = STANDARD_LICENCES.map(Licensee::parse).into_iter().collect::<Result<Vec<_>, _>>()?;
    // Some crates still separate the licences of a choice by `/`.
    let required = Expression::parse_mode(expression, ParseMode::LAX)?.minimized_requirements(&accepted);
    let required = required.with_context(|| {
        format!(
            "\"{expression}\" needs a licence that is not listed in STANDARD_LICENCES of tools/xtask/src/licences.rs"
        )
    })?;
    Ok(required.iter().filter_map(|requirement| requirement.license.id()).collect())
}

/// Finds the files in this folder, and in the folders below it, with texts of licences. `is_licences` is true for a folder that
/// contains nothing else.
fn find_licences(folder: &Path, is_licences: bool, files: &mut BTreeSet<PathBuf>) -> Result<()> {
    for entry in fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().to_uppercase();
        let is_licence = ["LICENSE", "LICENCE", "UNLICENSE", "COPYING", "COPYRIGHT", "NOTICE"]
            .into_iter()
            .any(|begin| name.starts_with(begin));
        if entry.file_type()?.is_dir() {
            if !SKIPPED_FOLDERS.iter().any(|skipped| name.eq_ignore_ascii_case(skipped)) {
                find_licences(&entry.path(), is_licence, files)?;
            }
        } else if (is_licence || is_licences) && !name.ends_with(".RS") {
            files.insert(entry.path());
        }
    }
    Ok(())
}

/// Runs cargo in the repository's folder, and returns its output.
fn cargo(arguments: &[&str]) -> Result<String> {
    let mut command = Command::new("cargo");
    command.args(arguments).current_dir(root()).stderr(Stdio::inherit());
    let output = command.output().context("cargo does not start")?;
    ensure!(output.status.success(), "cargo {} failed", arguments.join(" "));
    Ok(String::from_utf8(output.stdout)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The names of the licences with which a crate without a text is listed.
    fn names(expression: &str) -> Result<Vec<&'static str>> {
        Ok(standard_licences(expression)?.iter().map(|licence| licence.name).collect())
    }

    #[test]
    fn a_crate_without_a_text_is_listed_with_the_licences_that_it_needs() -> Result<()> {
        assert_eq!(names("MIT OR Apache-2.0")?, ["Apache-2.0"]);
        assert_eq!(names("MIT/Apache-2.0")?, ["Apache-2.0"]);
        assert_eq!(names("MIT")?, ["MIT"]);
        assert_eq!(names("(MIT OR GPL-3.0-only) AND BSD-3-Clause")?, ["MIT", "BSD-3-Clause"]);
        Ok(())
    }

    #[test]
    fn a_licence_that_was_not_accepted_is_an_error() {
        for expression in ["", "GPL-3.0-only", "MIT AND MPL-2.0", "LicenseRef-Nordic-5-Clause"] {
            assert!(names(expression).is_err(), "{expression}");
        }
    }
}

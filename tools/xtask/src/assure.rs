//! Measures the tests themselves: their number, the code that they execute, and the changes and attacks that they notice. The
//! core is the library in `src`.

use crate::arguments::Assure;
use crate::build::{cargo_firmware, firmware};
use crate::command::{built, root, run_command};
use crate::setup;
use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::{Command, Stdio};

/// Least share of the core's lines that tests execute.
const LEAST_COVERAGE: f64 = 0.90;
/// Least share of the changes to the modules in `.cargo/mutants.toml` that tests notice.
const LEAST_MUTATION_SCORE: f64 = 0.85;
/// Least number of tests of properties and of interleavings.
const LEAST_PROOFS: usize = 10;

/// The modules of the package `host-tests` whose tests cover the modules in `.cargo/mutants.toml` and need no firmware. They run
/// for the changes that the fast tests have not noticed.
const SLOWER_TESTS: [&str; 17] = [
    "admission::",
    "alerts::",
    "bouts::",
    "cells::",
    "client::",
    "gatt_values::",
    "layout::",
    "link::",
    "management::",
    "management_tools::",
    "parameters::",
    "scenarios::",
    "storage::",
    "supervision::",
    "supply::",
    "swap::",
    "wire::",
];

impl Assure {
    /// Measures everything, and compares the figures with their limits at the end.
    pub fn run(&self) -> Result<()> {
        setup::rust()?;
        let proofs = proofs()?;
        let skips = instruction_skips(self.every)?;
        undefined_behaviour()?;
        let coverage = coverage()?;
        let score = mutation_score(self.every)?;
        println!(
            "{:<20} {proofs:>8}  tests of properties for all inputs within bounds, and of interleavings",
            "proofs"
        );
        println!(
            "{:<20} {skips:>8}  images with a wrong signature that were accepted because instructions were skipped",
            "instruction_skips"
        );
        println!("{:<20} {coverage:>8.3}  share of the lines of src that tests execute", "coverage_lines");
        println!(
            "{:<20} {score:>8.3}  share of the changes to protocol, storage, update and supervision that tests notice",
            "mutation_score"
        );
        let figures = [
            ("proofs", proofs.into()),
            ("instruction_skips", skips.into()),
            ("coverage_lines", coverage.into()),
            ("mutation_score", score.into()),
        ];
        self.figures.write(&figures.map(|(key, figure)| (key.to_owned(), figure)).into_iter().collect())?;
        let limits = [
            ("proofs", proofs as f64, LEAST_PROOFS as f64),
            ("coverage_lines", coverage, LEAST_COVERAGE),
            ("mutation_score", score, LEAST_MUTATION_SCORE),
        ];
        let missed = limits.iter().filter(|(_, figure, least)| figure < least);
        let mut missed: Vec<_> =
            missed.map(|(name, figure, least)| format!("{name} is {figure:.3}, must be at least {least}")).collect();
        if skips > 0 {
            missed.push(format!("instruction_skips is {skips}, must be 0"));
        }
        ensure!(missed.is_empty(), "figures miss their limits: {}", missed.join("; "));
        Ok(())
    }
}

/// A cargo command with these arguments.
fn cargo(arguments: &[&str]) -> Command {
    let mut command = Command::new("cargo");
    command.args(arguments);
    command
}

/// Checks all properties with large bounds, and all interleavings of the firmware's loops. Returns the number of these tests.
fn proofs() -> Result<usize> {
    let exhaustive =
        ["test", "--locked", "--release", "--package", "proofs", "--test", "exhaustive", "--test", "stored"];
    run_command(cargo(&exhaustive).env("PLANTAR_ASSURE", "1"))?;
    let interleavings = ["test", "--locked", "--package", "proofs", "--test", "interleavings"];
    let folder = built("shuttle");
    let with_shuttle = |command: &mut Command| {
        // All packages are compiled again with this flag, so these builds have a target folder of their own.
        command.env("RUSTFLAGS", "--cfg shuttle").env("CARGO_TARGET_DIR", &folder);
    };
    let mut command = cargo(&interleavings);
    with_shuttle(&mut command);
    run_command(&mut command)?;
    let mut list = cargo(&[&interleavings[..], &["--", "--list"]].concat());
    with_shuttle(&mut list);
    Ok(tests(list)? + tests(cargo(&[&exhaustive[..], &["--", "--list"]].concat()))?)
}

/// The number of tests that the command `list` lists.
fn tests(mut list: Command) -> Result<usize> {
    let output = list.current_dir(root()).stderr(Stdio::inherit()).output()?;
    ensure!(output.status.success(), "the tests of the package proofs cannot be listed: see the output of cargo above");
    Ok(String::from_utf8_lossy(&output.stdout).lines().filter(|line| line.ends_with(": test")).count())
}

/// Makes the emulated processor skip 2 to 10 bytes at one in `every` instructions of the check of a wrong signature; returns
/// the number of accepted images. The same attack must succeed if the signature is checked only once, otherwise it shows
/// nothing.
fn instruction_skips(every: u32) -> Result<u64> {
    setup::qemu()?;
    const PROGRAM: &str = "signature-check";
    cargo_firmware("build", PROGRAM, &[])?;
    let json = built("instruction-skips.json");
    let mut command = Command::new(setup::gdb()?);
    command
        .args(["--batch", "--nx", "-x", "proofs/signature-check/skips.py"])
        .env("PLANTAR_PROGRAM", std::path::absolute(firmware(PROGRAM))?)
        .env("PLANTAR_EVERY", every.to_string())
        .env("PLANTAR_SKIPS", std::path::absolute(&json)?)
        // GDB reports every stop on its standard output.
        .stdout(Stdio::null());
    run_command(&mut command)?;
    let results = read(&json)?;
    let count = |check: &str, key: &str| {
        results[check][key].as_u64().with_context(|| format!("{} has no {key} for {check}", json.display()))
    };
    ensure!(count("one check", "accepted")? > 0, "no skip defeats a single check: use a smaller number with --every");
    ensure!(count("both checks", "attempts")? > 0, "no instruction was skipped");
    count("both checks", "accepted")
}

/// Runs tests of the core in Miri.
fn undefined_behaviour() -> Result<()> {
    setup::miri()?;
    // `cargo +toolchain` would need the wrapper of rustup, which is not first in the path within `cargo xtask`.
    let mut command = Command::new("rustup");
    command
        .args(["run", setup::MIRI_TOOLCHAIN, "cargo", "miri", "test", "--locked", "--target-dir"])
        .arg(built("miri"));
    command.args(["--package", "plantar", "--package", "proofs", "--lib", "--test", "examples"]);
    // These tests pack and unpack many frames, for which Miri is too slow.
    run_command(command.args(["--", "--skip", "protocol::cells"]))
}

/// The share of the core's lines that tests on a host execute. Tests of the firmware in the emulator do not count.
fn coverage() -> Result<f64> {
    let json = built("coverage.json");
    let mut command = Command::new(setup::cargo_llvm_cov()?);
    command
        .args(["llvm-cov", "test", "--locked", "--profile", "mutants", "--json", "--summary-only", "--output-path"])
        .arg(&json);
    let packages = ["plantar", "proofs", "host-tests", "client"];
    run_command(command.args(packages.iter().flat_map(|package| ["--package", package])))?;
    let report = read(&json)?;
    let files = report["data"][0]["files"].as_array().context("the report of the coverage has no files")?;
    let core = root().join("src");
    let (mut covered, mut lines) = (0, 0);
    for file in
        files.iter().filter(|file| file["filename"].as_str().is_some_and(|name| Path::new(name).starts_with(&core)))
    {
        let count =
            |key: &str| file["summary"]["lines"][key].as_u64().context("the report of the coverage has no lines");
        (covered, lines) = (covered + count("covered")?, lines + count("count")?);
    }
    // Without lines the share would be NaN, which misses no limit.
    ensure!(lines > 0, "{} has no file of {}: the coverage was not measured", json.display(), core.display());
    Ok(covered as f64 / lines as f64)
}

/// Time after which a run of the slower tests counts as an endless loop, s.
const SLOWER_TESTS_TIMEOUT_S: &str = "240";

/// Changes the modules in `.cargo/mutants.toml` at one in `every` places, one after the other, and returns the share of the
/// changes that tests notice.
fn mutation_score(every: u32) -> Result<f64> {
    let tool = setup::cargo_mutants()?;
    let mutants = |step: &str, arguments: &[&str]| {
        let folder = built("mutation").join(step);
        let mut command = Command::new(&tool);
        command.args(["mutants", "--package", "plantar", "--output"]).arg(&folder).args(arguments).current_dir(root());
        // Exit codes 2 and 3: some changes were not noticed, or ended in an endless loop.
        let status = command.status().context("cargo-mutants does not start")?;
        if !matches!(status.code(), Some(0 | 2 | 3)) {
            bail!("cargo-mutants failed: see {}", folder.display());
        }
        let changes = |file: &str| {
            let text = std::fs::read_to_string(folder.join("mutants.out").join(file))?;
            anyhow::Ok(text.lines().map(str::to_owned).collect::<Vec<_>>())
        };
        Ok(([changes("caught.txt")?, changes("timeout.txt")?].concat(), changes("missed.txt")?))
    };
    std::fs::create_dir_all(built("mutation"))?;
    println!("Testing one in {every} changes with the fast tests");
    let shard = format!("0/{every}");
    let fast = ["--sharding", "round-robin", "--shard", &shard, "--test-package", "plantar,proofs"];
    let (noticed, missed) = mutants("fast", &fast)?;
    let count = noticed.len() + missed.len();
    ensure!(count > 0, "no change could be tested: use a smaller number with --every");
    if missed.is_empty() {
        return Ok(1.0);
    }
    println!("Testing, with the slower tests, the {} changes that the fast tests did not notice", missed.len());
    let names: Vec<String> = missed.iter().map(|change| escaped(change)).collect();
    let names = format!("^({})$", names.join("|"));
    // cargo-mutants ignores the option --re for changes that delete a field, and tests all of them in the files of --file. Its
    // configuration would add further files, so `--no-config` excludes it.
    let files: BTreeSet<_> = missed.iter().filter_map(|change| change.split(':').next()).collect();
    let files = files.into_iter().flat_map(|file| ["--file", file]);
    let configuration = ["--no-config", "--profile", "mutants"];
    // There is no baseline, the run without changes: cargo-mutants would look for these tests in the changed package.
    let tested = ["--test-package", "host-tests", "--baseline", "skip", "--timeout", SLOWER_TESTS_TIMEOUT_S];
    // Arguments after the first separator are for `cargo test`, those after the second one for the program with the tests.
    let arguments = configuration
        .into_iter()
        .chain(files)
        .chain(["--re", &names])
        .chain(tested)
        .chain(["--", "--"])
        .chain(SLOWER_TESTS);
    let (noticed, _) = mutants("slow", &arguments.collect::<Vec<_>>())?;
    // A change that was not tested counts as not noticed.
    let never: Vec<_> = missed.into_iter().filter(|change| !noticed.contains(change)).collect();
    println!("Changes that no test noticed:\n{}", never.join("\n"));
    Ok(1.0 - never.len() as f64 / count as f64)
}

/// A regular expression for exactly this text. Not all punctuation is escaped, because `\<` and `\>` are the ends of a word.
fn escaped(text: &str) -> String {
    text.chars().flat_map(|c| r"\.+*?()|[]{}^$#&-~".contains(c).then_some('\\').into_iter().chain([c])).collect()
}

/// Reads a JSON file.
fn read(json: &Path) -> Result<Value> {
    let text = std::fs::read_to_string(json).with_context(|| format!("cannot read {}", json.display()))?;
    Ok(serde_json::from_str(&text)?)
}

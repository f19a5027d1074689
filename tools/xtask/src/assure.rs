//! Measures the tests themselves.

use crate::arguments::Assure;
use crate::command::{built, root, run_command};
use crate::setup;
use anyhow::{Context, Result, bail};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};

/// Least share of the core's lines that tests execute.
const LEAST_COVERAGE: f64 = 0.90;
/// Least share of the changes to the core that tests notice.
const LEAST_MUTATION_SCORE: f64 = 0.85;
/// Least number of properties.
const LEAST_PROOFS: usize = 10;

/// The tests of other packages that cover the core and need no firmware. They run if the fast tests have not noticed a change.
const SLOWER_TESTS: [&str; 12] = [
    "admission",
    "cells",
    "client",
    "gatt_values",
    "layout",
    "parameters",
    "scenarios",
    "storage",
    "supervision",
    "supply",
    "swap",
    "wire",
];

impl Assure {
    /// Measures everything, and compares the figures with their bars at the end.
    pub fn run(&self) -> Result<()> {
        setup::rust()?;
        let proofs = proofs()?;
        undefined_behaviour()?;
        let coverage = coverage()?;
        let score = mutation_score(self.every)?;
        println!("{:<20} {proofs:>8}  properties, checked for all inputs within their bounds", "proofs");
        println!("{:<20} {coverage:>8.3}  share of the lines of src that tests execute", "coverage_lines");
        println!(
            "{:<20} {score:>8.3}  share of the changes to protocol, storage and supervision that tests notice",
            "mutation_score"
        );
        let figures =
            [("proofs", proofs.into()), ("coverage_lines", coverage.into()), ("mutation_score", score.into())];
        self.figures.write(&figures.map(|(key, figure)| (key.to_owned(), figure)).into_iter().collect())?;
        if proofs < LEAST_PROOFS || coverage < LEAST_COVERAGE || score < LEAST_MUTATION_SCORE {
            bail!("a figure misses its bar: {LEAST_PROOFS}, {LEAST_COVERAGE}, {LEAST_MUTATION_SCORE}");
        }
        Ok(())
    }
}

/// A cargo command with these arguments.
fn cargo(arguments: &[&str]) -> Command {
    let mut command = Command::new("cargo");
    command.args(arguments);
    command
}

/// Checks all properties with large bounds, and all interleavings; returns the number of tests.
fn proofs() -> Result<usize> {
    let exhaustive = ["test", "--locked", "--release", "--package", "proofs"];
    run_command(cargo(&exhaustive).env("PLANTAR_ASSURE", "1"))?;
    let interleavings = ["test", "--locked", "--package", "proofs", "--test", "interleavings"];
    let folder = built("shuttle");
    let with_shuttle = |command: &mut Command| {
        // The flag changes all packages, so they have a folder of their own.
        command.env("RUSTFLAGS", "--cfg shuttle").env("CARGO_TARGET_DIR", &folder);
    };
    let mut command = cargo(&interleavings);
    with_shuttle(&mut command);
    run_command(&mut command)?;
    let mut list = cargo(&[&interleavings[..], &["--", "--list"]].concat());
    with_shuttle(&mut list);
    Ok(tests(list)? + tests(cargo(&[&exhaustive[..], &["--", "--list"]].concat()))?)
}

/// The number of tests in a list.
fn tests(mut list: Command) -> Result<usize> {
    let output = list.current_dir(root()).stderr(Stdio::null()).output()?;
    Ok(String::from_utf8_lossy(&output.stdout).lines().filter(|line| line.ends_with(": test")).count())
}

/// Runs tests of the core in Miri.
fn undefined_behaviour() -> Result<()> {
    setup::miri()?;
    let toolchain = format!("+{}", setup::MIRI_TOOLCHAIN);
    // cargo is not the wrapper of rustup here, which would understand the name of a toolchain.
    let mut command = Command::new("rustup");
    command.args(["run", &toolchain[1..], "cargo", "miri", "test", "--locked", "--target-dir"]).arg(built("miri"));
    run_command(command.args(["--package", "plantar", "--package", "proofs", "--lib", "--test", "examples"]))
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
    Ok(covered as f64 / lines as f64)
}

/// Changes the core at one in `every` places, one after the other, and returns the share of the changes that tests notice.
fn mutation_score(every: u32) -> Result<f64> {
    let folder = built("mutation");
    // A former run would be continued.
    if folder.exists() {
        std::fs::remove_dir_all(&folder)?;
    }
    let tool = setup::cargo_mutants()?;
    let mutants = |arguments: &[&str]| {
        let mut command = Command::new(&tool);
        let shard = format!("0/{every}");
        command.args(["mutants", "--package", "plantar", "--sharding", "round-robin", "--shard", &shard, "--output"]);
        command.arg(&folder).args(arguments).current_dir(root());
        eprintln!("> {command:?}");
        let status = command.status().context("cargo-mutants does not start")?;
        // 2 and 3: some changes were not noticed, or ended in an endless loop.
        if !matches!(status.code(), Some(0 | 2 | 3)) {
            bail!("cargo-mutants failed: see {}", folder.display());
        }
        let outcomes = read(&folder.join("mutants.out/outcomes.json"))?;
        let count = |key: &str| outcomes[key].as_u64().with_context(|| format!("cargo-mutants did not count {key}"));
        Ok([count("caught")?, count("timeout")?, count("missed")?])
    };
    // Most changes are noticed by the fast tests. The slower ones test the others.
    let [caught, endless, missed] = mutants(&["--test-package", "plantar,proofs"])?;
    let slower = SLOWER_TESTS.iter().flat_map(|test| ["--test", test]);
    let iterate = ["--iterate", "--test-package", "host-tests", "--"];
    let [_, _, never] = mutants(&iterate.into_iter().chain(slower).collect::<Vec<_>>())?;
    Ok(1.0 - never as f64 / (caught + endless + missed).max(1) as f64)
}

fn read(json: &Path) -> Result<Value> {
    let text = std::fs::read_to_string(json).with_context(|| format!("cannot read {}", json.display()))?;
    Ok(serde_json::from_str(&text)?)
}

//! Runs the fuzz targets, each for the same time, on all cores.

use crate::command::{built, join, root, run_command};
use crate::setup;
use anyhow::{Context, Result, bail, ensure};
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};

/// Largest memory that an input may need, MiB. The limit is high because a single page of a Parquet file may take 2 GiB.
const MEMORY_MIB: u32 = 4096;
/// Longest time that an input may take, s; a longer one counts as an endless loop.
const HANG_S: u32 = 25;

/// Runs every target; all of them together take `minutes` of one core.
///
/// # Errors
/// If targets fail, after all of them have run; the message names each target and, if an input was written, its file.
pub fn run(minutes: f64) -> Result<()> {
    let tool = setup::cargo_fuzz()?;
    let cargo_fuzz = |arguments: &[&str]| {
        let mut command = Command::new(&tool);
        command.current_dir(root()).args(arguments);
        command
    };
    let list = cargo_fuzz(&["list"]).stderr(Stdio::inherit()).output().context("cargo-fuzz does not start")?;
    ensure!(list.status.success(), "cargo-fuzz cannot list the targets in fuzz/Cargo.toml");
    let targets = String::from_utf8(list.stdout)?;
    let targets: Vec<_> = targets.lines().collect();
    ensure!(!targets.is_empty(), "no fuzz targets in fuzz/Cargo.toml");
    let folder = built("fuzz");
    // A sanitizer would need a nightly toolchain, and the parsers contain no unsafe code.
    let options = ["--sanitizer", "none", "--target-dir", &folder.to_string_lossy()];
    run_command(&mut cargo_fuzz(&[&["build"], &options[..]].concat()))?;
    let seconds = (minutes * 60.0 / targets.len() as f64).ceil().max(1.0) as u64;
    // A fuzzer uses one core, so as many targets run at the same time as there are cores.
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut failures = Vec::new();
    for targets in targets.chunks(cores) {
        std::thread::scope(|scope| {
            let runs = targets.iter().map(|target| {
                let fuzzer = cargo_fuzz(&[&["run", target], &options[..]].concat());
                let found = folder.join("corpus").join(target);
                scope.spawn(move || run_target(fuzzer, target, &found, seconds))
            });
            let failed = runs.collect::<Vec<_>>().into_iter().filter_map(|run| join(run).err());
            failures.extend(failed.map(|failure| format!("{failure:#}")));
        });
    }
    ensure!(failures.is_empty(), "{}", failures.join("\n"));
    Ok(())
}

/// Runs the fuzzer of a target for this time. New inputs are written to the folder `found`.
fn run_target(mut fuzzer: Command, target: &str, found: &Path, seconds: u64) -> Result<()> {
    // The fuzzer writes new inputs to its first folder. It only reads the second one, which has the repository's seeds.
    std::fs::create_dir_all(found)?;
    let seeds = Path::new("fuzz/corpus").join(target);
    fuzzer.arg(found).args(std::fs::exists(root().join(&seeds))?.then_some(&seeds)).args([
        "--",
        "-print_final_stats=1",
        &format!("-max_total_time={seconds}"),
        &format!("-rss_limit_mb={MEMORY_MIB}"),
        &format!("-timeout={HANG_S}"),
    ]);
    let mut process = fuzzer.stderr(Stdio::piped()).stdout(Stdio::null()).spawn()?;
    let mut output = Vec::new();
    process.stderr.take().context("the fuzzer has no output")?.read_to_end(&mut output)?;
    let output = String::from_utf8_lossy(&output);
    if !process.wait()?.success() {
        let artifact = output.split_once("Test unit written to ").and_then(|(_, rest)| rest.lines().next());
        let last: Vec<_> = output.lines().rev().take(40).collect();
        last.iter().rev().for_each(|line| eprintln!("{line}"));
        match artifact {
            Some(input) => bail!("fuzz target {target} failed for the input in {input}"),
            None => bail!("fuzz target {target} failed without an input: see its output above"),
        }
    }
    let executions = output.split_once("number_of_executed_units:").and_then(|(_, rest)| rest.lines().next());
    let executions: u64 = executions.context("the fuzzer printed no number of executions")?.trim().parse()?;
    println!("{target:<12} {executions:>12} executions in {seconds} s");
    Ok(())
}

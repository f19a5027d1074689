//! The fuzz targets, each for its share of the time.

use crate::{built, root, setup};
use anyhow::{Context, Result, bail};
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};

/// More memory than this is a finding, MiB: a page of a Parquet file may take 2 GiB.
const MEMORY_MIB: u32 = 4096;
/// Longer than this with one input is a finding, s.
const HANG_S: u32 = 25;

/// Runs every target; a finding ends it and is named.
pub fn run(minutes: f64) -> Result<()> {
    let tool = setup::cargo_fuzz()?;
    // Without a sanitizer the pinned toolchain can do it: the parsers hold no unsafe code for one to watch.
    let cargo_fuzz = |arguments: &[&str]| {
        let mut command = Command::new(&tool);
        command.current_dir(root()).args(arguments);
        command
    };
    let listed = cargo_fuzz(&["list"]).output().context("cargo-fuzz does not start")?;
    let listed = String::from_utf8(listed.stdout)?;
    let targets: Vec<_> = listed.lines().collect();
    if targets.is_empty() {
        bail!("no fuzz targets in fuzz/Cargo.toml");
    }
    let folder = built("fuzz");
    let options = ["--sanitizer", "none", "--target-dir", &folder.to_string_lossy()];
    crate::run_command(&mut cargo_fuzz(&[&["build"], &options[..]].concat()))?;
    let share_s = (minutes * 60.0 / targets.len() as f64).ceil().max(1.0) as u64;
    for target in targets {
        // What a run finds stays out of the repository's seeds, which it reads only.
        let found = folder.join("corpus").join(target);
        std::fs::create_dir_all(&found)?;
        let seeds = Path::new("fuzz/corpus").join(target);
        let mut command = cargo_fuzz(&[&["run", target], &options[..]].concat());
        command.arg(&found).args(std::fs::exists(root().join(&seeds))?.then_some(&seeds)).args([
            "--",
            "-print_final_stats=1",
            &format!("-max_total_time={share_s}"),
            &format!("-rss_limit_mb={MEMORY_MIB}"),
            &format!("-timeout={HANG_S}"),
        ]);
        let mut running = command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn()?;
        let mut said = Vec::new();
        running.stderr.take().context("the fuzzer has no output")?.read_to_end(&mut said)?;
        let said = String::from_utf8_lossy(&said);
        if !running.wait()?.success() {
            let artifact = said.split_once("Test unit written to ").and_then(|(_, rest)| rest.lines().next());
            let last: Vec<_> = said.lines().rev().take(40).collect();
            last.iter().rev().for_each(|line| eprintln!("{line}"));
            bail!("fuzz target {target} failed: {}", artifact.unwrap_or("it wrote no artifact"));
        }
        let executions = said.split_once("number_of_executed_units:").and_then(|(_, rest)| rest.lines().next());
        let executions: u64 = executions.context("the fuzzer did not count")?.trim().parse()?;
        println!("{target:<12} {executions:>12} executions in {share_s} s");
    }
    Ok(())
}

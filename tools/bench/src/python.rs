//! Runs the Python scripts of the benchmarks. A script receives the folder with its data, and prints numbers.

use anyhow::{Context, Result, bail};
use std::path::Path;
use std::process::Command;

/// Runs a script of this package on the data in `folder`. Returns the numbers of each line that it prints.
pub fn run(python: &Path, script: &str, folder: &Path, arguments: &[String]) -> Result<Vec<Vec<f64>>> {
    let output = Command::new(python)
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join(script))
        .arg(folder)
        .args(arguments)
        .output()
        .with_context(|| format!("cannot run {}: install it with `cargo xtask setup`", python.display()))?;
    if !output.status.success() {
        bail!("{script} failed: {}", String::from_utf8_lossy(&output.stderr));
    }
    let stdout = String::from_utf8(output.stdout)?;
    let line = |line: &str| line.split_whitespace().map(str::parse).collect::<Result<_, _>>();
    stdout
        .lines()
        .map(line)
        .collect::<Result<_, _>>()
        .with_context(|| format!("{script} printed something that is not a number: {stdout}"))
}

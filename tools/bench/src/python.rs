//! The comparisons' Python scripts: a folder of data in, numbers out.

use anyhow::{Context, Result, bail};
use std::path::Path;
use std::process::Command;

/// Runs a script of this package on the data in `folder`; the numbers it prints, line by line.
pub fn run(python: &Path, script: &str, folder: &Path, arguments: &[String]) -> Result<Vec<Vec<f64>>> {
    let ran = Command::new(python)
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join(script))
        .arg(folder)
        .args(arguments)
        .output()
        .with_context(|| format!("cannot run {}: `cargo xtask setup` makes it", python.display()))?;
    if !ran.status.success() {
        bail!("{script} failed: {}", String::from_utf8_lossy(&ran.stderr));
    }
    let said = String::from_utf8(ran.stdout)?;
    let line = |line: &str| line.split_whitespace().map(str::parse).collect::<Result<_, _>>();
    said.lines().map(line).collect::<Result<_, _>>().with_context(|| format!("{script} said: {said}"))
}

//! Builds and tests the Python package.

use crate::build::{build_example, build_host};
use crate::command::{built, root, run_command};
use crate::setup;
use anyhow::Result;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};

/// The target folder of the compiled part. The other host programs enable more features of its dependencies, so a common folder
/// would save nothing. With a folder of its own, it can be built at the same time.
const TARGET_FOLDER: &str = "package";

/// Set once the package is built and installed.
static IS_BUILT: AtomicBool = AtomicBool::new(false);

/// Builds the wheel of the package and installs it in the private environment, unless this was done before. Returns the folder of
/// the environment.
pub fn build() -> Result<PathBuf> {
    let (environment, wheels) = (setup::package()?, built("wheels"));
    if IS_BUILT.load(Ordering::Relaxed) {
        return Ok(environment);
    }
    // Wheels of earlier versions would be installed as well.
    if wheels.exists() {
        fs::remove_dir_all(&wheels)?;
    }
    let target = built(TARGET_FOLDER);
    let folders = ["--target-dir", &target.to_string_lossy(), "--out", &wheels.to_string_lossy()];
    run_tool(&environment, "maturin", &[&["build", "--locked", "--release"], &folders[..]].concat())?;
    for wheel in fs::read_dir(&wheels)? {
        let wheel = wheel?.path();
        setup::pip(&environment, &["install", "--force-reinstall", "--no-deps", &wheel.to_string_lossy()])?;
    }
    IS_BUILT.store(true, Ordering::Relaxed);
    Ok(environment)
}

/// Builds and installs the package, checks its types, and runs its tests, one of which executes the notebook.
pub fn test() -> Result<()> {
    build_host("plantar-cli")?;
    build_example("testkit", "simulated_insole")?;
    let environment = build()?;
    run_tool(&environment, "mypy", &[])?;
    run_tool(&environment, "pytest", &["--quiet"])
}

/// Runs a program of the environment in the folder of the package.
fn run_tool(environment: &Path, name: &str, arguments: &[&str]) -> Result<()> {
    let mut command = Command::new(setup::program(environment, name));
    command.args(arguments).current_dir(root().join("python"));
    command.env("PLANTAR", built("release/plantar"));
    command.env("PLANTAR_INSOLE", built("release/examples/simulated_insole"));
    run_command(&mut command)
}

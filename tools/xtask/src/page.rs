//! Builds and tests the page for a phone, including the library's code as WebAssembly.

use crate::bench::{self, Figures};
use crate::build::build_example;
use crate::command::{built, root, run, run_command};
use crate::setup;
use crate::test::recordings;
use anyhow::{Context, Result, ensure};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The folder of the page.
const FOLDER: &str = "tools/phone";
/// The compilation target of the page's WebAssembly.
const WASM: &str = "wasm32-unknown-unknown";

/// The folder of the built page.
pub fn dist() -> PathBuf {
    root().join(FOLDER).join("dist")
}

/// Builds the page, with the versions of npm packages that its lock file names.
pub fn build() -> Result<()> {
    setup::rust()?;
    install()?;
    let crates = ["--package", "phone-wire", "--package", "phone-identify"];
    run("cargo", &[&["build", "--locked", "--profile", "page", "--target", WASM], &crates[..]].concat())?;
    for name in ["phone_wire.wasm", "phone_identify.wasm"] {
        let wasm = built(&format!("{WASM}/page/{name}"));
        std::fs::copy(&wasm, root().join(FOLDER).join("src").join(name))
            .with_context(|| format!("cannot copy {}", wasm.display()))?;
    }
    npm(&["run", "build"])
}

/// Number of steps of each foot in the walk on which the identification on the page is compared with `plantar fit`.
const WALK_STEPS: &str = "60";

/// Checks the types of the page and runs its tests: unit tests, and tests in Chromium with a computed walk, with an emulated
/// insole and, if this machine has some, with recordings of people. `plantar` is the command line, `firmware` the firmware of
/// the emulated board. Returns the same figures as [`measure`].
pub fn test(plantar: &Path, firmware: &Path) -> Result<Figures> {
    npm(&["run", "check"])?;
    let mut command = tests(plantar)?;
    command.env("PLANTAR_FIRMWARE", std::path::absolute(firmware)?);
    if let Some(folder) = recordings() {
        command.env("PLANTAR_RECORDINGS", folder);
    }
    run_command(&mut command)?;
    figures()
}

/// Measures the identification on the page in Node.js, compares it with that of `plantar`, the command line, and measures how
/// fast the page opens in Chromium with many stored records.
pub fn measure(plantar: &Path) -> Result<Figures> {
    run_command(tests(plantar)?.args(["--", "--no-file-parallelism", "identify_core", "browser/storage"]))?;
    figures()
}

/// The folder for the figures that the page's tests measure.
fn figures_folder() -> PathBuf {
    built("page-figures")
}

/// Reads the figures that the page's tests have measured.
fn figures() -> Result<Figures> {
    let mut figures = Figures::new();
    for file in std::fs::read_dir(figures_folder())? {
        figures.extend(bench::read(&file?.path())?);
    }
    Ok(figures)
}

/// Checks that the page's example recording is the one that this build computes.
fn check_included_walk() -> Result<()> {
    let (included, computed) = (root().join(FOLDER).join("public/walk.plantar"), built("included-walk.plantar"));
    run_command(Command::new(built("release/examples/computed_walk")).arg(&computed))?;
    ensure!(
        std::fs::read(&included)? == std::fs::read(&computed)?,
        "{} is out of date: replace it by {}",
        included.display(),
        computed.display()
    );
    Ok(())
}

/// Prepares the inputs of the page's tests, and returns the command that runs the tests.
fn tests(plantar: &Path) -> Result<Command> {
    setup::chromium()?;
    let walk = std::path::absolute(built("walk.plantar"))?;
    build_example("serve", "computed_walk")?;
    run_command(Command::new(built("release/examples/computed_walk")).arg(&walk).arg(WALK_STEPS))?;
    check_included_walk()?;
    let figures = figures_folder();
    if figures.exists() {
        std::fs::remove_dir_all(&figures)?;
    }
    std::fs::create_dir_all(&figures)?;
    let mut command = Command::new("npm");
    command
        .args(["--prefix", FOLDER, "run", "test"])
        .env("PLANTAR", std::path::absolute(plantar)?)
        .env("PLANTAR_FIGURES", std::path::absolute(figures)?)
        .env("PLANTAR_WALK", walk);
    Ok(command)
}

/// Installs Node.js and the page's npm packages, if they are missing or the lock file has changed.
pub fn install() -> Result<()> {
    setup::node()?;
    let folder = root().join(FOLDER);
    let lock = std::fs::read(folder.join("package-lock.json"))?;
    let stamp = folder.join("node_modules/.installed-from");
    if std::fs::read(&stamp).ok().as_ref() != Some(&lock) {
        npm(&["ci"]).context("the page's packages come from the npm registry: check the network connection")?;
        std::fs::write(stamp, lock)?;
    }
    Ok(())
}

/// Runs npm in the page's folder.
fn npm(arguments: &[&str]) -> Result<()> {
    run("npm", &[&["--prefix", FOLDER], arguments].concat())
}

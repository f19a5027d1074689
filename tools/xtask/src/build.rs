//! Builds firmware and host programs, and writes firmware to a board.

use crate::command::{built, root, run, run_command};
use crate::{BOARDS, NRF52840, TARGET, WB55, setup};
use anyhow::{Context, Result, bail};
use std::env;
use std::path::PathBuf;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};

/// The boards that can be flashed, each with the name of its controller in probe-rs, as in `boards/<name>/.cargo/config.toml`.
pub const CHIPS: [(&str, &str); 2] = [(WB55, "STM32WB55RGVx"), (NRF52840, "nRF52840_xxAA")];

/// The path of the executable of a board's package: its firmware or its bootloader.
pub fn firmware(package: &str) -> PathBuf {
    built(&format!("{TARGET}/firmware/{package}"))
}

/// The name of the package with a board's bootloader.
pub fn bootloader(board: &str) -> String {
    format!("{board}-bootloader")
}

/// Builds firmware and bootloader of a board.
pub fn build_firmware(board: &str) -> Result<()> {
    // Within one build, cargo enables the features of a shared dependency for all packages. In a build of its own, the bootloader
    // does not contain features that only the firmware needs.
    [bootloader(board).as_str(), board].into_iter().try_for_each(|package| cargo_firmware("build", package, &[]))
}

/// The boards that are made for users: their packages refuse the public development key unless a feature allows it.
const PRODUCTS: [&str; 2] = [WB55, NRF52840];

/// Runs a cargo command such as `build` for a board's package, with the profile and the target of firmware, and with the board's
/// own settings of this profile. If `PLANTAR_UPDATE_KEY` is not set, a product accepts updates signed with the public development
/// key, and a warning is printed.
pub fn cargo_firmware(command: &str, package: &str, arguments: &[&str]) -> Result<()> {
    run_command(firmware_command(command, package)?.args(arguments))
}

/// The command that [`cargo_firmware`] runs, without further arguments.
pub fn firmware_command(command: &str, package: &str) -> Result<Command> {
    let mut cargo = Command::new("cargo");
    cargo.args([command, "--locked", "--profile", "firmware", "--target", TARGET, "--package", package]);
    // Cargo reads this file itself only in the board's folder.
    let settings = format!("boards/{package}/.cargo/config.toml");
    if root().join(&settings).is_file() {
        cargo.args(["--config", &settings]);
    }
    if package == NRF52840 {
        // The build of the radio's library generates its functions from C headers.
        cargo.envs(setup::libclang()?);
    }
    if PRODUCTS.contains(&package) && env::var_os("PLANTAR_UPDATE_KEY").is_none() {
        eprintln!(
            "warning: {package} accepts updates that anyone can sign: set PLANTAR_UPDATE_KEY before others use the insole"
        );
        cargo.args(["--features", "development-key"]);
    }
    Ok(cargo)
}

/// Set once all host programs are built.
static HOST_IS_BUILT: AtomicBool = AtomicBool::new(false);

/// Builds the host programs of a package, unless [`build_whole_host`] has already built them.
pub fn build_host(package: &str) -> Result<()> {
    if HOST_IS_BUILT.load(Ordering::Relaxed) {
        return Ok(());
    }
    run("cargo", &["build", "--locked", "--release", "--package", package])
}

/// Builds an example of a package, unless [`build_whole_host`] has already built it.
pub fn build_example(package: &str, example: &str) -> Result<()> {
    if HOST_IS_BUILT.load(Ordering::Relaxed) {
        return Ok(());
    }
    run("cargo", &["build", "--locked", "--release", "--package", package, "--example", example])
}

/// Builds all host programs and their tests at once. Separate builds would compile shared dependencies repeatedly, because each
/// build may enable other features of them.
pub fn build_whole_host() -> Result<()> {
    run("cargo", &["build", "--locked", "--release", "--all-targets"])?;
    HOST_IS_BUILT.store(true, Ordering::Relaxed);
    Ok(())
}

/// Builds the firmware of all boards and the command line.
pub fn all() -> Result<()> {
    setup::rust()?;
    BOARDS.into_iter().try_for_each(build_firmware)?;
    build_host("plantar-cli")
}

/// Writes bootloader and firmware to a board and shows its log.
pub fn flash(board: &str) -> Result<()> {
    setup::rust()?;
    if !setup::has("probe-rs") {
        bail!("probe-rs is not installed: `cargo install probe-rs-tools --locked`, see docs/hardware.md");
    }
    let (_, chip) = CHIPS.iter().find(|(name, _)| *name == board).context("no board that can be flashed")?;
    build_firmware(board)?;
    run("probe-rs", &["download", "--chip", chip, &firmware(&bootloader(board)).to_string_lossy()])?;
    run("probe-rs", &["run", "--chip", chip, &firmware(board).to_string_lossy()])
}

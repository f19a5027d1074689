//! The test suite: a quick part for use after each change, and the complete suite.

use crate::arguments::{FUZZ_MINUTES, Soak};
use crate::build::{bootloader, build_firmware, build_whole_host, cargo_firmware, firmware};
use crate::command::{built, root, run, run_command};
use crate::setup::Python;
use crate::{BOARDS, EMULATED, bench, fuzz, limits, package, page, setup};
use anyhow::Result;
use std::path::PathBuf;
use std::process::Command;

/// Arguments of Clippy that make every warning an error.
pub const DENY_WARNINGS: [&str; 3] = ["--", "--deny", "warnings"];

/// The name of the module with tests that need recordings of people. These recordings are not public.
const UNPUBLISHED: &str = "unpublished::";

/// Checks format and lints, and runs the host tests. Tests that need more than a Rust toolchain are reported as ignored.
pub fn quick() -> Result<()> {
    setup::rust()?;
    format()?;
    lint_host()?;
    run("cargo", &["test", "--locked", "--release", "--no-fail-fast"])
}

/// Runs everything that continuous integration runs.
pub fn all() -> Result<()> {
    let python = setup::all()?;
    format()?;
    deny(&["licenses", "bans", "sources"])?;
    // The bootloaders contain the library without its features, and the page contains it as WebAssembly, so these builds also
    // show that the library compiles in both ways.
    BOARDS.into_iter().try_for_each(build_firmware)?;
    lint_host()?;
    for board in BOARDS {
        cargo_firmware("clippy", board, &DENY_WARNINGS)?;
        cargo_firmware("clippy", &bootloader(board), &DENY_WARNINGS)?;
    }
    cargo_firmware("build", "minimal-board", &[])?;
    let doc = ["doc", "--locked", "--release", "--no-deps", "--package", "plantar", "--features", "firmware"];
    run_command(Command::new("cargo").args(doc).env("RUSTDOCFLAGS", "--deny warnings"))?;
    page::build()?;
    build_whole_host()?;
    let page_figures = page::test(&built("release/plantar"), &firmware(EMULATED))?;
    host_tests(&python)?;
    package::test()?;
    Soak { short: true, json: None }.run()?;
    fuzz::run(FUZZ_MINUTES)?;
    let mut figures = bench::bench_without_page()?;
    figures.extend(page_figures);
    limits::check(&figures)
}

/// Checks the format.
fn format() -> Result<()> {
    run("cargo", &["fmt", "--all", "--check"])?;
    run("cargo", &["fmt", "--manifest-path", "fuzz/Cargo.toml", "--check"])
}

/// Lints everything that is compiled for the host.
fn lint_host() -> Result<()> {
    run("cargo", &[&["clippy", "--locked", "--release", "--all-targets"], &DENY_WARNINGS[..]].concat())
}

/// Runs all tests on the host, including those that need firmware, Python, a browser or data. Tests that need recordings of
/// people are skipped if there are none on this machine.
fn host_tests(python: &Python) -> Result<()> {
    // Many tests wait for an emulated board, so more of them run at the same time than there are cores.
    let threads = 2 * std::thread::available_parallelism().map_or(1, usize::from);
    let mut command = Command::new("cargo");
    command
        .args(["test", "--locked", "--release", "--no-fail-fast", "--", "--include-ignored"])
        .env("RUST_TEST_THREADS", threads.to_string())
        .env("PLANTAR_FIRMWARE", firmware(EMULATED))
        .env("PLANTAR_FORMATS", setup::formats()?)
        .env("PLANTAR_JIKU", &python.jiku)
        .env("PLANTAR_MOTICON", &python.moticon)
        .env("PLANTAR_PYTHON", &python.interpreter)
        .env("PLANTAR_SMP", setup::management()?);
    match recordings() {
        Some(folder) => command.env("PLANTAR_RECORDINGS", folder),
        None => {
            eprintln!(
                "note: PLANTAR_RECORDINGS names no folder: tests with recordings that are not public are skipped"
            );
            command.args(["--skip", UNPUBLISHED])
        }
    };
    run_command(&mut command)
}

/// The folder with recordings of people: the folder that `PLANTAR_RECORDINGS` names, or else `shared/data` beside the repository.
pub fn recordings() -> Option<PathBuf> {
    let named = std::env::var_os("PLANTAR_RECORDINGS").map(PathBuf::from);
    named.or_else(|| Some(root().parent()?.join("shared/data")).filter(|folder| folder.is_dir()))
}

/// Checks the dependencies against these sections of deny.toml, for the workspace and for the fuzz targets' workspace.
pub fn deny(checks: &[&str]) -> Result<()> {
    let tool = setup::cargo_deny()?;
    for manifest in ["Cargo.toml", "fuzz/Cargo.toml"] {
        let mut command = Command::new(&tool);
        command.args([
            "--locked",
            "--workspace",
            "--all-features",
            "--manifest-path",
            manifest,
            "--config",
            "deny.toml",
        ]);
        run_command(command.arg("check").args(checks))?;
    }
    Ok(())
}

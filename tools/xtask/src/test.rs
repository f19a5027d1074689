//! The test suite: a quick part for use after each change, and the complete suite.

use crate::arguments::Soak;
use crate::build::{bootloader, build_firmware, build_whole_host, firmware, firmware_command};
use crate::command::{built, join, root, run, run_command};
use crate::setup::Python;
use crate::{BOARDS, EMULATED, bench, licences, limits, package, page, setup};
use anyhow::Result;
use std::path::PathBuf;
use std::process::Command;

/// Arguments of Clippy that make every warning an error.
pub const DENY_WARNINGS: [&str; 3] = ["--", "--deny", "warnings"];

/// Arguments of cargo-nextest that run the tests of all packages that are compiled for the host. By default, it skips tests that
/// are marked as ignored. It does not run the examples in the documentation: see [`documentation_tests`].
const HOST_TESTS: [&str; 4] = ["run", "--locked", "--release", "--no-fail-fast"];

/// Selects the tests that play walks in real time, by their modules. Such a test fails if it does not get processor time
/// regularly.
const IN_REAL_TIME: &str = "kind(test) and (test(/^(both_feet|cells_bluetooth|identify|update_walking)::/) \
     or (package(plantar-cli) and test(/^cells::/)))";

/// Excludes the tests in modules with the name `unpublished`. They need recordings of people, which are not public.
const PUBLISHED: &str = "not test(/unpublished::/)";

/// Checks format and lints, and runs the host tests. Tests that need more than a Rust toolchain are skipped and counted.
pub fn quick() -> Result<()> {
    setup::rust()?;
    format()?;
    lint_host()?;
    run_command(setup::nextest()?.args(HOST_TESTS))?;
    documentation_tests()
}

/// Runs everything that continuous integration runs, except the proofs with Kani.
pub fn all() -> Result<()> {
    setup::rust()?;
    format()?;
    // First, everything is installed and built, except the firmware of the other boards and the Python package, so that nothing
    // has to be built beside the tests in real time.
    let python = std::thread::scope(|scope| {
        let firmware_and_page = scope.spawn(|| build_firmware(EMULATED).and_then(|()| page::build()));
        let python = scope.spawn(setup::for_tests);
        build_host_programs()?;
        join(firmware_and_page)?;
        join(python)
    })?;
    // Nothing runs beside the tests in real time: even a build in idle time on one of two cores has delayed the emulated boards.
    tests_in_real_time(&python)?;
    // In idle time, beside the tests of the page and then all others, the firmware of the other boards is built, that of all
    // boards and the command line of the demonstration are linted, and the dependencies are checked.
    let page_figures = std::thread::scope(|scope| {
        let boards = scope.spawn(|| {
            in_idle_time()?;
            build_boards()?;
            lint_smallest_command_line()?;
            check_boards_and_dependencies()
        });
        let figures = page::test(&built("release/plantar"), &firmware(EMULATED));
        let figures = figures.and_then(|figures| other_tests(&python).map(|()| figures));
        // An error of the firmware is reported before one of these tests, because a test may have failed for the same reason.
        join(boards)?;
        figures
    })?;
    let mut figures = bench::bench_without_page()?;
    figures.extend(page_figures);
    limits::check(&figures)
}

/// Lints and builds what runs on the host, except the Python package, which is only linted, and builds the documentation of the
/// library.
fn build_host_programs() -> Result<()> {
    lint_host()?;
    let doc = ["doc", "--locked", "--release", "--no-deps", "--package", "plantar", "--features", "firmware"];
    run_command(Command::new("cargo").args(doc).env("RUSTDOCFLAGS", "--deny warnings"))?;
    build_whole_host()
}

/// Builds the firmware of the boards that are not emulated, and the minimal board.
fn build_boards() -> Result<()> {
    // The bootloaders contain the library without its features, and the page contains it as WebAssembly, so the builds also show
    // that the library compiles in both ways.
    let boards = BOARDS.into_iter().filter(|&board| board != EMULATED);
    let mut packages = boards.flat_map(|board| [bootloader(board), board.into()]).chain(["minimal-board".into()]);
    packages.try_for_each(|package: String| quiet_firmware("build", &package, &[]))
}

/// As [`crate::build::cargo_firmware`], but prints only warnings and errors of cargo: the output appears between that of the
/// tests that run at the same time.
fn quiet_firmware(command: &str, package: &str, arguments: &[&str]) -> Result<()> {
    run_command(firmware_command(command, package)?.arg("--quiet").args(arguments))
}

/// Lints the firmware of all boards, the minimal board and the program that checks a signature, and checks the dependencies:
/// their licences, the texts of these and their sources, and that none is banned.
fn check_boards_and_dependencies() -> Result<()> {
    let boards = BOARDS.into_iter().flat_map(|board| [board.to_owned(), bootloader(board)]);
    let mut packages = boards.chain(["minimal-board", "signature-check"].map(String::from));
    packages.try_for_each(|package| quiet_firmware("clippy", &package, &DENY_WARNINGS))?;
    deny(&["licenses", "bans", "sources"])?;
    licences::write(&built("licences"))
}

/// On Linux, lets this thread, and the programs that it starts, run only while a processor has nothing else to do: they delay
/// other programs less than with the lowest priority. Changes nothing on other systems, where all threads would be affected.
fn in_idle_time() -> Result<()> {
    #[cfg(target_os = "linux")]
    {
        use thread_priority::{NormalThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy, unix};
        let policy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Idle);
        unix::set_thread_priority_and_policy(unix::thread_native_id(), ThreadPriority::Min, policy)
            .map_err(|error| anyhow::anyhow!("the priority of a thread cannot be lowered: {error:?}"))?;
    }
    Ok(())
}

/// Checks the format of all Rust sources with rustfmt.
fn format() -> Result<()> {
    run("cargo", &["fmt", "--all", "--check"])?;
    run("cargo", &["fmt", "--manifest-path", "fuzz/Cargo.toml", "--check"])
}

/// Lints the command line without its optional parts, as `cargo xtask demo` builds it.
fn lint_smallest_command_line() -> Result<()> {
    let options = ["clippy", "--locked", "--release", "--package", "plantar-cli", "--no-default-features"];
    run_command(Command::new("cargo").args(options).args(DENY_WARNINGS))
}

/// The packages besides those of [`BOARDS`] that compile only for a board.
const BOARD_ONLY_PACKAGES: [&str; 3] = ["cortex-m-platform", "minimal-board", "signature-check"];

/// Lints all packages of the workspace that are compiled for the host.
fn lint_host() -> Result<()> {
    let mut command = Command::new("cargo");
    command.args(["clippy", "--locked", "--release", "--all-targets", "--workspace"]);
    let boards = BOARDS.into_iter().chain(BOARD_ONLY_PACKAGES).map(String::from).chain(BOARDS.map(bootloader));
    for package in boards {
        command.args(["--exclude", &package]);
    }
    run_command(command.args(DENY_WARNINGS))
}

/// Runs the tests with walks that are played in real time, except those of the page.
fn tests_in_real_time(python: &Python) -> Result<()> {
    // Two at a time, because on a slow computer more of them would cause missed scans and timeouts.
    selected_tests(python, IN_REAL_TIME, 2)
}

/// Runs all other host tests, and beside them those of the Python package and a short endurance test.
fn other_tests(python: &Python) -> Result<()> {
    std::thread::scope(|scope| {
        let package = scope.spawn(|| package::test().and_then(|()| Soak { short: true, json: None }.run()));
        // Many tests wait for an emulated board, so more of them run at the same time than there are cores.
        let threads = 3 * std::thread::available_parallelism().map_or(1, usize::from);
        selected_tests(python, &format!("not ({IN_REAL_TIME})"), threads)?;
        documentation_tests()?;
        join(package)
    })
}

/// Runs the selected host tests, ignored ones included, `threads` at the same time. Tests that need recordings of people are
/// skipped if there are none on this machine.
fn selected_tests(python: &Python, selected: &str, threads: usize) -> Result<()> {
    let recordings = recordings();
    let selected = match &recordings {
        Some(_) => selected.to_owned(),
        None => {
            eprintln!(
                "note: PLANTAR_RECORDINGS is not set, and there is no folder shared/data beside the repository: tests with \
                 recordings of people are skipped"
            );
            format!("({selected}) and {PUBLISHED}")
        }
    };
    let mut command = setup::nextest()?;
    command
        .args(HOST_TESTS)
        .args(["--run-ignored", "all", "--test-threads", &threads.to_string(), "--filterset", &selected])
        .env("PLANTAR_FIRMWARE", std::path::absolute(firmware(EMULATED))?)
        .env("PLANTAR_FORMATS", setup::formats()?)
        .env("PLANTAR_JIKU", setup::sample()?)
        .env("PLANTAR_MOTICON", &python.moticon)
        .env("PLANTAR_PYTHON", &python.interpreter)
        .env("PLANTAR_SMP", setup::management()?);
    if let Some(folder) = recordings {
        command.env("PLANTAR_RECORDINGS", folder);
    }
    run_command(&mut command)
}

/// Runs the examples in the documentation.
fn documentation_tests() -> Result<()> {
    run("cargo", &["test", "--locked", "--release", "--no-fail-fast", "--doc"])
}

/// The folder with recordings of people: the folder that `PLANTAR_RECORDINGS` names, or else `shared/data` beside the repository.
pub fn recordings() -> Option<PathBuf> {
    // Programs that use the folder run in other folders.
    let named = std::env::var_os("PLANTAR_RECORDINGS").and_then(|folder| std::path::absolute(folder).ok());
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

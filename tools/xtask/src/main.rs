//! Set-up, demonstration, tests, benchmarks and sizes, each one command.

mod explain;
mod fuzz;
mod image;
mod page;
mod setup;
mod size;

use anyhow::{Context, Result, bail};
use clap::{Args, Parser, Subcommand};
use serde_json::{Map, Value};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

/// What one does with this repository.
#[derive(Parser)]
#[command(bin_name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Install what is missing: Rust targets, QEMU, Node.js, Chromium, a C++ compiler, private cargo-fuzz and cargo-deny, a private Python with NumPy, SciPy and the sample walk.
    Setup,
    /// Build the firmware of both boards and the command line.
    Build,
    /// Build the page for a phone to tools/phone/dist.
    Page,
    /// Fit a walker's steps, push the parameters to the firmware in QEMU and play other steps through it, live in the terminal;
    /// then a table of the steps; then serve the page with the same walk.
    Demo(Demo),
    /// Run everything that continuous integration runs.
    Test {
        /// Only what a developer runs after each change: format, lints, and the tests on the host, scenarios included.
        #[arg(long)]
        quick: bool,
    },
    /// Feed every parser with arbitrary bytes; a finding ends it and is named.
    Fuzz(Fuzz),
    /// Let insoles endure: power that fails in every write, bit errors on the cable, a day of walking. About an hour.
    Soak(Soak),
    /// Compare what is depended on with RustSec's advisories, which are fetched from their repository.
    Advisories,
    /// Measure instructions a frame, accuracy, bytes, replay speed, identification and sizes.
    Bench(Json),
    /// Measure flash and RAM of both firmware binaries.
    Size(Json),
    /// Say where in the source an insole was that says "panic after ... at ..."; the firmware must be the one that was built last.
    Explain(Explain),
    /// Write bootloader and firmware to an STM32WB55 on a debug probe and show the log (needs probe-rs).
    Flash,
    /// Build the firmware of a board and sign it, for `plantar update`.
    Image(Image),
    /// Make a key to sign firmware with, and say how to build firmware that takes it.
    Key {
        /// The secret half goes to this file, which must not be there yet.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
}

#[derive(Args)]
struct Demo {
    /// Play this recording instead of the sample walk.
    #[arg(long, value_name = "FILE")]
    recording: Option<PathBuf>,
    /// real, or max: as fast as the emulator can.
    #[arg(long, default_value = "real", value_parser = ["real", "max"])]
    speed: String,
    /// End after this many steps.
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
    /// Write the steps and what became of the live frames to this file; the page is not served then.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// End after the table: neither build nor serve the page. As without a terminal.
    #[arg(long)]
    no_page: bool,
}

#[derive(Args)]
struct Fuzz {
    /// For all targets together.
    #[arg(long, value_name = "N", default_value_t = FUZZ_MINUTES)]
    minutes: f64,
}

#[derive(Args)]
struct Soak {
    /// Some of each, for minutes.
    #[arg(long)]
    short: bool,
    /// Also write the figures to this file, one flat object.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Args)]
struct Json {
    /// Also write the figures to this file, one flat object.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Args)]
struct Explain {
    /// The board that said it.
    #[arg(value_parser = BOARDS)]
    board: String,
    /// What it said, or the addresses alone, innermost call first.
    #[arg(required = true)]
    said: Vec<String>,
}

#[derive(Args)]
struct Image {
    #[arg(value_parser = BOARDS)]
    board: String,
    /// The secret key; without one the key for development, which everybody knows.
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// What a test spends on fuzzing.
const FUZZ_MINUTES: f64 = 2.0;

/// The device's target.
pub const TARGET: &str = "thumbv7em-none-eabihf";
/// The controller of the reference board in probe-rs, as in `boards/wb55/.cargo/config.toml`.
const CHIP: &str = "STM32WB55RGVx";
/// The boards: the package and binary `<board>` in `boards/<board>`, with the bootloader `<board>-bootloader`.
pub const BOARDS: [&str; 2] = [EMULATED, "wb55"];
/// The board that the host runs.
const EMULATED: &str = "emulated";

fn main() -> ExitCode {
    let done = match Arguments::parse().task {
        Task::Setup => setup::all().map(drop),
        Task::Build => build(),
        Task::Page => page::build(),
        Task::Demo(demo) => demo.run(),
        Task::Test { quick: true } => quick_test(),
        Task::Test { quick: false } => test(),
        Task::Fuzz(fuzz) => fuzz::run(fuzz.minutes),
        Task::Soak(soak) => soak.run(),
        Task::Advisories => deny(&["advisories"]),
        Task::Bench(to) => bench().and_then(|figures| to.write(figures)),
        Task::Size(to) => sizes().and_then(|figures| to.write(figures)),
        Task::Explain(fault) => explain::run(&firmware(&fault.board), &fault.said.join(" ")),
        Task::Flash => flash(),
        Task::Image(image) => image.make(),
        Task::Key { out } => image::make_key(&out),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// The repository.
pub fn root() -> PathBuf {
    // This package is two folders below.
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap_or(Path::new(".")).into()
}

/// Runs a command in the repository and fails with it.
pub fn run(program: &str, arguments: &[&str]) -> Result<()> {
    run_command(Command::new(program).args(arguments))
}

fn run_command(command: &mut Command) -> Result<()> {
    let words: Vec<_> = std::iter::once(command.get_program()).chain(command.get_args()).collect();
    let line = words.iter().map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ");
    eprintln!("> {line}");
    let status = command.current_dir(root()).status().with_context(|| format!("cannot run {line}"))?;
    if !status.success() {
        bail!("{line} failed");
    }
    Ok(())
}

fn built(path: &str) -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from);
    target.join(path)
}

fn firmware(board: &str) -> PathBuf {
    built(&format!("{TARGET}/firmware/{board}"))
}

fn bootloader(board: &str) -> String {
    format!("{board}-bootloader")
}

/// Builds application and bootloader.
fn build_firmware(board: &str) -> Result<()> {
    [bootloader(board).as_str(), board].into_iter().try_for_each(|package| cargo_firmware("build", package, &[]))
}

fn cargo_firmware(command: &str, package: &str, arguments: &[&str]) -> Result<()> {
    let common = [command, "--locked", "--profile", "firmware", "--target", TARGET, "--package", package];
    run("cargo", &[&common, arguments].concat())
}

fn build_host(package: &str) -> Result<()> {
    run("cargo", &["build", "--locked", "--release", "--package", package])
}

fn build() -> Result<()> {
    setup::rust()?;
    for board in BOARDS {
        build_firmware(board)?;
    }
    build_host("plantar-cli")
}

impl Demo {
    fn run(&self) -> Result<()> {
        setup::rust()?;
        setup::qemu()?;
        build_firmware(EMULATED)?;
        build_host("plantar-cli")?;
        let with_page = !self.no_page && self.json.is_none() && std::io::stdout().is_terminal();
        if with_page {
            page::build()?;
        }
        let plantar = built("release/plantar");
        let mut steps = self.steps;
        let (walk, parameters) = match &self.recording {
            Some(recording) => (std::path::absolute(recording)?, None),
            None => {
                let walk = sample_walk(&plantar)?;
                let parameters = fit_walk(&plantar, &walk)?;
                steps = Some(steps.unwrap_or(PLAYED_STEPS).min(PLAYED_STEPS));
                (walk, Some(parameters))
            }
        };
        let worn = |command: &mut Command| {
            command.arg("--firmware").arg(firmware(EMULATED));
            if let Some(parameters) = &parameters {
                command.arg("--params").arg(parameters);
            }
        };
        let mut command = Command::new(&plantar);
        command.arg("emulate").arg(&walk).args(["--speed", &self.speed]);
        worn(&mut command);
        if let Some(steps) = steps {
            command.args(["--steps", &steps.to_string()]);
        }
        if let Some(json) = &self.json {
            command.arg("--json").arg(std::path::absolute(json)?);
        }
        run_command(&mut command)?;
        if self.recording.is_none() {
            println!(
                "The insole's parameters were fitted to steps {FITTED_STEPS} of this walker; the errors above are of steps that the \
                 fit has not seen.\nThe fit's report: {}",
                report().display()
            );
        }
        if with_page {
            println!("The same walk in the page for a phone:");
            let mut command = Command::new(&plantar);
            command.arg("serve").arg("--emulate").arg(&walk);
            worn(&mut command);
            run_command(command.arg("--page").arg(page::dist()))?;
        }
        Ok(())
    }
}

/// Trials of the sample walk: the first are played, some fifteen seconds, and parameters are fitted to the others.
const SAMPLE_TRIALS: &str = "36";
const PLAYED_STEPS: usize = 12;
const FITTED_STEPS: &str = "12-35";

/// One walker's steps as a recording for the device.
fn sample_walk(plantar: &Path) -> Result<PathBuf> {
    let data = setup::python()?.jiku;
    let walk = setup::cache().join("walk.parquet");
    let mut command = Command::new(plantar);
    command.args(["import", "jiku", "--walker", "0", "--trials", SAMPLE_TRIALS, "--rate", "100", "--cells", "240"]);
    run_command(command.arg("--data").arg(data).arg("--out").arg(&walk))?;
    Ok(walk)
}

/// The walker's own parameters, and a report of how they were found.
fn fit_walk(plantar: &Path, walk: &Path) -> Result<PathBuf> {
    let parameters = setup::cache().join("params.toml");
    let mut command = Command::new(plantar);
    command.arg("fit").arg(walk).args(["--steps", FITTED_STEPS, "--contact-full", "150", "--participant", "walker 0"]);
    run_command(command.arg("--out").arg(&parameters).arg("--report").arg(report()))?;
    Ok(parameters)
}

fn report() -> PathBuf {
    setup::cache().join("report.html")
}

/// Runs these checks of deny.toml, for the workspace and for the fuzz targets, which have a lock file of their own.
fn deny(checks: &[&str]) -> Result<()> {
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

/// Format, lints, and the tests that need neither firmware nor data.
fn quick_test() -> Result<()> {
    setup::rust()?;
    run("cargo", &["fmt", "--all", "--check"])?;
    lint()?;
    run("cargo", &["test", "--locked", "--release", "--no-fail-fast"])
}

/// Everything that compiles for a host, without warnings.
fn lint() -> Result<()> {
    run("cargo", &["clippy", "--locked", "--release", "--all-targets", "--", "--deny", "warnings"])
}

fn test() -> Result<()> {
    let python = setup::all()?;
    run("cargo", &["fmt", "--all", "--check"])?;
    run("cargo", &["fmt", "--manifest-path", "fuzz/Cargo.toml", "--check"])?;
    deny(&["licenses", "bans", "sources"])?;
    for board in BOARDS {
        build_firmware(board)?;
    }
    lint()?;
    let deny = ["--", "--deny", "warnings"];
    for board in BOARDS {
        cargo_firmware("clippy", board, &deny)?;
        cargo_firmware("clippy", &bootloader(board), &deny)?;
    }
    run("cargo", &["check", "--locked", "--release", "--package", "minimal-board", "--target", TARGET])?;
    let doc = ["doc", "--locked", "--release", "--no-deps", "--package", "plantar", "--features", "firmware"];
    run_command(Command::new("cargo").args(doc).env("RUSTDOCFLAGS", "--deny warnings"))?;
    for target in [TARGET, "wasm32-unknown-unknown"] {
        run("cargo", &["check", "--locked", "--release", "--package", "plantar", "--lib", "--target", target])?;
    }
    page::build()?;
    build_host("plantar-cli")?;
    page::test(&built("release/plantar"), &firmware(EMULATED))?;
    run_command(
        Command::new("cargo")
            // What a test says of itself, such as that it was skipped, is shown.
            .args(["test", "--locked", "--release", "--no-fail-fast", "--", "--show-output"])
            .env("PLANTAR_FIRMWARE", firmware(EMULATED))
            .env("PLANTAR_JIKU", &python.jiku)
            .env("PLANTAR_PYTHON", &python.interpreter),
    )?;
    Soak { short: true, json: None }.run()?;
    fuzz::run(FUZZ_MINUTES)?;
    check_limits(&bench()?)
}

/// Figures that are the same on every machine, and the least and most each may be.
const LIMITS: [(&str, f64, f64); 24] = [
    ("frame_instructions", 0.0, 10_000.0),
    ("device_vs_host_force_rel", 0.0, 1e-4),
    ("device_vs_host_area_rel", 0.0, 1e-4),
    ("live_frame_bytes", 0.0, 90.0),
    ("step_record_bytes", 0.0, 320.0),
    ("flash_bytes.emulated", 0.0, 368_640.0),
    ("flash_bytes.wb55", 0.0, 368_640.0),
    ("flash_bytes.emulated-bootloader", 0.0, 32_768.0),
    ("flash_bytes.wb55-bootloader", 0.0, 32_768.0),
    ("ram_bytes.emulated", 0.0, 98_304.0),
    ("ram_bytes.wb55", 0.0, 98_304.0),
    ("fit_evaluations", 0.0, 600.0),
    ("fit_exact_nrmse", 0.0, 0.01),
    ("fit_exact_parameters", 0.0, 1e-4),
    ("fit_coverage", 0.90, 0.99),
    ("nrmse.heel.predicted", 0.0, 13.6),
    ("nrmse.posterior_midfoot.predicted", 0.0, 23.5),
    ("nrmse.anterior_midfoot.predicted", 0.0, 23.5),
    ("nrmse.metatarsals_12.predicted", 0.0, 26.5),
    ("nrmse.metatarsals_35.predicted", 0.0, 27.2),
    ("nrmse.hallux.predicted", 0.0, 18.4),
    ("nrmse.toe_2.predicted", 0.0, 21.0),
    ("nrmse.toes_35.predicted", 0.0, 19.5),
    ("nrmse.mean.less", 15.0, 100.0),
];

fn check_limits(figures: &Map<String, Value>) -> Result<()> {
    for (key, least, most) in LIMITS {
        let value = figures.get(key).and_then(Value::as_f64).with_context(|| format!("{key} was not measured"))?;
        if !(least..=most).contains(&value) {
            bail!("{key} is {value}, {least} to {most} is allowed");
        }
    }
    Ok(())
}

fn bench() -> Result<Map<String, Value>> {
    setup::rust()?;
    setup::qemu()?;
    let python = setup::python()?;
    let mut figures = sizes()?;
    let json = built("bench.json");
    build_host("plantar-cli")?;
    let plantar = built("release/plantar");
    run_bench(&[
        ("--python", &python.interpreter),
        ("--jiku", &python.jiku),
        ("--plantar", &plantar),
        ("--json", &json),
    ])?;
    let measured: Map<String, Value> = serde_json::from_str(&std::fs::read_to_string(json)?)?;
    figures.extend(measured);
    Ok(figures)
}

fn run_bench(options: &[(&str, &Path)]) -> Result<()> {
    build_host("bench")?;
    let mut command = Command::new(built("release/bench"));
    command.arg("--firmware").arg(firmware(EMULATED));
    for (name, path) in options {
        command.arg(name).arg(path);
    }
    run_command(&mut command)
}

/// Flash and RAM of both boards. RAM is what is reserved plus the deepest stack that the emulated board used in a walk; the
/// real board runs the same code above its drivers, so the same stack is taken for it.
fn sizes() -> Result<Map<String, Value>> {
    setup::rust()?;
    setup::qemu()?;
    for board in BOARDS {
        build_firmware(board)?;
    }
    let json = built("stack.json");
    run_bench(&[("--stack-json", &json)])?;
    let stack: Map<String, Value> = serde_json::from_str(&std::fs::read_to_string(json)?)?;
    let stack_bytes = stack.get("stack_bytes").and_then(Value::as_u64).context("the stack was not measured")?;
    let mut figures = Map::new();
    let mut add = |key: String, bytes: u64, meaning: &str| {
        println!("{key:<28} {bytes:>14}  {meaning}");
        figures.insert(key, bytes.into());
    };
    for board in BOARDS {
        let size = size::of(&firmware(board))?;
        add(format!("flash_bytes.{board}"), size.flash_bytes, "of 368,640: code, constants and initial values");
        add(format!("ram_bytes.{board}"), size.ram_bytes + stack_bytes, "of 98,304: static and deepest stack");
    }
    for board in BOARDS.map(bootloader) {
        let size = size::of(&firmware(&board))?;
        add(format!("flash_bytes.{board}"), size.flash_bytes, "of 32,768: the bootloader");
    }
    add("stack_bytes".into(), stack_bytes, "deepest stack of the emulated board in a walk");
    Ok(figures)
}

impl Image {
    fn make(&self) -> Result<()> {
        setup::rust()?;
        let key = image::key(self.key.as_deref())?;
        build_firmware(&self.board)?;
        image::make(&firmware(&self.board), &key, &self.out)
    }
}

impl Soak {
    fn run(&self) -> Result<()> {
        setup::rust()?;
        setup::qemu()?;
        build_firmware(EMULATED)?;
        build_host("bench")?;
        let mut command = Command::new(built("release/soak"));
        command.arg("--firmware").arg(firmware(EMULATED));
        if self.short {
            command.arg("--short");
        }
        if let Some(path) = &self.json {
            command.arg("--json").arg(path);
        }
        run_command(&mut command)
    }
}

impl Json {
    fn write(&self, figures: Map<String, Value>) -> Result<()> {
        let Some(path) = &self.json else { return Ok(()) };
        let text = serde_json::to_string_pretty(&figures)? + "\n";
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
    }
}

fn flash() -> Result<()> {
    setup::rust()?;
    if !setup::has("probe-rs") {
        bail!("probe-rs is not installed: `cargo install probe-rs-tools --locked`, see docs/hardware.md");
    }
    cargo_firmware("build", &bootloader("wb55"), &[])?;
    run("probe-rs", &["download", "--chip", CHIP, &firmware(&bootloader("wb55")).to_string_lossy()])?;
    cargo_firmware("build", "wb55", &[])?;
    run("probe-rs", &["run", "--chip", CHIP, &firmware("wb55").to_string_lossy()])
}

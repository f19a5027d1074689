//! Runs the benchmarks and the endurance test, and measures the sizes of the firmware.

use crate::arguments::{FiguresFile, Soak};
use crate::build::{bootloader, build_firmware, build_host, firmware};
use crate::command::{built, run_command};
use crate::test::recordings;
use crate::{BOARDS, EMULATED, image, package, page, setup};
use anyhow::{Context, Result};
use serde_json::{Map, Value};
use std::path::Path;
use std::process::Command;

/// Figures by their keys.
pub type Figures = Map<String, Value>;

/// Measures the sizes, runs all benchmarks and measures the page.
pub fn bench() -> Result<Figures> {
    let mut figures = bench_without_page()?;
    page::build()?;
    figures.extend(page::measure(&built("release/plantar"))?);
    Ok(figures)
}

/// Measures the sizes and runs all benchmarks but those of the page.
pub fn bench_without_page() -> Result<Figures> {
    setup::rust()?;
    setup::qemu()?;
    let python = setup::python()?;
    let sample = setup::sample()?;
    let mut figures = sizes()?;
    let json = built("bench.json");
    build_host("plantar-cli")?;
    let plantar = built("release/plantar");
    let folder = recordings();
    let package_python = setup::program(&package::build()?, "python");
    let options: [(&str, &Path); 6] = [
        ("--python", &python.interpreter),
        ("--package-python", &package_python),
        ("--jiku", &sample),
        ("--moticon", &python.moticon),
        ("--plantar", &plantar),
        ("--json", &json),
    ];
    let recordings = folder.as_deref().map(|folder| ("--recordings", folder));
    run_bench(&options.into_iter().chain(recordings).collect::<Vec<_>>())?;
    figures.extend(read(&json)?);
    Ok(figures)
}

/// Builds and runs the program `bench` with these options and paths.
fn run_bench(options: &[(&str, &Path)]) -> Result<()> {
    build_host("bench")?;
    let mut command = Command::new(built("release/bench"));
    command.arg("--firmware").arg(firmware(EMULATED));
    for (name, path) in options {
        command.arg(name).arg(path);
    }
    run_command(&mut command)
}

/// Stack that a pairing may use, bytes. It is the deepest one, and depends on the moments of interrupts: 9,200 to 9,416 bytes were
/// measured on the emulated board. The test `bluetooth::a_bonded_phone_receives_every_frame_and_step_of_a_walk` fails if a pairing
/// uses more.
const PAIRING_STACK_BYTES: u64 = 9_728;

/// Measures flash and RAM of all boards. RAM is the static memory plus the stack in a walk, which is measured on the emulated
/// board, or in a pairing, whichever is deeper. The stack of the other boards is not measured: apart from their drivers, they run
/// the same code, so the same stack is assumed.
pub fn sizes() -> Result<Figures> {
    setup::rust()?;
    setup::qemu()?;
    BOARDS.into_iter().try_for_each(build_firmware)?;
    let json = built("stack.json");
    run_bench(&[("--stack-json", &json)])?;
    let stack_bytes = read(&json)?.get("stack_bytes").and_then(Value::as_u64);
    let stack_bytes = stack_bytes.with_context(|| format!("{} has no stack_bytes", json.display()))?;
    let mut figures = Map::new();
    let mut add = |key: String, bytes: u64, meaning: &str| {
        println!("{key:<28} {bytes:>14}  {meaning}");
        figures.insert(key, bytes.into());
    };
    for board in BOARDS {
        let size = image::size(board)?;
        add(
            format!("flash_bytes.{board}"),
            size.flash_bytes,
            "limit 368,640: code, constants and initial values, bytes",
        );
        add(
            format!("ram_bytes.{board}"),
            size.ram_bytes + stack_bytes.max(PAIRING_STACK_BYTES),
            "limit 98,304: static memory and deepest stack, pairing included, bytes",
        );
    }
    for board in BOARDS.map(bootloader) {
        let size = image::size(&board)?;
        add(format!("flash_bytes.{board}"), size.flash_bytes, "limit 32,768: the bootloader, bytes");
    }
    add("stack_bytes".into(), stack_bytes, "deepest stack of the emulated board in a walk, bytes");
    Ok(figures)
}

/// Reads figures from a file.
pub fn read(json: &Path) -> Result<Figures> {
    let text = std::fs::read_to_string(json).with_context(|| format!("cannot read {}", json.display()))?;
    Ok(serde_json::from_str(&text)?)
}

impl FiguresFile {
    /// Writes the figures to the file, if the option is given.
    pub fn write(&self, figures: &Figures) -> Result<()> {
        let Some(path) = &self.json else { return Ok(()) };
        let text = serde_json::to_string_pretty(figures)? + "\n";
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
    }
}

impl Soak {
    /// Runs the endurance test.
    pub fn run(&self) -> Result<()> {
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
            command.arg("--json").arg(std::path::absolute(path)?);
        }
        run_command(&mut command)
    }
}

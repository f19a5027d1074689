//! Makes signed firmware images and keys, and inspects firmware files, with the program `firmware-image`.

use crate::arguments::Image;
use crate::build::{build_firmware, build_host, firmware};
use crate::command::{built, run_command};
use crate::setup;
use anyhow::{Context, Result, bail};
use std::path::Path;
use std::process::Command;

impl Image {
    /// Builds and signs the firmware of the board.
    pub fn make(&self) -> Result<()> {
        setup::rust()?;
        build_firmware(&self.board)?;
        let mut command = firmware_image("sign")?;
        command.arg(firmware(&self.board)).arg("--out").arg(std::path::absolute(&self.out)?);
        if let Some(key) = &self.key {
            command.arg("--key").arg(std::path::absolute(key)?);
        }
        run_command(&mut command)
    }
}

/// Makes a key for signing firmware.
pub fn make_key(out: &Path) -> Result<()> {
    run_command(firmware_image("key")?.arg("--out").arg(std::path::absolute(out)?))
}

/// Prints the source locations of the calls in an insole's crash report.
pub fn explain(board: &str, report: &str) -> Result<()> {
    run_command(firmware_image("explain")?.arg(firmware(board)).arg(report))
}

/// The memory that a firmware needs.
pub struct Size {
    /// Code, constants and the initial values of variables, bytes.
    pub flash_bytes: u64,
    /// Variables without the stack, bytes.
    pub ram_bytes: u64,
}

/// Measures the memory that the firmware of a board's package needs.
pub fn size(package: &str) -> Result<Size> {
    let output = firmware_image("size")?.arg(firmware(package)).output()?;
    if !output.status.success() {
        bail!("{}", String::from_utf8_lossy(&output.stderr));
    }
    let text = String::from_utf8_lossy(&output.stdout);
    let numbers: Vec<u64> = text.split_whitespace().filter_map(|number| number.parse().ok()).collect();
    let &[flash_bytes, ram_bytes] = &numbers[..] else { bail!("firmware-image did not print two sizes: {text}") };
    Ok(Size { flash_bytes, ram_bytes })
}

/// The bytes that a firmware file loads into flash. They are also written to the file `out`.
pub fn segments(firmware: &Path, out: &Path) -> Result<Vec<u8>> {
    run_command(firmware_image("segments")?.arg(firmware).arg("--out").arg(out))?;
    Ok(std::fs::read(out)?)
}

/// Builds the program `firmware-image`. Returns a command that runs the program with the subcommand `command`.
fn firmware_image(command: &str) -> Result<Command> {
    build_host("firmware-image").context("the program firmware-image cannot be built")?;
    let mut program = Command::new(built("release/firmware-image"));
    program.arg(command);
    Ok(program)
}

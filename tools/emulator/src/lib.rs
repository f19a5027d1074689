//! Runs the emulated board in QEMU: starts it, plays a walk into its sensor matrix, and provides its serial link.
//!
//! The *sensor plant* is the simulation of the sensor matrix in this process. [`emulation`] describes the protocol between the
//! board and the plant.

mod faults;
mod link;
#[cfg(feature = "log")]
mod log;
mod plant;
mod port;
mod recorded;

pub use faults::{FAULT_EXAMPLES, Faulty, ParseFaultError, SensorFault};
pub use link::Link;
#[cfg(feature = "log")]
pub use log::{LogEntry, LogError};
pub use plant::{Plant, Scan, Walk};
pub use recorded::{Joined, Looped, Recorded};

use emulation::{
    ACTIVE_IMAGE, EmulatorConfig, FLASH_BYTES, FLASH_FILE, MATRIX_FILE, SETUP_FILE, SWAPPED, SWAPPED_FILE,
};
use plantar::pipeline::setup::{DEVICE_CELLS, SetupCell};
use plantar::storage::flash_map::{ACTIVE, STM32_FLASH};
use port::{Port, START_TIMEOUT};
use std::fs::File;
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use tempfile::TempDir;
use thiserror::Error;

/// QEMU's name for a board with an STM32F405.
const MACHINE: &str = "netduinoplus2";
/// File name of the bootloader, in the folder of the firmware.
const BOOTLOADER: &str = "emulated-bootloader";
/// Name of the file with the image that QEMU loads into the controller's flash, in the emulator's directory.
const ACTIVE_FILE: &str = "active.bin";
/// Name of the file with the log, in the emulator's directory.
const LOG_FILE: &str = "log.defmt";
/// Name of the serial port of the link.
const LINK: &str = "link";

/// How the board's time passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Time {
    /// Real time: the board's own clock paces the scans.
    Real,
    /// As fast as possible: the plant paces the scans.
    Fastest,
    /// As [`Time::Fastest`], but each instruction takes one nanosecond of the board's time, so that instructions can be counted.
    Counted,
}

/// An error of the emulation.
#[derive(Debug, Error)]
pub enum Error {
    /// QEMU is not installed.
    #[error(
        "qemu-system-arm not found: install it (Debian and Ubuntu: apt-get install qemu-system-arm; Fedora: dnf \
         install qemu-system-arm; macOS: brew install qemu)"
    )]
    NoQemu,
    /// The firmware file is missing.
    #[error("no firmware at {0}: build it with `cargo xtask build`, or name it with --firmware")]
    NoFirmware(PathBuf),
    /// The bootloader is missing.
    #[error("no bootloader at {0}, which is expected beside the firmware: build both with `cargo xtask build`")]
    NoBootloader(PathBuf),
    /// QEMU exited before it connected.
    #[error("QEMU exited before the board started: {0}")]
    Exited(String),
    /// QEMU did not connect in time.
    #[error("QEMU did not connect within {} s: try again when this computer is less busy", START_TIMEOUT.as_secs())]
    Timeout,
    /// The firmware file is not an executable of the board.
    #[error(transparent)]
    Image(#[from] firmware_image::Error),
    /// The log cannot be decoded.
    #[cfg(feature = "log")]
    #[error(transparent)]
    Log(#[from] LogError),
    /// An error of a file or a serial port of the emulator. Both are in the folder for temporary files, except where a serial
    /// port is a socket.
    #[error(
        "the emulation failed: {0}; check the free space and the permissions of {folder}, the folder for temporary \
         files",
        folder = std::env::temp_dir().display()
    )]
    Io(#[from] io::Error),
}

/// The hardware around the controller.
#[derive(Clone, Debug, Default)]
pub struct Hardware {
    /// Address at which a Bluetooth controller listens for HCI (H4); `None` for a board without radio.
    pub hci: Option<SocketAddr>,
    /// The contents of the flash chip, as [`Board::flash`] returned them before this start; `None` for a new chip. If they
    /// include an active image, for example one that was swapped in, this image runs instead of the firmware file.
    pub flash: Option<Vec<u8>>,
    /// True if the bootloader swapped images before this start: the result of [`Board::wait`].
    pub swapped: bool,
}

/// A running board, which is switched off when this value is dropped. On Linux, it is also switched off when the thread ends that
/// started it.
pub struct Board {
    qemu: Qemu,
    plant: Plant,
    link: Link,
    // The last field, so that it is dropped after QEMU and the plant, which use it.
    directory: TempDir,
}

impl Board {
    /// Starts the bootloader in the folder of `firmware`, which starts `firmware`, with this configuration and these cells, and
    /// with `walk` in the sensor matrix.
    ///
    /// # Errors
    /// See [`enum@Error`].
    pub fn start(
        firmware: &Path,
        config: &EmulatorConfig,
        cells: &[SetupCell],
        time: Time,
        walk: impl Walk,
    ) -> Result<Self, Error> {
        Self::start_with(firmware, config, cells, time, walk, &Hardware::default())
    }

    /// As [`Board::start`], with this hardware around the controller.
    ///
    /// # Errors
    /// See [`enum@Error`].
    pub fn start_with(
        firmware: &Path,
        config: &EmulatorConfig,
        cells: &[SetupCell],
        time: Time,
        walk: impl Walk,
        hardware: &Hardware,
    ) -> Result<Self, Error> {
        let config = EmulatorConfig { is_paced: time != Time::Real, ..*config };
        let mut setup = postcard::to_stdvec(&config).map_err(io::Error::other)?;
        for cell in cells {
            setup = postcard::to_extend(cell, setup).map_err(io::Error::other)?;
        }
        Self::boot(firmware, Some(&setup), cells.len(), time, walk, hardware)
    }

    /// Starts `firmware` without a set-up file: in real time, with the built-in configuration.
    ///
    /// # Errors
    /// See [`enum@Error`].
    pub fn start_without_set_up(firmware: &Path, walk: impl Walk) -> Result<Self, Error> {
        Self::boot(firmware, None, DEVICE_CELLS, Time::Real, walk, &Hardware::default())
    }

    fn boot(
        firmware: &Path,
        setup: Option<&[u8]>,
        cells: usize,
        time: Time,
        walk: impl Walk,
        hardware: &Hardware,
    ) -> Result<Self, Error> {
        let bootloader = firmware.with_file_name(BOOTLOADER);
        if !firmware.is_file() {
            return Err(Error::NoFirmware(firmware.into()));
        }
        if !bootloader.is_file() {
            return Err(Error::NoBootloader(bootloader));
        }
        let directory = tempfile::tempdir()?;
        let file = |name: &std::ffi::CStr| directory.path().join(name.to_string_lossy().as_ref());
        if let Some(setup) = setup {
            std::fs::write(file(SETUP_FILE), setup)?;
        }
        std::fs::write(file(MATRIX_FILE), vec![0; 2 * cells])?;

        let mut flash = hardware.flash.clone().unwrap_or_else(|| vec![0xff; FLASH_BYTES]);
        let active = &mut flash[ACTIVE_IMAGE.start as usize..ACTIVE_IMAGE.end as usize];
        if active.iter().all(|byte| *byte == 0xff) {
            let image = firmware_image::flash_image(firmware)?;
            active[..image.len()].copy_from_slice(&image);
        }
        std::fs::write(directory.path().join(ACTIVE_FILE), active)?;
        std::fs::write(file(FLASH_FILE), flash)?;
        if hardware.swapped {
            std::fs::write(file(SWAPPED_FILE), [])?;
        }
        let hci = hardware.hci.map_or("null".into(), |address| format!("tcp:{address},nodelay=on"));

        let link = Port::create(directory.path(), LINK)?;
        let plant = Port::create(directory.path(), "plant")?;
        let active_address = STM32_FLASH + ACTIVE.start;
        let mut command = Command::new("qemu-system-arm");
        command
            .args(["-M", MACHINE, "-display", "none", "-monitor", "none"])
            .args(["-semihosting-config", "enable=on,target=native"])
            // In the order of the controller's ports USART1 to USART3.
            .args(["-serial", &link.argument, "-serial", &hci, "-serial", &plant.argument])
            .arg("-kernel")
            .arg(std::path::absolute(bootloader)?)
            .args(["-device", &format!("loader,file={ACTIVE_FILE},addr={active_address:#x},force-raw=on")])
            .current_dir(directory.path())
            .stdin(Stdio::null())
            .stdout(File::create(directory.path().join(LOG_FILE))?)
            .stderr(Stdio::piped());
        if time == Time::Counted {
            command.args(["-icount", "shift=0"]);
        }
        #[cfg(target_os = "linux")]
        end_with_this_thread(&mut command);
        let mut qemu = Qemu(command.spawn().map_err(|e| match e.kind() {
            io::ErrorKind::NotFound => Error::NoQemu,
            _ => Error::Io(e),
        })?);
        let link = Link(link.connect(&mut qemu.0)?);
        let plant = plant.connect(&mut qemu.0)?;
        let plant = Plant::start(plant, &file(MATRIX_FILE), walk)?;
        Ok(Self { qemu, plant, link, directory })
    }

    /// The board's serial link.
    ///
    /// # Errors
    /// If its handle cannot be cloned.
    pub fn link(&self) -> io::Result<Link> {
        self.link.try_clone()
    }

    /// The FIFOs of the serial link, for another process: the one to which it writes, and the one from which it reads. Bytes that
    /// this process reads from [`Board::link`] do not reach the other one.
    #[cfg(unix)]
    pub fn link_fifos(&self) -> [PathBuf; 2] {
        Port::paths(self.directory.path(), LINK)
    }

    /// The process of the emulator.
    pub fn process_id(&self) -> u32 {
        self.qemu.0.id()
    }

    /// The contents of the flash chip.
    ///
    /// # Errors
    /// If its file cannot be read.
    pub fn flash(&self) -> io::Result<Vec<u8>> {
        std::fs::read(self.directory.path().join(FLASH_FILE.to_string_lossy().as_ref()))
    }

    /// The log of the board since it was switched on; `firmware` is the file of the firmware that runs on the board.
    ///
    /// # Errors
    /// If a file cannot be read, or the firmware file lacks the texts of its messages.
    #[cfg(feature = "log")]
    pub fn log(&self, firmware: &Path) -> Result<Vec<LogEntry>, Error> {
        Ok(log::decode(&std::fs::read(firmware)?, &std::fs::read(self.directory.path().join(LOG_FILE))?)?)
    }

    /// Waits until the board is off. True if the bootloader swapped images, so that the board must be started again.
    ///
    /// # Errors
    /// If the operating system does not report the exit.
    pub fn wait(&mut self) -> io::Result<bool> {
        Ok(self.qemu.0.wait()?.code() == Some(SWAPPED))
    }

    /// Starts the walk; each reset of the board needs another call. In [`Time::Real`] this has no effect, because the walk
    /// starts with the board.
    pub fn play(&self) {
        self.plant.play();
    }

    /// The sensor plant, which plays the walk into the matrix.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }
}

/// Lets the system kill the process of `command` when the thread that starts it ends, also if this program is killed.
#[cfg(target_os = "linux")]
fn end_with_this_thread(command: &mut Command) {
    use nix::sys::{prctl, signal::Signal};
    use std::os::unix::process::{CommandExt, parent_id};
    let parent = std::process::id();
    let set_up = move || {
        prctl::set_pdeathsig(Signal::SIGKILL)?;
        // The program may have ended before the request.
        if parent_id() == parent { Ok(()) } else { Err(io::ErrorKind::Interrupted.into()) }
    };
    // SAFETY: between fork and exec, the closure only makes two system calls, prctl and getppid, which are allowed there, and
    // neither allocates memory nor takes a lock: both kinds of error are plain numbers.
    unsafe { command.pre_exec(set_up) };
}

/// QEMU's process, which is killed when this value is dropped.
struct Qemu(Child);

impl Drop for Qemu {
    fn drop(&mut self) {
        // This fails if QEMU has exited by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

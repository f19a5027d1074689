//! The interface between the emulated board and the sensor plant, which is the simulation of the sensor matrix on the host.
//!
//! The host creates three files in the emulator's working directory: [`SETUP_FILE`], an [`EmulatorConfig`] followed by the
//! cells as [`SetupCell`], all encoded by `postcard`; [`MATRIX_FILE`], to which the plant writes the codes of each scan, little
//! endian, in the order of the cells; and [`FLASH_FILE`], the flash chip, to which the board writes. After a swap the host
//! also creates [`SWAPPED_FILE`]. The board writes its log, encoded by `defmt`, to the standard output.
//!
//! Over USART3 the board sends requests of five bytes: [`SCAN`] and the number of the scan, or [`TICK`] and the number of the
//! tick, which counts from 0 regardless of [`EmulatorConfig::first_scan`] (both little endian). The plant answers with two
//! bytes: [`answer_number`] and, for `SCAN`, the number of rows that are in the file so far; several answers with increasing
//! numbers of rows are accepted. The second byte of an answer to `TICK` is `TICK`. Only the first byte of an answer has its
//! highest bit set: a board that restarts after the first byte of an answer recognises the second one as a remainder.
#![no_std]

#[cfg(feature = "device")]
mod configuration;
#[cfg(feature = "device")]
mod flash;

#[cfg(feature = "device")]
pub use configuration::configuration;
#[cfg(feature = "device")]
pub use flash::{FlashFile, NoAnswer};

use core::ops::Range;
use plantar::pipeline::setup::{Setup, SetupCell};
use plantar::storage::flash_map::{LARGEST_CHIP, MAX_IMAGE, log};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Name of the set-up file.
pub const SETUP_FILE: &core::ffi::CStr = c"setup.bin";
/// Name of the file with the codes of the current scan.
pub const MATRIX_FILE: &core::ffi::CStr = c"matrix.bin";
/// Name of the file with the contents of the board's flash chip.
pub const FLASH_FILE: &core::ffi::CStr = c"flash.bin";
/// Size of the flash chip unless a test chooses another one, bytes.
pub const FLASH_BYTES: usize = 4 << 20;
/// Addresses of the active image. It is in the flash chip, because the controller's flash is read-only in the emulator.
pub const ACTIVE_IMAGE: Range<u32> = 0x20_0000..0x20_0000 + MAX_IMAGE;
// The step log of a large chip begins after the active image.
const _: () = assert!(ACTIVE_IMAGE.end <= log(LARGEST_CHIP as usize).start);
/// Exit status after the bootloader swapped images: the emulator must be started again with the image that is active now.
pub const SWAPPED: i32 = 3;
/// Name of a file that exists after an exit with [`SWAPPED`]: at the next start, the bootloader starts the application directly.
pub const SWAPPED_FILE: &core::ffi::CStr = c"swapped";
/// Number of cells in a row of the emulated matrix; the last row may be shorter.
pub const COLUMNS: usize = 16;
/// The first byte of a request for a scan.
pub const SCAN: u8 = b'S';
/// The first byte of a request for an answer at the time of the next scan. Used only if the plant paces the scans.
pub const TICK: u8 = b'T';

/// The first byte of an answer to the request with this number: the highest bit, and the seven lowest bits of the number.
pub const fn answer_number(number: u32) -> u8 {
    0x80 | (number & 0x7f) as u8
}

/// Joins the bytes of the plant's answers.
#[derive(Clone, Copy, Default)]
pub struct Answers {
    /// The first byte of an answer, until its second byte arrives.
    first: Option<u8>,
}

impl Answers {
    /// Nothing has arrived.
    pub const fn new() -> Self {
        Self { first: None }
    }

    /// Receives a byte, and returns the answer that it completes, if it completes one.
    pub fn push(&mut self, byte: u8) -> Option<[u8; 2]> {
        if byte & answer_number(0) != 0 {
            self.first = Some(byte);
            return None;
        }
        // Without a first byte, this is the rest of an answer to the run before a reset.
        self.first.take().map(|first| [first, byte])
    }
}

/// A fault to inject into the board's software.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum InjectedFault {
    /// Scanning enters an endless loop, in its interrupt.
    ScanStalled,
    /// Processing enters an endless loop while it processes a frame.
    ProcessStalled,
    /// The link enters an endless loop.
    LinkStalled,
    /// Processing recurses without end.
    StackOverflow,
    /// Processing executes an undefined instruction.
    UndefinedInstruction,
    /// Processing panics. If the fault is due immediately after the reset, the start panics.
    Panic,
}

/// A fault to inject, and when it is injected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlannedFault {
    /// The kind of fault.
    pub kind: InjectedFault,
    /// Time from the start to the fault, ms.
    pub after_ms: u32,
    /// True: the fault is injected after every reset; false: only after power-on.
    pub is_repeated: bool,
}

/// The configuration of the emulated board: the beginning of the set-up file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EmulatorConfig {
    /// Foot, layout, frame period, sensor law, contact rule and stance rule.
    pub setup: Setup,
    /// The plant paces the scans: the board asks before each scan, and scans as fast as the plant answers.
    pub is_paced: bool,
    /// Time after the start in which a central can bond, s.
    pub bonding_s: u16,
    /// The random static Bluetooth address: the emulated controller has no unique number to derive it from.
    pub address: [u8; 6],
    /// Charge of the battery, percent; `None` for a board that does not measure it.
    pub battery_percent: Option<u8>,
    /// Number of the first scan, if the plant paces the scans.
    pub first_scan: u32,
    /// Number of the flash operation (a write, or the erasure of a sector; from 0) in which power fails; `None` if power does not
    /// fail. The bootloader and the application each count their own operations.
    pub power_cut: Option<u32>,
    /// The fault to inject; `None` for no fault.
    pub fault: Option<PlannedFault>,
}

impl EmulatorConfig {
    /// A board with its own clock and without faults.
    pub fn new(setup: Setup) -> Self {
        Self {
            setup,
            is_paced: false,
            bonding_s: 60,
            address: [1, 0, 0, 0, 0, 0xc0],
            battery_percent: None,
            first_scan: 0,
            power_cut: None,
            fault: None,
        }
    }
}

/// Longest [`EmulatorConfig`] or [`SetupCell`] in the file, bytes.
const ITEM_BYTES: usize = 192;

/// Decodes the set-up file item by item, because all of it would take kilobytes of stack. `read` fills a buffer from an offset in
/// the file, and returns how many bytes it read. Returns `None` if the file is absent or has an item that cannot be decoded.
pub fn read_setup<F>(read: F) -> Option<(EmulatorConfig, impl Iterator<Item = SetupCell> + Clone)>
where
    F: Fn(usize, &mut [u8]) -> Option<usize> + Clone,
{
    let mut items = Items { read, offset: 0 };
    let config = items.next()?;
    let cells = items.clone();
    while !items.is_at_end() {
        items.next::<SetupCell>()?;
    }
    Some((config, cells))
}

/// Decodes the items of the set-up file in their order: the configuration, then the cells.
#[derive(Clone)]
struct Items<F> {
    read: F,
    /// Offset of the next item in the file, bytes.
    offset: usize,
}

impl<F: Fn(usize, &mut [u8]) -> Option<usize>> Items<F> {
    fn next<T: DeserializeOwned>(&mut self) -> Option<T> {
        let mut bytes = [0; ITEM_BYTES];
        let len = (self.read)(self.offset, &mut bytes)?;
        let (item, rest) = postcard::take_from_bytes(bytes.get(..len)?).ok()?;
        self.offset += len - rest.len();
        Some(item)
    }

    fn is_at_end(&self) -> bool {
        (self.read)(self.offset, &mut [0]) == Some(0)
    }
}

impl<F: Fn(usize, &mut [u8]) -> Option<usize>> Iterator for Items<F> {
    type Item = SetupCell;

    fn next(&mut self) -> Option<SetupCell> {
        Self::next(self)
    }
}

#[cfg(test)]
mod tests {
    use super::{Answers, TICK, answer_number};

    /// The USART drops bytes during a reset, so the first byte of a run can be the second one of an answer.
    #[test]
    fn answers_are_joined_after_a_reset_within_one() {
        let mut answers = Answers::new();
        let bytes = [TICK, answer_number(300), 15, answer_number(7), answer_number(128), TICK];
        let joined = bytes.map(|byte| answers.push(byte));
        assert_eq!(joined, [None, None, Some([0x80 | 44, 15]), None, None, Some([0x80, TICK])]);
    }
}

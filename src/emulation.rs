//! What the emulated board and the sensor plant on the host agree on.
//!
//! The plant leaves three files in the emulator's working directory: [`SETUP_FILE`], a `postcard` [`Head`] followed by its
//! cells as [`crate::insole::SetupCell`]; [`MATRIX_FILE`], the codes of the current scan, little endian, in the order of
//! the cells; and [`FLASH_FILE`], which the board writes to. Over USART3 the board asks with five bytes, [`SCAN`] or [`TICK`] and a scan number (little endian), and the
//! plant answers with two: to `SCAN` the low byte of the number and how many rows are in the file by now, once or more; to
//! `TICK` twice [`TICK`].

use crate::insole::{Setup, SetupCell};
use crate::map::CHIP_BYTES;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Name of the set-up file.
pub const SETUP_FILE: &core::ffi::CStr = c"setup.bin";
/// Name of the file with the codes of the current scan.
pub const MATRIX_FILE: &core::ffi::CStr = c"matrix.bin";
/// Name of the file that is the board's flash chip.
pub const FLASH_FILE: &core::ffi::CStr = c"flash.bin";
/// Size of that chip, bytes.
pub const FLASH_BYTES: usize = CHIP_BYTES as usize;
/// Exit status of an emulator whose bootloader swapped images: it is to be started again with the one that is active now.
pub const SWAPPED: i32 = 3;
/// Name of a file that is there where it was: the start that ended so goes on.
pub const SWAPPED_FILE: &core::ffi::CStr = c"swapped";
/// Cells in a row of the emulated matrix; the last row may be shorter.
pub const COLUMNS: usize = 16;
/// Asks for a scan.
pub const SCAN: u8 = b'S';
/// Asks for the time of the next scan; only where the plant keeps the time.
pub const TICK: u8 = b'T';

/// What may go wrong on the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mishap {
    /// Scanning goes round for ever, in its interrupt.
    ScanWedged,
    /// Processing does, in a frame.
    ModelWedged,
    /// The link does.
    LinkWedged,
    /// Processing calls itself for ever.
    StackOverflow,
    /// An instruction that is none, in processing.
    Fault,
    /// Processing panics, or the start if it is due by then.
    Panic,
}

/// A mishap to come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Planned {
    /// What goes wrong.
    pub what: Mishap,
    /// How long after the start, ms.
    pub after_ms: u32,
    /// After a reset too; else only after power-on.
    pub is_repeated: bool,
}

/// Head of the set-up file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Head {
    /// The insole.
    pub setup: Setup,
    /// The plant keeps the time: the board asks it before each scan and scans as fast as it is answered.
    pub paced: bool,
    /// A phone can bond for this long after the start, s.
    pub bonding_s: u16,
    /// The board's Bluetooth address, random static: the emulated board has no number of its own to make one from.
    pub address: [u8; 6],
    /// Number of the first scan, where the plant keeps the time.
    pub first_scan: u32,
    /// Power fails in this write or erasure of the flash chip, from 0.
    pub power_cut: Option<u32>,
    /// For tests of what follows.
    pub mishap: Option<Planned>,
}

impl Head {
    /// A board with its own clock, alone in the air.
    pub fn new(setup: Setup) -> Self {
        Self {
            setup,
            paced: false,
            bonding_s: 60,
            address: [1, 0, 0, 0, 0, 0xc0],
            first_scan: 0,
            power_cut: None,
            mishap: None,
        }
    }
}

/// Longest [`Head`] or [`SetupCell`] in the file, bytes.
const ITEM_BYTES: usize = 192;

/// Takes the set-up file apart, item by item: all of it would be kilobytes of stack. `read` fills a buffer with what lies from a
/// place in the file on, and returns how much that is. `None` where the file is absent or not whole.
pub fn read_setup<F>(read: F) -> Option<(Head, impl Iterator<Item = SetupCell> + Clone)>
where
    F: Fn(usize, &mut [u8]) -> Option<usize> + Clone,
{
    let mut items = Items { read, at: 0 };
    let head = items.next()?;
    let cells = items.clone();
    while !items.is_at_end() {
        items.next::<SetupCell>()?;
    }
    Some((head, cells))
}

#[derive(Clone)]
struct Items<F> {
    read: F,
    at: usize,
}

impl<F: Fn(usize, &mut [u8]) -> Option<usize>> Items<F> {
    fn next<T: DeserializeOwned>(&mut self) -> Option<T> {
        let mut bytes = [0; ITEM_BYTES];
        let len = (self.read)(self.at, &mut bytes)?;
        let (item, rest) = postcard::take_from_bytes(bytes.get(..len)?).ok()?;
        self.at += len - rest.len();
        Some(item)
    }

    fn is_at_end(&self) -> bool {
        (self.read)(self.at, &mut [0]) == Some(0)
    }
}

impl<F: Fn(usize, &mut [u8]) -> Option<usize>> Iterator for Items<F> {
    type Item = SetupCell;

    fn next(&mut self) -> Option<SetupCell> {
        Self::next(self)
    }
}

//! Addresses in the flash chip.

use core::ops::Range;
use embassy_futures::block_on;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use plantar::protocol::update::CHUNK;
use plantar::storage::flash_map::{
    ACTIVE, BOOTLOADER, LARGEST_CHIP, OTHER, PREVIOUS, RECORDS, SECTOR, SMALL_LOG, STATE, log,
};
use plantar::storage::partition::Partition;

/// An operation of the chip that changes it.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Change {
    Write(Range<u32>),
    Erase(Range<u32>),
}

/// A chip that records the last change. It has any address, and each byte depends on its address.
#[derive(Default)]
struct Probe {
    change: Option<Change>,
}

/// The byte of the chip at an address.
fn byte(address: u32) -> u8 {
    (address ^ address >> 8) as u8
}

impl ErrorType for Probe {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Probe {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        for (at, slot) in (offset..).zip(bytes) {
            *slot = byte(at);
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        LARGEST_CHIP as usize
    }
}

impl NorFlash for Probe {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = SECTOR as usize;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.change = Some(Change::Erase(from..to));
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.change = Some(Change::Write(offset..offset + bytes.len() as u32));
        Ok(())
    }
}

/// Where `len` bytes at `offset` in an area are in the chip; an error if they are not within the area.
fn address(area: &Range<u32>, offset: u32, len: u32) -> Result<u32, NorFlashErrorKind> {
    let end = u64::from(area.start) + u64::from(offset) + u64::from(len);
    if end <= u64::from(area.end) { Ok(area.start + offset) } else { Err(NorFlashErrorKind::OutOfBounds) }
}

/// A read operation of a partition, after another one at `before`, returns the bytes of its area, and an error outside of it.
pub fn read(area: Range<u32>, before: u32, offset: u32, bytes: &mut [u8]) {
    let chip = Mutex::new(Probe::default());
    let mut partition = Partition::<_, CHUNK>::new(&chip, area.clone());
    let _ = block_on(partition.read(before, &mut [0]));
    let len = bytes.len() as u32;
    let expected = address(&area, offset, len);
    assert_eq!(block_on(partition.read(offset, bytes)), expected.map(drop));
    if let Ok(start) = expected {
        assert!((start..start + len).zip(bytes).all(|(at, found)| *found == byte(at)));
    }
}

/// A write and an erase operation of a partition change exactly their bytes within the area, or nothing.
pub fn change(area: Range<u32>, offset: u32, bytes: &[u8]) {
    let len = bytes.len() as u32;
    let expected = address(&area, offset, len);
    let written = |start| Change::Write(start..start + len);
    let erased = |start| Change::Erase(start..start + len);
    let chip = Mutex::new(Probe::default());
    let mut partition = Partition::<_, CHUNK>::new(&chip, area);
    assert_eq!(block_on(partition.write(offset, bytes)), expected.map(drop));
    assert_eq!(block_on(chip.lock()).change.take(), expected.ok().map(written));
    if let Some(to) = offset.checked_add(len) {
        assert_eq!(block_on(partition.erase(offset, to)), expected.map(drop));
        assert_eq!(block_on(chip.lock()).change.take(), expected.ok().map(erased));
    }
}

/// No two areas of the map of a chip with this number of bytes contain the same sector, each is within its chip, each begins
/// and ends with a sector, and the log of a large chip ends with the chip.
pub fn map(chip_bytes: u32, sector: u32) {
    let contains = |area: &Range<u32>| area.contains(&sector) || area.contains(&(sector + SECTOR - 1));
    let owners = |areas: &[Range<u32>]| areas.iter().filter(|area| contains(area)).count();
    let log = log(chip_bytes as usize);
    assert!(owners(&[RECORDS, log.clone(), STATE, PREVIOUS, OTHER]) <= usize::from(sector < chip_bytes));
    assert!(log == SMALL_LOG || chip_bytes - log.end < SECTOR, "the log takes the rest of the chip");
    assert!(owners(&[BOOTLOADER, ACTIVE]) <= 1);
    for area in [RECORDS, log, STATE, PREVIOUS, OTHER, BOOTLOADER, ACTIVE] {
        assert!(area.start.is_multiple_of(SECTOR) && area.end.is_multiple_of(SECTOR));
    }
}

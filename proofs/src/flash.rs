//! The addresses that the partitions of the flash chip read and change, and the map of the areas in flash.

use core::ops::Range;
use embassy_futures::block_on;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use plantar::protocol::update::CHUNK;
use plantar::storage::flash_map::{
    ACTIVE, BOOTLOADER, LARGEST_CHIP, OTHER, PREVIOUS, RECORDS, SECTOR, SMALL_LOG, STATE, log,
};
use plantar::storage::partition::Partition;

/// An operation that changes the chip, and its range of addresses.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Change {
    Write(Range<u32>),
    Erase(Range<u32>),
}

/// A chip that records the last change, but does not execute it. Every address is valid, and the content of a byte is computed
/// from its address.
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

/// The address in the chip of the `len` bytes at `offset` in an area; an error if these bytes are not within the area.
fn address(area: &Range<u32>, offset: u32, len: u32) -> Result<u32, NorFlashErrorKind> {
    let end = u64::from(area.start) + u64::from(offset) + u64::from(len);
    if end <= u64::from(area.end) { Ok(area.start + offset) } else { Err(NorFlashErrorKind::OutOfBounds) }
}

/// A read operation of a partition, after another read operation at the offset `before`, returns the bytes of the partition's
/// area, or an error if they are not within the area.
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

/// A write and an erase operation of a partition change exactly the bytes at `offset` in the area. If these bytes are not
/// within the area, the operations return an error and change nothing.
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

/// At most one area of a flash chip of `chip_bytes` bytes contains the sector at the address `sector`, and none if the chip
/// ends before it. At most one area of the controller's own flash contains it. Each area consists of whole sectors, and the log
/// of a large chip ends with the last whole sector of the chip.
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

//! Ranges of the flash chip in the form that `embassy-boot` expects.

use super::flash_map::STATE;
use crate::protocol::update::{CHUNK, Refusal};
use core::ops::Range;
use embassy_boot::{FirmwareState, State};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

/// Size of a word in [`STATE`], bytes: long enough that an interrupted write does not leave another valid word.
pub const STATE_WORD: usize = 8;

/// [`STATE`] as a partition.
pub fn state_partition<F>(chip: &Mutex<NoopRawMutex, F>) -> Partition<'_, F, STATE_WORD> {
    Partition::new(chip, STATE)
}

/// True if the running image is on trial: the bootloader swaps it back at the next start, unless it is confirmed before. Between
/// the acceptance of an update and the restart, also true because the received image is marked to be swapped in.
///
/// # Errors
/// [`Refusal::Chip`] if the chip fails.
pub async fn is_on_trial<F: NorFlash>(flash: &mut F) -> Result<bool, Refusal> {
    let (chip, mut word) = (Mutex::new(flash), [0; STATE_WORD]);
    Ok(FirmwareState::new(state_partition(&chip), &mut word).get_state().await? == State::Swap)
}

/// A range of the flash chip, written in multiples of `WRITE` bytes. Short reads are served from a buffered page; other tasks can
/// run after each page that is read into the buffer.
pub struct Partition<'a, F, const WRITE: usize> {
    chip: &'a Mutex<NoopRawMutex, F>,
    range: Range<u32>,
    /// The buffered page.
    page: [u8; CHUNK],
    /// Address of the buffered page in the chip; `None` if no page is buffered.
    page_address: Option<u32>,
}

impl<'a, F, const WRITE: usize> Partition<'a, F, WRITE> {
    /// The partition with these addresses.
    pub fn new(chip: &'a Mutex<NoopRawMutex, F>, range: Range<u32>) -> Self {
        Self { chip, range, page: [0; CHUNK], page_address: None }
    }

    /// The address in the chip of the `len` bytes at `offset`.
    ///
    /// # Errors
    /// If these bytes are not within the partition.
    fn address(&self, offset: u32, len: u32) -> Result<u32, NorFlashErrorKind> {
        let room = (self.range.end - self.range.start).checked_sub(offset).ok_or(NorFlashErrorKind::OutOfBounds)?;
        if len <= room { Ok(self.range.start + offset) } else { Err(NorFlashErrorKind::OutOfBounds) }
    }
}

impl<F, const WRITE: usize> ErrorType for Partition<'_, F, WRITE> {
    type Error = NorFlashErrorKind;
}

impl<F: ReadNorFlash, const WRITE: usize> ReadNorFlash for Partition<'_, F, WRITE> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let mut address = self.address(offset, bytes.len() as u32)?;
        if bytes.len() >= CHUNK {
            return self.chip.lock().await.read(address, bytes).await.map_err(|error| error.kind());
        }
        for byte in bytes {
            let index = address as usize % CHUNK;
            let page_address = address - index as u32;
            if self.page_address != Some(page_address) {
                self.page_address = None;
                self.chip.lock().await.read(page_address, &mut self.page).await.map_err(|error| error.kind())?;
                self.page_address = Some(page_address);
                yield_now().await;
            }
            *byte = self.page[index];
            address += 1;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.range.len()
    }
}

impl<F: NorFlash, const WRITE: usize> NorFlash for Partition<'_, F, WRITE> {
    const WRITE_SIZE: usize = WRITE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.page_address = None;
        let start = self.address(from, to.saturating_sub(from))?;
        let end = start + to.saturating_sub(from);
        self.chip.lock().await.erase(start, end).await.map_err(|error| error.kind())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.page_address = None;
        let address = self.address(offset, bytes.len() as u32)?;
        self.chip.lock().await.write(address, bytes).await.map_err(|error| error.kind())
    }
}

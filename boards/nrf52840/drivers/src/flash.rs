//! The flash chip: reads and writes of any bytes, by transfers of whole words.
//!
//! The controller's DMA only transfers whole, aligned words, from and to RAM. So every transfer uses a buffer of one page that
//! belongs to the [`Bus`]: a transfer that was given up half-way can then never write to memory that has another use.

use core::sync::atomic::{AtomicU32, Ordering};
use embedded_storage_async::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// Size of a page, which the chip programs at once, bytes.
pub const PAGE: u32 = 256;
/// Size of a sector, which the chip erases at once, bytes.
pub const SECTOR: u32 = 4096;
/// Number of words in a page.
pub const PAGE_WORDS: usize = PAGE as usize / 4;

/// The buffer of one page. Its words are atomic because the controller's DMA changes them, too.
pub type Page = [AtomicU32; PAGE_WORDS];

/// Timeout of the programming of a page, ms. Chips of this kind need up to 3 ms.
const WRITE_LIMIT_MS: u32 = 20;
/// Timeout of the erasure of a sector, ms. Chips of this kind need up to 400 ms.
const ERASE_LIMIT_MS: u32 = 600;
/// Longest time for which a chip can be busy at the start: it may have been erasing a sector when the controller was reset.
const OPEN_LIMIT_MS: u32 = ERASE_LIMIT_MS;
/// Timeout of each operation of the bus, ms: the longest time for which a chip can be busy. Before the nRF52840's QSPI is active,
/// and before a read, a write or an erase operation, it polls the status of the chip and waits until the chip is not busy
/// (documentation of Nordic's driver `nrfx_qspi`). The transfer of a page takes 0.13 ms.
pub const BUS_LIMIT_MS: u32 = OPEN_LIMIT_MS;
/// Largest number of attempts of a read. With one attempt, a single failed read at the start would count as a missing record,
/// such as the alert rules. A read from a chip that does not answer takes up to twice [`BUS_LIMIT_MS`].
const READS: usize = 2;
/// Number of times that the identity of the chip is read, a millisecond apart.
const IDENTITY_READS: usize = 5;

/// Command Read Status Register.
const READ_STATUS: u8 = 0x05;
/// Command Read Identification: manufacturer, type and capacity.
const READ_IDENTITY: u8 = 0x9f;
/// Command Release Power-down. Other firmware may have put the chip to sleep, and a reset of the controller does not wake it.
const RELEASE: u8 = 0xab;
/// The bit in the status register that is set while the chip writes or erases.
const BUSY: u8 = 1;

/// The chip or the bus does not answer in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoAnswer;

/// The bus to the chip. Every operation ends within a limited time.
#[allow(async_fn_in_trait, reason = "executors of this board do not move tasks between threads")]
pub trait Bus {
    /// The buffer of all transfers. No transfer is in progress while a caller has access to it.
    fn page(&self) -> &Page;

    /// Switches the bus on, before any of the following operations. Waits for a chip that is busy: the controller may have been
    /// reset during an erase operation, or the operation may have been cancelled.
    ///
    /// # Errors
    /// If the bus does not start, or if the chip is busy for longer than [`BUS_LIMIT_MS`].
    async fn activate(&mut self) -> Result<(), NoAnswer>;

    /// Switches the bus off, which saves power.
    fn deactivate(&mut self);

    /// Reads `words` words into the beginning of the buffer, from an address of the chip that is a multiple of 4.
    ///
    /// # Errors
    /// If the transfer does not end.
    async fn read(&mut self, address: u32, words: usize) -> Result<(), NoAnswer>;

    /// Begins to program the first `words` words of the buffer at an address that is a multiple of 4, all in one page of the
    /// chip.
    ///
    /// # Errors
    /// If the transfer does not end.
    async fn write(&mut self, address: u32, words: usize) -> Result<(), NoAnswer>;

    /// Begins to erase the sector at this address.
    ///
    /// # Errors
    /// If the command is not sent.
    async fn erase(&mut self, address: u32) -> Result<(), NoAnswer>;

    /// Sends a command without parameters, and returns the first three bytes of its answer.
    ///
    /// # Errors
    /// If the transfer does not end.
    async fn command(&mut self, opcode: u8) -> Result<[u8; 3], NoAnswer>;

    /// Waits for `ms` milliseconds.
    async fn pause_ms(&mut self, ms: u32);
}

/// An error of the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error {
    /// The chip or the bus does not answer in time.
    NoAnswer,
    /// The addresses are not in the chip.
    OutOfBounds,
    /// The addresses of an erase operation are not multiples of [`SECTOR`].
    NotAligned,
}

impl From<NoAnswer> for Error {
    fn from(_: NoAnswer) -> Self {
        Self::NoAnswer
    }
}

impl NorFlashError for Error {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::NoAnswer => NorFlashErrorKind::Other,
            Self::OutOfBounds => NorFlashErrorKind::OutOfBounds,
            Self::NotAligned => NorFlashErrorKind::NotAligned,
        }
    }
}

/// A chip with `BYTES` bytes.
pub struct Chip<B, const BYTES: u32>(B);

/// Returns an error unless the `len` bytes from `offset` on are within the first `BYTES` bytes.
fn check<const BYTES: u32>(offset: u32, len: usize) -> Result<(), Error> {
    let room = BYTES.checked_sub(offset).ok_or(Error::OutOfBounds)?;
    if len <= room as usize { Ok(()) } else { Err(Error::OutOfBounds) }
}

/// The place of a byte in the buffer: its word, and its offset within the word, bits. The first byte of a word is the lowest.
fn place(page: &Page, at: usize) -> (&AtomicU32, u32) {
    // The callers pass offsets within a page. The remainder only avoids the code of a panic.
    (&page[at / 4 % PAGE_WORDS], at as u32 % 4 * 8)
}

impl<B: Bus, const BYTES: u32> Chip<B, BYTES> {
    /// Opens the chip once it is not busy. Returns `None` if it does not answer in time, is smaller than `BYTES`, or does not
    /// return the same valid identity each time. The bytes read from a missing chip are 0, which is not a valid identity; the
    /// same applies to a chip that does not work yet.
    pub async fn open(bus: B) -> Option<Self> {
        let mut chip = Self(bus);
        let result = chip.identify().await;
        chip.0.deactivate();
        result.ok().filter(|is_valid| *is_valid).map(|_| chip)
    }

    /// Returns true if the chip is large enough and returns the same valid identity each time.
    async fn identify(&mut self) -> Result<bool, NoAnswer> {
        self.0.activate().await?;
        self.0.command(RELEASE).await?;
        self.0.pause_ms(1).await;
        self.idle(OPEN_LIMIT_MS).await?;
        let first = self.0.command(READ_IDENTITY).await?;
        let [manufacturer, _, capacity] = first;
        // The capacity is the binary logarithm of the number of bytes.
        let is_large = (BYTES.ilog2()..32).contains(&u32::from(capacity));
        let mut is_valid = is_large && ![0, 0xff].contains(&manufacturer);
        for _ in 1..IDENTITY_READS {
            self.0.pause_ms(1).await;
            is_valid &= self.0.command(READ_IDENTITY).await? == first;
        }
        Ok(is_valid)
    }

    /// Waits until the chip is not busy.
    async fn idle(&mut self, limit_ms: u32) -> Result<(), NoAnswer> {
        for _ in 0..limit_ms {
            if self.0.command(READ_STATUS).await?[0] & BUSY == 0 {
                return Ok(());
            }
            self.0.pause_ms(1).await;
        }
        Err(NoAnswer)
    }

    async fn read_bytes(&mut self, mut address: u32, mut bytes: &mut [u8]) -> Result<(), NoAnswer> {
        self.0.activate().await?;
        while !bytes.is_empty() {
            // The offset of the first byte within its word.
            let first = (address % 4) as usize;
            let (part, rest) = bytes.split_at_mut(bytes.len().min(PAGE as usize - first));
            self.0.read(address - first as u32, (first + part.len()).div_ceil(4)).await?;
            for (i, byte) in part.iter_mut().enumerate() {
                let (word, shift) = place(self.0.page(), first + i);
                *byte = (word.load(Ordering::Relaxed) >> shift) as u8;
            }
            address += part.len() as u32;
            bytes = rest;
        }
        Ok(())
    }

    /// Programs bytes. The other bytes of a word are programmed with ones, which does not change them.
    async fn write_bytes(&mut self, mut address: u32, mut bytes: &[u8]) -> Result<(), NoAnswer> {
        self.0.activate().await?;
        while !bytes.is_empty() {
            // The offset of the first byte within its word, and the number of bytes up to the end of the page.
            let (first, left_in_page) = ((address % 4) as usize, PAGE - address % PAGE);
            let (part, rest) = bytes.split_at(bytes.len().min(left_in_page as usize));
            let page = self.0.page();
            page.iter().for_each(|word| word.store(u32::MAX, Ordering::Relaxed));
            for (i, byte) in part.iter().enumerate() {
                let (word, shift) = place(page, first + i);
                word.store(word.load(Ordering::Relaxed) & !(u32::from(!byte) << shift), Ordering::Relaxed);
            }
            self.0.write(address - first as u32, (first + part.len()).div_ceil(4)).await?;
            self.idle(WRITE_LIMIT_MS).await?;
            address += part.len() as u32;
            bytes = rest;
        }
        Ok(())
    }

    async fn erase_sectors(&mut self, from: u32, to: u32) -> Result<(), NoAnswer> {
        self.0.activate().await?;
        for address in (from..to).step_by(SECTOR as usize) {
            self.0.erase(address).await?;
            self.idle(ERASE_LIMIT_MS).await?;
        }
        Ok(())
    }
}

impl<B, const BYTES: u32> ErrorType for Chip<B, BYTES> {
    type Error = Error;
}

impl<B: Bus, const BYTES: u32> ReadNorFlash for Chip<B, BYTES> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        check::<BYTES>(offset, bytes.len())?;
        let mut result = Err(NoAnswer);
        for _ in 0..READS {
            result = self.read_bytes(offset, bytes).await;
            // The next attempt switches the bus on again.
            self.0.deactivate();
            if result.is_ok() {
                break;
            }
        }
        Ok(result?)
    }

    fn capacity(&self) -> usize {
        BYTES as usize
    }
}

impl<B: Bus, const BYTES: u32> NorFlash for Chip<B, BYTES> {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = SECTOR as usize;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        check::<BYTES>(from, to.checked_sub(from).ok_or(Error::OutOfBounds)? as usize)?;
        if !from.is_multiple_of(SECTOR) || !to.is_multiple_of(SECTOR) {
            return Err(Error::NotAligned);
        }
        let result = self.erase_sectors(from, to).await;
        self.0.deactivate();
        Ok(result?)
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        check::<BYTES>(offset, bytes.len())?;
        let result = self.write_bytes(offset, bytes).await;
        self.0.deactivate();
        Ok(result?)
    }
}

// A chip of this kind may be programmed any number of times between two erase operations.
impl<B: Bus, const BYTES: u32> MultiwriteNorFlash for Chip<B, BYTES> {}

#[cfg(test)]
mod tests;

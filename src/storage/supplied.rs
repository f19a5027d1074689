//! A NOR flash chip that is not changed while its supply is too low.

use embedded_storage_async::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// A chip that refuses write and erase operations while `is_sufficient` returns false: below its lowest supply, a chip may
/// change other bytes than the addressed ones. A refused write operation has changed nothing; a refused erase operation may
/// have erased its first sectors. So a refusal has no worse effect than a loss of power at that moment: the stored data
/// remain, and the items that could not be stored are counted.
pub struct Supplied<F, S> {
    chip: F,
    /// Number of bytes that are used, from the beginning of the chip.
    bytes: u32,
    is_sufficient: S,
}

/// Why an operation failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SuppliedError<E> {
    /// The supply is too low. A write operation has changed nothing; an erase operation may have erased its first sectors.
    Supply,
    /// The range exceeds the used part of the chip. Nothing has changed.
    OutOfBounds,
    /// The chip has failed.
    Chip(E),
}

impl<E: NorFlashError> NorFlashError for SuppliedError<E> {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Supply => NorFlashErrorKind::Other,
            Self::OutOfBounds => NorFlashErrorKind::OutOfBounds,
            Self::Chip(error) => error.kind(),
        }
    }
}

impl<F, S: Fn() -> bool> Supplied<F, S> {
    /// A chip of which the first `bytes` bytes are used; `is_sufficient` states whether its supply is sufficient now, and is
    /// called before each write and erase operation.
    pub fn new(chip: F, bytes: u32, is_sufficient: S) -> Self {
        Self { chip, bytes, is_sufficient }
    }

    /// Fails if the bytes before `end` must not be changed: they are beyond the used part of the chip, or the supply is too
    /// low.
    fn check<E>(&self, end: u32) -> Result<(), SuppliedError<E>> {
        if end > self.bytes {
            return Err(SuppliedError::OutOfBounds);
        }
        if (self.is_sufficient)() { Ok(()) } else { Err(SuppliedError::Supply) }
    }
}

impl<F: ErrorType, S> ErrorType for Supplied<F, S> {
    type Error = SuppliedError<F::Error>;
}

impl<F: ReadNorFlash, S> ReadNorFlash for Supplied<F, S> {
    const READ_SIZE: usize = F::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        self.chip.read(offset, bytes).await.map_err(SuppliedError::Chip)
    }

    fn capacity(&self) -> usize {
        self.bytes as usize
    }
}

impl<F: NorFlash, S: Fn() -> bool> NorFlash for Supplied<F, S> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    /// Erases sector by sector, and checks the supply before each.
    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        let is_whole = to.checked_sub(from).is_some_and(|bytes| bytes.is_multiple_of(F::ERASE_SIZE as u32));
        if !is_whole {
            // The chip refuses this range before it erases anything.
            return self.chip.erase(from, to).await.map_err(SuppliedError::Chip);
        }
        for sector in (from..to).step_by(F::ERASE_SIZE) {
            self.check(to)?;
            self.chip.erase(sector, sector + F::ERASE_SIZE as u32).await.map_err(SuppliedError::Chip)?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        self.check(offset.saturating_add(bytes.len() as u32))?;
        self.chip.write(offset, bytes).await.map_err(SuppliedError::Chip)
    }
}

impl<F: MultiwriteNorFlash, S: Fn() -> bool> MultiwriteNorFlash for Supplied<F, S> {}

//! The chip, with write and erase operations that can be refused.

use embedded_storage_async::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// Whether the chip may be changed: `sequential-storage` repairs what appears to be damaged, also while it reads.
#[derive(Default)]
pub(super) struct Guard {
    /// Write and erase operations fail.
    pub is_read_only: bool,
    /// An operation has failed because `is_read_only` was set.
    pub has_refused: bool,
    /// An erase operation that fails, or is refused because `is_read_only` is set, is postponed: it reports success.
    /// `sequential-storage` erases sectors of which all entries were deleted while it reads the log. Reading must be possible
    /// even with a supply that is too low for erase operations, and during a survey, which must not change the chip.
    pub postpones_erasure: bool,
    /// An erase operation has been postponed, so the cached state of its sector is wrong.
    pub has_postponed: bool,
}

/// A chip behind its guard.
pub(super) struct Guarded<'f, F> {
    pub flash: &'f mut F,
    pub guard: &'f mut Guard,
}

impl<F> Guarded<'_, F> {
    fn check(&mut self) -> Result<(), NorFlashErrorKind> {
        self.guard.has_refused |= self.guard.is_read_only;
        if self.guard.is_read_only { Err(NorFlashErrorKind::Other) } else { Ok(()) }
    }
}

impl<F> ErrorType for Guarded<'_, F> {
    type Error = NorFlashErrorKind;
}

impl<F: ReadNorFlash> ReadNorFlash for Guarded<'_, F> {
    const READ_SIZE: usize = F::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        self.flash.read(offset, bytes).await.map_err(|error| error.kind())
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl<F: NorFlash> NorFlash for Guarded<'_, F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        if !self.guard.postpones_erasure {
            self.check()?;
            return self.flash.erase(from, to).await.map_err(|error| error.kind());
        }
        if self.guard.is_read_only || self.flash.erase(from, to).await.is_err() {
            self.guard.has_postponed = true;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.check()?;
        self.flash.write(offset, bytes).await.map_err(|error| error.kind())
    }
}

impl<F: MultiwriteNorFlash> MultiwriteNorFlash for Guarded<'_, F> {}

//! The NOR flash chip of the emulated board: a file on the host, with a supply that a test can interrupt in the middle of an
//! operation.

use super::FLASH_FILE;
use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use plantar::storage::flash_map::SECTOR;
use semihosting::fs::File;
use semihosting::io::{self, Read, Seek, SeekFrom, Write};

/// The chip. Its operations take no time of the board, but each access to the file halts the emulated core, on a busy computer
/// for milliseconds. So the other tasks run after each access, as they do while a driver waits for a chip.
pub struct FlashFile {
    /// `None` if there is no chip.
    file: Option<File>,
    /// Size of the file, bytes; 0 if there is no chip.
    bytes: usize,
    /// Number of write operations and erasures of a sector before power fails; `None` if power does not fail.
    operations_left: Option<u32>,
}

/// The chip did not answer, or does not have the address.
#[derive(Debug)]
pub struct NoAnswer;

impl From<io::Error> for NoAnswer {
    fn from(_: io::Error) -> Self {
        Self
    }
}

impl NorFlashError for NoAnswer {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl FlashFile {
    /// Opens the chip. Power fails in operation number `cut_at` (a write, or the erasure of a sector; from 0); never for `None`.
    pub fn open(cut_at: Option<u32>) -> Self {
        let mut file = File::options().read(true).write(true).open(FLASH_FILE).ok();
        let bytes = file.as_mut().and_then(|file| file.seek(SeekFrom::End(0)).ok()).unwrap_or(0);
        Self { file, bytes: bytes as usize, operations_left: cut_at }
    }

    /// The file at this offset, if the chip has `len` bytes there.
    fn at(&mut self, offset: u32, len: usize) -> Result<&mut File, NoAnswer> {
        let file = self.file.as_mut().filter(|_| offset as usize + len <= self.bytes).ok_or(NoAnswer)?;
        file.seek(SeekFrom::Start(offset.into()))?;
        Ok(file)
    }

    /// Number of the `len` bytes that an operation changes before power fails.
    fn completed(&mut self, len: usize) -> usize {
        if self.operations_left == Some(0) { len / 2 } else { len }
    }

    /// Counts an operation. If power fails in it, the emulator exits.
    fn end_operation(&mut self) {
        match &mut self.operations_left {
            Some(0) => semihosting::process::exit(0),
            Some(left) => *left -= 1,
            None => {}
        }
    }
}

impl ErrorType for FlashFile {
    type Error = NoAnswer;
}

impl ReadNorFlash for FlashFile {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NoAnswer> {
        self.at(offset, bytes.len())?.read_exact(bytes)?;
        yield_now().await;
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes
    }
}

impl NorFlash for FlashFile {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = SECTOR as usize;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NoAnswer> {
        for sector in (from..to).step_by(SECTOR as usize) {
            let completed = self.completed(SECTOR as usize);
            let file = self.at(sector, SECTOR as usize)?;
            for _ in (0..completed).step_by(64) {
                file.write_all(&[0xff; 64])?;
                yield_now().await;
            }
            self.end_operation();
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NoAnswer> {
        let bytes = &bytes[..self.completed(bytes.len())];
        let mut stored = [0; 64];
        for (offset, bytes) in (offset..).step_by(stored.len()).zip(bytes.chunks(stored.len())) {
            let stored = &mut stored[..bytes.len()];
            self.read(offset, stored).await?;
            // A write operation only clears bits.
            stored.iter_mut().zip(bytes).for_each(|(stored, byte)| *stored &= byte);
            self.at(offset, stored.len())?.write_all(stored)?;
            yield_now().await;
        }
        self.end_operation();
        Ok(())
    }
}

impl MultiwriteNorFlash for FlashFile {}

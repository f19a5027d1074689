//! What the bootloaders share: areas of the flash chip as `embassy-boot` wants them, which knows blocking chips only.

use crate::map::OTHER;
use crate::update::{Area, CHUNK, WORD, state};
use embassy_boot::BootLoaderConfig;
use embassy_futures::block_on;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use embedded_storage_async::nor_flash as asynchronous;

/// The largest piece that is copied at once, bytes.
pub const BUFFER: usize = crate::map::SECTOR as usize;

/// A chip that is waited for.
pub struct Blocking<F>(pub F);

impl<F: ErrorType> ErrorType for Blocking<F> {
    type Error = F::Error;
}

impl<F: asynchronous::ReadNorFlash> ReadNorFlash for Blocking<F> {
    const READ_SIZE: usize = F::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), F::Error> {
        block_on(self.0.read(offset, bytes))
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl<F: asynchronous::NorFlash> NorFlash for Blocking<F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), F::Error> {
        block_on(self.0.erase(from, to))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), F::Error> {
        block_on(self.0.write(offset, bytes))
    }
}

/// An area of the chip that is waited for.
pub type Waited<'a, F, const WRITE: usize> = Blocking<Area<'a, F, WRITE>>;

/// What the bootloader swaps: `active` with the other image in the chip.
pub fn config<F, A>(
    chip: &Mutex<NoopRawMutex, F>,
    active: A,
) -> BootLoaderConfig<A, Waited<'_, F, CHUNK>, Waited<'_, F, WORD>> {
    BootLoaderConfig { active, dfu: Blocking(Area::new(chip, OTHER)), state: Blocking(state(chip)) }
}

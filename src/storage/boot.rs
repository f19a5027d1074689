//! Code that the bootloaders share: partitions of the flash chip for `embassy-boot`, which supports blocking chips only.

use super::flash_map::{OTHER, SECTOR};
use super::partition::{Partition, STATE_WORD, state_partition};
use crate::protocol::update::CHUNK;
use core::pin::pin;
use core::task::{Context, Poll, Waker};
use embassy_boot::BootLoaderConfig;
use embassy_futures::block_on;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use embedded_storage_async::nor_flash as asynchronous;

/// Size of the largest block that is copied at once, bytes.
pub const BUFFER: usize = SECTOR as usize;

/// Polls a future until it is ready, with a waker that does nothing; `None` if it is not ready after `polls` polls.
pub fn poll_at_most<T>(polls: u32, future: impl Future<Output = T>) -> Option<T> {
    let mut future = pin!(future);
    (0..polls).find_map(|_| match future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(output) => Some(output),
        Poll::Pending => None,
    })
}

/// A chip, with blocking operations.
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

/// A partition of the chip, with blocking operations.
pub type BlockingPartition<'a, F, const WRITE: usize> = Blocking<Partition<'a, F, WRITE>>;

/// The configuration of the bootloader: it swaps the image in `active` with the one in [`OTHER`].
pub fn config<F, A>(
    chip: &Mutex<NoopRawMutex, F>,
    active: A,
) -> BootLoaderConfig<A, BlockingPartition<'_, F, CHUNK>, BlockingPartition<'_, F, STATE_WORD>> {
    BootLoaderConfig { active, dfu: Blocking(Partition::new(chip, OTHER)), state: Blocking(state_partition(chip)) }
}

//! Code that the bootloaders share: a limited wait for a future, and the swap of the images by `embassy-boot`. That package
//! supports only blocking drivers; [`Blocking`] adapts the asynchronous partitions of the flash chip to it.

use super::flash_map::{OTHER, SECTOR};
use super::partition::{Partition, state_partition};
use crate::protocol::update::CHUNK;
use core::pin::pin;
use core::task::{Context, Poll, Waker};
use embassy_boot::{AlignedBuffer, BootError, BootLoader, BootLoaderConfig, State};
use embassy_futures::block_on;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use embedded_storage_async::nor_flash as asynchronous;

/// Size of the largest block that is copied at once, bytes.
const BUFFER: usize = SECTOR as usize;

/// Number of attempts to read the state. If all of them fail, the active image starts.
const STATE_READS: usize = 3;

/// Polls a future until it is ready, with a waker that does nothing; `None` if it is not ready after `polls` polls.
pub fn poll_at_most<T>(polls: u32, future: impl Future<Output = T>) -> Option<T> {
    let mut future = pin!(future);
    (0..polls).find_map(|_| match future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(output) => Some(output),
        Poll::Pending => None,
    })
}

/// An asynchronous chip or partition, as a blocking one.
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

/// Swaps the image in `active` with the one in [`OTHER`], or swaps them back, if the state of the bootloader in the flash chip
/// demands it. Returns the state that was read before this.
///
/// If no attempt to read the state succeeds, nothing changes, and the result is [`State::Boot`]: the active image is to be
/// started, as without a chip. This image is incomplete if a loss of power or a reset has interrupted a swap. It then fails, the
/// watchdog or a fault resets the controller, and the next call can continue the swap.
///
/// # Errors
/// If the chip fails after the state was read for the first time, or the flash of `active` fails within the swap. The active
/// image may be a mixture of both images; the next call continues the swap.
pub fn swap_if_due<F, A>(chip: &Mutex<NoopRawMutex, F>, active: A) -> Result<State, BootError>
where
    F: asynchronous::MultiwriteNorFlash,
    A: NorFlash,
{
    let (dfu, state) = (Blocking(Partition::<_, CHUNK>::new(chip, OTHER)), Blocking(state_partition(chip)));
    let mut bootloader = BootLoader::new(BootLoaderConfig { active, dfu, state });
    let mut buffer = AlignedBuffer([0; BUFFER]);
    if (0..STATE_READS).any(|_| bootloader.read_state(buffer.as_mut()).is_ok()) {
        bootloader.prepare_boot(buffer.as_mut())
    } else {
        Ok(State::Boot)
    }
}

//! The flash chip of the module, as the firmware uses it.

use crate::matrix;
use core::future::poll_fn;
use core::task::Poll;
use embassy_nrf::interrupt;
use embassy_nrf::pac;
use embassy_nrf::{Peri, peripherals};
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::{Duration, Timer, with_timeout};
use nrf52840_drivers::CHIP_BYTES;
use nrf52840_drivers::qspi::{Qspi, Wait};
use plantar::storage::flash_map::OTHER;
use plantar::storage::supplied::Supplied;

// In a chip of this size, `OTHER` is the last area of the map.
const _: () = assert!(OTHER.end <= CHIP_BYTES, "the flash map fits into the chip");

static READY: AtomicWaker = AtomicWaker::new();

/// Waits while other tasks run. The interrupt `QSPI` must be enabled.
pub struct Sleep;

impl Wait for Sleep {
    async fn until(&mut self, limit_ms: u32, is_ready: impl Fn() -> bool) -> bool {
        let ready = poll_fn(|context| {
            READY.register(context.waker());
            if is_ready() { Poll::Ready(()) } else { Poll::Pending }
        });
        with_timeout(Duration::from_millis(limit_ms.into()), ready).await.is_ok()
    }

    async fn pause_ms(&mut self, ms: u32) {
        Timer::after_millis(ms.into()).await;
    }
}

/// The chip, which is written and erased only while its supply is sufficient.
pub type Chip = Supplied<nrf52840_drivers::flash::Chip<Qspi<Sleep>, CHIP_BYTES>, fn() -> bool>;

/// Opens the chip. `None` if it is missing, too small, does not answer in time, or does not return the same valid identity each
/// time.
pub async fn open(qspi: Peri<'static, peripherals::QSPI>) -> Option<Chip> {
    let chip = nrf52840_drivers::flash::Chip::open(Qspi::new(qspi, Sleep)).await?;
    Some(Supplied::new(chip, CHIP_BYTES, matrix::is_supplied))
}

#[interrupt]
fn QSPI() {
    // The event remains set until the next operation, for the task that waits for it.
    pac::QSPI.intenclr().write(|w| w.set_ready(true));
    READY.wake();
}

//! The bootloader of the nRF52840: swaps the images if a swap is due, and starts the active image.
//!
//! The watchdog starts before any wait. A wait that may exceed its timeout, such as that for the supply, feeds it. If the flash
//! chip does not answer, or if the state in it is not readable, the active image starts without a swap. The flash chip is
//! changed only while its supply suffices.
//!
//! Only the bootloader writes the controller's own flash; the radio does not run yet.
#![no_std]
#![no_main]

use cortex_m::peripheral::SCB;
use cortex_m_rt::entry;
use embassy_nrf::Peripherals;
use embassy_nrf::nvmc::{Error, Nvmc};
use embassy_sync::mutex::Mutex;
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use nrf52840_drivers::flash::Chip;
use nrf52840_drivers::qspi::{Qspi, Wait};
use nrf52840_drivers::{CHIP_BYTES, ground_divider, supply, wait_cycles, watchdog};
use plantar::protocol::SUFFICIENT_SUPPLY_MV;
use plantar::storage::boot::{poll_at_most, swap_if_due};
use plantar::storage::flash_map::{ACTIVE, MAX_IMAGE, NRF52_FLASH};
use plantar::storage::supplied::Supplied;

/// Address of the application.
const APPLICATION: u32 = NRF52_FLASH + ACTIVE.start;

/// The core's clock, kHz.
const CORE_KHZ: u32 = 64_000;

/// Interval between two measurements of the supply while it rises, ms.
const SUPPLY_POLL_MS: u32 = 10;
/// Number of measurements, after which a start continues with a low supply.
const SUPPLY_POLLS: u32 = 100;

/// True if the supply is sufficient for the flash chip, which works from 2.3 V on; the controller works from 1.7 V on. Also true
/// if the converter does not respond, which must not prevent the start.
fn is_supplied() -> bool {
    supply::millivolts().is_none_or(|supply_mv| supply_mv >= SUFFICIENT_SUPPLY_MV)
}

/// Waits in loops. Each wait for the chip is limited, so each may feed the watchdog.
struct Busy;

impl Wait for Busy {
    async fn until(&mut self, limit_ms: u32, is_ready: impl Fn() -> bool) -> bool {
        /// Time between two checks, us.
        const STEP_US: u32 = 10;
        (0..limit_ms * 1000 / STEP_US).any(|_| {
            // In each step, because without the instruction cache all steps may take longer than the watchdog's timeout.
            watchdog::feed();
            wait_cycles(CORE_KHZ / 1000 * STEP_US);
            is_ready()
        })
    }

    async fn pause_ms(&mut self, ms: u32) {
        wait_cycles(ms * CORE_KHZ);
    }
}

/// The application in the controller's own flash. Each operation feeds the watchdog.
struct Active(Nvmc<'static>);

impl Active {
    /// Returns the address of the `len` bytes at `offset` of the application, and feeds the watchdog.
    ///
    /// # Errors
    /// If they are not within the application.
    fn at(offset: u32, len: usize) -> Result<u32, Error> {
        watchdog::feed();
        let room = MAX_IMAGE.checked_sub(offset).ok_or(Error::OutOfBounds)?;
        if len <= room as usize { Ok(APPLICATION + offset) } else { Err(Error::OutOfBounds) }
    }
}

impl ErrorType for Active {
    type Error = Error;
}

impl ReadNorFlash for Active {
    const READ_SIZE: usize = Nvmc::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        self.0.read(Self::at(offset, bytes.len())?, bytes)
    }

    fn capacity(&self) -> usize {
        MAX_IMAGE as usize
    }
}

impl NorFlash for Active {
    const WRITE_SIZE: usize = Nvmc::WRITE_SIZE;
    const ERASE_SIZE: usize = Nvmc::ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        let len = to.checked_sub(from).ok_or(Error::OutOfBounds)?;
        let start = Self::at(from, len as usize)?;
        self.0.erase(start, start + len)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        self.0.write(Self::at(offset, bytes.len())?, bytes)
    }
}

#[entry]
fn main() -> ! {
    ground_divider();
    watchdog::start();
    // SAFETY: `main` runs once, and nothing else of this program uses peripherals. `embassy_nrf::init` is not called, because it
    // would start the low-frequency clock, of which the application chooses the source, and wait for it without a limit.
    let p = unsafe { Peripherals::steal() };
    // A wait of `Busy` never yields, so one poll completes the operation.
    if let Some(Some(chip)) = poll_at_most(1, Chip::<_, CHIP_BYTES>::open(Qspi::new(p.QSPI, Busy))) {
        // While the supply rises, the chip may read wrong, and a swap that was interrupted would be taken for a completed one.
        for _ in 0..SUPPLY_POLLS {
            watchdog::feed();
            if is_supplied() {
                break;
            }
            wait_cycles(SUPPLY_POLL_MS * CORE_KHZ);
        }
        let chip = Mutex::new(Supplied::new(chip, CHIP_BYTES, is_supplied));
        if swap_if_due(&chip, Active(Nvmc::new(p.NVMC))).is_err() {
            // The swap may have failed half-way, and then no image would run. It continues after the reset. With a low supply,
            // each start would erase the same page of the controller's own flash again, so the loop waits for the supply.
            while !is_supplied() {
                watchdog::feed();
            }
            SCB::sys_reset()
        }
    }
    watchdog::feed();
    // SAFETY: an image is at this address, and the drivers used here leave no interrupt enabled.
    unsafe {
        (*SCB::PTR).vtor.write(APPLICATION);
        cortex_m::asm::bootload(APPLICATION as *const u32)
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    SCB::sys_reset()
}

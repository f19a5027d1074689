//! The bootloader of the STM32WB55: swaps the images if a swap is due, and starts the active image.
//!
//! The watchdog starts first. The clocks need only the internal oscillator. No wait is longer than the watchdog's timeout, except
//! the wait for the supply after a failed swap, which feeds the watchdog.
//! If the flash chip does not answer, or if the state in it is not readable, the active image starts without a swap.
//!
//! Only the bootloader writes the controller's own flash; the radio's core does not run yet.
#![no_std]
#![no_main]

use core::cell::RefCell;
use cortex_m::peripheral::SCB;
use cortex_m_rt::entry;
use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_embedded_hal::flash::partition::BlockingPartition;
use embassy_stm32::flash::Flash;
use embassy_stm32::gpio::{Level, Output, Pull, Speed};
use embassy_stm32::pac;
use embassy_stm32::pac::iwdg::vals::Key;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::rcc::{LsConfig, MSIRange};
use embassy_stm32::spi::{self, Spi};
use embassy_stm32::time::Hertz;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_sync::blocking_mutex::Mutex as BlockingMutex;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_hal_bus::spi::ExclusiveDevice;
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use plantar::storage::boot::{poll_at_most, swap_if_due};
use plantar::storage::flash_map::{ACTIVE, MAX_IMAGE, SMALLEST_CHIP, STM32_FLASH};
use plantar::storage::supplied::Supplied;
use w25::{Q, W25};

/// Timeout of the watchdog, us. It resets the board if the swap of one sector does not end (it takes less than a second), or if
/// the started image does not feed the watchdog. An image on trial is then swapped back.
const WATCHDOG_US: u32 = 20_000_000;

/// The setting of the voltage detector for 2.8 V. The flash chip works from 2.7 V on.
const SUPPLY_LEVEL: u8 = 5;
/// The detector needs some microseconds after its start. At 16 MHz, this is at least 100 us.
const DETECTOR_START_CYCLES: u32 = 1_600;
/// Number of cycles in which the flash chip leaves its power-down mode: at least 30 us.
const WAKE_CYCLES: u32 = 480;
/// Iterations of the delay loop between two readings of the detector while the supply rises, of three cycles each. At 16 MHz,
/// this is 10 ms.
const SUPPLY_POLL_LOOPS: u32 = 53_333;
/// Number of readings, after which a start continues with a low supply.
const SUPPLY_POLLS: u32 = 100;

/// Address of the application.
const APPLICATION: u32 = STM32_FLASH + ACTIVE.start;

/// Number of times that the status of a busy chip is read, some 20 us each: 2 s. The longest operation of the chip takes 0.4 s.
const BUSY_POLLS: u32 = 100_000;

/// True if the supply is sufficient for the flash chip.
fn is_supplied() -> bool {
    !pac::PWR.sr2().read().pvdo()
}

/// The controller's own flash. It feeds the watchdog before each erase operation; a swap erases one sector at a time.
struct WatchedFlash<F> {
    flash: F,
    watchdog: IndependentWatchdog<'static, IWDG>,
}

impl<F: ErrorType> ErrorType for WatchedFlash<F> {
    type Error = F::Error;
}

impl<F: ReadNorFlash> ReadNorFlash for WatchedFlash<F> {
    const READ_SIZE: usize = F::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), F::Error> {
        self.flash.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl<F: NorFlash> NorFlash for WatchedFlash<F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), F::Error> {
        self.watchdog.pet();
        self.flash.erase(from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), F::Error> {
        self.flash.write(offset, bytes)
    }
}

#[entry]
fn main() -> ! {
    // Starts the watchdog with the timeout that it has after a reset, half a second, in case the clocks do not start.
    pac::IWDG.kr().write(|w| w.set_key(Key::START));
    let mut clocks = embassy_stm32::Config::default();
    // The internal oscillator needs no crystal. `init` raises its rate before it sets the wait states of the flash, and the
    // application begins without wait states. They are needed above 18 MHz (RM0434, "Read access latency").
    clocks.rcc.msi = Some(MSIRange::RANGE16M);
    clocks.rcc.hsi48 = None;
    clocks.rcc.ls = LsConfig::off();
    clocks.enable_debug_during_sleep = false;
    let p = embassy_stm32::init(clocks);
    let mut watchdog = IndependentWatchdog::new(p.IWDG, WATCHDOG_US);
    watchdog.unleash();
    // The new timeout is in force from the next feed on.
    watchdog.pet();

    let mut spi_config = spi::Config::default();
    spi_config.frequency = Hertz(8_000_000);
    // A missing chip reads 0, which means that it is not busy and that no swap is due.
    spi_config.miso_pull = Pull::Down;
    let bus = Spi::new_blocking(p.SPI2, p.PB13, p.PB15, p.PB14, spi_config);
    let select = Output::new(p.PB12, Level::High, Speed::VeryHigh);
    let Ok(device) = ExclusiveDevice::new_no_delay(BlockingAsync::new(bus), select);
    // Opening waits only while the chip is busy. A chip that stays busy does not prevent the start.
    if let Some(Ok(mut chip)) = poll_at_most(BUSY_POLLS, W25::<Q, _, _, _>::new_no_pins(device, SMALLEST_CHIP)) {
        // Other firmware may have left the chip in power-down mode, in which it ignores all other commands.
        let _ = poll_at_most(BUSY_POLLS, chip.disable_power_down_mode());
        cortex_m::asm::delay(WAKE_CYCLES);
        pac::PWR.cr2().modify(|w| {
            w.set_pls(SUPPLY_LEVEL);
            w.set_pvde(true);
        });
        cortex_m::asm::delay(DETECTOR_START_CYCLES);
        // While the supply rises, the chip may read wrong, and a swap that was interrupted would be taken for a completed one.
        for _ in 0..SUPPLY_POLLS {
            if is_supplied() {
                break;
            }
            cortex_m::asm::delay(SUPPLY_POLL_LOOPS);
        }
        let chip = Mutex::new(Supplied::new(chip, SMALLEST_CHIP, is_supplied));
        let flash = Flash::new_blocking(p.FLASH).into_blocking_regions().bank1_region;
        let own = BlockingMutex::<NoopRawMutex, _>::new(RefCell::new(WatchedFlash { flash, watchdog }));
        let active = BlockingPartition::new(&own, ACTIVE.start, MAX_IMAGE);
        if swap_if_due(&chip, active).is_err() {
            // The swap may have failed half-way, and then no image would run. It continues after the reset. With a low supply,
            // each start would erase the same sector of the controller's own flash again, so the loop waits for the supply. It
            // feeds the watchdog, because the application would report the reset by the watchdog as a stall of its own.
            while !is_supplied() {
                own.lock(|own| own.borrow_mut().watchdog.pet());
            }
            SCB::sys_reset()
        }
    }
    empty_flash_caches();
    // SAFETY: an image is at this address, and no interrupt can occur: `init` enables those of the DMA channels, which no driver
    // used here requests.
    unsafe {
        (*SCB::PTR).vtor.write(APPLICATION);
        cortex_m::asm::bootload(APPLICATION as *const u32)
    }
}

/// Empties the caches of the controller's flash, which otherwise may contain what a swap has replaced: neither the driver nor the
/// controller empties them after an erase. They can be emptied only while they are off.
fn empty_flash_caches() {
    let set = |is_on: bool, is_reset: bool| {
        pac::FLASH.acr().modify(|w| {
            w.set_icen(is_on);
            w.set_dcen(is_on);
            w.set_icrst(is_reset);
            w.set_dcrst(is_reset);
        });
    };
    set(false, false);
    set(false, true);
    set(false, false);
    set(true, false);
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    SCB::sys_reset()
}

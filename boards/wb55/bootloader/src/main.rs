//! The bootloader of the STM32WB55: swaps the images if a swap is due, and starts the active image.
//!
//! Only the bootloader writes the controller's own flash; the radio's core does not run yet.
#![no_std]
#![no_main]

use core::cell::RefCell;
use cortex_m::peripheral::SCB;
use cortex_m_rt::entry;
use embassy_boot_stm32::{BootLoader, State};
use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_embedded_hal::flash::partition::BlockingPartition;
use embassy_futures::block_on;
use embassy_stm32::flash::Flash;
use embassy_stm32::gpio::{Level, Output, Pull, Speed};
use embassy_stm32::rcc::{LsConfig, MSIRange};
use embassy_stm32::spi::{self, Spi};
use embassy_stm32::time::Hertz;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_sync::blocking_mutex::Mutex as BlockingMutex;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_hal_bus::spi::ExclusiveDevice;
use plantar::storage::boot::{BUFFER, config};
use plantar::storage::flash_map::{ACTIVE, BOOTLOADER, CHIP_BYTES, MAX_IMAGE};
use w25::{Q, W25};

/// Time within which an image on trial must set up the watchdog itself, us. Otherwise the watchdog resets the board, and the image
/// is swapped back.
const TRIAL_US: u32 = 20_000_000;

#[entry]
fn main() -> ! {
    let mut clocks = embassy_stm32::Config::default();
    // The internal oscillator needs no crystal. When the application starts, only its rate differs from the state after a reset.
    clocks.rcc.msi = Some(MSIRange::RANGE32M);
    clocks.rcc.hsi48 = None;
    clocks.rcc.ls = LsConfig::off();
    let p = embassy_stm32::init(clocks);

    let mut pins = spi::Config::default();
    pins.frequency = Hertz(16_000_000);
    // A missing chip reads 0, which means that it is not busy and that no swap is due.
    pins.miso_pull = Pull::Down;
    let bus = Spi::new_blocking(p.SPI2, p.PB13, p.PB15, p.PB14, pins);
    let select = Output::new(p.PB12, Level::High, Speed::VeryHigh);
    let Ok(device) = ExclusiveDevice::new_no_delay(BlockingAsync::new(bus), select);
    // Opening waits only while the chip is busy.
    let Ok(chip) = block_on(W25::<Q, _, _, _>::new_no_pins(device, CHIP_BYTES)) else { SCB::sys_reset() };
    let chip = Mutex::new(chip);
    let own = BlockingMutex::<NoopRawMutex, _>::new(RefCell::new(
        Flash::new_blocking(p.FLASH).into_blocking_regions().bank1_region,
    ));
    let active = BlockingPartition::new(&own, ACTIVE.start - BOOTLOADER.start, MAX_IMAGE);
    let swapped = BootLoader::try_prepare::<_, _, _, BUFFER>(config(&chip, active));
    let Ok(loader) = swapped else {
        // The swap failed half-way, so no image would run. It continues after the reset.
        SCB::sys_reset()
    };
    if loader.state == State::Swap {
        IndependentWatchdog::new(p.IWDG, TRIAL_US).unleash();
    }
    // SAFETY: an image is at this address, and the drivers used here leave no interrupt enabled.
    unsafe { loader.load(ACTIVE.start) }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    SCB::sys_reset()
}

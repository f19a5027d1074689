//! The bootloader of the emulated board: swaps the images if a swap is due, and starts the active image.
//!
//! The emulated controller's own flash is read-only. The active image is therefore stored in the file of the flash chip, and
//! the host loads it from there when it starts the emulator. After a swap the emulator exits, and the host starts it again with
//! the image that is active now.
#![no_std]
#![no_main]

use cortex_m::peripheral::SCB;
use cortex_m_rt::entry;
use embassy_boot::{BootError, State};
use embassy_sync::mutex::Mutex;
use emulation::{ACTIVE_IMAGE, FlashFile, SWAPPED, SWAPPED_FILE};
use plantar::protocol::update::CHUNK;
use plantar::storage::boot::{Blocking, swap_if_due};
use plantar::storage::flash_map::{ACTIVE, STM32_FLASH};
use plantar::storage::partition::Partition;
use semihosting::fs;

/// Address of the application.
const APPLICATION: u32 = STM32_FLASH + ACTIVE.start;

#[entry]
fn main() -> ! {
    // The file exists if the host started the emulator again after a swap.
    let is_continued = fs::remove_file(SWAPPED_FILE).is_ok();
    // The active image starts if no swap is due, if there is no chip, or if the swap fails.
    if !is_continued && swap() == Ok(State::Swap) {
        semihosting::process::exit(SWAPPED);
    }
    // SAFETY: the host has loaded an image to this address, and nothing else runs yet.
    unsafe {
        (*SCB::PTR).vtor.write(APPLICATION);
        cortex_m::asm::bootload(APPLICATION as *const u32)
    }
}

/// Swaps the images if a swap is due. Returns [`State::Swap`] if they were swapped or swapped back.
fn swap() -> Result<State, BootError> {
    let power_cut = emulation::configuration().and_then(|(config, _)| config.power_cut);
    let chip = Mutex::new(FlashFile::open(power_cut));
    let active = Blocking(Partition::<_, CHUNK>::new(&chip, ACTIVE_IMAGE));
    swap_if_due(&chip, active)
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    SCB::sys_reset()
}

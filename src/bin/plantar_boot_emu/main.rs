//! The emulated board's bootloader: swaps images where that is due, and starts the one that is active.
//!
//! The emulator's flash cannot be written: the active image lies in the file of the flash chip, from where the host loads it when
//! it starts the emulator. So after a swap the emulator ends, and the host starts it again.
#![no_std]
#![no_main]

#[path = "../plantar_emu/flash.rs"]
mod flash;

use cortex_m::peripheral::SCB;
use cortex_m_rt::entry;
use embassy_boot::{AlignedBuffer, BootError, BootLoader, State};
use embassy_sync::mutex::Mutex;
use flash::FlashFile;
use plantar::boot::{BUFFER, Blocking, config};
use plantar::emulation::{Head, SETUP_FILE, SWAPPED, SWAPPED_FILE};
use plantar::map::{ACTIVE, EMULATED_ACTIVE};
use plantar::update::{Area, CHUNK};
use semihosting::fs::{self, File};
use semihosting::io::Read;

#[entry]
fn main() -> ! {
    let goes_on = fs::remove_file(SWAPPED_FILE).is_ok();
    // Without a chip there is nothing to swap.
    if !goes_on && swap() == Ok(State::Swap) {
        semihosting::process::exit(SWAPPED);
    }
    // SAFETY: the host put an image there; nothing runs yet that would notice.
    unsafe {
        (*SCB::PTR).vtor.write(ACTIVE.start);
        cortex_m::asm::bootload(ACTIVE.start as *const u32)
    }
}

fn swap() -> Result<State, BootError> {
    let power_cut = head().and_then(|head| head.power_cut);
    let chip = Mutex::new(FlashFile::open(power_cut));
    let active = Blocking(Area::<_, CHUNK>::new(&chip, EMULATED_ACTIVE));
    BootLoader::new(config(&chip, active)).prepare_boot(AlignedBuffer([0; BUFFER]).as_mut())
}

fn head() -> Option<Head> {
    let mut bytes = [0; 256];
    let len = File::open(SETUP_FILE).and_then(|mut file| file.read(&mut bytes)).ok()?;
    Some(postcard::take_from_bytes(&bytes[..len]).ok()?.0)
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    SCB::sys_reset()
}

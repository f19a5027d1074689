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
use embassy_boot::{AlignedBuffer, BootLoader, State};
use embassy_sync::mutex::Mutex;
use flash::FlashFile;
use plantar::boot::{BUFFER, Blocking, config};
use plantar::emulation::{Head, RESTART, SETUP_FILE};
use plantar::map::{ACTIVE, EMULATED_ACTIVE};
use plantar::update::{Area, CHUNK};
use semihosting::fs::File;
use semihosting::io::Read;

#[entry]
fn main() -> ! {
    let power_cut = head().and_then(|head| head.power_cut);
    let chip = Mutex::new(FlashFile::open(power_cut));
    let active = Blocking(Area::<_, CHUNK>::new(&chip, EMULATED_ACTIVE));
    let mut buffer = AlignedBuffer([0; BUFFER]);
    // Without a chip there is nothing to swap.
    if BootLoader::new(config(&chip, active)).prepare_boot(buffer.as_mut()) == Ok(State::Swap) {
        semihosting::process::exit(RESTART);
    }
    // SAFETY: the host put an image there; nothing runs yet that would notice.
    unsafe {
        (*SCB::PTR).vtor.write(ACTIVE.start);
        cortex_m::asm::bootload(ACTIVE.start as *const u32)
    }
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

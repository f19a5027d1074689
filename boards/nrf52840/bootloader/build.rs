//! Links the bootloader of the nRF52840.

use build_support::{NRF52_FLASH, Program, link};

fn main() {
    // The same RAM as in the build script of the application, so that the region CRASH_RECORD is at the same address, and the
    // bootloader does not overwrite the crash record of the application.
    link(Program::Bootloader, NRF52_FLASH, 0x2000_0000..0x2002_0000, &[]);
}

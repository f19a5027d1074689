//! Links the bootloader of the nRF52840.

use build_support::{NRF52_FLASH, Program, link};

fn main() {
    // The RAM of the application, so that its crash record remains.
    link(Program::Bootloader, NRF52_FLASH, 0x2000_0000..0x2002_0000, &[]);
}

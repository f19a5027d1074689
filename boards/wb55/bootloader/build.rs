//! Links the bootloader of the STM32WB55.

use build_support::{Program, STM32_FLASH, link};

fn main() {
    // The RAM of the application, so that its crash record remains: 128 KiB of SRAM1.
    link(Program::Bootloader, STM32_FLASH, 0x2000_0000..0x2002_0000, &[]);
}

//! Links the program, which runs instead of the bootloader of the emulated board.

use build_support::{Program, STM32_FLASH, link};

fn main() {
    // The range is the RAM of the emulated board.
    link(Program::Bootloader, STM32_FLASH, 0x2000_0000..0x2002_0000, &[]);
}

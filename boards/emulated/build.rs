//! Links the application of the emulated board.

use build_support::{Program, STM32_FLASH, link};

fn main() {
    // The emulated STM32F405 has 128 KiB of SRAM at this address.
    link(Program::Application, STM32_FLASH, 0x2000_0000..0x2002_0000, &[]);
}

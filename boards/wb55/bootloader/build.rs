//! Links the bootloader of the STM32WB55.

use build_support::{Program, link};

fn main() {
    link(Program::Bootloader, 0x2000_0000..0x2002_0000, &[]);
}

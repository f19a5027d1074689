//! Links the application of the nRF52840.

use build_support::{NRF52_FLASH, Program, link, require_update_key};

fn main() {
    require_update_key();
    // The controller has 256 KiB of RAM. The firmware uses 128 KiB of it, as on the other boards.
    link(Program::Application, NRF52_FLASH, 0x2000_0000..0x2002_0000, &[]);
}

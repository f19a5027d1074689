//! Links the application of the STM32WB55.

use build_support::{Program, Region, STM32_FLASH, link, require_update_key};

/// The memory that is shared with the radio's core. With the factory value of option byte IPCCDBA, that core expects the tables
/// of the mailbox at the beginning of SRAM2A.
const MAILBOX: Region = Region { name: "MAILBOX", origin: 0x2003_0000, bytes: 10 << 10 };

fn main() {
    require_update_key();
    // SRAM1 has 192 KiB. The firmware uses 128 KiB of it, so that the same static memory fits all boards.
    link(Program::Application, STM32_FLASH, 0x2000_0000..0x2002_0000, &[MAILBOX]);
}

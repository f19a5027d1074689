//! Links the application.

use build_support::{Program, STM32_FLASH, link};

fn main() {
    // The range is the RAM of this board. All boards have the same offsets in their flash, but the flash begins at different
    // addresses.
    link(Program::Application, STM32_FLASH, 0x2000_0000..0x2002_0000, &[]);
    // The peripheral access crate of a microcontroller contains a file `device.x` with the names of its interrupts. This board
    // has none, so the file is empty.
    let folder = std::env::var("OUT_DIR").expect("cargo sets OUT_DIR");
    std::fs::write(format!("{folder}/device.x"), "").expect("cargo has created the folder");
    println!("cargo:rustc-link-search={folder}");
}

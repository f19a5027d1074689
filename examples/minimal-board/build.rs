//! Writes the memory regions of this board, and passes the application's linker scripts to the linker.

use build_support::{Program, STM32_FLASH, link};

fn main() {
    // `STM32_FLASH` is the address at which the controller's own flash begins, and the range is the RAM of this board: replace
    // both for another controller. The offsets in the flash are the same on all boards.
    link(Program::Application, STM32_FLASH, 0x2000_0000..0x2002_0000, &[]);
    // The peripheral access crate of a microcontroller contains a file `device.x` with the names of its interrupts. This board
    // uses no such crate, so the file is empty: delete these lines for a board that uses one.
    let folder = std::env::var("OUT_DIR").expect("cargo sets OUT_DIR");
    std::fs::write(format!("{folder}/device.x"), "").expect("cargo has created the folder");
    println!("cargo:rustc-link-search={folder}");
}

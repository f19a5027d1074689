//! Links the firmware binaries with `cortex-m-rt`'s script and, where it is used, `defmt`'s.

#[allow(dead_code, reason = "this script places code only")]
#[path = "src/map.rs"]
mod map;

use map::{ACTIVE, BOOTLOADER, HEADER, HEADER_BYTES};
use std::path::PathBuf;
use std::{env, fs};

/// Feature and binary, and whether it is a bootloader. One a build.
const BINARIES: [(&str, &str, bool); 4] = [
    ("EMU", "plantar_emu", false),
    ("WB55", "plantar_wb55", false),
    ("BOOT_EMU", "plantar_boot_emu", true),
    ("BOOT_WB55", "plantar_boot_wb55", true),
];

fn main() {
    println!("cargo:rerun-if-changed=memory.x");
    println!("cargo:rerun-if-changed=src/map.rs");
    let has_feature = |feature: &str| env::var_os(format!("CARGO_FEATURE_{feature}")).is_some();
    for (_, binary, is_bootloader) in BINARIES.into_iter().filter(|(feature, ..)| has_feature(feature)) {
        // Cargo always sets it.
        let folder = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default());
        let flash = if is_bootloader { BOOTLOADER } else { ACTIVE };
        let region = format!("FLASH : ORIGIN = {:#x}, LENGTH = {:#x}\n", flash.start, flash.end - flash.start);
        fs::write(folder.join("flash.x"), region).expect("the folder can be written");
        println!("cargo:rustc-link-search={}", folder.display());
        if !is_bootloader {
            let at = flash.start + HEADER;
            let header = format!(
                "_stext = {:#x};\nSECTIONS {{ .header {at:#x} : {{ KEEP(*(.header)) }} > FLASH }} INSERT AFTER .vector_table\n",
                at + HEADER_BYTES
            );
            fs::write(folder.join("header.x"), header).expect("the folder can be written");
            println!("cargo:rustc-link-arg-bin={binary}=-Theader.x");
        }
        println!("cargo:rustc-link-arg-bin={binary}=-Tlink.x");
        println!("cargo:rustc-link-arg-bin={binary}=--nmagic");
    }
    if has_feature("WB55") {
        println!("cargo:rustc-link-arg-bin=plantar_wb55=-Tdefmt.x");
    }
}

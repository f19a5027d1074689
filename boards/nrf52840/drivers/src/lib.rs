//! The parts of the nRF52840 board that its firmware and its bootloader share: the flash chip, the watchdog and short waits. Also
//! the charge of the battery, which is here because a host can test it, and the bootloader's measurement of the supply.
#![no_std]

pub mod battery;
pub mod flash;
#[cfg(target_os = "none")]
pub mod qspi;
#[cfg(target_os = "none")]
pub mod supply;
#[cfg(target_os = "none")]
pub mod watchdog;

/// Waits for about this number of cycles of the core, at least two thirds of it: an iteration of the loop takes three cycles on
/// this core, and never less than two.
#[cfg(target_os = "none")]
pub fn wait_cycles(cycles: u32) {
    cortex_m::asm::delay(cycles / 3);
}

/// Size of the flash chip on the XIAO, a P25Q16H, bytes.
pub const CHIP_BYTES: u32 = 2 << 20;

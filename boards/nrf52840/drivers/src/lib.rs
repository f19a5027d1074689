//! The parts of the nRF52840 board that its firmware and its bootloader share: the flash chip and the watchdog. Also the charge
//! of the battery, which is here because a host can test it, and the bootloader's measurement of the supply.
#![no_std]

pub mod battery;
pub mod flash;
#[cfg(target_os = "none")]
pub mod qspi;
#[cfg(target_os = "none")]
pub mod supply;
#[cfg(target_os = "none")]
pub mod watchdog;

/// Size of the flash chip on the XIAO, a P25Q16H, bytes.
pub const CHIP_BYTES: u32 = 2 << 20;

//! The parts of the nRF52840 board that its firmware and its bootloader share: the flash chip, the watchdog, short waits and the
//! ground of the battery's divider. Also the charge of the battery, which is here because a host can test it, and the
//! bootloader's measurement of the supply.
#![no_std]

pub mod battery;
pub mod flash;
#[cfg(target_os = "none")]
pub mod qspi;
#[cfg(target_os = "none")]
pub mod supply;
#[cfg(target_os = "none")]
pub mod watchdog;

/// Drives P0.14, the lower end of the battery's divider, low. While this pin floats, the analogue input P0.31 has the voltage of
/// the battery, up to 4.2 V, which is above the controller's supply.
#[cfg(target_os = "none")]
pub fn ground_divider() {
    // After a reset, the output register of the port is 0, and no code changes the bit of this pin.
    embassy_nrf::pac::P0.dirset().write(|w| w.set_pin(14, true));
}

/// Waits for about this number of cycles of the core, at least two thirds of it: an iteration of the loop takes three cycles on
/// this core, and never less than two.
#[cfg(target_os = "none")]
pub fn wait_cycles(cycles: u32) {
    cortex_m::asm::delay(cycles / 3);
}

/// Size of the flash chip on the XIAO, a P25Q16H, bytes.
pub const CHIP_BYTES: u32 = 2 << 20;

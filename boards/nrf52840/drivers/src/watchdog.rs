//! The hardware watchdog. It counts the low-frequency clock, for which it starts the internal RC oscillator if no other source
//! runs. No program can stop it once it runs; among others, a reset by the pin, System OFF and a loss of power do. Its timeout
//! cannot be changed while it runs, so the bootloader and the application use the same timeout.

use embassy_nrf::pac::WDT;
use embassy_nrf::pac::wdt::regs::Rren;
use embassy_nrf::pac::wdt::vals::{Halt, Rr, Sleep};

/// The watchdog resets the board after this time, ms. The longest times without feeding it are 0.1 s between two checks of the
/// supervision, 0.1 s for an operation of the controller's own flash, and at most 0.5 s in `embassy_nrf::init`, which waits
/// until the crystal oscillates.
const TIMEOUT_MS: u32 = 1_000;
/// The rate of the watchdog's counter, ticks per s.
const TICKS_PER_S: u32 = 32_768;

/// Starts the watchdog, unless it already runs, and feeds it. It is paused while a debugger halts the core.
pub fn start() {
    if !WDT.runstatus().read().runstatus() {
        WDT.config().write(|w| {
            w.set_sleep(Sleep::Run);
            w.set_halt(Halt::Pause);
        });
        WDT.crv().write_value(TIMEOUT_MS * TICKS_PER_S / 1000);
        // Only the first of the eight reload registers must be written to feed the watchdog.
        WDT.rren().write_value(Rren(1));
        WDT.tasks_start().write_value(1);
    }
    feed();
}

/// Prevents the reset for another timeout.
pub fn feed() {
    WDT.rr(0).write(|w| w.set_rr(Rr::Reload));
}

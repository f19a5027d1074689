//! The controller's supply, measured without interrupts, for the bootloader. The power-fail comparator is not used instead,
//! because its warning blocks the operations of the controller's own flash.

use crate::battery;
use core::sync::atomic::{AtomicU16, Ordering, fence};
use embassy_nrf::pac::SAADC;
use embassy_nrf::pac::saadc::vals::{Gain, Psel, Tacq, Val};

/// Number of checks whether the converter has completed an operation. It needs some 15 us, and each check takes at least 50 ns.
const CHECKS: u32 = 10_000;

/// The result, which the converter writes.
static CODE: AtomicU16 = AtomicU16::new(0);

/// The supply, mV; `None` if the converter does not respond. The converter is off afterwards.
pub fn millivolts() -> Option<u16> {
    SAADC.enable().write(|w| w.set_enable(true));
    SAADC.resolution().write(|w| w.set_val(Val::_12bit));
    SAADC.ch(0).pselp().write(|w| w.set_pselp(Psel::Vdd));
    // The rest of the configuration is 0: the internal reference, single-ended.
    SAADC.ch(0).config().write(|w| {
        w.set_gain(Gain::Gain16);
        w.set_tacq(Tacq::_10us);
    });
    SAADC.result().ptr().write_value(CODE.as_ptr() as u32);
    SAADC.result().maxcnt().write(|w| w.set_maxcnt(1));
    let is_set = |event: embassy_nrf::pac::common::Reg<u32, _>| (0..CHECKS).any(|_| event.read() != 0);
    SAADC.events_end().write_value(0);
    SAADC.events_stopped().write_value(0);
    SAADC.tasks_start().write_value(1);
    SAADC.tasks_sample().write_value(1);
    let has_ended = is_set(SAADC.events_end());
    SAADC.tasks_stop().write_value(1);
    // Without a response, the converter is switched off all the same.
    let _ = is_set(SAADC.events_stopped());
    SAADC.ch(0).pselp().write(|w| w.set_pselp(Psel::Nc));
    SAADC.enable().write(|w| w.set_enable(false));
    fence(Ordering::Acquire);
    has_ended.then(|| battery::supply_millivolts(CODE.load(Ordering::Relaxed).cast_signed()))
}

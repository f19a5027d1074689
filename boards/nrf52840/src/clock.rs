//! The controller's clocks, and waits with a finer resolution than the ticks of the time driver, which last 30.5 us.

use core::future::poll_fn;
use core::task::Poll;
use embassy_nrf::interrupt;
use embassy_nrf::pac;
use embassy_nrf::pac::clock::vals::{HfclkstatSrc, Lfclksrc};
use embassy_nrf::pac::timer::vals::{Bitmode, Mode};
use embassy_nrf::{Peri, peripherals};
use embassy_sync::waitqueue::AtomicWaker;
use nrf52840_drivers::{wait_cycles, watchdog};

/// The core's clock, kHz.
pub const CORE_KHZ: u32 = 64_000;
/// Longest time until the crystal of 32,768 Hz oscillates, ms. By the data sheet it takes a quarter of a second.
const CRYSTAL_LIMIT_MS: u32 = 500;
/// Longest time until the crystal of 32 MHz oscillates, ms. By the data sheet it takes 0.4 ms.
const FAST_CRYSTAL_LIMIT_MS: u32 = 5;
/// Longest time until the low-frequency clock has stopped, ms.
const STOP_LIMIT_MS: u32 = 5;

/// Checks a condition every millisecond, and feeds the watchdog meanwhile. Returns false if it is not met within `limit_ms`.
fn within_ms(limit_ms: u32, condition: impl Fn() -> bool) -> bool {
    (0..limit_ms).any(|_| {
        watchdog::feed();
        wait_cycles(CORE_KHZ);
        condition()
    })
}

/// Starts the crystal of 32,768 Hz; returns true if it oscillates. Then stops the clock again, because its source can be changed
/// only while it is stopped.
pub fn has_crystal() -> bool {
    pac::CLOCK.lfclksrc().write(|w| w.set_src(Lfclksrc::Xtal));
    pac::CLOCK.events_lfclkstarted().write_value(0);
    pac::CLOCK.tasks_lfclkstart().write_value(1);
    let has_started = within_ms(CRYSTAL_LIMIT_MS, || pac::CLOCK.events_lfclkstarted().read() != 0);
    pac::CLOCK.tasks_lfclkstop().write_value(1);
    pac::CLOCK.events_lfclkstarted().write_value(0);
    // A timeout is ignored, because `embassy_nrf::init` selects the source and starts the clock in any case. It is assumed that
    // this also works while the watchdog runs, which uses the same clock: see docs/bring-up.md.
    within_ms(STOP_LIMIT_MS, || !pac::CLOCK.lfclkstat().read().state());
    has_started
}

/// Waits until the high-frequency clock comes from its crystal, which the radio has requested, but not longer than
/// [`FAST_CRYSTAL_LIMIT_MS`]: without the radio nothing requests it, and the clock does not change.
pub fn wait_for_fast_crystal() {
    within_ms(FAST_CRYSTAL_LIMIT_MS, || {
        let status = pac::CLOCK.hfclkstat().read();
        status.state() && status.src() == HfclkstatSrc::Xtal
    });
}

static ELAPSED: AtomicWaker = AtomicWaker::new();

/// A timer with a resolution of 1 us, which runs only while something waits for it: the future of a wait must be awaited to its
/// end, because this stops the timer.
pub struct Microseconds(Peri<'static, peripherals::TIMER2>);

impl Microseconds {
    /// Configures the timer. The interrupt `TIMER2` must be enabled.
    pub fn new(timer: Peri<'static, peripherals::TIMER2>) -> Self {
        pac::TIMER2.mode().write(|w| w.set_mode(Mode::Timer));
        pac::TIMER2.bitmode().write(|w| w.set_bitmode(Bitmode::_32bit));
        // 16 MHz / 2^4.
        pac::TIMER2.prescaler().write(|w| w.set_prescaler(4));
        pac::TIMER2.shorts().write(|w| w.set_compare_stop(0, true));
        Self(timer)
    }

    /// Waits for `us` microseconds, which must not be 0.
    pub async fn wait(&mut self, us: u32) {
        pac::TIMER2.tasks_stop().write_value(1);
        pac::TIMER2.tasks_clear().write_value(1);
        pac::TIMER2.cc(0).write_value(us);
        pac::TIMER2.events_compare(0).write_value(0);
        pac::TIMER2.intenset().write(|w| w.set_compare(0, true));
        pac::TIMER2.tasks_start().write_value(1);
        poll_fn(|context| {
            ELAPSED.register(context.waker());
            if pac::TIMER2.events_compare(0).read() != 0 { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
        // A timer that was only stopped continues to draw current (erratum 78).
        pac::TIMER2.tasks_shutdown().write_value(1);
    }
}

#[interrupt]
fn TIMER2() {
    pac::TIMER2.intenclr().write(|w| w.set_compare(0, true));
    ELAPSED.wake();
}

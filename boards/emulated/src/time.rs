//! The time driver: it reads the time from the counter of TIM5, and has a queue with the times at which tasks must be woken.
//!
//! For this driver, SysTick only causes the regular checks of the queue. It does not count the time, because on a busy host the
//! emulator drops some of its interrupts, so that the time would run slow.

use core::cell::RefCell;
use core::task::Waker;
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use embassy_sync::blocking_mutex::CriticalSectionMutex;
use embassy_time_driver::{Driver, TICK_HZ};
use embassy_time_queue_utils::Queue;
use stm32_metapac::TIM5;

/// The emulator's core clock.
const CORE_HZ: u32 = 168_000_000;
/// The emulator's timer clock, regardless of the clock tree.
const TIMER_HZ: u64 = 1_000_000_000;
/// SysTick counts down from this value to 0 once in a millisecond, the granularity of the timers of `embassy-time` on this board.
pub const RELOAD: u32 = CORE_HZ / 1_000 - 1;

/// The time driver; the handler of the exception SysTick must call [`Time::on_interrupt`].
pub struct Time(CriticalSectionMutex<RefCell<State>>);

struct State {
    /// Number of wraps of the counter. The counter wraps after 71 minutes and is read every millisecond.
    wraps: u32,
    /// The last value of the counter.
    last: u32,
    queue: Queue,
}

impl State {
    fn now(&mut self) -> u64 {
        let count = TIM5.cnt().read();
        self.wraps += u32::from(count < self.last);
        self.last = count;
        u64::from(self.wraps) << 32 | u64::from(count)
    }
}

impl Time {
    /// A time driver that is not started yet.
    pub const fn new() -> Self {
        Self(CriticalSectionMutex::new(RefCell::new(State { wraps: 0, last: 0, queue: Queue::new() })))
    }

    /// Starts the counter at 0, and the exception SysTick.
    pub fn start(&self, systick: &mut SYST) {
        TIM5.psc().write_value((TIMER_HZ / TICK_HZ - 1) as u16);
        TIM5.cr1().write(|w| w.set_cen(true));
        // After a reset the emulated counter does not start from 0.
        TIM5.cnt().write_value(0);
        systick.set_clock_source(SystClkSource::Core);
        systick.set_reload(RELOAD);
        systick.clear_current();
        systick.enable_counter();
        systick.enable_interrupt();
    }

    /// Wakes the tasks that are due. The queue is checked once a millisecond, so no alarm needs to be set.
    pub fn on_interrupt(&self) {
        self.0.lock(|state| {
            let mut state = state.borrow_mut();
            let now = state.now();
            state.queue.next_expiration(now);
        });
    }
}

impl Driver for Time {
    fn now(&self) -> u64 {
        self.0.lock(|state| state.borrow_mut().now())
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        // The interrupt is periodic, so a change of the next expiry needs no action.
        self.0.lock(|state| state.borrow_mut().queue.schedule_wake(at, waker));
    }
}

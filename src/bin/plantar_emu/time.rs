//! Time from SysTick, for the executor's own queue of timers.

use core::cell::RefCell;
use core::task::Waker;
use cortex_m::peripheral::SYST;
use embassy_sync::blocking_mutex::CriticalSectionMutex;
use embassy_time_driver::{Driver, TICK_HZ};
use embassy_time_queue_utils::Queue;
use systick_timer::Timer;

/// The emulator's core clock.
const CORE_HZ: u64 = 168_000_000;
/// SysTick counts down from here once a millisecond: the granularity of this board's timers.
pub const RELOAD: u32 = (CORE_HZ / 1_000) as u32 - 1;

/// The time driver; SysTick's exception must call [`Time::on_interrupt`].
pub struct Time {
    clock: Timer,
    queue: CriticalSectionMutex<RefCell<Queue>>,
}

impl Time {
    pub const fn new() -> Self {
        Self {
            clock: Timer::new(TICK_HZ, RELOAD, CORE_HZ),
            queue: CriticalSectionMutex::new(RefCell::new(Queue::new())),
        }
    }

    pub fn start(&self, systick: &mut SYST) {
        self.clock.start(systick);
    }

    /// Wakes whoever is due. The queue is looked through once a millisecond, so no alarm needs to be set.
    pub fn on_interrupt(&self) {
        self.clock.systick_handler();
        self.queue.lock(|queue| queue.borrow_mut().next_expiration(self.clock.now()));
    }
}

impl Driver for Time {
    fn now(&self) -> u64 {
        self.clock.now()
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        // Whether the next expiry changed does not matter here.
        self.queue.lock(|queue| queue.borrow_mut().schedule_wake(at, waker));
    }
}

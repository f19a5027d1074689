//! Virtual time: the `embassy-time` driver of tests. Time passes only when a test advances it.
//!
//! Every thread has a clock of its own, so that tests can run in parallel. A simulated insole counts its time from its own
//! start: its tasks run within [`with_origin`].

use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;
use std::cell::{Cell, RefCell};
use std::task::Waker;

thread_local! {
    static NOW_US: Cell<u64> = const { Cell::new(0) };
    static ORIGIN_US: Cell<u64> = const { Cell::new(0) };
    static TIMERS: RefCell<Queue> = const { RefCell::new(Queue::new()) };
}

struct VirtualTime;

embassy_time_driver::time_driver_impl!(static DRIVER: VirtualTime = VirtualTime);

impl Driver for VirtualTime {
    fn now(&self) -> u64 {
        now_us() - ORIGIN_US.get()
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        // A timer at `u64::MAX` never expires, and would stay in the queue after its insole restarts.
        if let Some(at) = at.checked_add(ORIGIN_US.get()).filter(|at| *at != u64::MAX) {
            TIMERS.with_borrow_mut(|timers| timers.schedule_wake(at, waker));
        }
    }
}

/// Virtual time since this thread began, us.
pub fn now_us() -> u64 {
    NOW_US.get()
}

/// Restores the origin of the clock when it is dropped, also while a reset or a panic unwinds the stack.
struct RestoredOrigin {
    before_us: u64,
}

impl Drop for RestoredOrigin {
    fn drop(&mut self) {
        ORIGIN_US.set(self.before_us);
    }
}

/// Runs `work` with a clock that started at `origin_us`.
pub fn with_origin<T>(origin_us: u64, work: impl FnOnce() -> T) -> T {
    let _origin = RestoredOrigin { before_us: ORIGIN_US.replace(origin_us) };
    work()
}

/// Removes all timers of this thread. To be called before a simulation begins, because the timers of the previous simulation may
/// still be queued.
pub fn clear_timers() {
    TIMERS.replace(Queue::new());
}

/// Wakes the tasks whose timers are due; returns the time of the next timer, us, and `u64::MAX` if there is none.
pub fn wake_due() -> u64 {
    TIMERS.with_borrow_mut(|timers| timers.next_expiration(now_us()))
}

/// Advances the clock to this time.
///
/// # Panics
/// If the time is in the past.
pub fn advance_to(at_us: u64) {
    assert!(at_us >= now_us(), "time must not go backwards");
    NOW_US.set(at_us);
}

#[cfg(test)]
mod tests {
    use super::{advance_to, now_us, with_origin};
    use embassy_time::Instant;
    use std::panic::{catch_unwind, resume_unwind};

    #[test]
    fn a_reset_of_an_insole_leaves_the_clock_of_other_code_unchanged() {
        advance_to(5_000);
        let reset = catch_unwind(|| {
            with_origin(2_000, || {
                assert_eq!(Instant::now().as_micros(), 3_000);
                resume_unwind(Box::new(()))
            })
        });
        assert!(reset.is_err());
        assert_eq!(Instant::now().as_micros(), now_us());
    }
}

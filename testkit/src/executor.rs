//! An executor for the tasks of one simulated insole.

use crate::virtual_time::with_origin;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, Wake, Waker};

struct Task {
    name: &'static str,
    future: Pin<Box<dyn Future<Output = ()>>>,
    is_woken: Arc<Woken>,
    waker: Waker,
    is_stalled: bool,
}

/// Whether a task was woken since it last ran.
struct Woken(AtomicBool);

impl Wake for Woken {
    fn wake(self: Arc<Self>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Why a simulated processor is reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetCause {
    /// The firmware requested the reset.
    Software,
    /// The watchdog found stalled parts of the firmware: the bits that [`plantar::firmware::supervise::Watchdog::check`]
    /// returned.
    Watchdog(u32),
    /// The firmware panicked.
    Panic,
}

impl ResetCause {
    /// The bits of the stalled parts; 0 without any.
    pub fn stalled(self) -> u32 {
        if let Self::Watchdog(stalled) = self { stalled } else { 0 }
    }
}

/// Resets the insole to which the running task belongs: all tasks of that insole end.
pub fn reset(cause: ResetCause) -> ! {
    resume_unwind(Box::new(cause))
}

/// Runs tasks in the order in which they were spawned.
pub struct Executor {
    tasks: Vec<Task>,
    origin_us: u64,
}

impl Executor {
    /// An executor without tasks. The clock of its tasks starts at `origin_us`.
    pub fn new(origin_us: u64) -> Self {
        Self { tasks: Vec::new(), origin_us }
    }

    /// Adds a task.
    pub fn spawn(&mut self, name: &'static str, future: impl Future<Output = ()> + 'static) {
        let is_woken = Arc::new(Woken(AtomicBool::new(true)));
        let waker = Waker::from(is_woken.clone());
        self.tasks.push(Task { name, future: Box::pin(future), is_woken, waker, is_stalled: false });
    }

    /// Stops running the task with this name, as if it were in an endless loop.
    pub fn stall(&mut self, name: &str) {
        self.tasks.iter_mut().filter(|task| task.name == name).for_each(|task| task.is_stalled = true);
    }

    /// Runs each woken task once, and stops early if `is_off` returns true after a task. Returns true if a task ran.
    ///
    /// # Errors
    /// The reset that a task caused.
    ///
    /// # Panics
    /// If a task panics; [`reset`] does not count as a panic.
    pub fn run_woken(&mut self, mut is_off: impl FnMut() -> bool) -> Result<bool, ResetCause> {
        let mut has_run = false;
        let mut index = 0;
        while let Some(task) = self.tasks.get_mut(index) {
            index += 1;
            if task.is_stalled || !task.is_woken.0.swap(false, Ordering::Relaxed) {
                continue;
            }
            has_run = true;
            let mut context = Context::from_waker(&task.waker);
            let poll = || with_origin(self.origin_us, || task.future.as_mut().poll(&mut context));
            match catch_unwind(AssertUnwindSafe(poll)) {
                Ok(Poll::Pending) => {}
                Ok(Poll::Ready(())) => {
                    index -= 1;
                    self.tasks.remove(index);
                }
                Err(payload) => return Err(reset_of(payload)),
            }
            if is_off() {
                break;
            }
        }
        Ok(has_run)
    }
}

/// The reset that unwound a task. Any other panic continues to unwind.
fn reset_of(payload: Box<dyn Any + Send>) -> ResetCause {
    match payload.downcast::<ResetCause>() {
        Ok(cause) => *cause,
        Err(payload) => resume_unwind(payload),
    }
}

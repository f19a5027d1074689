//! Scan, processing and watchdog in all orders in which they can interrupt each other. Needs `RUSTFLAGS="--cfg shuttle"`, with
//! which the library's counters are Shuttle's atomics: `cargo xtask assure` sets it.
#![cfg(shuttle)]

use critical_section as _; // links the host's implementation of the critical sections that the firmware uses
use embassy_sync::zerocopy_channel::Channel;
use plantar::firmware::board::{FrameClock, Gauges, Matrix, MatrixTimeout};
use plantar::firmware::scan::{Frame, ScanCounters, scan};
use plantar::firmware::shared::{Carrier, Exchange, Shared};
use plantar::firmware::supervise::{Heartbeats, Part, STALLED_CHECKS, Watchdog};
use plantar::protocol::session::Session;
use plantar::protocol::{MAJOR, MAX_MESSAGE, MINOR, Status, ToDevice, ToHost, decode};
use proofs::acknowledgement::hello;
use shuttle::scheduler::{DfsScheduler, Schedule, Scheduler, Task, TaskId};
use shuttle::{Config, Runner, thread};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::future::poll_fn;
use std::pin::Pin;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Waker};

/// A stopped clock: these tests do not depend on time.
struct Clock;

embassy_time_driver::time_driver_impl!(static CLOCK: Clock = Clock);

impl embassy_time_driver::Driver for Clock {
    fn now(&self) -> u64 {
        0
    }

    fn schedule_wake(&self, _: u64, _: &Waker) {}
}

/// The names of the threads. The first character is the urgency of the thread: a thread with a higher character is more urgent.
/// The main thread, which prepares the others and checks the result, is the most urgent one: Shuttle names it `main-thread`,
/// and letters are above digits.
const PROCESSING: &str = "1 processing";
const SCAN: &str = "2 scan";
const WATCHDOG: &str = "3 watchdog";
/// The urgency of a thread without a name, above those of the three threads with these names.
const UNNAMED: char = '9';

/// A scheduler for all orders that are possible on one core with priorities: a thread, which is one activation of a loop, is
/// interrupted only by more urgent ones, and continues once these have ended. Threads of the same urgency run one after the
/// other, in the order in which they were created.
struct Priorities {
    orders: DfsScheduler,
    /// The threads that have begun to run.
    begun: BTreeSet<TaskId>,
}

impl Scheduler for Priorities {
    fn new_execution(&mut self) -> Option<Schedule> {
        self.begun.clear();
        self.orders.new_execution()
    }

    fn next_task(&mut self, runnable: &[&Task], current: Option<TaskId>, is_yielding: bool) -> Option<TaskId> {
        let urgency = |task: &Task| task.name().and_then(|name| name.chars().next()).unwrap_or(UNNAMED);
        let has_begun = |task: &Task| self.begun.contains(&task.id());
        let most_urgent = runnable.iter().filter(|task| has_begun(task)).map(|task| urgency(task)).max();
        let is_first = |task: &Task| {
            let same = |other: &&&Task| urgency(other) == urgency(task) && !has_begun(other);
            runnable.iter().find(same).is_some_and(|first| first.id() == task.id())
        };
        let can_run = |task: &&&Task| match most_urgent {
            Some(most_urgent) if has_begun(task) => urgency(task) == most_urgent,
            Some(most_urgent) => urgency(task) > most_urgent && is_first(task),
            None => is_first(task),
        };
        let possible: Vec<&Task> = runnable.iter().filter(can_run).copied().collect();
        let next = self.orders.next_task(&possible, current, is_yielding)?;
        self.begun.insert(next);
        Some(next)
    }

    fn next_u64(&mut self) -> u64 {
        self.orders.next_u64()
    }
}

/// Runs `test` in all orders; returns the number of orders.
fn in_all_orders(test: impl Fn() + Send + Sync + 'static) -> usize {
    let scheduler = Priorities { orders: DfsScheduler::new(None, false), begun: BTreeSet::new() };
    let mut config = Config::new();
    config.stack_size = 1 << 18;
    Runner::new(scheduler, config).run(test)
}

fn start(name: &str, work: impl FnOnce() + Send + 'static) -> thread::JoinHandle<()> {
    thread::Builder::new().name(name.into()).spawn(work).expect("Shuttle starts the thread")
}

/// A frame clock that returns each frame number once, after a test has set it.
struct SetClock(Arc<Mutex<Option<u32>>>);

impl FrameClock for SetClock {
    fn start(&self) -> embassy_time::Instant {
        embassy_time::Instant::MIN
    }

    async fn next(&mut self) -> u32 {
        poll_fn(|_| self.0.lock().expect("not poisoned").take().map_or(Poll::Pending, Poll::Ready)).await
    }
}

/// A matrix of one row, which does not answer in frame 3.
struct OneRow;

impl Matrix for OneRow {
    fn rows(&self) -> usize {
        1
    }

    async fn read_row(&mut self, seq: u32, _: usize, _: &mut [u16; 256]) -> Result<(), MatrixTimeout> {
        if seq == 3 { Err(MatrixTimeout) } else { Ok(()) }
    }
}

/// The shared state with an open session.
fn connected(counters: &'static ScanCounters) -> Shared {
    let gauges = Gauges { stack_bytes: || 0, supply_mv: || None };
    let exchange = Box::leak(Box::new(RefCell::new(Exchange::Idle)));
    let session = Box::leak(Box::new(RefCell::new(Session::new())));
    let shared = Shared::new(hello(), 1000, counters, gauges, exchange, session);
    shared.receive(Carrier::Serial, Some(ToDevice::Connect { major: MAJOR, minor: MINOR }));
    shared.next(Carrier::Serial, &mut [0; MAX_MESSAGE]);
    shared
}

/// Requests the counters as a host does, and returns them.
fn status(shared: &Shared) -> Status {
    shared.receive(Carrier::Serial, Some(ToDevice::GetStatus));
    let mut buffer = [0; MAX_MESSAGE];
    match shared.next(Carrier::Serial, &mut buffer).and_then(decode) {
        Some(ToHost::Status(status)) => status,
        other => panic!("no status: {other:?}"),
    }
}

/// Frames 0, 1, 3 and 4 become due while processing evaluates frames and a host reads the counters. Frame 2 is missed, the
/// matrix does not answer in frame 3, and the queue has room for one frame. No matter when the scan interrupts the other loops,
/// every frame is counted once.
#[test]
fn every_frame_is_counted_once_in_all_orders() {
    const NUMBERS: [u32; 4] = [0, 1, 3, 4];
    let orders = in_all_orders(|| {
        let counters: &'static ScanCounters = Box::leak(Box::new(ScanCounters::new()));
        let buffer: &'static mut [Frame; 1] = Box::leak(Box::new([Frame::EMPTY]));
        let queue: &'static mut Channel<'static, _, Frame> = Box::leak(Box::new(Channel::new(buffer)));
        let (sender, mut receiver) = queue.split();
        let due = Arc::new(Mutex::new(None));
        let scan = scan(SetClock(due.clone()), OneRow, sender, counters);
        let scan: Arc<Mutex<Pin<Box<dyn Future<Output = _> + Send>>>> = Arc::new(Mutex::new(Box::pin(scan)));
        let frame_times = Arc::new(AtomicU32::new(0));
        let times = frame_times.clone();
        let processing = start(PROCESSING, move || {
            let shared = connected(counters);
            let before = times.load(Ordering::Relaxed);
            if receiver.try_receive().is_some() {
                receiver.receive_done();
                counters.heartbeats.frame_processed();
            }
            // A frame that waits in the queue is not counted yet. `times` is the number of frame times whose scans have ended.
            let counted = status(&shared).frame_times();
            let after = times.load(Ordering::Relaxed);
            assert!((before.saturating_sub(1)..=after).contains(&counted), "{before}, {counted}, {after}");
        });
        let scans = NUMBERS.map(|number| {
            let (due, scan, times) = (due.clone(), scan.clone(), frame_times.clone());
            start(SCAN, move || {
                *due.lock().expect("not poisoned") = Some(number);
                let polled = scan.lock().expect("not poisoned").as_mut().poll(&mut Context::from_waker(Waker::noop()));
                assert!(polled.is_pending());
                times.store(number + 1, Ordering::Relaxed);
            })
        });
        scans.into_iter().chain([processing]).for_each(|thread| thread.join().expect("no panic"));
        let status = status(&connected(counters));
        assert_eq!(status.frame_times() + counters.heartbeats.pending_frames(), 5);
        assert!(status.frames_missed >= 1 && status.frames_skipped == 0);
    });
    assert!(orders > 100, "{orders}");
}

/// The watchdog interrupts a scan whose last heartbeat is almost too long ago. It reports the scan if and only if it runs
/// before the next heartbeat of the scan, and never finds more frames pending than were queued.
#[test]
fn the_watchdog_reports_a_scan_only_before_its_next_heartbeat_in_all_orders() {
    let orders = in_all_orders(|| {
        let heartbeats = Arc::new(Heartbeats::new());
        let mut watchdog = Watchdog::new();
        heartbeats.scan_progressed();
        for check in 0..STALLED_CHECKS {
            [Part::Link, Part::Storage].into_iter().for_each(|part| heartbeats.progressed(part));
            assert_eq!(watchdog.check(&heartbeats), 0, "check {check}");
        }
        let (watchdog, has_progressed) = (Arc::new(Mutex::new(watchdog)), Arc::new(AtomicU32::new(0)));
        let (scan_heartbeats, progressed) = (heartbeats.clone(), has_progressed.clone());
        let processing_heartbeats = heartbeats.clone();
        let processing = start(PROCESSING, move || {
            for _ in 0..processing_heartbeats.pending_frames() {
                processing_heartbeats.frame_processed();
            }
        });
        let scan = start(SCAN, move || {
            scan_heartbeats.frame_queued();
            scan_heartbeats.scan_progressed();
            progressed.store(1, Ordering::Relaxed);
        });
        let checks = [(); 2].map(|()| {
            let (heartbeats, has_progressed, watchdog) = (heartbeats.clone(), has_progressed.clone(), watchdog.clone());
            start(WATCHDOG, move || {
                heartbeats.progressed(Part::Link);
                let is_expected = has_progressed.load(Ordering::Relaxed) == 0;
                let reported = watchdog.lock().expect("not poisoned").check(&heartbeats);
                assert_eq!(reported & 1 << Part::Scan as u32 != 0, is_expected);
                assert!(heartbeats.pending_frames() <= 1);
            })
        });
        checks.into_iter().chain([scan, processing]).for_each(|thread| thread.join().expect("no panic"));
        assert_eq!((heartbeats.count(Part::Scan), heartbeats.count(Part::Link)), (2, u32::from(STALLED_CHECKS) + 2));
    });
    assert!(orders > 100, "{orders}");
}

/// A counter with two writers loses counts; this is why each counter has one writer. The test also shows that tests in all
/// orders find such a loss.
#[test]
fn a_second_writer_would_lose_counts() {
    let fewest = Arc::new(AtomicU32::new(u32::MAX));
    let fewest_seen = fewest.clone();
    in_all_orders(move || {
        let heartbeats = Arc::new(Heartbeats::new());
        let writers = [PROCESSING, SCAN].map(|name| {
            let heartbeats = heartbeats.clone();
            start(name, move || heartbeats.frame_processed())
        });
        writers.into_iter().for_each(|thread| thread.join().expect("no panic"));
        fewest_seen.fetch_min(heartbeats.processed(), Ordering::Relaxed);
    });
    assert_eq!(fewest.load(Ordering::Relaxed), 1);
}

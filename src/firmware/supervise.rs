//! Supervision: heartbeats of scan, processing and link, and the detection of a stalled one.
//!
//! The tasks count heartbeats; an interrupt above their executors checks them every [`CHECK_PERIOD_MS`]. Checks are counted, not
//! time: a processor that is stopped for seconds, as by a debugger, is one check late, and nothing counts as stalled.

use core::sync::atomic::{AtomicU32, Ordering};

/// Time between checks, ms.
pub const CHECK_PERIOD_MS: u32 = 100;
/// Number of successive checks without a heartbeat after which a part counts as stalled: one second, because the insole must run
/// again within two. Every part has a heartbeat at least every 200 ms.
pub const STALLED_CHECKS: u8 = 10;
/// Number of healthy checks after which a start counts as successful: 5 s.
pub const HEALTHY_CHECKS: u32 = 50;
/// Number of checks within which all parts must have started: two minutes. Erasing a flash chip with foreign contents takes that
/// long; any other start takes a second.
pub const START_CHECKS: u32 = 1200;

/// Names of the three parts, in the order of the bits that [`Watchdog::check`] returns.
pub const PARTS: [&str; 3] = ["scan", "model", "link"];

/// Counters that change while their part makes progress. Each has one writer.
#[derive(Default)]
pub struct Heartbeats {
    scan: AtomicU32,
    queued: AtomicU32,
    processed: AtomicU32,
    link: AtomicU32,
}

fn count(counter: &AtomicU32) {
    counter.store(counter.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
}

impl Heartbeats {
    /// No heartbeat yet.
    pub const fn new() -> Self {
        Self {
            scan: AtomicU32::new(0),
            queued: AtomicU32::new(0),
            processed: AtomicU32::new(0),
            link: AtomicU32::new(0),
        }
    }

    /// Scanning made progress: a row, a skipped frame, a matrix that does not answer, or a frame clock that waits deliberately.
    pub fn scan_progressed(&self) {
        count(&self.scan);
    }

    /// A frame was queued for processing.
    pub fn frame_queued(&self) {
        count(&self.queued);
    }

    /// A frame was processed.
    pub fn frame_processed(&self) {
        count(&self.processed);
    }

    /// The link made progress.
    pub fn link_progressed(&self) {
        count(&self.link);
    }

    /// Number of processed frames; wraps.
    pub fn processed(&self) -> u32 {
        self.processed.load(Ordering::Relaxed)
    }

    /// Number of frames that wait for processing, the one that is being processed included.
    pub fn pending_frames(&self) -> u32 {
        self.queued.load(Ordering::Relaxed).wrapping_sub(self.processed())
    }

    /// The counts of all three parts, in the order of [`PARTS`].
    pub fn counts(&self) -> [u32; 3] {
        [self.scan.load(Ordering::Relaxed), self.processed(), self.link.load(Ordering::Relaxed)]
    }
}

/// The state of the checks.
#[derive(Clone, Copy, Default)]
pub struct Watchdog {
    checks: u32,
    healthy_checks: u32,
    before: [u32; 3],
    stalled: [u8; 3],
}

impl Watchdog {
    /// No check yet.
    pub const fn new() -> Self {
        Self { checks: 0, healthy_checks: 0, before: [0; 3], stalled: [0; 3] }
    }

    /// Number of checks so far.
    pub fn checks(&self) -> u32 {
        self.checks
    }

    /// Number of checks since all parts have started.
    pub fn healthy_checks(&self) -> u32 {
        self.healthy_checks
    }

    /// Checks all parts. Once one is stalled, returns a bit for each stalled part by its position in [`PARTS`]; 0 otherwise.
    /// Processing without frames is idle, not stalled.
    pub fn check(&mut self, heartbeats: &Heartbeats) -> u32 {
        self.checks = self.checks.saturating_add(1);
        let now = heartbeats.counts();
        // The parts are started together, and the link always has heartbeats.
        if now[2] == 0 && self.checks < START_CHECKS {
            return 0;
        }
        self.healthy_checks = self.healthy_checks.saturating_add(1);
        let is_idle = [false, heartbeats.pending_frames() == 0, false];
        for (stalled, ((now, before), is_idle)) in
            self.stalled.iter_mut().zip(now.iter().zip(&self.before).zip(is_idle))
        {
            *stalled = if now != before || is_idle { 0 } else { stalled.saturating_add(1) };
        }
        self.before = now;
        if self.stalled.iter().all(|&stalled| stalled < STALLED_CHECKS) {
            return 0;
        }
        // Parts on the executor of the stalled one stopped up to two checks earlier or later.
        let bits = self.stalled.iter().enumerate().filter(|(_, stalled)| **stalled >= STALLED_CHECKS - 2);
        bits.fold(0, |parts, (bit, _)| parts | 1 << bit)
    }
}

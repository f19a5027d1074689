//! Supervision of three parts of the firmware, scan, processing and link: their heartbeats, and the detection of a stalled part.
//!
//! The tasks count heartbeats; an interrupt above their executors checks them every [`CHECK_PERIOD_MS`]. Checks are counted, not
//! time: if the processor is stopped for seconds, as by a debugger, one check is late, and no part counts as stalled. A hardware
//! watchdog, which a board may also have, is not aware of this and resets the board.

use core::sync::atomic::{AtomicU32, Ordering};

/// Time between checks, ms.
pub const CHECK_PERIOD_MS: u32 = 100;
/// Number of successive checks without a heartbeat after which a part counts as stalled: one second, because the insole must run
/// again within two seconds. Every part that is not idle has a heartbeat at least every 200 ms.
pub const STALLED_CHECKS: u8 = 10;
/// Number of healthy checks after which a start counts as successful: 5 s.
pub const HEALTHY_CHECKS: u32 = 50;
/// Number of checks within which all parts must have started: two minutes. Erasing a flash chip with foreign contents takes that
/// long; any other start takes a second.
pub const START_CHECKS: u32 = 1200;

/// Names of the three parts in crash reports, in the order of the bits that [`Watchdog::check`] returns. `model` is processing.
pub const PARTS: [&str; 3] = ["scan", "model", "link"];

/// Counters that change while their part makes progress. Each has one writer.
#[derive(Default)]
pub struct Heartbeats {
    scan: AtomicU32,
    /// Frames that were queued for processing.
    queued: AtomicU32,
    /// Frames that were processed.
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

    /// Counts a heartbeat of scanning: a frame became due, a row was read, or the frame clock waits as intended.
    pub fn scan_progressed(&self) {
        count(&self.scan);
    }

    /// Counts a frame that was queued for processing.
    pub fn frame_queued(&self) {
        count(&self.queued);
    }

    /// Counts a frame that was processed, which is the heartbeat of processing.
    pub fn frame_processed(&self) {
        count(&self.processed);
    }

    /// Counts a heartbeat of the link.
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
    /// The counts of the heartbeats at the last check.
    previous_counts: [u32; 3],
    /// For each part, number of successive checks without a heartbeat.
    checks_without_heartbeat: [u8; 3],
}

impl Watchdog {
    /// No check yet.
    pub const fn new() -> Self {
        Self { checks: 0, healthy_checks: 0, previous_counts: [0; 3], checks_without_heartbeat: [0; 3] }
    }

    /// Number of checks so far.
    pub fn checks(&self) -> u32 {
        self.checks
    }

    /// Number of checks since the parts have started, or since [`START_CHECKS`] passed without their start.
    pub fn healthy_checks(&self) -> u32 {
        self.healthy_checks
    }

    /// Checks all parts. Once a part is stalled, returns a bit for each stalled part, by its position in [`PARTS`]; 0 otherwise.
    /// Processing without frames is idle, not stalled.
    pub fn check(&mut self, heartbeats: &Heartbeats) -> u32 {
        self.checks = self.checks.saturating_add(1);
        let counts = heartbeats.counts();
        // The parts are started together, and the link always has heartbeats: without one, the parts have not started yet.
        if counts[2] == 0 && self.checks < START_CHECKS {
            return 0;
        }
        self.healthy_checks = self.healthy_checks.saturating_add(1);
        let is_idle = [false, heartbeats.pending_frames() == 0, false];
        for (checks, ((count, previous), is_idle)) in
            self.checks_without_heartbeat.iter_mut().zip(counts.iter().zip(&self.previous_counts).zip(is_idle))
        {
            *checks = if count != previous || is_idle { 0 } else { checks.saturating_add(1) };
        }
        self.previous_counts = counts;
        if self.checks_without_heartbeat.iter().all(|&checks| checks < STALLED_CHECKS) {
            return 0;
        }
        // A stalled part also stops the other parts on its executor. Their last heartbeats can be up to two checks later.
        let bits =
            self.checks_without_heartbeat.iter().enumerate().filter(|(_, checks)| **checks >= STALLED_CHECKS - 2);
        bits.fold(0, |parts, (bit, _)| parts | 1 << bit)
    }
}

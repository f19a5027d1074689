//! Supervision of the parts of the firmware: their heartbeats, and the detection of a stalled part.
//!
//! The tasks count heartbeats; an interrupt above their executors checks them every [`CHECK_PERIOD_MS`]. Checks are counted, not
//! time: if the processor is stopped for seconds, as by a debugger, one check is late, and no part counts as stalled. A hardware
//! watchdog, which a board may also have, is not aware of this and resets the board.

#[cfg(not(shuttle))]
use core::sync::atomic::{AtomicU32, Ordering};
#[cfg(shuttle)]
use shuttle::sync::atomic::{AtomicU32, Ordering};

/// Time between checks, ms.
pub const CHECK_PERIOD_MS: u32 = 100;
/// Number of successive checks without a heartbeat after which scan, processing or link counts as stalled: one second, because
/// the insole must run again within two seconds. Unless it is idle, each of these parts has a heartbeat at least twice a second.
pub const STALLED_CHECKS: u16 = 10;
/// Number of healthy checks after which a start counts as successful: 5 minutes, in which a host can send an update over any
/// link.
pub const HEALTHY_CHECKS: u32 = 3000;
/// Number of healthy checks after which earlier stalls of the radio no longer count: half an hour. Stalls that are further apart
/// restart the insole at most twice an hour, which is no reason to do without Bluetooth.
pub const RADIO_HEALTHY_CHECKS: u32 = 18_000;
/// Number of checks within which all parts must have started: two minutes. A start that erases a flash chip with foreign
/// contents takes nearly that long; the first start with a blank chip of 16 MiB, a repair, and a start after a trial of newer
/// firmware take some 20 s; any other start takes a second.
pub const START_CHECKS: u32 = 1200;

/// Names of the supervised parts in crash reports, in the order of [`Part`].
pub const PARTS: [&str; 5] = ["scan", "process", "link", "storage", "radio"];

/// A supervised part: an index of [`PARTS`], and a bit of the result of [`Watchdog::check`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// [`super::scan::scan`].
    Scan,
    /// [`super::process::process`].
    Process,
    /// [`super::serve::serve`].
    Link,
    /// [`super::persist::persist`].
    Storage,
    /// The Bluetooth stack together with its radio.
    Radio,
}

/// For each part, the number of successive checks without a heartbeat after which it counts as stalled: a second, for the storage
/// a minute, and for the radio half a minute. A stall of these two does not stop the measurement, and both may be busy for
/// seconds.
pub const MOST_CHECKS: [u16; PARTS.len()] = [STALLED_CHECKS, STALLED_CHECKS, STALLED_CHECKS, 600, 300];

/// Counters that change while their part makes progress. Each has one writer.
#[derive(Default)]
pub struct Heartbeats {
    parts: [AtomicU32; PARTS.len()],
    /// Frames that were queued for processing.
    queued: AtomicU32,
}

fn count(counter: &AtomicU32) {
    counter.store(counter.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
}

impl Heartbeats {
    /// No heartbeat yet.
    pub const fn new() -> Self {
        Self { parts: [const { AtomicU32::new(0) }; PARTS.len()], queued: AtomicU32::new(0) }
    }

    /// Counts a heartbeat of scanning: a frame became due, a row was read, or the frame clock waits as intended.
    pub fn scan_progressed(&self) {
        self.progressed(Part::Scan);
    }

    /// Counts a frame that was queued for processing.
    pub fn frame_queued(&self) {
        count(&self.queued);
    }

    /// Counts a frame that was processed, which is the heartbeat of processing.
    pub fn frame_processed(&self) {
        self.progressed(Part::Process);
    }

    /// Counts a heartbeat of a part.
    pub fn progressed(&self, part: Part) {
        count(&self.parts[part as usize]);
    }

    /// Number of heartbeats of a part; wraps.
    pub fn count(&self, part: Part) -> u32 {
        self.parts[part as usize].load(Ordering::Relaxed)
    }

    /// Number of processed frames; wraps.
    pub fn processed(&self) -> u32 {
        self.count(Part::Process)
    }

    /// Number of frames that wait for processing, the one that is being processed included.
    pub fn pending_frames(&self) -> u32 {
        self.queued.load(Ordering::Relaxed).wrapping_sub(self.processed())
    }

    /// The counts of all parts, in the order of [`PARTS`].
    pub fn counts(&self) -> [u32; PARTS.len()] {
        self.parts.each_ref().map(|part| part.load(Ordering::Relaxed))
    }
}

/// The state of the checks.
#[derive(Clone, Copy, Default)]
pub struct Watchdog {
    checks: u32,
    healthy_checks: u32,
    /// The counts of the heartbeats at the last check.
    previous_counts: [u32; PARTS.len()],
    /// For each part, number of successive checks without a heartbeat.
    checks_without_heartbeat: [u16; PARTS.len()],
}

impl Watchdog {
    /// No check yet.
    pub const fn new() -> Self {
        Self {
            checks: 0,
            healthy_checks: 0,
            previous_counts: [0; PARTS.len()],
            checks_without_heartbeat: [0; PARTS.len()],
        }
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
    /// Processing without frames is idle, not stalled, and so is a radio that has never answered.
    pub fn check(&mut self, heartbeats: &Heartbeats) -> u32 {
        self.checks = self.checks.saturating_add(1);
        let counts = heartbeats.counts();
        // The parts are started together, and the link always has heartbeats: without one, the parts have not started yet.
        if counts[Part::Link as usize] == 0 && self.checks < START_CHECKS {
            return 0;
        }
        self.healthy_checks = self.healthy_checks.saturating_add(1);
        let (mut stalled, mut silent) = (false, 0);
        for (part, checks) in self.checks_without_heartbeat.iter_mut().enumerate() {
            let is_idle = part == Part::Process as usize && heartbeats.pending_frames() == 0
                || part == Part::Radio as usize && counts[part] == 0;
            *checks = if counts[part] != self.previous_counts[part] || is_idle { 0 } else { checks.saturating_add(1) };
            stalled |= *checks >= MOST_CHECKS[part];
            // A stalled part also stops the other parts on its executor. Their last heartbeats can be up to two checks later.
            silent |= u32::from(*checks >= MOST_CHECKS[part] - 2) << part;
        }
        self.previous_counts = counts;
        if stalled { silent } else { 0 }
    }
}

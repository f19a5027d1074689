//! Recordings as walks on the sensor matrix.

use crate::{Scan, Walk};
use recording::{Recording, VirtualInsole};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// The walk of a recording, as a virtual insole measures it.
pub struct Recorded {
    recording: Recording,
    insole: VirtualInsole,
}

impl Recorded {
    /// The walk of `recording`, as `insole` measures it.
    pub fn new(recording: Recording, insole: VirtualInsole) -> Self {
        Self { recording, insole }
    }
}

impl Walk for Recorded {
    fn scans(&self) -> u32 {
        self.insole.frames(&self.recording) as u32
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        self.insole.codes_of(&self.recording, seq as usize, codes);
        Scan::Whole
    }
}

/// Repeats a walk, which has at least one scan, without end.
pub struct Looped<W>(pub W);

impl<W: Walk> Walk for Looped<W> {
    fn scans(&self) -> u32 {
        u32::MAX
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        self.0.scan(seq % self.0.scans(), codes)
    }
}

/// A walk that several boards play together in real time, repeatedly and without end, although they start one after the other:
/// it begins with the first scan of any of them, and the other boards join it where it is.
pub struct Joined<W> {
    walk: W,
    period: Duration,
    /// The time after which the walk is repeated.
    repeated_after: Duration,
    /// The time of the first scan of any board.
    start: Arc<OnceLock<Instant>>,
    /// Number of scans of the walk before the first scan of this board.
    missed: Option<u32>,
}

impl<W> Joined<W> {
    /// `walk` with a scan in each `period`. `repeated_after`, the duration of the longest walk of any board, and `start` are
    /// common to the boards. A shorter walk stays at its last scan until then.
    pub fn new(walk: W, period: Duration, repeated_after: Duration, start: Arc<OnceLock<Instant>>) -> Self {
        Self { walk, period, repeated_after, start, missed: None }
    }
}

impl<W: Walk> Walk for Joined<W> {
    fn scans(&self) -> u32 {
        u32::MAX
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        let missed = *self.missed.get_or_insert_with(|| {
            let since_start = self.start.get_or_init(Instant::now).elapsed();
            (since_start.as_secs_f64() / self.period.as_secs_f64()).round() as u32
        });
        let played = self.period * seq.wrapping_add(missed);
        let played_us = played.as_micros() % self.repeated_after.as_micros();
        let index = (played_us / self.period.as_micros()) as u32;
        self.walk.scan(index.min(self.walk.scans() - 1), codes)
    }
}

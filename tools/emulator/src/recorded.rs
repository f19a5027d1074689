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

/// A walk without end in real time that several boards play together, although they start one after the other: it begins with
/// the first scan of any of them, and the other boards join it where it is.
pub struct Joined<W> {
    walk: Looped<W>,
    period: Duration,
    /// The time of the first scan of any board.
    start: Arc<OnceLock<Instant>>,
    /// Number of scans of the walk before the first scan of this board.
    missed: Option<u32>,
}

impl<W> Joined<W> {
    /// `walk` with a scan in each `period`. `start` is common to the boards.
    pub fn new(walk: Looped<W>, period: Duration, start: Arc<OnceLock<Instant>>) -> Self {
        Self { walk, period, start, missed: None }
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
        self.walk.scan(seq.wrapping_add(missed), codes)
    }
}

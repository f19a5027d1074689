//! Supervision: signs of life of scan, model and link, and who of them stands still.
//!
//! The tasks leave the signs; an interrupt above their executors looks at them every [`LOOK_MS`]. Looks are counted, not time:
//! a simulator that stalls for seconds is one look late, and nobody stood still.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// Time between looks, ms.
pub const LOOK_MS: u32 = 100;
/// Looks in a row without a sign of life after which a part is wedged: a second, of the two within which the insole is to
/// be back. Every part lives at least every 200 ms.
pub const STILL_LOOKS: u8 = 10;
/// Looks with all parts at work after which a start has succeeded: 5 s.
pub const LIVED_LOOKS: u32 = 50;
/// Looks within which the parts must be at work: two minutes. So long a flash chip may take to be erased that held something else;
/// any other start takes a second.
pub const START_LOOKS: u32 = 1200;

/// Names of the three parts, in the order of [`Watch::look`]'s bits.
pub const PARTS: [&str; 3] = ["scan", "model", "link"];

/// Signs of life. Each has one writer.
#[derive(Default)]
pub struct Life {
    scan: AtomicU32,
    is_asleep: AtomicBool,
    handed_over: AtomicU32,
    modelled: AtomicU32,
    link: AtomicU32,
}

fn count(counter: &AtomicU32) {
    counter.store(counter.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
}

impl Life {
    /// None yet.
    pub const fn new() -> Self {
        Self {
            scan: AtomicU32::new(0),
            is_asleep: AtomicBool::new(false),
            handed_over: AtomicU32::new(0),
            modelled: AtomicU32::new(0),
            link: AtomicU32::new(0),
        }
    }

    /// Scanning got on: a row, a frame that is left out, a matrix that does not answer.
    pub fn scan(&self) {
        count(&self.scan);
    }

    /// Scanning waits for a clock that may stand still, until it says otherwise.
    pub fn sleep(&self, is_asleep: bool) {
        self.is_asleep.store(is_asleep, Ordering::Relaxed);
    }

    /// Scanning left a frame to the model.
    pub fn hand_over(&self) {
        count(&self.handed_over);
    }

    /// The model is done with a frame.
    pub fn model(&self) {
        count(&self.modelled);
    }

    /// Frames that the model is done with.
    pub fn modelled(&self) -> u32 {
        self.modelled.load(Ordering::Relaxed)
    }

    /// Counts of all three, in the order of [`PARTS`]: each changes while its part is at work.
    pub fn signs(&self) -> [u32; 3] {
        [self.scan.load(Ordering::Relaxed), self.modelled(), self.link.load(Ordering::Relaxed)]
    }

    /// The link looked up.
    pub fn link(&self) {
        count(&self.link);
    }
}

/// What the looks saw.
#[derive(Clone, Copy, Default)]
pub struct Watch {
    looks: u32,
    lived: u32,
    before: [u32; 3],
    still: [u8; 3],
}

impl Watch {
    /// No look yet.
    pub const fn new() -> Self {
        Self { looks: 0, lived: 0, before: [0; 3], still: [0; 3] }
    }

    /// Looks so far.
    pub fn looks(&self) -> u32 {
        self.looks
    }

    /// Looks since the parts are at work.
    pub fn lived(&self) -> u32 {
        self.lived
    }

    /// Looks. Once a part is wedged, a bit for each that stands still, by its place in [`PARTS`]; 0 else. A model without
    /// frames rests, and so does scanning while its clock sleeps.
    pub fn look(&mut self, life: &Life) -> u32 {
        self.looks = self.looks.saturating_add(1);
        let now = life.signs();
        // The parts are started together, and the link lives in any case.
        if now[2] == 0 && self.looks < START_LOOKS {
            return 0;
        }
        self.lived = self.lived.saturating_add(1);
        let rests = [life.is_asleep.load(Ordering::Relaxed), now[1] == life.handed_over.load(Ordering::Relaxed), false];
        for (still, ((now, before), rests)) in self.still.iter_mut().zip(now.iter().zip(&self.before).zip(rests)) {
            *still = if now != before || rests { 0 } else { still.saturating_add(1) };
        }
        self.before = now;
        if self.still.iter().all(|&still| still < STILL_LOOKS) {
            return 0;
        }
        // Who shares an executor with the wedged stood still a look earlier or later.
        let bits = self.still.iter().enumerate().filter(|(_, still)| **still >= STILL_LOOKS - 2);
        bits.fold(0, |parts, (bit, _)| parts | 1 << bit)
    }
}

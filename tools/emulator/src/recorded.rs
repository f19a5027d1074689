//! Recordings as walks on the sensor matrix.

use crate::{Scan, Walk};
use recording::{Recording, VirtualInsole};

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

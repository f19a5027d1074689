//! A recording as what the matrix feels.

use crate::{Scan, Walk};
use recording::{Recording, VirtualInsole};

/// A recording, worn as an insole.
pub struct Recorded {
    recording: Recording,
    worn: VirtualInsole,
}

impl Recorded {
    /// The walk of a recording under the rules of its insole.
    pub fn new(recording: Recording, worn: VirtualInsole) -> Self {
        Self { recording, worn }
    }
}

impl Walk for Recorded {
    fn scans(&self) -> u32 {
        self.worn.frames(&self.recording) as u32
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        self.worn.codes_of(&self.recording, seq as usize, codes);
        Scan::Whole
    }
}

/// A walk that begins again when it is over, for ever.
pub struct Looped<W>(pub W);

impl<W: Walk> Walk for Looped<W> {
    fn scans(&self) -> u32 {
        u32::MAX
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        self.0.scan(seq % self.0.scans(), codes)
    }
}

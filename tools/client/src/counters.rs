//! Counters of a live stream: how many frames arrived, and how many were lost on the way.

use plantar::sequence;
use serde::Serialize;

/// Counters of a link, as `--json` writes them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LinkCounters {
    /// Live frames that the insole passed to the carrier, by its own count.
    pub frames_sent: u32,
    /// Live frames that arrived undamaged.
    pub frames_received: u32,
    /// Live frames missing between those that arrived.
    pub frames_lost: u32,
    /// Frames of any kind with a wrong CRC or without a known message.
    pub crc_errors: u32,
}

/// Counts the frames of a live stream, and those that are missing by their sequence numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LiveCounter {
    /// Frames that arrived.
    pub received: u32,
    /// Frames that did not.
    pub lost: u32,
    expected: Option<u32>,
}

impl LiveCounter {
    /// Takes a frame with this sequence number.
    pub fn frame(&mut self, sequence: u32) {
        self.received = self.received.wrapping_add(1);
        if let Some(expected) = self.expected {
            self.lost = self.lost.saturating_add(sequence::skipped(expected, sequence));
        }
        self.expected = Some(sequence.wrapping_add(1));
    }

    /// Another session begins, with sequence numbers of its own.
    pub fn new_session(&mut self) {
        self.expected = None;
    }

    /// Takes the insole's own count of the frames that were due before its answer. This also finds frames that were lost before
    /// the first one that arrived, or after the last.
    pub fn due(&mut self, live_due: u32) {
        self.lost = self.lost.max(live_due.saturating_sub(self.received));
    }
}

//! A stream of all cells: unpacks its frames and counts the ones that are missing.

use plantar::protocol::{CellCoder, CellFrame, CellStream, KEY_INTERVAL};
use plantar::sequence;

/// The host's side of a stream of cells.
#[derive(Debug)]
pub struct CellReceiver {
    coder: CellCoder,
    expected: Option<u32>,
    /// Frames that were received and unpacked.
    pub received: u32,
    /// Frames that were lost on the way, or that cannot be unpacked after a loss: up to the next key frame, so at most
    /// [`KEY_INTERVAL`] for one loss.
    pub lost: u32,
    /// Scans that the insole dropped, because the carrier was too slow.
    pub dropped: u32,
}

impl CellReceiver {
    /// Before the first frame of a stream.
    pub fn new(stream: &CellStream) -> Self {
        Self { coder: CellCoder::new(stream.resolution), expected: None, received: 0, lost: 0, dropped: 0 }
    }

    /// Unpacks a frame into `codes`, one code of 16 bits for each cell; false if it was lost.
    pub fn frame(&mut self, frame: &CellFrame, codes: &mut [u16]) -> bool {
        self.lost += sequence::skipped(self.expected.unwrap_or(frame.sequence), frame.sequence);
        self.expected = Some(frame.sequence.wrapping_add(1));
        self.dropped = frame.dropped;
        let is_unpacked = self.coder.unpack(frame, codes).is_some();
        let counter = if is_unpacked { &mut self.received } else { &mut self.lost };
        *counter = counter.wrapping_add(1);
        is_unpacked
    }
}

const _: () = assert!(KEY_INTERVAL.is_power_of_two(), "sequence numbers wrap at a key frame");

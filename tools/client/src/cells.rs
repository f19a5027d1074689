//! A stream of all cells: unpacks its frames and counts the ones that are missing.

use crate::{Carrier, Client, Error};
use plantar::pipeline::setup::{Setup, SetupCell};
use plantar::protocol::{CellCoder, CellFrame, CellStream, KEY_INTERVAL};
use plantar::sequence;

/// A stream of cells that has started, and the configuration by which its codes are converted to pressures.
#[derive(Debug)]
pub struct StartedCells {
    /// The configuration of the insole, except its cells.
    pub setup: Setup,
    /// The cells in the order of their codes.
    pub cells: Vec<SetupCell>,
    /// Receives the frames.
    pub receiver: CellReceiver,
}

impl<C: Carrier> Client<C> {
    /// Reads the configuration of the insole and starts a stream of cells.
    ///
    /// # Errors
    /// Those of [`Client::setup`], [`Client::setup_cells`] and [`Client::stream_cells`].
    pub fn start_cells(&mut self, stream: CellStream) -> Result<StartedCells, Error> {
        let (setup, cells) = (self.setup()?, self.setup_cells()?);
        self.stream_cells(Some(stream))?;
        let receiver = CellReceiver::new(&stream, cells.len());
        Ok(StartedCells { setup, cells, receiver })
    }
}

/// The host's side of a stream of cells.
#[derive(Debug)]
pub struct CellReceiver {
    coder: CellCoder,
    /// See [`CellReceiver::codes`].
    codes: Vec<u16>,
    /// Number of scans from one frame of the stream to the next.
    stride: u32,
    /// Sequence number of the next frame, and the number of the scan after the last frame; `None` before the first frame.
    next: Option<(u32, u32)>,
    /// Frames that were received and unpacked.
    pub received: u32,
    /// Frames that were lost on the way, or that cannot be unpacked after a loss: up to the next key frame, so at most
    /// [`KEY_INTERVAL`] for one loss. If the stream was started again, also the frames that were due between the last frame
    /// before the new start and the first one after it.
    pub lost: u32,
    /// Scans that the insole dropped, because the carrier was too slow.
    pub dropped: u32,
    /// Number of scans that it had dropped before the stream was last started again.
    dropped_before: u32,
}

impl CellReceiver {
    /// A receiver before the first frame of `stream`, from an insole with this number of cells.
    pub fn new(stream: &CellStream, cells: usize) -> Self {
        Self {
            coder: CellCoder::new(stream.resolution),
            codes: vec![0; cells],
            stride: stream.stride().into(),
            next: None,
            received: 0,
            lost: 0,
            dropped: 0,
            dropped_before: 0,
        }
    }

    /// Unpacks a frame, so that [`CellReceiver::codes`] returns its codes. False if it cannot be unpacked and counts as lost.
    pub fn frame(&mut self, frame: &CellFrame) -> bool {
        let (expected, scan) = self.next.unwrap_or((frame.sequence, frame.scan));
        let missing = if sequence::is_after(expected, frame.sequence) {
            // The client started the stream again, which counts frames and dropped scans from 0.
            self.dropped_before = self.dropped;
            sequence::skipped(scan, frame.scan) / self.stride
        } else {
            sequence::skipped(expected, frame.sequence)
        };
        // An insole may send implausible numbers.
        self.lost = self.lost.saturating_add(missing);
        self.next = Some((frame.sequence.wrapping_add(1), frame.scan.wrapping_add(1)));
        self.dropped = self.dropped_before.saturating_add(frame.dropped);
        let is_unpacked = self.coder.unpack(frame, &mut self.codes).is_some();
        let counter = if is_unpacked { &mut self.received } else { &mut self.lost };
        *counter = counter.saturating_add(1);
        is_unpacked
    }

    /// The codes of the last frame, 16 bits for each cell.
    pub fn codes(&self) -> &[u16] {
        &self.codes
    }
}

const _: () = assert!(KEY_INTERVAL.is_power_of_two(), "sequence numbers wrap at a key frame");

#[cfg(test)]
mod tests {
    use super::CellReceiver;
    use plantar::protocol::{CellCoder, CellFrame, CellStream, Resolution};

    #[test]
    fn the_number_of_lost_frames_saturates() {
        let mut receiver = CellReceiver::new(&CellStream { resolution: Resolution::Converter, every: 1 }, 8);
        for sequence in [0, 1 << 30, 1 << 31, 3 << 30, 0, 1 << 30, 1 << 31] {
            receiver.frame(&CellFrame { sequence, scan: 0, dropped: 0, sum: 0, packed: Default::default() });
        }
        assert_eq!(receiver.lost, u32::MAX);
    }

    #[test]
    fn a_stream_that_was_started_again_is_continued_and_its_losses_are_counted() {
        let stream = CellStream { resolution: Resolution::Converter, every: 2 };
        let mut receiver = CellReceiver::new(&stream, 8);
        // The frames of the scans 16, 18 and 20 are missing.
        for (scans, dropped) in [(&[10, 12, 14][..], 3), (&[21, 23][..], 1)] {
            let mut coder = CellCoder::new(stream.resolution);
            for &scan in scans {
                let codes = [16 * scan as u16; 8];
                assert!(receiver.frame(&coder.pack(scan, dropped, &codes)));
                assert_eq!(receiver.codes(), codes);
            }
        }
        assert_eq!((receiver.received, receiver.lost, receiver.dropped), (5, 3, 4));
    }
}

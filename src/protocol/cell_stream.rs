//! The insole's side of a stream of cells: which frames to send, and the queue of packed frames.

use super::cells::{CellCoder, MAX_PACKED, Resolution};
use super::{ToHost, encode};
use heapless::{Deque, Vec};
use serde::{Deserialize, Serialize};

/// Longest packed frame as a message, bytes: tag, three numbers of 32 bits, the sum, and the packed codes with their length.
const MAX_CELLS: usize = 1 + 3 * 5 + 3 + 2 + MAX_PACKED;
/// Packed frames that can wait for the carrier.
const QUEUE: usize = 3;
/// Bytes of a message that are not codes, with its frame on a byte carrier: tag, numbers, CRC and COBS.
const OVERHEAD_BYTES: u32 = 22;
/// Bytes of a live frame, which is sent as well, with its frame on a byte carrier.
const LIVE_BYTES: u32 = 92;

/// A stream of cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CellStream {
    /// The resolution of the codes.
    pub resolution: Resolution,
    /// One of so many frames is sent; 1 for all.
    pub every: u8,
}

impl CellStream {
    /// Bytes of a frame of `cells` cells in a stance. A packed frame takes at most 60 % of its plain codes there; longer ones are
    /// rare, and dropped where the carrier cannot send them in time.
    const fn frame_bytes(self, cells: u32) -> u32 {
        OVERHEAD_BYTES + cells * self.resolution.bits() * 6 / 10 / 8
    }

    /// The highest rate, at most this one, at which a carrier of `bytes_per_s` can send the frames of `cells` cells beside live
    /// frames: `every` of the stream; `None` where it is too slow for any.
    pub fn fitting(self, cells: u32, period_us: u32, bytes_per_s: u32) -> Option<u8> {
        let frames_per_s = 1_000_000 / period_us.max(1);
        let left = bytes_per_s.saturating_sub(LIVE_BYTES * frames_per_s);
        let needed = self.frame_bytes(cells) * frames_per_s;
        let every = needed.checked_div(left)? + u32::from(!needed.is_multiple_of(left));
        u8::try_from(every.max(self.every.max(1).into())).ok()
    }
}

/// The state of a running stream.
#[derive(Debug)]
struct Running {
    stream: CellStream,
    coder: CellCoder,
    /// Scans until the next one that is sent.
    skip: u8,
    dropped: u32,
}

/// Packs and queues the frames of a stream of cells.
#[derive(Debug)]
pub(super) struct CellSender {
    running: Option<Running>,
    queue: Deque<Vec<u8, MAX_CELLS>, QUEUE>,
}

impl CellSender {
    pub const fn new() -> Self {
        Self { running: None, queue: Deque::new() }
    }

    /// Begins another stream, or none.
    pub fn start(&mut self, stream: Option<CellStream>) {
        self.queue.clear();
        self.running =
            stream.map(|stream| Running { stream, coder: CellCoder::new(stream.resolution), skip: 0, dropped: 0 });
    }

    /// Packs the codes of a scan, where it is due. A full queue drops it: a frame that is packed is needed for the next one.
    pub fn push(&mut self, scan: u32, codes: &[u16]) {
        let Some(running) = &mut self.running else { return };
        if let Some(skip) = running.skip.checked_sub(1) {
            running.skip = skip;
            return;
        }
        running.skip = running.stream.every.saturating_sub(1);
        if self.queue.is_full() {
            running.dropped = running.dropped.wrapping_add(1);
            return;
        }
        let frame = running.coder.pack(scan, running.dropped, codes);
        let mut message = [0; MAX_CELLS];
        // A packed frame has at most MAX_CELLS bytes by its field types, and the queue has room.
        if let Ok(used) = encode(&ToHost::Cells(frame), &mut message).map(|used| used.len()) {
            let mut message = Vec::from_array(message);
            message.truncate(used);
            let _ = self.queue.push_back(message);
        }
    }

    /// The next message to send.
    pub fn pop(&mut self) -> Option<Vec<u8, MAX_CELLS>> {
        self.queue.pop_front()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes per second of a serial port at 460,800 bit/s: a byte is ten bits.
    const SERIAL: u32 = 46_080;

    #[test]
    fn a_serial_port_sends_240_cells_at_100_hz_and_offers_less_at_400_hz() {
        let stream = CellStream { resolution: Resolution::Converter, every: 1 };
        assert_eq!(stream.fitting(240, 10_000, SERIAL), Some(1));
        // 36.8 kB/s of live frames leave 9.28 kB/s: 39 frames of 238 bytes.
        assert_eq!(stream.fitting(240, 2_500, SERIAL), Some(11));
        assert_eq!(stream.fitting(240, 10_000, 960), None, "9,600 bit/s are too slow for live frames");
    }
}

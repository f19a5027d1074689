//! The insole's side of a stream of cells: which frames to send, and the queue of packed frames.

use super::cells::{CellCoder, CellStream, MAX_PACKED};
use super::{ToHost, encode};
use heapless::{Deque, Vec};

/// Longest packed frame as a message, bytes: tag, three numbers of 32 bits, the sum, and the packed codes with their length.
const MAX_CELLS: usize = 1 + 3 * 5 + 3 + 2 + MAX_PACKED;
/// Packed frames that can wait for the carrier.
const QUEUE: usize = 3;

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

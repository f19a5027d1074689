//! The insole's side of a stream of cells: which frames to send, and the queue of packed frames.

use super::cells::{CellCoder, CellStream, MAX_PACKED, Packed};
use super::{ToHost, encode};

/// Largest length of a message before the packed codes, bytes: the tag, three numbers of 32 bits in up to 5 bytes each, the sum
/// in up to 3, and the length of the codes in up to 2.
const MAX_HEAD: usize = 1 + 3 * 5 + 3 + 2;
/// Number of packed frames that can wait for the carrier.
const QUEUE: usize = 3;

/// The state of a running stream.
#[derive(Debug)]
struct Running {
    stream: CellStream,
    coder: CellCoder,
    /// The last scan that was due. Those at multiples of the stride after it are due, so that a missed scan does not shift those
    /// that follow. If two due scans in a row are missed, the next scan is due.
    last: Option<u32>,
    /// Number of scans that were dropped because the queue was full.
    dropped: u32,
}

/// A message in the queue.
#[derive(Clone, Copy, Debug)]
struct Message {
    /// The bytes before the packed codes.
    head: [u8; MAX_HEAD],
    head_len: usize,
    packed: [u8; MAX_PACKED],
    packed_len: usize,
}

/// Packs and queues the frames of a stream of cells. Frames are packed in their place in the queue, because copying them would
/// take a fifth of the instructions for the stream.
#[derive(Debug)]
pub(super) struct CellSender {
    running: Option<Running>,
    messages: [Message; QUEUE],
    /// Index of the oldest message.
    first: usize,
    /// Number of messages in the queue.
    len: usize,
}

impl CellSender {
    pub const fn new() -> Self {
        const EMPTY: Message = Message { head: [0; MAX_HEAD], head_len: 0, packed: [0; MAX_PACKED], packed_len: 0 };
        Self { running: None, messages: [EMPTY; QUEUE], first: 0, len: 0 }
    }

    /// Empties the queue, and starts `stream`; `None` stops the running stream.
    pub fn start(&mut self, stream: Option<CellStream>) {
        self.len = 0;
        self.running =
            stream.map(|stream| Running { stream, coder: CellCoder::new(stream.resolution), last: None, dropped: 0 });
    }

    /// True from the start of a stream until its end.
    pub fn is_running(&self) -> bool {
        self.running.is_some()
    }

    /// Packs and queues the codes of a scan if the scan is due. If the queue is full, the scan is dropped before it is packed,
    /// because a host needs each packed frame to unpack the next one.
    // Not inlined, so that all registers are available.
    #[inline(never)]
    pub fn push(&mut self, scan: u32, codes: &[u16]) {
        let Some(running) = &mut self.running else { return };
        let stride = u32::from(running.stream.stride());
        if let Some(since) = running.last.map(|last| scan.wrapping_sub(last))
            && !since.is_multiple_of(stride)
            && since < 2 * stride
        {
            return;
        }
        running.last = Some(scan);
        if self.len == QUEUE {
            running.dropped = running.dropped.wrapping_add(1);
            return;
        }
        let message = &mut self.messages[(self.first + self.len) % QUEUE];
        let Packed { sequence, sum, len } = running.coder.pack_into(codes, &mut message.packed);
        message.packed_len = len;
        // The fields of `ToHost::Cells` up to the bytes of the codes. They fit MAX_HEAD by their types.
        let fields = (ToHost::CELLS, sequence, scan, running.dropped, sum, len as u32);
        message.head_len = encode(&fields, &mut message.head).map_or(0, |head| head.len());
        self.len += 1;
    }

    /// Moves the oldest message to `buffer`, and returns it; `None` if the queue is empty. A message that does not fit into
    /// `buffer` is dropped, and `None` is returned as well.
    pub fn pop<'b>(&mut self, buffer: &'b mut [u8]) -> Option<&'b mut [u8]> {
        self.len = self.len.checked_sub(1)?;
        let message = &self.messages[self.first];
        self.first = (self.first + 1) % QUEUE;
        let (head, packed) = (message.head.get(..message.head_len)?, message.packed.get(..message.packed_len)?);
        let out = buffer.get_mut(..head.len() + packed.len())?;
        let (to_head, to_packed) = out.split_at_mut(head.len());
        to_head.copy_from_slice(head);
        to_packed.copy_from_slice(packed);
        Some(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_head_has_the_stated_length() {
        let longest = (ToHost::CELLS, u32::MAX, u32::MAX, u32::MAX, u16::MAX, MAX_PACKED as u32);
        assert_eq!(encode(&longest, &mut [0; 2 * MAX_HEAD]).expect("the buffer is long enough").len(), MAX_HEAD);
    }
}

//! The encoding of messages as bytes, and their framing on a carrier of bytes, such as a serial port.

use crate::checksum::crc32;
use heapless::Vec;
use mcumgr::line::{self, Lines};
use postcard::ser_flavors::Flavor;
use serde::{Deserialize, Serialize};

/// Longest message, bytes.
pub const MAX_MESSAGE: usize = 560;
/// Longest frame on a byte carrier: message, CRC, COBS overhead and the final zero, bytes.
pub const MAX_FRAME: usize = MAX_MESSAGE + 4 + (MAX_MESSAGE + 4) / 254 + 1 + 1;

// The buffers for messages and frames can also hold the longest message of a management tool and its lines.
const _: () = assert!(line::MAX_LINES <= MAX_FRAME && line::MAX_WRAPPED <= MAX_MESSAGE);

/// The message does not fit into its buffer. This cannot happen with a buffer of [`MAX_MESSAGE`] bytes.
pub type EncodeError = postcard::Error;

/// Encodes a message without a frame; returns the used part of `buffer`.
///
/// # Errors
/// If `buffer` is too short.
pub fn encode<'b, T: Serialize>(message: &T, buffer: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
    postcard::to_slice(message, buffer)
}

/// Encodes `value` without a frame and appends it to `message`. A caller can thus build a message in its place in a queue.
///
/// # Errors
/// If `message` has too little room.
#[inline(always)]
pub(crate) fn append<T: Serialize, const N: usize>(value: &T, message: &mut Vec<u8, N>) -> Result<(), EncodeError> {
    postcard::serialize_with_flavor(value, Append(message))
}

/// Appends bytes to a message. An array, as [`encode`] needs it, would have to be initialised first.
struct Append<'a, const N: usize>(&'a mut Vec<u8, N>);

impl<const N: usize> Flavor for Append<'_, N> {
    type Output = ();

    #[inline(always)]
    fn try_extend(&mut self, data: &[u8]) -> Result<(), EncodeError> {
        self.0.extend_from_slice(data).map_err(|_| EncodeError::SerializeBufferFull)
    }

    #[inline(always)]
    fn try_push(&mut self, data: u8) -> Result<(), EncodeError> {
        self.0.push(data).map_err(|_| EncodeError::SerializeBufferFull)
    }

    fn finalize(self) -> Result<(), EncodeError> {
        Ok(())
    }
}

/// Decodes exactly one message without a frame; `None` for anything else.
pub fn decode<'b, T: Deserialize<'b>>(bytes: &'b [u8]) -> Option<T> {
    match postcard::take_from_bytes(bytes) {
        Ok((message, [])) => Some(message),
        _ => None,
    }
}

/// Frames an encoded message of at most [`MAX_MESSAGE`] bytes for a byte carrier; returns the number of bytes used.
pub fn frame(message: &[u8], out: &mut [u8; MAX_FRAME]) -> usize {
    let mut encoder = cobs::CobsEncoder::new(out);
    // Neither push nor finalize can fail: MAX_FRAME has room for MAX_MESSAGE. A longer message is truncated here, so that this
    // device does not panic; the receiver cannot decode it.
    let message = &message[..message.len().min(MAX_MESSAGE)];
    let _ = encoder.push(message);
    let _ = encoder.push(&crc32(message).to_le_bytes());
    let end = encoder.finalize();
    out[end] = 0;
    end + 1
}

/// Finds messages in a stream of bytes. A damaged frame is counted and ends at the next zero byte.
///
/// ```
/// use plantar::protocol::{Decoder, MAX_FRAME, ToDevice, decode, encode, frame};
///
/// let (mut message, mut framed) = ([0; 32], [0; MAX_FRAME]);
/// let len = frame(encode(&ToDevice::GetStatus, &mut message).unwrap(), &mut framed);
/// let mut decoder = Decoder::new();
/// let received = framed[..len].iter().find_map(|&byte| decoder.push(byte).and_then(decode));
/// assert_eq!(received, Some(ToDevice::GetStatus));
/// ```
#[derive(Debug)]
pub struct Decoder {
    buffer: [u8; MAX_FRAME],
    len: usize,
    /// Number of frames, and of messages of a management tool, that were too long or damaged. A damaged message of a tool can
    /// count more than once: at each of its lines, and as a frame at the next zero.
    pub bad_frames: u32,
}

impl Decoder {
    /// A decoder at the start of a stream.
    pub const fn new() -> Self {
        Self { buffer: [0; MAX_FRAME], len: 0, bad_frames: 0 }
    }

    /// Processes one byte; returns the message, without its frame, if the byte completes one.
    pub fn push(&mut self, byte: u8) -> Option<&[u8]> {
        if byte != 0 {
            // The length `MAX_FRAME + 1` marks a frame that is too long.
            if let Some(slot) = self.buffer.get_mut(self.len) {
                *slot = byte;
            }
            self.len = (self.len + 1).min(MAX_FRAME + 1);
            return None;
        }
        let len = core::mem::take(&mut self.len);
        if len == 0 {
            return None;
        }
        let message_len = self.buffer.get_mut(..len).and_then(unframe);
        if message_len.is_none() {
            self.bad_frames = self.bad_frames.wrapping_add(1);
        }
        message_len.map(|len| &self.buffer[..len])
    }

    /// Returns the message of a management tool ([`mcumgr`]) that the last byte has completed; `None` if there is none. An insole
    /// calls this function after each [`Decoder::push`] of a line feed; a host does not call it.
    pub fn management_message(&mut self) -> Option<&[u8]> {
        let len = core::mem::take(&mut self.len);
        // Management tools send no zero byte, and only a zero byte ends a frame that is too long. If the bytes of such a frame
        // were not discarded here, no message of a tool would be found any more.
        let Some(bytes) = self.buffer.get_mut(..len) else {
            self.bad_frames = self.bad_frames.wrapping_add(1);
            return None;
        };
        match line::unwrap(bytes) {
            Lines::Message(message) => return Some(message),
            // The bytes are not discarded, because they may be a part of a frame. If only the checksum of the message was wrong,
            // `unwrap` has overwritten them. The next message of a tool is found nevertheless, because bytes before its first
            // line are ignored.
            Lines::Damaged => self.bad_frames = self.bad_frames.wrapping_add(1),
            Lines::Incomplete => {}
        }
        self.len = len;
        None
    }
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

/// Decodes a frame in place and checks its CRC; returns the length of the message, at most [`MAX_MESSAGE`].
fn unframe(frame: &mut [u8]) -> Option<usize> {
    let len = cobs::decode_in_place(frame).ok()?;
    let (message, crc) = frame.get(..len)?.split_last_chunk::<4>()?;
    // A frame of MAX_FRAME bytes has room for a message that is too long, because it can contain fewer bytes of COBS overhead.
    (message.len() <= MAX_MESSAGE && crc32(message) == u32::from_le_bytes(*crc)).then_some(message.len())
}

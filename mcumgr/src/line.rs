//! Messages as lines of text, for a serial port: the length of the message, the message and its CRC-16 in base64, in lines that
//! begin with two marker bytes and end with a line feed.
//!
//! Such lines contain no zero, so they can arrive between frames that end with a zero.

use base64ct::{Base64, Encoding};
use core::cmp::Ordering;
use crc::{CRC_16_XMODEM, Crc, NoTable};
use heapless::Vec;

/// A slow and short implementation: messages are short.
const CRC: Crc<u16, NoTable> = Crc::<u16, NoTable>::new(&CRC_16_XMODEM);
/// The beginning of a message's first line. No such byte occurs in base64.
const FIRST: [u8; 2] = [6, 9];
/// The beginning of each further line.
const FURTHER: [u8; 2] = [4, 20];
/// The last byte of each line.
pub const END: u8 = b'\n';
/// Largest number of bytes that a line encodes. Such a line has 127 characters: its first two bytes, base64 and the line feed.
const LINE: usize = 93;
/// Length of the message's length, and of its checksum, bytes.
const NUMBER: usize = 2;

/// Length of the longest message, bytes. The longest answer, with the states of two images, has 257.
pub const MAX_WRAPPED: usize = 300;
/// Length of the lines of the longest message, bytes.
pub const MAX_LINES: usize = text_bytes(MAX_WRAPPED) + (2 * NUMBER + MAX_WRAPPED).div_ceil(LINE) * 3;

/// Length of the base64 of a message of this length, bytes.
const fn text_bytes(message_bytes: usize) -> usize {
    (NUMBER + message_bytes + NUMBER).div_ceil(3) * 4
}

/// Writes the lines of a message of at most [`MAX_WRAPPED`] bytes to `out`; returns their length, 0 if the message is too long.
// Not inlined, because the caller may be compiled for speed.
#[inline(never)]
pub fn wrap(message: &[u8], out: &mut [u8; MAX_LINES]) -> usize {
    write_lines(message, out).unwrap_or(0)
}

fn write_lines(message: &[u8], out: &mut [u8]) -> Option<usize> {
    let (len, crc) = (((message.len() + NUMBER) as u16).to_be_bytes(), CRC.checksum(message).to_be_bytes());
    let mut bytes = len.iter().chain(message).chain(&crc).copied();
    let (mut end, mut marker) = (0, FIRST);
    loop {
        let line: Vec<u8, LINE> = bytes.by_ref().take(LINE).collect();
        if line.is_empty() {
            return Some(end);
        }
        let (start, text) = out.get_mut(end..)?.split_first_chunk_mut()?;
        *start = marker;
        let text_len = Base64::encode(&line, text).ok()?.len();
        *text.get_mut(text_len)? = END;
        end += marker.len() + text_len + 1;
        marker = FURTHER;
    }
}

/// The result of [`unwrap`]: the content of received bytes.
#[derive(Debug, PartialEq, Eq)]
pub enum Lines<'b> {
    /// Not the lines of a complete message, but for example a part of a frame. The bytes are unchanged.
    Incomplete,
    /// The lines of a message with a wrong length or checksum.
    Damaged,
    /// The lines of this message.
    Message(&'b [u8]),
}

/// Finds a message in received bytes that end with a line feed. Whatever precedes its first line is ignored.
// Not inlined, because the caller may be compiled for speed.
#[inline(never)]
pub fn unwrap(bytes: &mut [u8]) -> Lines<'_> {
    let Some(start) = bytes.windows(FIRST.len()).rposition(|pair| pair == FIRST) else { return Lines::Incomplete };
    let lines = &mut bytes[start + FIRST.len()..];
    let text = |byte: &u8| byte.is_ascii_graphic();
    // A frame, too, may contain the beginning of a message and a line feed, but with bytes of any kind between them.
    if !lines.iter().all(|byte| text(byte) || [b'\r', END].contains(byte) || FURTHER.contains(byte)) {
        return Lines::Incomplete;
    }
    let received_text_bytes = lines.iter().filter(|byte| text(byte)).count();
    let Some(first) = lines.get(..4) else { return Lines::Incomplete };
    let mut number = [0; 3];
    let Ok(&[high, low, _]) = Base64::decode(first, &mut number) else { return Lines::Damaged };
    let len = usize::from(u16::from_be_bytes([high, low]));
    let Some(message_bytes) = len.checked_sub(NUMBER) else { return Lines::Damaged };
    match received_text_bytes.cmp(&text_bytes(message_bytes)) {
        Ordering::Less => return Lines::Incomplete,
        Ordering::Greater => return Lines::Damaged,
        Ordering::Equal => {}
    }
    let mut end = 0;
    for at in 0..lines.len() {
        if text(&lines[at]) {
            lines[end] = lines[at];
            end += 1;
        }
    }
    match Base64::decode_in_place(&mut lines[..end]) {
        // The checksum of a message with its checksum is 0.
        Ok([_, _, content @ ..]) if content.len() == len && CRC.checksum(content) == 0 => {
            Lines::Message(&content[..message_bytes])
        }
        _ => Lines::Damaged,
    }
}

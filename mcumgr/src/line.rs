//! Messages as lines of text, for a serial port: the length of the message, the message and its CRC-16 in base64, in lines that
//! begin with two bytes and end with a line feed.
//!
//! Such lines contain no zero, so they can arrive between frames that end with a zero. Base64 is decoded here, in one pass with the
//! lines: a library would take 2 KiB more of a device's flash.

use core::cmp::Ordering;
use crc::{CRC_16_XMODEM, Crc, NoTable};

/// A slow and short implementation: messages are short.
const CRC: Crc<u16, NoTable> = Crc::<u16, NoTable>::new(&CRC_16_XMODEM);
/// The beginning of a message's first line. No such byte occurs in base64.
const FIRST: [u8; 2] = [6, 9];
/// The beginning of each further line.
const FURTHER: [u8; 2] = [4, 20];
/// The last byte of each line.
pub const END: u8 = b'\n';
/// Longest text of a line, which has 127 bytes then.
const LINE: usize = 124;
/// Length of the message's length, and of its checksum, bytes.
const NUMBER: usize = 2;

/// Length of the longest message, bytes: of the answer to the longest echo.
pub const MAX_WRAPPED: usize = 300;
/// Length of its lines, bytes.
pub const MAX_LINES: usize = TEXT + TEXT.div_ceil(LINE) * 3;
/// Length of its text, bytes.
const TEXT: usize = (MAX_WRAPPED + 2 * NUMBER).div_ceil(3) * 4;

/// Writes the lines of a message of at most [`MAX_WRAPPED`] bytes to `out`; returns their length.
// Not inlined, because the caller may be compiled for speed.
#[inline(never)]
pub fn wrap(message: &[u8], out: &mut [u8; MAX_LINES]) -> usize {
    let (len, crc) = (((message.len() + NUMBER) as u16).to_be_bytes(), CRC.checksum(message).to_be_bytes());
    let (mut end, mut column) = (0, 0);
    let mut push = |byte| {
        // A message that is too long is cut, and refused by its receiver.
        if let Some(place) = out.get_mut(end) {
            *place = byte;
            end += 1;
        }
    };
    let (mut bits, mut count) = (0_u32, 0);
    let mut bytes = len.iter().chain(message).chain(&crc);
    loop {
        if count < 6 {
            match bytes.next() {
                Some(byte) => (bits, count) = (bits << 8 | u32::from(*byte), count + 8),
                // The last character has the remaining bits, then zeros.
                None if count > 0 => (bits, count) = (bits << (6 - count), 6),
                None => break,
            }
        }
        count -= 6;
        if column % LINE == 0 {
            (if column == 0 { FIRST } else { FURTHER }).into_iter().for_each(&mut push);
        }
        push(letter((bits >> count & 0x3f) as u8));
        column += 1;
        if column % LINE == 0 {
            push(END);
        }
    }
    while column % 4 > 0 {
        push(b'=');
        column += 1;
        if column % LINE == 0 {
            push(END);
        }
    }
    if column % LINE > 0 {
        push(END);
    }
    end
}

/// The character of six bits.
const fn letter(bits: u8) -> u8 {
    match bits {
        0..=25 => b'A' + bits,
        26..=51 => b'a' + bits - 26,
        52..=61 => b'0' + bits - 52,
        62 => b'+',
        _ => b'/',
    }
}

/// The six bits of a character; `None` for bytes that have none.
const fn bits(letter: u8) -> Option<u8> {
    Some(match letter {
        b'A'..=b'Z' => letter - b'A',
        b'a'..=b'z' => letter - b'a' + 26,
        b'0'..=b'9' => letter - b'0' + 52,
        b'+' => 62,
        b'/' => 63,
        _ => return None,
    })
}

/// What received bytes are.
#[derive(Debug, PartialEq, Eq)]
pub enum Lines<'b> {
    /// Not the lines of a complete message. The bytes are unchanged.
    Incomplete,
    /// The lines of a message with a wrong checksum, or more than a message.
    Damaged,
    /// This message.
    Message(&'b [u8]),
}

/// Finds a message in received bytes that end with a line feed. Whatever precedes its first line is ignored.
// Not inlined, because the caller may be compiled for speed.
#[inline(never)]
pub fn unwrap(bytes: &mut [u8]) -> Lines<'_> {
    let Some(start) = bytes.windows(FIRST.len()).rposition(|pair| pair == FIRST) else { return Lines::Incomplete };
    let Decoded { found, len, crc } = decode(bytes, start, false);
    match found.cmp(&(NUMBER + len)) {
        Ordering::Less => Lines::Incomplete,
        // The checksum of a message with its checksum is 0.
        Ordering::Equal if crc == 0 && len >= NUMBER => {
            decode(bytes, start, true);
            Lines::Message(&bytes[NUMBER..len])
        }
        _ => Lines::Damaged,
    }
}

/// What lines contain.
struct Decoded {
    /// Number of bytes.
    found: usize,
    /// The number in the first two bytes.
    len: usize,
    /// The checksum of the others.
    crc: u16,
}

/// Decodes lines from `start` on; writes what they contain to the beginning of `bytes` if `is_stored`.
fn decode(bytes: &mut [u8], start: usize, is_stored: bool) -> Decoded {
    let (mut found, mut len, mut digest) = (0, 0, CRC.digest());
    let (mut buffer, mut count) = (0_u32, 0);
    for at in start..bytes.len() {
        let Some(bits) = bits(bytes[at]) else { continue };
        (buffer, count) = (buffer << 6 | u32::from(bits), count + 6);
        if count < 8 {
            continue;
        }
        count -= 8;
        let byte = (buffer >> count) as u8;
        if found < NUMBER {
            len = len << 8 | usize::from(byte);
        } else {
            digest.update(&[byte]);
        }
        if is_stored {
            // Four characters become three bytes, so this one was read.
            bytes[found] = byte;
        }
        found += 1;
    }
    Decoded { found, len, crc: digest.finalize() }
}

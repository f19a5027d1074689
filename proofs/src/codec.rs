//! Messages and their frames on a byte carrier.

use plantar::checksum::crc32;
use plantar::protocol::{Decoder, MAX_FRAME, MAX_MESSAGE, decode, encode, frame};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// CRC-32 by its definition, bit by bit.
fn crc32_by_bits(bytes: &[u8]) -> u32 {
    let mut remainder = u32::MAX;
    for bit in bytes.iter().flat_map(|byte| (0..8).map(move |bit| u32::from(byte >> bit & 1))) {
        let is_divided = (remainder ^ bit) & 1 == 1;
        remainder = remainder >> 1 ^ if is_divided { 0xedb8_8320 } else { 0 };
    }
    !remainder
}

/// Decodes a COBS frame, passed without its final zero: joins its blocks, with the zeros between them. `None` if a block is
/// incomplete.
fn uncobs(frame: &[u8]) -> Option<Vec<u8>> {
    let (mut bytes, mut blocks) = (Vec::new(), frame);
    while let Some((&code, after)) = blocks.split_first() {
        let (block, next) = after.split_at_checked(usize::from(code) - 1)?;
        bytes.extend(block);
        if code < 255 && !next.is_empty() {
            bytes.push(0);
        }
        blocks = next;
    }
    Some(bytes)
}

/// The COBS frame of some bytes, with its final zero.
fn cobs(bytes: &[u8]) -> Vec<u8> {
    let mut frame = Vec::new();
    for part in bytes.split(|byte| *byte == 0) {
        let blocks = part.chunks_exact(254);
        let rest = blocks.remainder();
        blocks.for_each(|block| frame.extend([&[255], block].concat()));
        frame.push(rest.len() as u8 + 1);
        frame.extend(rest);
    }
    frame.push(0);
    frame
}

/// The message in a frame, passed without its final zero; `None` if the frame is damaged, or if frame or message are too long.
fn message(frame: &[u8]) -> Option<Vec<u8>> {
    let mut message = uncobs(frame).filter(|_| frame.len() <= MAX_FRAME)?;
    let crc = message.split_off(message.len().checked_sub(4)?);
    (message.len() <= MAX_MESSAGE && crc32_by_bits(&message).to_le_bytes() == *crc).then_some(message)
}

/// The checksum equals the CRC-32 that is computed by its definition.
pub fn checksum(bytes: &[u8]) {
    assert_eq!(crc32(bytes), crc32_by_bits(bytes));
}

/// The decoder finds exactly the messages in a stream, and counts exactly the damaged frames.
pub fn stream(stream: &[u8]) {
    let mut decoder = Decoder::new();
    let mut start = 0;
    let mut bad_frames = 0;
    for (at, &byte) in stream.iter().enumerate() {
        let decoded = decoder.push(byte).map(<[u8]>::to_vec);
        let mut expected = None;
        if byte == 0 {
            if at > start {
                expected = message(&stream[start..at]);
                bad_frames += u32::from(expected.is_none());
            }
            start = at + 1;
        }
        assert_eq!(decoded, expected);
        assert_eq!(decoder.bad_frames, bad_frames);
    }
}

/// The decoder returns a message of this length, if it is not too long, and the next message after it.
pub fn length(len: usize) {
    for byte in [0, 7] {
        let frames = [vec![byte; len], vec![1]].map(|mut message| {
            let crc = crc32_by_bits(&message).to_le_bytes();
            message.extend(crc);
            cobs(&message)
        });
        stream(&frames.concat());
    }
}

/// A message is framed according to the definitions of CRC-32 and COBS, and the decoder returns the message.
pub fn framing(message: &[u8]) {
    let mut framed = [0; MAX_FRAME];
    let len = frame(message, &mut framed);
    let mut with_crc = message.to_vec();
    with_crc.extend(crc32_by_bits(message).to_le_bytes());
    assert_eq!(uncobs(&cobs(&with_crc)[..cobs(&with_crc).len() - 1]).as_ref(), Some(&with_crc), "uncobs inverts cobs");
    // After a block of 254 bytes without a zero, an empty last block may be omitted.
    let expected = cobs(&with_crc);
    let shorter = expected.strip_suffix(&[1, 0]).map(|start| [start, &[0]].concat());
    assert!(framed[..len] == expected || shorter.is_some_and(|shorter| framed[..len] == shorter));
    let mut decoder = Decoder::new();
    let (last, before) = framed[..len].split_last().expect("a frame is not empty");
    assert!(before.iter().all(|&byte| decoder.push(byte).is_none()));
    assert_eq!(decoder.push(*last), Some(message));
}

/// If two bytes of the frame of a message, at the positions `at`, are replaced by `bytes`, the decoder returns this message or
/// none, and receives the next frame.
pub fn damage(message: &[u8], at: [usize; 2], bytes: [u8; 2]) {
    let mut framed = [0; MAX_FRAME];
    let len = frame(message, &mut framed);
    let mut decoder = Decoder::new();
    let mut damaged = framed;
    (damaged[at[0]], damaged[at[1]]) = (bytes[0], bytes[1]);
    for &byte in &damaged[..len] {
        if let Some(decoded) = decoder.push(byte) {
            assert_eq!(decoded, message);
        }
    }
    // If the final zero is damaged, this zero ends the damaged frame, which would otherwise include the next one.
    let _ = decoder.push(0);
    let received = framed[..len].iter().filter(|&&byte| decoder.push(byte) == Some(message)).count();
    assert_eq!(received, 1);
}

/// The bytes are not a message, or a message that encoding and decoding leave unchanged. Returns true if they are a message.
pub fn message_of<T: Serialize + DeserializeOwned + PartialEq>(bytes: &[u8]) -> bool {
    let Some(message) = decode::<T>(bytes) else { return false };
    let mut buffer = [0; MAX_MESSAGE];
    let encoded = encode(&message, &mut buffer).expect("a message fits MAX_MESSAGE");
    assert!(encoded.len() <= bytes.len(), "the encoder must produce the shortest encoding of a message");
    assert!(decode::<T>(encoded).is_some_and(|decoded| decoded == message));
    true
}

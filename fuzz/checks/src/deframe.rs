//! A stream of bytes: each frame in the stream is a message or is counted as bad, and a valid frame is received after any bytes
//! that end with a zero.

use plantar::protocol::{Decoder, MAX_FRAME, MAX_MESSAGE, frame};

/// Checks one input.
pub fn check(data: &[u8]) {
    let mut decoder = Decoder::new();
    let mut messages = 0;
    for &byte in data.iter().chain(&[0]) {
        if let Some(message) = decoder.push(byte) {
            assert!(message.len() <= MAX_MESSAGE);
            messages += 1;
        }
    }
    let frames = data.split(|&byte| byte == 0).filter(|frame| !frame.is_empty()).count();
    assert_eq!(messages + decoder.bad_frames as usize, frames);

    let message = &data[..data.len().min(MAX_MESSAGE)];
    let mut framed = [0; MAX_FRAME];
    let len = frame(message, &mut framed);
    let (end, body) = framed[..len].split_last().expect("a frame ends with a zero");
    assert!(*end == 0 && body.iter().all(|&byte| decoder.push(byte).is_none()));
    assert_eq!(decoder.push(0), Some(message));
}

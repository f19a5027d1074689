//! Messages of management tools: any bytes are refused or decoded, as lines on a serial port and as parts over Bluetooth. After
//! any lines, a frame of the insole's own protocol is received. Every message is unwrapped from its lines unchanged.

use mcumgr::line::{END, Lines, MAX_LINES, MAX_WRAPPED, unwrap, wrap};
use mcumgr::{Answer, CHUNK, HEAD, Request, decode, message_bytes};
use plantar::protocol::fragment::Joiner;
use plantar::protocol::mcuboot::{read_front, read_trailer};
use plantar::protocol::{Decoder, MAX_FRAME, frame};

/// Checks what a message asks for, and the answer to an echo.
fn check_message(message: &[u8]) {
    let Some((head, request)) = decode(message) else { return };
    assert_eq!(message_bytes(message), Some(message.len()));
    match request {
        Ok(Request::Upload(part)) => assert!(part.data.len() <= CHUNK),
        Ok(Request::Echo(text)) => {
            let mut buffer = [0; MAX_WRAPPED];
            let answer = Answer::Echo(text).encode(&head, &mut buffer).expect("the longest answer fits");
            assert!(answer.len() > HEAD);
        }
        Ok(_) => {}
        Err(failure) => assert!(failure.common() > 0),
    }
}

/// Checks one input.
pub fn check(data: &[u8]) {
    check_message(data);
    let _ = read_front(data);
    let _ = read_trailer(data);

    let mut decoder = Decoder::new();
    for &byte in data {
        if decoder.push(byte).is_none()
            && byte == END
            && let Some(message) = decoder.management_message()
        {
            check_message(message);
        }
    }
    decoder.push(0);
    let mut framed = [0; MAX_FRAME];
    let len = frame(b"any", &mut framed);
    let received = framed[..len].iter().find_map(|&byte| decoder.push(byte).map(<[u8]>::to_vec));
    assert_eq!(received.as_deref(), Some(&b"any"[..]));

    let mut joiner = Joiner::new();
    for part in data.chunks(20) {
        if let Ok(Some(message)) = joiner.push_plain(part, message_bytes) {
            check_message(message);
        }
    }

    let message = &data[..data.len().min(MAX_WRAPPED)];
    let mut lines = [0; MAX_LINES];
    let len = wrap(message, &mut lines);
    assert_eq!(unwrap(&mut lines[..len]), Lines::Message(message));
}

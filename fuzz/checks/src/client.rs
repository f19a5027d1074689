//! The host's side of a session with an insole that sends any messages: the session ends normally or with an error, and the
//! host's counters are consistent.

use crate::Pieces;
use client::{Client, Framed, step_to_json};
use plantar::protocol::{MAX_FRAME, ToHost, frame};
use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::time::Duration;

/// An insole that sends these bytes, independently of the requests that it receives.
struct Insole(VecDeque<u8>);

impl Read for Insole {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // At the end of the bytes this returns 0, as a broken carrier does.
        self.0.read(buffer)
    }
}

impl Write for Insole {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Checks one input.
pub fn check(data: &[u8]) {
    let mut bytes = VecDeque::new();
    for message in Pieces(data) {
        let mut framed = [0; MAX_FRAME];
        let len = frame(message, &mut framed);
        bytes.extend(&framed[..len]);
    }
    let Ok(mut client) = Client::connect(Framed::new(Insole(bytes)), Duration::MAX) else { return };
    // A request without an answer ends with an error, because the carrier breaks at the end of the bytes.
    let _ = client.stream();
    let _ = client.tissue();
    let mut live = 0;
    while let Ok(message) = client.receive() {
        match message {
            Some(ToHost::Live(_)) => live += 1,
            Some(ToHost::Step(step)) => assert!(step_to_json(&step).is_object()),
            _ => {}
        }
    }
    assert_eq!(client.counters().frames_received, live);
}

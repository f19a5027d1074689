//! Fragments of messages, as a central writes them: any fragments are joined or refused, and the fragments of a message, of any
//! size, are joined to the same message.

use crate::Pieces;
use plantar::protocol::MAX_MESSAGE;
use plantar::protocol::fragment::{Joiner, Splitter};

/// Checks one input.
pub fn check(data: &[u8]) {
    let mut joiner = Joiner::new();
    for piece in Pieces(data) {
        if let Ok(Some(message)) = joiner.push(piece) {
            assert!(message.len() <= MAX_MESSAGE);
        }
    }

    let Some((&size, message)) = data.split_first() else { return };
    let message = &message[..message.len().min(MAX_MESSAGE)];
    if message.is_empty() {
        return;
    }
    let mut splitter = Splitter::new();
    splitter.buffer()[..message.len()].copy_from_slice(message);
    splitter.start(message.len());
    // A full fragment has 6 to 255 bytes here, and 20 to 244 bytes on a real link. With fewer than 6 bytes, the longest message
    // would have more fragments than the seven bits of a header can number.
    let mut fragment = vec![0; usize::from(size).max(6)];
    loop {
        let len = splitter.next(&mut fragment).expect("the message has another fragment");
        let joined = joiner.push(&fragment[..len]).expect("the fragments are in order");
        assert_eq!(joined.is_some(), splitter.is_done());
        if let Some(joined) = joined {
            assert_eq!(joined, message);
            return;
        }
    }
}

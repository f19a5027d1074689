//! Messages in fragments.

use plantar::protocol::MAX_MESSAGE;
use plantar::protocol::fragment::{FragmentError, Joiner, Splitter};

/// A fragment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fragment {
    /// Its number; `None` for an empty fragment, which has no header.
    pub number: Option<u8>,
    /// Whether the header marks it as the last one of its message.
    pub is_last: bool,
    /// Length of its part of the message, bytes.
    pub len: usize,
}

/// Byte `at` of the message that begins with the fragment at the index `start`.
fn byte(start: usize, at: usize) -> u8 {
    (start * 31 + at * 7 + at / 256) as u8
}

/// The joiner accepts exactly the fragments that continue their message, up to the length [`MAX_MESSAGE`]. In the model, which
/// knows all fragments, a message begins at the latest fragment with number 0. A fragment continues the message if all
/// fragments from there on are numbered without a gap, and no earlier one of them is marked as the last.
pub fn joining(fragments: &[Fragment]) {
    let mut joiner = Joiner::new();
    let mut start = None;
    for (at, fragment) in fragments.iter().enumerate() {
        if fragment.number == Some(0) {
            start = Some(at);
        }
        let message = start.map(|start| &fragments[start..=at]);
        let offset: usize = message.map_or(0, |message| message[..message.len() - 1].iter().map(|part| part.len).sum());
        let mut bytes: Vec<u8> =
            fragment.number.map(|number| number | if fragment.is_last { 0x80 } else { 0 }).into_iter().collect();
        if fragment.number.is_some() {
            bytes.extend((0..fragment.len).map(|i| byte(start.unwrap_or(at), offset + i)));
        }
        let is_next = message.is_some_and(|message| {
            let (_, before) = message.split_last().expect("the fragment itself");
            let is_numbered = message.iter().enumerate().all(|(i, part)| part.number.map(usize::from) == Some(i));
            is_numbered && before.iter().all(|part| !part.is_last)
        });
        let is_too_long = |message: &[Fragment]| message.iter().map(|part| part.len).sum::<usize>() > MAX_MESSAGE;
        let was_too_long = message.is_some_and(|message| is_too_long(&message[..message.len() - 1]));
        let expected = match message {
            _ if fragment.number.is_none() => Err(FragmentError::Empty),
            Some(message) if is_next && !was_too_long => match is_too_long(message) {
                true => Err(FragmentError::TooLong),
                false => Ok(fragment
                    .is_last
                    .then(|| (0..offset + fragment.len).map(|i| byte(at + 1 - message.len(), i)).collect())),
            },
            _ => Err(FragmentError::OutOfOrder),
        };
        let joined: Result<Option<Vec<u8>>, _> = joiner.push(&bytes).map(|joined| joined.map(<[u8]>::to_vec));
        assert_eq!(joined, expected, "{fragments:?}, fragment {at}");
    }
}

/// The joiner accepts parts without headers, up to the length that the first two bytes of their message state. If this length or
/// that of the parts exceeds [`MAX_MESSAGE`], or if more bytes arrive than stated, it refuses the message, and the next part
/// begins another one. `parts` has the lengths of the parts.
pub fn joining_plain(stated: u16, parts: &[usize]) {
    let message_bytes = |message: &[u8]| message.first_chunk().map(|&length| usize::from(u16::from_le_bytes(length)));
    let mut joiner = Joiner::new();
    let mut message = Vec::new();
    for &len in parts {
        let at = message.len();
        let length = stated.to_le_bytes();
        message.extend((at..at + len).map(|at| length.get(at).copied().unwrap_or_else(|| byte(0, at))));
        let most = if message.len() < length.len() { MAX_MESSAGE } else { stated.into() };
        let expected = match message.len() {
            len if len > most || most > MAX_MESSAGE => Err(FragmentError::TooLong),
            len => Ok((len == most).then(|| message.clone())),
        };
        let joined = joiner.push_plain(&message[at..], message_bytes).map(|joined| joined.map(<[u8]>::to_vec));
        assert_eq!(joined, expected, "{stated}, {parts:?}");
        if expected != Ok(None) {
            message.clear();
        }
    }
}

/// Splits a message of `len` bytes, after an interrupted one, into fragments of at most `room` bytes each, with their headers.
pub fn split(len: usize, room: usize) -> Vec<Vec<u8>> {
    let mut splitter = Splitter::new();
    // A message of which only the first fragment was sent.
    splitter.start(room);
    assert!(splitter.next(&mut vec![0; room]).is_some());
    for (at, slot) in splitter.buffer().iter_mut().enumerate() {
        *slot = byte(0, at);
    }
    splitter.start(len);
    let mut fragments = Vec::new();
    let mut fragment = vec![0; room];
    while let Some(len) = splitter.next(&mut fragment) {
        fragments.push(fragment[..len].to_vec());
    }
    assert!(splitter.is_done());
    fragments
}

/// A message is split into as few fragments as possible, all but the last of them full, and the joiner returns the message.
pub fn splitting(len: usize, room: usize) {
    let fragments = split(len, room);
    assert_eq!(fragments.len(), len.div_ceil(room - 1));
    let mut joiner = Joiner::new();
    for (number, fragment) in fragments.iter().enumerate() {
        let is_last = number + 1 == fragments.len();
        assert_eq!(usize::from(fragment[0]), number | if is_last { 0x80 } else { 0 });
        assert!(fragment.len() == room || is_last);
        let expected: Option<Vec<u8>> = is_last.then(|| (0..len).map(|at| byte(0, at)).collect());
        assert_eq!(joiner.push(fragment).map(|joined| joined.map(<[u8]>::to_vec)), Ok(expected));
    }
}

/// If fragments of a message are lost, repeated or reordered, the joiner returns the message exactly when all of its fragments
/// have arrived in order, one directly after the other. `order` has the indices of the fragments in the order of their arrival.
pub fn disorder(fragments: &[Vec<u8>], order: &[usize]) {
    let message: Vec<u8> = fragments.iter().flat_map(|fragment| &fragment[1..]).copied().collect();
    let mut joiner = Joiner::new();
    for (arrived, &index) in order.iter().enumerate() {
        let is_complete = index + 1 == fragments.len()
            && arrived + 1 >= fragments.len()
            && order[arrived + 1 - fragments.len()..=arrived].iter().copied().eq(0..fragments.len());
        let joined = joiner.push(&fragments[index]).ok().flatten();
        assert_eq!(joined, is_complete.then_some(&message[..]));
    }
}

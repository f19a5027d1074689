//! Messages in fragments, for a carrier with packets shorter than a message.
//!
//! A fragment is one header byte and a part of the message. Bit 7 of the header marks the last fragment, bits 0 to 6 number the
//! fragments from 0. The carrier neither loses, repeats nor reorders fragments, so an unexpected number is an error of the
//! sender.

use super::MAX_MESSAGE;
use core::fmt;
use heapless::Vec;

/// Marks the last fragment of a message.
const LAST: u8 = 0x80;

/// Splits a message into fragments.
#[derive(Debug)]
pub struct Splitter {
    message: [u8; MAX_MESSAGE],
    /// Length of the message, bytes.
    len: usize,
    /// Number of bytes of the message that were returned in fragments.
    sent: usize,
    /// Number of the next fragment.
    next: u8,
    /// The parts have no headers.
    is_plain: bool,
}

impl Splitter {
    /// A splitter without a message.
    pub const fn new() -> Self {
        Self { message: [0; MAX_MESSAGE], len: 0, sent: 0, next: 0, is_plain: false }
    }

    /// The buffer for the next message, to be filled before [`Splitter::start`].
    pub fn buffer(&mut self) -> &mut [u8; MAX_MESSAGE] {
        &mut self.message
    }

    /// Begins a message, the first `len` bytes of [`Splitter::buffer`].
    pub fn start(&mut self, len: usize) {
        *self = Self { len: len.min(MAX_MESSAGE), sent: 0, next: 0, is_plain: false, ..*self };
    }

    /// Begins a message as [`Splitter::start`] does, for a message that contains its length, so that its parts need no headers.
    pub fn start_plain(&mut self, len: usize) {
        self.start(len);
        self.is_plain = true;
    }

    /// True if all fragments of the message were returned.
    pub fn is_done(&self) -> bool {
        self.sent == self.len
    }

    /// Writes the next fragment into `fragment`, which has at least 6 bytes, and returns its length; `None` after the last one.
    pub fn next(&mut self, fragment: &mut [u8]) -> Option<usize> {
        let unsent = self.message.get(self.sent..self.len).filter(|unsent| !unsent.is_empty())?;
        if self.is_plain {
            let len = unsent.len().min(fragment.len());
            fragment[..len].copy_from_slice(&unsent[..len]);
            self.sent += len;
            return Some(len);
        }
        let (header, room) = fragment.split_first_mut()?;
        let len = unsent.len().min(room.len());
        room[..len].copy_from_slice(&unsent[..len]);
        self.sent += len;
        *header = self.next | if self.is_done() { LAST } else { 0 };
        // Even the longest message in the shortest fragments has fewer than 128 of them, so the number fits 7 bits.
        self.next = (self.next + 1) & !LAST;
        Some(len + 1)
    }
}

impl Default for Splitter {
    fn default() -> Self {
        Self::new()
    }
}

/// Why a fragment was not accepted. The fragments before it are discarded: the next message starts with fragment 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FragmentError {
    /// The fragment has no header.
    Empty,
    /// The fragment does not have the next number.
    OutOfOrder,
    /// The message is longer than [`MAX_MESSAGE`].
    TooLong,
}

impl fmt::Display for FragmentError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Empty => "a fragment of a message without its header",
            Self::OutOfOrder => "a fragment of a message out of order",
            Self::TooLong => "a message longer than the protocol allows",
        })
    }
}

impl core::error::Error for FragmentError {}

/// Joins the fragments of the messages of one characteristic.
#[derive(Debug, Default)]
pub struct Joiner {
    message: Vec<u8, MAX_MESSAGE>,
    /// Number of the next fragment.
    next: u8,
    /// `message` is complete.
    whole: bool,
}

impl Joiner {
    /// A joiner before the first fragment.
    pub const fn new() -> Self {
        Self { message: Vec::new(), next: 0, whole: false }
    }

    /// Adds a fragment; returns the message if this was its last fragment. Fragment 0 always starts a message.
    ///
    /// # Errors
    /// If the fragment does not continue the message.
    pub fn push(&mut self, fragment: &[u8]) -> Result<Option<&[u8]>, FragmentError> {
        let joined = self.join(fragment);
        if joined.is_err() {
            *self = Self::new();
        }
        joined.map(|()| self.whole.then_some(self.message.as_slice()))
    }

    /// Adds a part without a header; returns the message if this was its last part. `message_bytes` computes the length of a
    /// message from its first bytes; it returns `None` as long as these are too few.
    ///
    /// # Errors
    /// [`FragmentError::TooLong`], if the message is too long, or the part extends beyond the end of the message.
    pub fn push_plain(
        &mut self,
        part: &[u8],
        message_bytes: impl Fn(&[u8]) -> Option<usize>,
    ) -> Result<Option<&[u8]>, FragmentError> {
        if self.whole {
            *self = Self::new();
        }
        let is_stored = self.message.extend_from_slice(part).is_ok();
        let expected = message_bytes(&self.message).unwrap_or(MAX_MESSAGE);
        if !is_stored || expected > MAX_MESSAGE || self.message.len() > expected {
            *self = Self::new();
            return Err(FragmentError::TooLong);
        }
        self.whole = self.message.len() == expected;
        Ok(self.whole.then_some(self.message.as_slice()))
    }

    fn join(&mut self, fragment: &[u8]) -> Result<(), FragmentError> {
        let (header, part) = fragment.split_first().ok_or(FragmentError::Empty)?;
        let number = header & !LAST;
        if number == 0 || self.whole {
            *self = Self::new();
        }
        if number != self.next {
            return Err(FragmentError::OutOfOrder);
        }
        self.message.extend_from_slice(part).map_err(|_| FragmentError::TooLong)?;
        self.next = number + 1;
        self.whole = header & LAST != 0;
        Ok(())
    }
}

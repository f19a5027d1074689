//! Messages in pieces, for a carrier whose packets are shorter than a message.
//!
//! A piece is one header byte and a part of the message. Bit 7 of the header marks the last piece, bits 0 to 6 number the
//! pieces from 0. The carrier neither loses, repeats nor reorders pieces, so a number out of turn is a sender's mistake.

use crate::wire::MAX_MESSAGE;
use core::fmt;
use heapless::Vec;

/// Marks the last piece of a message.
const LAST: u8 = 0x80;

/// Cuts a message into pieces.
#[derive(Debug)]
pub struct Splitter {
    message: [u8; MAX_MESSAGE],
    len: usize,
    sent: usize,
    next: u8,
}

impl Splitter {
    /// Without a message.
    pub const fn new() -> Self {
        Self { message: [0; MAX_MESSAGE], len: 0, sent: 0, next: 0 }
    }

    /// Where the next message goes, before [`Splitter::start`].
    pub fn buffer(&mut self) -> &mut [u8; MAX_MESSAGE] {
        &mut self.message
    }

    /// Begins a message of `len` bytes, which is in the buffer.
    pub fn start(&mut self, len: usize) {
        *self = Self { len: len.min(MAX_MESSAGE), sent: 0, next: 0, ..*self };
    }

    /// All pieces of the message are out.
    pub fn is_done(&self) -> bool {
        self.sent == self.len
    }

    /// Writes the next piece, as long as `piece` has room for, which is at least 4 bytes; its length.
    pub fn next(&mut self, piece: &mut [u8]) -> Option<usize> {
        let rest = self.message.get(self.sent..self.len).filter(|rest| !rest.is_empty())?;
        let (header, room) = piece.split_first_mut()?;
        let len = rest.len().min(room.len());
        room[..len].copy_from_slice(&rest[..len]);
        self.sent += len;
        *header = self.next | if self.is_done() { LAST } else { 0 };
        // The longest message in the shortest pieces has less than 128.
        self.next = (self.next + 1) & !LAST;
        Some(len + 1)
    }
}

impl Default for Splitter {
    fn default() -> Self {
        Self::new()
    }
}

/// Why a piece was refused. What was joined so far is dropped: the next message starts with piece 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// No header.
    Empty,
    /// Not the number that follows.
    OutOfOrder,
    /// Longer than any message.
    TooLong,
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Empty => "a piece of a message without its header",
            Self::OutOfOrder => "a piece of a message out of order",
            Self::TooLong => "a message longer than any is",
        })
    }
}

impl core::error::Error for Refused {}

/// Joins the pieces of one characteristic's messages.
#[derive(Debug, Default)]
pub struct Joiner {
    message: Vec<u8, MAX_MESSAGE>,
    next: u8,
    whole: bool,
}

impl Joiner {
    /// Before the first piece.
    pub const fn new() -> Self {
        Self { message: Vec::new(), next: 0, whole: false }
    }

    /// Takes a piece; the message when it was the last one. Piece 0 always starts a message.
    pub fn push(&mut self, piece: &[u8]) -> Result<Option<&[u8]>, Refused> {
        let joined = self.join(piece);
        if joined.is_err() {
            *self = Self::new();
        }
        joined.map(|()| self.whole.then_some(self.message.as_slice()))
    }

    fn join(&mut self, piece: &[u8]) -> Result<(), Refused> {
        let (header, part) = piece.split_first().ok_or(Refused::Empty)?;
        let number = header & !LAST;
        if number == 0 || self.whole {
            *self = Self::new();
        }
        if number != self.next {
            return Err(Refused::OutOfOrder);
        }
        self.message.extend_from_slice(part).map_err(|_| Refused::TooLong)?;
        self.next = number + 1;
        self.whole = header & LAST != 0;
        Ok(())
    }
}

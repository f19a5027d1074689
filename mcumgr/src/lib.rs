//! The Simple Management Protocol (SMP) of MCUmgr, with which standard tools update a device: requests and answers, each a head
//! of eight bytes and a map in CBOR.
//!
//! A tool sends a request and waits for the answer. `docs/update.md` has the commands. On a serial port messages travel in lines
//! of text ([`line`]), over Bluetooth as the values of a characteristic.
//!
//! This is a separate package because it is compiled for size, while the library is compiled for speed.
#![no_std]
#![forbid(unsafe_code)]

mod answer;
mod cbor;
mod clock;
pub mod line;

pub use answer::{Answer, Failure, ImageState};
pub use clock::{Clock, DAY_MIN};

use cbor::Item;
use heapless::{String, Vec};

/// Length of the head of a message, bytes.
pub const HEAD: usize = 8;
/// Longest text of an echo, bytes; a longer one is refused. Also the largest number of bytes of a file that one request can
/// store: if its part of the file is longer, the offset in the answer requests the rest again.
pub const CHUNK: usize = 192;
/// Longest message that tools may send, bytes, including two bytes for its length and two for its checksum. On a serial port,
/// all lines of such a message together have 281 bytes, which the receive buffers of the ports can hold.
pub const BUFFER: u16 = 204;

/// A SHA-256.
pub type Sha256 = [u8; 32];

/// A text that is sent back.
pub type Text = String<CHUNK>;

/// The head of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Head {
    /// The operation is a write, not a read.
    pub is_write: bool,
    /// The version of the protocol, 0 or 1. It decides how failures are reported.
    pub version: u8,
    /// The group of the command.
    pub group: u16,
    /// A number that the answer repeats.
    pub sequence: u8,
    /// The command within its group.
    pub command: u8,
}

/// The group of the commands for the operating system.
pub const OS: u16 = 0;
/// The group of the commands for images.
pub const IMAGE: u16 = 1;

/// A decoded request.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(
    clippy::large_enum_variant,
    reason = "only one request is decoded at a time, so boxing a variant would save nothing"
)]
pub enum Request {
    /// Send the text back.
    Echo(Text),
    /// Send the length of the longest message that is accepted, and the number of messages that can wait.
    Parameters,
    /// Restart.
    Reset,
    /// Send the wall clock.
    GetTime,
    /// Set the wall clock.
    SetTime(Clock),
    /// Send the state of the images.
    GetImages,
    /// Let an image run at the next start, or confirm the running one.
    SetImage {
        /// The SHA-256 of the image; `None` for the running one.
        sha256: Option<Sha256>,
        /// Confirm the image.
        is_confirmed: bool,
    },
    /// Store a part of a file.
    Upload(Upload),
    /// Discard the received image.
    Erase,
}

/// A part of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Upload {
    /// The offset of the part in the file, bytes.
    pub offset: u32,
    /// Length of the file, bytes; in the first part only.
    pub file_bytes: Option<u32>,
    /// The SHA-256 of the file, in the first part only. A transfer of the same file continues where it was interrupted.
    pub sha256: Option<Sha256>,
    /// The image must be newer than the running one.
    pub must_be_newer: bool,
    /// The first bytes of the part, at most [`CHUNK`]. The answer has the offset of the next part.
    pub data: Vec<u8, CHUNK>,
}

/// The length of the message that begins with these bytes; `None` if its head is incomplete.
pub fn message_bytes(start: &[u8]) -> Option<usize> {
    let &[_, _, high, low, ..] = start else { return None };
    (start.len() >= HEAD).then(|| HEAD + usize::from(u16::from_be_bytes([high, low])))
}

/// An encoded map without entries.
const EMPTY_MAP: &[u8] = &[0xa0];

/// Decodes a message; `None` if it is not a request.
// Not inlined, because the caller may be compiled for speed.
#[inline(never)]
pub fn decode(message: &[u8]) -> Option<(Head, Result<Request, Failure>)> {
    let (&[first, _, _, _, group_high, group_low, sequence, command], body) = message.split_first_chunk()?;
    // The first byte contains the operation (0 read request, 2 write request) in its three lowest bits, and the version above
    // them.
    let is_write = match first & 0b111 {
        0 => false,
        2 => true,
        _ => return None,
    };
    if message_bytes(message) != Some(message.len()) {
        return None;
    }
    let group = u16::from_be_bytes([group_high, group_low]);
    let head = Head { is_write, version: first >> 3 & 0b11, group, sequence, command };
    Some((head, request(&head, body)))
}

/// The fields of all supported requests, as places in [`KEYS`].
mod field {
    pub const TEXT: usize = 0;
    pub const CLOCK: usize = 1;
    pub const FILE_SHA256: usize = 2;
    pub const SHA256: usize = 3;
    pub const DATA: usize = 4;
    pub const OFFSET: usize = 5;
    pub const FILE_BYTES: usize = 6;
    pub const IMAGE: usize = 7;
    pub const SLOT: usize = 8;
    pub const CONFIRM: usize = 9;
    pub const UPGRADE: usize = 10;
}

/// The names of the fields.
const KEYS: [&str; 11] = ["d", "datetime", "sha", "hash", "data", "off", "len", "image", "slot", "confirm", "upgrade"];

/// The fields of a request.
struct Fields<'b>([Option<Item<'b>>; KEYS.len()]);

impl<'b> Fields<'b> {
    fn number(&self, field: usize) -> Result<Option<u32>, Failure> {
        self.0[field].map(|item| item.number().ok_or(Failure::INVALID)).transpose()
    }

    fn text(&self, field: usize) -> Result<&'b str, Failure> {
        self.0[field].and_then(Item::text).ok_or(Failure::INVALID)
    }

    fn flag(&self, field: usize) -> Result<bool, Failure> {
        self.0[field].map_or(Ok(false), |item| item.flag().ok_or(Failure::INVALID))
    }

    fn sha256(&self, field: usize) -> Result<Option<Sha256>, Failure> {
        let sha256 = |item: Item| item.bytes().and_then(|bytes| bytes.try_into().ok()).ok_or(Failure::HASH);
        self.0[field].map(sha256).transpose()
    }
}

/// The request with this head and this body.
///
/// # Errors
/// The failure that the answer reports, if the request is malformed or not supported.
fn request(head: &Head, body: &[u8]) -> Result<Request, Failure> {
    // A request without fields may have no map.
    let body = if body.is_empty() { EMPTY_MAP } else { body };
    let fields = Fields(cbor::read_map(body, &KEYS).ok_or(Failure::INVALID)?);
    Ok(match (head.group, head.command, head.is_write) {
        (OS, 0, _) => Request::Echo(Text::try_from(fields.text(field::TEXT)?).map_err(|_| Failure::TOO_LONG)?),
        (OS, 4, false) => Request::GetTime,
        (OS, 4, true) => Request::SetTime(Clock::parse(fields.text(field::CLOCK)?).ok_or(Failure::INVALID)?),
        (OS, 5, true) => Request::Reset,
        (OS, 6, false) => Request::Parameters,
        (IMAGE, 0, false) => Request::GetImages,
        (IMAGE, 0, true) => {
            Request::SetImage { sha256: fields.sha256(field::SHA256)?, is_confirmed: fields.flag(field::CONFIRM)? }
        }
        (IMAGE, 1, true) => {
            if fields.number(field::IMAGE)?.is_some_and(|image| image > 0) {
                return Err(Failure::SLOT);
            }
            let data = fields.0[field::DATA].and_then(Item::bytes).ok_or(Failure::INVALID)?;
            Request::Upload(Upload {
                offset: fields.number(field::OFFSET)?.ok_or(Failure::OFFSET)?,
                file_bytes: fields.number(field::FILE_BYTES)?,
                sha256: fields.sha256(field::FILE_SHA256)?,
                must_be_newer: fields.flag(field::UPGRADE)?,
                data: Vec::from_slice(data.get(..CHUNK).unwrap_or(data)).unwrap_or_default(),
            })
        }
        (IMAGE, 5, true) if fields.number(field::SLOT)?.is_none_or(|slot| slot == 1) => Request::Erase,
        (IMAGE, 5, true) => return Err(Failure::SLOT),
        _ => return Err(Failure::NOT_SUPPORTED),
    })
}

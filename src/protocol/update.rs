//! The messages of a firmware update, and the header of an image.

use core::fmt;
use serde::{Deserialize, Serialize};

/// Length of a chunk, bytes: the largest number of bytes that the flash chip writes at once. An image is padded to whole chunks
/// and sent chunk by chunk.
pub const CHUNK: usize = 256;
/// A chunk of an image; a nested array, because serde supports arrays of up to 32 elements.
pub type Chunk = [[u8; 32]; CHUNK / 32];
/// An ed25519 signature of an image's SHA-512; a nested array for the same reason as [`Chunk`].
pub type Signature = [[u8; 32]; 2];

/// The first bytes of every header.
const MAGIC: [u8; 8] = *b"plantar1";

/// The header of an image, [`crate::storage::flash_map::HEADER`] bytes after its beginning.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    magic: [u8; 8],
    pub(crate) board: [u8; 16],
    version: [u8; 16],
}

impl Header {
    /// Length of [`Header::bytes`].
    pub const BYTES: usize = size_of::<Self>();

    /// The header of an image for the board with the name `board`; `version` has the form `1.2.3` or `1.2.3+build`.
    ///
    /// # Panics
    /// If a text is longer than 16 bytes.
    pub const fn new(board: &str, version: &str) -> Self {
        const fn padded(text: &str) -> [u8; 16] {
            let (text, mut bytes) = (text.as_bytes(), [0; 16]);
            bytes.split_at_mut(text.len()).0.copy_from_slice(text);
            bytes
        }
        Self { magic: MAGIC, board: padded(board), version: padded(version) }
    }

    /// Decodes a header; `None` if `bytes` are not a valid header.
    pub fn read(bytes: &[u8; Self::BYTES]) -> Option<Self> {
        let (magic, rest) = bytes.split_first_chunk()?;
        let (board, rest) = rest.split_first_chunk()?;
        let header = Self { magic: *magic, board: *board, version: rest.try_into().ok()? };
        (header.magic == MAGIC && header.number().is_some()).then_some(header)
    }

    /// The header as it is stored in the image.
    pub fn bytes(&self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        let (magic, rest) = bytes.split_at_mut(self.magic.len());
        let (board, version) = rest.split_at_mut(self.board.len());
        magic.copy_from_slice(&self.magic);
        board.copy_from_slice(&self.board);
        version.copy_from_slice(&self.version);
        bytes
    }

    /// The board that the image is for.
    pub fn board(&self) -> &str {
        text(&self.board)
    }

    /// The version of the image.
    pub fn version(&self) -> &str {
        text(&self.version)
    }

    /// The three numbers of the version, for comparison; `None` if it has another form. A part after a plus sign, as in
    /// `1.2.3+build`, is ignored.
    pub fn number(&self) -> Option<[u16; 3]> {
        let (release, _build) = self.version().split_once('+').unwrap_or((self.version(), ""));
        let mut parts = release.split('.');
        let mut number = [0; 3];
        for part in &mut number {
            *part = parts.next()?.parse().ok()?;
        }
        parts.next().is_none().then_some(number)
    }
}

fn text(bytes: &[u8; 16]) -> &str {
    let len = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    core::str::from_utf8(&bytes[..len]).unwrap_or_default()
}

/// An image that a host offers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Offer {
    /// The header of the image.
    pub header: Header,
    /// The length of the image, chunks.
    pub chunks: u16,
    /// The signature of the image.
    pub signature: Signature,
}

/// A request of a host during a firmware update.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "requests exist one at a time, in place")]
pub enum Request {
    /// Asks whether the insole accepts this image. The transfer of the same image continues where it was interrupted.
    Begin(Offer),
    /// A chunk of the image.
    Chunk {
        /// The number of the chunk, from 0.
        number: u16,
        /// The content of the chunk.
        chunk: Chunk,
    },
    /// Ends the transfer: the insole checks the signature and restarts with the new image.
    Finish,
    /// States that this host can use the insole with the running image; answered by [`Progress::Confirmed`], or by
    /// [`Refusal::OnTrial`] while the insole still checks the image. After [`Refusal::OnTrial`], the insole confirms the image
    /// without another request once the image has passed the checks.
    Confirm,
}

/// The progress of an update.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Progress {
    /// The insole expects the chunk with this number, or [`Request::Finish`] after the last one.
    Next(u16),
    /// The signature is valid, and the insole restarts.
    Accepted,
    /// The running image is confirmed.
    Confirmed,
}

/// Why a request was refused; the running image remains in use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// The image is for another board.
    Board,
    /// The running image is newer, or has the same version although a management tool requires a newer one.
    Older,
    /// The image is empty or too long.
    Length,
    /// The running image is still on trial, or a received image is marked for the next start.
    OnTrial,
    /// No transfer is in progress, because none was begun or the insole restarted.
    NotBegun,
    /// Chunks are missing.
    Incomplete,
    /// The image is not the one that was offered.
    Header,
    /// The image is damaged, or not signed with the key that this insole accepts.
    Signature,
    /// The flash chip failed, or its supply is too low.
    Chip,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Board => "the image is for another board: choose the one for this insole",
            Self::Older => "the image is older than the running firmware: choose a newer one",
            Self::Length => "the image is empty or too long for the insole: choose a complete one for this insole",
            Self::OnTrial => {
                "the running firmware is still on trial, or a received image waits for the next start: a firmware on trial is \
                 confirmed after ten minutes without a fault; if an image waits, restart the insole first"
            }
            Self::NotBegun => "the insole has no transfer in progress, for example because it restarted: send the image again",
            Self::Incomplete => "parts of the image are missing: send it again",
            Self::Header => "the received image is not the one that was offered: send it again",
            Self::Signature => {
                "the image is damaged, or not signed with the key that this insole accepts: ask its manufacturer for a \
                 signed one"
            }
            Self::Chip => {
                "the insole could not write to its flash chip: charge its battery and send the image again; if this fails with \
                 a charged battery, the chip must be repaired"
            }
        })
    }
}

impl core::error::Error for Refusal {}

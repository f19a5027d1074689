//! Takes in a new image, chunk by chunk, and lets the bootloader swap it with the running one once its signature is right.
//!
//! The bootloader, `embassy-boot`, swaps at the next start, and back at the one after unless the new image confirmed itself by
//! then. `docs/update.md` has the whole way.

use crate::map::{HEADER, MAX_IMAGE, OTHER, SECTOR, STATE};
use core::fmt;
use core::ops::Range;
use embassy_boot::{FirmwareState, FirmwareUpdater, FirmwareUpdaterConfig, FirmwareUpdaterError, State};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use serde::{Deserialize, Serialize};

/// An image arrives in pieces of this length, and is a whole number of them, bytes. The flash chip writes as much at once.
pub const CHUNK: usize = 256;
/// A piece of an image; nested, because messages know no longer arrays.
pub type Chunk = [[u8; 32]; CHUNK / 32];
/// An ed25519 signature of an image's SHA-512; nested as above.
pub type Signature = [[u8; 32]; 2];

/// The public key of those who make images for this insole, as `PLANTAR_UPDATE_KEY` gave it to the build in hex; else the one
/// for development, whose other half everybody knows (`docs/security.md`).
pub const KEY: [u8; 32] = from_hex(match option_env!("PLANTAR_UPDATE_KEY") {
    Some(key) => key,
    None => "68335e1b188bb8cd9c390c584b54e2ad61f1604f71091415177d09ab23c3970c",
});

const fn from_hex(text: &str) -> [u8; 32] {
    const fn digit(digit: u8) -> u8 {
        match (digit as char).to_digit(16) {
            Some(value) => value as u8,
            None => panic!("PLANTAR_UPDATE_KEY holds something that is no hex digit"),
        }
    }
    let (digits, mut bytes, mut i) = (text.as_bytes(), [0; 32], 0);
    assert!(digits.len() == 64, "PLANTAR_UPDATE_KEY has 64 hex digits");
    while i < bytes.len() {
        bytes[i] = digit(digits[2 * i]) << 4 | digit(digits[2 * i + 1]);
        i += 1;
    }
    bytes
}

const MAGIC: [u8; 8] = *b"plantar1";

/// What an image says of itself, [`HEADER`] bytes after its beginning.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    magic: [u8; 8],
    board: [u8; 16],
    version: [u8; 16],
}

impl Header {
    /// Length of [`Header::bytes`].
    pub const BYTES: usize = size_of::<Self>();

    /// An image for a board; name and version (`1.2.3`) have at most 16 bytes.
    pub const fn new(board: &str, version: &str) -> Self {
        const fn padded(text: &str) -> [u8; 16] {
            let (text, mut bytes) = (text.as_bytes(), [0; 16]);
            bytes.split_at_mut(text.len()).0.copy_from_slice(text);
            bytes
        }
        Self { magic: MAGIC, board: padded(board), version: padded(version) }
    }

    /// Reads an image's.
    pub fn read(bytes: &[u8; Self::BYTES]) -> Option<Self> {
        let (magic, rest) = bytes.split_first_chunk()?;
        let (board, rest) = rest.split_first_chunk()?;
        let header = Self { magic: *magic, board: *board, version: rest.try_into().ok()? };
        (header.magic == MAGIC && header.number().is_some()).then_some(header)
    }

    /// As it lies in the image.
    pub fn bytes(&self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        let (magic, rest) = bytes.split_at_mut(self.magic.len());
        let (board, version) = rest.split_at_mut(self.board.len());
        magic.copy_from_slice(&self.magic);
        board.copy_from_slice(&self.board);
        version.copy_from_slice(&self.version);
        bytes
    }

    /// The board that it is for.
    pub fn board(&self) -> &str {
        text(&self.board)
    }

    /// Its version.
    pub fn version(&self) -> &str {
        text(&self.version)
    }

    /// The version's three numbers, to be compared.
    pub fn number(&self) -> Option<[u16; 3]> {
        let mut parts = self.version().split('.');
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

/// An image that a host would send.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Offer {
    /// Its header.
    pub header: Header,
    /// Its length, chunks.
    pub chunks: u16,
    /// Its signature.
    pub signature: Signature,
}

/// A step of an update.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "requests live one at a time, in place")]
pub enum Request {
    /// Asks whether the insole takes this image. The one that it was sent last goes on where it was.
    Begin(Offer),
    /// A piece of it.
    Chunk {
        /// Which, from 0.
        number: u16,
        /// The piece.
        chunk: Chunk,
    },
    /// All is there: checks the signature. The insole restarts with the new image.
    Finish,
}

/// How far an update is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Progress {
    /// The insole waits for the chunk of this number, or for [`Request::Finish`] after the last.
    Next(u16),
    /// The signature is right, and the insole restarts.
    Accepted,
}

/// Why an image was not taken; the running one stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// It is for another board.
    Board,
    /// A newer one runs.
    Older,
    /// There is no room for it.
    Length,
    /// The running image did not confirm itself yet.
    OnTrial,
    /// Nothing was begun, as after a restart.
    NotBegun,
    /// Chunks are missing.
    Incomplete,
    /// It is not what was offered.
    Header,
    /// It is not signed with the key that this insole takes, or was damaged.
    Signature,
    /// The flash chip failed.
    Chip,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Board => "the image is for another board: choose the one that is made for this insole",
            Self::Older => "the image is older than what runs, and stays out: choose a newer one",
            Self::Length => "the image is empty or longer than the insole has room for",
            Self::OnTrial => {
                "what runs was updated just now and is still on trial: wait half a minute while it runs, then try again"
            }
            Self::NotBegun => "the insole restarted during the transfer: send the image again",
            Self::Incomplete => "parts of the image are missing: send it again",
            Self::Header => "the image is not the one that was announced: send it again",
            Self::Signature => {
                "the image is damaged, or not signed with the key that this insole takes: ask its maker for one that is"
            }
            Self::Chip => "its flash chip failed: the insole runs on, and needs repair to be updated",
        })
    }
}

impl From<NorFlashErrorKind> for Refusal {
    fn from(_: NorFlashErrorKind) -> Self {
        Self::Chip
    }
}

impl From<FirmwareUpdaterError> for Refusal {
    fn from(error: FirmwareUpdaterError) -> Self {
        match error {
            FirmwareUpdaterError::Flash(_) => Self::Chip,
            FirmwareUpdaterError::Signature(_) => Self::Signature,
            FirmwareUpdaterError::BadState => Self::OnTrial,
        }
    }
}

/// An update that arrives.
#[derive(Debug, Default)]
pub struct Update {
    offer: Option<Offer>,
    next: u16,
}

impl Update {
    /// Nothing begun.
    pub const fn new() -> Self {
        Self { offer: None, next: 0 }
    }

    /// Does what a host asks. `running` is the header of the image that runs, `key` the one that signatures must be of.
    pub async fn handle<F: NorFlash>(
        &mut self,
        flash: &mut F,
        running: &Header,
        key: &[u8; 32],
        request: &Request,
    ) -> Result<Progress, Refusal> {
        match request {
            Request::Begin(offer) => self.begin(flash, running, offer).await,
            Request::Chunk { number, chunk } => self.chunk(flash, *number, chunk).await,
            Request::Finish => self.finish(flash, key).await,
        }
    }

    async fn begin<F: NorFlash>(
        &mut self,
        flash: &mut F,
        running: &Header,
        offer: &Offer,
    ) -> Result<Progress, Refusal> {
        if offer.header.board != running.board {
            return Err(Refusal::Board);
        }
        if offer.header.number() < running.number() {
            return Err(Refusal::Older);
        }
        if !(1..=MAX_IMAGE).contains(&(u32::from(offer.chunks) * CHUNK as u32)) {
            return Err(Refusal::Length);
        }
        // The image before lies where the new one would.
        if is_on_trial(flash).await? {
            return Err(Refusal::OnTrial);
        }
        if self.offer.as_ref() != Some(offer) {
            *self = Self { offer: Some(*offer), next: 0 };
        }
        Ok(Progress::Next(self.next))
    }

    async fn chunk<F: NorFlash>(&mut self, flash: &mut F, number: u16, chunk: &Chunk) -> Result<Progress, Refusal> {
        let offer = self.offer.as_ref().ok_or(Refusal::NotBegun)?;
        // Any other was answered already, or comes after one that was lost.
        if number == self.next && number < offer.chunks {
            let at = OTHER.start + u32::from(number) * CHUNK as u32;
            if at.is_multiple_of(SECTOR) {
                flash.erase(at, at + SECTOR).await.map_err(|error| error.kind())?;
            }
            flash.write(at, chunk.as_flattened()).await.map_err(|error| error.kind())?;
            self.next += 1;
        }
        Ok(Progress::Next(self.next))
    }

    async fn finish<F: NorFlash>(&mut self, flash: &mut F, key: &[u8; 32]) -> Result<Progress, Refusal> {
        let offer = self.offer.ok_or(Refusal::NotBegun)?;
        if self.next < offer.chunks {
            return Err(Refusal::Incomplete);
        }
        // Whatever is wrong now, sending the rest does not mend it.
        *self = Self::new();
        let mut header = [0; Header::BYTES];
        flash.read(OTHER.start + HEADER, &mut header).await.map_err(|error| error.kind())?;
        if Header::read(&header) != Some(offer.header) {
            return Err(Refusal::Header);
        }
        let chip = Mutex::new(flash);
        let mut word = [0; WORD];
        let config = FirmwareUpdaterConfig { dfu: Area::<_, CHUNK>::new(&chip, OTHER), state: state(&chip) };
        let signature = *offer.signature.as_flattened().as_array().ok_or(Refusal::Signature)?;
        let len = u32::from(offer.chunks) * CHUNK as u32;
        FirmwareUpdater::new(config, &mut word).verify_and_mark_updated(key, &signature, len).await?;
        Ok(Progress::Accepted)
    }
}

/// True for an image that the bootloader swaps back unless it is confirmed.
pub async fn is_on_trial<F: NorFlash>(flash: &mut F) -> Result<bool, Refusal> {
    let (chip, mut word) = (Mutex::new(flash), [0; WORD]);
    Ok(FirmwareState::new(state(&chip), &mut word).get_state().await? == State::Swap)
}

/// Lets the running image stay.
pub async fn confirm<F: NorFlash>(flash: &mut F) -> Result<(), Refusal> {
    let (chip, mut word) = (Mutex::new(flash), [0; WORD]);
    Ok(FirmwareState::new(state(&chip), &mut word).mark_booted().await?)
}

/// Bytes of a mark in [`STATE`]: a loss of power leaves no other mark instead.
pub const WORD: usize = 8;

/// [`STATE`] as an area.
pub fn state<F>(chip: &Mutex<NoopRawMutex, F>) -> Area<'_, F, WORD> {
    Area::new(chip, STATE)
}

/// An area of the flash chip, written `WRITE` bytes at a time. Short reads are served from a page that is read at once, and other
/// tasks have their turn between pages.
pub struct Area<'a, F, const WRITE: usize> {
    chip: &'a Mutex<NoopRawMutex, F>,
    range: Range<u32>,
    page: [u8; CHUNK],
    page_at: Option<u32>,
}

impl<'a, F, const WRITE: usize> Area<'a, F, WRITE> {
    /// The area of these addresses.
    pub fn new(chip: &'a Mutex<NoopRawMutex, F>, range: Range<u32>) -> Self {
        Self { chip, range, page: [0; CHUNK], page_at: None }
    }

    /// The address of `len` bytes.
    fn at(&self, offset: u32, len: u32) -> Result<u32, NorFlashErrorKind> {
        let room = (self.range.end - self.range.start).checked_sub(offset).ok_or(NorFlashErrorKind::OutOfBounds)?;
        if len <= room { Ok(self.range.start + offset) } else { Err(NorFlashErrorKind::OutOfBounds) }
    }
}

impl<F, const WRITE: usize> ErrorType for Area<'_, F, WRITE> {
    type Error = NorFlashErrorKind;
}

impl<F: ReadNorFlash, const WRITE: usize> ReadNorFlash for Area<'_, F, WRITE> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let mut at = self.at(offset, bytes.len() as u32)?;
        if bytes.len() >= CHUNK {
            return self.chip.lock().await.read(at, bytes).await.map_err(|error| error.kind());
        }
        for byte in bytes {
            let within = at as usize % CHUNK;
            let page_at = at - within as u32;
            if self.page_at != Some(page_at) {
                self.page_at = None;
                self.chip.lock().await.read(page_at, &mut self.page).await.map_err(|error| error.kind())?;
                self.page_at = Some(page_at);
                yield_now().await;
            }
            *byte = self.page[within];
            at += 1;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.range.len()
    }
}

impl<F: NorFlash, const WRITE: usize> NorFlash for Area<'_, F, WRITE> {
    const WRITE_SIZE: usize = WRITE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.page_at = None;
        let start = self.at(from, to.saturating_sub(from))?;
        let end = start + to.saturating_sub(from);
        self.chip.lock().await.erase(start, end).await.map_err(|error| error.kind())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.page_at = None;
        let at = self.at(offset, bytes.len() as u32)?;
        self.chip.lock().await.write(at, bytes).await.map_err(|error| error.kind())
    }
}

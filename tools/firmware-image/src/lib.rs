//! Firmware images: made from the linker's output, signed, and verified before they are sent.
//!
//! An image file has the form of MCUboot ([`plantar::protocol::mcuboot`]): the image, padded to whole chunks, between a header
//! and a trailer with its Ed25519 signature and the public key that verifies the signature.

use ed25519_dalek::{Digest, Sha512, Signer, VerifyingKey};
use object::{Object, ObjectSegment};
use plantar::protocol::mcuboot::{FRONT, Sha256, TRAILER, front, read_front, read_trailer, trailer};
use plantar::protocol::update::{CHUNK, Chunk, Header, Offer};
use plantar::storage::flash_map::{HEADER, MAX_IMAGE};
use std::path::{Path, PathBuf};
use thiserror::Error;

pub use ed25519_dalek::SigningKey;

/// The contents of the file of the published key for development.
pub const DEVELOPMENT_KEY: &str = include_str!("../development.key");

const SIGNATURE_BYTES: usize = 64;
const KEY_BYTES: usize = 32;

/// Why an image cannot be made or read, or a key cannot be read.
#[derive(Debug, Error)]
pub enum Error {
    /// A file cannot be read.
    #[error("cannot read {0}: {1}")]
    Read(PathBuf, std::io::Error),
    /// The file is not the linker's output for a board.
    #[error("{0} is not firmware of a board: build it with `cargo xtask build`")]
    NotFirmware(PathBuf),
    /// The file is not an image.
    #[error("{0} is not a firmware image, or is cut short: make one with `cargo xtask image`")]
    NotAnImage(PathBuf),
    /// The image has this number of bytes, which is more than the flash of an insole has for it.
    #[error("{0} has an image of {1} bytes, but insoles accept at most {MAX_IMAGE} bytes: build smaller firmware")]
    TooLarge(PathBuf, usize),
    /// The trailer cannot be read, or its signature or digest does not match.
    #[error("{0} is damaged: its signature or digest does not match; copy or download it again")]
    Damaged(PathBuf),
    /// The file is not a secret key.
    #[error("{0} is not a key file, which has one line of 64 hex digits; `cargo xtask key` makes one")]
    NotAKey(PathBuf),
}

/// A signed image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    bytes: Vec<u8>,
    header: Header,
    signature: [u8; SIGNATURE_BYTES],
    key: VerifyingKey,
}

impl Image {
    /// Signs an image from [`flash_image`]; `None` if it has no header.
    pub fn sign(bytes: Vec<u8>, key: &SigningKey) -> Option<Self> {
        let header = header(&bytes)?;
        let signature = key.sign(&Sha512::digest(&bytes)).to_bytes();
        Some(Self { bytes, header, signature, key: key.verifying_key() })
    }

    /// Reads a file and verifies its signature.
    ///
    /// # Errors
    /// [`Error::Read`], [`Error::NotAnImage`], [`Error::TooLarge`] and [`Error::Damaged`].
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::parse(&read(path)?, path)
    }

    /// Parses the contents of a file and verifies its signature.
    ///
    /// # Errors
    /// [`Error::NotAnImage`], [`Error::TooLarge`] and [`Error::Damaged`], which name `path`.
    pub fn parse(file: &[u8], path: &Path) -> Result<Self, Error> {
        let not_an_image = || Error::NotAnImage(path.into());
        let (offered, image_bytes) = read_front(file).ok_or_else(not_an_image)?;
        let (rest, end) = file.split_last_chunk::<TRAILER>().ok_or_else(not_an_image)?;
        let bytes = rest.get(FRONT..).filter(|bytes| bytes.len() == image_bytes as usize).ok_or_else(not_an_image)?;
        let header = header(bytes).filter(|header| *header == offered).ok_or_else(not_an_image)?;
        let damaged = || Error::Damaged(path.into());
        let (sha256, signature, key) = read_trailer(end).ok_or_else(damaged)?;
        let key = VerifyingKey::from_bytes(key).map_err(|_| damaged())?;
        key.verify_strict(&Sha512::digest(bytes), &signature.into()).map_err(|_| damaged())?;
        if *sha256 != digest(rest) {
            return Err(damaged());
        }
        if bytes.len() as u64 > u64::from(MAX_IMAGE) {
            return Err(Error::TooLarge(path.into(), bytes.len()));
        }
        Ok(Self { bytes: bytes.into(), header, signature: *signature, key })
    }

    /// The contents of the file of this image.
    pub fn file(&self) -> Vec<u8> {
        let mut file = [&front(&self.header, self.bytes.len() as u32)[..], &self.bytes].concat();
        let sha256 = digest(&file);
        file.extend(trailer(&sha256, &self.signature, self.key.as_bytes()));
        file
    }

    /// The header, which names board and version.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The image: the contents of the board's flash from the application's start on.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The offer that begins an update.
    pub fn offer(&self) -> Offer {
        let (signature, _) = self.signature.as_chunks();
        Offer {
            header: self.header,
            chunks: (self.bytes.len() / CHUNK) as u16,
            signature: [signature[0], signature[1]],
        }
    }

    /// The chunk with this number; zeros if the image has fewer chunks.
    pub fn chunk(&self, number: u16) -> Chunk {
        let mut chunk = Chunk::default();
        let bytes = self.bytes.get(usize::from(number) * CHUNK..).unwrap_or_default();
        for (to, from) in chunk.as_flattened_mut().iter_mut().zip(bytes) {
            *to = *from;
        }
        chunk
    }
}

/// The SHA-256 of a file without its trailer; it identifies the image.
fn digest(file: &[u8]) -> Sha256 {
    sha2::Sha256::digest(file).into()
}

fn read(path: &Path) -> Result<Vec<u8>, Error> {
    std::fs::read(path).map_err(|error| Error::Read(path.into(), error))
}

/// The header of an image. Its texts are printed, so they may only have visible ASCII characters.
fn header(bytes: &[u8]) -> Option<Header> {
    let header = Header::read(bytes.get(HEADER as usize..)?.first_chunk()?)?;
    let is_printable = [header.board(), header.version()].iter().all(|text| text.bytes().all(|b| b.is_ascii_graphic()));
    is_printable.then_some(header)
}

/// The contents of a board's flash from the application's start on, padded to whole chunks, for `firmware`, an ELF file from the
/// linker.
///
/// # Errors
/// [`Error::Read`], [`Error::NotFirmware`] and [`Error::TooLarge`].
pub fn flash_image(firmware: &Path) -> Result<Vec<u8>, Error> {
    let data = read(firmware)?;
    let not_firmware = || Error::NotFirmware(firmware.into());
    let segments = loaded_segments(&data).ok_or_else(not_firmware)?;
    let len = segments.iter().map(|(start, bytes)| start + bytes.len()).fold(0, usize::max);
    let mut image = vec![0xff; len.min(MAX_IMAGE as usize).next_multiple_of(CHUNK)];
    for (start, bytes) in segments {
        let room = image.get_mut(start..).unwrap_or_default();
        room.iter_mut().zip(bytes).for_each(|(to, byte)| *to = *byte);
    }
    header(&image).ok_or_else(not_firmware)?;
    if len > MAX_IMAGE as usize { Err(Error::TooLarge(firmware.into(), len)) } else { Ok(image) }
}

/// The loaded segments of an ELF file, each with its offset in the image; `None` if the file is not valid or has none. The
/// address of the flash depends on the controller, so offsets count from the segment at the lowest address, which begins with the
/// vector table.
fn loaded_segments(elf: &[u8]) -> Option<Vec<(usize, &[u8])>> {
    let file = object::read::elf::ElfFile32::<object::Endianness>::parse(elf).ok()?;
    let mut segments = Vec::new();
    for segment in file.segments() {
        let (data, header) = (segment.data().ok()?, segment.elf_program_header());
        // Segments without data only reserve memory.
        if !data.is_empty() {
            segments.push((header.p_paddr.get(file.endian()) as usize, data));
        }
    }
    let image_start = segments.iter().map(|(address, _)| *address).min()?;
    segments.iter_mut().for_each(|(address, _)| *address -= image_start);
    Some(segments)
}

/// Reads a secret key from its file.
///
/// # Errors
/// [`Error::Read`] and [`Error::NotAKey`].
pub fn read_signing_key(path: &Path) -> Result<SigningKey, Error> {
    let text = std::fs::read_to_string(path).map_err(|error| Error::Read(path.into(), error))?;
    parse_signing_key(&text).ok_or_else(|| Error::NotAKey(path.into()))
}

/// The published key for development; `None` if its file is damaged.
pub fn development_key() -> Option<SigningKey> {
    parse_signing_key(DEVELOPMENT_KEY)
}

fn parse_signing_key(text: &str) -> Option<SigningKey> {
    let digits = text.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#'))?;
    let mut bytes = [0; KEY_BYTES];
    if digits.len() != 2 * bytes.len() || !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        return None;
    }
    for (i, byte) in bytes.iter_mut().enumerate() {
        *byte = u8::from_str_radix(&digits[2 * i..2 * i + 2], 16).ok()?;
    }
    Some(SigningKey::from_bytes(&bytes))
}

/// Bytes as hex digits, the format of a key file and of `PLANTAR_UPDATE_KEY`.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

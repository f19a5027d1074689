//! Firmware images: made from what the linker wrote, signed, and checked before they are sent.
//!
//! A file is the image, padded to whole chunks, its signature, and the public key that it was made with.

use ed25519_dalek::{Digest, Sha512, Signer, VerifyingKey};
use object::{Object, ObjectSegment};
use plantar::protocol::update::{CHUNK, Chunk, Header, Offer};
use plantar::storage::flash_map::{ACTIVE, HEADER, MAX_IMAGE};
use std::path::{Path, PathBuf};
use thiserror::Error;

pub use ed25519_dalek::SigningKey as Secret;

/// The key that everybody knows.
pub const DEVELOPMENT_KEY: &str = include_str!("../development.key");

const SIGNATURE_BYTES: usize = 64;
const KEY_BYTES: usize = 32;

/// Why there is no image or key.
#[derive(Debug, Error)]
pub enum Error {
    /// A file.
    #[error("cannot read {0}: {1}")]
    Read(PathBuf, std::io::Error),
    /// Not what the linker writes for a board.
    #[error("{0} is no firmware of a board: build it with `cargo xtask build`")]
    NoFirmware(PathBuf),
    /// Not a file of this kind.
    #[error("{0} is no firmware image, or is cut short: make one with `cargo xtask image`")]
    NoImage(PathBuf),
    /// The signature is not its own.
    #[error("{0} is damaged, or cut short: its signature does not fit; get it again")]
    Damaged(PathBuf),
    /// The secret key.
    #[error("{0} holds no key: it has one line of 64 hex digits; `cargo xtask key` makes one")]
    NoKey(PathBuf),
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
    /// Signs an image as [`raw`] gives it; `None` where it has no header.
    pub fn sign(bytes: Vec<u8>, secret: &Secret) -> Option<Self> {
        let header = header(&bytes)?;
        let signature = secret.sign(&Sha512::digest(&bytes)).to_bytes();
        Some(Self { bytes, header, signature, key: secret.verifying_key() })
    }

    /// Reads a file and holds it against its signature.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::parse(&read(path)?, path)
    }

    /// Takes the contents of a file apart and holds them against their signature; errors name `path`.
    pub fn parse(file: &[u8], path: &Path) -> Result<Self, Error> {
        let no_image = || Error::NoImage(path.into());
        let (rest, key) = file.split_last_chunk::<KEY_BYTES>().ok_or_else(no_image)?;
        let (bytes, signature) = rest.split_last_chunk::<SIGNATURE_BYTES>().ok_or_else(no_image)?;
        let header = header(bytes).ok_or_else(no_image)?;
        let damaged = |_| Error::Damaged(path.into());
        let key = VerifyingKey::from_bytes(key).map_err(damaged)?;
        key.verify_strict(&Sha512::digest(bytes), &signature.into()).map_err(damaged)?;
        if bytes.len() % CHUNK != 0 || bytes.len() as u64 > u64::from(MAX_IMAGE) {
            return Err(no_image());
        }
        Ok(Self { bytes: bytes.into(), header, signature: *signature, key })
    }

    /// The contents of its file.
    pub fn file(&self) -> Vec<u8> {
        [&self.bytes[..], &self.signature, self.key.as_bytes()].concat()
    }

    /// What it says of itself.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// What runs on the board.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// What an insole is asked.
    pub fn offer(&self) -> Offer {
        let (signature, _) = self.signature.as_chunks();
        Offer {
            header: self.header,
            chunks: (self.bytes.len() / CHUNK) as u16,
            signature: [signature[0], signature[1]],
        }
    }

    /// The piece of this number; zeros beyond the last.
    pub fn chunk(&self, number: u16) -> Chunk {
        let mut chunk = Chunk::default();
        let bytes = self.bytes.get(usize::from(number) * CHUNK..).unwrap_or_default();
        for (to, from) in chunk.as_flattened_mut().iter_mut().zip(bytes) {
            *to = *from;
        }
        chunk
    }
}

fn read(path: &Path) -> Result<Vec<u8>, Error> {
    std::fs::read(path).map_err(|error| Error::Read(path.into(), error))
}

fn header(bytes: &[u8]) -> Option<Header> {
    Header::read(bytes.get(HEADER as usize..)?.first_chunk()?)
}

/// What lies in the flash once this file of the linker is there, padded to whole chunks.
pub fn raw(firmware: &Path) -> Result<Vec<u8>, Error> {
    let data = read(firmware)?;
    flat(&data).filter(|bytes| header(bytes).is_some()).ok_or_else(|| Error::NoFirmware(firmware.into()))
}

fn flat(elf: &[u8]) -> Option<Vec<u8>> {
    let file = object::read::elf::ElfFile32::<object::Endianness>::parse(elf).ok()?;
    let mut bytes = Vec::new();
    for segment in file.segments() {
        let (data, at) = (segment.data().ok()?, segment.elf_program_header());
        let at = at.p_paddr.get(file.endian());
        // What is only reserved has no contents.
        let Some(start) = at.checked_sub(ACTIVE.start).filter(|_| !data.is_empty()) else { continue };
        let (start, end) = (start as usize, start as usize + data.len());
        if end > MAX_IMAGE as usize {
            return None;
        }
        bytes.resize(bytes.len().max(end), 0xff);
        bytes[start..end].copy_from_slice(data);
    }
    bytes.resize(bytes.len().next_multiple_of(CHUNK), 0xff);
    Some(bytes)
}

/// Reads a secret key from its file.
pub fn secret(path: &Path) -> Result<Secret, Error> {
    let text = std::fs::read_to_string(path).map_err(|error| Error::Read(path.into(), error))?;
    parse_secret(&text).ok_or_else(|| Error::NoKey(path.into()))
}

/// The key that everybody knows.
pub fn development() -> Option<Secret> {
    parse_secret(DEVELOPMENT_KEY)
}

fn parse_secret(text: &str) -> Option<Secret> {
    let digits = text.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#'))?;
    let mut bytes = [0; KEY_BYTES];
    if digits.len() != 2 * bytes.len() || !digits.is_ascii() {
        return None;
    }
    for (i, byte) in bytes.iter_mut().enumerate() {
        *byte = u8::from_str_radix(&digits[2 * i..2 * i + 2], 16).ok()?;
    }
    Some(Secret::from_bytes(&bytes))
}

/// A key as `PLANTAR_UPDATE_KEY` takes it.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

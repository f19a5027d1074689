//! The file of a signed image, in the form of MCUboot, which the tools of MCUmgr understand.
//!
//! A file is the header of MCUboot, the insole's own [`Header`], the image, and a trailer of entries with type, length and value:
//! the SHA-256 of everything before the trailer, the ed25519 signature of the image, and the public key of the signature. The
//! SHA-256 names the image; the signature decides whether an insole accepts it.

use super::update::{CHUNK, Header};
pub use mcumgr::Sha256;

/// Length of the part of a file before the image, bytes.
pub const FRONT: usize = MCUBOOT_HEADER + Header::BYTES;
/// Length of the part of a file after the image, bytes.
pub const TRAILER: usize = ENTRY + (ENTRY + 32) + (ENTRY + 64) + (ENTRY + 32);

/// Length of the header of MCUboot, bytes.
const MCUBOOT_HEADER: usize = 32;
/// The first bytes of that header.
const MAGIC: [u8; 4] = 0x96f3_b83d_u32.to_le_bytes();
/// Length of the head of a trailer, and of the head of each entry before its value, bytes.
const ENTRY: usize = 4;
/// The first bytes of a trailer.
const TRAILER_MAGIC: [u8; 2] = 0x6907_u16.to_le_bytes();
/// Types of entries. Those from 0xa0 on are free for vendors.
const SHA256: u8 = 0x10;
const SIGNATURE: u8 = 0xa0;
const PUBLIC_KEY: u8 = 0xa1;

/// The part of a file before an image with this header and length.
pub fn front(header: &Header, image_bytes: u32) -> [u8; FRONT] {
    let [major, minor, revision] = header.number().unwrap_or_default();
    let [major, minor] = [major, minor].map(|number| u8::try_from(number).unwrap_or(u8::MAX));
    let mut front = [0; FRONT];
    // The offsets are those of `struct image_header` in MCUboot: magic, header size, image size, and version.
    let (mcuboot, own) = front.split_at_mut(MCUBOOT_HEADER);
    mcuboot[..4].copy_from_slice(&MAGIC);
    mcuboot[8..10].copy_from_slice(&(FRONT as u16).to_le_bytes());
    mcuboot[12..16].copy_from_slice(&image_bytes.to_le_bytes());
    mcuboot[20..22].copy_from_slice(&[major, minor]);
    mcuboot[22..24].copy_from_slice(&revision.to_le_bytes());
    own.copy_from_slice(&header.bytes());
    front
}

/// The header and the length of the image, bytes, from the first bytes of a file; `None` if `file` does not begin with a result
/// of [`front`] for an image of whole chunks.
pub fn read_front(file: &[u8]) -> Option<(Header, u32)> {
    let bytes: &[u8; FRONT] = file.first_chunk()?;
    let header = Header::read(bytes.last_chunk()?)?;
    let image_bytes = u32::from_le_bytes(*bytes[12..16].first_chunk()?);
    (*bytes == front(&header, image_bytes) && image_bytes.is_multiple_of(CHUNK as u32)).then_some((header, image_bytes))
}

/// The entries of a trailer: the type of each, and the length of its value, bytes.
const ENTRIES: [(u8, usize); 3] = [(SHA256, 32), (SIGNATURE, 64), (PUBLIC_KEY, 32)];

/// The trailer with these values.
pub fn trailer(sha256: &Sha256, signature: &[u8; 64], key: &[u8; 32]) -> [u8; TRAILER] {
    let mut trailer = [0; TRAILER];
    trailer[..2].copy_from_slice(&TRAILER_MAGIC);
    trailer[2..ENTRY].copy_from_slice(&(TRAILER as u16).to_le_bytes());
    let mut start = ENTRY;
    for ((entry_type, len), value) in ENTRIES.into_iter().zip([&sha256[..], signature, key]) {
        trailer[start] = entry_type;
        trailer[start + 2] = len as u8;
        trailer[start + ENTRY..start + ENTRY + len].copy_from_slice(value);
        start += ENTRY + len;
    }
    trailer
}

/// The SHA-256, the signature and the public key in a trailer; `None` if `bytes` are not a trailer.
pub fn read_trailer(bytes: &[u8]) -> Option<(&Sha256, &[u8; 64], &[u8; 32])> {
    let bytes: &[u8; TRAILER] = bytes.try_into().ok()?;
    let sha256 = bytes[2 * ENTRY..].first_chunk()?;
    let signature = bytes[3 * ENTRY + 32..].first_chunk()?;
    let key = bytes.last_chunk()?;
    (*bytes == trailer(sha256, signature, key)).then_some((sha256, signature, key))
}

//! The CRC-32 of frames on a byte carrier, of whole areas of the flash chip, and of the previous image in that chip. Identifiers
//! that are derived from content (parameters, settings, calibration) are such CRCs, too. The CRC of a single stored item is that
//! of `sequential-storage`.

use crc::{CRC_32_ISO_HDLC, Crc};

/// The algorithm, for a CRC that is computed over several pieces of data.
pub(crate) const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// CRC-32 (ISO-HDLC, as in Ethernet and zlib) of `bytes`.
pub fn crc32(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes)
}

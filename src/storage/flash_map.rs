//! Addresses in flash, for bootloaders, application, build scripts and host programs.

use core::ops::Range;

/// Size of a sector, bytes: the flash chip erases whole sectors of this size, and so does the controllers' own flash.
pub const SECTOR: u32 = 4096;

/// Address of the controller's own flash in an STM32.
pub const STM32_FLASH: u32 = 0x0800_0000;
/// Address of the controller's own flash in an nRF52.
pub const NRF52_FLASH: u32 = 0;
/// The bootloader, as offsets in the controller's own flash.
pub const BOOTLOADER: Range<u32> = 0..8 * SECTOR;
/// The running application, as offsets in the controller's own flash. Only the bootloader writes it.
pub const ACTIVE: Range<u32> = BOOTLOADER.end..BOOTLOADER.end + 96 * SECTOR;
/// Longest image, bytes.
pub const MAX_IMAGE: u32 = ACTIVE.end - ACTIVE.start;

/// Size of the smallest flash chip that the map fits into, bytes.
pub const SMALLEST_CHIP: u32 = 2 << 20;
/// Size of the largest flash chip of which all bytes are used: its addresses have three bytes.
pub const LARGEST_CHIP: u32 = 16 << 20;
/// The settings records (parameters, identity, calibration and others), in the flash chip.
pub const RECORDS: Range<u32> = 0..16 * SECTOR;
/// The step log, in a flash chip of up to 4 MiB: at least 2,000 steps, because each of its 256 sectors has room for 8 steps of
/// the longest form.
pub const SMALL_LOG: Range<u32> = RECORDS.end..RECORDS.end + 256 * SECTOR;
/// Size of the largest flash chip with [`SMALL_LOG`], bytes. Version 0.2 used that log in larger chips, too.
const SMALL_LOG_CHIP: u32 = 4 << 20;
/// Beginning of the step log in a larger flash chip, in which the log occupies the rest: at least 27,000 steps in 16 MiB. The
/// emulated board has its running image between [`OTHER`] and this address.
const LARGE_LOG_START: u32 = 0x28_0000;
/// The state of the bootloader, in the flash chip.
pub const STATE: Range<u32> = 0x12_0000..0x12_0000 + SECTOR;
/// The note about the previous image ([`super::previous`]), in the flash chip.
pub const PREVIOUS: Range<u32> = STATE.end..STATE.end + SECTOR;
/// The image that is being received, or after a swap the previous image, in the flash chip. The bootloader swaps it with
/// [`ACTIVE`], for which it needs one more sector.
pub const OTHER: Range<u32> = 0x14_0000..0x14_0000 + MAX_IMAGE + SECTOR;

/// Offset of the [`crate::protocol::update::Header`] in an image: after the longest vector table of the supported controllers.
pub const HEADER: u32 = 0x200;
/// Size that is reserved for the header, bytes.
pub const HEADER_BYTES: u32 = 64;

const _: () = assert!(SMALL_LOG.end <= STATE.start && PREVIOUS.end <= OTHER.start);
const _: () = assert!(OTHER.end <= SMALLEST_CHIP && OTHER.end <= LARGE_LOG_START);

/// The step log in a flash chip with this number of bytes, at least [`SMALLEST_CHIP`].
pub const fn log(chip_bytes: usize) -> Range<u32> {
    if chip_bytes <= SMALL_LOG_CHIP as usize {
        return SMALL_LOG;
    }
    let end = if chip_bytes < LARGEST_CHIP as usize { chip_bytes as u32 / SECTOR * SECTOR } else { LARGEST_CHIP };
    LARGE_LOG_START..end
}

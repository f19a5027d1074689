//! Addresses in flash, for bootloaders, application, build scripts and host programs.

use core::ops::Range;

/// Size of a sector, bytes: the flash chip erases whole sectors, and so does the own flash of the controllers.
pub const SECTOR: u32 = 4096;

/// Address of the own flash of an STM32.
pub const STM32_FLASH: u32 = 0x0800_0000;
/// Address of the own flash of an nRF52.
pub const NRF52_FLASH: u32 = 0;
/// The bootloader, as offsets in the controller's own flash.
pub const BOOTLOADER: Range<u32> = 0..8 * SECTOR;
/// The running application, as offsets in the controller's own flash. Only the bootloader writes it.
pub const ACTIVE: Range<u32> = BOOTLOADER.end..BOOTLOADER.end + 96 * SECTOR;
/// Longest image, bytes.
pub const MAX_IMAGE: u32 = ACTIVE.end - ACTIVE.start;

/// Size of the flash chip, a W25Q32, bytes.
pub const CHIP_BYTES: u32 = 4 << 20;
/// Records, in the flash chip.
pub const RECORDS: Range<u32> = 0..16 * SECTOR;
/// The step log, in the flash chip: about 3,000 usual steps, and at least 2,000 of the longest form, 8 in each sector.
pub const LOG: Range<u32> = RECORDS.end..RECORDS.end + 256 * SECTOR;
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

const _: () = assert!(LOG.end <= STATE.start && PREVIOUS.end <= OTHER.start && OTHER.end <= CHIP_BYTES);

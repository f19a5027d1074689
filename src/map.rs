//! Where everything lies in flash: what build script, bootloaders, application and host agree on.

use core::ops::Range;

/// What the flash chip erases at once, and the STM32WB55's own flash too, bytes.
pub const SECTOR: u32 = 4096;

/// The bootloader, in the controller's own flash.
pub const BOOTLOADER: Range<u32> = 0x0800_0000..0x0800_8000;
/// The application that runs, in the controller's own flash. Only the bootloader writes it.
pub const ACTIVE: Range<u32> = BOOTLOADER.end..BOOTLOADER.end + 96 * SECTOR;
/// Longest image, bytes.
pub const MAX_IMAGE: u32 = ACTIVE.end - ACTIVE.start;

/// Size of the flash chip, a W25Q32, bytes.
pub const CHIP_BYTES: u32 = 4 << 20;
/// How far the bootloader is, in the flash chip; what comes before is the store's.
pub const STATE: Range<u32> = 0x12_0000..0x12_0000 + SECTOR;
/// The image that arrives, later the one before, in the flash chip: the bootloader swaps it with [`ACTIVE`] by way of one more
/// sector.
pub const OTHER: Range<u32> = 0x14_0000..0x14_0000 + MAX_IMAGE + SECTOR;
/// Stands for [`ACTIVE`] in the emulated board's chip: its controller's flash cannot be written.
pub const EMULATED_ACTIVE: Range<u32> = 0x20_0000..0x20_0000 + MAX_IMAGE;

/// Where an image has its [`crate::update::Header`], from its beginning: after the longest table of vectors.
pub const HEADER: u32 = 0x200;
/// Room for the header, bytes.
pub const HEADER_BYTES: u32 = 64;

//! Computes flash and RAM of firmware from the sections of its ELF file.

use anyhow::{Context, Result};
use object::{Object, ObjectSection, SectionFlags, SectionKind, elf};
use std::path::Path;

/// The memory that firmware needs.
pub struct Size {
    /// Code, constants and the initial values of variables, bytes.
    pub flash_bytes: u64,
    /// Variables without the stack, bytes.
    pub ram_bytes: u64,
}

/// Adds up the sections that occupy flash or RAM. Initialised variables occupy both.
pub fn of(firmware: &Path) -> Result<Size> {
    let data = std::fs::read(firmware).with_context(|| format!("cannot read {}", firmware.display()))?;
    let file = object::File::parse(&*data).with_context(|| format!("{} is not an ELF file", firmware.display()))?;
    let mut size = Size { flash_bytes: 0, ram_bytes: 0 };
    for section in file.sections() {
        let SectionFlags::Elf { sh_flags } = section.flags() else { continue };
        if sh_flags & u64::from(elf::SHF_ALLOC) == 0 {
            continue;
        }
        let is_reserved = section.kind() == SectionKind::UninitializedData || section.file_range().is_none();
        if !is_reserved {
            size.flash_bytes += section.size();
        }
        if is_reserved || sh_flags & u64::from(elf::SHF_WRITE) != 0 {
            size.ram_bytes += section.size();
        }
    }
    Ok(size)
}

//! Flash and RAM of a firmware file, from its sections.

use anyhow::{Context, Result};
use object::{Object, ObjectSection, SectionFlags, SectionKind, elf};
use std::path::Path;

/// What a binary takes.
pub struct Size {
    /// Code, constants and the initial values of variables.
    pub flash_bytes: u64,
    /// Variables, without stack.
    pub ram_bytes: u64,
}

/// Sums up the sections that are loaded or reserved.
pub fn of(firmware: &Path) -> Result<Size> {
    let data = std::fs::read(firmware).with_context(|| format!("cannot read {}", firmware.display()))?;
    let file = object::File::parse(&*data).with_context(|| format!("{} is no ELF file", firmware.display()))?;
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

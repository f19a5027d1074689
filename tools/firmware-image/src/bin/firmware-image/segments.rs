//! Extracts the loaded segments of a firmware file, without symbols and debug information.

use anyhow::{Context, Result};
use object::{Object, ObjectSegment};
use std::path::Path;

/// Writes the loaded segments of an ELF file: for each its address and its length in bytes, both as little-endian 64-bit numbers,
/// and its data.
pub fn write(firmware: &Path, out: &Path) -> Result<()> {
    let data = std::fs::read(firmware).with_context(|| format!("cannot read {}", firmware.display()))?;
    let file = object::File::parse(&*data).with_context(|| format!("{} is not an ELF file", firmware.display()))?;
    let mut bytes = Vec::new();
    for segment in file.segments() {
        let data = segment.data().with_context(|| format!("{} is cut short: build it again", firmware.display()))?;
        bytes.extend(segment.address().to_le_bytes());
        bytes.extend((data.len() as u64).to_le_bytes());
        bytes.extend(data);
    }
    std::fs::write(out, bytes).with_context(|| format!("cannot write {}", out.display()))
}

//! The configuration of the emulated board, from the set-up file on the host.

use super::{EmulatorConfig, SETUP_FILE, read_setup};
use plantar::pipeline::setup::SetupCell;
use semihosting::fs::File;
use semihosting::io::{Read, Seek, SeekFrom};

/// Reads the configuration and the cells; `None` if the file is absent or has an item that cannot be decoded.
pub fn configuration() -> Option<(EmulatorConfig, impl Iterator<Item = SetupCell> + Clone)> {
    read_setup(|offset, bytes| {
        let mut file = File::open(SETUP_FILE).ok()?;
        file.seek(SeekFrom::Start(offset as u64)).ok()?;
        file.read(bytes).ok()
    })
}

//! Files for the data of an insole.

use std::fs::File;
use std::io;
use std::path::Path;

/// Opens a file for the data of an insole. Existing data are never overwritten, because an insole deletes steps that a host has
/// acknowledged.
///
/// # Errors
/// If the file cannot be opened for writing, or is not empty.
pub fn create_new(path: &Path) -> io::Result<File> {
    let file = File::options().write(true).create(true).truncate(false).open(path)?;
    match file.metadata()?.len() {
        0 => Ok(file),
        _ => Err(io::Error::new(io::ErrorKind::AlreadyExists, "it is not empty: name a new file")),
    }
}

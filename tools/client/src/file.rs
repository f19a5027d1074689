//! Files for the data of an insole.

use std::fs::File;
use std::io;
use std::path::Path;

/// Creates a file for the data of an insole, or opens an empty one. Existing data are never overwritten, because an insole
/// deletes steps that a host has acknowledged.
///
/// # Errors
/// If the file cannot be opened for writing, or is not empty.
pub fn create_or_open_empty(path: &Path) -> io::Result<File> {
    let file = File::options().write(true).create(true).truncate(false).open(path)?;
    match file.metadata()?.len() {
        0 => Ok(file),
        _ => Err(io::Error::new(io::ErrorKind::AlreadyExists, "the file is not empty: choose another name")),
    }
}

//! Writes files and folders under a temporary name, and renames them when they are complete.

use crate::{Error, Result};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Writes a file. If this fails, an existing file with this name is unchanged.
///
/// # Errors
/// Fails if `write` fails, or the file cannot be created, stored or renamed.
pub fn file(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<()> {
    at(path, |incomplete| {
        let mut to = BufWriter::new(File::create(incomplete)?);
        write(&mut to)?;
        to.flush()?;
        // Some file systems report a full disk only here.
        to.get_ref().sync_all()
    })
}

/// Writes a file or a folder: `write` receives a temporary path, which is then renamed to `path`. After a failure, the
/// temporary file or folder is removed. A file with the temporary name, which an interrupted program may have left, is replaced.
///
/// # Errors
/// Fails if `write` fails, the temporary file or folder cannot be renamed, or a folder with the temporary name exists.
pub fn at(path: &Path, write: impl FnOnce(&Path) -> io::Result<()>) -> Result<()> {
    let mut name = OsString::from(path);
    name.push(".incomplete");
    let incomplete = PathBuf::from(name);
    // The folder may contain anything, so it is not removed, also not after a failure.
    if incomplete.is_dir() {
        return Err(Error::content(
            incomplete.display().to_string(),
            "the folder exists, but its name is that of unfinished output",
            "rename it, or remove it if an interrupted program left it",
        ));
    }
    if incomplete.is_file() {
        fs::remove_file(&incomplete).map_err(|reason| Error::Io { file: incomplete.clone(), reason })?;
    }
    let written = write(&incomplete).and_then(|()| fs::rename(&incomplete, path));
    written.map_err(|reason| {
        // If nothing was written, there is nothing to remove.
        let _ = fs::remove_file(&incomplete).or_else(|_| fs::remove_dir_all(&incomplete));
        Error::Io { file: path.into(), reason }
    })
}

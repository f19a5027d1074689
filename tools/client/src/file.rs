//! Files for the data of an insole.

use std::fs::{File, TryLockError};
use std::io::{self, ErrorKind};
use std::path::Path;

/// Creates a file for the data of an insole, or opens an empty one. Existing data are never overwritten, because an insole
/// deletes steps that a host has acknowledged. The file is reserved for this program until it is closed.
///
/// # Errors
/// If the file cannot be opened for writing, is not empty, or is reserved by another program.
pub fn create_or_open_empty(path: &Path) -> io::Result<File> {
    let file = File::options().write(true).create(true).truncate(false).open(path)?;
    // Several programs can write to a device or a pipe. On Windows, the lock would prevent others from reading the file.
    if cfg!(unix) && file.metadata()?.is_file() {
        reserve(&file).map_err(|problem| io::Error::new(problem.kind(), format!("{problem}: choose another name")))?;
    }
    // The length is read only now, because the program that reserved the file before may have written to it.
    match file.metadata()?.len() {
        0 => Ok(file),
        _ => Err(io::Error::new(ErrorKind::AlreadyExists, "the file is not empty: choose another name")),
    }
}

/// Reserves a file for this program until it is closed, also by the end of the program. File systems without locks reserve
/// nothing: this must not prevent a recording.
///
/// # Errors
/// If another program has reserved the file.
pub fn reserve(file: &File) -> io::Result<()> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => {
            Err(io::Error::new(ErrorKind::ResourceBusy, "another program records into it"))
        }
        Ok(()) | Err(TryLockError::Error(_)) => Ok(()),
    }
}

/// Synchronises the contents of a file with the disk.
///
/// # Errors
/// If the contents cannot be stored. Devices such as /dev/null and some network shares do not support the request, which is no
/// error. Neither does a pipe; this is an error, because nobody knows whether its reader stores the contents.
pub fn sync_data(file: &File) -> io::Result<()> {
    /// The number of the error with which macOS refuses the request for an SMB share (ENOTSUP), and for which the standard
    /// library has no kind.
    const MACOS_NOT_SUPPORTED: i32 = 45;
    match file.sync_data() {
        Err(error) if is_pipe(file) => Err(error),
        Err(error) if matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => Ok(()),
        Err(error) if cfg!(target_os = "macos") && error.raw_os_error() == Some(MACOS_NOT_SUPPORTED) => Ok(()),
        synchronised => synchronised,
    }
}

#[cfg(unix)]
fn is_pipe(file: &File) -> bool {
    use std::os::unix::fs::FileTypeExt;
    file.metadata().is_ok_and(|metadata| metadata.file_type().is_fifo())
}

#[cfg(not(unix))]
fn is_pipe(_: &File) -> bool {
    false
}

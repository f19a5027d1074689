//! Writes files and folders under a temporary name, and renames them when they are complete.

use crate::{Error, Result};
use plantar::Side;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{self, Path, PathBuf};

/// Largest number of symbolic links that are followed, each of which leads to the next one, as on Linux.
const MAX_LINKS: usize = 40;

/// Writes a file. If this fails, an existing file with this name is unchanged. A device or a pipe is written directly.
///
/// # Errors
/// Fails if `path` ends with a separator, `write` fails, or the file cannot be created, stored or renamed.
pub fn file(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<()> {
    check_file_name(path)?;
    at(path, |incomplete| {
        let mut to = BufWriter::new(File::create(incomplete)?);
        write(&mut to)?;
        to.flush()?;
        sync(to.get_ref())
    })
}

/// Synchronises a file or folder with the disk, because some file systems report a full disk only then.
///
/// # Errors
/// Fails if the file cannot be stored. Devices, pipes, some network shares and folders do not support the request, which is no
/// error.
pub fn sync(file: &File) -> io::Result<()> {
    /// The number of the error with which macOS refuses the request for an SMB share (ENOTSUP), and for which the standard
    /// library has no kind.
    const MACOS_NOT_SUPPORTED: i32 = 45;
    match file.sync_all() {
        Err(error) if matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => Ok(()),
        Err(error) if cfg!(target_os = "macos") && error.raw_os_error() == Some(MACOS_NOT_SUPPORTED) => Ok(()),
        synchronised => synchronised,
    }
}

/// True if the path ends with a separator, so that it can only name a folder.
pub fn ends_with_separator(path: &Path) -> bool {
    path.as_os_str().as_encoded_bytes().last().is_some_and(|&byte| path::is_separator(byte.into()))
}

/// Checks that a path can name a file.
///
/// # Errors
/// Fails if the path ends with a separator.
pub fn check_file_name(path: &Path) -> Result<()> {
    if ends_with_separator(path) {
        let problem = "a name with a separator at its end is that of a folder";
        return Err(Error::content(path.display().to_string(), problem, "name a file"));
    }
    Ok(())
}

/// The file of one foot of a pair that is named `path`: `NAME.left.parquet` or `NAME.right.parquet` for `NAME.parquet` or `NAME`.
pub fn of_foot(path: &Path, side: Side) -> PathBuf {
    // A name such as `trial-1.1` has no ending to replace.
    let stem = match path.extension() {
        Some(ending) if ending == "parquet" => path.with_extension(""),
        _ => path.to_owned(),
    };
    let mut path = stem.into_os_string();
    path.push(format!(".{}.parquet", side.name()));
    path.into()
}

/// The path of the file or folder that output to `path` replaces, and the temporary path of the output. If `path` is a symbolic
/// link, its target is replaced, and not the link itself. A device or a pipe cannot be replaced: both paths are then `path`.
pub fn paths(path: &Path) -> (PathBuf, PathBuf) {
    if fs::metadata(path).is_ok_and(|existing| !existing.is_file() && !existing.is_dir()) {
        return (path.into(), path.into());
    }
    let target = fs::canonicalize(path).unwrap_or_else(|_| absent(path));
    let mut incomplete = OsString::from(&target);
    incomplete.push(".incomplete");
    (target, incomplete.into())
}

/// The path of a file or folder that does not exist yet. If `path` is a symbolic link, this is its target.
fn absent(path: &Path) -> PathBuf {
    // With a separator at the end of the path, the temporary name would be that of a file in the absent folder. Collecting the
    // components omits it.
    let mut target: PathBuf = path.components().collect();
    for _ in 0..MAX_LINKS {
        let Ok(next) = fs::read_link(&target) else { break };
        // The target of a link is relative to the folder of the link.
        target = target.parent().unwrap_or(Path::new("")).join(next).components().collect();
    }
    target
}

/// Writes a file or a folder: `write` receives a temporary path, which is then renamed to `path`. After a failure, the
/// temporary file or folder is removed. A file with the temporary name, which an interrupted program may have left, is replaced.
/// If `path` is a device or a pipe, `write` receives `path` itself.
///
/// # Errors
/// Fails if `write` fails, the temporary file or folder cannot be renamed, or a folder with the temporary name exists.
pub fn at(path: &Path, write: impl FnOnce(&Path) -> io::Result<()>) -> Result<()> {
    let (target, incomplete) = paths(path);
    if incomplete == target {
        return write(path).map_err(Error::io(path));
    }
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
    let written = write(&incomplete).and_then(|()| fs::rename(&incomplete, &target));
    written.map_err(|reason| {
        // If nothing was written, there is nothing to remove.
        let _ = fs::remove_file(&incomplete).or_else(|_| fs::remove_dir_all(&incomplete));
        Error::Io { file: path.into(), reason }
    })
}

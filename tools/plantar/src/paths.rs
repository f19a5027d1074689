//! Prevents a command from overwriting its inputs, or one of its outputs with another.

use anyhow::{Result, ensure};
use recording::is_parquet;
use std::path::{Path, PathBuf};

/// The folder of a file, in a form that is the same for all paths that lead to this folder; `None` if it does not exist.
fn folder_of(path: &Path) -> Option<PathBuf> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    folder.canonicalize().ok()
}

/// The path of a file in a form that does not depend on how the file is named: by a relative or an absolute path, or by a link.
pub fn resolved(path: &Path) -> PathBuf {
    // A file that does not exist yet cannot be resolved, but its folder can.
    let in_folder = || Some(folder_of(path)?.join(path.file_name()?));
    path.canonicalize().ok().or_else(in_folder).unwrap_or_else(|| path.into())
}

/// True if a file at `path` would replace a Parquet file in one of the folders `read`, or be read together with those there.
fn is_part(path: &Path, read: &[PathBuf]) -> bool {
    let Some(folder) = folder_of(path).filter(|_| is_parquet(path)) else { return false };
    let mut entries = folder.read_dir().into_iter().flatten().flatten();
    read.contains(&folder) && entries.any(|entry| is_parquet(&entry.path()))
}

/// Checks that the folders of these files exist. Otherwise the command would fail after all its work.
///
/// # Errors
/// If a folder does not exist. The message names the file.
pub fn check_folders(written: &[Option<&Path>]) -> Result<()> {
    for path in written.iter().flatten() {
        ensure!(
            folder_of(path).is_some(),
            "cannot write {}: its folder does not exist: check the path, or create the folder",
            path.display()
        );
    }
    Ok(())
}

/// Checks that none of the files in `written` is also one of those in `read`, or is named twice. If `read` contains a folder,
/// such as a recording in parts, none of the files may be among the Parquet files in it.
///
/// # Errors
/// If a file in `written` is also in `read` or in such a folder, or is named twice. The message names the file, and asks for
/// another name.
pub fn check_written(read: &[PathBuf], written: &[Option<&Path>]) -> Result<()> {
    let read: Vec<_> = read.iter().map(|path| resolved(path)).collect();
    let mut files = read.clone();
    for path in written.iter().flatten() {
        let file = resolved(path);
        // If the path is a link, both the link and its target may be among the Parquet files.
        ensure!(
            !files.contains(&file) && !is_part(path, &read) && !is_part(&file, &read),
            "{} would be written twice, is an input of this command, or is among the Parquet files of an input: name another \
             file",
            path.display()
        );
        files.push(file);
    }
    Ok(())
}

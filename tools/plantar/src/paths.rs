//! Prevents a command from overwriting its inputs, or one of its outputs with another.

use anyhow::{Result, ensure};
use std::path::{Path, PathBuf};

/// The path of a file in a form that is the same for all paths that lead to this file, such as relative paths and links.
fn resolved(path: &Path) -> PathBuf {
    // A file that does not exist yet cannot be resolved, but its folder can.
    let in_folder = || {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Some(folder.canonicalize().ok()?.join(path.file_name()?))
    };
    path.canonicalize().ok().or_else(in_folder).unwrap_or_else(|| path.into())
}

/// Checks that none of the files in `written` is also one of those in `read`, or is named twice.
///
/// # Errors
/// If a file in `written` is also in `read`, or is named twice. The message names the file, and asks for another name.
pub fn check_written(read: &[PathBuf], written: &[Option<&Path>]) -> Result<()> {
    let mut files: Vec<_> = read.iter().map(|path| resolved(path)).collect();
    for path in written.iter().flatten() {
        let file = resolved(path);
        ensure!(
            !files.contains(&file),
            "{} would be written twice, or is an input of this command: name another file",
            path.display()
        );
        files.push(file);
    }
    Ok(())
}

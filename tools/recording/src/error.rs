use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// The result of reading, writing or converting a recording.
pub type Result<T> = std::result::Result<T, Error>;

/// The reason why a recording could not be read, written or converted. Every message names the file or the operation, and a
/// remedy.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused to open, read or write a file.
    #[error("{}: {reason}; check {}", file.display(), to_check(reason.kind()))]
    Io {
        /// The file.
        file: PathBuf,
        /// The operating system's reason.
        reason: std::io::Error,
    },
    /// The content of a file or a recording violates a rule.
    #[error("{place}: {problem}; {remedy}")]
    Content {
        /// The file, with the line, row or column if it is known; the operation, such as resampling, if there is no file.
        place: String,
        /// The violation of a rule.
        problem: String,
        /// An action that resolves the problem.
        remedy: String,
    },
}

impl Error {
    pub(crate) fn content(place: impl Into<String>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        // The problem may quote a file that comes from anywhere. Control characters would have an effect on the terminal on which
        // the message is printed.
        let problem = problem.into().replace(|c: char| c.is_control() && c != '\n', " ");
        Error::Content { place: place.into(), problem, remedy: remedy.into() }
    }

    /// Returns a conversion that adds the name of `file` to an I/O error.
    pub(crate) fn io(file: &Path) -> impl FnOnce(std::io::Error) -> Self {
        move |reason| Error::Io { file: file.to_owned(), reason }
    }
}

/// What the user should check after an I/O error of this kind.
fn to_check(kind: std::io::ErrorKind) -> &'static str {
    match kind {
        std::io::ErrorKind::NotFound => "the path",
        std::io::ErrorKind::PermissionDenied => "the path and its permissions",
        _ => "the path, its permissions and the free disk space",
    }
}

/// Calls `read`. The libraries for Parquet and HDF5 panic on some damaged files; such a panic becomes an error with this remedy.
pub(crate) fn caught<T>(file: &str, remedy: &str, read: impl FnOnce() -> Result<T>) -> Result<T> {
    // After a panic, no value that `read` may have left inconsistent is used.
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| Err(Error::content(file, "the file is damaged", remedy)))
}

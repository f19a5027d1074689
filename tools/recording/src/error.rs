use std::path::{Path, PathBuf};

/// The result of reading, writing or converting a recording.
pub type Result<T> = std::result::Result<T, Error>;

/// Why a recording could not be read, written or converted. Every message says where and what to do.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused to open, read or write the file.
    #[error("{}: {reason}; check the path, its permissions and the room on the disk", file.display())]
    Io { file: PathBuf, reason: std::io::Error },
    /// The content breaks a rule. `place` names the file and, where there is one, the line, row or column.
    #[error("{place}: {problem}; {remedy}")]
    Content { place: String, problem: String, remedy: String },
}

impl Error {
    pub(crate) fn content(place: impl Into<String>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Error::Content { place: place.into(), problem: problem.into(), remedy: remedy.into() }
    }

    /// Turns an I/O error into one that names `file`.
    pub(crate) fn io(file: &Path) -> impl FnOnce(std::io::Error) -> Self {
        move |reason| Error::Io { file: file.to_owned(), reason }
    }
}

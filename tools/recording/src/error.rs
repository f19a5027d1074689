use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Once;
use std::thread;

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

thread_local! {
    /// True while this thread is in [`caught`].
    static IN_CAUGHT: Cell<bool> = const { Cell::new(false) };
}

/// Calls `read`. The libraries for Parquet and HDF5 panic on some damaged files; such a panic becomes an error with this remedy,
/// and is not reported in any other way. `read` must not wait for tasks of a thread pool, because this thread may then execute
/// other tasks, and panics in these must be reported.
pub(crate) fn caught<T>(file: &str, remedy: &str, read: impl FnOnce() -> Result<T>) -> Result<T> {
    silence_caught_panics();
    let outer = IN_CAUGHT.replace(true);
    // After a panic, no value that `read` may have left inconsistent is used.
    let result = catch_unwind(AssertUnwindSafe(read));
    IN_CAUGHT.set(outer);
    result.unwrap_or_else(|_| Err(Error::content(file, "the file is damaged", remedy)))
}

/// Extends the panic hook of the program, so that it is not called for panics in [`caught`]. The default hook would print them
/// before the error.
fn silence_caught_panics() {
    static EXTENDED: Once = Once::new();
    // While this thread panics, as in a destructor, the hook cannot be replaced.
    if thread::panicking() {
        return;
    }
    EXTENDED.call_once(|| {
        let hook = panic::take_hook();
        panic::set_hook(Box::new(move |panic| {
            if !IN_CAUGHT.get() {
                hook(panic);
            }
        }));
    });
}

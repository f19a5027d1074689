//! Lets only one program of a session of a user use an insole at a time. Programs of other users are not excluded, nor are those
//! that the system starts without a session, such as by cron. If the lock file cannot be created or locked, no program is
//! excluded.
//!
//! The system's Bluetooth service shares a connection between all programs: a second program would receive the insole's messages
//! to the first one, and would end the connection of both when it disconnects.

use std::fs::{File, TryLockError};
use std::path::PathBuf;

/// Another program has reserved the insole.
pub(super) struct InUse;

/// Reserves the insole with this identifier until the returned file is dropped. `None` if the lock file cannot be created or
/// locked: this must not prevent a connection.
///
/// # Errors
/// If another program has reserved the insole.
pub(super) fn reserve(id: &str) -> Result<Option<File>, InUse> {
    // The file is not truncated: other users can predict its path, and place a link to another file of this user there.
    let opened = File::options().write(true).create(true).truncate(false).open(lock_file(id));
    let Ok(file) = opened else { return Ok(None) };
    match file.try_lock() {
        Ok(()) => Ok(Some(file)),
        Err(TryLockError::WouldBlock) => Err(InUse),
        Err(TryLockError::Error(_)) => Ok(None),
    }
}

/// The path of the lock file of the insole with this identifier.
fn lock_file(id: &str) -> PathBuf {
    let name: String = id.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    // On Linux, the folder for temporary files is that of all users, and a file of another user cannot be opened.
    let of_user = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from).filter(|folder| folder.is_dir());
    of_user.unwrap_or_else(std::env::temp_dir).join(format!("plantar-{name}.lock"))
}

#[cfg(test)]
mod tests {
    use super::{InUse, lock_file, reserve};

    #[test]
    fn an_insole_is_reserved_once_and_the_content_of_the_lock_file_remains() {
        let id = format!("test:{}", std::process::id());
        std::fs::write(lock_file(&id), "of the user").expect("written");
        let reserved = reserve(&id);
        assert!(matches!(reserved, Ok(Some(_))) && matches!(reserve(&id), Err(InUse)));
        drop(reserved);
        assert!(matches!(reserve(&id), Ok(Some(_))));
        assert_eq!(std::fs::read_to_string(lock_file(&id)).expect("a file"), "of the user");
        std::fs::remove_file(lock_file(&id)).expect("removed");
    }
}

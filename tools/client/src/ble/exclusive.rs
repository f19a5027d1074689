//! Ensures that only one program of this computer uses an insole at a time.
//!
//! The system's Bluetooth service shares a connection between all programs: a second one would receive the messages of the first
//! one, and end the connection of both when it ends.

use std::fs::{File, TryLockError};

/// Another program of this computer uses the insole.
pub(super) struct InUse;

/// Reserves the insole with this identifier until the returned file is dropped. `None` if the lock file cannot be created or
/// locked: this must not prevent a connection.
///
/// # Errors
/// If another program has reserved the insole.
pub(super) fn reserve(id: &str) -> Result<Option<File>, InUse> {
    let name: String = id.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    let Ok(file) = File::create(std::env::temp_dir().join(format!("plantar-{name}.lock"))) else { return Ok(None) };
    match file.try_lock() {
        Ok(()) => Ok(Some(file)),
        Err(TryLockError::WouldBlock) => Err(InUse),
        Err(TryLockError::Error(_)) => Ok(None),
    }
}

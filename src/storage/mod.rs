//! Persistent data in a NOR flash chip: records that are replaced, a log of the steps, load bouts and alerts that no host has
//! acknowledged, and firmware images.
//!
//! Records and log use the package `sequential-storage`, which spreads the wear, protects every item by a CRC-32 and recovers
//! from a loss of power during any write: an item is stored completely or not at all. Every record and every entry of the log
//! contains the version of its format. `docs/storage.md` has the map of the chip, its wear, and the rules for the stored data.

pub mod boot;
pub mod flash_map;
mod guard;
mod log;
mod migration;
pub mod partition;
pub mod previous;
mod records;
mod store;
pub mod supplied;
pub mod update;
pub mod upload;

pub use records::{
    Bonds, BootCounters, CalibrationRecord, CellsRecord, IdentifiedRecord, IdentityRecord, MAX_BONDS_BYTES,
    RadioRecord, Record, SettingsRecord,
};
pub use store::Store;

use sequential_storage::Error;

/// Why something could not be stored or read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StorageError {
    /// The chip did not execute an operation, there is no chip, or the store does not use it, as in recovery mode.
    Chip,
    /// No room is left, or the stored data are inconsistent.
    Contents,
}

impl<E> From<Error<E>> for StorageError {
    fn from(error: Error<E>) -> Self {
        match error {
            Error::Storage { .. } => Self::Chip,
            _ => Self::Contents,
        }
    }
}

/// Longest item that any version of the firmware may store, bytes: an encoded record with its key, or an entry of the log. Older
/// firmware with the same limit can then skip the items of a newer version (`docs/storage.md`).
const MAX_ITEM_BYTES: usize = 512;

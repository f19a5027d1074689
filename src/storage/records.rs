//! The records, such as settings, calibration and bonds, each with the number of its kind and the version of its format. They
//! are stored in a map of `sequential-storage`; load records are in the step log instead.

use crate::pipeline::alert::{AlertRules, DailyLoad};
use crate::pipeline::region::Side;
use crate::pipeline::tissue::{Identified, Tissue};
use crate::protocol::{CalibrationBlock, Reset, Serial, Settings};
use heapless::Vec;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Largest size of the stored bonds, bytes.
pub const MAX_BONDS_BYTES: usize = 192;

/// A kind of record.
pub trait Record: Serialize + DeserializeOwned + PartialEq {
    /// Number of the kind, never reused.
    const KIND: u8;
    /// Version of the format, from 1.
    const VERSION: u8;
}

/// The foot and the serial number; in force from the next start on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct IdentityRecord {
    /// The foot.
    pub side: Side,
    /// The serial number.
    pub serial: Serial,
}

/// The calibration that is in force from the next start on; its cells are in [`CellsRecord`]s.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CalibrationRecord {
    /// The layout that the calibration was measured on.
    pub layout_id: u32,
    /// Number of cells.
    pub cells: u16,
    /// Checksum of the cells' calibrations, from [`crate::protocol::CalibrationId`].
    pub id: u32,
    /// The slot that contains the blocks of the calibration, 0 or 0x80. The next calibration is written to the other slot.
    pub slot: u8,
}

/// A block of a calibration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellsRecord(pub CalibrationBlock);

/// The settings; in force from the next start on. `None` if a host has returned the insole to the board's own configuration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SettingsRecord(pub Option<Settings>);

/// How parameters were identified. The record has two parts, of which the one that belongs to the stored parameters is in force
/// ([`Store::put_tissue`](super::Store::put_tissue)).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct IdentifiedRecord {
    /// The parameters, by [`Tissue::id`]. The record is written before them, so after a loss of power it may belong to
    /// parameters that are not stored.
    pub tissue_id: u32,
    /// `None` if the host that set the parameters did not send this information.
    pub identified: Option<Identified>,
}

/// The bonded centrals and the insole's identity key, in the format of the package `bluetooth`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Bonds(pub Vec<u8, MAX_BONDS_BYTES>);

/// Whether the radio has ever answered on this board. If it has, an updated image confirms itself only if the radio also
/// answers while this image runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RadioRecord {
    /// True if the radio has answered.
    pub has_answered: bool,
}

/// The number of the next load record when the erasure of the wearer's data began. If a loss of power interrupts the erasure,
/// the log may not contain this number any more, or be damaged. The record is removed at the first start at which the log has
/// the number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct NumberingRecord(pub u32);

/// Number of boots for each variant of [`Reset`], in their order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BootCounters(pub [u32; 6]);

impl BootCounters {
    /// Counts a boot.
    pub fn count(&mut self, reset: Reset) {
        if let Some(count) = self.0.get_mut(reset as usize) {
            *count = count.wrapping_add(1);
        }
    }

    /// Number of all boots, which is also the number of the present boot.
    pub fn total(&self) -> u32 {
        self.0.iter().fold(0, |sum, count| sum.wrapping_add(*count))
    }
}

/// Assigns numbers and versions to all kinds.
macro_rules! records {
    ($($record:ty: $kind:literal, $version:literal;)*) => {
        $(impl Record for $record {
            const KIND: u8 = $kind;
            const VERSION: u8 = $version;
        })*

        /// Number and version of every kind, to recognise records of a newer firmware.
        pub(super) const VERSIONS: &[(u8, u8)] = &[$(($kind, $version)),*];
    };
}

records! {
    IdentityRecord: 1, 1;
    Tissue: 2, 1;
    CalibrationRecord: 3, 1;
    CellsRecord: 4, 1;
    Bonds: 5, 1;
    BootCounters: 6, 1;
    SettingsRecord: 7, 1;
    IdentifiedRecord: 8, 2;
    AlertRules: 9, 1;
    DailyLoad: 10, 1;
    RadioRecord: 11, 1;
    NumberingRecord: 12, 1;
}

/// Key of a record: kind, part (of the cells of a calibration and of [`IdentifiedRecord`]; otherwise 0) and version. The version
/// is in the key so that a record never replaces a newer version.
pub(super) type Key = [u8; 3];

//! The entries of the log of steps, load bouts and alerts.

use super::MAX_ITEM_BYTES;
use super::migration::{OldEntry, StepV1, StepV2};
use crate::protocol::{Alert, Bout, LoadRecord, Step, decode, encode};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// An entry of the log.
#[derive(Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "entries exist one at a time, in place")]
pub(super) enum Entry {
    /// A step that no host has acknowledged yet.
    Step {
        /// Number of the boot that recorded the step.
        boot: u32,
        step: Step,
    },
    /// All records before this number are acknowledged.
    Acknowledged { next: u32 },
    /// A load bout that no host has acknowledged yet.
    Bout {
        /// Number of the boot that recorded the bout.
        boot: u32,
        bout: Bout,
    },
    /// An alert that no host has acknowledged yet.
    Alert {
        /// Number of the boot that recorded the alert.
        boot: u32,
        alert: Alert,
    },
}

/// Version of [`Entry`], the first byte of an encoded entry.
const VERSION: u8 = 3;

impl Entry {
    /// Decodes an entry of this or an older version. The function is marked `inline`, so that it is compiled with the board's
    /// package, which is optimised for size; this saves 3 KiB of flash.
    #[inline]
    pub(super) fn decode(bytes: &[u8]) -> Option<Self> {
        match bytes.split_first()? {
            (&VERSION, entry) => decode(entry),
            (2, entry) => Self::decode_old::<StepV2>(entry),
            (1, entry) => Self::decode_old::<StepV1>(entry),
            _ => None,
        }
    }

    /// Decodes an entry with steps of an older version. The function is not inlined, because otherwise each decoding reserves the
    /// stack for entries of all versions.
    #[inline(never)]
    fn decode_old<S: Into<Step> + DeserializeOwned>(entry: &[u8]) -> Option<Self> {
        decode::<OldEntry<S>>(entry).map(Self::from)
    }

    pub(super) fn encode<'b>(&self, buffer: &'b mut [u8; MAX_ITEM_BYTES]) -> &'b [u8] {
        buffer[0] = VERSION;
        // `buffer` has room for the longest entry, so the length is never 0.
        let len = encode(self, &mut buffer[1..]).map_or(0, |entry| 1 + entry.len());
        &buffer[..len]
    }

    /// The entry of a record of this boot.
    pub(super) fn of(boot: u32, record: LoadRecord) -> Self {
        match record {
            LoadRecord::Step(step) => Self::Step { boot, step },
            LoadRecord::Bout(bout) => Self::Bout { boot, bout },
            LoadRecord::Alert(alert) => Self::Alert { boot, alert },
        }
    }

    /// The record, and the boot that recorded it; `None` for an acknowledgement.
    pub(super) fn record(self) -> Option<(u32, LoadRecord)> {
        match self {
            Self::Step { boot, step } => Some((boot, step.into())),
            Self::Bout { boot, bout } => Some((boot, bout.into())),
            Self::Alert { boot, alert } => Some((boot, alert.into())),
            Self::Acknowledged { .. } => None,
        }
    }

    /// The number of the next record after this entry.
    pub(super) fn next_record(&self) -> u32 {
        match self {
            Self::Step { step, .. } => step.step.wrapping_add(1),
            Self::Bout { bout, .. } => bout.number.wrapping_add(1),
            Self::Alert { alert, .. } => alert.number.wrapping_add(1),
            Self::Acknowledged { next } => *next,
        }
    }
}

impl<S: Into<Step>> From<OldEntry<S>> for Entry {
    fn from(entry: OldEntry<S>) -> Self {
        match entry {
            OldEntry::Step { boot, step } => Self::Step { boot, step: step.into() },
            OldEntry::Acknowledged { next } => Self::Acknowledged { next },
        }
    }
}

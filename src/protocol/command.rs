//! Requests that wait for the storage, and answers that wait for the carrier.

use super::cells::CellStream;
use super::{CalibrationBlock, Identity, Refusal, Serial, update};
use crate::pipeline::region::Side;
use crate::pipeline::tissue::Tissue;

/// A request that needs the storage. It is answered on completion: [`super::session::Session::complete`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Store the wearer's parameters, which are in force from then on.
    Tissue(Tissue),
    /// Store side and serial number.
    SetIdentity(Side, Serial),
    /// Store a block of a calibration, by its number.
    CalibrationBlock(u8, CalibrationBlock),
    /// Use the calibration made of the stored blocks.
    Calibration {
        /// As in [`super::ToDevice::SetCalibration`].
        layout_id: u32,
        /// Number of cells.
        cells: u16,
        /// Its checksum.
        id: u32,
    },
    /// Restart.
    Restart,
    /// Execute a step of a firmware update.
    Update(update::Request),
}

/// The result of a [`Command`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CommandResult {
    /// The value is stored.
    Stored,
    /// The value is stored, and the identity is now this one.
    Identity(Identity),
    /// The progress of the update.
    Update(update::Progress),
}

/// An answer that waits for the carrier.
#[derive(Debug)]
pub(super) enum Answer {
    Status,
    Tissue,
    Refused(Refusal),
    Time { host_us: u64, device_us: u64 },
    Faults,
    Identity,
    CalibrationBlock(u8),
    Update(update::Progress),
    CellStream(Option<CellStream>),
    Setup,
    SetupCells(u16),
}

impl Answer {
    /// True if the answer announces parameters that are in force from now on. [`Refusal::NotStored`] is such an answer, because
    /// parameters that could not be stored are in force until the insole restarts. Live frames that are still queued used the
    /// previous parameters.
    pub fn is_announcement(&self) -> bool {
        matches!(self, Self::Tissue | Self::Refused(Refusal::NotStored))
    }
}

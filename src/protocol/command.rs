//! Requests that wait for the storage, and answers that wait for the carrier.

use super::cells::CellStream;
use super::{CALIBRATION_BLOCKS, CalibrationBlock, Identity, Refusal, Serial, Settings, ToDevice, update};
use crate::pipeline::alert::AlertRules;
use crate::pipeline::calibrate::CellCalibration;
use crate::pipeline::contact::ContactRule;
use crate::pipeline::region::Side;
use crate::pipeline::setup::{Setup, SetupCell};
use crate::pipeline::tissue::{Identified, Tissue};

/// A request that needs the storage. Except [`Command::Restart`], which has no answer, it is answered on completion:
/// [`super::session::Session::complete`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Store the wearer's parameters, which are in force from then on, and how they were identified, if this is known.
    Tissue(Tissue, Option<Identified>),
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
        /// Checksum of the calibration; see [`super::CalibrationId`].
        id: u32,
    },
    /// Restart the insole.
    Restart,
    /// Execute a request of a firmware update.
    Update(update::Request),
    /// Store settings; with `None`, the board's own configuration is in force from the next start on.
    Settings(Option<Settings>),
    /// Store rules of alerts, which are in force from then on.
    AlertRules(AlertRules),
    /// Erase everything about the wearer, and restart.
    EraseWearer,
}

impl Command {
    /// The command of a request, or the reason why it is refused; `None` for a message that needs no storage. `contact` is the
    /// contact rule in force; `None` without a valid layout.
    #[inline]
    pub(super) fn of(request: &ToDevice, contact: Option<ContactRule>) -> Option<Result<Self, Refusal>> {
        let accept = |is_accepted: bool, refusal, command| Some(if is_accepted { Ok(command) } else { Err(refusal) });
        match *request {
            ToDevice::SetTissue(tissue) => {
                Some(tissue.check().map(|()| Self::Tissue(tissue, None)).map_err(Refusal::from))
            }
            ToDevice::SetIdentifiedTissue { tissue, identified } => match tissue.check() {
                Err(error) => Some(Err(error.into())),
                Ok(()) => match contact {
                    None => Some(Err(Refusal::NoLayout)),
                    Some(contact) => accept(
                        contact == identified.contact,
                        Refusal::ContactRule,
                        Self::Tissue(tissue, Some(identified)),
                    ),
                },
            },
            ToDevice::SetIdentity { side, serial } => {
                accept(serial.is_valid(), Refusal::Serial, Self::SetIdentity(side, serial))
            }
            ToDevice::SetCalibrationBlock { block, cells } => accept(
                usize::from(block) < CALIBRATION_BLOCKS && cells.iter().all(CellCalibration::is_valid),
                Refusal::Calibration,
                Self::CalibrationBlock(block, cells),
            ),
            ToDevice::SetCalibration { layout_id, cells, id } => Some(Ok(Self::Calibration { layout_id, cells, id })),
            ToDevice::SetSettings(settings) => {
                accept(settings.is_none_or(|settings| settings.is_valid()), Refusal::Settings, Self::Settings(settings))
            }
            ToDevice::SetAlertRules(rules) => accept(rules.is_valid(), Refusal::AlertRules, Self::AlertRules(rules)),
            ToDevice::Restart => Some(Ok(Self::Restart)),
            ToDevice::EraseWearer => Some(Ok(Self::EraseWearer)),
            ToDevice::Update(request) => Some(Ok(Self::Update(request))),
            _ => None,
        }
    }
}

/// The parameters and the configuration that hosts read and change; they outlast a session.
#[derive(Clone, Copy, Debug)]
pub(super) struct Configured {
    /// The parameters in force.
    pub tissue: Tissue,
    /// How the parameters in force were identified, if this is known.
    pub identified: Option<Identified>,
    /// The stored settings.
    pub settings: Option<Settings>,
    /// The stored identity.
    pub identity: Identity,
    /// The rules of alerts in force.
    pub alert_rules: AlertRules,
    /// The layout in force: the set-up of the insole and its cells; `None` without a valid one.
    pub layout: Option<(Setup, &'static [SetupCell])>,
}

impl Configured {
    /// The state after a reset, before stored data are restored.
    pub const NONE: Self = Self {
        tissue: Tissue::NONE,
        identified: None,
        settings: None,
        identity: Identity { side: Side::Left, serial: Serial::NONE, calibration_id: 0 },
        alert_rules: AlertRules::OFF,
        layout: None,
    };
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

/// An answer that waits for the carrier. It becomes the message of the same name of [`super::ToHost`] when it is sent, with the
/// values of that time. [`Answer::NewTissue`] becomes `Tissue`, or `Refused` if the parameters could not be stored.
#[derive(Debug)]
pub(super) enum Answer {
    Status,
    Tissue,
    /// New parameters are in force from now on; if they could not be stored, until the insole restarts.
    NewTissue {
        is_stored: bool,
    },
    Refused(Refusal),
    Time {
        host_us: u64,
        device_us: u64,
    },
    Faults,
    Identity,
    CalibrationBlock(u8),
    Update(update::Progress),
    CellStream(Option<CellStream>),
    Setup,
    SetupCells(u16),
    Settings,
    Identified,
    AlertRules,
    DailyLoad,
    Zero,
}

impl Answer {
    /// True if the answer announces new parameters. Live frames that are still queued used the previous parameters.
    pub fn is_announcement(&self) -> bool {
        matches!(self, Self::NewTissue { .. })
    }
}

//! The two directions of messages, and their version.

use super::update;
use super::{
    Alert, Bout, CalibrationBlock, CellFrame, CellStream, Ellipses, Hello, Identity, Live, Refusal, Serial, Settings,
    Status, Step,
};
use crate::faults::Faults;
use crate::pipeline::alert::{AlertRules, DailyLoad};
use crate::pipeline::baseline::ZeroResult;
use crate::pipeline::region::Side;
use crate::pipeline::setup::{Setup, SetupCell};
use crate::pipeline::tissue::{Identified, Tissue};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Major protocol version of this build.
pub const MAJOR: u8 = 3;
/// Minor protocol version of this build.
pub const MINOR: u8 = 0;

/// Largest number of cells in a [`ToHost::SetupCells`].
pub const SETUP_CELLS: usize = 16;

/// A message from the insole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "messages exist one at a time, in place")]
pub enum ToHost {
    /// The answer to [`ToDevice::Connect`].
    Hello(Hello),
    /// One frame of a running stream.
    Live(Live),
    /// A step that is not acknowledged yet.
    Step(Step),
    /// The answer to [`ToDevice::GetStatus`].
    Status(Status),
    /// The wearer's parameters in force: on request, and when new ones are accepted. Live frames after this message use them.
    Tissue(Tissue),
    /// The answer to a request that cannot be executed.
    Refused(Refusal),
    /// The answer to [`ToDevice::GetTime`].
    Time {
        /// The host's time, as it was sent.
        host_us: u64,
        /// When the request arrived: time since the first scan, as in [`Live::t_us`], us.
        device_us: u64,
    },
    /// The answer to [`ToDevice::GetFaults`].
    Faults(Faults),
    /// The stored identity of the insole: on request, and when a new one is stored.
    Identity(Identity),
    /// A block of a calibration is stored.
    CalibrationBlock {
        /// Number of the block.
        block: u8,
    },
    /// The answer to [`ToDevice::Update`].
    Update(update::Progress),
    /// The answer to [`ToDevice::StreamCells`]: the stream that runs from now on.
    CellStream(Option<CellStream>),
    /// All cells of one frame.
    Cells(CellFrame),
    /// The answer to [`ToDevice::GetSetup`].
    Setup(Setup),
    /// The answer to [`ToDevice::GetSetupCells`].
    SetupCells {
        /// Index of the first cell.
        first: u16,
        /// The cells from there on; fewer than [`SETUP_CELLS`] at the end of the layout.
        cells: Vec<SetupCell, SETUP_CELLS>,
    },
    /// The stored settings, which are in force from the next start on: on request, and when new ones are stored. `None` if the
    /// board's own configuration is in force.
    Settings(Option<Settings>),
    /// How the parameters in force were identified; `None` without parameters, or if the host that set them did not send this
    /// information.
    Identified(Option<Identified>),
    /// A load bout that is not acknowledged yet.
    Bout(Bout),
    /// An alert that is not acknowledged yet.
    Alert(Alert),
    /// The rules of alerts in force: on request, and when new ones are accepted.
    AlertRules(AlertRules),
    /// The load of the day: on request, and after [`ToDevice::SnoozeAlerts`].
    DailyLoad(DailyLoad),
    /// The contact ellipses of one frame of a running stream of ellipses.
    Ellipses(Ellipses),
    /// The answer to [`ToDevice::Zero`].
    Zero(ZeroResult),
}

impl ToHost {
    /// First byte of an encoded [`ToHost::Live`].
    pub const LIVE: u8 = 1;
    /// First byte of an encoded [`ToHost::Step`].
    pub const STEP: u8 = 2;
    /// First byte of an encoded [`ToHost::Tissue`].
    pub const TISSUE: u8 = 4;
    /// First byte of an encoded [`ToHost::Refused`].
    pub const REFUSED: u8 = 5;
    /// First byte of an encoded [`ToHost::Cells`].
    pub const CELLS: u8 = 12;
    /// First byte of an encoded [`ToHost::Bout`].
    pub const BOUT: u8 = 17;
    /// First byte of an encoded [`ToHost::Alert`].
    pub const ALERT: u8 = 18;
    /// First byte of an encoded [`ToHost::Ellipses`].
    pub const ELLIPSES: u8 = 21;
}

/// A message to the insole.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "messages exist one at a time, in place")]
pub enum ToDevice {
    /// Opens a session: the insole answers with a hello and, to a host of its own major version, replays the steps,
    /// load bouts and alerts that were never acknowledged.
    Connect {
        /// The host's [`MAJOR`].
        major: u8,
        /// The host's [`MINOR`].
        minor: u8,
    },
    /// Turns the live stream on or off.
    Stream {
        /// True for on.
        live: bool,
    },
    /// The host has received and stored all steps, load bouts and alerts up to and including this number.
    Acknowledge {
        /// The number of the record.
        number: u32,
    },
    /// Asks for [`Status`].
    GetStatus,
    /// Replaces the wearer's parameters; answered by [`ToHost::Tissue`] once they are stored, or by [`ToHost::Refused`].
    SetTissue(Tissue),
    /// Asks for [`ToHost::Tissue`].
    GetTissue,
    /// Asks for [`ToHost::Time`]. From several answers a host computes offset and drift of the insole's clock.
    GetTime {
        /// The host's time; returned unchanged.
        host_us: u64,
    },
    /// Sets the wall clock until the insole restarts; answered by [`ToHost::Refused`] for a time outside of
    /// [`CLOCK_US`](super::session::CLOCK_US).
    SetClock {
        /// Time since 1970, UTC, us.
        unix_us: u64,
    },
    /// Asks for [`ToHost::Faults`].
    GetFaults,
    /// Asks for [`ToHost::Identity`].
    GetIdentity,
    /// Sets the insole's identity from its next start on; answered by [`ToHost::Identity`] once it is stored.
    SetIdentity {
        /// The foot.
        side: Side,
        /// The serial number.
        serial: Serial,
    },
    /// A block of a calibration, to be stored but not used yet; answered by [`ToHost::CalibrationBlock`].
    SetCalibrationBlock {
        /// Number of the block, of which the first cell has the index `block` times [`super::BLOCK_CELLS`].
        block: u8,
        /// Calibrations of the cells of the block; those beyond the last cell of the insole are ignored.
        cells: CalibrationBlock,
    },
    /// Puts the calibration made of the stored blocks in force from the next start on; answered by [`ToHost::Identity`].
    SetCalibration {
        /// The layout that the calibration was measured on, as in [`Hello::layout_id`].
        layout_id: u32,
        /// Number of cells.
        cells: u16,
        /// Checksum of the calibration; see [`super::CalibrationId`].
        id: u32,
    },
    /// Restarts the insole; answered only by [`ToHost::Refused`], if another command is pending.
    Restart,
    /// A request of a firmware update; answered by [`ToHost::Update`] or [`ToHost::Refused`].
    Update(update::Request),
    /// Turns the stream of cells on or off; answered by [`ToHost::CellStream`], or by [`ToHost::Refused`] if the carrier is
    /// too slow.
    StreamCells(Option<CellStream>),
    /// Asks for [`ToHost::Setup`].
    GetSetup,
    /// Asks for [`ToHost::SetupCells`].
    GetSetupCells {
        /// Index of the first cell.
        first: u16,
    },
    /// Asks for [`ToHost::Settings`].
    GetSettings,
    /// Replaces the settings from the next start on, with `None` by the board's own configuration; answered by
    /// [`ToHost::Settings`] once they are stored, or by [`ToHost::Refused`].
    SetSettings(Option<Settings>),
    /// Replaces the wearer's parameters, as [`ToDevice::SetTissue`] does, by parameters that hold for one contact rule; refused
    /// if another rule is in force. If the rule changes later, the parameters are not used any more.
    SetIdentifiedTissue {
        /// The parameters.
        tissue: Tissue,
        /// How the parameters were identified.
        identified: Identified,
    },
    /// Asks for [`ToHost::Identified`].
    GetIdentified,
    /// Asks for [`ToHost::AlertRules`].
    GetAlertRules,
    /// Replaces the rules of alerts; answered by [`ToHost::AlertRules`] once they are stored, or by [`ToHost::Refused`].
    SetAlertRules(AlertRules),
    /// Asks for [`ToHost::DailyLoad`].
    GetDailyLoad,
    /// Raises no alerts for this time; answered by [`ToHost::DailyLoad`], or by [`ToHost::Refused`] if the insole has no valid
    /// layout.
    SnoozeAlerts {
        /// The time, s; a longer pause or snooze in progress is not shortened; 0 ends both. A time above
        /// [`MAX_SNOOZE_S`](crate::pipeline::alert::MAX_SNOOZE_S) is limited to it.
        snoozed_s: u16,
    },
    /// Turns the stream of ellipses on or off; answered only by [`ToHost::Refused`], if the rate is above 25 Hz or the insole
    /// has no valid layout.
    StreamEllipses {
        /// One of every `every` frames is sent; 0 turns the stream off.
        every: u8,
    },
    /// Measures the baselines of all cells under the lifted foot; answered by [`ToHost::Zero`], or by [`ToHost::Refused`] if the
    /// foot is not lifted within [`ZERO_S`](crate::pipeline::baseline::ZERO_S) seconds, or the insole has no valid layout.
    Zero,
    /// Erases everything about the wearer: parameters, rules of alerts, load of the day, bonds, and all records of steps, load
    /// bouts and alerts. Foot, serial number, calibration and settings remain. Answered by [`ToHost::Identity`] after some 15 s,
    /// with a full log of 13.5 MiB after some three minutes; then the insole restarts.
    EraseWearer,
}

//! Why an insole did not execute a request.

use super::{SCALE, SETTABLE_PERIOD_US, update};
use crate::pipeline::cumulative::WINDOW_PARTS;
use crate::pipeline::model::{AB_M2, COEFFICIENT, LENGTH_M, MAX_EXPONENT};
use crate::pipeline::region::Region;
use crate::pipeline::tissue::TissueError;
use core::fmt;
use serde::{Deserialize, Serialize};

/// Why a request was not executed. Except after [`Refusal::NotStored`] and [`Refusal::Update`], nothing was changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// A frame arrived intact, and its message is unknown to this firmware, too short or too long. `plantar serve` also refuses
    /// with it what it does not accept from the page.
    NotUnderstood,
    /// The identifier of the parameters is not the checksum of their values.
    TissueId,
    /// The parameters of this region are out of range; see [`crate::pipeline::model::ForceLaw::is_valid`].
    Tissue(Region),
    /// The flash chip failed to store the value, its supply is too low, or the insole is in recovery mode, in which it stores
    /// nothing. New parameters and rules of alerts are in force until the next start only; other values are not in force.
    NotStored,
    /// An earlier request is still being executed. `plantar serve` also refuses a request with it if the link to the insole ended
    /// before the answer.
    Busy,
    /// The serial number contains a space or a character that is not printable ASCII.
    Serial,
    /// The calibration is out of range, of another layout, or incomplete.
    Calibration,
    /// A request of a firmware update was refused for this reason. The running image is unchanged; the image that was being
    /// received may be discarded.
    Update(update::Refusal),
    /// The carrier is too slow for this stream of cells.
    CellRate {
        /// The smallest [`CellStream::every`](super::CellStream::every) for which the carrier is fast enough; 0 if it is too slow
        /// for any.
        every: u8,
    },
    /// The insole has no valid layout.
    NoLayout,
    /// The settings are out of range.
    Settings,
    /// The parameters were identified with another contact rule than the one in force.
    ContactRule,
    /// The rules of alerts are out of range.
    AlertRules,
    /// The requested stream of ellipses has more than 25 messages a second.
    EllipseRate {
        /// The smallest accepted value of `every`, other than 0, in
        /// [`ToDevice::StreamEllipses`](super::ToDevice::StreamEllipses).
        every: u8,
    },
    /// The foot was not lifted, so the baselines were not measured.
    NotLifted,
    /// The time for the wall clock is outside of [`CLOCK_US`](super::session::CLOCK_US).
    Clock,
    /// Another host has connected later over the insole's other carrier, and has the session. The insole answers every message
    /// of this host, except a connect request, with this refusal until the other host ends its session or has been silent for
    /// half a minute.
    OtherHost,
}

impl From<TissueError> for Refusal {
    fn from(error: TissueError) -> Self {
        match error {
            TissueError::Id => Self::TissueId,
            TissueError::Region(region) => Self::Tissue(region),
        }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotUnderstood => f.write_str("a message was not understood: update the insole's firmware"),
            Self::NotStored => f.write_str(
                "the insole could not store this, because its supply is too low (charge its battery), its flash chip failed, \
                 or it is in recovery mode (update its firmware): parameters and rules of alerts are in force until it \
                 restarts, and other requests must be repeated",
            ),
            Self::Busy => f.write_str("the insole is still executing another request, or its answer was lost: try again after some seconds"),
            Self::Serial => f.write_str("a serial number has up to 16 printable ASCII characters and no spaces"),
            Self::Calibration => f.write_str(
                "the calibration is out of range, of another layout, or incomplete: it needs one line for each cell, \
                 gains from 0.1 to 10 and offsets in the lower half of the scale",
            ),
            Self::TissueId => {
                f.write_str("the parameters do not match their identifier, so some were damaged: send them again")
            }
            Self::Tissue(region) => write!(
                f,
                "the parameters of {} are out of range: A B must be {:e} to {:e} m2, C {:e} to {:e} m, \
                 K and G {} to {:e} Pa and Pa s, n and m above -1 and at most {MAX_EXPONENT}",
                region.name(),
                AB_M2.start(),
                AB_M2.end(),
                LENGTH_M.start(),
                LENGTH_M.end(),
                COEFFICIENT.start(),
                COEFFICIENT.end(),
            ),
            Self::Update(refusal) => refusal.fmt(f),
            Self::CellRate { every: 0 } => f.write_str(
                "the connection is too slow for a stream of cells: set a lower frame rate, or, over Bluetooth, use the \
                 serial port",
            ),
            Self::CellRate { every } => write!(
                f,
                "the connection is too slow for this stream of cells: request one of every {every} frames, or, over \
                 Bluetooth, use the serial port"
            ),
            Self::OtherHost => f.write_str(
                "another phone or program is connected to the insole, by cable or Bluetooth, and receives its steps now: \
                 this connection continues soon after the other one has ended",
            ),
            Self::NoLayout => f.write_str("the insole has no valid layout; `plantar insole show` prints the reason"),
            Self::Settings => write!(
                f,
                "the settings are out of range: {} to {} frames/s, a scale of {} to {}, 0 < off_kpa <= on_kpa <= 1000, \
                 full_kpa = 0 or on_kpa <= full_kpa <= 2000, 0 < release_n <= 1000, 0 < strike_n <= 1000, \
                 min_stance_ms < max_stance_ms, min_swing_ms > 0",
                1_000_000 / SETTABLE_PERIOD_US.end(),
                1_000_000 / SETTABLE_PERIOD_US.start(),
                SCALE.start(),
                SCALE.end(),
            ),
            Self::ContactRule => f.write_str(
                "the parameters were identified with another contact rule than the one of the insole: set the rule \
                 first",
            ),
            Self::NotLifted => f.write_str(
                "the baselines were not measured, because the foot carries load or moves: sit down, lift the foot, and \
                 hold it still",
            ),
            Self::AlertRules => write!(
                f,
                "the rules of alerts are out of range: pressures of 1 to 2000 kPa, a window of 60 to 3600 s that is a multiple \
                 of {WINDOW_PARTS} s, relieved_percent above 0 and below sustained_percent, which is at most 100, a dose of \
                 0 to 1e7 kPa s, 60 to 43200 s without another alert, and a day that begins before minute 1440",
            ),
            Self::Clock => f.write_str("the time is before 2020 or after 2099: set the clock of this computer or phone"),
            Self::EllipseRate { every } => {
                write!(f, "ellipses are streamed at 25 Hz at most: request one of every {every} frames")
            }
        }
    }
}

impl core::error::Error for Refusal {}

//! The GATT service of an insole: UUIDs, advertised names, and the rules that connect characteristics with messages.
//! `docs/bluetooth.md` has the whole table.

use super::{Capacity, ToDevice, ToHost};
use crate::pipeline::region::Side;

/// The UUID of the insole service (number 0) or of one of its characteristics: `dca8c3xx-cb96-463f-8bec-f2094e1ccf7b`, a random
/// UUID in which `xx` is the number.
const fn uuid(number: u128) -> u128 {
    0xdca8_c300_cb96_463f_8bec_f209_4e1c_cf7b + (number << 96)
}

/// The insole service.
pub const SERVICE: u128 = uuid(0);
/// Requests and their answers, except those of [`PARAMETERS`].
pub const CONTROL: u128 = uuid(1);
/// Live frames, frames of all cells, and ellipses.
pub const LIVE: u128 = uuid(2);
/// Steps, load bouts and alerts.
pub const STEPS: u128 = uuid(3);
/// The wearer's parameters, and the refusals of all requests.
pub const PARAMETERS: u128 = uuid(4);

/// The service of management tools ([`mcumgr`]).
pub const MANAGEMENT_SERVICE: u128 = 0x8d53_dc1d_1db7_4cd3_868b_8a52_7460_aa84;
/// The requests of management tools and their answers. A long message is split into values without the header that the fragments
/// on the other characteristics have, because each message states its own length.
pub const MANAGEMENT: u128 = 0xda2e_7828_fbce_4e01_ae9e_2611_7499_7c48;

/// Longest value of a characteristic, bytes: the longest packet of the link layer, 251 bytes, without its L2CAP and ATT headers.
pub const MAX_VALUE: usize = 244;

/// What a link is assumed to carry from the insole: four values in each connection interval of 30 ms, the longest one that the
/// insole requests. A central may choose a longer one. The first byte of a value is the header of the fragment.
pub const CAPACITY: Capacity = Capacity { packets_per_s: 4 * 1000 / 30, packet_bytes: MAX_VALUE as u32 - 1 };

/// The advertised name of an insole.
pub const fn name(side: Side) -> &'static str {
    match side {
        Side::Left => "Plantar L",
        Side::Right => "Plantar R",
    }
}

/// A characteristic with values that the firmware writes or reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GattChannel {
    /// Current Time, of the standard service.
    Time,
    /// RSC Measurement, of the standard service Running Speed and Cadence.
    Cadence,
    /// [`CONTROL`].
    Control,
    /// [`LIVE`].
    Live,
    /// [`STEPS`].
    Steps,
    /// [`PARAMETERS`].
    Parameters,
    /// [`MANAGEMENT`].
    Management,
}

impl GattChannel {
    /// The characteristic that a request is written to.
    pub const fn of_request(request: &ToDevice) -> Self {
        match request {
            ToDevice::SetTissue(_) | ToDevice::SetIdentifiedTissue { .. } | ToDevice::GetTissue => Self::Parameters,
            _ => Self::Control,
        }
    }

    /// The characteristic that an encoded [`ToHost`] is sent on.
    pub fn of_message(message: &[u8]) -> Self {
        match message.first() {
            Some(&(ToHost::LIVE | ToHost::CELLS | ToHost::ELLIPSES)) => Self::Live,
            Some(&(ToHost::STEP | ToHost::BOUT | ToHost::ALERT)) => Self::Steps,
            // Refusals are sent on this characteristic, whichever request was refused.
            Some(&(ToHost::TISSUE | ToHost::REFUSED)) => Self::Parameters,
            _ => Self::Control,
        }
    }
}

/// Why a written value was not accepted; the central receives it as an attribute error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WriteError {
    /// The value is empty, or its message is longer than the protocol allows.
    Length,
    /// The value is a fragment of a message out of order.
    OutOfOrder,
    /// The value is not a message, or not a message for this characteristic.
    NotUnderstood,
    /// The value is not a valid time.
    Value,
}

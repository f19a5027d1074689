//! The constants of the protocol and the geometry of the sole. The page reads them once, when it starts.

use crate::sole::Sole;
use plantar::Region;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::tissue::{AreaFilter, Identified, Tissue};
use plantar::protocol::gatt::{self, GattChannel};
use plantar::protocol::session::RECORD_QUEUE;
use plantar::protocol::{MAJOR, MAX_MESSAGE, MINOR, ToDevice, encode};
use serde::Serialize;

/// Constants of the protocol and the geometry of the sole.
#[derive(Serialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub struct Facts {
    /// Major protocol version of the page.
    major: u8,
    /// Minor protocol version of the page.
    minor: u8,
    /// Largest number of unacknowledged records that an insole holds in RAM.
    record_queue: usize,
    gatt: Gatt,
    /// The regions, in the order of the messages.
    regions: Vec<RegionFacts>,
    /// The sole to draw until the cells of an insole are known.
    sole: Sole,
}

/// UUIDs of the insole's Bluetooth service and of its characteristics, all of which require a bond.
#[derive(Serialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub struct Gatt {
    service: String,
    /// The page writes requests to this characteristic, and the insole indicates the answers.
    control: String,
    /// The insole notifies live frames and contact ellipses on this characteristic.
    live: String,
    /// The insole notifies steps, load bouts and alerts on this characteristic.
    steps: String,
    /// As `control`, for requests that set or read the wearer's parameters themselves. The insole indicates all refusals here.
    parameters: String,
    /// For each kind of request that is written to `parameters`, the first byte of the encoded request.
    parameter_requests: Vec<u8>,
}

/// A region.
#[derive(Serialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub struct RegionFacts {
    /// Name in messages and files.
    name: &'static str,
}

/// See [`Gatt::parameter_requests`].
fn parameter_requests() -> Vec<u8> {
    let tissue = Tissue::NONE;
    let contact = ContactRule::COUNTED;
    let identified = Identified { contact, filter: AreaFilter::Direct, side: None, steps: 0, regions: 0 };
    let requests =
        [ToDevice::SetTissue(tissue), ToDevice::GetTissue, ToDevice::SetIdentifiedTissue { tissue, identified }];
    let of_parameters = requests.iter().filter(|request| GattChannel::of_request(request) == GattChannel::Parameters);
    let first_byte = |request| {
        let mut buffer = [0; MAX_MESSAGE];
        encode(request, &mut buffer).ok().and_then(|message| message.first().copied())
    };
    of_parameters.filter_map(first_byte).collect()
}

/// The [`Facts`] as JSON.
pub(crate) fn facts_to_json() -> String {
    let facts = Facts {
        major: MAJOR,
        minor: MINOR,
        record_queue: RECORD_QUEUE,
        gatt: Gatt {
            service: uuid_to_text(gatt::SERVICE),
            control: uuid_to_text(gatt::CONTROL),
            live: uuid_to_text(gatt::LIVE),
            steps: uuid_to_text(gatt::STEPS),
            parameters: uuid_to_text(gatt::PARAMETERS),
            parameter_requests: parameter_requests(),
        },
        regions: Region::ALL.iter().map(|region| RegionFacts { name: region.name() }).collect(),
        sole: Sole::generic(),
    };
    // Strings and finite numbers can always be written as JSON.
    serde_json::to_string(&facts).unwrap_or_default()
}

/// A UUID in the form that Web Bluetooth requires: lower-case digits in groups of 8, 4, 4, 4 and 12.
fn uuid_to_text(uuid: u128) -> String {
    let digits = format!("{uuid:032x}");
    [0..8, 8..12, 12..16, 16..20, 20..32].map(|group| &digits[group]).join("-")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uuids_have_the_form_that_web_bluetooth_requires() {
        assert_eq!(uuid_to_text(gatt::LIVE), "dca8c302-cb96-463f-8bec-f2094e1ccf7b");
        assert_eq!(uuid_to_text(0x0001), "00000000-0000-0000-0000-000000000001");
    }
}

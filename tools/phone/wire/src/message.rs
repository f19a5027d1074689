//! Messages of an insole as JSON for the page. Each message is one object. Its first key is `kind`; the names of the other keys
//! include the units.

use crate::sole::LayoutCell;
use client::{alert_to_json, bout_to_json, daily_load_to_json, step_to_json};
use plantar::Side;
use plantar::checksum::crc32;
use plantar::pipeline::setup::SetupCell;
use plantar::pipeline::tissue::Identified;
use plantar::protocol::{self, Alert, Bout, ContactEllipse, LiveRegion, MAX_MESSAGE, Quantity, Step, ToHost, encode};
use serde::ser::{SerializeMap, SerializeSeq};
use serde::{Serialize, Serializer};
use serde_json::Value;

/// The reason of [`protocol::Refusal::NotUnderstood`], by which `plantar serve` refuses a change if it was started without
/// `--accept-parameters`. It also passes on this refusal of an insole with older firmware.
const NOT_UNDERSTOOD: &str = "plantar serve accepts changes only with the option --accept-parameters; \
                              if it was started with this option, update the insole's firmware";

/// A message of an insole.
#[derive(Serialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
#[cfg_attr(test, ts(rename = "ToHost"))]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(crate) enum Message {
    Hello(Hello),
    Live(#[cfg_attr(test, ts(type = "Live"))] LiveFrame),
    Step {
        /// Identifies the step. It does not change when an insole sends the step again.
        key: String,
        #[cfg_attr(test, ts(type = "Step"))]
        step: Value,
    },
    /// A load bout.
    Bout {
        /// Identifies the load bout. It does not change when an insole sends the load bout again.
        key: String,
        #[cfg_attr(test, ts(type = "Bout"))]
        bout: Value,
    },
    /// An alert.
    Alert {
        /// Identifies the alert. It does not change when an insole sends the alert again.
        key: String,
        #[cfg_attr(test, ts(type = "Alert"))]
        alert: Value,
    },
    /// The rules of alerts.
    AlertRules {
        /// Largest number of alerts in a day; 0 if the insole raises none.
        per_day: u8,
        /// Minutes from midnight UTC to the start of the wearer's day.
        day_start_min: u16,
    },
    /// The load of the day.
    DailyLoad {
        #[cfg_attr(test, ts(type = "DailyLoad"))]
        load: Value,
    },
    Status(Status),
    Tissue {
        /// Identifies the tissue parameters of the insole; 0 if the insole has none.
        id: u32,
    },
    /// Distinguishes typical parameters from those of the wearer.
    Identified {
        /// Indices of the regions of which the parameters are typical values, or not known to be the wearer's.
        typical: Vec<usize>,
    },
    Refused {
        /// The reason, as a phrase without a full stop.
        reason: String,
        /// True if the session belongs to another host now. The insole repeats the refusal until that host has left.
        is_other_host: bool,
        /// True if the insole could not store what was requested: parameters and rules of alerts are in force until it restarts.
        is_not_stored: bool,
        /// True if the same request would be refused again, because `plantar serve` accepts no changes, or the insole does not
        /// know this request.
        is_final: bool,
    },
    Time {
        /// The page's time in the request.
        host_us: u64,
        /// The insole's time when the request arrived.
        device_us: u64,
    },
    /// The contact ellipses of one frame.
    Ellipses {
        /// Time of the scan since the first scan.
        t_s: f64,
        /// The ellipse of each region, in the order of `Facts.regions`, the list of the regions' names; null without contact.
        #[cfg_attr(test, ts(type = "Array<Ellipse | null>"))]
        regions: Vec<Option<ShownEllipse>>,
    },
    /// A part of the insole's cells.
    SetupCells {
        /// Index of the first cell.
        first: u16,
        cells: Vec<LayoutCell>,
    },
}

/// Identifies the insole.
#[derive(Serialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub(crate) struct Hello {
    /// Major protocol version of the insole.
    major: u8,
    /// Minor protocol version of the insole.
    minor: u8,
    /// Firmware version.
    firmware: String,
    /// Board name.
    board: String,
    #[cfg_attr(test, ts(type = "Side"))]
    side: &'static str,
    /// Number of cells.
    cells: u16,
    /// Frames per second.
    rate_hz: f64,
    /// True if areas are sums of covered shares: effective areas instead of contact areas.
    has_effective_areas: bool,
    /// True if the insole has tissue parameters, whether the wearer's or typical ones. Without them it computes no deformation
    /// and no model force.
    has_parameters: bool,
    /// The reason of the last reset, one word.
    reset: &'static str,
    /// The fault that ended the previous run, or a fault of this start. If the number of cells is 0, the insole has refused its
    /// set-up, and does not measure.
    fault: Option<String>,
}

/// Counters of an insole since its start, unless they state another period.
#[derive(Serialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub(crate) struct Status {
    uptime_s: f64,
    /// Frame times that passed without a complete scan.
    frames_missed: u32,
    /// Live frames that were due in this session, without those that still wait for the link.
    live_due: u32,
    /// Live frames that the insole handed to its link in this session.
    live_sent: u32,
    steps: u32,
    /// Number that the next step, load bout or alert will have. The numbering continues after a restart.
    next_record: u32,
    /// Unacknowledged records that were dropped, because there was no space or they could not be stored; with `plantar serve`
    /// also those that it deleted before this page received them.
    records_dropped: u32,
    /// Damaged or unknown messages that the insole received.
    bad_frames: u32,
    /// Items that the insole could not store: load records, acknowledgements, and others such as settings and bonds.
    not_stored: u32,
    /// Number of sensor faults.
    faults: u32,
    /// Number of times that the baseline of a cell was corrected.
    rezeroed: u32,
}

/// The message as JSON. `None` for bytes that are not a message of this version, and for messages that the page does not use.
pub fn decode_to_json(bytes: &[u8]) -> Option<String> {
    serde_json::to_string(&Message::new(protocol::decode(bytes)?)?).ok()
}

impl Message {
    /// The message for the page; `None` for messages that the page does not use.
    fn new(message: ToHost) -> Option<Self> {
        Some(match message {
            ToHost::Hello(hello) => Self::Hello(hello.into()),
            ToHost::Live(live) => Self::Live(LiveFrame(live)),
            ToHost::Step(step) => Self::Step {
                key: key(step.step, step.start_us, &Step { boots_since: 0, ..step }),
                step: step_to_json(&step),
            },
            ToHost::Bout(bout) => Self::Bout {
                key: key(bout.number, bout.start_us, &Bout { boots_since: 0, ..bout }),
                bout: bout_to_json(&bout),
            },
            ToHost::Alert(alert) => Self::Alert {
                key: key(alert.number, alert.start_us, &Alert { boots_since: 0, ..alert }),
                alert: alert_to_json(&alert),
            },
            ToHost::AlertRules(rules) => {
                Self::AlertRules { per_day: rules.per_day, day_start_min: rules.day_start_min }
            }
            ToHost::DailyLoad(daily) => Self::DailyLoad { load: daily_load_to_json(&daily) },
            ToHost::Status(status) => Self::Status(status.into()),
            ToHost::Tissue(tissue) => Self::Tissue { id: tissue.id },
            ToHost::Identified(identified) => {
                let typical = Identified::typical_regions(identified);
                Self::Identified { typical: typical.map(|region| region as usize).collect() }
            }
            ToHost::Refused(refusal) => Self::Refused {
                reason: match refusal {
                    // Only `plantar serve` passes this refusal to a page: over Bluetooth, the write of such a request fails.
                    protocol::Refusal::NotUnderstood => NOT_UNDERSTOOD.into(),
                    refusal => refusal.to_string(),
                },
                is_other_host: refusal == protocol::Refusal::OtherHost,
                is_not_stored: refusal == protocol::Refusal::NotStored,
                is_final: refusal == protocol::Refusal::NotUnderstood,
            },
            ToHost::Time { host_us, device_us } => Self::Time { host_us, device_us },
            ToHost::Ellipses(ellipses) => Self::Ellipses {
                t_s: ellipses.t_us as f64 / 1e6,
                regions: ellipses.regions.iter().map(|&ellipse| ShownEllipse::new(ellipse)).collect(),
            },
            ToHost::SetupCells { first, cells } => {
                Self::SetupCells { first, cells: cells.iter().map(LayoutCell::from).collect() }
            }
            _ => return None,
        })
    }
}

/// The key of a step, load bout or alert: its number, its start and the checksum of its encoded `content`, in hexadecimal digits.
/// The number of boots since the record, which changes if the insole sends the record again after a restart, must be 0 in
/// `content`. Two records of different wearers can have the same number and, rarely, the same start in microseconds since the
/// first scan of their insole; the chance that their checksums are then equal is 1 in 4 billion.
fn key(number: u32, start_us: u64, content: &impl Serialize) -> String {
    let mut buffer = [0; MAX_MESSAGE];
    // Every message fits into the buffer.
    let content = encode(content, &mut buffer).map_or(&[][..], |content| content);
    format!("{number:x}-{start_us:x}-{:08x}", crc32(content))
}

impl From<protocol::Hello> for Hello {
    fn from(hello: protocol::Hello) -> Self {
        Self {
            major: hello.major,
            minor: hello.minor,
            firmware: hello.firmware.as_str().into(),
            board: hello.board.as_str().into(),
            side: match hello.side {
                Side::Left => "left",
                Side::Right => "right",
            },
            cells: hello.cells,
            rate_hz: 1e6 / f64::from(hello.period_us),
            has_effective_areas: hello.contact_rule.full_kpa > 0.0,
            has_parameters: hello.tissue_id != 0,
            reset: hello.reset.name(),
            fault: hello.fault.as_deref().map(String::from),
        }
    }
}

impl From<protocol::Status> for Status {
    fn from(status: protocol::Status) -> Self {
        Self {
            uptime_s: status.uptime_us as f64 / 1e6,
            frames_missed: status.frames_missed,
            live_due: status.live_due,
            live_sent: status.live_sent,
            steps: status.steps,
            next_record: status.contents.next_record,
            records_dropped: status.records_dropped,
            bad_frames: status.bad_frames,
            not_stored: status.not_stored,
            faults: status.faults,
            rezeroed: status.rezeroed,
        }
    }
}

/// A live frame. Its JSON contains the quantities and flags that the protocol declares. An insole sends about a hundred frames
/// per second, so they are serialised without an intermediate object.
pub(crate) struct LiveFrame(pub protocol::Live);

impl Serialize for LiveFrame {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        serialize_quantities(&mut map, protocol::Live::QUANTITIES, &self.0)?;
        map.serialize_entry("regions", &Regions(&self.0))?;
        map.end()
    }
}

/// A contact ellipse. Its JSON contains the quantities that the protocol declares.
pub(crate) struct ShownEllipse(ContactEllipse);

impl ShownEllipse {
    /// `None` without contact.
    fn new(ellipse: ContactEllipse) -> Option<Self> {
        (ellipse.r_a_cmm > 0).then_some(Self(ellipse))
    }
}

impl Serialize for ShownEllipse {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        serialize_quantities(&mut map, ContactEllipse::QUANTITIES, &self.0)?;
        map.end()
    }
}

impl From<&SetupCell> for LayoutCell {
    fn from(cell: &SetupCell) -> Self {
        Self { region: cell.region as usize, x_mm: cell.x_mm, y_mm: cell.y_mm, area_mm2: cell.area_mm2 }
    }
}

/// The list of the regions of a live frame.
struct Regions<'a>(&'a protocol::Live);

impl Serialize for Regions<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut list = serializer.serialize_seq(Some(self.0.regions.len()))?;
        (0..self.0.regions.len()).try_for_each(|i| list.serialize_element(&RegionOf(self.0, i)))?;
        list.end()
    }
}

/// The region with this index in a live frame.
struct RegionOf<'a>(&'a protocol::Live, usize);

impl Serialize for RegionOf<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self(live, i) = *self;
        let mut map = serializer.serialize_map(None)?;
        serialize_quantities(&mut map, LiveRegion::QUANTITIES, &live.regions[i])?;
        for flag in protocol::Live::FLAGS {
            map.serialize_entry(flag.name, &flag.is_set(live, i))?;
        }
        map.end()
    }
}

/// Serialises the quantities of a part of a message: a live frame, its region or a contact ellipse. Unlike the quantities of a
/// step, they have no nested keys. A quantity without a value is null, such as the centre of pressure of a lifted foot.
fn serialize_quantities<T, M: SerializeMap>(map: &mut M, quantities: &[Quantity<T>], part: &T) -> Result<(), M::Error> {
    quantities.iter().try_for_each(|quantity| match quantity.per_unit {
        1 => map.serialize_entry(quantity.key, &(quantity.value)(part)),
        _ => map.serialize_entry(quantity.key, &quantity.in_unit(part)),
    })
}

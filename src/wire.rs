//! Messages and bytes.
//!
//! A message is `postcard`; its first byte tells which. On a packet carrier one packet is one message; on a byte carrier a
//! frame is the message and its CRC-32 (little endian), COBS-encoded and ended by a zero byte.
//!
//! Version rule: framing, [`Hello`] and [`ToDevice::Connect`] never change. A change of any other message raises
//! [`MAJOR`]; a message added at the end of an enum raises [`MINOR`]. Peers of different majors exchange hellos only.

use crate::contact::ContactRule;
use crate::fault::Faults;
use crate::insole::{RegionLoad, Tissue};
use crate::model::{AB_M2, COEFFICIENT, LENGTH_M, MAX_EXPONENT};
use crate::num::Real;
use crate::region::{Region, Side};
use crate::stance::Rejected;
use crate::step::{RegionStep, StepRecord};
use crate::store::{Contents, Part};
use crate::update;
use core::fmt;
use crc::{CRC_32_ISO_HDLC, Crc};
use heapless::String;
use serde::{Deserialize, Serialize};

/// Protocol version of this build.
pub const MAJOR: u8 = 2;
/// See [`MAJOR`].
pub const MINOR: u8 = 0;

/// Longest message, bytes.
pub const MAX_MESSAGE: usize = 320;
/// Longest frame on a byte carrier: message, CRC, COBS overhead and the zero, bytes.
pub const MAX_FRAME: usize = MAX_MESSAGE + 4 + (MAX_MESSAGE + 4) / 254 + 1 + 1;
/// Longest live frame as a message, bytes.
pub const MAX_LIVE: usize = 84;

/// From the insole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "messages live one at a time, in place")]
pub enum ToHost {
    /// The answer to [`ToDevice::Connect`].
    Hello(Hello),
    /// One frame of a running stream.
    Live(Live),
    /// A step that is not acknowledged yet.
    Step(Step),
    /// Counters, on request.
    Status(Status),
    /// The wearer's parameters in force, on request and once new ones are accepted: live frames after this use them.
    Tissue(Tissue),
    /// The answer to what cannot be done.
    Refused(Refusal),
    /// The answer to [`ToDevice::GetTime`].
    Time {
        /// As it came.
        host_us: u64,
        /// When the request arrived: time since the first scan, as in [`Live::t_us`], us.
        device_us: u64,
    },
    /// The answer to [`ToDevice::GetFaults`].
    Faults(Faults),
    /// What is kept of the insole itself, on request and once it is kept.
    Identity(Identity),
    /// A part of a calibration is kept.
    CalibrationPart {
        /// Its number.
        part: u8,
    },
    /// The answer to [`ToDevice::Update`].
    Update(update::Progress),
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
}

/// To the insole.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "messages live one at a time, in place")]
pub enum ToDevice {
    /// Opens a session: the insole says hello and, to a host of its own major version, replays steps that were never
    /// acknowledged.
    Connect {
        /// The host's [`MAJOR`].
        major: u8,
        /// The host's [`MINOR`].
        minor: u8,
    },
    /// Turns the live stream on or off.
    Stream {
        /// On?
        live: bool,
    },
    /// All steps up to and with this number arrived and are stored.
    Acknowledge {
        /// Step number.
        step: u32,
    },
    /// Asks for [`Status`].
    GetStatus,
    /// Replaces the wearer's parameters; answered, once they are kept, by [`ToHost::Tissue`], or by [`ToHost::Refused`].
    SetTissue(Tissue),
    /// Asks for [`ToHost::Tissue`].
    GetTissue,
    /// Asks for [`ToHost::Time`]. With several, a host finds offset and drift of the insole's clock.
    GetTime {
        /// The host's time; comes back unchanged.
        host_us: u64,
    },
    /// Sets the wall clock until the insole restarts.
    SetClock {
        /// Time since 1970, UTC, us.
        unix_us: u64,
    },
    /// Asks for [`ToHost::Faults`].
    GetFaults,
    /// Asks for [`ToHost::Identity`].
    GetIdentity,
    /// Names the insole, from its next start on; answered by [`ToHost::Identity`] once it is kept.
    SetIdentity {
        /// The foot.
        side: Side,
        /// The serial number.
        serial: Serial,
    },
    /// Part of a calibration, to be kept but not yet used; answered by [`ToHost::CalibrationPart`].
    SetCalibrationPart {
        /// Its number: it begins with cell `part` times [`crate::store::PART_CELLS`].
        part: u8,
        /// Calibrations of its cells; those beyond the last cell are not used.
        cells: Part,
    },
    /// Uses the calibration whose parts were kept from the next start on; answered by [`ToHost::Identity`].
    SetCalibration {
        /// The layout it was measured on, as in [`Hello::layout_id`].
        layout_id: u32,
        /// Number of cells.
        cells: u16,
        /// Its checksum; see [`crate::store::CalibrationId`].
        id: u32,
    },
    /// Restarts the insole; there is no answer.
    Restart,
    /// A step of a firmware update; answered by [`ToHost::Update`] or [`ToHost::Refused`].
    Update(update::Request),
}

/// Why an insole did not do what it was told; all stays as it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// A frame arrived whole and holds no message that this firmware knows.
    NotUnderstood,
    /// The id of the parameters is not the checksum of their values.
    TissueId,
    /// This region's parameters are out of bounds; see [`crate::model::Gauge::is_valid`].
    Tissue(Region),
    /// It holds until the next start only: the flash chip failed.
    NotKept,
    /// The last request of this kind is not answered yet.
    Busy,
    /// A serial number with other than printable ASCII characters.
    Serial,
    /// A calibration out of bounds, of another layout, or whose parts are not all there.
    Calibration,
    /// The image is not taken.
    Update(update::Refusal),
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotUnderstood => f.write_str("a message was not understood: update the insole's firmware"),
            Self::NotKept => f.write_str("the insole could not keep it, its flash chip failed: what was sent holds until it restarts"),
            Self::Busy => f.write_str("the insole is still keeping what came before: wait for its answer"),
            Self::Serial => f.write_str("a serial number has up to 16 letters, digits or signs"),
            Self::Calibration => f.write_str(
                "the calibration is out of bounds, of another layout, or not whole: it needs one line a cell, gains from 0.1 to 10 and offsets in the lower half of the scale",
            ),
            Self::TissueId => f.write_str("the parameters do not match their id, some were damaged: send them again"),
            Self::Tissue(region) => write!(
                f,
                "parameters of {} out of bounds: needs A B from {:e} to {:e} m2, C from {:e} to {:e} m, K and G from {} to {:e} Pa and Pa s, n and m above -1 and up to {MAX_EXPONENT}",
                region.name(),
                AB_M2.start(),
                AB_M2.end(),
                LENGTH_M.start(),
                LENGTH_M.end(),
                COEFFICIENT.start(),
                COEFFICIENT.end(),
            ),
            Self::Update(refusal) => refusal.fmt(f),
        }
    }
}

impl core::error::Error for Refusal {}

/// Who speaks. This message never changes, nor do [`ContactRule`] and [`Reset`] within it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// Protocol version of the insole.
    pub major: u8,
    /// Protocol version of the insole.
    pub minor: u8,
    /// Firmware version.
    pub firmware: String<16>,
    /// Board name.
    pub board: String<16>,
    /// Foot.
    pub side: Side,
    /// Identifies the layout.
    pub layout_id: u32,
    /// Number of cells.
    pub cells: u16,
    /// Time between frames, us.
    pub period_us: u32,
    /// Identifies the wearer's parameters; 0 without any.
    pub tissue_id: u32,
    /// The rule that areas are counted by.
    pub contact_rule: ContactRule,
    /// Why the insole last started.
    pub reset: Reset,
    /// What ended the start before, when, and where the program was, as `cargo xtask explain` reads it, and whether this start is
    /// a fallback; or why the set-up of this start was refused.
    pub last_panic: Option<String<96>>,
}

/// Why an insole started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Reset {
    /// Power came on, or dipped.
    Power,
    /// The reset pin.
    Pin,
    /// The software asked for it.
    Software,
    /// Scan, model or link stood still.
    Watchdog,
    /// After a panic, a hard fault or a stack that was too deep; see [`Hello::last_panic`].
    Panic,
    /// None of these.
    Unknown,
}

impl Reset {
    /// One word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Power => "power",
            Self::Pin => "pin",
            Self::Software => "software",
            Self::Watchdog => "watchdog",
            Self::Panic => "panic",
            Self::Unknown => "unknown",
        }
    }
}

/// What is kept of the insole itself; a change is in force from its next start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// The foot.
    pub side: Side,
    /// The serial number.
    pub serial: Serial,
    /// Identifies the cells' calibration; 0 where the built-in one is in force.
    pub calibration_id: u32,
}

/// A serial number: up to 16 printable ASCII characters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Serial([u8; 16]);

impl Serial {
    /// None given.
    pub const NONE: Self = Self([0; 16]);

    /// True where it holds printable ASCII and after that nothing.
    pub fn is_valid(&self) -> bool {
        self.0.iter().skip(self.as_str().len()).all(|byte| *byte == 0)
    }

    /// `None` where `text` is longer or holds anything else.
    pub fn new(text: &str) -> Option<Self> {
        let mut serial = Self::default();
        let printable = text.bytes().all(|byte| byte.is_ascii_graphic());
        serial.0.get_mut(..text.len()).filter(|_| printable)?.copy_from_slice(text.as_bytes());
        Some(serial)
    }

    /// The text; empty where an insole was given none.
    pub fn as_str(&self) -> &str {
        let len = self.0.iter().take_while(|byte| byte.is_ascii_graphic()).count();
        // Printable ASCII is UTF-8.
        core::str::from_utf8(&self.0[..len]).unwrap_or_default()
    }
}

/// One frame: 8 regions in the order of [`crate::Region::ALL`].
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Live {
    /// Counts the frames of the stream; a gap is a frame that was dropped or lost on the way.
    pub sequence: u32,
    /// Time of the scan since the first scan, us.
    pub t_us: u64,
    /// Bit i: a cell of region i is saturated.
    pub saturated: u8,
    /// Bit i: region i's contact exceeds its ellipsoid.
    pub clamped: u8,
    /// Bit i: region i has masked cells.
    pub masked: u8,
    /// The regions.
    #[serde(with = "live_regions")]
    pub regions: [LiveRegion; 8],
}

/// One region of a [`Live`] frame in scaled integers.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct LiveRegion {
    /// Contact area, mm2.
    pub area_mm2: u16,
    /// Tissue deformation, um.
    pub deformation_um: u16,
    /// Model force, 0.1 N.
    pub model_dn: u16,
    /// Measured force, 0.1 N.
    pub measured_dn: u16,
}

/// The regions of a [`Live`] frame as one run of bytes, two for each number, little endian: number by number is slower.
mod live_regions {
    use super::LiveRegion;
    use core::fmt;
    use serde::de::{Error, Visitor};
    use serde::{Deserializer, Serializer};

    const REGION: usize = 8;

    pub fn serialize<S: Serializer>(regions: &[LiveRegion; 8], serializer: S) -> Result<S::Ok, S::Error> {
        let mut bytes = [0; 8 * REGION];
        for (place, region) in bytes.chunks_exact_mut(REGION).zip(regions) {
            let LiveRegion { area_mm2, deformation_um, model_dn, measured_dn } = *region;
            for (place, number) in place.chunks_exact_mut(2).zip([area_mm2, deformation_um, model_dn, measured_dn]) {
                place.copy_from_slice(&number.to_le_bytes());
            }
        }
        serializer.serialize_bytes(&bytes)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[LiveRegion; 8], D::Error> {
        struct Regions;

        impl Visitor<'_> for Regions {
            type Value = [LiveRegion; 8];

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("eight regions of eight bytes")
            }

            fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Self::Value, E> {
                if bytes.len() != 8 * REGION {
                    return Err(E::invalid_length(bytes.len(), &self));
                }
                let number = |i: usize| u16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]);
                Ok(core::array::from_fn(|i| LiveRegion {
                    area_mm2: number(4 * i),
                    deformation_um: number(4 * i + 1),
                    model_dn: number(4 * i + 2),
                    measured_dn: number(4 * i + 3),
                }))
            }
        }

        deserializer.deserialize_bytes(Regions)
    }
}

impl Live {
    /// Rounds one frame to the wire's units; `masked` is [`crate::insole::Insole::masked`].
    pub fn new<R: Real>(sequence: u32, t_us: u64, loads: &[RegionLoad<R>; 8], masked: u8) -> Self {
        let mut live = Self { sequence, t_us, masked, ..Self::default() };
        for (i, (region, load)) in live.regions.iter_mut().zip(loads).enumerate() {
            live.saturated |= u8::from(load.frame.saturated) << i;
            live.clamped |= u8::from(load.tissue.clamped) << i;
            *region = LiveRegion {
                area_mm2: load.frame.area.area_mm2::<R>().round_u16(),
                deformation_um: (load.tissue.deformation_m * R::of(1e6)).round_u16(),
                model_dn: (load.tissue.model_n * R::of(10.0)).round_u16(),
                measured_dn: (load.frame.force.force_n * R::of(10.0)).round_u16(),
            };
        }
        live
    }
}

/// A [`StepRecord`] in scaled integers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Counts steps; goes on after a start, as long as the flash chip is the same.
    pub step: u32,
    /// Foot.
    pub side: Side,
    /// Time of the first loaded frame since the first scan, us.
    pub start_us: u64,
    /// Heel strike to toe off, us.
    pub duration_us: u32,
    /// Time between samples that the step was computed from, us.
    pub sample_us: u32,
    /// Frames that were missing and bridged.
    pub bridged_frames: u16,
    /// Bit i: a cell of region i was saturated: its forces are lower bounds.
    pub saturated: u8,
    /// Bit i: region i's contact exceeded its ellipsoid.
    pub clamped: u8,
    /// The rule that areas were counted by.
    pub contact_rule: ContactRule,
    /// The regions, in the order of [`crate::Region::ALL`].
    pub regions: [StepRegion; 8],
    /// Starts of the insole since the one that this step was made in; `start_us` counts from that one.
    pub starts_ago: u32,
    /// `start_us` on the wall clock, us since 1970, UTC; `None` where that was not set then.
    pub start_unix_us: Option<u64>,
}

/// One region of a [`Step`].
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct StepRegion {
    /// Largest measured force, 0.1 N.
    #[serde(with = "postcard::fixint::le")]
    pub measured_peak_dn: u16,
    /// Largest model force, 0.1 N.
    #[serde(with = "postcard::fixint::le")]
    pub model_peak_dn: u16,
    /// Force-time integral of the measured force, 0.01 N s.
    #[serde(with = "postcard::fixint::le")]
    pub measured_integral_cns: u16,
    /// Force-time integral of the model force, 0.01 N s.
    #[serde(with = "postcard::fixint::le")]
    pub model_integral_cns: u16,
    /// Largest contact area, mm2.
    #[serde(with = "postcard::fixint::le")]
    pub area_peak_mm2: u16,
    /// Largest deformation, um.
    #[serde(with = "postcard::fixint::le")]
    pub deformation_peak_um: u16,
    /// Largest loading rate of the deformation, 0.1 mm/s.
    #[serde(with = "postcard::fixint::le")]
    pub deformation_rate_peak_dmm_s: u16,
    /// Contact time, ms.
    #[serde(with = "postcard::fixint::le")]
    pub contact_ms: u16,
    /// Time from first contact to the largest measured force, ms.
    #[serde(with = "postcard::fixint::le")]
    pub time_to_peak_ms: u16,
    /// Centre of the contact ellipse then, foot coordinates, 0.1 mm.
    #[serde(with = "postcard::fixint::le")]
    pub ellipse_x_dmm: i16,
    /// See `ellipse_x_dmm`.
    #[serde(with = "postcard::fixint::le")]
    pub ellipse_y_dmm: i16,
    /// Its radii, 0.01 mm; 0 without contact.
    #[serde(with = "postcard::fixint::le")]
    pub ellipse_r_a_cmm: u16,
    /// See `ellipse_r_a_cmm`.
    #[serde(with = "postcard::fixint::le")]
    pub ellipse_r_b_cmm: u16,
    /// Its angle, 0.1 degrees.
    #[serde(with = "postcard::fixint::le")]
    pub ellipse_angle_ddeg: i16,
    /// Model against measured force (Eq. 20), 0.01 %.
    #[serde(with = "postcard::fixint::le")]
    pub model_error_bp: u16,
    /// Masked cells at toe off; 255 for more.
    pub masked_cells: u8,
}

impl Step {
    /// Rounds a step of the running start to the wire's units.
    pub fn new<R: Real>(record: &StepRecord<R>) -> Self {
        let clamped = record.regions.iter().enumerate().fold(0, |bits, (i, r)| bits | u8::from(r.clamped) << i);
        Self {
            step: record.step,
            side: record.side,
            start_us: record.start_us,
            duration_us: record.duration_us,
            sample_us: record.sample_us,
            bridged_frames: record.bridged_frames,
            saturated: record.saturated,
            clamped,
            contact_rule: record.contact_rule,
            regions: record.regions.each_ref().map(StepRegion::new),
            starts_ago: 0,
            start_unix_us: None,
        }
    }
}

impl StepRegion {
    fn new<R: Real>(region: &RegionStep<R>) -> Self {
        let scaled = |value: R, units: f64| (value * R::of(units)).round_u16();
        let mut wire = Self {
            measured_peak_dn: scaled(region.measured_peak_n, 10.0),
            model_peak_dn: scaled(region.model_peak_n, 10.0),
            measured_integral_cns: scaled(region.measured_integral_n_s, 100.0),
            model_integral_cns: scaled(region.model_integral_n_s, 100.0),
            area_peak_mm2: scaled(region.area_peak_mm2, 1.0),
            deformation_peak_um: scaled(region.deformation_peak_m, 1e6),
            deformation_rate_peak_dmm_s: scaled(region.deformation_rate_peak_m_s, 1e4),
            contact_ms: scaled(region.contact_s, 1e3),
            time_to_peak_ms: scaled(region.time_to_peak_s, 1e3),
            model_error_bp: scaled(region.model_error, 1e4),
            masked_cells: region.masked_cells,
            ..Self::default()
        };
        if let Some(ellipse) = &region.ellipse_at_peak {
            wire.ellipse_x_dmm = (ellipse.x_mm * R::of(10.0)).round_i16();
            wire.ellipse_y_dmm = (ellipse.y_mm * R::of(10.0)).round_i16();
            wire.ellipse_r_a_cmm = scaled(ellipse.r_a_mm, 100.0);
            wire.ellipse_r_b_cmm = scaled(ellipse.r_b_mm, 100.0);
            wire.ellipse_angle_ddeg = (ellipse.angle_deg() * 10.0).round_i16();
        }
        wire
    }
}

/// Counters since start; all wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Time since start, us.
    pub uptime_us: u64,
    /// Frames processed, with the steps that ended in them.
    pub frames: u32,
    /// Frame times that passed without a complete scan: late, or the matrix did not answer.
    pub frames_missed: u32,
    /// Scanned frames that processing had no room for.
    pub frames_overrun: u32,
    /// Live frames that were due in this session.
    pub live_due: u32,
    /// Live frames given to the carrier in this session.
    pub live_sent: u32,
    /// Steps completed since start.
    pub steps: u32,
    /// Unacknowledged steps that had to make room for newer ones.
    pub steps_dropped: u32,
    /// Contacts that did not become steps.
    pub rejected: Rejected,
    /// Frames received with a wrong CRC or no known message.
    pub bad_frames: u32,
    /// Processor cycles of a frame with the foot on the ground, codes to encoded live message: least and most so far.
    pub frame_cycles: (u32, u32),
    /// Deepest use of the main stack so far, bytes.
    pub stack_bytes: u32,
    /// Faults of the sensor found since start; see [`ToDevice::GetFaults`].
    pub faults: u32,
    /// How often an unloaded cell's zero was followed.
    pub rezeroed: u32,
    /// What could not be kept.
    pub unkept: u32,
    /// What the flash chip holds.
    pub contents: Contents,
}

/// A message does not fit its buffer, which cannot happen with [`MAX_MESSAGE`] bytes.
pub type EncodeError = postcard::Error;

/// Writes a message, unframed; returns the used part of `buffer`.
pub fn encode<'b, T: Serialize>(message: &T, buffer: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
    postcard::to_slice(message, buffer)
}

/// Reads an unframed message; `None` for anything else than exactly one.
pub fn decode<'b, T: Deserialize<'b>>(bytes: &'b [u8]) -> Option<T> {
    match postcard::take_from_bytes(bytes) {
        Ok((message, [])) => Some(message),
        _ => None,
    }
}

const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// The CRC-32 of the frames, also for ids made from content.
pub fn checksum(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes)
}

/// Frames an encoded message of at most [`MAX_MESSAGE`] bytes for a byte carrier; returns the bytes used.
pub fn frame(message: &[u8], out: &mut [u8; MAX_FRAME]) -> usize {
    let mut encoder = cobs::CobsEncoder::new(out);
    // Neither push nor finish can fail: MAX_FRAME has room for MAX_MESSAGE, and a longer message is cut here, where the
    // receiver will see a bad CRC instead of this device a panic.
    let message = &message[..message.len().min(MAX_MESSAGE)];
    let _ = encoder.push(message);
    let _ = encoder.push(&checksum(message).to_le_bytes());
    let end = encoder.finalize();
    out[end] = 0;
    end + 1
}

/// Finds messages in a stream of bytes. Anything wrong is counted and ends at the next zero byte.
#[derive(Debug)]
pub struct Decoder {
    buffer: [u8; MAX_FRAME],
    len: usize,
    /// Frames whose COBS or CRC was wrong, or that were too long.
    pub bad_frames: u32,
}

impl Decoder {
    /// A decoder at the start of a stream.
    pub const fn new() -> Self {
        Self { buffer: [0; MAX_FRAME], len: 0, bad_frames: 0 }
    }

    /// Takes one byte; the message, unframed, when it completes one.
    pub fn push(&mut self, byte: u8) -> Option<&[u8]> {
        if byte != 0 {
            // One past the end marks a frame that is too long.
            if let Some(slot) = self.buffer.get_mut(self.len) {
                *slot = byte;
            }
            self.len = (self.len + 1).min(MAX_FRAME + 1);
            return None;
        }
        let len = core::mem::take(&mut self.len);
        if len == 0 {
            return None;
        }
        let message_len = self.buffer.get_mut(..len).and_then(unframe);
        if message_len.is_none() {
            self.bad_frames = self.bad_frames.wrapping_add(1);
        }
        message_len.map(|len| &self.buffer[..len])
    }
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

/// Decodes in place and checks the CRC; length of the message.
fn unframe(frame: &mut [u8]) -> Option<usize> {
    let len = cobs::decode_in_place(frame).ok()?;
    let (message, crc) = frame.get(..len)?.split_last_chunk::<4>()?;
    (checksum(message) == u32::from_le_bytes(*crc)).then_some(message.len())
}

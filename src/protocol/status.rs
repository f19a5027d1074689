//! Counters and state of an insole.

use crate::pipeline::stance_rule::Rejected;
use serde::{Deserialize, Serialize};

/// Smallest supply with which an insole writes to its flash chip, mV; with less, it stores nothing. The flash chips of all
/// boards work at 2.7 V and above.
pub const SUFFICIENT_SUPPLY_MV: u16 = 2_800;

/// Counters and state of an insole. Unless stated otherwise, counters begin with 0 when the insole starts, and wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Time since the start, us.
    pub uptime_us: u64,
    /// Number of processed frames. The frame that completes a load record, and the frames after it, are counted only once the
    /// record is stored: so a host that receives this number has received, or will receive, all load records of these frames.
    pub frames: u32,
    /// Number of frame times without a complete scan, because the scan was late or the matrix did not answer.
    pub frames_missed: u32,
    /// Number of frames that were not scanned because the queue to processing was full.
    pub frames_overrun: u32,
    /// Number of live frames that were due in this session, without those that still wait for the carrier.
    pub live_due: u32,
    /// Number of live frames that were passed to the carrier in this session.
    pub live_sent: u32,
    /// Number of steps completed since the start.
    pub steps: u32,
    /// Number of unacknowledged load records that were dropped.
    pub records_dropped: u32,
    /// Number of contacts that did not become steps.
    pub rejected: Rejected,
    /// Number of frames on the serial port, or values over Bluetooth, that arrived with a wrong CRC or without a known message.
    pub bad_frames: u32,
    /// Smallest and largest number of processor cycles so far for a frame with the foot on the ground, from codes to encoded live
    /// message, with the packing of its cells while they are streamed; `(u32::MAX, 0)` before the first such frame.
    pub frame_cycles: (u32, u32),
    /// Deepest use of the main stack so far, bytes.
    pub stack_bytes: u32,
    /// Number of sensor faults detected since the start; see [`super::ToDevice::GetFaults`].
    pub faults: u32,
    /// Number of baseline corrections of unloaded cells.
    pub rezeroed: u32,
    /// Number of items that could not be stored: load records, acknowledgements, and others such as settings and bonds.
    pub not_stored: u32,
    /// Contents of the flash chip.
    pub contents: Contents,
    /// The wall clock is set. A restart loses it.
    pub is_clock_set: bool,
    /// Identifies the key with which updates must be signed, by its first four bytes.
    pub update_key: u32,
    /// The insole is worn: every frame is scanned. An insole that was not loaded for a minute, streams no cells and measures no
    /// baselines counts as not worn, and scans two frames a second until one of these changes.
    pub is_worn: bool,
    /// Number of frames that were not scanned because the insole was not worn.
    pub frames_skipped: u32,
    /// Time since the start in which the matrix was scanned, ms.
    pub scanning_ms: u32,
    /// Time since the start in which frames were evaluated, ms; without the evaluation of steps.
    pub processing_ms: u32,
    /// Supply of the controller, mV; `None` if the board does not measure it. See [`SUFFICIENT_SUPPLY_MV`].
    pub supply_mv: Option<u16>,
    /// State of the Bluetooth radio.
    pub radio: Radio,
}

/// State of the Bluetooth radio.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Radio {
    /// It has executed no command since the start: in the first seconds, after repeated stalls in the first hour, and on a board
    /// without Bluetooth.
    #[default]
    Silent,
    /// It executes commands.
    Answers,
    /// The firmware of the radio is missing.
    NoFirmware,
    /// It does not start. The number is the vendor's code, 0 without one.
    Failed(u8),
}

impl Status {
    /// True if the insole has restarted since it sent the status `before`. Without working storage the number of boots does not
    /// change, but the uptime does.
    pub fn is_after_restart(&self, before: &Self) -> bool {
        self.contents.start != before.contents.start || self.uptime_us < before.uptime_us
    }

    /// Number of frame times since the first scan, whether their frames were processed or not; wraps.
    pub fn frame_times(&self) -> u32 {
        let Self { frames, frames_missed, frames_overrun, frames_skipped, .. } = *self;
        frames.wrapping_add(frames_missed).wrapping_add(frames_overrun).wrapping_add(frames_skipped)
    }
}

/// The contents of the flash chip, as far as they are known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Contents {
    /// Number of the present boot, from 1; 0 if it is unknown, as without a chip and in recovery mode.
    pub start: u32,
    /// Number of the next load record, according to the log.
    pub next_record: u32,
    /// Bit k: records of kind k exist in a newer format than this firmware knows. They are not changed.
    pub newer_kinds: u32,
    /// Number of entries in a newer format than this firmware knows, among the entries that were counted at the start: those in
    /// the newest sectors of the log, or all. At least 1 if the oldest entry of the log has a newer format. Entries in a newer
    /// format are not changed until the log is full.
    pub newer_records: u32,
    /// Number of areas of the chip (that of the records, that of the log) that were damaged beyond repair and erased at this
    /// start.
    pub erased: u32,
    /// Number of times at this start that a repeated survey of the chip gave another result than the survey before it. A survey
    /// reads the records and parts of the log. The chip is used once two successive surveys agree.
    pub contradictions: u32,
}

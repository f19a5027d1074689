//! Counters of an insole.

use crate::pipeline::stance::Rejected;
use serde::{Deserialize, Serialize};

/// Counters since the start; all wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Time since the start, us.
    pub uptime_us: u64,
    /// Processed frames, together with the steps that ended in them.
    pub frames: u32,
    /// Frame times that passed without a complete scan: late, or the matrix did not answer.
    pub frames_missed: u32,
    /// Scanned frames that were dropped because processing was behind.
    pub frames_overrun: u32,
    /// Live frames that were due in this session.
    pub live_due: u32,
    /// Live frames given to the carrier in this session.
    pub live_sent: u32,
    /// Steps completed since the start.
    pub steps: u32,
    /// Unacknowledged steps that were dropped in favour of newer ones.
    pub steps_dropped: u32,
    /// Contacts that did not become steps.
    pub rejected: Rejected,
    /// Frames received with a wrong CRC or no known message.
    pub bad_frames: u32,
    /// Processor cycles of a frame with the foot on the ground, from codes to encoded live message: smallest and largest so far.
    pub frame_cycles: (u32, u32),
    /// Deepest use of the main stack so far, bytes.
    pub stack_bytes: u32,
    /// Sensor faults detected since the start; see [`super::ToDevice::GetFaults`].
    pub faults: u32,
    /// Number of zero corrections of unloaded cells.
    pub rezeroed: u32,
    /// Records, steps and acknowledgements that could not be stored.
    pub not_stored: u32,
    /// Contents of the flash chip.
    pub contents: Contents,
}

/// The contents of the flash chip, as far as they are known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Contents {
    /// Number of the present boot, from 1.
    pub start: u32,
    /// Number of the next step, as far as the step log shows.
    pub next_step: u32,
    /// Bit k: records of kind k have a newer version than this firmware knows. They are not changed.
    pub newer_kinds: u32,
    /// Entries of the step log with a newer version. They are not changed until the log is full.
    pub newer_steps: u32,
    /// Areas that were damaged beyond repair and had to be erased.
    pub erased: u32,
}

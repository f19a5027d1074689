//! Counters of a link, for users and for `--json`.

use serde::Serialize;

/// Counters of a link, as `--json` writes them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LinkCounters {
    /// Live frames that the insole passed to the carrier, by its own count.
    pub frames_sent: u32,
    /// Live frames that arrived undamaged.
    pub frames_received: u32,
    /// Live frames missing between those that arrived.
    pub frames_lost: u32,
    /// Frames of any kind with a wrong CRC or without a known message.
    pub crc_errors: u32,
}

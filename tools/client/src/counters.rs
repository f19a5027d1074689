//! Counters of a link, for users and for `--json`.

use serde::Serialize;

/// Counters of a link, as `--json` writes them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LinkCounters {
    /// Live frames that the insole passed to its serial port or radio in the latest session, by its own count in its last status.
    pub frames_sent: u32,
    /// Live frames that arrived undamaged in all sessions of the link.
    pub frames_received: u32,
    /// Live frames that were lost in all sessions of the link, found by gaps in their numbers and by the insole's own count.
    pub frames_lost: u32,
    /// Damaged frames of any kind: frames with a wrong CRC or without a known message. The name, which is also the key in the
    /// files of `--json`, describes only the first kind.
    pub crc_errors: u32,
}

//! The host's side of a session with an insole, over any carrier of messages.

mod alert;
#[cfg(feature = "ble")]
pub mod ble;
mod carrier;
mod cells;
mod clock_mapping;
mod commands;
mod counters;
mod delivered;
mod error;
mod file;
pub mod gait;
mod json;
mod link;
mod order;
mod read_ahead;
mod session;
mod stream_file;
mod update;

pub use alert::{alert_advice, alert_to_json, daily_load_to_json};
pub use carrier::{Carrier, Framed, READ_TIMEOUT};
pub use cells::{CellReceiver, StartedCells};
pub use clock_mapping::{ClockMapping, are_feet_comparable};
pub use counters::LinkCounters;
pub use error::Error;
pub use file::{create_or_open_empty, reserve, sync_data};
pub use json::{bout_to_json, step_to_json};
pub use link::{Event, Link, Meanwhile, Open, ReconnectPolicy, SessionStart};
pub use order::{Arrival, RecordOrder};
pub use read_ahead::ReadAhead;
pub use session::Client;
pub use stream_file::{DamagedAt, Entries, Entry, STREAM_INSOLES, StreamFile, append};

use std::time::{SystemTime, UNIX_EPOCH};

/// This computer's clock, us since 1970, UTC.
pub fn unix_us() -> u64 {
    // A clock before 1970 is as wrong as one that shows 1970.
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_micros() as u64)
}

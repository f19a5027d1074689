//! The alert as a message. The macro `quantities` in `quantities.rs` documents the form of the declaration.

use super::quantities::quantities;
use crate::pipeline::alert::AlertRecord;
use crate::pipeline::region::Side;
use serde::{Deserialize, Serialize};

quantities! {
    /// An [`AlertRecord`].
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub struct Alert {
        /// Number of the record.
        number: u32 = record.number
            => number [1 per "count"],
            "Steps, load bouts and alerts are numbered together; the number continues after a restart.";
        /// Foot.
        side: Side = record.side;
        /// Time of the alert, since the first scan.
        start_us: u64 = record.start_us
            => start_s [1_000_000 per "s"],
            "End of the second in which the insole raised the alert; a pause or a snooze delays it after the limit was reached.";
        /// The region is under sustained load.
        sustained: u8 = record.sustained,
            flags "The largest cell pressure of the region reached the limit for the set share of the window; no relief since.";
        /// The dose of the region has reached the limit of the day, and no earlier alert of this day has reported it.
        dose: u8 = record.dose,
            flags "Time integral of the excess of the largest cell pressure over the pressure limit of the dose.";
        /// Length of the window of sustained load.
        window_s: u16 = record.window_s
            => window_s [1 per "s"],
            "Set by the rules of alerts.";
        /// Number of alerts on this day, including this one.
        today: u8 = record.today
            => today [1 per "count"],
            "Counted by the insole.";
        /// Boots of the insole since the one that recorded this alert; `start_s` counts from that boot.
        boots_since: u32 = 0
            => boots_since [1 per "count"],
            "Counted by the insole.";
        /// `start_us` on the wall clock (UTC; local time if Current Time has set it), us since 1970; `None` if it was not set.
        start_unix_us: Option<u64> = None;
    }

    /// An alert of the running boot.
    pub fn new(record: &AlertRecord);
}

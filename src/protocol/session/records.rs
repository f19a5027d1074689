//! The load records of a session that wait for the host.

use super::Session;
use crate::protocol::LoadRecord;

impl Session {
    /// Number of the last record that was acknowledged since the last call.
    pub fn take_acknowledged(&mut self) -> Option<u32> {
        self.acknowledged.take()
    }

    /// Number of the last record that was acknowledged, if [`Session::take_acknowledged`] has not returned it yet.
    pub fn acknowledged(&self) -> Option<u32> {
        self.acknowledged
    }

    /// True if a record can be added without dropping another one.
    pub fn has_room(&self) -> bool {
        !self.records.is_full()
    }

    /// True if the record with this number was sent in this session, and is not acknowledged yet.
    pub fn has_sent(&self, number: u32) -> bool {
        self.records.iter().take(self.records_sent).any(|record| record.number() == number)
    }

    /// The number of the newest record in RAM.
    pub fn newest_record(&self) -> Option<u32> {
        self.records.back().map(LoadRecord::number)
    }

    /// The records in RAM, oldest first. `plantar serve`, which passes them on, updates their number of boots after a restart.
    pub fn records_mut(&mut self) -> impl Iterator<Item = &mut LoadRecord> {
        self.records.iter_mut()
    }

    /// Counts records that are lost.
    pub fn count_dropped(&mut self, records: u32) {
        self.records_dropped = self.records_dropped.wrapping_add(records);
    }
}

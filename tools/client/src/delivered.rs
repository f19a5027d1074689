//! Remembers the load records that were delivered to the caller, so that each is delivered only once if the insole
//! repeats it.

use plantar::protocol::LoadRecord;
use plantar::protocol::session::RECORD_QUEUE;
use plantar::sequence;
use std::collections::VecDeque;

/// Largest number of records that an insole can send again: those in its RAM, and the same number of earlier ones if a restart
/// has lost their acknowledgements. Only an insole that could not store acknowledgements, as with a low supply, can send more of
/// them again after a restart.
const CAPACITY: usize = 2 * RECORD_QUEUE;

/// The last records that were delivered, oldest first, and for each whether the caller has acknowledged it.
#[derive(Debug, Default)]
pub(crate) struct Delivered(VecDeque<(LoadRecord, bool)>);

impl Delivered {
    pub const fn new() -> Self {
        Self(VecDeque::new())
    }

    /// Whether the caller acknowledged this record; `None` if it is not among the remembered records.
    pub fn is_acknowledged(&self, record: &LoadRecord) -> Option<bool> {
        self.0.iter().find(|(delivered, _)| delivered.is_same(record)).map(|(_, acknowledged)| *acknowledged)
    }

    pub fn push(&mut self, record: LoadRecord) {
        if self.0.len() == CAPACITY {
            self.0.pop_front();
        }
        self.0.push_back((record, false));
    }

    /// Forgets the records that the caller has not acknowledged.
    pub fn forget_unacknowledged(&mut self) {
        self.0.retain(|(_, acknowledged)| *acknowledged);
    }

    /// Marks all remembered records up to and including this number as acknowledged.
    pub fn acknowledge(&mut self, number: u32) {
        for (record, acknowledged) in &mut self.0 {
            *acknowledged |= !sequence::is_after(record.number(), number);
        }
    }
}

//! Checks the order of the load records that arrive, and decides when to request a replay of those that were lost on
//! the way.
//!
//! In a replay, the insole sends all its unacknowledged records again, oldest first.

use plantar::sequence::is_after;

/// Number of replays without the missing record after which the insole is assumed to have dropped it. A damaged link may lose the
/// record in several replays.
const REPLAYS: u8 = 8;

/// The treatment of a record that arrives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Arrival {
    /// It is the next one.
    InOrder,
    /// Records before it are missing. Request a replay and ignore this record, because the replay includes it.
    Gap,
    /// A replay was requested and has not begun. Ignore the record, because the replay includes it.
    Awaited,
}

/// Detects records that were lost on the way. An acknowledgement also covers all earlier ones, so a lost record must arrive
/// before a later one is accepted.
#[derive(Debug, Default)]
pub(crate) struct RecordOrder {
    /// The number after the last accepted record.
    expected: Option<u32>,
    /// When a replay that has not begun yet was requested, by the carrier's clock, us.
    requested_us: Option<u64>,
    /// The first missing number for which replays were requested, and the number of replays that have begun.
    replays: Option<(u32, u8)>,
}

impl RecordOrder {
    /// Decides how to treat a record that was not delivered before.
    pub(crate) fn arrive(&mut self, number: u32) -> Arrival {
        if self.requested_us.is_some() {
            return Arrival::Awaited;
        }
        let missing = self.expected.filter(|&expected| is_after(number, expected));
        let begun = self.replays.filter(|(first, _)| Some(*first) == missing).map_or(0, |(_, begun)| begun);
        if missing.is_some() && begun < REPLAYS {
            return Arrival::Gap;
        }
        self.expected = Some(number.wrapping_add(1));
        Arrival::InOrder
    }

    /// Called when a replay was requested, at `now_us` of the carrier's clock.
    pub(crate) fn request(&mut self, now_us: u64) {
        self.requested_us = Some(now_us);
    }

    /// Called when a session begins, in which the insole sends its unacknowledged records from the oldest on. True if this is the
    /// replay that was requested.
    pub(crate) fn begin(&mut self) -> bool {
        let is_requested = self.requested_us.take().is_some();
        if let Some(expected) = self.expected.filter(|_| is_requested) {
            let begun = self.replays.filter(|(number, _)| *number == expected).map_or(0, |(_, begun)| begun);
            self.replays = Some((expected, begun + 1));
        }
        is_requested
    }

    /// When a replay that has not begun yet was requested, us.
    pub(crate) fn requested_us(&self) -> Option<u64> {
        self.requested_us
    }
}

#[cfg(test)]
mod tests {
    use super::{Arrival, REPLAYS, RecordOrder};

    #[test]
    fn a_gap_is_replayed_once() {
        let mut order = RecordOrder::default();
        assert_eq!([7, 8].map(|step| order.arrive(step)), [Arrival::InOrder; 2]);
        assert_eq!(order.arrive(10), Arrival::Gap);
        order.request(5);
        assert_eq!(order.arrive(11), Arrival::Awaited);
        assert!(order.begin());
        assert_eq!([9, 10, 11].map(|step| order.arrive(step)), [Arrival::InOrder; 3]);
        assert!(!order.begin());
    }

    #[test]
    fn a_step_that_the_insole_dropped_is_not_awaited_without_end() {
        let mut order = RecordOrder::default();
        assert_eq!(order.arrive(u32::MAX), Arrival::InOrder);
        for _ in 0..REPLAYS {
            assert_eq!(order.arrive(3), Arrival::Gap);
            order.request(5);
            assert!(order.begin());
        }
        assert_eq!(order.arrive(3), Arrival::InOrder);
        // The next gap is another one.
        assert_eq!(order.arrive(5), Arrival::Gap);
    }

    #[test]
    fn numbers_of_another_flash_chip_are_no_gap() {
        let mut order = RecordOrder::default();
        assert_eq!([900, 0, 1].map(|step| order.arrive(step)), [Arrival::InOrder; 3]);
    }
}

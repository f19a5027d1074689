//! Checks the order of the load records that arrive, and decides when to request a retransmission of those that were lost on
//! the way.
//!
//! In a retransmission, the insole sends all its unacknowledged records again, oldest first.

use plantar::sequence::is_after;

/// Number of retransmissions without the missing record and without a damaged frame after which the insole is assumed to have
/// dropped the record. A cable that was cut for a moment may have lost the record nevertheless, so one retransmission does not
/// suffice.
const INTACT_RETRANSMISSIONS: u8 = 8;
/// Number of retransmissions after which the insole is assumed to have dropped the record even if each time a damaged frame
/// arrived, which may have contained it. A record of a kind that this program does not know counts as a damaged frame each time
/// it arrives.
const ALL_RETRANSMISSIONS: u8 = 64;

/// The treatment of a record that arrives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival {
    /// Accept it: no record before it is missing, or the missing one is assumed to have been dropped by the insole.
    InOrder,
    /// Records before it are missing or may have been damaged. Request a retransmission and ignore this record, because the
    /// retransmission includes it.
    Gap,
    /// A retransmission was requested and has not begun. Ignore the record, because the retransmission includes it.
    Awaited,
}

/// The retransmissions that were requested for a missing record.
#[derive(Debug)]
struct Retransmissions {
    /// The first missing number.
    missing: u32,
    /// Number of retransmissions without it.
    all: u8,
    /// Number of retransmissions without it in which no damaged frame arrived.
    intact: u8,
    /// Number of damaged frames before the last request. It is recorded with the request, and not when the retransmission begins,
    /// because damaged frames of the retransmission may already be counted while its first messages still wait for the caller.
    damaged_before: u32,
}

/// Detects records that were lost on the way. An acknowledgement also covers all earlier ones, so a lost record must arrive
/// before a later one is accepted.
#[derive(Debug)]
pub struct RecordOrder {
    /// The number after the last accepted record.
    expected: Option<u32>,
    /// When a retransmission that has not begun yet was requested, by the carrier's clock, us.
    requested_us: Option<u64>,
    retransmissions: Option<Retransmissions>,
    /// Number of damaged frames before the last request for a retransmission; 0 before the first request. A damaged frame that
    /// arrived later may have contained the first record.
    damaged_before: u32,
    /// Number of retransmissions that were requested because the first record of a session may have been damaged.
    first_record_requests: u8,
}

impl Default for RecordOrder {
    fn default() -> Self {
        Self::NEW
    }
}

impl RecordOrder {
    /// Before the first record.
    pub const NEW: Self =
        Self { expected: None, requested_us: None, retransmissions: None, damaged_before: 0, first_record_requests: 0 };

    /// Decides how to treat a record that was not delivered before. `damaged` is the number of damaged frames that have arrived.
    pub fn arrive(&mut self, number: u32, damaged: u32) -> Arrival {
        if self.requested_us.is_some() {
            return Arrival::Awaited;
        }
        // The number of the first record is not known, so a gap before this one would not be noticed.
        if self.expected.is_none() && damaged != self.damaged_before && self.first_record_requests < ALL_RETRANSMISSIONS
        {
            self.first_record_requests += 1;
            return Arrival::Gap;
        }
        if let Some(missing) = self.expected.filter(|&expected| is_after(number, expected)) {
            let counts = match self.retransmissions.take().filter(|counts| counts.missing == missing) {
                None => Retransmissions { missing, all: 0, intact: 0, damaged_before: damaged },
                Some(counts) => Retransmissions {
                    all: counts.all + 1,
                    intact: counts.intact + u8::from(counts.damaged_before == damaged),
                    ..counts
                },
            };
            let requests_again = counts.intact < INTACT_RETRANSMISSIONS && counts.all < ALL_RETRANSMISSIONS;
            self.retransmissions = Some(counts);
            if requests_again {
                return Arrival::Gap;
            }
        }
        self.first_record_requests = 0;
        self.expected = Some(number.wrapping_add(1));
        Arrival::InOrder
    }

    /// Called for a record that was delivered before and arrives again. The insole sends it with all unacknowledged records after
    /// it, so the next number is known even if no other record has arrived yet.
    pub fn repeat(&mut self, number: u32) {
        if self.requested_us.is_none() && self.expected.is_none_or(|expected| expected == number) {
            self.expected = Some(number.wrapping_add(1));
        }
    }

    /// Called when a retransmission was requested, at `now_us` of the carrier's clock, after this number of damaged frames.
    pub fn request(&mut self, now_us: u64, damaged: u32) {
        (self.requested_us, self.damaged_before) = (Some(now_us), damaged);
        if let Some(counts) = &mut self.retransmissions {
            counts.damaged_before = damaged;
        }
    }

    /// Called when a session begins, in which the insole sends its unacknowledged records from the oldest on. True if this is the
    /// retransmission that was requested.
    pub fn begin(&mut self) -> bool {
        self.requested_us.take().is_some()
    }

    /// Called when another host receives the records. The next one that arrives here can have any number.
    pub fn interrupt(&mut self) {
        *self = Self { damaged_before: self.damaged_before, ..Self::NEW };
    }

    /// When a retransmission that has not begun yet was requested, us.
    pub fn requested_us(&self) -> Option<u64> {
        self.requested_us
    }
}

#[cfg(test)]
mod tests {
    use super::{ALL_RETRANSMISSIONS, Arrival, INTACT_RETRANSMISSIONS, RecordOrder};

    #[test]
    fn a_missing_record_is_requested_once() {
        let mut order = RecordOrder::default();
        assert_eq!([7, 8].map(|step| order.arrive(step, 0)), [Arrival::InOrder; 2]);
        assert_eq!(order.arrive(10, 0), Arrival::Gap);
        order.request(5, 0);
        assert_eq!(order.arrive(11, 0), Arrival::Awaited);
        assert!(order.begin());
        assert_eq!([9, 10, 11].map(|step| order.arrive(step, 0)), [Arrival::InOrder; 3]);
        assert!(!order.begin());
    }

    /// Requests retransmissions in which record 3 arrives, but not the missing records before it, until record 3 is accepted. In
    /// each retransmission this number of damaged frames arrives. Returns the number of retransmissions.
    fn retransmissions_until_accepted(order: &mut RecordOrder, damaged_frames: u32) -> u8 {
        assert_eq!(order.arrive(u32::MAX, 0), Arrival::InOrder);
        for retransmission in 0.. {
            if order.arrive(3, damaged_frames * u32::from(retransmission)) == Arrival::InOrder {
                return retransmission;
            }
            order.request(5, damaged_frames * u32::from(retransmission));
            assert!(order.begin());
        }
        unreachable!("the number of retransmissions is limited")
    }

    #[test]
    fn a_step_that_the_insole_dropped_is_not_awaited_without_end() {
        let mut order = RecordOrder::default();
        assert_eq!(retransmissions_until_accepted(&mut order, 0), INTACT_RETRANSMISSIONS);
        // The retransmissions of another gap are counted from the start.
        assert_eq!(order.arrive(5, 0), Arrival::Gap);
    }

    #[test]
    fn a_step_that_may_have_been_damaged_is_requested_more_often() {
        assert_eq!(retransmissions_until_accepted(&mut RecordOrder::default(), 2), ALL_RETRANSMISSIONS);
    }

    #[test]
    fn a_record_is_missing_after_one_that_was_delivered_before() {
        let mut order = RecordOrder::default();
        order.repeat(5);
        assert_eq!(order.arrive(7, 0), Arrival::Gap);
        order.request(5, 0);
        order.repeat(5);
        assert!(order.begin());
        order.repeat(5);
        assert_eq!([6, 7].map(|step| order.arrive(step, 0)), [Arrival::InOrder; 2]);
        order.interrupt();
        [3, 4, 5].into_iter().for_each(|step| order.repeat(step));
        assert_eq!([6, 8].map(|step| order.arrive(step, 0)), [Arrival::InOrder, Arrival::Gap]);
    }

    #[test]
    fn the_first_record_of_a_session_is_requested_again_if_it_may_have_been_damaged() {
        let mut order = RecordOrder::default();
        // Record 4 arrives after a damaged frame, which was record 3. The retransmission is damaged, too.
        for damaged in [1, 2] {
            assert_eq!(order.arrive(4, damaged), Arrival::Gap);
            order.request(5, damaged);
            assert_eq!(order.arrive(5, damaged), Arrival::Awaited);
            assert!(order.begin());
        }
        assert_eq!([3, 4, 5].map(|step| order.arrive(step, 2)), [Arrival::InOrder; 3]);
        // The same applies to the first record after another host.
        order.interrupt();
        assert_eq!(order.arrive(9, 3), Arrival::Gap);
        // A record that this program does not know counts as a damaged frame each time it arrives.
        let mut order = RecordOrder::default();
        let is_accepted = (1..=u32::MAX).take(100).position(|damaged| {
            let arrival = order.arrive(4, damaged);
            if arrival == Arrival::Gap {
                order.request(5, damaged);
                order.begin();
            }
            arrival == Arrival::InOrder
        });
        assert_eq!(is_accepted, Some(ALL_RETRANSMISSIONS.into()));
    }

    #[test]
    fn numbers_of_another_flash_chip_are_no_gap() {
        let mut order = RecordOrder::default();
        assert_eq!([900, 0, 1].map(|step| order.arrive(step, 0)), [Arrival::InOrder; 3]);
    }
}

//! The order of the steps that arrive, and the replay of those that were lost on the way.

use plantar::sequence::is_after;

/// Number of replays without a missing step after which the step counts as dropped by the insole. A damaged link may lose it
/// several times.
const REPLAYS: u8 = 8;

/// The treatment of a step that arrives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Arrival {
    /// It is the next one.
    InOrder,
    /// Steps before it are missing: request a replay, and ignore this step, which the replay includes.
    Gap,
    /// A replay is in progress, which includes it.
    Awaited,
}

/// Finds steps that were lost on the way. An acknowledgement is for all steps before it, too, so a lost step must arrive before
/// any later one is accepted.
#[derive(Debug, Default)]
pub(crate) struct StepOrder {
    /// The number after the last accepted step.
    expected: Option<u32>,
    /// When the running replay was requested, by the carrier's clock, us.
    requested_us: Option<u64>,
    /// The first missing number for which replays were requested, and the number of replays that have begun.
    replays: Option<(u32, u8)>,
}

impl StepOrder {
    /// Decides on a step that did not arrive before.
    pub(crate) fn arrive(&mut self, step: u32) -> Arrival {
        if self.requested_us.is_some() {
            return Arrival::Awaited;
        }
        let missing = self.expected.filter(|&expected| is_after(step, expected));
        let begun = self.replays.filter(|(number, _)| Some(*number) == missing).map_or(0, |(_, begun)| begun);
        if missing.is_some() && begun < REPLAYS {
            return Arrival::Gap;
        }
        self.expected = Some(step.wrapping_add(1));
        Arrival::InOrder
    }

    /// A replay was requested.
    pub(crate) fn request(&mut self, now_us: u64) {
        self.requested_us = Some(now_us);
    }

    /// A session begins: the insole sends the steps that it has from the oldest on. True where that was requested.
    pub(crate) fn begin(&mut self) -> bool {
        let is_requested = self.requested_us.take().is_some();
        if let Some(expected) = self.expected.filter(|_| is_requested) {
            let begun = self.replays.filter(|(number, _)| *number == expected).map_or(0, |(_, begun)| begun);
            self.replays = Some((expected, begun + 1));
        }
        is_requested
    }

    /// When the running replay was requested, us.
    pub(crate) fn requested_us(&self) -> Option<u64> {
        self.requested_us
    }
}

#[cfg(test)]
mod tests {
    use super::{Arrival, REPLAYS, StepOrder};

    #[test]
    fn a_gap_is_replayed_once() {
        let mut order = StepOrder::default();
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
        let mut order = StepOrder::default();
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
        let mut order = StepOrder::default();
        assert_eq!([900, 0, 1].map(|step| order.arrive(step)), [Arrival::InOrder; 3]);
    }
}

//! Counts the live frames that a host received and lost; shared by the client and the page.

use crate::sequence;

/// Counts the frames of live streams, and those that are missing by their sequence numbers or by the insole's own count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LiveCounter {
    /// Frames that arrived, in all sessions.
    pub received: u32,
    /// Frames that did not arrive, in all sessions.
    pub lost: u32,
    /// The same in this session, which the insole counts from 0.
    session_received: u32,
    session_lost: u32,
    expected: Option<u32>,
}

impl LiveCounter {
    /// A counter before the first frame.
    pub const NEW: Self = Self { received: 0, lost: 0, session_received: 0, session_lost: 0, expected: None };

    /// Another session begins, with sequence numbers and counts of its own.
    pub fn new_session(&mut self) {
        *self = Self { received: self.received, lost: self.lost, ..Self::NEW };
    }

    /// Takes a frame with this sequence number.
    pub fn frame(&mut self, sequence: u32) {
        self.received = self.received.wrapping_add(1);
        self.session_received = self.session_received.wrapping_add(1);
        if let Some(expected) = self.expected {
            self.lose(sequence::skipped(expected, sequence));
        }
        self.expected = Some(sequence.wrapping_add(1));
    }

    /// Takes the insole's count of the frames that were due in this session before its answer. This also finds frames that were
    /// lost before the first one that arrived, or after the last.
    pub fn due(&mut self, live_due: u32) {
        self.lose(live_due.saturating_sub(self.session_received).saturating_sub(self.session_lost));
    }

    fn lose(&mut self, frames: u32) {
        self.lost = self.lost.saturating_add(frames);
        self.session_lost = self.session_lost.saturating_add(frames);
    }
}

#[cfg(test)]
mod tests {
    use super::LiveCounter;

    fn counts(counter: LiveCounter) -> (u32, u32) {
        (counter.received, counter.lost)
    }

    #[test]
    fn gaps_are_counted_and_the_count_of_the_insole_finds_the_losses_at_the_ends() {
        let mut counter = LiveCounter::NEW;
        [2, 3, 7].into_iter().for_each(|sequence| counter.frame(sequence));
        assert_eq!(counts(counter), (3, 3));
        counter.due(9);
        counter.due(9);
        assert_eq!(counts(counter), (3, 6));
    }

    #[test]
    fn sequence_numbers_wrap_and_a_step_back_is_no_loss() {
        let mut counter = LiveCounter::NEW;
        [u32::MAX - 1, u32::MAX, 1, 0].into_iter().for_each(|sequence| counter.frame(sequence));
        assert_eq!(counts(counter), (4, 1));
    }

    #[test]
    fn each_session_is_compared_with_its_own_count() {
        let mut counter = LiveCounter::NEW;
        (0..100).for_each(|sequence| counter.frame(sequence));
        counter.new_session();
        counter.frame(50);
        counter.due(3);
        assert_eq!(counts(counter), (101, 2));
    }
}

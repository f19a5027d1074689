//! Counts the live frames that a host received and lost; shared by the client and the web page for a phone.

use crate::sequence;

/// Counts the received and the lost frames of live streams. Lost frames are found by gaps in the sequence numbers and by the
/// insole's own count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LiveCounter {
    /// Frames that were received in all sessions.
    pub received: u32,
    /// Frames that were lost in all sessions.
    pub lost: u32,
    /// Frames that were received in this session; the insole counts each session from 0.
    session_received: u32,
    /// Frames that were lost in this session.
    session_lost: u32,
    /// The next sequence number; `None` before the first frame of a session.
    expected: Option<u32>,
}

impl LiveCounter {
    /// A counter before the first frame.
    pub const NEW: Self = Self { received: 0, lost: 0, session_received: 0, session_lost: 0, expected: None };

    /// Begins a session, in which the counts start from 0 again.
    pub fn new_session(&mut self) {
        *self = Self { received: self.received, lost: self.lost, ..Self::NEW };
    }

    /// Counts a received frame and the gap before its sequence number.
    pub fn frame(&mut self, sequence: u32) {
        self.received = self.received.wrapping_add(1);
        self.session_received = self.session_received.wrapping_add(1);
        if let Some(expected) = self.expected {
            self.add_lost(sequence::skipped(expected, sequence));
        }
        self.expected = Some(sequence.wrapping_add(1));
    }

    /// Counts the losses that follow from `live_due` of the status ([`super::Status::live_due`]), the number of live frames that
    /// were due in this session. Unlike gaps in the sequence numbers, this number also reveals losses before the first and after
    /// the last received frame.
    pub fn due(&mut self, live_due: u32) {
        let missing = live_due.saturating_sub(self.session_received).saturating_sub(self.session_lost);
        self.add_lost(missing);
        // The gap before the next frame must not count these losses again. Before the first frame there is no number to expect:
        // with a server, frames have the numbers of its session with the insole, which do not begin at 0.
        self.expected = self.expected.map(|expected| expected.wrapping_add(missing));
    }

    fn add_lost(&mut self, frames: u32) {
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
    fn gaps_are_counted_and_the_count_of_the_insole_reveals_losses_at_the_ends() {
        let mut counter = LiveCounter::NEW;
        [2, 3, 7].into_iter().for_each(|sequence| counter.frame(sequence));
        assert_eq!(counts(counter), (3, 3));
        counter.due(9);
        counter.due(9);
        assert_eq!(counts(counter), (3, 6));
    }

    #[test]
    fn a_loss_that_the_insole_has_reported_is_not_counted_again() {
        let mut counter = LiveCounter::NEW;
        counter.frame(0);
        counter.due(3);
        counter.frame(4);
        assert_eq!(counts(counter), (2, 3));
    }

    #[test]
    fn the_first_frame_after_a_status_can_have_any_number() {
        let mut counter = LiveCounter::NEW;
        counter.due(2);
        counter.frame(12_523);
        counter.due(3);
        assert_eq!(counts(counter), (1, 2));
        // Five frames are lost, which the status reveals before the next frame.
        counter.due(8);
        counter.frame(12_529);
        assert_eq!(counts(counter), (2, 7));
    }

    #[test]
    fn sequence_numbers_wrap_and_a_smaller_number_is_no_loss() {
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

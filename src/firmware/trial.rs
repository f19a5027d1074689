//! An image on trial after an update: it is confirmed once scanning, processing and link have made progress for some seconds.

use super::supervise::Heartbeats;
use embassy_time::{Duration, Instant};

/// Number of successive checks, all with progress, after which the image is confirmed.
const CHECKS: u8 = 5;
/// Time between checks.
const PERIOD: Duration = Duration::from_secs(1);

/// Observes an image that was just swapped in.
pub(super) struct Trial {
    checks_left: u8,
    next_check: Instant,
    /// The counts of the heartbeats at the last check.
    previous_counts: [u32; 3],
}

impl Trial {
    pub(super) fn new(heartbeats: &Heartbeats) -> Self {
        Self { checks_left: CHECKS, next_check: Instant::now() + PERIOD, previous_counts: heartbeats.counts() }
    }

    pub(super) fn next_check(&self) -> Instant {
        self.next_check
    }

    /// Checks the image if a check is due. True once scanning, processing and link have each made progress before each of
    /// [`CHECKS`] successive checks.
    pub(super) fn is_passed(&mut self, heartbeats: &Heartbeats) -> bool {
        if Instant::now() >= self.next_check {
            let counts = heartbeats.counts();
            let has_progress = counts.iter().zip(&self.previous_counts).all(|(count, previous)| count != previous);
            let checks_left = if has_progress { self.checks_left - 1 } else { CHECKS };
            *self = Self { checks_left, next_check: Instant::now() + PERIOD, previous_counts: counts };
        }
        self.checks_left == 0
    }
}

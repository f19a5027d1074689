//! An image on trial after an update: it is confirmed once all parts have made progress for some seconds.

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
    before: [u32; 3],
}

impl Trial {
    pub(super) fn new(heartbeats: &Heartbeats) -> Self {
        Self { checks_left: CHECKS, next_check: Instant::now() + PERIOD, before: heartbeats.counts() }
    }

    pub(super) fn next_check(&self) -> Instant {
        self.next_check
    }

    /// True once scanning, processing and link each made progress before each of [`CHECKS`] successive checks.
    pub(super) fn is_passed(&mut self, heartbeats: &Heartbeats) -> bool {
        if Instant::now() >= self.next_check {
            let now = heartbeats.counts();
            let has_progress = now.iter().zip(&self.before).all(|(now, before)| now != before);
            let checks_left = if has_progress { self.checks_left - 1 } else { CHECKS };
            *self = Self { checks_left, next_check: Instant::now() + PERIOD, before: now };
        }
        self.checks_left == 0
    }
}

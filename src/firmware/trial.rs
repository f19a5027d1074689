//! An image on trial after an update.
//!
//! It is confirmed once scanning, processing, link, storage and, if it has answered on this board before, the radio have made
//! progress for some seconds and the host has confirmed it. Without a host it is confirmed once all of them have made progress in
//! [`UNATTENDED_CHECKS`] successive checks. An image that has met neither condition after [`TRIAL_CHECKS`] checks has failed.

use super::supervise::{Heartbeats, PARTS, Part};
use crate::storage::update;
use embassy_time::{Duration, Instant};
use embedded_storage_async::nor_flash::NorFlash;

/// Time between checks. Every part has a heartbeat in this time: the storage with each check, the others at least every second.
const PERIOD: Duration = Duration::from_secs(2);
/// Number of successive checks, all with progress, after which the host's confirmation counts: 10 s.
const CHECKS: u16 = 5;
/// Number of successive checks, all with progress, after which the image is confirmed without a host: 10 minutes.
const UNATTENDED_CHECKS: u16 = 300;
/// Number of checks after which an image that is not confirmed has failed: 15 minutes.
const TRIAL_CHECKS: u16 = 450;

/// Time from a failed confirmation to the next attempt, which reads the whole image.
const RETRY: Duration = Duration::from_secs(60);

/// Largest number of attempts to read whether the image is on trial, as many as the bootloader makes.
const STATE_READS: usize = 3;

/// True if the running image is on trial. The state is read at the start only, so a read that fails is repeated: without its
/// trial the image would neither be confirmed nor swapped back before the next start.
pub(super) async fn is_on_trial(flash: &mut impl NorFlash) -> bool {
    for _ in 0..STATE_READS {
        if let Ok(is_on_trial) = update::is_on_trial(flash).await {
            return is_on_trial;
        }
    }
    false
}

/// The state of a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// The trial continues.
    Pending,
    /// The image works.
    Passed,
    /// The image must be swapped back.
    Failed,
}

/// Observes an image that was just swapped in.
pub(super) struct Trial {
    /// Number of checks so far.
    checks: u16,
    /// Number of successive checks with progress up to now.
    healthy_checks: u16,
    is_confirmed_by_host: bool,
    /// The image has passed before, but could not be confirmed.
    has_passed: bool,
    /// The radio has answered on this board before, so it must make progress, too.
    needs_radio: bool,
    next_check: Instant,
    /// The counts of the heartbeats at the last check.
    previous_counts: [u32; PARTS.len()],
}

impl Trial {
    pub(super) fn new(heartbeats: &Heartbeats, needs_radio: bool) -> Self {
        Self {
            checks: 0,
            healthy_checks: 0,
            is_confirmed_by_host: false,
            has_passed: false,
            needs_radio,
            next_check: Instant::now() + PERIOD,
            previous_counts: heartbeats.counts(),
        }
    }

    pub(super) fn next_check(&self) -> Instant {
        self.next_check
    }

    /// Records that the host has confirmed the image.
    pub(super) fn confirm_by_host(&mut self) {
        self.is_confirmed_by_host = true;
    }

    /// Counts a check, which is due at [`Trial::next_check`]. `is_storage_sound` is the result of the storage's own check.
    pub(super) fn check(&mut self, heartbeats: &Heartbeats, is_storage_sound: bool) {
        let counts = heartbeats.counts();
        let is_unused = |part| part == Part::Radio as usize && !self.needs_radio;
        let has_progress = (0..PARTS.len()).all(|part| counts[part] != self.previous_counts[part] || is_unused(part));
        self.healthy_checks = if has_progress && is_storage_sound { self.healthy_checks.saturating_add(1) } else { 0 };
        self.checks = self.checks.saturating_add(1);
        self.next_check = Instant::now() + PERIOD;
        self.previous_counts = counts;
    }

    /// Postpones the next check: the image has passed, but could not be confirmed, for example with a low supply. From now on it
    /// does not fail any more.
    pub(super) fn retry_later(&mut self) {
        self.has_passed = true;
        self.next_check = Instant::now() + RETRY;
    }

    /// True if a confirmation by the host should have taken effect by now: more than twice the checks that it needs were made.
    #[cfg(feature = "management")]
    pub(super) fn is_overdue(&self) -> bool {
        self.checks > 2 * CHECKS
    }

    pub(super) fn verdict(&self) -> Verdict {
        let needed = if self.is_confirmed_by_host { CHECKS } else { UNATTENDED_CHECKS };
        match self.checks {
            _ if self.healthy_checks >= needed => Verdict::Passed,
            TRIAL_CHECKS.. if !self.has_passed => Verdict::Failed,
            _ => Verdict::Pending,
        }
    }
}

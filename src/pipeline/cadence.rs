//! Cadence, estimated from the steps of one foot.

/// Longest stride time within a walk, between successive heel strikes of one foot, us.
const PAUSE_US: u64 = 3_000_000;
/// Time that is allowed from toe off until the step is added, us. The default rule confirms toe off after 50 ms; with a much
/// longer time, the cadence of very slow walkers is interrupted.
const CONFIRMED_US: u64 = 200_000;

/// The cadence of both feet, from the stride time of one foot: a stride has one step of each foot.
///
/// ```
/// use plantar::pipeline::cadence::Cadence;
///
/// let mut cadence = Cadence::default();
/// cadence.step(5_000_000, 700_000);
/// assert_eq!(cadence.per_min(5_800_000), 0);
/// // A stride of 1.2 s: two steps.
/// cadence.step(6_200_000, 700_000);
/// assert_eq!(cadence.per_min(7_000_000), 100);
/// assert_eq!(cadence.per_min(60_000_000), 0);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cadence {
    /// Number of steps of this foot so far; wraps.
    pub steps: u32,
    /// Heel strike of the last step.
    start_us: u64,
    /// Toe off of the last step.
    end_us: u64,
    cadence_per_min: u8,
}

impl Cadence {
    /// Adds a step with its heel strike at `start_us` and a stance of `duration_us`, us.
    pub fn step(&mut self, start_us: u64, duration_us: u32) {
        let interval_us = start_us.saturating_sub(self.start_us);
        let is_walk = self.steps > 0 && (1..=PAUSE_US).contains(&interval_us);
        // A stride has two steps, one of each foot.
        self.cadence_per_min = if is_walk { (2 * 60_000_000 / interval_us).min(255) as u8 } else { 0 };
        self.start_us = start_us;
        self.end_us = start_us.saturating_add(duration_us.into());
        self.steps = self.steps.wrapping_add(1);
    }

    /// Steps of both feet per minute at the time `now_us`, up to 255; 0 at rest and after the first step of a walk. The wearer
    /// rests if no step was added within the longest stride time after the last toe off, and 0.2 s for its confirmation.
    pub fn per_min(&self, now_us: u64) -> u8 {
        if now_us.saturating_sub(self.end_us) > PAUSE_US + CONFIRMED_US { 0 } else { self.cadence_per_min }
    }
}

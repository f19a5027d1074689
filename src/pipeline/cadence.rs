//! Cadence from the steps of one foot.

/// Largest time between the heel strikes of two steps of one walk, us.
const PAUSE_US: u64 = 3_000_000;

/// The state of the estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cadence {
    /// Number of steps so far; wraps.
    pub steps: u32,
    start_us: u64,
    cadence_per_min: u8,
}

impl Cadence {
    /// Adds a step that started at `start_us`.
    pub fn step(&mut self, start_us: u64) {
        let interval_us = start_us.saturating_sub(self.start_us);
        let is_walk = self.steps > 0 && (1..=PAUSE_US).contains(&interval_us);
        // The other foot makes as many steps.
        self.cadence_per_min = if is_walk { (2 * 60_000_000 / interval_us).min(255) as u8 } else { 0 };
        self.start_us = start_us;
        self.steps = self.steps.wrapping_add(1);
    }

    /// Steps of both feet per minute; 0 at rest and after the first step.
    pub fn per_min(&self, now_us: u64) -> u8 {
        if now_us.saturating_sub(self.start_us) > PAUSE_US { 0 } else { self.cadence_per_min }
    }
}

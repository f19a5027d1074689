//! The circumstances of a start, from the reset reason and from what the RAM preserved of the previous run.

use crate::protocol::{MAX_FAULT_TEXT, Reset};
use heapless::String;

/// Number of successive failed starts after which the insole starts in recovery mode. A start has failed if a crash or a stall
/// ends the run before the supervision has counted [`HEALTHY_CHECKS`](super::supervise::HEALTHY_CHECKS) healthy checks.
pub const MAX_FAILED_STARTS: u32 = 3;

/// The circumstances of a start.
pub struct BootReport {
    /// Why the board started.
    pub reset: Reset,
    /// The failure that ended the previous run; `None` if there was none. In recovery mode, the text begins with words that
    /// state this.
    pub fault: Option<String<MAX_FAULT_TEXT>>,
    /// Number of successive starts that failed before this one.
    pub failed_starts: u32,
    /// A person who has the insole in hand has started it: it was switched on after its RAM had lost its contents, or reset by its
    /// pin. A short interruption of the supply, as by a battery contact that bounces, does not count: [`is_started_by_user`].
    pub is_started_by_user: bool,
}

/// Whether a person who has the insole in hand has started it: see [`BootReport::is_started_by_user`]. `has_survived` states whether
/// the RAM still has the contents of the previous run.
pub fn is_started_by_user(reset: Reset, has_survived: bool) -> bool {
    reset == Reset::Pin || reset == Reset::Power && !has_survived
}

impl BootReport {
    /// True if the insole starts in recovery mode: with its built-in configuration, and without stored data except the bonds. It
    /// reads the bonds in the first such start only, and no stored data in the following ones.
    pub fn is_recovery(&self) -> bool {
        self.failed_starts >= MAX_FAILED_STARTS
    }
}

#[cfg(test)]
mod tests {
    use super::{Reset, is_started_by_user};

    /// A battery contact that bounces must not open the bonding window to strangers.
    #[test]
    fn a_short_interruption_of_the_supply_is_no_start_by_the_user() {
        assert!(is_started_by_user(Reset::Power, false) && !is_started_by_user(Reset::Power, true));
        assert!([false, true].into_iter().all(|has_survived| is_started_by_user(Reset::Pin, has_survived)));
        for reset in [Reset::Software, Reset::Watchdog, Reset::Panic, Reset::Unknown] {
            assert!(![false, true].into_iter().any(|has_survived| is_started_by_user(reset, has_survived)));
        }
    }
}

//! The circumstances of a start, from the reset reason and from what the RAM preserved of the previous run.

use super::supervise::{HEALTHY_CHECKS, Part, RADIO_HEALTHY_CHECKS};
use crate::protocol::{MAX_FAULT_TEXT, Reset};
use embassy_time::Duration;
use heapless::String;

/// Number of successive failed starts after which the insole starts in recovery mode. A start has failed if a crash or a stall
/// ends the run before the supervision has counted [`HEALTHY_CHECKS`] healthy checks. A stall of the radio alone does not count:
/// see [`MAX_RADIO_STALLS`].
pub const MAX_FAILED_STARTS: u32 = 3;
/// Number of successive stalls of the radio alone after which it starts [`RADIO_DELAY`] later. The first one may end a run of any
/// length; each further one counts if it ends a run before its [`RADIO_HEALTHY_CHECKS`] healthy checks.
pub const MAX_RADIO_STALLS: u32 = 2;
/// Time from the start of the firmware to that of a radio that has stalled again and again. Each attempt may cost the measurement
/// a restart.
pub const RADIO_DELAY: Duration = Duration::from_secs(3600);
/// The text of the hello's fault begins with these words if the radio starts [`RADIO_DELAY`] later.
pub const RADIO_DELAYED: &str = "Bluetooth starts 1 h after the start: ";

/// The failures of successive runs. A run without failure in its first [`HEALTHY_CHECKS`] healthy checks ends the succession of
/// failed starts, one without failure in its first [`RADIO_HEALTHY_CHECKS`] that of the radio's stalls, too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct Failures {
    /// Number of failed starts.
    pub starts: u32,
    /// Number of stalls of the radio alone. Such a run is no failed start, because everything else has worked: recovery mode
    /// would only end the measurement, too.
    pub radio_stalls: u32,
}

impl Failures {
    /// What to record at the start of a run, in RAM that survives a reset. The run counts as a failed start in advance:
    /// [`Failures::at_next_start`] takes this back unless the start has failed ([`MAX_FAILED_STARTS`]), and
    /// [`Failures::recorded_after`] once the run has been healthy for long enough.
    pub fn recorded(self) -> Self {
        Self { starts: self.starts.saturating_add(1), ..self }
    }

    /// What to record, in place of this record, in a run that has had this number of healthy checks; `None` if the record stays.
    pub fn recorded_after(self, healthy_checks: u32) -> Option<Self> {
        match healthy_checks {
            HEALTHY_CHECKS => Some(Self { starts: 0, ..self }),
            RADIO_HEALTHY_CHECKS => Some(Self::default()),
            _ => None,
        }
    }

    /// The failures that a start has to consider after a run with this record. `reset` ended the run, and `stalled` has a bit for
    /// each part that was stalled then, as [`Watchdog::check`](super::supervise::Watchdog::check) returns them.
    pub fn at_next_start(self, reset: Reset, stalled: u32) -> Self {
        match reset {
            Reset::Watchdog if stalled == 1 << Part::Radio as u32 => Self {
                // The run was in recovery mode if the record has more failed starts than lead to it: then it remains counted.
                starts: if self.starts > MAX_FAILED_STARTS { self.starts } else { self.starts.saturating_sub(1) },
                radio_stalls: self.radio_stalls.saturating_add(1),
            },
            Reset::Watchdog | Reset::Panic => self,
            // A run that ended in another way, for example by the user, did not fail.
            _ => Self::default(),
        }
    }

    /// True if the insole starts in recovery mode; see [`BootReport::is_recovery`].
    pub fn lead_to_recovery(&self) -> bool {
        self.starts >= MAX_FAILED_STARTS
    }

    /// True if the radio starts [`RADIO_DELAY`] later than everything else. In recovery mode, it does not: no measurement can be
    /// lost, and an update may come over Bluetooth.
    pub fn is_radio_delayed(&self) -> bool {
        self.radio_stalls >= MAX_RADIO_STALLS && !self.lead_to_recovery()
    }
}

/// The circumstances of a start.
pub struct BootReport {
    /// Why the board started.
    pub reset: Reset,
    /// The failure that ended the previous run; `None` if there was none. In recovery mode, or if the radio starts later
    /// ([`RADIO_DELAYED`]), the text begins with words that state this.
    pub fault: Option<String<MAX_FAULT_TEXT>>,
    /// The failures before this start.
    pub failures: Failures,
    /// A person who has the insole in hand has started it: it was switched on after its RAM had lost its contents, or reset by
    /// its pin. A short interruption of the supply, as by a battery contact that bounces, does not count: [`is_started_by_user`].
    pub is_started_by_user: bool,
}

/// Whether a person who has the insole in hand has started it: see [`BootReport::is_started_by_user`]. `has_survived` states
/// whether the RAM still has the contents of the previous run.
pub fn is_started_by_user(reset: Reset, has_survived: bool) -> bool {
    reset == Reset::Pin || reset == Reset::Power && !has_survived
}

impl BootReport {
    /// True if the insole starts in recovery mode: with its built-in configuration, and without stored data except the bonds. It
    /// reads the bonds in the first such start only, and no stored data in the following ones.
    pub fn is_recovery(&self) -> bool {
        self.failures.lead_to_recovery()
    }
}

#[cfg(test)]
mod tests {
    use super::super::supervise::Part;
    use super::{Failures, HEALTHY_CHECKS, RADIO_HEALTHY_CHECKS, Reset, is_started_by_user};

    /// A battery contact that bounces must not open the bonding window to strangers.
    #[test]
    fn a_short_interruption_of_the_supply_is_no_start_by_the_user() {
        assert!(is_started_by_user(Reset::Power, false) && !is_started_by_user(Reset::Power, true));
        assert!([false, true].into_iter().all(|has_survived| is_started_by_user(Reset::Pin, has_survived)));
        for reset in [Reset::Software, Reset::Watchdog, Reset::Panic, Reset::Unknown] {
            assert!(![false, true].into_iter().any(|has_survived| is_started_by_user(reset, has_survived)));
        }
    }

    #[test]
    fn stalls_of_the_radio_delay_it_and_are_no_failed_starts() {
        let radio = 1 << Part::Radio as u32;
        let after = |failures: Failures, reset, stalled| failures.recorded().at_next_start(reset, stalled);
        let mut failures = after(Failures::default(), Reset::Panic, 0);
        failures = after(failures, Reset::Watchdog, radio);
        assert_eq!((failures, failures.is_radio_delayed()), (Failures { starts: 1, radio_stalls: 1 }, false));
        failures = after(failures, Reset::Watchdog, radio);
        assert_eq!((failures, failures.is_radio_delayed()), (Failures { starts: 1, radio_stalls: 2 }, true));
        // A stalled scan stops the measurement, whatever the radio does.
        assert_eq!(after(failures, Reset::Watchdog, radio | 1), Failures { starts: 2, radio_stalls: 2 });
        assert_eq!(after(failures, Reset::Software, 0), Failures::default());
        let recovery = Failures { starts: 3, radio_stalls: 2 };
        assert!(!recovery.is_radio_delayed());
        assert_eq!(after(recovery, Reset::Watchdog, radio), Failures { starts: 4, radio_stalls: 3 });
        // The run before was healthy for five minutes, or for half an hour.
        let healthy = recovery.recorded_after(HEALTHY_CHECKS).expect("the failed starts are forgotten");
        assert_eq!(healthy.at_next_start(Reset::Watchdog, radio), Failures { starts: 0, radio_stalls: 3 });
        assert_eq!(healthy.recorded_after(RADIO_HEALTHY_CHECKS), Some(Failures::default()));
        assert_eq!(healthy.recorded_after(RADIO_HEALTHY_CHECKS - 1), None);
        assert_eq!(Failures::default().at_next_start(Reset::Watchdog, radio), Failures { starts: 0, radio_stalls: 1 });
        assert_eq!(Failures::default().at_next_start(Reset::Panic, 0), Failures::default());
    }
}

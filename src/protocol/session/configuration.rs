//! The configuration and the clock of an insole, and what its data path exchanges with the session of a host.

use super::{Answer, Session};
use crate::faults::Faults;
use crate::pipeline::alert::{AlertRules, DailyLoad};
use crate::pipeline::baseline::ZeroResult;
use crate::pipeline::setup::{Setup, SetupCell};
use crate::pipeline::tissue::{Identified, Tissue};
use crate::protocol::{Identity, Refusal, Settings};
use core::ops::RangeInclusive;

/// The times to which the wall clock can be set, us since 1970: the years 2020 to 2099.
pub const CLOCK_US: RangeInclusive<u64> = 1_577_836_800_000_000..=4_102_444_799_999_999;

/// Requests of a host for the data path ([`crate::insole::Insole`]), which executes them at the end of each second.
#[derive(Clone, Copy, Debug)]
pub struct ToInsole {
    /// New rules of alerts.
    pub rules: Option<AlertRules>,
    /// Raise no alerts for at least this time, s; 0 ends a snooze and a pause.
    pub snooze_s: Option<u16>,
    /// The host of the session waits for the load of the day as the answer to its request for a snooze.
    pub is_load_awaited: bool,
    /// Measure the baselines.
    pub zero: bool,
}

impl ToInsole {
    pub(super) const NONE: Self = Self { rules: None, snooze_s: None, is_load_awaited: false, zero: false };
}

impl Session {
    /// Restores the persisted identity after a start.
    pub fn restore_identity(&mut self, identity: Identity) {
        self.configured.identity = identity;
    }

    /// Restores the persisted parameters after a start. Parameters that do not pass their check are discarded.
    pub fn restore_tissue(&mut self, tissue: Tissue, identified: Option<Identified>) {
        self.is_tissue_due = tissue.check().is_ok();
        (self.configured.tissue, self.configured.identified) =
            if self.is_tissue_due { (tissue, identified) } else { (Tissue::NONE, None) };
    }

    /// Puts rules of alerts in force.
    pub fn set_alert_rules(&mut self, rules: AlertRules) {
        self.configured.alert_rules = rules;
        self.to_insole.rules = Some(rules);
    }

    /// Returns and clears the requests that hosts have made since the last call.
    pub fn take_to_insole(&mut self) -> ToInsole {
        core::mem::replace(&mut self.to_insole, ToInsole::NONE)
    }

    /// The rules of alerts in force.
    pub fn alert_rules(&self) -> &AlertRules {
        &self.configured.alert_rules
    }

    /// Answers the request of this session to measure the baselines, if there is one, with the result or the refusal.
    pub fn answer_zero(&mut self, result: Result<ZeroResult, Refusal>) {
        if core::mem::take(&mut self.is_zero_awaited) {
            // The answer to an earlier request may still wait for the carrier.
            self.zeroed = result.ok().or(self.zeroed);
            self.answer(result.map_or_else(Answer::Refused, |_| Answer::Zero));
        }
    }

    /// Stores the faults that the insole detected; returns how many of them are new.
    pub fn set_faults(&mut self, faults: &Faults) -> u32 {
        let new = faults.found.saturating_sub(self.faults.found);
        let state = |faults: &Faults| (faults.found, faults.rezeroed, faults.with_former_baseline);
        if state(faults) != state(&self.faults) {
            self.faults = faults.clone();
        }
        new
    }

    /// Sets the load of the day; with `is_answer`, it is sent to the host.
    pub fn set_daily_load(&mut self, daily: DailyLoad, is_answer: bool) {
        self.daily = daily;
        if is_answer && self.is_open {
            self.answer(Answer::DailyLoad);
        }
    }

    /// The load of the day.
    pub fn daily_load(&self) -> &DailyLoad {
        &self.daily
    }

    /// Sets the layout that hosts can read (the set-up of the insole and its cells), and the stored settings that are part of it.
    pub fn set_layout(&mut self, setup: Setup, cells: &'static [SetupCell], settings: Option<Settings>) {
        self.configured.layout = Some((setup, cells));
        self.configured.settings = settings;
    }

    /// The set-up of the layout; `None` without a valid layout.
    pub fn setup(&self) -> Option<&Setup> {
        self.configured.layout.as_ref().map(|(setup, _)| setup)
    }

    /// The stored identity of the insole.
    pub fn identity(&self) -> Identity {
        self.configured.identity
    }

    /// The wearer's parameters: the last that were accepted.
    pub fn tissue(&self) -> &Tissue {
        &self.configured.tissue
    }

    /// Returns new parameters once, to be in force from the next frame on, even if they are equal to the previous ones. `None`
    /// while they must be announced first, because live frames before the announcement use the previous ones.
    pub fn take_tissue_due(&mut self) -> Option<&Tissue> {
        if !self.is_tissue_due || self.answers.iter().any(Answer::is_announcement) {
            return None;
        }
        self.is_tissue_due = false;
        Some(&self.configured.tissue)
    }

    /// The regions of which the parameters in force are tracked ([`Identified::tracked_regions`]); 0 if it is not known how they
    /// were identified.
    pub fn tracked_regions(&self) -> u8 {
        self.configured.identified.map_or(0, |identified| identified.tracked_regions())
    }

    /// Sets the wall clock to `unix_us` at `now_us` of the device's time. Returns false, and changes nothing, for a time
    /// outside of [`CLOCK_US`].
    pub fn set_clock(&mut self, unix_us: u64, now_us: u64) -> bool {
        if !CLOCK_US.contains(&unix_us) {
            return false;
        }
        self.unix_offset_us = Some(unix_us.wrapping_sub(now_us));
        self.clock_sets = self.clock_sets.wrapping_add(1);
        true
    }

    /// Number of times that the wall clock was set; wraps.
    pub fn clock_sets(&self) -> u32 {
        self.clock_sets
    }

    /// The wall clock at `now_us` of the device's time, us since 1970; `None` until the clock is set.
    pub fn unix_us(&self, now_us: u64) -> Option<u64> {
        self.unix_offset_us.map(|offset_us| offset_us.wrapping_add(now_us))
    }
}

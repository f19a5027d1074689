//! Alerts: when a region has carried too much load for too long, the wearer is asked to unload it.
//!
//! An alert is raised when a region is under sustained load ([`super::cumulative`]), at the earliest [`AlertRules::pause_s`]
//! after the previous alert, and is repeated at this interval until the region is relieved. Another alert is raised once a day
//! when the dose of a region reaches [`AlertRules::dose_kpa_s`]. At most [`AlertRules::per_day`] alerts are raised in a day, so
//! that they do not go on without end.

use super::cumulative::{LoadLimits, Totals};
use super::region::Side;
use serde::{Deserialize, Serialize};

/// Largest [`AlertRules::pause_s`], and longest snooze that can be requested, s: 12 hours.
pub const MAX_SNOOZE_S: u16 = 43_200;

/// The rules of alerts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AlertRules {
    /// The limits of the load.
    pub limits: LoadLimits,
    /// Bit i: alerts are raised for region i.
    pub regions: u8,
    /// Dose of a region in a day from which an alert is raised, kPa s; 0 for no such alert, at most 1e7.
    pub dose_kpa_s: f32,
    /// Time after an alert without another one, s, 60 to [`MAX_SNOOZE_S`].
    pub pause_s: u16,
    /// Largest number of alerts in a day; 0 for no alerts.
    pub per_day: u8,
    /// Time at which the wearer's day begins, minutes after midnight UTC, below 1440.
    pub day_start_min: u16,
}

impl AlertRules {
    /// The load is counted, and no alerts are raised.
    pub const OFF: Self = Self { per_day: 0, ..Self::RECOMMENDED };
    /// Alerts on sustained load, repeated after 20 minutes; see `docs/alerts.md`.
    pub const RECOMMENDED: Self = Self {
        limits: LoadLimits::DEFAULT,
        regions: 0xff,
        dose_kpa_s: 0.0,
        pause_s: 1200,
        per_day: 20,
        day_start_min: 0,
    };

    /// Not set; all bytes are zero.
    pub(crate) const UNSET: Self = Self {
        limits: LoadLimits {
            dose_kpa: 0.0,
            sustained_kpa: 0.0,
            window_s: 0,
            sustained_percent: 0,
            relieved_percent: 0,
        },
        regions: 0,
        dose_kpa_s: 0.0,
        pause_s: 0,
        per_day: 0,
        day_start_min: 0,
    };

    /// True if all values are in range and in order.
    pub fn is_valid(&self) -> bool {
        self.limits.is_valid()
            && (0.0..=1e7).contains(&self.dose_kpa_s)
            && (60..=MAX_SNOOZE_S).contains(&self.pause_s)
            && self.day_start_min < 1440
    }

    /// The number of the wearer's day at the time `unix_us`, us since 1970. Day 1 contains the first moment of 1970.
    pub fn day(&self, unix_us: u64) -> u32 {
        let minutes = unix_us / 60_000_000;
        (minutes.saturating_sub(self.day_start_min.into()) / 1440 + 1) as u32
    }
}

/// An alert.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AlertRecord {
    /// The foot.
    pub side: Side,
    /// Number of the record; steps, load bouts and alerts are numbered together.
    pub number: u32,
    /// Time of the alert since frame 0, us.
    pub start_us: u64,
    /// Bit i: region i is under sustained load, and alerts are raised for it.
    pub sustained: u8,
    /// Bit i: the dose of region i has reached the limit of the day, and no earlier alert of this day has reported it.
    pub dose: u8,
    /// Length of the window of sustained load, s.
    pub window_s: u16,
    /// Number of alerts in this day, including this one.
    pub today: u8,
}

/// The load of a day, and the state of the alerts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DailyLoad {
    /// Number of the wearer's day, see [`AlertRules::day`]. It is 0 without a clock: each day then lasts 24 hours, and the first
    /// one begins with the start of the insole.
    pub day: u32,
    /// The load.
    pub totals: Totals,
    /// Bit i: region i is under sustained load.
    pub sustained: u8,
    /// Bit i: the dose of region i has reached its limit, and an alert was raised.
    pub dose: u8,
    /// Number of alerts in this day.
    pub alerts: u8,
    /// Time until the next alert can be raised, s.
    pub snoozed_s: u16,
}

impl DailyLoad {
    /// No load, on an unknown day.
    pub const NONE: Self = Self { day: 0, totals: Totals::NONE, sustained: 0, dose: 0, alerts: 0, snoozed_s: 0 };
}

/// The state of the alerts.
#[derive(Debug)]
pub(crate) struct Alerts {
    /// Number of the day, see [`AlertRules::day`]; 0 without a clock.
    pub(crate) day: u32,
    /// Number of seconds since the beginning of the day. A day without a clock ends by this count.
    seconds: u32,
    /// Time until the next alert can be raised, s.
    snoozed_s: u16,
    /// Number of alerts in this day.
    today: u8,
    /// Bit i: the dose of region i has reached its limit, and an alert was raised.
    dose: u8,
    /// The regions of the last alert until it is taken: those under sustained load, and those for which the dose has reached the
    /// limit. (0, 0) if no alert waits.
    raised: (u8, u8),
    /// Number of the frame that raised the last alert.
    raised_seq: u32,
    /// Number of alerts in the day of the last alert, up to and including that alert. A new day may begin before it is taken.
    raised_today: u8,
    /// Length of the window by which the last alert was raised, s. The rules may change before it is taken.
    raised_window_s: u16,
}

impl Alerts {
    pub(crate) const NONE: Self = Self {
        day: 0,
        seconds: 0,
        snoozed_s: 0,
        today: 0,
        dose: 0,
        raised: (0, 0),
        raised_seq: 0,
        raised_today: 0,
        raised_window_s: 0,
    };

    /// Ends a second, and raises an alert if the rules demand it. Frame `seq` was the last one of the second.
    pub(crate) fn end_second(&mut self, rules: &AlertRules, seq: u32, sustained: u8, totals: &Totals) {
        self.snoozed_s = self.snoozed_s.saturating_sub(1);
        let sustained = sustained & rules.regions;
        let dose = over_dose(rules, totals) & rules.regions & !self.dose;
        // An alert that was not taken yet must not be replaced: its dose would not be reported again on this day.
        let is_due = self.raised == (0, 0) && self.snoozed_s == 0 && self.today < rules.per_day;
        if sustained | dose != 0 && is_due {
            (self.raised, self.raised_seq) = ((sustained, dose), seq);
            self.snoozed_s = rules.pause_s;
            self.today += 1;
            (self.raised_today, self.raised_window_s) = (self.today, rules.limits.window_s);
            self.dose |= dose;
        }
    }

    /// Suppresses alerts for at least `snoozed_s` more seconds. A pause or snooze that lasts longer continues; 0 ends both.
    pub(crate) fn snooze(&mut self, snoozed_s: u16) {
        self.snoozed_s = if snoozed_s == 0 { 0 } else { self.snoozed_s.max(snoozed_s) };
    }

    /// The alert that was raised since the last call, as a record with this side and number. `period_us` is the time between
    /// frames.
    pub(crate) fn take(&mut self, side: Side, number: u32, period_us: u32) -> Option<AlertRecord> {
        let (sustained, dose) = core::mem::take(&mut self.raised);
        (sustained | dose != 0).then_some(AlertRecord {
            side,
            number,
            start_us: u64::from(self.raised_seq) * u64::from(period_us),
            sustained,
            dose,
            window_s: self.raised_window_s,
            today: self.raised_today,
        })
    }

    /// Adds the alerts of an earlier part of the day.
    pub(crate) fn add(&mut self, earlier: &DailyLoad) {
        self.today = self.today.saturating_add(earlier.alerts);
        self.dose |= earlier.dose;
        self.snoozed_s = self.snoozed_s.max(earlier.snoozed_s);
    }

    /// Counts a second. True if there is no clock, and the day has lasted 24 hours.
    pub(crate) fn count_second(&mut self) -> bool {
        self.seconds += 1;
        self.day == 0 && self.seconds >= 86_400
    }

    /// Begins a day.
    pub(crate) fn begin_day(&mut self, day: u32) {
        *self = Self { day, seconds: 0, today: 0, dose: 0, ..*self };
    }

    /// The state of the alerts together with the load of the day.
    pub(crate) fn daily(&self, totals: &Totals, sustained: u8) -> DailyLoad {
        DailyLoad {
            day: self.day,
            totals: *totals,
            sustained,
            dose: self.dose,
            alerts: self.today,
            snoozed_s: self.snoozed_s,
        }
    }
}

/// Bit i: the dose of region i has reached the limit of the day.
fn over_dose(rules: &AlertRules, totals: &Totals) -> u8 {
    if rules.dose_kpa_s <= 0.0 {
        return 0;
    }
    let is_over = |dose_dkpa_s: u32| dose_dkpa_s as f32 >= rules.dose_kpa_s * 10.0;
    let bits = totals.regions.iter().enumerate().map(|(i, region)| u8::from(is_over(region.dose_dkpa_s)) << i);
    bits.fold(0, |all, bit| all | bit)
}

//! Cumulative load and alerts of a day.

use super::Insole;
use crate::num::Real;
use crate::pipeline::alert::{AlertRecord, AlertRules, DailyLoad};
use crate::pipeline::cumulative::Totals;

impl<R: Real, const N: usize> Insole<R, N> {
    /// Adds the present frame to the cumulative load. The frame stands for `frames` frames, more than 1 after missing ones.
    pub(super) fn accumulate(&mut self, frames: u32) {
        let regions = self.loads.iter().map(|load| &load.frame);
        self.has_ended_second = self.cumulative.frame(&self.alert_rules.limits, frames, regions);
        if self.has_ended_second {
            self.end_second();
        }
    }

    /// Adds the load of the last frames, which are no whole second, to the load of the day. Used by hosts, at the end of a
    /// recording.
    pub fn end_load(&mut self) {
        if self.cumulative.finish(&self.alert_rules.limits) {
            self.end_second();
        }
    }

    #[cold]
    fn end_second(&mut self) {
        self.alerts.end_second(
            &self.alert_rules,
            self.last_seq.unwrap_or(0),
            self.cumulative.sustained(),
            &self.cumulative.totals,
        );
        // Without a clock, the number of the day is 0, and the day ends after 24 hours.
        if self.alerts.count_second() {
            self.begin_day(0);
        }
    }

    /// True if the last frame completed a second of the cumulative load. Then [`Insole::daily_load`] may have changed.
    pub fn has_ended_second(&self) -> bool {
        self.has_ended_second
    }

    /// Number of complete seconds since the last load.
    pub fn unloaded_s(&self) -> u32 {
        self.cumulative.unloaded_s()
    }

    /// Number of frames in a second.
    pub fn second_frames(&self) -> u32 {
        self.cumulative.second_frames()
    }

    /// Replaces the rules of alerts, which must be valid ([`AlertRules::is_valid`]). The load of the day remains. If the limits
    /// of the load have changed, the window of sustained load begins again.
    pub fn set_alert_rules(&mut self, rules: &AlertRules) {
        if rules.limits != self.alert_rules.limits {
            self.cumulative.clear_window();
        }
        if rules.day_start_min != self.alert_rules.day_start_min && self.alerts.day != 0 {
            // The load so far is part of the day of the next call of `enter_day`.
            self.alerts.day = 0;
            self.earlier = DailyLoad::NONE;
        }
        self.alert_rules = *rules;
    }

    /// Suppresses alerts for at least the next `snoozed_s` seconds. A pause or a snooze that lasts longer continues; 0 ends both.
    pub fn snooze_alerts(&mut self, snoozed_s: u16) {
        self.alerts.snooze(snoozed_s);
    }

    /// The load of the present day.
    pub fn daily_load(&self) -> DailyLoad {
        self.alerts.daily(&self.cumulative.totals, self.cumulative.sustained())
    }

    /// Restores the load that was stored before this start. Its day begins at the time of day that the present rules state. It
    /// is added if [`Insole::enter_day`] is called on the same day.
    pub fn restore_day(&mut self, earlier: &DailyLoad) {
        self.earlier = *earlier;
        self.earlier_start_min = self.alert_rules.day_start_min;
    }

    /// States the present time, us since 1970, from which the day follows. A new day begins without load. The first call after
    /// the start states the day of the load so far. A clock that is set back by one day begins no day. The load that was stored
    /// before the start is added once on its day, also if the first call stated another day by mistake.
    pub fn enter_day(&mut self, unix_us: u64) {
        let day = self.alert_rules.day(unix_us);
        let is_first = self.alerts.day == 0;
        if is_first {
            self.alerts.day = day;
        } else if self.alerts.day != day && self.alerts.day != day + 1 {
            self.begin_day(day);
        }
        // The rules may have changed since the start, but the stored load has the number of its day by the former ones.
        let earlier_rules = AlertRules { day_start_min: self.earlier_start_min, ..self.alert_rules };
        if self.alerts.day == day && self.earlier.day == earlier_rules.day(unix_us) {
            self.cumulative.totals.add(&self.earlier.totals);
            // A snooze from before the start may have been ended since the first call.
            let snoozed_s = if is_first { self.earlier.snoozed_s } else { 0 };
            self.alerts.add(&DailyLoad { snoozed_s, ..self.earlier });
            self.earlier = DailyLoad::NONE;
        }
    }

    fn begin_day(&mut self, day: u32) {
        self.cumulative.totals = Totals::NONE;
        self.alerts.begin_day(day);
    }

    /// The alert that was raised since the last call, if there is one. It is returned once.
    pub fn take_alert(&mut self) -> Option<AlertRecord> {
        let alert = self.alerts.take(self.setup.side, self.next_record, self.setup.period_us)?;
        self.next_record = self.next_record.wrapping_add(1);
        Some(AlertRecord { start_us: self.unwrapped_us(alert.start_us), ..alert })
    }
}

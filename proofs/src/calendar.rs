//! The encoding of the wall clock as the Bluetooth characteristic Current Time.

use plantar::protocol::current_time::{from_current_time, to_current_time};

/// A day of the calendar, computed by counting from [`Day::FIRST`], independently of the code under test.
#[derive(Clone, Copy, Debug)]
pub struct Day {
    year: u16,
    month: u8,
    day: u8,
    /// Monday is 1.
    weekday: u8,
}

impl Day {
    /// The first day of 1970, a Thursday.
    pub const FIRST: Self = Self { year: 1970, month: 1, day: 1, weekday: 4 };

    /// The year.
    pub fn year(self) -> u16 {
        self.year
    }

    fn is_last_of_month(self) -> bool {
        let is_leap_year =
            self.year.is_multiple_of(400) || self.year.is_multiple_of(4) && !self.year.is_multiple_of(100);
        let february = if is_leap_year { 29 } else { 28 };
        self.day == [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31][usize::from(self.month) - 1]
    }

    /// The next day.
    #[must_use]
    pub fn next(self) -> Self {
        let weekday = self.weekday % 7 + 1;
        match (self.is_last_of_month(), self.month) {
            (false, _) => Self { day: self.day + 1, weekday, ..self },
            (true, 12) => Self { year: self.year + 1, month: 1, day: 1, weekday },
            (true, month) => Self { month: month + 1, day: 1, weekday, ..self },
        }
    }

    /// The ten bytes of the characteristic for a time on this day: `second` since midnight, and `fraction` in 1/256 s.
    fn bytes(self, second: u32, fraction: u8) -> [u8; 10] {
        let [low, high] = self.year.to_le_bytes();
        let [hour, minute, second] = [second / 3600, second / 60 % 60, second % 60].map(|number| number as u8);
        [low, high, self.month, self.day, hour, minute, second, self.weekday, fraction, 0]
    }

    /// A time on this day is encoded as the bytes of this day, and they are decoded as this time, exact to a microsecond.
    /// `number` is the number of days from 1 January 1970 to this day, `second` and `fraction` (in 1/256 s) are the time since
    /// midnight.
    pub fn encoding(self, number: u64, second: u32, fraction: u8) {
        let bytes = self.bytes(second, fraction);
        // The first whole microsecond of this 1/256 s.
        let us = (u64::from(fraction) * 1_000_000).div_ceil(256);
        let unix_us = (number * 86_400 + u64::from(second)) * 1_000_000 + us;
        assert_eq!(to_current_time(Some(unix_us)), bytes);
        assert_eq!(from_current_time(&bytes), Some(unix_us - us + u64::from(fraction) * 1_000_000 / 256));
    }

    /// The bytes of the last second of this day, in which byte `field` (from 2, the month, to 9, the reason for the last
    /// adjustment) is replaced by `value`, are decoded if and only if their date and their time of day exist. Every day of the
    /// week, every fraction and every reason is accepted.
    pub fn field(self, field: usize, value: u8) {
        let mut bytes = self.bytes(86_399, 0);
        bytes[field] = value;
        let is_in_month = value <= self.day + self.days_left();
        let is_valid = match field {
            2 => return self.month_field(value, bytes),
            3 => value > 0 && is_in_month,
            4 => value < 24,
            5 | 6 => value < 60,
            _ => true,
        };
        assert_eq!(from_current_time(&bytes).is_some(), is_valid, "{bytes:?}");
    }

    /// Number of days of the month after this one.
    fn days_left(self) -> u8 {
        let mut day = self;
        let mut days = 0;
        while !day.is_last_of_month() {
            (day, days) = (day.next(), days + 1);
        }
        days
    }

    /// As [`Day::field`], for the month.
    fn month_field(self, month: u8, bytes: [u8; 10]) {
        let first = Self { month: month.clamp(1, 12), day: 1, ..self };
        let is_valid = (1..=12).contains(&month) && first.days_left() + 1 >= self.day;
        assert_eq!(from_current_time(&bytes).is_some(), is_valid, "{bytes:?}");
    }
}

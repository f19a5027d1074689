//! The wall clock as the Bluetooth characteristic Current Time. Its ten bytes are: year (two bytes, little endian), month, day,
//! hour, minute, second, day of the week (Monday is 1), fraction of the second in 1/256 s, and reason for the last adjustment.

/// Length of a day, us.
const DAY_US: u64 = 86_400_000_000;

/// Number of days of a month; `month` is 1 to 12. The function is not inlined, because several copies would take flash.
#[inline(never)]
const fn month_days(year: u16, month: u8) -> u64 {
    match month {
        2 if year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400)) => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

/// Number of days of a year: 337 outside of February.
const fn year_days(year: u16) -> u64 {
    337 + month_days(year, 2)
}

/// Encodes a time, us since 1970, as ten bytes. `None` is encoded as ten zeros, which stand for an unknown time.
pub fn to_current_time(unix_us: Option<u64>) -> [u8; 10] {
    let Some(unix_us) = unix_us else { return [0; 10] };
    let (mut day, in_day_us) = (unix_us / DAY_US, unix_us % DAY_US);
    // 1 January 1970 was a Thursday.
    let weekday = (day + 3) % 7 + 1;
    let (mut year, mut month) = (1970, 1);
    // The characteristic allows years up to 9999.
    while year < 9999 && day >= year_days(year) {
        day -= year_days(year);
        year += 1;
    }
    while month < 12 && day >= month_days(year, month) {
        day -= month_days(year, month);
        month += 1;
    }
    let in_day_s = in_day_us / 1_000_000;
    let [low, high] = year.to_le_bytes();
    let fraction = (in_day_us % 1_000_000) * 256 / 1_000_000;
    let [day, hour, minute, second] =
        [day.min(30) + 1, in_day_s / 3600, in_day_s / 60 % 60, in_day_s % 60].map(|number| number as u8);
    [low, high, month, day, hour, minute, second, weekday as u8, fraction as u8, 0]
}

/// Decodes ten bytes to a time, us since 1970; `None` if they are not a valid time since then. The day of the week and the reason
/// for the adjustment are ignored.
pub fn from_current_time(bytes: &[u8]) -> Option<u64> {
    let &[low, high, month, day, hour, minute, second, _, fraction, _] = bytes else { return None };
    let year = u16::from_le_bytes([low, high]);
    if !(1970..=9999).contains(&year) || !(1..=12).contains(&month) || hour > 23 || minute > 59 || second > 59 {
        return None;
    }
    if day == 0 || u64::from(day) > month_days(year, month) {
        return None;
    }
    let days = (1970..year).map(year_days).sum::<u64>()
        + (1..month).map(|month| month_days(year, month)).sum::<u64>()
        + u64::from(day - 1);
    let seconds = (u64::from(hour) * 60 + u64::from(minute)) * 60 + u64::from(second);
    Some(days * DAY_US + seconds * 1_000_000 + u64::from(fraction) * 1_000_000 / 256)
}

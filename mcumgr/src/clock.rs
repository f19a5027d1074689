//! The wall clock as text, `2026-03-31T12:34:56`.

use heapless::String;

/// Length of a date with a time of day, characters.
const LEN: usize = 19;
/// Positions of month, day, hour, minute and second in a text.
const NUMBERS: [usize; 5] = [5, 8, 11, 14, 17];

/// Minutes of a day.
pub const DAY_MIN: i16 = 24 * 60;

/// A date and a time of day. The date or the time may not exist, for example February 31.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    /// The year.
    pub year: u16,
    /// Month, from 1, day, from 1, hour, minute and second.
    pub numbers: [u8; 5],
    /// How far the clock is ahead of coordinated universal time (UTC), minutes; ±[`DAY_MIN`] for a zone that does not exist.
    pub zone_min: i16,
}

impl Clock {
    /// The text, without the zone.
    pub(super) fn text(&self) -> String<LEN> {
        let mut text = String::new();
        let mut push = |number: u16, digits: u32, end: &str| {
            for place in (0..digits).rev() {
                let digit = number / 10_u16.pow(place) % 10;
                // There is room for all characters of the text.
                let _ = text.push((b'0' + digit as u8) as char);
            }
            let _ = text.push_str(end);
        };
        push(self.year, 4, "-");
        for (number, end) in self.numbers.into_iter().zip(["-", "T", ":", ":", ""]) {
            push(number.into(), 2, end);
        }
        text
    }

    /// Reads a text with an optional fraction of the second, which is ignored, and an optional zone, `Z` or `+01:00`; without a
    /// zone, the time is in UTC. `None` if the text has another form.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let (time, after_time) = text.split_at_checked(LEN)?;
        let separators = [4, 7, 10, 13, 16].map(|at| time.as_bytes()[at]);
        if separators != *b"--T::" {
            return None;
        }
        let mut numbers = [0; 5];
        for (number, from) in numbers.iter_mut().zip(NUMBERS) {
            *number = digits(time.get(from..from + 2)?)? as u8;
        }
        let after_fraction = match after_time.strip_prefix('.') {
            Some(fraction) => {
                let zone = fraction.trim_start_matches(|digit: char| digit.is_ascii_digit());
                (zone.len() < fraction.len()).then_some(zone)?
            }
            None => after_time,
        };
        let zone_min = match after_fraction {
            "" | "Z" => 0,
            zone => {
                let (hours, minutes) =
                    zone.get(1..)?.split_once(':').filter(|(hours, minutes)| hours.len() == 2 && minutes.len() == 2)?;
                let zone_min = match (digits(hours)?, digits(minutes)?) {
                    (hours @ 0..24, minutes @ 0..60) => (hours * 60 + minutes) as i16,
                    _ => DAY_MIN,
                };
                match zone.as_bytes()[0] {
                    b'+' => zone_min,
                    b'-' => -zone_min,
                    _ => return None,
                }
            }
        };
        Some(Self { year: digits(time.get(..4)?)?, numbers, zone_min })
    }
}

/// The number that a text of one to four digits represents; `None` for any other text.
fn digits(text: &str) -> Option<u16> {
    let are_digits = (1..=4).contains(&text.len()) && text.bytes().all(|digit| digit.is_ascii_digit());
    are_digits.then(|| text.bytes().fold(0, |number, digit| 10 * number + u16::from(digit - b'0')))
}

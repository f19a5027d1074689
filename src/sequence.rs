//! Wrapping sequence numbers: the one comparison that the firmware, the host programs and the web page for a phone share.
//!
//! Numbers count modulo 2^32. Number `a` is later than number `b` if the difference `a - b` modulo 2^32 is from 1 to
//! 2^31 - 1, as in RFC 1982 (serial number arithmetic).

/// True if number `a` comes after number `b`.
pub const fn is_after(a: u32, b: u32) -> bool {
    a != b && a.wrapping_sub(b) < 1 << 31
}

/// Number of values that were skipped between `expected` and `received`; 0 if `received` comes before `expected`, as after a
/// restart.
pub const fn skipped(expected: u32, received: u32) -> u32 {
    if is_after(received, expected) { received.wrapping_sub(expected) } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::{is_after, skipped};

    #[test]
    fn a_number_is_later_if_it_is_ahead_by_less_than_half_of_the_range() {
        assert!(is_after(1, 0) && !is_after(0, 1) && !is_after(7, 7));
        assert!(is_after(0, u32::MAX) && !is_after(u32::MAX, 0));
        assert!(is_after(1 << 31, 1) && !is_after((1 << 31) + 1, 1));
    }

    #[test]
    fn a_gap_counts_forwards_only() {
        assert_eq!(skipped(10, 10), 0);
        assert_eq!(skipped(10, 13), 3);
        assert_eq!(skipped(u32::MAX, 1), 2);
        assert_eq!(skipped(10, 3), 0);
    }
}

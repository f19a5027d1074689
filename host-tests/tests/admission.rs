//! Centrals that occupy an insole without an encrypted link, in virtual time.

use embassy_time::Duration;
use plantar::firmware::admission::Admission;
use testkit::virtual_time::{advance_to, now_us};

/// Resolution with which the virtual time advances, us.
const STEP_US: u64 = 200_000;

/// Connects a central that never encrypts its link, again and again, until `for_us` has passed. Each connection ends `early_us`
/// before the central's time limit. Returns the fraction of the time in which the central occupied the insole, and its longest
/// connection, us. The central connects half a second after the end of its last connection. The firmware does not enforce this
/// pause: the fraction holds for such a central, not for one that connects at once.
fn occupied(admission: &mut Admission, early_us: u64, for_us: u64) -> (f64, u64) {
    let start_us = now_us();
    let (mut occupied_us, mut longest_us) = (0, 0);
    while now_us() < start_us + for_us {
        let connected_us = now_us();
        while now_us() - connected_us + early_us < admission.time_limit(false, false).as_micros() {
            advance_to(now_us() + STEP_US);
        }
        admission.ended(Duration::from_micros(now_us() - connected_us), false);
        occupied_us += now_us() - connected_us;
        longest_us = longest_us.max(now_us() - connected_us);
        advance_to(now_us() + 500_000);
    }
    (occupied_us as f64 / (now_us() - start_us) as f64, longest_us)
}

#[test]
fn a_central_without_a_bond_is_disconnected_sooner_after_it_occupied_the_insole() {
    let mut admission = Admission::new();
    assert_eq!(admission.time_limit(false, false).as_secs(), 30);
    // A single connection.
    let (_, longest_us) = occupied(&mut admission, 0, 1);
    assert_eq!(longest_us, 30_000_000);
    // From then on, a central without a bond is disconnected after 2 s.
    let (fraction, longest_us) = occupied(&mut admission, 0, 3_600_000_000);
    assert!(longest_us <= 2_000_000 + STEP_US && fraction < 0.85, "{longest_us} us, {fraction}");
    // The owner's phone still has the full time, and so has a new phone while bonding is open.
    assert_eq!(admission.time_limit(true, false).as_secs(), 30);
    assert_eq!(admission.time_limit(false, true).as_secs(), 30);
    advance_to(now_us() + 300_000_000);
    assert_eq!(admission.time_limit(false, false).as_secs(), 30, "the short time limit must end");
}

/// The central disconnects shortly before the insole would disconnect it.
#[test]
fn a_central_that_disconnects_itself_in_time_has_a_shorter_limit_from_then_on() {
    let mut admission = Admission::new();
    let (_, longest_us) = occupied(&mut admission, 400_000, 1);
    assert!(longest_us > 29_000_000, "{longest_us} us");
    let (fraction, longest_us) = occupied(&mut admission, 400_000, 3_600_000_000);
    assert!(longest_us <= 2_000_000 && fraction < 0.85, "{longest_us} us, {fraction}");
}

#[test]
fn a_phone_that_was_admitted_and_a_short_connection_raise_no_suspicion() {
    let mut admission = Admission::new();
    admission.ended(Duration::from_secs(3600), true);
    admission.ended(Duration::from_millis(500), false);
    assert_eq!(admission.time_limit(false, false).as_secs(), 30);
}

//! The baselines are measured on request, under a lifted foot only.

use plantar::insole::{Insole, NotLifted};
use plantar::pipeline::baseline::{ZERO_S, ZeroResult};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use recording::{Recording, VirtualInsole};
use testkit::activity::{self, Activity};

const RATE_HZ: usize = 100;
/// Pressure of the shoe on all cells from [`LACED_S`] on, kPa.
const SHOE_KPA: f32 = 5.0;
/// Time at which the wearer laces the shoe, while the foot is lifted, s.
const LACED_S: usize = 16;

/// A recording of a wearer who walks, lifts the foot, laces the shoe while the foot is lifted, and continues with `last`.
fn wearer(last: Activity) -> Recording {
    let activities = [Activity::Walk, Activity::Lift, last];
    let (mut recording, _) = activity::recording(&activities, 650.0, RATE_HZ as f64, 10.0, 3);
    let laced = LACED_S * RATE_HZ * recording.cells();
    recording.pressure_kpa[laced..].iter_mut().for_each(|kpa| *kpa += SHOE_KPA);
    recording
}

/// Requests a measurement after `request_s` seconds. Returns its outcome, the number of seconds from the request to the
/// outcome, and the total force two seconds after the outcome, N.
fn request_after(recording: &Recording, request_s: usize) -> (Result<ZeroResult, NotLifted>, usize, f64) {
    let virtual_insole = VirtualInsole::new(recording, ContactRule::COVERED, StanceRule::ADAPTIVE);
    let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("the set-up is valid");
    let mut codes = vec![0; virtual_insole.cells.len()];
    let (mut second, mut outcome) = (0, None);
    for i in 0..recording.frames() {
        virtual_insole.codes_of(recording, i, &mut codes);
        if insole.frame(i as u32, &codes) {
            insole.whole_step();
        }
        if !insole.has_ended_second() {
            continue;
        }
        second += 1;
        let taken = insole.take_zero().map(|result| (result, second));
        if second == request_s {
            insole.request_zero();
        }
        assert!(outcome.is_none() || taken.is_none(), "a request must have only one outcome");
        outcome = outcome.or(taken);
        if let Some((result, at_s)) = outcome
            && second == at_s + 2
        {
            let total_n = insole.loads().iter().map(|load| f64::from(load.frame.force.force_n)).sum();
            return (result, at_s - request_s, total_n);
        }
    }
    panic!("the recording ends before, or less than two seconds after, the outcome: {outcome:?}");
}

#[test]
fn the_reading_of_a_lifted_foot_becomes_the_baseline_at_once() {
    let recording = wearer(Activity::Lift);
    let (result, duration_s, total_n) = request_after(&recording, LACED_S + 2);
    let result = result.expect("the foot is lifted");
    assert!(duration_s <= 1, "{duration_s}");
    assert_eq!(usize::from(result.changed), recording.cells());
    assert_eq!(result.with_former_baseline, [0; 8]);
    let shoe_n = recording.layout.force_n(&vec![SHOE_KPA; recording.cells()]);
    let found_n: f64 = result.residual_dn.iter().map(|dn| f64::from(*dn) / 10.0).sum();
    // The shoe changes every code by hundreds, and a baseline ignores changes of up to 32 codes. The noise, 12 codes of an
    // unloaded cell, is at most 0.02 kPa.
    assert!((found_n - shoe_n).abs() < 0.02 * shoe_n, "{found_n} N for {shoe_n} N");
    assert!(total_n.abs() < 0.02 * shoe_n, "{total_n} N remain of {shoe_n} N");
}

#[test]
fn a_measurement_under_a_standing_foot_is_refused_and_the_foot_remains_loaded() {
    let recording = wearer(Activity::Stand);
    // The wearer stands in the last 10 s of the recording.
    let standing_s = recording.frames() / RATE_HZ - 9;
    let (result, duration_s, total_n) = request_after(&recording, standing_s);
    assert_eq!((result, duration_s), (Err(NotLifted), usize::from(ZERO_S)));
    assert!(total_n > 200.0, "{total_n} N");
}

#[test]
fn a_foot_that_is_lifted_after_the_request_is_measured() {
    let activities = [Activity::Walk, Activity::Stand, Activity::Lift];
    let (recording, spans) = activity::recording(&activities, 650.0, RATE_HZ as f64, 10.0, 3);
    let lifted_s = spans[2].1.start / RATE_HZ;
    let (result, duration_s, _) = request_after(&recording, lifted_s - 2);
    assert!(result.is_ok() && (2..=usize::from(ZERO_S)).contains(&duration_s), "{result:?} after {duration_s} s");
}

#[test]
fn a_new_set_up_ends_a_requested_measurement_without_an_outcome() {
    let recording = wearer(Activity::Lift);
    let virtual_insole = VirtualInsole::new(&recording, ContactRule::COVERED, StanceRule::ADAPTIVE);
    let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    for _ in 0..2 {
        insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("the set-up is valid");
        assert!(!insole.is_zero_requested() && insole.take_zero().is_none());
        insole.request_zero();
        assert!(insole.is_zero_requested());
    }
}

//! Load bouts: all load that is not part of a step.

use plantar::insole::Insole;
use plantar::pipeline::bout::{BoutKind, BoutRecord, BoutRegion};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::{Setup, SetupCell};
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{Bout, LoadRecord};
use plantar::{Region, Side};
use testkit::activity::{Activity, recognised, recording, sequences};
use testkit::wear::{Residual, find, with_residual};
use testkit::{LAW, SETUP, cell, code_of};

/// A child, an adult, and a heavy person, in sequences of activities.
#[test]
fn each_newton_second_is_part_of_one_record_and_kinds_are_recognised() {
    let (mut labelled, mut correct) = (0, 0);
    for (weight_n, rate_hz) in [(150.0, 100.0), (650.0, 50.0), (650.0, 100.0), (650.0, 400.0), (1_770.0, 100.0)] {
        for (order, seed) in sequences().zip(1..) {
            let (recording, spans) = recording(&order, weight_n, rate_hz, 20.0, seed);
            let found = find(&recording, ContactRule::COVERED, StanceRule::ADAPTIVE);
            let share = found.unassigned(rate_hz);
            // The number of activities for which a kind of bout is expected, and of those for which it was found.
            let counts = recognised(&spans, &found, (1e6 / rate_hz) as u64);
            println!("{weight_n} N, {rate_hz} Hz, {order:?}: {} steps, {counts:?}, {share:.6}", found.steps.len());
            assert!(share < 0.001, "{weight_n} N, {rate_hz} Hz: {share}");
            labelled += counts.0;
            correct += counts.1;
        }
    }
    println!("{correct} of {labelled} recognised");
    assert!(correct as f64 >= 0.95 * labelled as f64, "{correct} of {labelled}");
}

#[test]
fn load_in_a_tight_shoe_is_part_of_one_record() {
    for residual in Residual::ALL {
        let (recording, _) = recording(&Activity::ALL, 700.0, 100.0, 8.0, 3);
        let found = find(&with_residual(recording, residual, 4.0), ContactRule::COVERED, StanceRule::ADAPTIVE);
        let share = found.unassigned(100.0);
        println!("{residual:?}: {share:.6}");
        assert!(share < 0.001, "{residual:?}: {share}");
    }
}

/// The recording ends at different moments of an activity, also at one in which two bouts are completed at once.
#[test]
fn load_at_the_end_of_a_recording_is_part_of_one_record() {
    for half_seconds in 1..16 {
        let activities = [Activity::Walk, Activity::Stand, Activity::Stand, Activity::Sit, Activity::Stand];
        for count in 3..=activities.len() {
            let seconds = f64::from(half_seconds) / 2.0;
            let (recording, _) = recording(&activities[..count], 650.0, 100.0, seconds, 2);
            let found = find(&recording, ContactRule::COVERED, StanceRule::ADAPTIVE);
            let share = found.unassigned(100.0);
            assert!(share < 0.001, "{count} activities of {seconds} s: {share}");
        }
    }
}

/// A bout is classified in windows of 2 s, and its longest duration is a minute. At this frame rate, 30 windows are a little
/// shorter than a minute, so the bout reaches a minute in window 31. The foot leaves the ground just after that, while window 31
/// is still too short to have a kind.
#[test]
fn a_bout_of_the_longest_duration_ends_with_the_last_frame_of_its_contact() {
    const PERIOD_US: u32 = 6_667;
    let heel_cell = |i: u8| SetupCell { row_column: i, ..cell(Region::Heel, f32::from(i) * 10.0, 0.0, 100.0) };
    let mut insole = Box::new(Insole::<f64, 16>::new());
    insole.set_up(Setup { period_us: PERIOD_US, ..SETUP }, (0..16).map(heel_cell)).expect("the set-up is accepted");
    let (mut on_ground_frames, mut bout) = (0, None);
    for seq in 0..9_100 {
        let pressure_kpa = if seq < 9_020 { 300.0 } else { 0.0 };
        insole.frame(seq, &[code_of(&LAW, pressure_kpa); 16]);
        on_ground_frames += u32::from(insole.on_ground());
        bout = bout.or(insole.take_bout());
    }
    let bout = bout.expect("a bout has ended");
    assert_eq!((bout.kind, bout.start_us), (BoutKind::Standing, 0));
    assert_eq!(bout.duration_us, on_ground_frames * PERIOD_US);
}

/// The units of the message are 0.01 N s, 0.1 kPa s and 0.1 kPa: 12.346 N s are 1,234.6 units, which are rounded to 1,235.
#[test]
fn the_message_of_a_load_bout_has_the_nearest_integers() {
    let region = BoutRegion { integral_n_s: 12.346, pressure_integral_kpa_s: 56.74, peak_pressure_kpa: 123.46 };
    let kind = BoutKind::Standing;
    let record = BoutRecord { side: Side::Right, number: 7, kind, start_us: 11, duration_us: 12, regions: [region; 8] };
    let bout = Bout { boots_since: 3, start_unix_us: Some(13), ..Bout::new(&record) };
    assert_eq!((bout.side, bout.number, bout.kind, bout.duration_us), (Side::Right, 7, kind, 12));
    assert_eq!(LoadRecord::from(bout).start(), (3, 11, Some(13)));
    for region in bout.regions {
        let integers = (region.measured_integral_cns, region.pressure_integral_dkpas, region.peak_pressure_dkpa);
        assert_eq!(integers, (1_235, 567, 1_235));
    }
}

/// Slow steps that last longer than a stance may, 2.5 s: each is a contact of 3 s. When a contact has lasted 2.5 s, its curves
/// contain only every fourth frame.
#[test]
fn slow_contacts_at_400_hz_have_their_load_and_their_peaks_and_are_no_bout_of_sitting() {
    const RATE_HZ: f64 = 400.0;
    let layout = recording::synthetic::insole(144);
    let (cells, mut pressure_kpa) = (layout.cells.len(), Vec::new());
    let frames = 40 * 400;
    for frame in 0..frames {
        // 3 s on the ground and 1 s in swing.
        let in_stride = frame % 1600;
        let kpa = if in_stride < 1200 { 35.0 + 5.0 * (in_stride as f32 / 30.0).sin() } else { 1.0 };
        pressure_kpa.extend((0..cells).map(|_| kpa));
        if in_stride == 101 {
            *pressure_kpa.last_mut().expect("the insole has cells") = 250.0;
        }
    }
    let recording = recording::Recording {
        side: Side::Left,
        layout,
        rate_hz: RATE_HZ,
        source: "computed slow steps".into(),
        t_s: (0..frames).map(|frame| frame as f64 / RATE_HZ).collect(),
        pressure_kpa,
    };
    let found = find(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    assert!(found.steps.is_empty() && found.unassigned(RATE_HZ) < 0.001, "{}", found.unassigned(RATE_HZ));
    let total_n_s =
        |bout: &BoutRecord<f32>| bout.regions.iter().map(|region| f64::from(region.integral_n_s)).sum::<f64>();
    let light = found.bouts.iter().filter(|bout| matches!(bout.kind, BoutKind::Sitting | BoutKind::Unclassified));
    let (light_n_s, all_n_s): (f64, f64) = (light.map(total_n_s).sum(), found.bouts.iter().map(total_n_s).sum());
    assert!(light_n_s < 0.05 * all_n_s, "{light_n_s} of {all_n_s} N s");
    let peaks = found.bouts.iter().flat_map(|bout| &bout.regions).map(|region| region.peak_pressure_kpa);
    assert!((peaks.fold(0.0, f32::max) - 250.0).abs() < 0.5);
}

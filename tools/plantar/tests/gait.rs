//! Tests `plantar gait`, which computes the measures of both feet from a stream file or from recordings.

use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::protocol::{Step, StepFoot, StepRegion, ToHost};
use recording::synthetic::{SyntheticWalk, walk};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

/// Stride time, us.
const STRIDE_US: u64 = 1_100_000;
/// Time from the left to the right heel strike, us.
const LAG_US: u64 = 500_000;

fn gait(folder: &Path, arguments: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plantar"));
    command.arg("gait").args(arguments.split_whitespace()).current_dir(folder).output().expect("the program starts")
}

/// The measures that the command writes, and the text that it prints.
fn measures(folder: &Path, arguments: &str) -> (Value, String) {
    let output = gait(folder, &format!("{arguments} --json gait.json"));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    let json = std::fs::read_to_string(folder.join("gait.json")).expect("a file");
    (serde_json::from_str(&json).expect("JSON"), text)
}

/// The mean of a measure for `side`, which is `left`, `right` or `symmetry_percent`.
fn mean(gait: &Value, key: &str, side: &str) -> f64 {
    let measures = gait["measures"].as_array().expect("measures");
    let measure = measures.iter().find(|measure| measure["key"] == key).expect("the key");
    measure[side]["mean"].as_f64().unwrap_or(f64::NAN)
}

/// A step of the walk, by the clock of an insole that is `ahead_us` ahead of the walk's clock.
fn step(side: Side, number: u32, ahead_us: u64) -> Step {
    let (lag_us, duration_us, peak_dn) =
        if side == Side::Left { (0, 700_000, 8_000) } else { (LAG_US, 650_000, 7_600) };
    Step {
        step: number,
        side,
        start_us: 1_000_000 + ahead_us + lag_us + u64::from(number) * STRIDE_US,
        duration_us,
        sample_us: 10_000,
        bridged_frames: 0,
        saturated: 0,
        clamped: 0,
        contact_rule: ContactRule::COUNTED,
        foot: StepFoot { peak_dn, integral_dns: 3_000, ..StepFoot::default() },
        regions: [StepRegion::default(); 8],
        boots_since: 0,
        start_unix_us: None,
        refit: 0,
    }
}

/// Writes a stream file with the steps of both feet. The clocks of the insoles differ by 85 s; if `has_times`, the file has
/// messages that relate them to the host's clock, which is that of the walk.
fn write_stream(path: &Path, has_times: bool) {
    let mut file = Vec::new();
    let mut append = |insole, message: &ToHost| client::append(&mut file, 0, insole, message).expect("it fits");
    for (insole, side, ahead_us) in [(0, Side::Left, 5_000_000), (1, Side::Right, 90_000_000)] {
        if has_times {
            append(insole, &ToHost::Time { host_us: 100, device_us: 100 + ahead_us });
        }
        for number in 0..10 {
            append(insole, &ToHost::Step(step(side, number, ahead_us)));
        }
        // The insole sends the last step again.
        append(insole, &ToHost::Step(step(side, 9, ahead_us)));
    }
    std::fs::write(path, file).expect("written");
}

#[test]
fn a_stream_has_the_measures_of_both_feet_on_the_clock_of_the_host() {
    let folder = tempfile::tempdir().expect("a folder");
    write_stream(&folder.path().join("walk.plantar"), true);
    let (gait, text) = measures(folder.path(), "walk.plantar --stride-length 1.32");
    assert_eq!(gait["strides"], serde_json::json!({ "left": 9, "right": 9 }));
    for (key, left, right) in [
        ("stride_time_s", 1.1, 1.1),
        ("step_time_s", 0.6, 0.5),
        ("double_support_s", 0.25, 0.25),
        ("peak_force_n", 800.0, 760.0),
    ] {
        assert!((mean(&gait, key, "left") - left).abs() < 1e-6, "{key}: {gait:#}");
        assert!((mean(&gait, key, "right") - right).abs() < 1e-6, "{key}: {gait:#}");
    }
    // 200 (800 - 760) / (800 + 760)
    assert!((mean(&gait, "peak_force_n", "symmetry_percent") - 5.128_205).abs() < 1e-5);
    assert!((gait["speed_m_s"].as_f64().expect("a speed") - 1.2).abs() < 1e-6);
    // (300 + 300) N s in 1.1 s, and 545.45 N / 9.80665 m/s2.
    assert!(text.contains("over whole strides: 545 N, the weight of 55.6 kg"), "{text}");
    assert!(text.contains("Walking speed: 1.20 m/s") && text.contains("Double support"), "{text}");
    assert!(text.contains("difference of the force scales"), "{text}");
}

/// The limits are those of the page.
#[test]
fn a_stride_length_is_accepted_within_its_limits_only() {
    let folder = tempfile::tempdir().expect("a folder");
    write_stream(&folder.path().join("walk.plantar"), true);
    for stride_m in ["0.1", "6"] {
        measures(folder.path(), &format!("walk.plantar --stride-length {stride_m}"));
    }
    for stride_m in ["0.09", "6.01", "-1", "long"] {
        let output = gait(folder.path(), &format!("walk.plantar --stride-length {stride_m}"));
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && text.contains("metres, 0.1 to 6"), "{stride_m}: {text}");
    }
}

/// An insole sends its stored steps before its first time message.
#[test]
fn steps_before_the_first_time_message_of_an_insole_are_used() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut file = Vec::new();
    let mut append = |insole, message: &ToHost| client::append(&mut file, 0, insole, message).expect("it fits");
    for (insole, side, ahead_us) in [(0, Side::Left, 5_000_000), (1, Side::Right, 90_000_000)] {
        (0..10).for_each(|number| append(insole, &ToHost::Step(step(side, number, ahead_us))));
        append(insole, &ToHost::Time { host_us: 100, device_us: 100 + ahead_us });
    }
    std::fs::write(folder.path().join("stored.plantar"), file).expect("written");
    write_stream(&folder.path().join("walk.plantar"), true);
    let [stored, live] = ["stored.plantar", "walk.plantar"].map(|name| measures(folder.path(), name).0);
    assert_eq!(stored, live);
}

/// The stated frame rate of one foot is wrong by 0.5 %, and the virtual insole knows only this rate.
#[test]
fn times_of_recordings_are_those_of_their_frames() {
    let folder = tempfile::tempdir().expect("a folder");
    for (side, lag_s, rate_hz) in [(Side::Left, 0.0, 100.0), (Side::Right, 0.4, 100.5)] {
        let mut recording =
            walk(&SyntheticWalk { side, steps: 30, variation: 0.0, ..SyntheticWalk::default() }).recording;
        recording.t_s.iter_mut().for_each(|t_s| *t_s += lag_s);
        recording.rate_hz = rate_hz;
        recording.write(folder.path().join(format!("{}.parquet", side.name()))).expect("written");
    }
    let (gait, _) = measures(folder.path(), "left.parquet right.parquet");
    let SyntheticWalk { stance_s, swing_s, .. } = SyntheticWalk::default();
    for key in ["stride_time_s", "stance_time_s"] {
        assert!((mean(&gait, key, "left") - mean(&gait, key, "right")).abs() < 1e-6, "{key}: {gait:#}");
    }
    assert!((mean(&gait, "step_time_s", "right") - 0.4).abs() < 1e-6, "{gait:#}");
    assert!((mean(&gait, "step_time_s", "left") - (stance_s + swing_s - 0.4)).abs() < 1e-6, "{gait:#}");
}

/// A walk of each foot, with the rate and the origin of each. Returns the text on stderr, and whether the command succeeded.
fn feet(rates_hz: [f64; 2], sources: [&str; 2]) -> (String, bool) {
    let folder = tempfile::tempdir().expect("a folder");
    for ((side, rate_hz), source) in [Side::Left, Side::Right].into_iter().zip(rates_hz).zip(sources) {
        let mut recording = walk(&SyntheticWalk { side, steps: 6, rate_hz, ..SyntheticWalk::default() }).recording;
        recording.source = source.into();
        recording.write(folder.path().join(format!("{}.parquet", side.name()))).expect("written");
    }
    let output = gait(folder.path(), "left.parquet right.parquet");
    (String::from_utf8_lossy(&output.stderr).into_owned(), output.status.success())
}

#[test]
fn feet_with_different_rates_are_refused_and_feet_of_different_measurements_are_noted() {
    let one = ["pedar measurement ann.asc, left insole.", "pedar measurement ann.asc, right insole."];
    let (text, succeeds) = feet([50.0, 100.0], one);
    assert!(!succeeds && text.contains("50.00 and 100.00 Hz") && text.contains("--rate"), "{text}");
    let (text, succeeds) = feet([100.0, 100.0], one);
    assert!(succeeds && text.is_empty(), "{text}");
    let (text, succeeds) = feet([100.0, 100.0], ["Tekscan measurement bob.asf, regions by template.", one[1]]);
    assert!(succeeds && text.contains("note:") && text.contains("bob.asf") && text.contains("ann.asc"), "{text}");
}

/// A stride needs two steps, and an interval three strides.
#[test]
fn missing_strides_and_intervals_are_explained() {
    let folder = tempfile::tempdir().expect("a folder");
    for (steps, explains_strides, explains_intervals) in [(1, true, false), (3, false, true), (30, false, false)] {
        let recording = walk(&SyntheticWalk { side: Side::Left, steps, ..SyntheticWalk::default() }).recording;
        recording.write(folder.path().join("left.parquet")).expect("written");
        let output = gait(folder.path(), "left.parquet");
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{text}");
        let is_explained = text.contains("two successive steps of a foot, and the walk has 1 step of the left");
        assert_eq!(is_explained, explains_strides, "{steps}: {text}");
        assert_eq!(text.contains("A mean without an interval"), explains_intervals, "{steps}: {text}");
        assert!(text.contains("- No value"), "the measures of both feet: {text}");
    }
}

/// Each of two insoles has a clock of its own.
#[test]
fn recordings_of_two_insoles_are_not_compared_in_time() {
    let folder = tempfile::tempdir().expect("a folder");
    for side in [Side::Left, Side::Right] {
        let mut recording = walk(&SyntheticWalk { side, steps: 10, ..SyntheticWalk::default() }).recording;
        recording.layout.name = format!("insole 0x1a, {} cells", recording.cells());
        recording.write(folder.path().join(format!("{}.parquet", side.name()))).expect("written");
    }
    let (gait, _) = measures(folder.path(), "left.parquet right.parquet");
    assert!(mean(&gait, "stride_time_s", "left") > 0.0 && mean(&gait, "step_time_s", "left").is_nan(), "{gait:#}");
}

#[test]
fn a_stream_without_a_common_clock_has_the_measures_of_each_foot() {
    let folder = tempfile::tempdir().expect("a folder");
    write_stream(&folder.path().join("walk.plantar"), false);
    let (gait, text) = measures(folder.path(), "walk.plantar --distance 10");
    assert_eq!(gait["has_both_feet"], false);
    assert!(text.contains("- No value") && text.contains("the feet are not compared"), "{text}");
    assert!(!text.contains("force scales"), "{text}");
    assert!((mean(&gait, "stance_time_s", "right") - 0.65).abs() < 1e-9);
    assert!(mean(&gait, "step_time_s", "left").is_nan() && gait["speed_m_s"].is_null());
}

#[test]
fn recordings_of_both_feet_have_their_true_stride_and_step_times() {
    let folder = tempfile::tempdir().expect("a folder");
    for (side, lag_s) in [(Side::Left, 0.0), (Side::Right, 0.4)] {
        let mut recording =
            walk(&SyntheticWalk { side, steps: 6, variation: 0.0, ..SyntheticWalk::default() }).recording;
        recording.t_s.iter_mut().for_each(|t_s| *t_s += lag_s);
        recording.write(folder.path().join(format!("{}.parquet", side.name()))).expect("written");
    }
    let (gait, _) = measures(folder.path(), "left.parquet right.parquet");
    let SyntheticWalk { stance_s, swing_s, .. } = SyntheticWalk::default();
    assert!((mean(&gait, "stride_time_s", "left") - (stance_s + swing_s)).abs() < 1e-6, "{gait:#}");
    assert!((mean(&gait, "step_time_s", "right") - 0.4).abs() < 1e-6, "{gait:#}");
    assert!((mean(&gait, "step_time_s", "left") - (stance_s + swing_s - 0.4)).abs() < 1e-6, "{gait:#}");
    // An earlier toe off, at a higher force, makes the stance shorter, but not the stride.
    let (earlier, _) = measures(folder.path(), "left.parquet right.parquet --thresholds absolute --release 300");
    assert!(mean(&earlier, "stance_time_s", "left") < mean(&gait, "stance_time_s", "left"), "{earlier:#}");
    assert!((mean(&earlier, "stride_time_s", "left") - (stance_s + swing_s)).abs() < 1e-6, "{earlier:#}");
    // A recording can also be a folder with its parts, as `plantar record --cells` writes it.
    std::fs::create_dir(folder.path().join("cells")).expect("made");
    std::fs::copy(folder.path().join("left.parquet"), folder.path().join("cells/0.parquet")).expect("copied");
    assert_eq!(measures(folder.path(), "cells right.parquet").0, gait);
    let output = self::gait(folder.path(), "left.parquet left.parquet");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && text.contains("one file for each foot"), "{text}");
}

/// Writes a recording at 100 Hz in which the foot carries `force_n` from `start_s` on, for `duration_s`, in each of these
/// contacts. The force begins and ends within one frame. The recording ends a second after the last contact.
fn write_contacts(path: &Path, side: Side, contacts: impl Iterator<Item = (f64, f64, f64)>) {
    write_at(100.0, path, side, 0.0, contacts);
}

/// As [`write_contacts`], at another rate. The shoe presses with `shoe_n` in every frame.
fn write_at(rate_hz: f64, path: &Path, side: Side, shoe_n: f64, contacts: impl Iterator<Item = (f64, f64, f64)>) {
    let mut recording = walk(&SyntheticWalk { side, steps: 1, ..SyntheticWalk::default() }).recording;
    let cells = recording.cells();
    let area_mm2: f64 = recording.layout.cells.iter().map(|cell| cell.area_mm2).sum();
    let kpa = |force_n: f64| (1e3 * force_n / area_mm2) as f32;
    let frame = |t_s: f64| (t_s * rate_hz).round() as usize;
    recording.rate_hz = rate_hz;
    recording.pressure_kpa.clear();
    for (start_s, duration_s, force_n) in contacts {
        recording.pressure_kpa.resize(frame(start_s) * cells, kpa(shoe_n));
        recording.pressure_kpa.resize(frame(start_s + duration_s) * cells, kpa(shoe_n + force_n));
    }
    let frames = recording.pressure_kpa.len() / cells + rate_hz as usize;
    recording.pressure_kpa.resize(frames * cells, kpa(shoe_n));
    recording.t_s = (0..frames).map(|i| i as f64 / rate_hz).collect();
    recording.write(path).expect("written");
}

/// Contacts that begin at `from_s`, each `stride_s` after the one before it, until 19 s.
fn regular(from_s: f64, stride_s: f64, duration_s: f64, force_n: f64) -> impl Iterator<Item = (f64, f64, f64)> {
    let count = ((19.0 - from_s) / stride_s) as u32;
    (0..count).map(move |i| (from_s + f64::from(i) * stride_s, duration_s, force_n))
}

/// The frames of a contact at 100 Hz, the force of which follows half of a sine up to `peak_n`.
fn half_sine((start_s, duration_s, peak_n): (f64, f64, f64)) -> impl Iterator<Item = (f64, f64, f64)> {
    let [first, last] = [(100.0 * start_s).ceil(), (100.0 * (start_s + duration_s)).floor()].map(|frame| frame as u32);
    (first..=last).map(move |i| {
        let t_s = f64::from(i) / 100.0;
        (t_s, 0.01, peak_n * (std::f64::consts::PI * (t_s - start_s) / duration_s).sin().max(0.0))
    })
}

/// The numbers of strides in use and of gaps of the left foot.
fn left_counts(gait: &Value) -> [Option<u64>; 2] {
    ["strides", "gaps"].map(|key| gait[key]["left"].as_u64())
}

/// The notes on stderr of a command that succeeds.
fn notes(folder: &Path, arguments: &str) -> String {
    let output = gait(folder, arguments);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{text}");
    text
}

/// The error on stderr of a command that fails.
fn failure(folder: &Path, arguments: &str) -> String {
    let output = gait(folder, arguments);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success(), "{text}");
    text
}

/// Every third contact of the left foot is shorter than a step. The strides around it are not one stride.
#[test]
fn no_stride_spans_a_contact_that_is_too_short_for_a_step() {
    let folder = tempfile::tempdir().expect("a folder");
    let contacts = regular(1.0, 0.6, 0.25, 1500.0).enumerate();
    let contacts = contacts.map(|(i, (start_s, duration_s, force_n))| match i % 3 {
        2 => (start_s, 0.07, force_n),
        _ => (start_s, duration_s, force_n),
    });
    write_contacts(&folder.path().join("left.parquet"), Side::Left, contacts);
    let (measured, text) = measures(folder.path(), "left.parquet");
    assert!((mean(&measured, "stride_time_s", "left") - 0.6).abs() < 0.002, "{text}");
    assert_eq!(left_counts(&measured), [Some(10), Some(9)], "{text}");
    let notes = notes(folder.path(), "left.parquet");
    assert!(notes.contains("10 shorter than a step (70 ms; --min-stance 90)"), "{notes}");
    // With the remedy, all strides are used.
    let (measured, text) = measures(folder.path(), "left.parquet --min-stance 50");
    assert_eq!(left_counts(&measured), [Some(29), Some(0)], "{text}");
}

/// Contacts of 70 ms, each of them instead of a step, and then 30 s of standing, which are load bouts.
#[test]
fn load_bouts_after_contacts_that_are_too_short_do_not_join_the_strides_around_them() {
    let folder = tempfile::tempdir().expect("a folder");
    for short in [&[3, 5, 7][..], &[3, 5, 7, 9, 11]] {
        let walk = regular(1.0, 1.2, 0.7, 800.0).take(14).enumerate();
        let walk = walk.map(|(i, step)| if short.contains(&i) { (step.0, 0.07, step.2) } else { step });
        let standing = std::iter::once((18.0, 30.0, 400.0));
        let second = (0..20).map(|i| (50.0 + 1.2 * f64::from(i), 0.7, 800.0));
        write_contacts(&folder.path().join("left.parquet"), Side::Left, walk.chain(standing).chain(second));
        let (measured, text) = measures(folder.path(), "left.parquet");
        // The walks before and after the standing have 13 and 19 pairs of successive contacts; each short contact belongs to two.
        let strides = 13 - 2 * short.len() as u64 + 19;
        assert_eq!(measured["strides"]["left"].as_u64(), Some(strides), "{text}");
        assert!((mean(&measured, "stride_time_s", "left") - 1.2).abs() < 1e-6, "{text}");
    }
}

/// At 50 Hz, the insole rounds the durations of the stance rule to whole frames of 20 ms.
#[test]
fn the_reason_why_a_contact_is_no_step_is_that_of_the_insole() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("left.parquet");
    let short = |(i, step): (usize, (f64, f64, f64))| if i % 3 == 2 { (step.0, 0.08, step.2) } else { step };
    write_at(50.0, &path, Side::Left, 0.0, regular(1.0, 0.6, 0.26, 1500.0).enumerate().map(short));
    let found = notes(folder.path(), "left.parquet");
    assert!(found.contains("10 shorter than a step (80 ms; --min-stance 90)"), "{found}");
    // Contacts of 0.7 s with up to 20 N, between steps with up to 300 N, of which the threshold of toe off is 30 N.
    let weak = |(i, step): (usize, (f64, f64, f64))| if i % 3 == 2 { (step.0, 0.7, 20.0) } else { step };
    for shoe_n in [0.0, 30.0] {
        let contacts = regular(1.0, 1.2, 0.7, 300.0).enumerate().map(weak);
        write_at(100.0, &path, Side::Left, shoe_n, contacts.flat_map(half_sine));
        let found = notes(folder.path(), "left.parquet");
        assert!(found.contains("below the threshold of toe off (--release 70)"), "{shoe_n} N: {found}");
        assert!(!found.contains("shorter than a step"), "{shoe_n} N: {found}");
    }
}

/// A foot that touches the ground in swing takes no step, so it does not divide the stride.
#[test]
fn a_stride_contains_the_scuffs_of_its_swing() {
    let folder = tempfile::tempdir().expect("a folder");
    let steps = regular(1.0, 1.2, 0.7, 800.0);
    let contacts = steps.flat_map(|step| [step, (step.0 + 0.9, 0.12, 120.0)]);
    write_contacts(&folder.path().join("left.parquet"), Side::Left, contacts);
    let (measured, text) = measures(folder.path(), "left.parquet");
    assert!((mean(&measured, "stride_time_s", "left") - 1.2).abs() < 0.002, "{text}");
    assert_eq!(left_counts(&measured), [Some(14), Some(0)], "{text}");
}

/// The left leg carries 60 N, less than the thresholds.
#[test]
fn a_foot_that_was_recorded_but_takes_no_step_is_named_and_there_is_no_cadence() {
    let folder = tempfile::tempdir().expect("a folder");
    write_contacts(&folder.path().join("left.parquet"), Side::Left, regular(1.0, 1.2, 0.7, 60.0));
    write_contacts(&folder.path().join("right.parquet"), Side::Right, regular(1.6, 1.2, 0.7, 800.0));
    let (measured, _) = measures(folder.path(), "left.parquet right.parquet");
    assert!(measured["cadence_per_min"].is_null() && mean(&measured, "stride_time_s", "right") > 1.0, "{measured:#}");
    let notes = notes(folder.path(), "left.parquet right.parquet");
    assert!(notes.contains("left.parquet: no step: the largest total force is 60.4 N"), "{notes}");
    assert!(notes.contains("below the threshold of toe off (--release 70)"), "{notes}");
    let remedy = "left.parquet right.parquet --thresholds absolute --strike 15 --release 10";
    let (measured, text) = measures(folder.path(), remedy);
    assert!((mean(&measured, "peak_force_n", "left") - 60.0).abs() < 1.0, "{text}");
    assert!((mean(&measured, "stance_time_s", "left") - 0.7).abs() < 0.011, "{text}");
    let (_, text) = measures(folder.path(), "left.parquet right.parquet --stride-length 1.4");
    assert!(text.contains("only one of the two recorded feet took steps"), "{text}");
    // Two recordings of the same foot are refused, although only one of them has steps.
    write_contacts(&folder.path().join("again.parquet"), Side::Left, regular(1.0, 1.2, 0.7, 800.0));
    let text = failure(folder.path(), "left.parquet again.parquet");
    assert!(text.contains("both files are of the left foot"), "{text}");
    // Without the other recording, the cadence assumes that the other foot steps as often.
    let (measured, _) = measures(folder.path(), "right.parquet");
    assert!((measured["cadence_per_min"]["mean"].as_f64().expect("a number") - 100.0).abs() < 0.2, "{measured:#}");
}

/// A walk, and a run after it.
#[test]
fn the_measures_of_a_part_of_a_recording_are_those_of_the_activity_in_it() {
    let folder = tempfile::tempdir().expect("a folder");
    for (side, lag) in [(Side::Left, 0.0), (Side::Right, 0.5)] {
        let of_walk = regular(1.0 + 1.2 * lag, 1.2, 0.7, 800.0).take_while(|step| step.0 < 9.0);
        let of_run = regular(11.0 + 0.7 * lag, 0.7, 0.25, 1600.0);
        write_contacts(&folder.path().join(format!("{}.parquet", side.name())), side, of_walk.chain(of_run));
    }
    for (options, stride_s, flight_s) in [("--to 10", 1.2, 0.0), ("--from 10", 0.7, 0.2)] {
        let (measured, text) = measures(folder.path(), &format!("left.parquet right.parquet {options}"));
        assert!((mean(&measured, "stride_time_s", "left") - stride_s).abs() < 0.002, "{text}");
        assert!((mean(&measured, "flight_s", "left") - flight_s).abs() < 0.011, "{text}");
        assert_eq!(text.contains("Flight"), flight_s > 0.0, "{text}");
    }
    let text = failure(folder.path(), "left.parquet --from 30");
    assert!(text.starts_with("error: left.parquet: no frame from 30 s; "), "{text}");
    let text = failure(folder.path(), "left.parquet --from 9 --to 3");
    assert!(text.contains("from 9 s to 3 s: the part does not end after it begins"), "{text}");
    write_stream(&folder.path().join("walk.plantar"), true);
    for option in ["--from 3", "--zero zero.toml"] {
        let text = failure(folder.path(), &format!("walk.plantar {option}"));
        assert!(text.contains("--from and --to are for recordings of all cells"), "{text}");
    }
}

/// The force of each contact follows half of a sine with a peak of 1000 N, so it reaches the threshold of heel strike, 50 N,
/// after asin(0.05) / pi of the contact time, and falls below that of toe off, 100 N, asin(0.1) / pi before its end. The stride
/// time is no whole number of frames, so that the rounding to frames averages out.
#[test]
fn a_contact_is_shorter_than_the_time_with_force_by_that_below_the_thresholds() {
    const CONTACT_S: f64 = 0.3;
    let folder = tempfile::tempdir().expect("a folder");
    let contacts = regular(1.0, 0.7037, CONTACT_S, 1000.0);
    write_contacts(&folder.path().join("left.parquet"), Side::Left, contacts.flat_map(half_sine));
    let lost_s = |threshold_n: f64| CONTACT_S * (threshold_n / 1000.0).asin() / std::f64::consts::PI;
    for (options, [strike_n, release_n]) in
        [("", [50.0, 100.0]), ("--thresholds absolute --strike 20 --release 20", [20.0, 20.0])]
    {
        let (measured, text) = measures(folder.path(), &format!("left.parquet {options}"));
        let expected_s = CONTACT_S - lost_s(strike_n) - lost_s(release_n);
        let found_s = mean(&measured, "stance_time_s", "left");
        assert!((found_s - expected_s).abs() < 0.003, "{found_s} for {expected_s}: {text}");
    }
}

/// All contacts last longer than a step. The message names the option.
#[test]
fn a_very_slow_walk_is_refused_with_the_option_that_admits_it() {
    let folder = tempfile::tempdir().expect("a folder");
    write_contacts(&folder.path().join("left.parquet"), Side::Left, regular(1.0, 4.0, 2.9, 800.0));
    let text = failure(folder.path(), "left.parquet");
    assert!(text.contains("4 longer than a step (2900 ms; --max-stance 2500)"), "{text}");
    let (measured, text) = measures(folder.path(), "left.parquet --max-stance 5000");
    assert!((mean(&measured, "stride_time_s", "left") - 4.0).abs() < 0.002, "{text}");
}

/// Each foot carries between 30 and 330 N, as on the pedals of a bicycle at 90 revolutions a minute.
#[test]
fn a_foot_that_is_never_lifted_is_noted() {
    let folder = tempfile::tempdir().expect("a folder");
    let frames = (100..1900).map(|i| {
        let t_s = f64::from(i) / 100.0;
        (t_s, 0.01, 180.0 - 150.0 * (3.0 * std::f64::consts::PI * t_s).cos())
    });
    write_contacts(&folder.path().join("left.parquet"), Side::Left, frames);
    let found = notes(folder.path(), "left.parquet");
    assert!(found.contains("pairs of steps: on a bicycle"), "{found}");
    write_contacts(&folder.path().join("left.parquet"), Side::Left, regular(1.0, 1.2, 0.7, 800.0));
    assert_eq!(notes(folder.path(), "left.parquet"), "");
}

#[test]
fn computed_walks_of_both_feet_are_those_of_one_walk() {
    let folder = tempfile::tempdir().expect("a folder");
    for side in ["left", "right"] {
        let mut import = Command::new(env!("CARGO_BIN_EXE_plantar"));
        import.args(["import", "synthetic", "--steps", "60", "--side", side, "--out", &format!("{side}.parquet")]);
        assert!(import.current_dir(folder.path()).output().expect("the program starts").status.success());
    }
    let (gait, text) = measures(folder.path(), "left.parquet right.parquet");
    for side in ["left", "right"] {
        let stride_s = mean(&gait, "stride_time_s", side);
        assert!((mean(&gait, "step_time_s", side) / stride_s - 0.5).abs() < 0.01, "{text}");
        assert!((0.1..0.4).contains(&mean(&gait, "double_support_s", side)), "{text}");
        assert!(mean(&gait, "single_support_s", side) > 0.3, "{text}");
    }
    assert!(!text.contains("-0.000") && text.contains("the index of the means of the feet"), "{text}");
}

/// The expected mean is that of the force in all frames between two heel strikes that are a whole number of strides apart.
#[test]
fn the_mean_force_over_whole_strides_is_that_of_the_frames() {
    let folder = tempfile::tempdir().expect("a folder");
    let SyntheticWalk { stance_s, swing_s, .. } = SyntheticWalk::default();
    let mut expected_n = 0.0;
    for side in [Side::Left, Side::Right] {
        let mut recording =
            walk(&SyntheticWalk { side, steps: 12, variation: 0.0, ..SyntheticWalk::default() }).recording;
        if side == Side::Right {
            recording.t_s.iter_mut().for_each(|t_s| *t_s += 0.5 * (stance_s + swing_s));
        }
        let cells = &recording.layout.cells;
        let force_n = |frame: usize| -> f64 {
            let loads = cells.iter().zip(recording.frame(frame));
            loads.map(|(cell, kpa)| cell.area_mm2 * f64::from(*kpa) * 1e-3).sum()
        };
        let frames = (8.0 * (stance_s + swing_s) * recording.rate_hz).round() as usize;
        let first = recording.frames() / 6;
        expected_n += (first..first + frames).map(force_n).sum::<f64>() / frames as f64;
        recording.write(folder.path().join(format!("{}.parquet", side.name()))).expect("written");
    }
    let (_, text) = measures(folder.path(), "left.parquet right.parquet");
    let (_, after) = text.split_once("over whole strides: ").expect("the line");
    let force_n: f64 = after.split_once(" N").expect("a unit").0.parse().expect("a number");
    // The force below the thresholds of heel strike and toe off is not part of a step.
    assert!((0.98 * expected_n..1.005 * expected_n).contains(&force_n), "{force_n} {expected_n}");
    // A single foot does not carry the body.
    assert!(!measures(folder.path(), "left.parquet").1.contains("over whole strides"));
}

#[test]
fn two_files_with_steps_of_the_same_foot_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    write_stream(&folder.path().join("walk.plantar"), true);
    let mut file = Vec::new();
    client::append(&mut file, 0, 0, &ToHost::Step(step(Side::Right, 0, 0))).expect("it fits");
    std::fs::write(folder.path().join("right.plantar"), file).expect("written");
    // The first step in walk.plantar is of the left foot.
    for arguments in ["walk.plantar right.plantar", "right.plantar walk.plantar"] {
        let output = gait(folder.path(), arguments);
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && text.contains("steps of the right foot"), "{arguments}: {text}");
    }
}

#[test]
fn a_truncated_stream_is_noted_and_a_file_without_a_stream_is_refused_with_the_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("walk.plantar");
    write_stream(&path, true);
    let file = std::fs::read(&path).expect("a file");
    std::fs::write(&path, &file[..file.len() - 5]).expect("written");
    let output = gait(folder.path(), "walk.plantar");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && text.contains("walk.plantar is truncated"), "{text}");
    let output = gait(folder.path(), "walk.plantar --release 50");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success(), "{text}");
    assert!(text.contains("walk.plantar were found by an insole") && text.contains("plantar insole set"), "{text}");
    std::fs::write(&path, "this is a text and no stream").expect("written");
    let output = gait(folder.path(), "walk.plantar");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success(), "{text}");
    assert!(text.contains("walk.plantar") && text.contains("give a file that `plantar serve --record`"), "{text}");
}

/// The link to the left insole broke before the acknowledgement of its last step, and the right insole went on.
#[test]
fn a_step_that_is_sent_again_after_many_steps_of_the_other_foot_counts_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, has_repetition: bool| {
        let mut file = Vec::new();
        let mut append = |insole, message: &ToHost| client::append(&mut file, 0, insole, message).expect("it fits");
        for (insole, side) in [(0, Side::Left), (1, Side::Right)] {
            append(insole, &ToHost::Time { host_us: 100, device_us: 100 });
            (0..60).for_each(|number| append(insole, &ToHost::Step(step(side, number, 0))));
        }
        if has_repetition {
            append(0, &ToHost::Step(step(Side::Left, 59, 0)));
        }
        std::fs::write(folder.path().join(name), file).expect("written");
        measures(folder.path(), name).0
    };
    assert_eq!(write("repeated.plantar", true), write("walk.plantar", false));
}

/// The clock of an insole begins with each boot, so the times of steps of different boots cannot be compared.
#[test]
fn a_step_of_an_earlier_boot_without_a_time_of_day_is_left_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("walk.plantar");
    for (has_times, reason) in [(true, "without an exact time on the common clock"), (false, "from earlier boots")] {
        write_stream(&path, has_times);
        let (expected, _) = measures(folder.path(), "walk.plantar");
        let mut file = std::fs::read(&path).expect("a file");
        let old = Step { boots_since: 1, ..step(Side::Left, 20, 0) };
        client::append(&mut file, 0, 0, &ToHost::Step(old)).expect("it fits");
        std::fs::write(&path, file).expect("written");
        let text = String::from_utf8_lossy(&gait(folder.path(), "walk.plantar").stderr).into_owned();
        assert!(text.contains("left foot") && text.contains(reason) && text.contains("not used: 1"), "{text}");
        assert_eq!(measures(folder.path(), "walk.plantar").0, expected);
    }
}

/// Writes a stream file with the ten steps of each foot from one hour before the host connected, and `live` more of each foot
/// from afterwards. The clock of the right insole is 40 ppm fast, so it has gained 144 ms since the walk.
fn write_stored(path: &Path, live: u32) {
    let mut file = Vec::new();
    let mut append = |insole, message: &ToHost| client::append(&mut file, 0, insole, message).expect("it fits");
    for (insole, side, rate) in [(0, Side::Left, 1.0), (1, Side::Right, 1.000_04)] {
        let device_us = |host_us: u64| (host_us as f64 * rate) as u64;
        let step = |number| {
            let step = step(side, number, if number < 10 { 0 } else { 3_600_000_000 });
            ToHost::Step(Step { start_us: device_us(step.start_us), ..step })
        };
        (0..10).for_each(|number| append(insole, &step(number)));
        for second in 3600..3630 {
            append(insole, &ToHost::Time { host_us: second * 1_000_000, device_us: device_us(second * 1_000_000) });
        }
        (10..10 + live).for_each(|number| append(insole, &step(number)));
    }
    std::fs::write(path, file).expect("written");
}

/// Steps that are stored while no host is connected have no time on the common clock that is exact enough for both feet.
#[test]
fn stored_steps_are_not_compared_with_those_of_the_other_foot() {
    let folder = tempfile::tempdir().expect("a folder");
    for (live, strides) in [(0, 9), (3, 12), (10, 9)] {
        write_stored(&folder.path().join("walk.plantar"), live);
        let (gait, _) = measures(folder.path(), "walk.plantar");
        let text = String::from_utf8_lossy(&self::gait(folder.path(), "walk.plantar").stderr).into_owned();
        let has_both_feet = live == 10;
        assert_eq!(gait["has_both_feet"], has_both_feet, "{gait:#}");
        let (counted, gaps) = (gait["strides"]["left"].as_u64(), gait["gaps"]["left"].as_u64());
        // An hour passes between the stored steps and the others.
        assert_eq!(counted.zip(gaps), Some(if live == 3 { (strides - 1, 1) } else { (strides, 0) }), "{gait:#}");
        assert!((mean(&gait, "stride_time_s", "right") - 1.1).abs() < 1e-4, "{gait:#}");
        if has_both_feet {
            assert!(text.contains("stored while no host was connected") && text.contains("not used: 10"), "{text}");
            assert!((mean(&gait, "step_time_s", "left") - 0.6).abs() < 1e-3, "{gait:#}");
        } else {
            assert!(text.contains("the feet are not compared") && text.contains("plantar serve --record"), "{text}");
        }
    }
}

#[test]
fn steps_of_two_earlier_boots_are_not_mixed() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("walk.plantar");
    let measured = |boots: &[u32]| {
        let mut file = Vec::new();
        for (number, boots_since) in (0..).zip(boots.iter().flat_map(|&boots_since| [boots_since; 10])) {
            // The clock of the insole begins with each boot.
            let step = Step { step: number, boots_since, ..step(Side::Left, number % 10, 0) };
            client::append(&mut file, 0, 0, &ToHost::Step(step)).expect("it fits");
        }
        std::fs::write(&path, file).expect("written");
        measures(folder.path(), "walk.plantar").0
    };
    assert_eq!(measured(&[2, 1]), measured(&[1]));
}

/// After a loss of power of the computer, the end of a file may be filled with zeros.
#[test]
fn the_steps_before_the_damaged_end_of_a_stream_are_used() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("walk.plantar");
    write_stream(&path, true);
    let (expected, _) = measures(folder.path(), "walk.plantar");
    let mut file = std::fs::read(&path).expect("a file");
    let damage = format!("walk.plantar is damaged at byte {}: its last 100 bytes are not used", file.len());
    file.extend([0; 100]);
    std::fs::write(&path, file).expect("written");
    let text = String::from_utf8_lossy(&gait(folder.path(), "walk.plantar").stderr).into_owned();
    assert!(text.contains(&damage), "{text}");
    assert_eq!(measures(folder.path(), "walk.plantar").0, expected);
}

/// The test limits the size of files, which has the same effect as a full disk.
#[test]
#[cfg(target_os = "linux")]
fn measures_that_cannot_be_written_leave_an_existing_file_as_it_is() {
    let folder = tempfile::tempdir().expect("a folder");
    write_stream(&folder.path().join("walk.plantar"), true);
    let json = folder.path().join("gait.json");
    std::fs::write(&json, "of the last walk").expect("written");
    let output = Command::new("sh")
        .args(["-c", "trap '' XFSZ; ulimit -f 0; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_plantar")])
        .args(["gait", "walk.plantar", "--json", "gait.json"])
        .current_dir(folder.path())
        .output()
        .expect("the program starts");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && text.contains("gait.json") && text.contains("File too large"), "{text}");
    assert_eq!(std::fs::read_to_string(&json).expect("a file"), "of the last walk");
}

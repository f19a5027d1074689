//! Exported files, read by independent programs, contain what was measured.

use export::motion_bids::Names;
use export::{Event, EventKind, Foot, Quantity, Session, c3d, csv, mat, mcap, motion_bids, opensim};
use parameters::{InsoleSize, Parameters};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::{Step, StepFoot, StepRegion};
use plantar::{Region, Side};
use recording::synthetic::{self, SyntheticWalk};
use recording::{Recording, VirtualInsole};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// Time by which the walk of the right foot begins later than that of the left foot, s.
const LAG_S: f64 = 0.5;

/// A walk. Its times begin at 3 s for the left foot, and [`LAG_S`] later for the right foot.
fn walk(side: Side, steps: usize, cells: usize) -> Recording {
    let walk = SyntheticWalk { side, steps, cells, ..SyntheticWalk::default() };
    let mut recording = synthetic::walk(&walk).recording;
    let begins_s = if side == Side::Left { 3.0 } else { 3.0 + LAG_S };
    recording.t_s.iter_mut().for_each(|t_s| *t_s += begins_s);
    recording
}

fn foot(recording: Recording) -> Foot {
    let insole = VirtualInsole::new(&recording, ContactRule::COVERED, StanceRule::ADAPTIVE);
    Foot::new(recording, &insole, &Parameters::typical(InsoleSize::default()).tissue(), "walk.parquet")
        .expect("the recording is valid")
}

fn both_feet() -> Session {
    both_feet_late(0.0)
}

/// Both feet, with times that are later than those of [`walk`] by `late_s`.
fn both_feet_late(late_s: f64) -> Session {
    let feet = [Side::Right, Side::Left].map(|side| {
        let mut recording = walk(side, 5, 60);
        recording.t_s.iter_mut().for_each(|t_s| *t_s += late_s);
        foot(recording)
    });
    Session::new(feet.into(), None, None).expect("one clock")
}

#[test]
fn refused_parameters_are_not_reported_as_a_defect_of_the_recording() {
    let recording = walk(Side::Left, 1, 60);
    let insole = VirtualInsole::new(&recording, ContactRule::COVERED, StanceRule::ADAPTIVE);
    // An insole accepts no parameters that are all zeros.
    let error = Foot::new(recording, &insole, &Tissue::NONE, "walk.parquet").expect_err("an error").to_string();
    assert!(error.starts_with("tissue parameters: ") && error.contains("plantar fit"), "{error}");
    assert!(!error.contains("walk.parquet") && !error.contains("import"), "{error}");
}

/// The content of a file, as readers.py prints it.
fn read(reader: &str, path: &Path) -> Value {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/readers.py");
    let python =
        std::env::var_os("PLANTAR_FORMATS").expect("PLANTAR_FORMATS names a Python with the readers of the formats");
    let mut command = Command::new(python);
    json(command.args([script, reader]).arg(path))
}

fn json(command: &mut Command) -> Value {
    let output = command.output().expect("the reader starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

fn numbers(values: &Value) -> Vec<f64> {
    values.as_array().expect("an array").iter().map(|value| value.as_f64().unwrap_or(f64::NAN)).collect()
}

/// Compares numbers within a relative tolerance. NaN is equal to NaN.
fn compare(name: &str, found: &Value, expected: impl IntoIterator<Item = f64>, tolerance: f64) {
    let (found, expected) = (numbers(found), expected.into_iter().collect::<Vec<_>>());
    assert_eq!(found.len(), expected.len(), "{name}");
    for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
        let is_near = (found - expected).abs() <= tolerance * expected.abs();
        assert!(is_near || found.is_nan() && expected.is_nan(), "{name} {i}: {found} for {expected}");
    }
}

/// Compares all channels, with `absent` for the values that are absent, and the units if the format has them.
fn compare_channels(found: &Value, session: &Session, absent: f64, tolerance: f64) {
    let channels = session.channels();
    assert_eq!(found["channels"].as_object().map(|object| object.len()), Some(channels.len()));
    for channel in &channels {
        let values = (0..session.frames()).map(|i| channel.value(i).unwrap_or(absent));
        compare(&channel.name(), &found["channels"][channel.name()], values, tolerance);
        if let Some(unit) = found["units"].get(channel.name()) {
            assert_eq!(unit, channel.quantity.unit());
        }
    }
}

/// Compares the events. The times of the events in the file are relative to `begins_s`, a time of the session.
fn compare_events(found: &Value, session: &Session, begins_s: f64) {
    let mut found: Vec<(f64, &str)> = found["events"]
        .as_array()
        .expect("events")
        .iter()
        .map(|event| (event[0].as_f64().expect("a time"), event[1].as_str().expect("a name")))
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let expected = session.events();
    assert_eq!(found.len(), expected.len());
    assert!(expected.len() > 10, "{expected:?}");
    for (found, expected) in found.iter().zip(expected) {
        assert_eq!(found.1, format!("{}_{}", expected.side.name(), expected.kind.name()));
        assert!((found.0 - (expected.t_s - begins_s)).abs() < 5e-6, "{found:?} for {expected:?}");
    }
}

/// Largest relative error of a value that was rounded to single precision.
const SINGLE: f64 = 6e-8;
/// Largest relative error of a value that was rounded to single precision and then written as the shortest decimal number.
const SINGLE_TEXT: f64 = 2.0 * SINGLE;

/// The expected quantities of the frames are computed from the recorded pressures of the cells alone.
#[test]
fn the_session_has_the_forces_and_the_centre_of_pressure_of_the_recording() {
    let recordings = [Side::Left, Side::Right].map(|side| walk(side, 5, 60));
    let session = both_feet();
    // The right foot begins later, and ends later.
    assert_eq!(session.t_s[0], recordings[1].t_s[0]);
    assert_eq!(session.t_s.last(), recordings[0].t_s.last());
    let lag = (LAG_S * session.rate_hz) as usize;
    for (recording, (foot, first)) in recordings.iter().zip(session.feet.iter().zip([lag, 0])) {
        assert_eq!(foot.side, recording.side);
        let mut loaded = 0;
        for (i, frame) in foot.frames.iter().enumerate() {
            let kpa = recording.frame(first + i);
            assert_eq!(foot.cells_kpa(i), kpa);
            let cells =
                || recording.layout.cells.iter().zip(kpa).map(|(c, &kpa)| (c, f64::from(kpa) * c.area_mm2 / 1e3));
            // The codes of the virtual sensor have a finite resolution, which is coarse near zero.
            let near = |found: f64, expected: f64| (found - expected).abs() <= 0.002 * expected + 0.2;
            for region in Region::ALL {
                let force_n: f64 = cells().filter(|(cell, _)| cell.region == region).map(|(_, force_n)| force_n).sum();
                assert!(near(frame.regions[region as usize].force_n, force_n), "{frame:?} for {force_n} N");
            }
            let force_n: f64 = cells().map(|(_, force_n)| force_n).sum();
            assert!(near(frame.total_force_n(), force_n));
            assert!(frame.cop_mm.is_some() || force_n < 100.0, "{frame:?} at {} s", session.t_s[i]);
            if let Some((x_mm, y_mm)) = frame.cop_mm.filter(|_| force_n > 50.0) {
                let centre = |of: fn(&recording::Cell) -> f64| cells().map(|(c, n)| n * of(c)).sum::<f64>() / force_n;
                assert!((x_mm - centre(|cell| cell.x_mm)).abs() < 0.2 && (y_mm - centre(|cell| cell.y_mm)).abs() < 0.2);
                loaded += 1;
            }
        }
        assert!(loaded > foot.frames.len() / 3);
        // From each toe off to the next heel strike, the foot is off the ground.
        let mut in_swing_frames = 0;
        let strikes = foot.steps[1..].iter().map(|next| next.heel_strike_s).chain([f64::INFINITY]);
        for (step, strike_s) in foot.steps.iter().zip(strikes) {
            let in_swing = |t_s: f64| step.toe_off_s <= t_s && t_s < strike_s;
            let frames = foot.frames.iter().zip(&session.t_s).filter(|(_, t_s)| in_swing(**t_s));
            let on: Vec<_> = frames.clone().filter(|(frame, _)| frame.cop_mm.is_some()).map(|(_, t_s)| *t_s).collect();
            assert!(on.is_empty(), "toe off at {} s, heel strike at {strike_s} s: {on:?}", step.toe_off_s);
            in_swing_frames += frames.count();
        }
        assert!(in_swing_frames > 50);
    }
}

#[test]
fn a_session_has_no_frames_outside_of_the_given_times() {
    let mut recording = walk(Side::Left, 2, 60);
    // The frame that is nearest to time 0 is at -0.004 s.
    let begins_s = recording.t_s[0];
    recording.t_s.iter_mut().for_each(|t_s| *t_s -= begins_s + 0.504);
    let session = Session::new(vec![foot(recording.clone())], Some(0.0), Some(0.602)).expect("frames");
    // The frame at 0.606 s is nearer to the end than that at 0.596 s.
    let [first_s, last_s] = [session.t_s[0], session.t_s[session.t_s.len() - 1]];
    assert!((first_s - 0.006).abs() < 1e-9 && (last_s - 0.596).abs() < 1e-9, "{first_s} s to {last_s} s");
    // There is no frame between -0.004 s and 0.006 s.
    let text = Session::new(vec![foot(recording)], Some(0.001), Some(0.005)).expect_err("no frames").to_string();
    assert!(text.contains("no frame in common"), "{text}");
}

#[test]
fn frames_of_both_feet_that_are_nearest_in_time_belong_together() {
    let [left, mut right] = [Side::Left, Side::Right].map(|side| walk(side, 2, 60));
    right.t_s.iter_mut().for_each(|t_s| *t_s += 0.004);
    let session = Session::new(vec![foot(right.clone()), foot(left.clone())], None, None).expect("one clock");
    let lag = (LAG_S * session.rate_hz) as usize;
    assert_eq!(session.t_s, left.t_s[lag..]);
    for i in 0..session.frames() {
        assert_eq!(session.feet[0].cells_kpa(i), left.frame(lag + i));
        assert_eq!(session.feet[1].cells_kpa(i), right.frame(i));
    }
    // The clocks differ by 0.4 %, so that the frames of the two feet drift apart by more than half a frame period.
    right.t_s.iter_mut().for_each(|t_s| *t_s *= 1.004);
    right.rate_hz /= 1.004;
    let text = Session::new(vec![foot(right), foot(left)], None, None).expect_err("two rates").to_string();
    assert!(text.contains("--rate"), "{text}");
}

#[test]
fn recordings_of_two_insoles_are_not_paired() {
    let of_insole = |side| {
        let mut recording = walk(side, 2, 60);
        recording.layout.name = "insole 0x00001069".into();
        foot(recording)
    };
    let [left, right] = [Side::Left, Side::Right].map(of_insole);
    for other in [right, foot(walk(Side::Right, 2, 60))] {
        let text = Session::new(vec![left.clone(), other], None, None).expect_err("two clocks").to_string();
        assert!(text.contains("on the clock of its insole") && text.contains("one foot at a time"), "{text}");
    }
    assert!(Session::new(vec![left], None, None).is_ok());
}

/// The names of the files in a folder.
fn names(folder: &Path) -> Vec<std::ffi::OsString> {
    std::fs::read_dir(folder).expect("a folder").flatten().map(|entry| entry.file_name()).collect()
}

#[test]
fn a_session_that_exceeds_the_limits_of_a_format_is_refused_with_a_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut session = both_feet();
    // The parameters of a C3D file can hold the events of two thousand steps, but not those of three thousand.
    session.feet[0].steps = session.feet[0].steps[1..2].repeat(2000);
    c3d::write(&session, &folder.path().join("walk.c3d")).expect("the events fit");
    std::fs::remove_file(folder.path().join("walk.c3d")).expect("removed");
    session.feet[0].steps = session.feet[0].steps[1..2].repeat(3000);
    let events = c3d::write(&session, &folder.path().join("walk.c3d"));
    // Ten million frames of 60 cells need about 4 GB.
    session.t_s = vec![0.0; 10_000_000];
    let bytes = mat::write(&session, &folder.path().join("walk.mat"));
    for (refused, problem) in [(events, "events"), (bytes, "2 GiB")] {
        let text = refused.expect_err("it does not fit").to_string();
        assert!(text.contains("walk.parquet") && text.contains(problem) && text.contains("--from"), "{text}");
    }
    assert_eq!(names(folder.path()), Vec::<std::ffi::OsString>::new());
}

#[test]
fn events_are_where_the_recorded_force_rises_and_falls() {
    let events = both_feet().events();
    assert!(events.len() > 10, "{events:?}");
    for event in events {
        let recording = walk(event.side, 5, 60);
        let at = recording.t_s.iter().position(|t_s| (t_s - event.t_s).abs() < 1e-9).expect("the time of a frame");
        let [before_n, after_n] = [at - 5, at + 5].map(|i| recording.force_n(i));
        let is_heel_strike = event.kind == EventKind::HeelStrike;
        let (lifted_n, loaded_n) = if is_heel_strike { (before_n, after_n) } else { (after_n, before_n) };
        assert!(lifted_n < 20.0 && loaded_n > 50.0, "{event:?}: {before_n} N, {after_n} N");
    }
}

/// The frames of the right foot are 4 ms later than those of the left one. The last frames of both feet, which belong together,
/// have the toe off of the right foot.
#[test]
fn an_event_in_the_last_frame_of_the_later_foot_is_exported() {
    const LATE_S: f64 = 0.004;
    let mut right = walk(Side::Right, 5, 60);
    right.t_s.iter_mut().for_each(|t_s| *t_s += LATE_S);
    let right = foot(right);
    let (toe_off_s, step) = (right.steps[1].toe_off_s, right.steps[1].step.step);
    let session =
        Session::new(vec![foot(walk(Side::Left, 5, 60)), right], None, Some(toe_off_s - LATE_S)).expect("one clock");
    let end_s = session.t_s[session.frames() - 1];
    assert!((end_s - (toe_off_s - LATE_S)).abs() < 1e-9, "{end_s}");
    let is_toe_off = |event: &Event| (event.side, event.kind, event.step) == (Side::Right, EventKind::ToeOff, step);
    let events = session.events();
    let times: Vec<_> = events.iter().filter(|event| is_toe_off(event)).map(|event| event.t_s).collect();
    assert_eq!(times, [end_s], "{events:?}");
}

/// A time of day, s, of which single precision has no milliseconds.
const TIME_OF_DAY_S: f64 = 45_296.123;

/// Compares the start of the session `both_feet_late(TIME_OF_DAY_S)`, which begins with the right foot.
fn compare_start(found: &Value) {
    let start_s = found["start_s"].as_f64().expect("a time");
    assert!((start_s - (TIME_OF_DAY_S + 3.0 + LAG_S)).abs() < 1e-6, "{start_s}");
}

#[test]
#[ignore = "needs the readers of the formats: cargo xtask test"]
fn c3d_is_read_by_ezc3d_and_c3d() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("walk.c3d");
    let mut session = both_feet_late(TIME_OF_DAY_S);
    let long =
        "A plate of 2 m², trial ".to_string() + &(1..=200).map(|i| format!("{i}, ")).collect::<String>() + "end.";
    session.feet[0].source = long.clone();
    c3d::write(&session, &path).expect("written");
    for reader in ["ezc3d", "c3d"] {
        let found = read(reader, &path);
        compare_start(&found);
        assert_eq!(found["sources"]["left"], long.replace('²', "?"));
        assert_eq!(found["sources"]["right"], walk(Side::Right, 5, 60).source);
        assert_eq!(found["rate_hz"], 100.0);
        assert_eq!(found["frames"], session.frames());
        compare_channels(&found, &session, 0.0, SINGLE);
        compare_events(&found, &session, session.t_s[0]);
    }
}

/// The session has more frames than the header of a C3D file can count (65,535), and more events than a parameter can hold
/// (255).
#[test]
#[ignore = "needs the readers of the formats: cargo xtask test"]
fn a_long_c3d_file_has_all_frames_and_events() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("walk.c3d");
    let session = Session::new(vec![foot(walk(Side::Left, 640, 20))], None, None).expect("a foot");
    assert!(session.frames() > 65_535 && session.events().len() > 3 * 255);
    c3d::write(&session, &path).expect("written");
    for reader in ["ezc3d", "c3d"] {
        let found = read(reader, &path);
        assert_eq!(found["event_count"], session.events().len());
        compare_channels(&found, &session, 0.0, SINGLE);
        compare_events(&found, &session, session.t_s[0]);
    }
}

#[test]
#[ignore = "needs the readers of the formats: cargo xtask test"]
fn a_part_without_load_and_events_is_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let session = Session::new(vec![foot(walk(Side::Left, 2, 60))], Some(3.0), Some(3.3)).expect("a swing");
    assert_eq!((session.frames(), session.events().len(), session.feet[0].steps.len()), (31, 0, 0));
    c3d::write(&session, &path("walk.c3d")).expect("written");
    mat::write(&session, &path("walk.mat")).expect("written");
    let names = Names { subject: "01".into(), task: "walking".into() };
    motion_bids::write(&session, &names, "Plantar test", &path("study")).expect("written");
    for (reader, name, absent) in [
        ("ezc3d", "walk.c3d", 0.0),
        ("c3d", "walk.c3d", 0.0),
        ("scipy", "walk.mat", f64::NAN),
        ("bids", "study", f64::NAN),
    ] {
        let found = read(reader, &path(name));
        compare_channels(&found, &session, absent, SINGLE_TEXT);
        assert!(found.get("errors").is_none_or(|errors| *errors == serde_json::json!([])), "{found}");
    }
}

#[test]
#[ignore = "needs the readers of the formats: cargo xtask test"]
fn external_loads_are_read_by_opensim() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = both_feet();
    for name in ["walk.mot", "walk.sto"] {
        let path = folder.path().join(name);
        opensim::write(&session, &path).expect("written");
        let found = read("opensim", &path);
        compare("t_s", &found["t_s"], session.t_s.iter().copied(), 1e-15);
        assert_eq!(found["channels"].as_object().map(|object| object.len()), Some(18));
        // The lateral side of the left foot is at its left, at negative z.
        for (foot, side, right) in [(&session.feet[0], 'l', -1.0), (&session.feet[1], 'r', 1.0)] {
            let column = |name: &str, value: fn(f64, (f64, f64)) -> f64| {
                let values = foot.frames.iter().map(|frame| {
                    frame.cop_mm.map_or(0.0, |(x_mm, y_mm)| value(frame.total_force_n(), (right * x_mm, y_mm)))
                });
                compare(name, &found["channels"][name], values, 1e-12);
            };
            column(&format!("ground_force_{side}_vy"), |force_n, _| force_n);
            column(&format!("ground_force_{side}_px"), |_, (_, y_mm)| y_mm / 1e3);
            column(&format!("ground_force_{side}_pz"), |_, (x_mm, _)| x_mm / 1e3);
            for zero in ["force_S_vx", "force_S_vz", "force_S_py", "torque_S_x", "torque_S_y", "torque_S_z"] {
                column(&format!("ground_{}", zero.replace('S', &side.to_string())), |_, _| 0.0);
            }
        }
    }
}

#[test]
#[ignore = "needs the readers of the formats and GNU Octave: cargo xtask test"]
fn a_matlab_file_is_read_by_scipy_and_octave() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("walk.mat");
    let mut session = both_feet();
    session.feet[0].source = "A plate of 2 m², with \"quotes\".".into();
    mat::write(&session, &path).expect("written");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/readers.m");
    let octave = json(Command::new("octave-cli").args(["--no-init-file", script]).arg(&path));
    for found in [read("scipy", &path), octave] {
        compare("t_s", &found["t_s"], session.t_s.iter().copied(), 0.0);
        compare_channels(&found, &session, f64::NAN, 1e-15);
        for foot in &session.feet {
            let read = &found["feet"][foot.side.name()];
            assert_eq!(read["source"], foot.source.replace('²', "?"));
            compare("heel_strike_s", &read["heel_strike_s"], foot.steps.iter().map(|step| step.heel_strike_s), 0.0);
            compare("toe_off_s", &read["toe_off_s"], foot.steps.iter().map(|step| step.toe_off_s), 0.0);
            compare("pressure", &read["pressure_kpa"], foot.pressure_kpa.iter().copied().map(f64::from), 0.0);
            let cells = &foot.layout.cells;
            compare("x_mm", &read["layout"]["x_mm"], cells.iter().map(|cell| cell.x_mm), 0.0);
            compare("y_mm", &read["layout"]["y_mm"], cells.iter().map(|cell| cell.y_mm), 0.0);
            compare("area_mm2", &read["layout"]["area_mm2"], cells.iter().map(|cell| cell.area_mm2), 0.0);
            compare(
                "region",
                &read["layout"]["region"],
                cells.iter().map(|cell| f64::from(cell.region as u8 + 1)),
                0.0,
            );
            compare_steps(&read["steps"], &foot.steps.iter().map(|step| step.step).collect::<Vec<_>>());
        }
    }
}

/// Compares the tables of the steps: matrices with a row for each step.
fn compare_steps(found: &Value, steps: &[Step]) {
    let absent = f64::NAN;
    for quantity in Step::QUANTITIES.iter().filter(|quantity| !["start_s", "boots_since"].contains(&quantity.name)) {
        let values = steps.iter().map(|step| quantity.in_unit(step).unwrap_or(absent));
        compare(quantity.name, &found[quantity.name], values, 0.0);
    }
    for quantity in StepFoot::QUANTITIES {
        let values = steps.iter().map(|step| quantity.in_unit(&step.foot).unwrap_or(absent));
        compare(quantity.name, &found[quantity.name], values, 0.0);
    }
    for quantity in StepRegion::QUANTITIES {
        let regions = steps.iter().flat_map(|step| &step.regions);
        let values = regions.map(|region| quantity.in_unit(region).unwrap_or(absent));
        compare(quantity.name, &found[quantity.name], values, 0.0);
    }
    for flag in Step::FLAGS {
        let regions = steps.iter().flat_map(|step| (0..Region::ALL.len()).map(|region| flag.is_set(step, region)));
        compare(flag.name, &found[flag.name], regions.map(|is_set| f64::from(u8::from(is_set))), 0.0);
    }
}

#[test]
#[ignore = "needs the readers of the formats: cargo xtask test"]
fn a_motion_bids_folder_is_valid_and_has_all_channels() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("study");
    let session = both_feet_late(TIME_OF_DAY_S);
    let names = Names { subject: "ann".into(), task: "walking".into() };
    motion_bids::write(&session, &names, "Plantar test", &path).expect("written");
    let found = read("bids", &path);
    assert_eq!(found["errors"], serde_json::json!([]), "{found}");
    // The validator recommends information that an export does not have: authors, licence, manufacturer and so on.
    let optional =
        ["JSON_KEY_RECOMMENDED", "SIDECAR_KEY_RECOMMENDED", "NO_AUTHORS", "TOO_FEW_AUTHORS"].map(Value::from);
    for warning in found["warnings"].as_array().expect("warnings") {
        assert!(optional.contains(&warning["code"]), "{warning}");
    }
    assert_eq!(found["rate_hz"], 100.0);
    compare_start(&found);
    compare_channels(&found, &session, f64::NAN, SINGLE_TEXT);
    compare_events(&found, &session, session.t_s[0]);
}

#[test]
#[ignore = "needs the readers of the formats: cargo xtask test"]
fn csv_is_read_by_pandas() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("walk.csv");
    let session = both_feet();
    csv::write(&session, &path).expect("written");
    let found = read("pandas", &path);
    compare("t_s", &found["t_s"], session.t_s.iter().copied(), 1e-15);
    compare_channels(&found, &session, f64::NAN, SINGLE_TEXT);
    compare_events(&found, &session, 0.0);
    // All quantities of both feet are present.
    assert_eq!(Quantity::all().count() * 2, found["channels"].as_object().map_or(0, |object| object.len()));
}

#[test]
#[ignore = "needs the readers of the formats: cargo xtask test"]
fn mcap_is_read_by_foxgloves_own_reader() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("walk.mcap");
    let session = both_feet();
    mcap::write(&session, &path).expect("written");
    let found = read("mcap", &path);
    assert_eq!(found["rate_hz"], 100.0);
    compare("t_s", &found["t_s"], session.t_s.iter().copied(), 1e-9);
    compare_channels(&found, &session, f64::NAN, 0.0);
    compare_events(&found, &session, 0.0);
    for (foot, direction) in session.feet.iter().zip([-1.0, 1.0]) {
        let read = &found["feet"][foot.side.name()];
        assert_eq!(read["source"], foot.source);
        compare("pressure", &read["pressure_kpa"], foot.pressure_kpa.iter().copied().map(f64::from), 0.0);
        // The medial edges are 5 cm apart, and the lateral sides outside.
        let cells = &foot.layout.cells;
        compare("x", &read["x_m"], cells.iter().map(|cell| direction * (0.025 + cell.x_mm / 1e3)), SINGLE);
        compare("y", &read["y_m"], cells.iter().map(|cell| cell.y_mm / 1e3), SINGLE);
        let steps = read["steps"].as_array().expect("steps");
        assert_eq!(steps.len(), foot.steps.len());
        for (found, step) in steps.iter().zip(&foot.steps) {
            assert_eq!(found["heel_strike_s"], step.heel_strike_s);
            assert_eq!(found["toe_off_s"], step.toe_off_s);
            for (i, (region, of)) in Region::ALL.iter().zip(&step.step.regions).enumerate() {
                let column = |name: &str| &found[format!("{}_{name}", region.name())];
                assert_eq!(*column("measured_force_peak_n"), f64::from(of.measured_peak_dn) / 10.0);
                assert_eq!(*column("area_peak_mm2"), f64::from(of.area_peak_mm2));
                for flag in Step::FLAGS {
                    assert_eq!(*column(flag.name), flag.is_set(&step.step, i));
                }
            }
            let of_region = StepRegion::QUANTITIES.len() + Step::FLAGS.len();
            // Without `start_s` and `boots_since`, with `heel_strike_s` and `toe_off_s`.
            assert!(found.get("start_s").is_none() && found.get("boots_since").is_none(), "{found}");
            let most = Step::QUANTITIES.len() + StepFoot::QUANTITIES.len() + 8 * of_region;
            assert!(found.as_object().is_some_and(|step| step.len() <= most && step.len() > most / 2));
            assert_eq!(found["foot_force_peak_n"], f64::from(step.step.foot.peak_dn) / 10.0);
        }
    }
}

#[test]
fn negative_times_are_refused_by_mcap() {
    let mut recording = walk(Side::Left, 2, 60);
    recording.t_s.iter_mut().for_each(|t_s| *t_s -= 10.0);
    let folder = tempfile::tempdir().expect("a folder");
    let session = Session::new(vec![foot(recording)], None, None).expect("a foot");
    let error = mcap::write(&session, &folder.path().join("walk.mcap")).expect_err("negative times").to_string();
    assert!(error.contains("walk.parquet") && error.contains("--from 0"), "{error}");
}

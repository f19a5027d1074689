//! Tests `plantar fit`: its files, its messages about steps and regions that cannot be fitted, and its exit status.

use parameters::Parameters;
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{
    Decoder, Hello, Live, MAJOR, MAX_FRAME, MAX_MESSAGE, MINOR, Reset, Status, Step, ToDevice, ToHost, decode, encode,
    frame,
};
use plantar::{Region, Side};
use recording::{Recording, VirtualInsole};
use serde_json::Value;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

fn plantar(folder: &Path, arguments: &str) -> Output {
    let program = env!("CARGO_BIN_EXE_plantar");
    Command::new(program).args(arguments.split_whitespace()).current_dir(folder).output().expect("the program starts")
}

/// Runs a command. Returns its exit status, stdout and stderr.
fn run(folder: &Path, arguments: &str) -> (i32, String, String) {
    let output = plantar(folder, arguments);
    let text = |bytes| String::from_utf8(bytes).expect("text");
    (output.status.code().expect("an exit"), text(output.stdout), text(output.stderr))
}

/// Asserts that a command succeeds, and returns what it printed on stdout.
fn succeed(folder: &Path, arguments: &str) -> String {
    let (status, out, err) = run(folder, arguments);
    assert_eq!(status, 0, "{arguments}: {err}");
    out
}

/// Asserts that a command fails with a message that contains all of `words`, and without a panic.
fn fail(folder: &Path, arguments: &str, words: &[&str]) {
    let (status, _, err) = run(folder, arguments);
    assert_eq!(status, 1, "{arguments}: {err}");
    for word in words {
        assert!(err.contains(word), "{arguments}: no \"{word}\" in: {err}");
    }
    assert!(!err.contains("panicked"), "{err}");
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).expect("a file")).expect("JSON")
}

/// A folder with a computed walk of six steps.
fn walk() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    succeed(folder.path(), "import synthetic --steps 6 --out walk.parquet");
    folder
}

#[test]
fn fitted_parameters_have_the_same_errors_in_a_replay_as_in_the_fit() {
    let folder = walk();
    let path = folder.path();
    let text = succeed(path, "fit walk.parquet --out p.toml --json p.json --participant someone");
    assert!(text.contains("someone: 6 steps of 1 recording,") && text.contains("8 of 8 regions"), "{text}");
    let fitted = json(&path.join("p.json"));
    assert_eq!(fitted["contact_rule"]["full_kpa"], 150.0);
    assert_eq!((fitted["filter"].as_str(), fitted["method"].as_str()), (Some("direct"), Some("projection")));

    let parameters = Parameters::read(&path.join("p.toml")).expect("readable");
    assert!(parameters.personal && parameters.subject == "someone");
    let text = std::fs::read_to_string(path.join("p.toml")).expect("a file");
    for mark in ["within the region's borders", "fixed", "identified", "(95 %)"] {
        assert!(text.contains(mark), "no {mark} in {text}");
    }
    // Replay uses the contact rule of the parameters, and has the same errors as the fit.
    let (_, out, err) = run(path, "replay walk.parquet --params p.toml --json steps.json --precision f64");
    assert!(out.contains("150 kPa") && !err.contains("note"), "{out}{err}");
    let steps = json(&path.join("steps.json"));
    for (region, fit) in fitted["regions"].as_object().expect("regions") {
        let errors =
            steps.as_array().expect("steps").iter().map(|s| s["regions"][region]["model_error_nrmse_percent"].as_f64());
        let mean = errors.map(|e| e.expect("a number")).sum::<f64>() / 6.0;
        let fitted = fit["nrmse_percent"]["fitted"].as_f64().expect("a number");
        assert!((mean - fitted).abs() < 0.02, "{region}: {mean} % replayed, {fitted} % fitted");
        let fitted_ellipsoid = &fit["ellipsoid"];
        let ellipsoid = &parameters.regions[plantar::Region::from_name(region).expect("a region") as usize];
        assert!((fitted_ellipsoid["a_mm"].as_f64().expect("a number") - ellipsoid.a_m * 1e3).abs() < 1e-9);
    }
    let (_, _, err) = run(path, "replay walk.parquet --params p.toml --contact-full 0");
    assert!(err.contains("are not valid"), "{err}");
}

#[test]
fn the_reported_error_with_counted_cells_equals_that_of_a_fit_with_counted_cells() {
    let folder = walk();
    let path = folder.path();
    let text = succeed(path, "fit walk.parquet --steps 1-5 --out p.toml --json covered.json");
    assert!(text.contains("counted %"), "{text}");
    assert!(!text.contains("the prior was learnt"), "{text}");
    let text =
        succeed(path, "fit walk.parquet --steps 1-5 --out p.toml --json counted.json --contact-full 0 --report r.html");
    let report = std::fs::read_to_string(path.join("r.html")).expect("a report");
    for text in [&text, &report] {
        assert!(text.contains("the prior was learnt from areas by the contact rule 10 / 7.5 / 150 kPa"), "{text}");
    }
    let [covered, counted] = ["covered.json", "counted.json"].map(|name| json(&path.join(name)));
    for (region, fit) in counted["regions"].as_object().expect("regions") {
        let errors = &fit["nrmse_percent"];
        let reported = &covered["regions"][region]["nrmse_percent"]["predicted_counted"];
        assert!(errors["predicted"].is_f64() && errors["predicted"] == *reported, "{region}: {errors}, {reported}");
        assert_eq!(errors["predicted_counted"], errors["predicted"], "{region}");
    }
}

#[test]
fn steps_are_selected_and_options_are_recorded() {
    let folder = walk();
    let path = folder.path();
    succeed(path, "fit walk.parquet --steps 2-4 --filter live --out p.toml --json p.json --bounds paper");
    let fitted = json(&path.join("p.json"));
    let numbers: Vec<_> = fitted["steps"].as_array().expect("steps").iter().map(|s| s["number"].as_u64()).collect();
    assert_eq!(numbers, [Some(2), Some(3), Some(4)]);
    assert_eq!(fitted["filter"], "live");
    let identified = Parameters::read(&path.join("p.toml")).expect("readable").identified.expect("known");
    assert_eq!((&*identified.filter, &*identified.side, identified.steps), ("live", "right", 3));
    let (_, _, err) = run(path, "replay walk.parquet --params p.toml");
    assert!(err.contains("with the filter of the live stream"), "{err}");
    for (size, of_replay, of_fit, is_extrapolated) in [
        ("", "\"typical, size 42 assumed\" are not personal", "size 42 assumed for the typical thickness", false),
        ("--size 42", "\"typical, size 42\" are not personal", "", false),
        ("--size 50", "\"typical, size 50\" are not personal", "size 50 is outside of the sizes of the paper", true),
    ] {
        let (_, _, of_replayed) = run(path, &format!("replay walk.parquet {size}"));
        let fit = "fit walk.parquet --steps 2-4 --filter live --bounds paper --out sized.toml";
        let (_, _, of_fitted) = run(path, &format!("{fit} {size}"));
        assert!(of_replayed.contains(of_replay) && of_fitted.contains(of_fit), "{size}: {of_replayed}{of_fitted}");
        assert_eq!(of_fitted.contains("assumed"), size.is_empty(), "{size}: {of_fitted}");
        for text in [of_replayed, of_fitted] {
            let is_noted = text.contains("(35 to 46): thickness and areas are extrapolated");
            assert_eq!(is_noted, is_extrapolated, "{size}: {text}");
        }
    }

    std::fs::write(path.join("thick.toml"), "heel = 20.5\n").expect("written");
    succeed(path, "fit walk.parquet --thickness thick.toml --compression 0.3 --size 40 --out p.toml --json p.json");
    let regions = &json(&path.join("p.json"))["regions"];
    assert_eq!(regions["heel"]["pinned"]["d0_mm"], 20.5);
    let hallux = regions["hallux"]["pinned"]["d0_mm"].as_f64().expect("a number");
    assert!((hallux - 10.0 * 40.0 / 42.0).abs() < 1e-9, "{hallux}");
    let compression = regions["hallux"]["pinned"]["compression"].as_f64().expect("a number");
    assert!((compression - 0.3).abs() < 1e-12, "{compression}");
}

/// The layout has four cells in two regions. Only the heel is loaded, in three whole stances.
#[test]
fn regions_that_cannot_be_fitted_are_named_and_set_the_exit_status() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let layout =
        "cell,x_mm,y_mm,area_mm2,region\n0,20,20,400,heel\n1,40,20,400,heel\n2,30,41,400,heel\n3,30,240,100,hallux\n";
    std::fs::write(path.join("layout.csv"), layout).expect("written");
    let write = |kpa: &dyn Fn(usize, f64) -> f64| {
        let frames: String = (0..400)
            .map(|i| {
                let phase = (f64::from(i % 120) - 30.0) / 60.0;
                let load = if (0.0..1.0).contains(&phase) { (std::f64::consts::PI * phase).sin() } else { 0.0 };
                format!("{:.2},{},{},{},0\n", f64::from(i) * 0.01, kpa(0, load), kpa(1, load), kpa(2, load))
            })
            .collect();
        std::fs::write(path.join("frames.csv"), format!("t_s,c0,c1,c2,c3\n{frames}")).expect("written");
        succeed(path, "import csv --layout layout.csv --frames frames.csv --side left --out walk.parquet");
    };
    write(&|cell, load| (load - 0.25 * cell as f64).max(0.0) * 400.0);
    let (status, out, _) = run(path, "fit walk.parquet --out p.toml --json p.json");
    assert_eq!(status, 3, "{out}");
    assert!(out.contains("hallux: NOT FITTED, never loaded") && out.contains("1 of 8 regions identified"), "{out}");
    let regions = &json(&path.join("p.json"))["regions"];
    assert_eq!((&regions["heel"]["fitted"], &regions["hallux"]["fitted"]), (&true.into(), &false.into()));
    let text = std::fs::read_to_string(path.join("p.toml")).expect("a file");
    assert!(text.contains("typical, NOT identified: never loaded"), "{text}");
    // The hallux has a single cell, which is loaded now.
    let loaded = std::fs::read_to_string(path.join("frames.csv")).expect("a file");
    let loaded: Vec<_> = loaded
        .lines()
        .map(|line| match line.rsplit_once(',').zip(line.split(',').nth(2)) {
            Some(((cells, "0"), kpa)) => format!("{cells},{kpa}"),
            _ => line.to_string(),
        })
        .collect();
    std::fs::write(path.join("loaded.csv"), loaded.join("\n")).expect("written");
    succeed(path, "import csv --layout layout.csv --frames loaded.csv --side left --out loaded.parquet");
    let (status, out, _) = run(path, "fit loaded.parquet --out single.toml");
    assert!(status == 3 && out.contains("hallux: NOT FITTED, a single cell"), "{out}");
    // An insole tracks only the regions in this list.
    let identified = Parameters::read(&path.join("p.toml")).expect("valid").identified.expect("known");
    assert_eq!(identified.regions, [Region::Heel]);
    let (_, _, err) = run(path, "replay walk.parquet --params p.toml");
    assert!(err.contains("note: the parameters of posterior_midfoot, ") && err.contains("are typical values"), "{err}");
    let all: Vec<_> = Region::ALL.iter().map(|region| format!("{:?}", region.name())).collect();
    std::fs::write(path.join("all.toml"), text.replace("[\"heel\"]", &format!("[{}]", all.join(", "))))
        .expect("written");
    let (_, _, err) = run(path, "replay walk.parquet --params all.toml");
    assert!(!err.contains("typical values"), "{err}");

    // With all cells loaded at once, the area is constant, and no region can be fitted.
    write(&|_, load| if load > 0.0 { 50.0 + 300.0 * load } else { 0.0 });
    std::fs::remove_file(path.join("p.toml")).expect("was written");
    let (status, out, err) = run(path, "fit walk.parquet --contact-full 0 --out p.toml");
    assert_eq!(status, 1, "{out}{err}");
    assert!(out.contains("heel: NOT FITTED, constant area") && err.contains("no region could be fitted"), "{out}{err}");
    assert!(!path.join("p.toml").exists());
}

/// One cell of the heel reads 180 kPa all the time. The stream and the recording of all cells have the defect.
#[test]
fn a_region_with_a_faulty_cell_is_named() {
    let folder = walk();
    let path = folder.path();
    let mut stuck = recording(path);
    let heel: Vec<_> = (0..stuck.cells()).filter(|&i| stuck.layout.cells[i].region == Region::Heel).collect();
    let cells = stuck.cells();
    stuck.pressure_kpa.iter_mut().skip(heel[heel.len() / 2]).step_by(cells).for_each(|kpa| *kpa = 180.0);
    stuck.write(path.join("stuck.parquet")).expect("written");
    std::fs::write(path.join("stuck.plantar"), stream(&messages(&stuck, ContactRule::COVERED), 0)).expect("written");
    for (file, is_stuck) in [("walk.parquet", false), ("stuck.parquet", true), ("stuck.plantar", true)] {
        let (status, out, err) = run(path, &format!("fit {file} --json fit.json --out p.toml"));
        assert_eq!(status, if is_stuck { 3 } else { 0 }, "{file}: {out}{err}");
        for (name, region) in json(&path.join("fit.json"))["regions"].as_object().expect("regions") {
            let defects = region["defects"].as_array().expect("defects");
            let is_named = |defect: &Value| defect.as_str().is_some_and(|text| text.contains("faulty cells (up to 1)"));
            assert_eq!(defects.iter().any(is_named), is_stuck && name == "heel", "{file}: {name}: {defects:?}");
        }
    }
}

#[test]
fn contacts_that_are_not_steps_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    std::fs::write(path.join("layout.csv"), "cell,x_mm,y_mm,area_mm2,region\n0,30,20,900,heel\n").expect("written");
    // The first frame, the frame after the last one, and the pressure of each contact: one that begins before the recording, a
    // complete step, a contact of 50 ms, a weak step, a complete step, and a step that the end of the recording cuts off.
    let contacts =
        [(0, 30, 300.0), (80, 140, 300.0), (200, 205, 300.0), (260, 320, 60.0), (380, 440, 310.0), (480, 500, 300.0)];
    let frames: String = (0..500)
        .map(|i| {
            let kpa = contacts.iter().find(|(from, to, _)| (*from..*to).contains(&i)).map_or(0.0, |(_, _, kpa)| *kpa);
            format!("{:.2},{kpa}\n", f64::from(i) * 0.01)
        })
        .collect();
    std::fs::write(path.join("frames.csv"), format!("t_s,c0\n{frames}")).expect("written");
    succeed(path, "import csv --layout layout.csv --frames frames.csv --side left --out walk.parquet");
    let (_, out, _) = run(path, "fit walk.parquet");
    for words in [
        "0.00 s, on the ground from the first frame",
        "2.00 s, shorter",
        "2.60 s, partial: its peak force is 20 %",
        "4.80 s, on the ground until the last frame",
    ] {
        assert!(out.contains(words), "no \"{words}\" in {out}");
    }
    assert!(out.contains("2 steps of 1 recording,"), "{out}");
}

#[test]
fn recordings_of_different_sensors_and_with_cells_of_different_sizes_are_noted() {
    let folder = walk();
    let path = folder.path();
    let mut recording = Recording::read(path.join("walk.parquet")).expect("a recording");
    recording.pressure_kpa.iter_mut().for_each(|kpa| *kpa *= 1.01);
    recording.write(path.join("again.parquet")).expect("written");
    recording.layout.name = "emed plate".into();
    recording.write(path.join("plate.parquet")).expect("written");
    let note = "note: the recordings are of different sensors";
    assert!(!run(path, "fit walk.parquet again.parquet").2.contains(note));
    let (_, _, err) = run(path, "fit walk.parquet plate.parquet");
    assert!(err.contains(note) && err.contains("emed plate") && err.contains("plate.parquet"), "{err}");
    // The names of the sensors differ in the number of cells only.
    succeed(path, "import synthetic --steps 6 --cells 96 --out merged.parquet");
    let (_, _, err) = run(path, "fit walk.parquet merged.parquet");
    let sizes = err.split(" mm2 per cell, in ").map(|text| text.split(' ').next_back().expect("a number"));
    let sizes: Vec<f64> = sizes.take(2).map(|size| size.parse().expect("a number")).collect();
    assert!(err.contains(note) && sizes[1] > 2.0 * sizes[0] && err.contains("the same --cells"), "{err}");
}

#[test]
fn the_default_file_of_another_person_or_foot_is_not_replaced() {
    let folder = walk();
    let path = folder.path();
    succeed(path, "import synthetic --side left --steps 6 --out left.parquet");
    succeed(path, "fit walk.parquet --participant ann");
    let file = || std::fs::read_to_string(path.join("params.toml")).expect("a file");
    let of_ann = file();
    for (arguments, words) in [
        ("fit walk.parquet --participant bob", ["ann, right foot", "bob, right foot", "--out params.toml replaces"]),
        ("fit left.parquet --participant ann", ["ann, right foot", "ann, left foot", "another file with --out"]),
    ] {
        fail(path, arguments, &words);
        assert_eq!(file(), of_ann);
    }
    succeed(path, "fit walk.parquet --participant ann --steps 0-3");
    assert_ne!(file(), of_ann);
    succeed(path, "fit walk.parquet --participant bob --out params.toml");
    assert!(file().contains("bob"));
    std::fs::write(path.join("params.toml"), "notes").expect("written");
    fail(path, "fit walk.parquet", &["params.toml exists and would be replaced", "--out"]);
}

#[test]
fn the_steps_of_each_foot_are_stated_if_both_are_fitted_together() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    succeed(path, "import synthetic --side left --steps 6 --out walk.left.parquet");
    succeed(path, "import synthetic --side right --steps 5 --out walk.right.parquet");
    let out = succeed(path, "fit walk.left.parquet walk.right.parquet --out p.toml");
    assert!(out.contains("walk: 11 steps of 2 recordings"), "{out}");
    assert!(out.contains("both feet together: 6 steps of the left foot and 5 steps of the right foot"), "{out}");
    assert_eq!(Parameters::read(&path.join("p.toml")).expect("valid").subject, "walk");
}

#[test]
fn the_last_line_states_how_many_regions_are_incomplete_and_why() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    succeed(path, "import synthetic --steps 1 --out walk.parquet");
    let (status, out, _) = run(path, "fit walk.parquet");
    let last = out.lines().last().expect("a line");
    let words = "8 of 8 regions identified, 8 of them with incomplete results: only one step could be used";
    assert!(status == 3 && last.contains(words), "{out}");
}

/// The force on the foot is 90 to 270 N.
#[test]
fn a_recording_in_which_the_foot_is_never_lifted_is_named_as_such() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    std::fs::write(path.join("layout.csv"), "cell,x_mm,y_mm,area_mm2,region\n0,30,20,900,heel\n").expect("written");
    let frames: String = (0..400)
        .map(|i| {
            let kpa = if i / 50 % 2 == 0 { 300 } else { 100 };
            format!("{:.2},{kpa}\n", f64::from(i) * 0.01)
        })
        .collect();
    std::fs::write(path.join("frames.csv"), format!("t_s,c0\n{frames}")).expect("written");
    succeed(path, "import csv --layout layout.csv --frames frames.csv --side left --out walk.parquet");
    let reason = "on the ground from the first to the last frame: record a walk";
    let (status, out, err) = run(path, "fit walk.parquet");
    assert!(status == 1 && out.contains(&format!("left out: walk.parquet at 0.00 s, {reason}")), "{out}{err}");
    assert!(out.contains("heel: NOT FITTED, no whole step"), "{out}");
    assert!(out.contains("0 steps of 1 recording,") && !out.contains("NRMSE") && !out.contains("95 %"), "{out}");
    let (status, out, err) = run(path, "replay walk.parquet");
    let note = "no swing was recognised: record a walk";
    assert!(status == 0 && out.contains("no steps") && err.contains(note), "{out}{err}");
    let walk = walk();
    assert!(!run(walk.path(), "replay walk.parquet").2.contains(note));
}

#[test]
fn errors_for_bad_input_name_the_place_and_the_remedy() {
    let folder = walk();
    let path = folder.path();
    fail(path, "fit nothing.parquet", &["nothing.parquet"]);
    fail(path, "fit walk.parquet --compression 2", &["--compression 2", "0.05 to 0.95"]);
    fail(path, "fit walk.parquet --steps 90-99", &["--steps 90-99", "steps 0 to 5"]);
    fail(path, "fit walk.parquet walk.parquet", &["same recording", "give each recording once"]);
    fail(path, "fit walk.parquet --contact-on 5 --contact-off 6", &["contact-off may not be above contact-on"]);
    fail(path, "fit walk.parquet --tissue none.toml", &["none.toml"]);
    for (text, words) in [
        ("heal = 12\n", ["heal is not a region", "the regions are heel"]),
        ("heel = \"thick\"\n", ["bad.toml", "line 1"]),
        ("heel = 12\nhallux\n", ["bad.toml", "line 2"]),
        ("[heel]\nstrain = 0.4\n", ["bad.toml", "peak_strain"]),
    ] {
        std::fs::write(path.join("bad.toml"), text).expect("written");
        fail(path, "fit walk.parquet --thickness bad.toml", &words);
    }
    let (status, _, err) = run(path, "fit walk.parquet --steps 4-2");
    assert!(status == 2 && err.contains("a range N-M"), "{err}");
}

/// The recording of [`walk`] in `folder`.
fn recording(folder: &Path) -> Recording {
    Recording::read(folder.join("walk.parquet")).expect("a recording")
}

/// The messages of an insole with this contact rule while it measures the recording.
pub fn messages(recording: &Recording, contact: ContactRule) -> Vec<ToHost> {
    let computed = VirtualInsole::new(recording, contact, StanceRule::ADAPTIVE);
    let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    insole.set_up(computed.setup, computed.cells.iter().copied()).expect("a valid insole");
    let mut messages = vec![ToHost::Hello(Hello {
        major: MAJOR,
        minor: MINOR,
        firmware: "1".try_into().expect("short"),
        board: "computed".try_into().expect("short"),
        side: recording.side,
        layout_id: computed.setup.layout_id,
        cells: computed.cells.len() as u16,
        period_us: computed.setup.period_us,
        tissue_id: 0,
        contact_rule: contact,
        reset: Reset::Power,
        fault: None,
    })];
    let mut codes = vec![0; computed.cells.len()];
    for frame in 0..computed.frames(recording) {
        computed.codes_of(recording, frame, &mut codes);
        let is_toe_off = insole.frame(frame as u32, &codes);
        let t_us = frame as u64 * u64::from(computed.setup.period_us);
        messages.push(ToHost::Live(Live::new(
            frame as u32,
            t_us,
            insole.loads(),
            insole.masked(),
            insole.foot_centre_mm(),
        )));
        if is_toe_off {
            messages.push(ToHost::Step(Step::new(&insole.whole_step().expect("a step"))));
        }
    }
    messages
}

/// The content of a stream file with these messages of the insole with index `insole`, all at time 0.
pub fn stream(messages: &[ToHost], insole: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    for message in messages {
        let mut buffer = [0; MAX_MESSAGE];
        let message = encode(message, &mut buffer).expect("a message");
        bytes.extend([0, 0, 0, 0, insole]);
        bytes.extend((message.len() as u16).to_le_bytes());
        bytes.extend(&*message);
    }
    bytes
}

/// Asserts that two fits of the same walk have the same number of steps, and that the parameters of `fit` are within the 95 %
/// intervals of `reference`, except parameters that the force does not determine.
fn assert_agree(fit: &Value, reference: &Value) {
    let steps = |fit: &Value| fit["steps"].as_array().expect("steps").len();
    assert_eq!(steps(fit), steps(reference));
    for (name, reference) in reference["regions"].as_object().expect("regions") {
        let fit = &fit["regions"][name];
        for parameter in ["ab_m2", "stiffness_pa", "damping_pa_s", "n", "m"] {
            let value = fit["identified"][parameter].as_f64().expect("a number");
            let interval = &reference["uncertainty"]["intervals_95"][parameter];
            let end = |i: usize| interval["jacobian"][i].as_f64().unwrap_or(f64::NAN);
            let is_within = end(0) * 0.999 <= value && value <= end(1) * 1.001;
            assert!(is_within || interval["is_identifiable"] == false, "{name}: {parameter} {value} for {interval}");
        }
    }
}

#[test]
fn a_stream_file_results_in_the_same_parameters_as_the_recording_of_all_cells() {
    let folder = walk();
    let path = folder.path();
    succeed(path, "fit walk.parquet --contact-full 150 --json cells.json");
    let right = messages(&recording(path), ContactRule::COVERED);
    std::fs::write(path.join("walk.plantar"), stream(&right, 0)).expect("written");
    let out = succeed(path, "fit walk.plantar --json live.json --out p.toml --report r.html");
    assert!(out.contains("walk: 6 steps of 1 recording,") && out.contains("fraction sqrt(p / 150 kPa)"), "{out}");
    let live = json(&path.join("live.json"));
    assert_eq!((&live["recordings"][0]["cells"], &live["recordings"][0]["rate_hz"]), (&Value::Null, &100.0.into()));
    assert_eq!(live["recordings"][0]["name"], "walk.plantar, right");
    assert_agree(&live, &json(&path.join("cells.json")));
    let parameters = Parameters::read(&path.join("p.toml")).expect("readable").identified.expect("known");
    assert_eq!(parameters.contact, ContactRule::COVERED);
    let report = std::fs::read_to_string(path.join("r.html")).expect("a report");
    assert!(report.contains("live stream"), "the report does not name the live stream");

    // A file of both feet, truncated within its last message, which is a live frame.
    let mut left = right.clone();
    for message in &mut left {
        match message {
            ToHost::Hello(hello) => hello.side = Side::Left,
            ToHost::Step(step) => step.side = Side::Left,
            ToHost::Live(live) => live.regions[0].measured_dn += 1,
            _ => (),
        }
    }
    let mut both = stream(&left, 1);
    both.extend(stream(&right, 0));
    both.truncate(both.len() - 3);
    std::fs::write(path.join("both.plantar"), &both).expect("written");
    let (status, out, err) = run(path, "fit both.plantar --json both.json --out p.toml");
    assert_eq!(status, 0, "{out}{err}");
    assert!(out.contains("12 steps of 2 recordings") && err.contains("both.plantar is truncated"), "{out}{err}");

    // The foot of the second insole is not known, because neither its hello nor a step has arrived.
    left.retain(|message| matches!(message, ToHost::Live(_)));
    std::fs::write(path.join("one.plantar"), [stream(&left, 1), stream(&right, 0)].concat()).expect("written");
    let (status, out, err) = run(path, "fit one.plantar --json one.json --out p.toml");
    assert_eq!(status, 0, "{out}{err}");
    assert!(out.contains("6 steps of 1 recording,") && err.contains("the foot is not known"), "{out}{err}");
}

#[test]
fn errors_of_live_streams_name_the_file_and_the_remedy() {
    let folder = walk();
    let path = folder.path();
    let write = |name: &str, bytes: &[u8]| std::fs::write(path.join(name), bytes).expect("written");
    let covered = messages(&recording(path), ContactRule::COVERED);
    write("a.plantar", &stream(&covered, 0));
    write("copy.plantar", &stream(&covered, 1));
    write("b.plantar", &stream(&messages(&recording(path), ContactRule::COUNTED), 0));
    let mut changed = covered.clone();
    if let Some(ToHost::Step(step)) = changed.iter_mut().rfind(|message| matches!(message, ToHost::Step(_))) {
        step.contact_rule = ContactRule::COUNTED;
    }
    write("changed.plantar", &stream(&changed, 0));
    write("text.plantar", b"this is a text and no recorded stream");
    write("empty.plantar", &stream(&covered[..1], 0));
    let is_live = |message: &&ToHost| matches!(message, ToHost::Live(_));
    write("unknown.plantar", &stream(&covered.iter().filter(is_live).cloned().collect::<Vec<_>>(), 0));
    let mut other_version = covered.clone();
    if let Some(ToHost::Hello(hello)) = other_version.first_mut() {
        hello.major = MAJOR + 1;
    }
    write("version.plantar", &stream(&other_version, 0));
    fail(path, "fit a.plantar b.plantar", &["a.plantar", "b.plantar", "whole cells", "fit them separately"]);
    fail(path, "fit changed.plantar", &["changed.plantar", "the contact rule changed", "record each rule separately"]);
    fail(path, "fit a.plantar --contact-full 100", &["--contact-full 100 contradicts a.plantar", "omit the option"]);
    fail(path, "fit a.plantar --zero zero.toml", &["--zero zero.toml", "omit the option"]);
    fail(path, "fit a.plantar --release 50", &["--release", "its own stance rule", "omit the options"]);
    fail(path, "fit a.plantar copy.plantar", &["copy.plantar", "same steps as a.plantar", "once"]);
    // The stream and the cells of the same walk.
    for sources in ["walk.parquet a.plantar", "a.plantar walk.parquet"] {
        fail(path, &format!("fit {sources}"), &["a.plantar", "walk.parquet", "steps of the same walk"]);
    }
    fail(path, "fit text.plantar", &["text.plantar", "not a recorded stream", "plantar serve --record"]);
    fail(path, "fit empty.plantar", &["empty.plantar", "no live frames"]);
    fail(path, "fit unknown.plantar", &["unknown.plantar", "the foot is not known", "record a walk"]);
    fail(path, "fit version.plantar", &["version.plantar", "protocol version", "use the program"]);
    fail(path, "fit missing.plantar", &["missing.plantar"]);
    // Zeros at the end, as after a loss of power of the computer, do not prevent the use of the messages before them.
    write("zeros.plantar", &[stream(&covered, 0), vec![0; 100]].concat());
    succeed(path, "fit zeros.plantar --out p.toml");
    // Options that state the rule of the stream do not contradict it. A recording that is fitted together with a stream is
    // evaluated by the stream's rule.
    succeed(path, "fit a.plantar --contact-full 150 --contact-on 10 --out p.toml");
    succeed(path, "import synthetic --side left --steps 6 --out left.parquet");
    let out = succeed(path, "fit left.parquet a.plantar --steps 0-2 --out p.toml");
    assert!(out.contains("fraction sqrt(p / 150 kPa)"), "{out}");
}

/// Serves the messages to one program, as an insole on the network does.
fn serve(messages: Vec<ToHost>) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    std::thread::spawn(move || {
        let (mut host, _) = listener.accept().expect("the program connects");
        let mut send = {
            let mut host = host.try_clone().expect("a socket");
            move |message: &ToHost| {
                let mut buffer = [0; MAX_MESSAGE];
                let mut framed = [0; MAX_FRAME];
                let length = frame(encode(message, &mut buffer).expect("a message"), &mut framed);
                host.write_all(&framed[..length]).expect("the program is connected");
            }
        };
        let mut decoder = Decoder::new();
        let mut bytes = [0; 256];
        let mut is_streaming = false;
        // The program closes the connection after its last step.
        while let Ok(count @ 1..) = host.read(&mut bytes) {
            for &byte in &bytes[..count] {
                match decoder.push(byte).and_then(decode::<ToDevice>) {
                    Some(ToDevice::Connect { .. }) => send(&messages[0]),
                    Some(ToDevice::GetTime { host_us }) => send(&ToHost::Time { host_us, device_us: 0 }),
                    Some(ToDevice::Stream { live: true }) => is_streaming = true,
                    // The program waits for a status after it has turned the stream on.
                    Some(ToDevice::GetStatus) => {
                        send(&ToHost::Status(Status::default()));
                        if std::mem::take(&mut is_streaming) {
                            messages[1..].iter().for_each(&mut send);
                        }
                    }
                    _ => (),
                }
            }
        }
    });
    address
}

#[test]
fn the_folder_of_a_recorded_session_results_in_the_same_parameters_as_its_stream_file() {
    let folder = walk();
    let path = folder.path();
    let messages = messages(&recording(path), ContactRule::COUNTED);
    std::fs::write(path.join("walk.plantar"), stream(&messages, 0)).expect("written");
    let address = serve(messages);
    succeed(path, &format!("record --tcp {address} --out session --steps 6"));
    succeed(path, "fit walk.plantar --json stream.json");
    let out = succeed(path, "fit session --json session.json --out p.toml");
    assert!(out.contains("session: 6 steps of 1 recording,"), "{out}");
    let (session, stream) = (json(&path.join("session.json")), json(&path.join("stream.json")));
    assert_eq!(session["steps"], stream["steps"]);
    assert_eq!(session["regions"], stream["regions"]);

    // Recordings of the cells beside the tables are not used, and a note states this.
    std::fs::create_dir(path.join("session/cells")).expect("made");
    let (status, _, notes) = run(path, "fit session --json cells.json --out p.toml");
    assert!(status == 0 && notes.contains("not the cells"), "{notes}");

    // A recording of the cells has the same steps as the tables.
    std::fs::create_dir(path.join("session/cells/000")).expect("made");
    std::fs::copy(path.join("walk.parquet"), path.join("session/cells/000/part-00000.parquet")).expect("copied");
    fail(path, "fit session ./session/cells/000", &["./session/cells/000", "steps in session: give one of the two"]);

    std::fs::write(path.join("session/live/part-99999.parquet"), b"PAR1 truncated").expect("written");
    fail(path, "fit session", &["part-99999.parquet", "remove the file"]);
    std::fs::remove_file(path.join("session/live/part-99999.parquet")).expect("removed");
    std::fs::remove_dir_all(path.join("session/steps")).expect("removed");
    std::fs::create_dir(path.join("session/steps")).expect("made");
    fail(path, "fit session", &["session: no steps", "record a walk"]);
    std::fs::remove_dir_all(path.join("session/live")).expect("removed");
    fail(path, "fit session", &["live is missing"]);
}

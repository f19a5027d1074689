//! Tests `plantar export`: it writes complete files only, and names the remedy if it cannot write one.

use plantar::Side;
use recording::Recording;
use recording::synthetic::{SyntheticWalk, walk};
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

/// A folder with recordings of both feet on one clock, and with a right foot at another rate.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, side, rate_hz| {
        let walk = walk(&SyntheticWalk { side, steps: 2, rate_hz, ..SyntheticWalk::default() });
        walk.recording.write(folder.path().join(name)).expect("written");
    };
    write("left.parquet", Side::Left, 100.0);
    write("right.parquet", Side::Right, 100.0);
    write("slow.parquet", Side::Right, 50.0);
    folder
}

fn export(folder: &Path, arguments: &str) -> Output {
    // If the arguments contain "full", the shell limits the size of files to 16 blocks, which has the same effect as a full
    // disk.
    let limit = if arguments.contains("full") { "trap '' XFSZ; ulimit -f 16; " } else { "" };
    let mut command = Command::new("sh");
    command.args(["-c", &format!("{limit}exec \"$0\" export {arguments}"), env!("CARGO_BIN_EXE_plantar")]);
    command.current_dir(folder).output().expect("the shell starts")
}

/// The names in a folder, in order.
fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten();
    let mut names: Vec<_> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Asserts that an export fails with a message that contains all of `words`, and leaves nothing behind.
fn fail(folder: &Path, arguments: &str, words: &[&str]) {
    let before = names(folder);
    let output = export(folder, arguments);
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{arguments}: {text}");
    for word in words {
        assert!(text.contains(word), "{arguments}: no \"{word}\" in: {text}");
    }
    assert_eq!(names(folder), before, "{arguments}");
}

const FORMATS: [&str; 7] = ["c3d", "mot", "sto", "mat", "motion-bids", "csv", "mcap"];

/// The file of this name with the extension of a format; Motion-BIDS is a folder.
fn with_extension(name: &str, format: &str) -> String {
    if format == "motion-bids" { name.into() } else { format!("{name}.{format}") }
}

#[test]
fn every_format_is_written_for_one_foot_and_for_both() {
    let folder = folder();
    for format in FORMATS {
        for recordings in ["left.parquet", "right.parquet left.parquet"] {
            let out = with_extension(&format!("{format}-{}", recordings.len()), format);
            let output = export(folder.path(), &format!("{format} {recordings} --out {out}"));
            let text = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success() && text.contains("steps"), "{out}: {text}");
            assert!(folder.path().join(&out).exists());
        }
    }
    let incomplete: Vec<_> = names(folder.path()).into_iter().filter(|name| name.contains("incomplete")).collect();
    assert!(incomplete.is_empty(), "{incomplete:?}");
}

/// The rows of a CSV file without its header.
fn rows(path: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(path).expect("a file");
    text.lines().skip(1).map(|line| line.split(',').map(String::from).collect()).collect()
}

fn number(field: &str) -> f64 {
    field.parse().expect("a number")
}

#[test]
fn an_export_has_the_frames_and_steps_of_a_replay() {
    let folder = folder();
    let output = export(folder.path(), "csv left.parquet --contact-on 20 --release 200 --out walk.csv");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut replay = Command::new(env!("CARGO_BIN_EXE_plantar"));
    replay.args("replay left.parquet --contact-on 20 --release 200 --frames frames.csv --json steps.json".split(' '));
    assert!(replay.current_dir(folder.path()).output().expect("the program starts").status.success());
    let exported = rows(&folder.path().join("walk.csv"));
    let quantity = |region: &str, name: &str| {
        let of = exported.iter().filter(|row| row[2] == region && row[3] == name);
        of.map(|row| (number(&row[0]), number(&row[4]) as f32)).collect::<Vec<_>>()
    };
    // The columns of a replay: time, total force and centre of pressure of the foot, then area and force of the heel.
    let replayed = rows(&folder.path().join("frames.csv"));
    let column = |i: usize| replayed.iter().map(|row| (number(&row[0]), number(&row[i]) as f32)).collect::<Vec<_>>();
    assert_eq!(quantity("foot", "total_force_n"), column(1));
    assert_eq!(quantity("heel", "area_mm2"), column(4));
    assert_eq!(quantity("heel", "measured_force_n"), column(5));
    let steps = std::fs::read_to_string(folder.path().join("steps.json")).expect("a file");
    let steps: Vec<serde_json::Value> = serde_json::from_str(&steps).expect("JSON");
    assert_eq!(steps.len(), 2);
    let [strikes, offs] = ["heel_strike", "toe_off"].map(|name| quantity("foot", name));
    for ((step, strike), off) in steps.iter().zip(&strikes).zip(&offs) {
        // The recording begins at 0 s, so the times of steps and events can be compared.
        let (start_s, duration_s) = (step["start_s"].as_f64().expect("s"), step["duration_s"].as_f64().expect("s"));
        assert!((strike.0 - start_s).abs() < 1e-6 && (off.0 - start_s - duration_s).abs() < 1e-6, "{step}");
        assert_eq!(step["step"], strike.1 as u32);
    }
}

#[test]
fn feet_of_different_measurements_are_noted() {
    let folder = folder();
    let path = folder.path();
    let export = |left: &str| {
        let mut recording = Recording::read(path.join("left.parquet")).expect("a recording");
        recording.source = left.into();
        recording.write(path.join("other.parquet")).expect("written");
        let output = export(path, "csv other.parquet right.parquet --out walk.csv");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{text}");
        text
    };
    let right = Recording::read(path.join("right.parquet")).expect("a recording").source;
    assert!(!export(&right).contains("different origins"));
    assert!(export("emed measurement other.lst, regions by template.").contains("different origins"));
}

#[test]
fn a_part_of_a_recording_is_exported() {
    let folder = folder();
    let recording = Recording::read(folder.path().join("left.parquet")).expect("a recording");
    let output = export(folder.path(), "csv left.parquet --from 0.5 --to 1.25 --out part.csv");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = std::fs::read_to_string(folder.path().join("part.csv")).expect("a file");
    let time = |line: &str| line.split(',').next().and_then(|field| field.parse::<f64>().ok()).expect("a time");
    let mut times: Vec<f64> = text.lines().skip(1).map(time).collect();
    times.dedup();
    let expected: Vec<f64> = recording.t_s.into_iter().filter(|t_s| (0.499..=1.251).contains(t_s)).collect();
    assert_eq!(times, expected);
}

#[test]
fn unusable_recordings_and_options_are_refused_with_the_remedy() {
    let folder = folder();
    let folder = folder.path();
    fail(folder, "csv missing.parquet --out a.csv", &["missing.parquet", "check the path"]);
    fail(folder, "csv left.parquet left.parquet --out a.csv", &["left foot", "one recording for each foot"]);
    fail(folder, "csv left.parquet slow.parquet --out a.csv", &["slow.parquet", "50", "--rate"]);
    fail(folder, "csv left.parquet --from 100 --out a.csv", &["left.parquet", "--from", "within the recording"]);
    fail(folder, "csv left.parquet --out ./left.parquet", &["left.parquet", "input of this command", "another file"]);
    fail(folder, "motion-bids left.parquet --task one_two --out a", &["one_two", "letters and digits"]);
    fail(folder, "motion-bids left.parquet --subject '' --out a", &["letters and digits"]);
}

#[test]
fn an_output_that_cannot_be_written_is_named_and_leaves_nothing() {
    let folder = folder();
    let folder = folder.path();
    for format in FORMATS {
        let fail = |name: &str, words: &[&str]| {
            fail(folder, &format!("{format} left.parquet --out {}", with_extension(name, format)), words);
        };
        std::fs::create_dir_all(folder.join(with_extension("existing", format))).expect("created");
        fail("nowhere/a", &["nowhere/a", "check the path"]);
        fail("existing", &["existing"]);
        fail("full", &["full", "the free disk space"]);
    }
}

#[test]
fn a_file_with_the_extension_of_another_format_is_refused() {
    let folder = folder();
    let path = folder.path().join("steps.csv");
    std::fs::write(&path, "precious").expect("written");
    for (arguments, words) in [
        ("c3d left.parquet --out steps.csv", "steps.csv: use the extension .c3d"),
        ("mot left.parquet --out walk.sto", "walk.sto: use the extension .mot"),
        ("sto left.parquet --out walk.mot", "walk.mot: use the extension .sto"),
        ("csv left.parquet --out walkcsv", "walkcsv: use the extension .csv"),
        ("mat left.parquet --out walk.parquet", "walk.parquet: use the extension .mat"),
        ("mcap left.parquet --out walk.csv", "walk.csv: use the extension .mcap"),
    ] {
        fail(folder.path(), arguments, &[words]);
    }
    assert_eq!(std::fs::read_to_string(&path).expect("a file"), "precious");
}

/// A file that exists is replaced only by a complete one.
#[test]
fn a_failed_export_leaves_the_existing_file() {
    let folder = folder();
    let path = folder.path().join("full.mat");
    std::fs::write(&path, "precious").expect("written");
    fail(folder.path(), "mat left.parquet --out full.mat", &["full.mat"]);
    assert_eq!(std::fs::read_to_string(&path).expect("a file"), "precious");
}

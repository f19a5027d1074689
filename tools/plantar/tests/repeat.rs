//! Tests `plantar repeat`: its results, and its messages about people and recordings that cannot be used.

use plantar::Side;
use recording::synthetic::{self, SyntheticWalk};
use recording::{Recording, jiku};
use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

/// Runs the program. Returns the exit status, and the text on stdout and stderr.
fn plantar(folder: &Path, arguments: &str) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_plantar"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .output()
        .expect("the program starts");
    let text = [&output.stdout, &output.stderr].map(|stream| String::from_utf8_lossy(stream));
    (output.status.code(), text.concat())
}

/// Writes a computed walk of three steps of this foot. Walks with different seeds are different trials.
fn walk(path: &Path, side: Side, seed: u64, peak_n: f64) {
    fs::create_dir_all(path.parent().expect("a folder")).expect("made");
    let walk = SyntheticWalk { side, steps: 3, seed, peak_n, ..Default::default() };
    synthetic::walk(&walk).recording.write(path).expect("written");
}

/// A study of three people with two trials of the left foot each. The peak forces of the people are 600, 750 and 900 N.
fn study() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().to_path_buf();
    for (i, name) in ["ann", "bob", "cid"].into_iter().enumerate() {
        for (j, trial) in ["a", "b"].into_iter().enumerate() {
            let peak_n = 600.0 + 150.0 * i as f64;
            walk(&path.join(format!("people/{name}/{trial}.parquet")), Side::Left, (10 * i + j) as u64, peak_n);
        }
    }
    (folder, path)
}

fn csv_rows(path: &Path) -> Vec<HashMap<String, String>> {
    let mut file = csv::Reader::from_path(path).expect("a CSV file");
    file.deserialize().map(|line| line.expect("a line")).collect()
}

fn number(row: &HashMap<String, String>, column: &str) -> f64 {
    row[column].parse().expect("a number")
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(path).expect("a file")).expect("JSON")
}

#[test]
fn a_quantity_that_differs_more_between_people_than_between_trials_has_a_high_icc() {
    let (_folder, path) = study();
    let (status, text) = plantar(&path, "repeat people --json r.csv");
    assert!(status == Some(1) && text.contains("extension .json; --csv writes a table"), "{text}");
    let (status, text) = plantar(&path, "repeat people --csv r.csv --json r.json");
    assert_eq!(status, Some(0), "{text}");
    assert!(text.contains("left foot: 2 trials of 3 people"), "{text}");
    // The loads come first, then the quantities, and then the eight parameters.
    let positions = [
        "peak pressure, kPa",
        "force at 70 %",
        "energy dissipated",
        "d₀: thickness",
        "m: damping exponent",
        "ICC(2,1) by region",
    ];
    let positions = positions.map(|words| text.find(words).unwrap_or_else(|| panic!("{words}: {text}")));
    assert!(positions.is_sorted(), "{positions:?}");

    let rows = csv_rows(&path.join("r.csv"));
    let of = |variable: &'static str| rows.iter().filter(move |row| row["variable"] == variable);
    // The steps of a trial vary by at most 3 %, and the peak forces of the people are 600, 750 and 900 N, so the force at a
    // fixed share of the area has a high ICC.
    let heel = of("force_at_70_percent_area_n").find(|row| row["region"] == "heel").expect("the heel");
    assert_eq!((heel["people"].as_str(), heel["trials"].as_str(), heel["side"].as_str()), ("3", "2", "left"));
    assert!(number(heel, "icc_2_1") > 0.9, "{heel:?}");
    assert!(number(heel, "sem") < 0.03 * number(heel, "mean"), "{heel:?}");
    for row in &rows {
        assert!(
            (number(row, "mdc_95") - 1.96 * 2f64.sqrt() * number(row, "sem")).abs() <= 1e-9 * number(row, "mdc_95")
        );
    }
    // The means are those of the values of `plantar fit` with the same recordings.
    let values = ["ann/a", "ann/b", "bob/a", "bob/b", "cid/a", "cid/b"].map(|trial| {
        let (status, text) = plantar(&path, &format!("fit people/{trial}.parquet --out p.toml --json fit.json"));
        assert!(matches!(status, Some(0 | 3)), "{text}");
        let heel = &json(&path.join("fit.json"))["regions"]["heel"];
        [&heel["quantities"]["force_at_70_percent_area_n"]["value"], &heel["ellipsoid"]["k_n_m3"]]
            .map(|value| value.as_f64().expect("a number"))
    });
    let stiffness = of("k_n_m3").find(|row| row["region"] == "heel").expect("the heel");
    for (i, row) in [heel, stiffness].into_iter().enumerate() {
        let mean = values.iter().map(|value| value[i]).sum::<f64>() / 6.0;
        assert!((number(row, "mean") / mean - 1.0).abs() < 1e-9, "{row:?}, {mean}");
    }
    let foot = &json(&path.join("r.json"))["feet"][0];
    assert_eq!(foot["people"], serde_json::json!(["ann", "bob", "cid"]));
    let icc = &foot["variables"]["force_at_70_percent_area_n"]["heel"]["icc_2_1"];
    assert!((icc.as_f64().expect("a number") - number(heel, "icc_2_1")).abs() < 1e-12);
}

#[test]
fn single_trials_are_left_out_with_the_remedy_and_extra_trials_are_not_used() {
    let (_folder, path) = study();
    let (_, before) = plantar(&path, "repeat people --csv before.csv");
    walk(&path.join("people/bob/c.parquet"), Side::Left, 90, 300.0);
    walk(&path.join("people/dan/a.parquet"), Side::Left, 91, 700.0);
    walk(&path.join("people/ann/r.parquet"), Side::Right, 92, 700.0);
    fs::write(path.join("people/cid/d.parquet"), "PAR1").expect("written");
    fs::create_dir(path.join("people/eve")).expect("made");
    let (status, text) = plantar(&path, "repeat people --csv after.csv");
    assert_eq!(status, Some(3), "{text}");
    for words in [
        "left foot: the first 2 trials of 3 people, who have 2 to 3",
        "left out: dan, left foot: only one usable recording",
        "record another trial of the left foot",
        "left out: ann, right foot: only one usable recording",
        "left out: people/cid/d.parquet",
        "left out: people/eve: no recordings",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    assert_eq!(csv_rows(&path.join("before.csv")), csv_rows(&path.join("after.csv")), "{before}");
}

#[test]
fn incomplete_results_of_trials_are_named() {
    let (_folder, path) = study();
    fs::write(path.join("people/ann/participant.toml"), "tissue = 'tissue.toml'").expect("written");
    let tissue = "[heel]\nthickness_mm = 18\npeak_strain = 0.6\ncurvature_mm = [400, 400]\n";
    fs::write(path.join("people/ann/tissue.toml"), tissue).expect("written");
    let (status, text) = plantar(&path, "repeat people --json r.json");
    assert_eq!(status, Some(3), "{text}");
    for trial in ["a", "b"] {
        assert!(
            text.contains(&format!("incomplete: ann, {trial}, heel: measurements contradict each other")),
            "{text}"
        );
    }
    assert_eq!(json(&path.join("r.json"))["incomplete"].as_array().map(Vec::len), Some(2));
}

/// A copy would be a trial without an error of measurement.
#[test]
fn copies_of_recordings_are_left_out_and_named() {
    let (_folder, path) = study();
    plantar(&path, "repeat people --csv before.csv");
    fs::copy(path.join("people/ann/a.parquet"), path.join("people/ann/z.parquet")).expect("copied");
    fs::copy(path.join("people/ann/a.parquet"), path.join("people/bob/z.parquet")).expect("copied");
    let (status, text) = plantar(&path, "repeat people --csv after.csv");
    assert_eq!(status, Some(3), "{text}");
    for person in ["ann", "bob"] {
        let words = format!("left out: {person}, z: the same recording as ann, a: give each recording once");
        assert!(text.contains(&words), "{words}: {text}");
    }
    assert_eq!(csv_rows(&path.join("before.csv")), csv_rows(&path.join("after.csv")));
    let (status, text) = plantar(&path, "cohort people --out table");
    assert_eq!(status, Some(0), "{text}");
    assert!(text.contains("note: bob, z.parquet: the same recording as ann, a.parquet"), "{text}");
}

/// Files that may be recordings, but that the program does not read, are named; the exit status is 3.
#[test]
fn files_that_are_not_directly_in_a_participants_folder_are_left_out_and_named() {
    let (_folder, path) = study();
    walk(&path.join("people/ann/day2/walk.parquet"), Side::Left, 90, 700.0);
    walk(&path.join("people/lost.parquet"), Side::Left, 91, 700.0);
    let (status, text) = plantar(&path, "repeat people --json repeat.json");
    assert_eq!(status, Some(3), "{text}");
    let left_out = json(&path.join("repeat.json"))["left_out"].to_string();
    for text in [text, left_out] {
        assert!(text.contains("lost.parquet: not in the folder of a participant"), "{text}");
        assert!(text.contains("day2: Parquet files in a sub-folder of a participant are not used (1)"), "{text}");
    }
}

/// The folder of a study may also contain the tables of earlier runs.
#[test]
fn folders_of_results_are_not_participants() {
    let (_folder, path) = study();
    for command in ["cohort people --out people/table", "repeat people"] {
        let (status, text) = plantar(&path, command);
        assert!(status == Some(0) && !text.contains("left out"), "{command}: {text}");
    }
    let nested = "cohort people --out people/results/table";
    for command in [nested, nested, "repeat people"] {
        let (status, text) = plantar(&path, command);
        assert!(status == Some(0) && !text.contains("left out"), "{command}: {text}");
    }
}

#[test]
fn the_folder_of_a_participant_is_refused_with_the_remedy() {
    let (_folder, path) = study();
    let remedy = "give the recordings as files, or the folder of the study";
    fs::write(path.join("people/bob/participant.toml"), "size = 40").expect("written");
    for words in ["people/ann is not one recording in parts", "people/bob is the folder of a participant"] {
        let folder = words.split(' ').next().expect("a folder");
        let (status, text) = plantar(&path, &format!("repeat {folder}"));
        assert!(status == Some(1) && text.contains(words) && text.contains(remedy), "{text}");
    }
}

#[test]
fn the_recordings_of_one_person_are_compared_without_an_icc() {
    let (_folder, path) = study();
    let (status, text) = plantar(&path, "repeat people/ann/a.parquet people/ann/b.parquet --csv r.csv");
    assert_eq!(status, Some(0), "{text}");
    assert!(text.contains("left foot: 2 trials of one person") && !text.contains("ICC(2,1) by region"), "{text}");
    let rows = csv_rows(&path.join("r.csv"));
    assert!(rows.len() > 100 && rows.iter().all(|row| row["icc_2_1"].is_empty() && row["people"] == "1"));
    for (arguments, words) in [
        ("repeat people/ann/a.parquet", "two or more usable recordings of the same foot are needed"),
        ("repeat people/ann/a.parquet people/ann/a.parquet", "given twice"),
        ("repeat nowhere.parquet people/ann/a.parquet", "cannot read nowhere.parquet"),
        ("repeat people --zero zero.toml", "name the zero file of each participant in participant.toml"),
    ] {
        let (status, text) = plantar(&path, arguments);
        assert_eq!((status, text.contains(words)), (Some(1), true), "{arguments}: {text}");
    }
    // A folder whose only file is hidden, such as one of macOS, is not read as a recording that is divided into several files,
    // but as a study without participants.
    fs::create_dir(path.join("hidden")).expect("made");
    fs::write(path.join("hidden/._a.parquet"), "of macOS").expect("written");
    let (status, text) = plantar(&path, "repeat hidden");
    assert_eq!((status, text.contains("hidden: no participant")), (Some(1), true), "{text}");
    // A study in which only one person has two trials of a foot.
    fs::remove_dir_all(path.join("people/bob")).expect("removed");
    fs::remove_file(path.join("people/cid/b.parquet")).expect("removed");
    let (status, text) = plantar(&path, "repeat people");
    assert_eq!(status, Some(1), "{text}");
    for words in [
        "ann, left foot: nobody else",
        "compare the recordings of this person alone, without other people",
        "cid, left foot: only one",
        "two or more people with two or more",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
}

#[test]
fn trials_of_different_sensors_are_noted_for_each_foot() {
    let (_folder, path) = study();
    let mut recording = Recording::read(path.join("people/ann/b.parquet")).expect("a recording");
    let compare = "repeat people/ann/a.parquet other.parquet";
    recording.write(path.join("other.parquet")).expect("written");
    assert!(!plantar(&path, compare).1.contains("different sensors"));
    recording.layout.name = "emed plate".into();
    recording.write(path.join("other.parquet")).expect("written");
    let (_, text) = plantar(&path, compare);
    for words in ["note: the recordings are of different sensors", "emed plate", "differences between the trials"] {
        assert!(text.contains(words), "no \"{words}\" in {text}");
    }
}

#[test]
#[ignore = "needs the data set SpeedPP2DS: cargo xtask test"]
fn the_area_at_half_of_the_force_repeats_better_than_the_exponent_n() {
    let data = std::env::var_os("PLANTAR_JIKU").expect("PLANTAR_JIKU names the folder of the data set");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    for walker in 0..jiku::WALKERS {
        let person = path.join(format!("people/walker-{walker}"));
        fs::create_dir_all(&person).expect("made");
        // Each of the two recordings has every second one of the walker's first 40 trials in the data set, which are single
        // steps, so that a trend over the session affects both alike.
        for first in 0..2 {
            let trials = (first..40).step_by(2);
            let recording = jiku::import(&data, walker, trials, &mut |_, _| ()).expect("a recording");
            recording.write(person.join(format!("{first}.parquet"))).expect("written");
        }
    }
    // The results of some regions are incomplete: their steps change within a recording, or only one of them could be used.
    let (status, text) = plantar(path, "repeat people --csv r.csv");
    assert!(status == Some(3) && text.contains("incomplete: walker-1, 0, toe_2: only one step"), "{text}");
    println!("{text}");
    let rows = csv_rows(&path.join("r.csv"));
    let median_icc = |variable: &str| {
        let of = rows.iter().filter(|row| row["variable"] == variable && !row["icc_2_1"].is_empty());
        let mut all: Vec<f64> = of.map(|row| number(row, "icc_2_1")).collect();
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    let (area_icc, exponent_icc) = (median_icc("area_at_50_percent_force_mm2"), median_icc("n"));
    assert!(area_icc > 0.75 && area_icc > exponent_icc, "{area_icc}, {exponent_icc}");
}

//! Tests `plantar cohort`: the table, the means, and participants that are up to date or cannot be used.

use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use plantar::{Region, Side};
use recording::Recording;
use recording::synthetic::{self, SyntheticWalk};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::SystemTime;
use study::table::{self, Value};
use tempfile::TempDir;

type Row = HashMap<String, Field>;

fn cohort(folder: &Path, options: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_plantar"))
        .args("cohort people --out table --summary summary.csv".split(' '))
        .args(options.split_whitespace())
        .current_dir(folder)
        .output()
        .expect("the program starts")
}

/// The exit status, and the text on stdout and stderr.
fn outcome(output: &Output) -> (Option<i32>, String) {
    let text = [&output.stdout, &output.stderr].map(|stream| String::from_utf8_lossy(stream));
    (output.status.code(), text.concat())
}

/// Writes a computed walk of one to three steps.
fn walk(path: &Path, side: Side, seed: u64) {
    let peak_n = 700.0 + 20.0 * seed as f64;
    let walk = SyntheticWalk { side, steps: 1 + seed as usize % 3, seed, peak_n, ..Default::default() };
    synthetic::walk(&walk).recording.write(path).expect("written");
}

/// A folder with two participants, each with three recordings: "ann" with size 36, and "bob=b." with size 43, whose name contains
/// a special character.
fn people() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().to_path_buf();
    for (name, size, recordings) in [
        ("ann", 36, [("a.parquet", Side::Left, 1), ("b.parquet", Side::Left, 2), ("c.parquet", Side::Right, 3)]),
        ("bob=b.", 43, [("l.parquet", Side::Left, 4), ("r.parquet", Side::Right, 5), ("s.parquet", Side::Right, 6)]),
    ] {
        let participant = path.join("people").join(name);
        fs::create_dir_all(&participant).expect("made");
        fs::write(
            participant.join("participant.toml"),
            format!("size = {size}\nmass_kg = 60.5\nheight_cm = 160\nage_years = 30\nsex = 'female'\n"),
        )
        .expect("written");
        for (recording, side, seed) in recordings {
            walk(&participant.join(recording), side, seed);
        }
    }
    (folder, path)
}

/// The rows of a participant in the table.
fn rows(path: &Path, participant: &str) -> Vec<Row> {
    let file = File::open(path.join(format!("table/participant={participant}/steps.parquet"))).expect("a table");
    let reader = SerializedFileReader::new(file).expect("Parquet");
    let rows = reader.get_row_iter(None).expect("rows");
    rows.map(|row| row.expect("a row").into_columns().into_iter().collect()).collect()
}

fn number(row: &Row, column: &str) -> f64 {
    match row[column] {
        Field::Double(value) => value,
        Field::Int(value) => f64::from(value),
        ref other => panic!("{column}: {other}"),
    }
}

fn text<'r>(row: &'r Row, column: &str) -> &'r str {
    if let Field::Str(text) = &row[column] { text } else { panic!("{column}") }
}

fn summary(path: &Path) -> String {
    fs::read_to_string(path.join("summary.csv")).expect("a summary")
}

#[test]
fn each_region_of_each_step_is_a_row_with_a_fit_of_its_own() {
    let (_folder, path) = people();
    let (status, text_of_run) = outcome(&cohort(&path, "--contact-full 150 --filter live"));
    assert_eq!(status, Some(0), "{text_of_run}");
    assert!(text_of_run.contains("12 steps of 2 participants"), "{text_of_run}");
    let ann = rows(&path, "ann");
    // Both participants have recordings of two, three and one steps.
    assert_eq!((ann.len(), rows(&path, "bob%3Db.").len()), (6 * 8, 6 * 8));
    let of = |recording: &str| ann.iter().filter(|row| text(row, "recording") == recording).count();
    assert_eq!(["a.parquet", "b.parquet", "c.parquet"].map(of), [16, 24, 8]);
    for (row, region) in ann.iter().zip(Region::ALL.iter().cycle()) {
        assert_eq!((text(row, "region"), row.len(), row.contains_key("participant")), (region.name(), 73, false));
        assert_eq!((number(row, "insole_size"), number(row, "mass_kg")), (36.0, 60.5));
        assert_eq!((number(row, "height_cm"), number(row, "age_years"), text(row, "sex")), (160.0, 30.0, "female"));
        assert_eq!((text(row, "filter"), text(row, "method")), ("live", "projection"));
        let rule = ["contact_on_kpa", "contact_off_kpa", "contact_full_kpa"].map(|column| number(row, column));
        assert_eq!(rule, [10.0, 7.5, 150.0]);
        assert!(text(row, "side") == if text(row, "recording") == "c.parquet" { "right" } else { "left" });
        if row["fitted"] == Field::Bool(false) {
            assert!(!text(row, "reason").is_empty() && row["n"] == Field::Null && row["n_at_bound"] == Field::Null);
            assert!(row["k_n_m3"] == Field::Null && row["evaluations"] == Field::Null);
            continue;
        }
        assert_eq!((&row["fitted"], &row["reason"]), (&Field::Bool(true), &Field::Null));
        assert!(number(row, "secant_modulus_kpa") > 0.0 && number(row, "area_at_50_percent_force_mm2") > 0.0);
        for column in ["ab_mm2", "stiffness_pa", "damping_pa_s", "n", "m"] {
            let [low, high] = ["low", "high"].map(|end| number(row, &format!("{column}_{end}")));
            assert!(low <= number(row, column) && number(row, column) <= high, "{region:?} {column}");
        }
        assert!(matches!(row["ab_at_bound"], Field::Bool(_)));
        // The five identified and the paper's eight parameters result in the same force: K = k C^(n+1) / d0^n.
        let value = |column| number(row, column);
        let (c_m, d0_m) = (value("c_mm") * 1e-3, value("d0_mm") * 1e-3);
        let stiffness_pa = value("k_n_m3") * c_m.powf(value("n") + 1.0) / d0_m.powf(value("n"));
        assert!((stiffness_pa / value("stiffness_pa") - 1.0).abs() < 1e-9);
        assert!((value("a_mm") * value("b_mm") / value("ab_mm2") - 1.0).abs() < 1e-9);
        assert!((0.0..100.0).contains(&value("nrmse_percent")) && value("evaluations") > 0.0);
    }
    assert!(ann.iter().filter(|row| row["fitted"] == Field::Bool(true)).count() > 30);
}

/// With absolute thresholds, the recorded force alone determines heel strike and toe off.
#[test]
fn steps_begin_and_end_at_the_stated_thresholds() {
    const STRIKE_N: f64 = 300.0;
    const RELEASE_N: f64 = 250.0;
    let (_folder, path) = people();
    let options = format!("--thresholds absolute --strike {STRIKE_N} --release {RELEASE_N}");
    let (status, text_of_run) = outcome(&cohort(&path, &options));
    assert_eq!(status, Some(0), "{text_of_run}");
    let ann = rows(&path, "ann");
    assert_eq!(ann.len(), 6 * 8);
    for row in ann.iter().step_by(8) {
        let recording = Recording::read(path.join("people/ann").join(text(row, "recording"))).expect("a recording");
        let at = |time_s: f64| recording.t_s.iter().position(|t_s| (t_s - time_s).abs() < 1e-6).expect("a frame");
        let start_s = number(row, "start_s");
        let (strike, off) = (at(start_s), at(start_s + number(row, "duration_s")));
        let force_n = |frame: usize| recording.force_n(frame);
        assert!(force_n(strike - 1) < STRIKE_N && force_n(strike) >= STRIKE_N, "heel strike at {start_s} s");
        assert!(force_n(off - 1) >= RELEASE_N && force_n(off) < RELEASE_N, "toe off at {} s", recording.t_s[off]);
    }
}

#[test]
fn the_loads_of_each_region_are_those_of_the_step_record() {
    let (_folder, path) = people();
    let (status, text_of_run) = outcome(&cohort(&path, "--contact-full 150"));
    assert_eq!(status, Some(0), "{text_of_run}");
    let replayed = Command::new(env!("CARGO_BIN_EXE_plantar"))
        .args("replay people/ann/b.parquet --contact-full 150 --precision f64 --steps steps.csv".split(' '))
        .current_dir(&path)
        .output();
    assert!(replayed.expect("the program starts").status.success());
    let mut file = csv::Reader::from_path(path.join("steps.csv")).expect("a table");
    let steps: Vec<HashMap<String, String>> = file.deserialize().map(|line| line.expect("a line")).collect();
    let rows: Vec<Row> = rows(&path, "ann").into_iter().filter(|row| text(row, "recording") == "b.parquet").collect();
    assert_eq!((steps.len(), rows.len()), (3 * 8, 3 * 8));
    for (row, step) in rows.iter().zip(&steps) {
        assert_eq!(text(row, "region"), step["region"]);
        for column in [
            "measured_force_peak_n",
            "measured_force_integral_n_s",
            "peak_pressure_kpa",
            "pressure_integral_kpa_s",
            "area_peak_mm2",
            "contact_time_s",
        ] {
            assert_eq!(number(row, column), step[column].parse::<f64>().expect("a number"), "{step:?}, {column}");
        }
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// A participant's mean of a column: over the steps of each recording, then over the recordings.
fn mean_of(rows: &[Row], region: &str, column: &str) -> Option<f64> {
    let mut trials = BTreeMap::<_, Vec<f64>>::new();
    for row in rows.iter().filter(|row| text(row, "region") == region && row[column] != Field::Null) {
        trials.entry(text(row, "recording")).or_default().push(number(row, column));
    }
    let means: Vec<f64> = trials.values().map(|steps| mean(steps)).collect();
    (!means.is_empty()).then(|| mean(&means))
}

#[test]
fn the_summary_has_means_over_steps_then_trials_then_participants_of_a_size() {
    let (_folder, path) = people();
    // A second participant in bob's pair of sizes, 43-44.
    let cid = path.join("people/cid");
    fs::create_dir(&cid).expect("made");
    fs::write(cid.join("participant.toml"), "size = 44").expect("written");
    walk(&cid.join("w.parquet"), Side::Left, 8);
    let (status, text_of_run) = outcome(&cohort(&path, ""));
    assert_eq!(status, Some(0), "{text_of_run}");
    // Age, mass and height of cid are unknown.
    for words in ["30.0 (1)", "60.5 (1)", "1.60 (1)"] {
        assert_eq!(text_of_run.matches(words).count(), 1, "{words}: {text_of_run}");
    }
    let [ann, bob, cid] = ["ann", "bob%3Db.", "cid"].map(|name| rows(&path, name));
    // Every column is described.
    let document = include_str!("../../../docs/cohort.md");
    let described = |column: &&String| document.contains(&format!("`{column}`"));
    let undescribed: Vec<_> = ann[0].keys().filter(|column| !described(column)).collect();
    assert!(undescribed.is_empty(), "{undescribed:?}");

    let mut file = csv::Reader::from_path(path.join("summary.csv")).expect("a summary");
    let lines: Vec<HashMap<String, String>> = file.deserialize().map(|line| line.expect("a line")).collect();
    assert_eq!(lines.len(), 2 * 8);
    let close = |found: &str, expected: f64| {
        let found: f64 = found.parse().expect("a number");
        assert!((found - expected).abs() <= 1e-9 * expected.abs(), "{found}, not {expected}");
    };
    let loads = ["measured_force_peak_n", "pressure_integral_kpa_s", "area_peak_mm2"];
    let columns = "measured_force_peak_n pressure_integral_kpa_s area_peak_mm2 force_at_70_percent_area_n area_at_100_n_mm2 secant_modulus_kpa dissipated_energy_mj a_mm b_mm c_mm d0_mm \
                   k_n_m3 n c_n_s_m3 m ab_mm2 stiffness_pa damping_pa_s nrmse_percent nrmse_smoothed_percent";
    for line in &lines {
        let participants: &[&Vec<Row>] = if line["insole_size"] == "35-36" { &[&ann] } else { &[&bob, &cid] };
        for column in columns.split_whitespace() {
            let means: Vec<f64> =
                participants.iter().filter_map(|rows| mean_of(rows, &line["region"], column)).collect();
            assert_eq!(line[&format!("{column}_participants")], means.len().to_string());
            // Every region has loads, but a region that was not fitted has no other values.
            let fitted: usize = line["participants"].parse().expect("a number");
            assert!(if loads.contains(&column) { means.len() == participants.len() } else { means.len() <= fitted });
            let [found, sd] = ["mean", "sd"].map(|kind| &line[&format!("{column}_{kind}")]);
            match means[..] {
                [] => assert!(found.is_empty() && sd.is_empty()),
                [one] => {
                    close(found, one);
                    assert!(sd.is_empty());
                }
                _ => {
                    close(found, mean(&means));
                    close(sd, (means[0] - means[1]).abs() / 2f64.sqrt());
                }
            }
        }
    }
    assert_eq!(lines[8]["insole_size"], "43-44");
    assert_eq!(lines[8]["participants"], "2");
}

#[test]
fn the_folder_of_a_participant_is_refused_as_output() {
    let (_folder, path) = people();
    let mut command = Command::new(env!("CARGO_BIN_EXE_plantar"));
    command.args(["cohort", "people", "--out", "people/ann"]).current_dir(&path);
    let (status, text) = outcome(&command.output().expect("the program starts"));
    assert!(status == Some(1) && text.contains("ann") && text.contains("choose another --out"), "{text}");
    // An output folder that is not in the folder of the study may contain a recording beside the table.
    fs::create_dir(path.join("table")).expect("made");
    walk(&path.join("table/all.parquet"), Side::Left, 9);
    assert_eq!(outcome(&cohort(&path, "")).0, Some(0));
}

#[test]
fn a_second_run_processes_only_changed_participants() {
    let (_folder, path) = people();
    assert_eq!(outcome(&cohort(&path, "")).0, Some(0));
    let complete_summary = summary(&path);
    let again = |options: &str, words: &[&str]| {
        let (status, text_of_run) = outcome(&cohort(&path, options));
        assert_eq!(status, Some(0), "{text_of_run}");
        assert!(words.iter().all(|word| text_of_run.contains(word)), "{text_of_run}");
    };
    again("", &["0 steps of 0 participants", "participants already up to date: 2"]);
    let ann = path.join("table/participant=ann/steps.parquet");
    let bob = path.join("table/participant=bob%3Db./steps.parquet");
    let written = |path: &Path| path.metadata().and_then(|file| file.modified()).expect("a time");
    let bob_written = written(&bob);
    // Sets up the state after a run that was interrupted while it wrote ann's file.
    fs::remove_file(&ann).expect("removed");
    fs::write(ann.with_file_name(".steps.parquet.part"), "PAR1").expect("written");
    again("", &["6 steps of 1 participant in ", "participants already up to date: 1"]);
    assert_eq!((summary(&path), written(&bob)), (complete_summary.clone(), bob_written));
    // A damaged file, another recording, another size and other options each cause the participant to be processed again.
    fs::write(&ann, "PAR1").expect("written");
    again("", &["6 steps of 1 participant in "]);
    assert_eq!(summary(&path), complete_summary);
    walk(&path.join("people/ann/d.parquet"), Side::Right, 7);
    again("", &["8 steps of 1 participant in "]);
    fs::write(path.join("people/ann/participant.toml"), "size = 37").expect("written");
    again("", &["8 steps of 1 participant in ", "37-38 (1)"]);
    again("--bounds paper --release 60", &["14 steps of 2 participants"]);
    again("--bounds paper", &["14 steps of 2 participants"]);
    // Invalid options change nothing.
    for (invalid, named) in [("--contact-on 5 --contact-off 6", "--contact-off"), ("--release 0", "--release")] {
        let (status, text_of_invalid) = outcome(&cohort(&path, invalid));
        assert_eq!((status, text_of_invalid.contains(named)), (Some(1), true), "{text_of_invalid}");
    }
    // A participant without a folder is no longer counted, but a note names the participant's file.
    fs::rename(path.join("people/ann"), path.join("ann")).expect("moved");
    again("--bounds paper", &["participants already up to date: 1", "participant=ann", "remove the file"]);
    assert!(!summary(&path).contains("37-38"));
}

#[test]
fn unusable_recordings_are_left_out_and_named_and_tried_again() {
    let (_folder, path) = people();
    let damaged = path.join("people/ann/b.parquet");
    let good = fs::read(&damaged).expect("a recording");
    fs::write(&damaged, &good[..good.len() / 2]).expect("written");
    let standing = recording::synthetic::standing(&recording::synthetic::SyntheticStanding::default());
    standing.write(path.join("people/ann/standing.parquet")).expect("written");
    fs::create_dir(path.join("people/nobody")).expect("made");
    for cached in ["participants already up to date: 0", "participants already up to date: 1"] {
        let (status, text_of_run) = outcome(&cohort(&path, ""));
        assert_eq!(status, Some(3), "{text_of_run}");
        for words in [
            "left out: people/ann/b.parquet",
            "people/ann/standing.parquet: no whole step",
            "nobody: 0 recordings",
            cached,
        ] {
            assert!(text_of_run.contains(words), "{words}: {text_of_run}");
        }
        assert_eq!((rows(&path, "ann").len(), rows(&path, "bob%3Db.").len()), (3 * 8, 6 * 8));
    }
    fs::write(&damaged, good).expect("written");
    fs::remove_file(path.join("people/ann/standing.parquet")).expect("removed");
    fs::remove_dir(path.join("people/nobody")).expect("removed");
    let (status, text_of_all) = outcome(&cohort(&path, ""));
    assert_eq!((status, rows(&path, "ann").len()), (Some(0), 6 * 8), "{text_of_all}");

    // If a participant's settings cannot be used, the participant's file in the table is removed.
    for (text, words) in [
        ("size = 36\nsise = 36", ["people/ann/participant.toml", "line 2", "sise"]),
        ("\nsize = 53", ["people/ann/participant.toml", "line 2", "53: a European shoe size is required"]),
        ("mass_kg = 7", ["people/ann/participant.toml", "mass_kg = 7", "10 to 300"]),
        ("height_cm = 1.7", ["people/ann/participant.toml", "height_cm = 1.7", "50 to 250"]),
        ("sex = 'f'", ["people/ann/participant.toml", "sex = \"f\"", "\"female\", \"male\" or \"other\""]),
        ("zero = 'nowhere.toml'", ["left out", "people/ann", "nowhere.toml"]),
        ("thickness = 'nowhere.toml'", ["left out", "people/ann", "nowhere.toml"]),
    ] {
        fs::write(path.join("people/ann/participant.toml"), text).expect("written");
        let (status, text_of_run) = outcome(&cohort(&path, ""));
        assert_eq!(status, Some(3), "{text_of_run}");
        assert!(words.iter().all(|word| text_of_run.contains(word)), "{words:?}: {text_of_run}");
        assert!(!path.join("table/participant=ann/steps.parquet").exists());
        assert!(!summary(&path).contains("35-36"));
    }
}

/// The name of an unfinished file contains the extension of the file: without it, the unfinished files of `steps` and
/// `steps.parquet` would have the same name. It also contains the number of the process.
#[test]
fn the_unfinished_file_of_another_table_or_process_remains() {
    let folder = tempfile::tempdir().expect("a folder");
    let process = std::process::id();
    let others = [format!(".steps.{process}.part"), ".steps.parquet.part".into(), ".steps.parquet.1.part".into()];
    let others = others.map(|name| folder.path().join(name));
    others.iter().for_each(|unfinished| fs::write(unfinished, "unfinished").expect("written"));
    let rows = [vec![("step", Value::Integer(Some(7)))]];
    table::write(&folder.path().join("steps.parquet"), None, &rows).expect("written");
    for unfinished in &others {
        assert_eq!(fs::read_to_string(unfinished).expect("the file remains"), "unfinished");
    }
    assert!(folder.path().join("steps.parquet").is_file());
}

#[test]
fn a_folder_with_the_parts_of_a_recording_is_one_recording() {
    let (_folder, path) = people();
    assert_eq!(outcome(&cohort(&path, "")).0, Some(0));
    let expected = rows(&path, "ann");
    let file = path.join("people/ann/a.parquet");
    let whole = Recording::read(&file).expect("a recording");
    fs::remove_file(&file).expect("removed");
    fs::create_dir(&file).expect("made");
    let middle = whole.frames() / 2;
    for (name, frames) in [("part-0.parquet", 0..middle), ("part-1.parquet", middle..whole.frames())] {
        let pressure_kpa = whole.pressure_kpa[frames.start * whole.cells()..frames.end * whole.cells()].to_vec();
        let part = Recording { t_s: whole.t_s[frames].to_vec(), pressure_kpa, ..whole.clone() };
        part.write(file.join(name)).expect("written");
    }
    let run = |words: &str| {
        let (status, text_of_run) = outcome(&cohort(&path, ""));
        assert!(status == Some(0) && text_of_run.contains(words), "{text_of_run}");
    };
    run("participants already up to date: 1");
    assert!(rows(&path, "ann") == expected);
    run("participants already up to date: 2");
    // A changed part causes a new evaluation.
    let part = File::options().write(true).open(file.join("part-1.parquet")).expect("a part");
    part.set_modified(SystemTime::UNIX_EPOCH).expect("changed");
    run("participants already up to date: 1");
}

/// macOS writes a hidden file with the prefix `._` beside some files.
#[test]
fn hidden_files_are_not_recordings() {
    let (_folder, path) = people();
    fs::write(path.join("people/ann/._a.parquet"), "attributes").expect("written");
    let (status, text_of_run) = outcome(&cohort(&path, ""));
    assert_eq!((status, rows(&path, "ann").len()), (Some(0), 6 * 8), "{text_of_run}");
}

#[test]
fn thickness_and_zero_file_of_a_participant_are_used() {
    let (_folder, path) = people();
    let ann = path.join("people/ann");
    fs::write(ann.join("participant.toml"), "thickness = 'measured/mm.toml'").expect("written");
    fs::create_dir(ann.join("measured")).expect("made");
    fs::write(ann.join("measured/mm.toml"), "heel = 18.5").expect("written");
    let (status, text_of_all) = outcome(&cohort(&path, "--size 39"));
    assert_eq!(status, Some(0), "{text_of_all}");
    assert!(
        text_of_all.contains("Participants without a size in participant.toml, counted as size 39: 1."),
        "{text_of_all}"
    );
    let rows = rows(&path, "ann");
    assert_eq!((number(&rows[0], "d0_mm"), number(&rows[0], "insole_size")), (18.5, 39.0));
    assert_eq!(rows[0]["mass_kg"], Field::Null);
    assert!((number(&rows[3], "d0_mm") - 12.0 * 39.0 / 42.0).abs() < 1e-9);

    fs::write(ann.join("participant.toml"), "zero = 'zero.toml'").expect("written");
    fs::write(ann.join("zero.toml"), "version = 1\n[left]\nlayout_id = x\n").expect("written");
    let (status, text_of_run) = outcome(&cohort(&path, ""));
    assert_eq!(status, Some(3), "{text_of_run}");
    assert!(text_of_run.contains("ann/zero.toml:3"), "{text_of_run}");
}

/// The measurements of the heel are close to a contradiction, so that single steps are on both sides of the limit; then they
/// clearly contradict each other.
#[test]
fn a_contradiction_of_measurements_is_decided_for_a_whole_recording_and_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let ann = path.join("people/ann");
    fs::create_dir_all(&ann).expect("made");
    synthetic::walk(&SyntheticWalk { steps: 12, ..Default::default() })
        .recording
        .write(ann.join("walk.parquet"))
        .expect("written");
    fs::write(ann.join("participant.toml"), "tissue = 'tissue.toml'").expect("written");
    let run = |radii: &str| {
        let tissue = format!("[heel]\nthickness_mm = 18\npeak_strain = 0.6\ncurvature_mm = {radii}\n");
        fs::write(ann.join("tissue.toml"), tissue).expect("written");
        let (status, text_of_run) = outcome(&cohort(path, "--report cohort.html"));
        let rows = rows(path, "ann");
        let heel = rows.iter().filter(|row| text(row, "region") == "heel");
        let sources: BTreeSet<String> = heel.map(|row| text(row, "c_by").into()).collect();
        (status, text_of_run, sources)
    };
    let (_, text_of_run, sources) = run("[59, 90]");
    assert_eq!(sources.len(), 1, "{sources:?}: {text_of_run}");
    let (status, text_of_run, sources) = run("[41, 62]");
    assert_eq!((status, sources), (Some(0), ["peak_strain".into()].into()), "{text_of_run}");
    // The second run reads the defects from the table.
    for _ in 0..2 {
        let (status, text_of_run, sources) = run("[400, 400]");
        assert_eq!((status, sources), (Some(3), ["assumed_compression".into()].into()), "{text_of_run}");
        let named = "incomplete: ann, walk.parquet, heel: measurements contradict each other";
        assert_eq!(text_of_run.matches(named).count(), 1, "{text_of_run}");
        let report = fs::read_to_string(path.join("cohort.html")).expect("a report");
        assert!(report.contains("ann, walk.parquet, heel: measurements contradict each other"));
    }
}

#[test]
fn errors_for_missing_participants_name_what_is_needed() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let fail = |words: &[&str]| {
        let (status, text_of_run) = outcome(&cohort(path, ""));
        assert_eq!(status, Some(1), "{text_of_run}");
        assert!(words.iter().all(|word| text_of_run.contains(word)), "{words:?}: {text_of_run}");
    };
    fail(&["people", "one folder per participant"]);
    fs::write(path.join("people"), "").expect("written");
    fail(&["people", "one folder per participant"]);
    fs::remove_file(path.join("people")).expect("removed");
    fs::create_dir(path.join("people")).expect("made");
    fail(&["people: no participant"]);
    fs::write(path.join("people/walk.parquet"), "").expect("written");
    fail(&["people: no participant"]);
    assert!(!path.join("table").exists());
    fs::create_dir(path.join("people/ann")).expect("made");
    fail(&["left out: people/ann", "people: no step of any participant"]);
    assert!(!path.join("summary.csv").exists());
}

#[test]
fn the_report_has_table_1_charts_and_repeatability() {
    let (_folder, path) = people();
    let (status, text_of_run) = outcome(&cohort(&path, "--report cohort.html"));
    assert_eq!(status, Some(0), "{text_of_run}");
    // Only ann has two recordings of the left foot, and only bob of the right foot, so there is no ICC.
    assert!(text_of_run.contains("Table 1") && !text_of_run.contains("ICC"), "{text_of_run}");
    walk(&path.join("people/ann/d.parquet"), Side::Right, 9);
    let (status, text_of_run) = outcome(&cohort(&path, "--report cohort.html"));
    assert_eq!(status, Some(0), "{text_of_run}");
    assert!(text_of_run.contains("Repeatability, right foot: 2 trials of 2 people"), "{text_of_run}");
    // Table 1 comes first, then the errors, the loads, the quantities, the parameters and the repeatability.
    let html = fs::read_to_string(path.join("cohort.html")).expect("a report");
    let words = [
        "id=\"people\"",
        "<th scope=\"row\">35–36</th><td>1</td><td>1/0</td><td>30.0</td><td>60.5</td><td>1.60</td>",
        "id=\"errors\"",
        "id=\"loads\"",
        "peak pressure, kPa",
        "id=\"quantities\"",
        "secant modulus at 20 % strain, kPa",
        "id=\"parameters\"",
        "d₀: thickness, mm",
        "id=\"repeatability\"",
        "ICC(2,1), right foot: 2 trials of 2 people",
    ];
    let positions = words.map(|words| html.find(words).unwrap_or_else(|| panic!("{words}")));
    assert!(positions.is_sorted(), "{positions:?}");
    for outside in ["http:", "https:", "<script", "src=", "@import", "url("] {
        assert!(!html.contains(outside), "{outside}");
    }
    assert_eq!(html.matches("<svg class=\"drawing\"").count(), html.matches("role=\"img\" aria-label=\"").count());
}

/// Files that may be recordings, but that the program does not read, are named; the exit status is 3.
#[test]
fn files_that_are_not_directly_in_a_participants_folder_are_left_out_and_named() {
    let (_folder, path) = people();
    let ann = path.join("people/ann");
    // A recording in parts, a hidden file, a folder of notes and tables of results are no reason for a report.
    fs::create_dir_all(ann.join("parts.parquet")).expect("made");
    fs::rename(ann.join("c.parquet"), ann.join("parts.parquet/0.parquet")).expect("moved");
    fs::create_dir_all(ann.join("notes")).expect("made");
    fs::write(ann.join("notes/plan.txt"), "walk").expect("written");
    fs::write(path.join("people/._a.parquet"), "hidden").expect("written");
    fs::create_dir_all(ann.join("results/participant=ann")).expect("made");
    fs::copy(ann.join("a.parquet"), ann.join("results/participant=ann/steps.parquet")).expect("copied");
    let (status, text) = outcome(&cohort(&path, ""));
    assert_eq!(status, Some(0), "{text}");

    fs::create_dir_all(ann.join("day2/shod")).expect("made");
    fs::copy(ann.join("a.parquet"), ann.join("day2/shod/a.parquet")).expect("copied");
    fs::copy(ann.join("a.parquet"), ann.join("day2/B.PARQUET")).expect("copied");
    fs::copy(ann.join("a.parquet"), ann.join("X.PARQUET")).expect("copied");
    fs::copy(ann.join("a.parquet"), path.join("people/lost.parquet")).expect("copied");
    // A recording in parts.
    fs::create_dir(path.join("people/parts.parquet")).expect("created");
    fs::copy(ann.join("a.parquet"), path.join("people/parts.parquet/0.parquet")).expect("copied");
    // Both runs find the participants up to date, and nevertheless name the files.
    for _ in 0..2 {
        let (status, text) = outcome(&cohort(&path, ""));
        assert_eq!(status, Some(3), "{text}");
        assert!(text.contains("participants already up to date: 2"), "{text}");
        let left_out: Vec<&str> = text.lines().filter(|line| line.starts_with("left out:")).collect();
        let expected = [
            ("people/lost.parquet", "not in the folder of a participant"),
            ("people/parts.parquet", "not in the folder of a participant"),
            ("people/ann/X.PARQUET", "in lower case"),
            ("people/ann/day2", "are not used (2)"),
        ];
        assert_eq!(left_out.len(), expected.len(), "{text}");
        for (line, (name, reason)) in left_out.iter().zip(expected) {
            assert!(line.contains(&format!("{name}: ")) && line.contains(reason), "{line}");
        }
    }
}

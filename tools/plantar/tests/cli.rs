//! Tests the files that the command line writes, and its messages about bad input.

use recording::Recording;
use recording::synthetic::{self, SyntheticStanding, SyntheticWalk};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

fn plantar(folder: &Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_plantar"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .output()
        .expect("the program starts")
}

fn succeed(folder: &Path, arguments: &str) -> String {
    let output = plantar(folder, arguments);
    assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// Asserts that a command fails with exit status 1 and a message that contains all of `words`. A panic has another exit status.
fn fail(folder: &Path, arguments: &str, words: &[&str]) {
    let output = plantar(folder, arguments);
    let text = String::from_utf8(output.stderr).expect("text");
    assert_eq!(output.status.code(), Some(1), "{arguments}: {text}");
    for word in words {
        assert!(text.contains(word), "{arguments}: no \"{word}\" in: {text}");
    }
}

/// A folder with a layout of four cells of 100 mm2, two in the heel and two in the hallux, and with frames in which the cells of
/// the heel are loaded for half a second.
fn folder() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().to_path_buf();
    let layout = "cell,x_mm,y_mm,area_mm2,region\n\
                  0,30,20,100,heel\n1,40,20,100,heel\n2,20,240,100,hallux\n3,30,240,100,hallux\n";
    std::fs::write(path.join("layout.csv"), layout).expect("written");
    let frames: String = (0..100)
        .map(|i| {
            let kpa = if (20..70).contains(&i) { 5000 } else { 0 };
            format!("{:.2},{kpa},{kpa},0,0\n", f64::from(i) * 0.01)
        })
        .collect();
    std::fs::write(path.join("frames.csv"), format!("t_s,c0,c1,c2,c3\n{frames}")).expect("written");
    (folder, path)
}

const IMPORT: &str = "import csv --layout layout.csv --frames frames.csv --side left --out walk.parquet";

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).expect("a file")).expect("JSON")
}

/// The recording has 5,000 kPa on 200 mm2 for 0.5 s, which is 1,000 N.
#[test]
fn a_csv_recording_becomes_a_step_with_its_force_area_and_ellipse() {
    let (_folder, path) = folder();
    succeed(&path, IMPORT);
    assert!(succeed(&path, "info walk.parquet").contains("100 at 100.00 Hz"));
    fail(&path, "replay walk.parquet --frames frames.csv/", &["frames.csv/", "name a file"]);
    succeed(&path, "replay walk.parquet --contact-full 0 --json steps.json --frames frames.parquet --picture step.svg");
    let steps = json(&path.join("steps.json"));
    assert_eq!(steps.as_array().map(Vec::len), Some(1));
    let step = &steps[0];
    assert_eq!((step["side"].as_str(), step["step"].as_u64()), (Some("left"), Some(0)));
    assert_eq!((step["start_s"].as_f64(), step["duration_s"].as_f64()), (Some(0.2), Some(0.5)));
    let heel = &step["regions"]["heel"];
    let close = |key: &str, expected: f64, tolerance: f64| {
        let value = heel[key].as_f64().expect(key);
        assert!((value - expected).abs() <= tolerance, "{key}: {value}, not {expected}");
    };
    close("measured_force_peak_n", 1000.0, 1.0);
    close("measured_force_integral_n_s", 500.0, 0.5);
    close("area_peak_mm2", 200.0, 0.0);
    close("contact_time_s", 0.5, 0.0);
    // Two adjacent squares of 10 mm have the variances 400/12 mm2 along x and 100/12 mm2 along y. A radius is 2 sqrt(variance).
    let ellipse = &heel["ellipse_at_peak"];
    assert_eq!((ellipse["x_mm"].as_f64(), ellipse["y_mm"].as_f64()), (Some(35.0), Some(20.0)));
    assert_eq!((ellipse["r_a_mm"].as_f64(), ellipse["r_b_mm"].as_f64()), (Some(11.55), Some(5.77)));
    assert_eq!(step["regions"]["hallux"]["area_peak_mm2"].as_f64(), Some(0.0));
    assert_eq!(step["contact_rule"]["rule"].as_str(), Some("counted"));
    assert!(std::fs::read_to_string(path.join("step.svg")).expect("a picture").contains("</svg>"));
}

/// From frame 20 on, the force rises by 5 N in each frame to 50 N, and falls in the same way to 0 in frame 69. The foot is
/// unloaded in the frames 40 to 45.
#[test]
fn the_options_of_the_stance_rule_determine_the_steps_of_a_recording() {
    let (_folder, path) = folder();
    let frames: String = (0..100)
        .map(|i: i32| {
            let force_n = if (40..46).contains(&i) { 0 } else { 5 * (i - 19).min(69 - i).clamp(0, 10) };
            // 5 kPa on the 200 mm2 of the heel are 1 N.
            let kpa = 5 * force_n;
            format!("{:.2},{kpa},{kpa},0,0\n", f64::from(i) * 0.01)
        })
        .collect();
    std::fs::write(path.join("frames.csv"), format!("t_s,c0,c1,c2,c3\n{frames}")).expect("written");
    succeed(&path, IMPORT);
    let steps = |options: &str| -> Vec<(f64, f64)> {
        succeed(&path, &format!("replay walk.parquet {options} --json steps.json"));
        let steps = json(&path.join("steps.json"));
        let seconds = |step: &Value, key: &str| step[key].as_f64().expect("a time");
        let steps = steps.as_array().expect("steps").iter();
        steps.map(|step| (seconds(step, "start_s"), seconds(step, "duration_s"))).collect()
    };
    // By the default rule, a contact below 70 N is no step.
    assert_eq!(steps(""), []);
    // The force reaches 12 N in frame 22 and falls below 8 N in frame 68.
    let absolute = "--thresholds absolute --strike 12 --release 8";
    let (first, second, bridged) = ((0.22, 0.18), (0.46, 0.22), (0.22, 0.46));
    assert_eq!(steps(absolute), [first, second]);
    assert_eq!(steps(&format!("{absolute} --min-stance 200")), [second]);
    assert_eq!(steps(&format!("{absolute} --max-stance 200")), [first]);
    assert_eq!(steps(&format!("{absolute} --min-swing 70")), [bridged]);
    // Adaptive thresholds follow the peaks: after a step with 50 N, that of toe off is 4.3 N instead of 8 N.
    assert_eq!(steps("--strike 12 --release 8"), [first, (0.46, 0.23)]);
    for option in ["--strike 0", "--release 1001", "--min-stance 2500", "--min-swing 0"] {
        fail(
            &path,
            &format!("replay walk.parquet {option}"),
            &["--strike, --release", "invalid stance rule", "above 0"],
        );
    }
}

#[test]
fn the_times_of_a_csv_file_may_be_uneven_if_its_frames_are_resampled() {
    let (_folder, path) = folder();
    let frames = std::fs::read_to_string(path.join("frames.csv")).expect("frames");
    std::fs::write(path.join("frames.csv"), frames.replacen("0.51,", "0.519,", 1)).expect("written");
    fail(&path, IMPORT, &["frames.csv:53", "--rate"]);
    fail(&path, &format!("{IMPORT} --rate 10"), &["--rate 10", "20 to 500"]);
    succeed(&path, &format!("{IMPORT} --rate 50"));
    assert!(succeed(&path, "info walk.parquet").contains("50 at 50.00 Hz"));
}

#[test]
fn single_and_double_precision_result_in_the_same_steps() {
    let (_folder, path) = folder();
    succeed(&path, "import synthetic --steps 3 --out walk.parquet");
    succeed(&path, "replay walk.parquet --json single.json");
    succeed(&path, "replay walk.parquet --precision f64 --json double.json");
    let (single, double) = (json(&path.join("single.json")), json(&path.join("double.json")));
    let peaks = |steps: &Value| -> Vec<f64> {
        let steps = steps.as_array().expect("steps").iter();
        steps.map(|s| s["regions"]["heel"]["model_force_peak_n"].as_f64().expect("a force")).collect()
    };
    assert_eq!((peaks(&single).len(), peaks(&double).len()), (3, 3));
    for (single, double) in peaks(&single).into_iter().zip(peaks(&double)) {
        assert!((single - double).abs() <= 0.1, "{single} {double}");
    }
}

#[test]
fn live_values_are_written_as_csv_with_a_column_per_quantity() {
    let (_folder, path) = folder();
    succeed(&path, IMPORT);
    succeed(&path, "replay walk.parquet --frames live.csv");
    let mut live = csv::Reader::from_path(path.join("live.csv")).expect("a table");
    let header = live.headers().expect("a header").clone();
    let column = |name: &str| header.iter().position(|h| h == name).expect(name);
    let rows: Vec<_> = live.records().map(|r| r.expect("a row")).collect();
    assert_eq!(rows.len(), 100);
    let loaded = &rows[40];
    let number = |name: &str| loaded[column(name)].parse::<f64>().expect(name);
    assert!((number("total_force_n") - 1000.0).abs() < 1.0);
    assert!((number("heel_cop_x_mm") - 35.0).abs() < 0.01);
    assert!((number("heel_ellipse_r_a_mm") - 11.547).abs() < 0.01);
    assert_eq!(&rows[5][column("heel_cop_x_mm")], "", "no centre of pressure without force");
    assert_eq!((number("contact_on_kpa"), number("heel_clamped"), number("t_s")), (10.0, 0.0, 0.4));
}

/// The fields of a CSV file, with its header.
fn fields(path: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(path).expect("a table");
    text.lines().map(|line| line.split(',').map(String::from).collect()).collect()
}

/// The values are those in the JSON of the steps, which has its own code.
#[test]
fn steps_are_written_as_a_table_with_a_row_for_each_region() {
    let (_folder, path) = folder();
    let mut walk = synthetic::walk(&SyntheticWalk { steps: 3, ..Default::default() }).recording;
    walk.t_s.iter_mut().for_each(|t_s| *t_s += 100.0);
    walk.write(path.join("walk.parquet")).expect("written");
    succeed(&path, "replay walk.parquet --steps table.csv --json steps.json");
    succeed(&path, "replay walk.parquet --steps table.parquet");
    let table = fields(&path.join("table.csv"));
    let column = |name: &str| table[0].iter().position(|column| column == name).expect(name);
    let number = |row: &[String], name: &str| row[column(name)].parse::<f64>().expect(name);
    let steps = json(&path.join("steps.json"));
    let steps = steps.as_array().expect("steps");
    assert_eq!((steps.len(), table.len()), (3, 1 + 3 * 8));
    for (i, row) in table[1..].iter().enumerate() {
        let (step, region) = (&steps[i / 8], &steps[i / 8]["regions"][&row[column("region")]]);
        assert!(row[column("side")] == "right" && number(row, "start_s") > 100.0, "{row:?}");
        for name in ["step", "start_s", "duration_s"] {
            assert_eq!(Some(number(row, name)), step[name].as_f64(), "{name}");
        }
        for name in ["measured_force_peak_n", "area_peak_mm2", "peak_pressure_kpa", "contact_time_s"] {
            assert_eq!(Some(number(row, name)), region[name].as_f64(), "{name}");
        }
    }
    // The Parquet table has the same columns and values.
    use parquet::file::reader::SerializedFileReader;
    use parquet::record::Field;
    let file = std::fs::File::open(path.join("table.parquet")).expect("a table");
    let rows = SerializedFileReader::new(file).expect("Parquet").into_iter().map(|row| row.expect("a row"));
    let rows: Vec<Vec<(String, String)>> = rows
        .map(|row| {
            let text = |field: Field| match field {
                Field::Null => String::new(),
                Field::Str(text) => text,
                Field::Int(number) => number.to_string(),
                Field::Double(number) => number.to_string(),
                Field::Bool(flag) => flag.to_string(),
                other => panic!("{other}"),
            };
            row.into_columns().into_iter().map(|(name, field)| (name, text(field))).collect()
        })
        .collect();
    let expected = table[1..].iter().map(|row| table[0].iter().cloned().zip(row.iter().cloned()).collect());
    assert_eq!(rows, expected.collect::<Vec<Vec<_>>>());
}

#[test]
fn a_table_of_steps_has_its_columns_without_steps_and_another_extension_is_refused() {
    let (_folder, path) = folder();
    let trial = synthetic::standing(&SyntheticStanding::default());
    trial.write(path.join("trial.parquet")).expect("written");
    succeed(&path, "replay trial.parquet --steps none.csv");
    succeed(&path, "replay trial.parquet --steps none.parquet");
    let table = fields(&path.join("none.csv"));
    assert!(table.len() == 1 && table[0].contains(&"measured_force_peak_n".to_string()), "{table:?}");
    fail(&path, "replay trial.parquet --steps steps.xlsx", &["steps.xlsx", ".csv or .parquet"]);
    // JSON in a file with the name of a table.
    for option in ["--json", "--bouts", "--load"] {
        for name in ["steps.csv", "steps.parquet"] {
            let output = plantar(&path, &format!("replay trial.parquet {option} {name}"));
            let text = String::from_utf8_lossy(&output.stderr);
            assert!(
                output.status.code() == Some(1) && text.contains(name) && text.contains("extension .json"),
                "{text}"
            );
            // Load bouts and alerts have no table.
            assert_eq!(text.contains("--steps writes a table"), option == "--json", "{text}");
            assert!(!path.join(name).exists());
        }
    }
}

/// A recording of a foot that is on the ground in its last frame, and one that is on the ground in its first frame.
#[test]
fn contacts_that_a_recording_cuts_off_are_named() {
    let (_folder, path) = folder();
    let walk = synthetic::walk(&SyntheticWalk { steps: 1, ..Default::default() }).recording;
    let cells = walk.cells();
    let first = (0..walk.frames()).find(|&frame| walk.force_n(frame) > 100.0).expect("a loaded frame");
    let middle = first + 30;
    let end = Recording {
        t_s: walk.t_s[..middle].to_vec(),
        pressure_kpa: walk.pressure_kpa[..middle * cells].to_vec(),
        ..walk.clone()
    };
    end.write(path.join("end.parquet")).expect("written");
    let start = Recording {
        t_s: walk.t_s[middle..].to_vec(),
        pressure_kpa: walk.pressure_kpa[middle * cells..].to_vec(),
        ..walk.clone()
    };
    start.write(path.join("start.parquet")).expect("written");
    walk.write(path.join("walk.parquet")).expect("written");
    let [missing_toe_off, missing_strike] = ["its toe off is missing", "its heel strike is missing"];
    for (name, reason) in [("end.parquet", missing_toe_off), ("start.parquet", missing_strike)] {
        let text = succeed(&path, &format!("replay {name}"));
        assert!(text.contains("no steps") && text.contains(&format!("left out: {name} at ")), "{text}");
        assert!(text.contains(reason), "{text}");
        let output = plantar(&path, &format!("gait {name}"));
        let text = [output.stdout, output.stderr].map(|text| String::from_utf8(text).expect("text")).concat();
        assert!(text.contains("no steps in") && text.contains(reason), "{text}");
    }
    assert!(!succeed(&path, "replay walk.parquet").contains("left out"));
}

/// More steps could exhaust the memory.
#[test]
fn a_synthetic_walk_has_at_least_one_step_and_not_too_many() {
    let (_folder, path) = folder();
    for steps in ["0", "10001"] {
        let option = format!("--steps {steps}");
        fail(&path, &format!("import synthetic {option} --out walk.parquet"), &[&option, "1 to 10000"]);
    }
    assert!(!path.join("walk.parquet").exists());
}

#[test]
fn errors_for_recordings_name_the_file_the_line_and_the_remedy() {
    let (_folder, path) = folder();
    let good = std::fs::read_to_string(path.join("frames.csv")).expect("frames");
    for (from, to, words) in [
        ("0.05,0,0,0,0", "0.05,0,0,0", ["frames.csv:7", "4 columns"]),
        ("0.05,0,0,0,0", "0.05,0,NaN,0,0", ["frames.csv:7", "NaN"]),
        ("0.05,0,0,0,0", "0.03,0,0,0,0", ["frames.csv:7", "backwards"]),
    ] {
        std::fs::write(path.join("frames.csv"), good.replacen(from, to, 1)).expect("written");
        fail(&path, IMPORT, &words);
    }
    std::fs::write(path.join("frames.csv"), good).expect("written");
    let good = std::fs::read_to_string(path.join("layout.csv")).expect("layout");
    for (from, to, words) in [
        ("0,30,20,100,heel", "0,30,20,100,knee", ["layout.csv:2", "knee"]),
        ("1,40,20,100,heel", "1,31,20,100,heel", ["layout.csv:3", "overlap"]),
        ("1,40,20,100,heel\n", "", ["layout.csv", "cell 1 is missing"]),
        ("1,40,20,100,heel", "1,40,20,0.01,heel", ["layout.csv: cell 1", "0.0625"]),
        ("1,40,20,100,heel", "1,40000,20,100,heel", ["layout.csv: cell 1", "within 10 m"]),
    ] {
        std::fs::write(path.join("layout.csv"), good.replacen(from, to, 1)).expect("written");
        fail(&path, IMPORT, &words);
    }
    fail(&path, "info nowhere.parquet", &["nowhere.parquet"]);
    fail(&path, "replay layout.csv", &["layout.csv"]);
    // The output is checked before the input is read, which does not exist either.
    fail(
        &path,
        "fit nowhere.parquet --out absent/parameters.toml",
        &["absent/parameters.toml", "does not exist", "check the path"],
    );
}

#[test]
fn files_of_another_kind_are_refused_with_the_kind_that_is_expected() {
    let (_folder, path) = folder();
    succeed(&path, IMPORT);
    std::fs::write(path.join("zero.toml"), "version = 1\n[left]\nlayout_id = 1\noffset_kpa = [0.0]\n")
        .expect("written");
    succeed(&path, "params typical --size 40 --out params.toml");
    fail(&path, "replay walk.parquet --zero params.toml", &["params.toml", "name a file that `plantar zero` wrote"]);
    fail(&path, "replay walk.parquet --params zero.toml", &["zero.toml", "expected a file of parameters (TOML)"]);
    std::fs::write(path.join("steps.json"), "[\n  {}\n]\n").expect("written");
    fail(&path, "replay walk.parquet --params steps.json", &["steps.json", "expected a file of parameters (TOML)"]);
}

#[test]
fn errors_for_parameters_name_the_file_the_region_and_the_remedy() {
    let (_folder, path) = folder();
    succeed(&path, IMPORT);
    succeed(&path, "params typical --size 40 --out params.toml");
    succeed(&path, "replay walk.parquet --params params.toml");
    let good = std::fs::read_to_string(path.join("params.toml")).expect("parameters");
    let a_of_heel = good.lines().find(|line| line.starts_with("a_mm")).expect("a radius").to_owned();
    let (before_hallux, hallux) = good.split_once("[regions.hallux]").expect("a hallux");
    let after_hallux = hallux.split_once("[regions.").map(|(_, rest)| format!("[regions.{rest}")).expect("toes");
    for (text, words) in [
        (good.replacen(&a_of_heel, "a_mm = -30.0", 1), ["regions.heel", "a length from 0.1 to 200 mm"]),
        (format!("{before_hallux}{after_hallux}"), ["hallux", "missing"]),
        (good.replacen("[regions.hallux]", "[regions.thumb]", 1), ["thumb", "hallux"]),
        (good.replacen(&a_of_heel, "a_mm = wide", 1), ["params.toml", "a_mm"]),
        (good.replacen("version = 1", "version = 9\nnew_in_9 = true", 1), ["version 9", "update"]),
        (good.replacen("k_n_m3 = ", "k_n_m3 = 1e300 # ", 1), ["heel", "more than 1e9"]),
    ] {
        std::fs::write(path.join("params.toml"), text).expect("written");
        fail(&path, "replay walk.parquet --params params.toml", &words);
    }
}

#[test]
fn no_command_overwrites_its_input_or_personal_parameters() {
    let (_folder, path) = folder();
    succeed(&path, IMPORT);
    let walk = std::fs::read(path.join("walk.parquet")).expect("a recording");
    let other_spelling = format!("../{}/walk.parquet", path.file_name().expect("a name").display());
    for command in [
        "replay walk.parquet --json",
        "gait walk.parquet --json",
        "export csv walk.parquet --out",
        "fit walk.parquet --out",
        "fit walk.parquet --report",
        "repeat walk.parquet --json",
        "emulate walk.parquet --json",
    ] {
        fail(&path, &format!("{command} {other_spelling}"), &[&other_spelling, "name another file"]);
    }
    assert!(std::fs::read(path.join("walk.parquet")).expect("a recording") == walk);
    std::fs::create_dir_all(path.join("people/ann")).expect("made");
    std::fs::write(path.join("people/ann/walk.parquet"), &walk).expect("written");
    std::fs::write(path.join("people/ann/participant.toml"), "zero = '../../zero.txt'").expect("written");
    for command in [
        "replay walk.parquet --params p.toml --json ./p.toml",
        "export csv walk.parquet --zero z.toml --out z.toml",
        "fit walk.parquet --tissue t.toml --out t.toml",
        "fit walk.parquet --json a.json --report ./a.json",
        "repeat people --csv people/ann/walk.parquet",
        "repeat people --csv zero.txt",
        "cohort people --out table --summary people/ann/walk.parquet",
        "cohort people --out table --summary zero.txt",
        "emulate walk.parquet --identify . --json cells.parquet",
    ] {
        fail(&path, command, &["name another file"]);
    }
    assert!(std::fs::read(path.join("people/ann/walk.parquet")).expect("a recording") == walk);
    // The input is a folder: a part of a recording is not overwritten, and no other Parquet file is added to the parts.
    std::fs::create_dir(path.join("parts")).expect("made");
    std::fs::write(path.join("parts/part-00000.parquet"), &walk).expect("written");
    for name in ["part-00000.parquet", "part-00001.parquet"] {
        for command in ["replay parts --frames parts/", "replay ./parts --json parts/../parts/"] {
            fail(&path, &format!("{command}{name}"), &[name, "name another file"]);
        }
    }
    assert!(std::fs::read(path.join("parts/part-00000.parquet")).expect("a part") == walk);
    // Files of other kinds may be written there, and Parquet files in another folder, and both can be written a second time.
    for _ in 0..2 {
        succeed(&path, "replay parts --json parts/steps.json --frames parts/live.csv");
        std::fs::create_dir_all(path.join("parts/out")).expect("made");
        succeed(&path, "replay parts --frames parts/out/live.parquet");
    }
    for command in [IMPORT.replace("frames.csv", "walk.parquet"), "zero walk.parquet --out walk.parquet".into()] {
        fail(&path, &command, &["name another file"]);
    }
    succeed(&path, "params typical --out params.toml");
    succeed(&path, "params typical --size 40 --out params.toml");
    let text = std::fs::read_to_string(path.join("params.toml")).expect("parameters");
    std::fs::write(path.join("params.toml"), text.replace("personal = false", "personal = true")).expect("written");
    fail(&path, "params typical --out params.toml", &["params.toml", "--out"]);
    fail(&path, "params pull --out params.toml --tcp 127.0.0.1:1", &["params.toml", "--out"]);
}

#[test]
fn errors_for_too_many_cells_and_missing_programs_name_the_remedy() {
    let (_folder, path) = folder();
    let cells: String = (0..400).map(|i| format!("{i},{},{},9\n", i % 20 * 4, i / 20 * 12)).collect();
    std::fs::write(path.join("layout.csv"), format!("cell,x_mm,y_mm,area_mm2\n{cells}")).expect("written");
    let header: String = (0..400).map(|i| format!(",c{i}")).collect();
    let frames: String = (0..30).map(|i| format!("{:.2}{}\n", f64::from(i) * 0.01, ",20".repeat(400))).collect();
    std::fs::write(path.join("frames.csv"), format!("t_s{header}\n{frames}")).expect("written");
    succeed(&path, IMPORT);
    fail(&path, "emulate walk.parquet", &["400 cells", "--cells 256"]);
    succeed(&path, &format!("{IMPORT} --cells 256"));
    fail(&path, "emulate walk.parquet --firmware nowhere", &["nowhere", "cargo xtask build"]);
    fail(&path, "emulate walk.parquet --fault open-cell:300", &["no cell 300", "walk.parquet has cells 0 to"]);
    fail(&path, "monitor --tcp 127.0.0.1:1", &["127.0.0.1:1"]);
    fail(&path, "monitor --tcp 127.0.0.1:1 --json a.json --alerts ./a.json", &["a.json", "name another file"]);
    fail(&path, "monitor --serial /dev/nowhere", &["/dev/nowhere"]);
    // Options of an emulated insole are not silently ignored for a connected one.
    for option in ["--size 41", "--params p.toml", "--contact-on 20", "--strike 20", "--zero z.toml"] {
        fail(&path, &format!("serve --tcp 127.0.0.1:1 {option}"), &["are for --emulate", "plantar insole"]);
    }
}

#[test]
fn the_name_of_a_file_in_an_error_does_not_control_a_terminal() {
    let (_folder, path) = folder();
    fail(&path, "info a\u{1b}[2J\u{7}.parquet", &["a [2J .parquet", "check the path"]);
}

/// An option that cannot be used is refused before the person is asked to walk.
#[test]
fn a_session_is_refused_before_it_connects_if_its_options_cannot_be_used() {
    let (_folder, path) = folder();
    for (option, words) in [
        ("--filter smoothed", ["smoothing", "--filter direct"]),
        ("--filter live", ["live frames", "--filter direct"]),
        ("--method paper", ["smoothing", "--filter direct"]),
        ("--compression 5", ["compression of 5", "0.05 to 0.95"]),
        ("--tissue nowhere.toml", ["cannot read nowhere.toml", "check the path"]),
    ] {
        fail(&path, &format!("identify --tcp 127.0.0.1:1 --out session {option}"), &words);
    }
}

#[cfg(unix)]
#[test]
fn a_folder_without_permission_to_write_is_refused_before_the_connection() {
    use std::os::unix::fs::PermissionsExt;

    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("session");
    std::fs::create_dir(&out).expect("created");
    std::fs::set_permissions(&out, PermissionsExt::from_mode(0o500)).expect("changed");
    if std::fs::create_dir(out.join("root")).is_ok() {
        eprintln!("note: not tested, because permissions do not restrict root");
    } else {
        fail(folder.path(), "record --tcp 127.0.0.1:9 --out session", &["cannot write to session", "permissions"]);
    }
}

/// The heel carries 1,000 N on 200 mm2. The typical parameters were determined from barefoot steps that load more than 2,000
/// mm2 of the heel.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn replay_and_emulate_note_that_typical_parameters_are_not_applicable() {
    let firmware = std::env::var("PLANTAR_FIRMWARE").expect("PLANTAR_FIRMWARE names the emulated board's firmware");
    let (_folder, path) = folder();
    succeed(&path, IMPORT);
    let emulate = format!("emulate walk.parquet --speed max --firmware {firmware}");
    for command in ["replay walk.parquet", &emulate] {
        let output = plantar(&path, command);
        let text = String::from_utf8(output.stderr).expect("text");
        assert!(
            output.status.success() && text.contains("NOT APPLICABLE to heel (200 mm2, 5000 kPa)"),
            "{command}: {text}"
        );
    }
}

/// An offset for each of 240 cells, kPa, all different.
fn offsets() -> Vec<f32> {
    (0..240).map(|i| 20.0 * ((i * 37) % 240) as f32 / 240.0).collect()
}

/// Writes a standing trial in which this foot carries the force `standing_n`, measured by cells with [`offsets`].
fn write_trial(path: &Path, side: plantar::Side, standing_n: f64) -> Recording {
    let mut trial = synthetic::standing(&SyntheticStanding { side, standing_n, ..Default::default() });
    synthetic::add_sensor_errors(&mut trial, &offsets(), 8.0, 7);
    trial.write(path).expect("written");
    trial
}

/// This foot carries 400 N for ten seconds, with a transition of one second before and after.
#[test]
fn standing_is_a_load_bout_with_its_force_time_integral() {
    let (_folder, path) = folder();
    let trial = synthetic::standing(&SyntheticStanding { standing_n: 400.0, ..Default::default() });
    trial.write(path.join("trial.parquet")).expect("written");
    let text = succeed(&path, "replay trial.parquet --bouts bouts.json");
    for expected in
        ["no steps\n", "contacts that are no steps: ", "1 longer than a step (", "--max-stance 2500)\n", "standing"]
    {
        assert!(text.contains(expected), "{text}");
    }
    let bouts: serde_json::Value =
        serde_json::from_slice(&std::fs::read(path.join("bouts.json")).expect("written")).expect("JSON");
    let bouts = bouts.as_array().expect("an array");
    let integral_n_s = |bout: &serde_json::Value| -> f64 {
        let regions = bout["regions"].as_object().expect("regions").values();
        regions.map(|region| region["measured_force_integral_n_s"].as_f64().expect("a number")).sum()
    };
    let true_n_s = (0..trial.frames()).map(|i| trial.force_n(i)).sum::<f64>() / trial.rate_hz;
    let sum_n_s: f64 = bouts.iter().map(integral_n_s).sum();
    assert!((sum_n_s - true_n_s).abs() < 0.01 * true_n_s, "{sum_n_s} for {true_n_s} N s");
    let standing: Vec<_> = bouts.iter().filter(|bout| bout["kind"] == "standing").collect();
    assert!(standing.len() == 1 && integral_n_s(standing[0]) > 0.95 * true_n_s, "{bouts:?}");
}

/// At 75 Hz, the insole's period in whole microseconds is 25 ppm too short: 1.5 ms in this minute.
#[test]
fn starts_of_records_are_on_the_clock_of_the_recording() {
    let (_folder, path) = folder();
    let walk = synthetic::walk(&SyntheticWalk { steps: 60, ..Default::default() }).recording;
    let mut walk = walk.at_rate(75.0).expect("a walk");
    walk.t_s.iter_mut().for_each(|t_s| *t_s += 10.0);
    walk.write(path.join("walk.parquet")).expect("written");
    succeed(&path, "replay walk.parquet --json steps.json --bouts bouts.json");
    let steps = json(&path.join("steps.json"));
    assert_eq!(steps.as_array().map(Vec::len), Some(60));
    for step in steps.as_array().into_iter().flatten() {
        let start_s = step["start_s"].as_f64().expect("a time");
        let frame = ((start_s - 10.0) * 75.0).round() as usize;
        assert!((walk.t_s[frame] - start_s).abs() < 1e-6, "{start_s} s");
        assert!(walk.force_n(frame) > walk.force_n(frame - 1), "heel strike at {start_s} s");
    }
    let bouts = json(&path.join("bouts.json"));
    assert!(bouts[0]["start_s"].as_f64() >= Some(10.0), "{bouts}");
}

#[test]
fn the_last_load_bout_ends_with_the_recording() {
    let (_folder, path) = folder();
    let mut trial = synthetic::standing(&SyntheticStanding::default());
    // The foot stands from 6 s on.
    trial.t_s.truncate(1200);
    trial.pressure_kpa.truncate(1200 * trial.cells());
    trial.write(path.join("trial.parquet")).expect("written");
    succeed(&path, "replay trial.parquet --bouts bouts.json");
    let bouts = json(&path.join("bouts.json"));
    let last = bouts.as_array().and_then(|bouts| bouts.last()).expect("a bout");
    let end_s = last["start_s"].as_f64().expect("a time") + last["duration_s"].as_f64().expect("a time");
    assert!(last["kind"] == "standing" && (end_s - 12.0).abs() < 1e-6, "{last}");
}

/// Toe off is confirmed after 50 ms, or by the end of the recording.
#[test]
fn a_recording_that_ends_right_after_toe_off_has_its_last_step() {
    let (_folder, path) = folder();
    let mut walk = synthetic::walk(&SyntheticWalk { steps: 1, ..Default::default() }).recording;
    walk.write(path.join("whole.parquet")).expect("written");
    succeed(&path, "replay whole.parquet --json whole.json");
    let whole = json(&path.join("whole.json"));
    let toe_off_s = whole[0]["start_s"].as_f64().expect("a time") + whole[0]["duration_s"].as_f64().expect("a time");
    let frames = (toe_off_s * walk.rate_hz).round() as usize + 1;
    walk.t_s.truncate(frames);
    walk.pressure_kpa.truncate(frames * walk.cells());
    walk.write(path.join("cut.parquet")).expect("written");
    succeed(&path, "replay cut.parquet --json cut.json --picture step.svg");
    assert_eq!(json(&path.join("cut.json")), whole);
    assert!(path.join("step.svg").exists());
}

/// The weight of 70 kg is 686.5 N, of which the left foot carries 420 N (61.2 %) and the right foot 266.5 N (38.8 %).
#[test]
fn a_standing_trial_results_in_a_zero_file_and_a_check_of_the_weight() {
    use plantar::Side::{Left, Right};
    let (_folder, path) = folder();
    write_trial(&path.join("left.parquet"), Left, 420.0);
    write_trial(&path.join("right.parquet"), Right, 266.5);
    let text = succeed(&path, "zero left.parquet right.parquet --out zero.toml --mass 70");
    // All numbers that the text has between `before` and `after`.
    let number = |before: &str, after: &str| -> Vec<f64> {
        let parts = text.match_indices(after).map(|(end, _)| &text[..end]);
        parts.map(|s| s.rsplit_once(before).expect(before).1.parse().expect("a number")).collect()
    };
    let shares = number(", ", " % of body weight");
    for (share, truth) in shares.iter().zip([61.2, 38.8, 100.0]) {
        assert!((share - truth).abs() < 1.0, "{text}");
    }
    assert!(shares.len() == 3 && text.contains("weight: good"), "{text}");
    assert!(text.contains("left foot, left.parquet") && text.contains("drift of +0.0 N, +0.0 % of standing"), "{text}");
    let zero = std::fs::read_to_string(path.join("zero.toml")).expect("a zero file");
    assert!(zero.contains("[left]") && zero.contains("[right]"));

    let text = succeed(&path, "zero left.parquet right.parquet --out zero.toml --mass 90");
    assert!(text.contains("NOT good") && text.contains("more than 10 %") && text.contains("calibrate"), "{text}");
    let text = succeed(&path, "zero right.parquet --out right.toml --mass 70");
    assert!(text.contains("% of body weight") && !text.contains("good") && !text.contains("both"), "{text}");
    let text = succeed(&path, "zero left.parquet right.parquet --out zero.toml");
    assert!(text.contains("--mass") && !text.contains("% of body"), "{text}");

    fail(&path, "zero left.parquet left.parquet --out twice.toml", &["left.parquet", "left foot", "two recordings"]);
    fail(&path, "zero left.parquet --out zero.toml --mass 0", &["--mass 0", "kg"]);
    succeed(&path, "import synthetic --out walk.parquet");
    fail(&path, "zero walk.parquet --out walk.toml", &["walk.parquet", "standing still", "sit and lift both feet"]);
    assert!(!path.join("twice.toml").exists() && !path.join("walk.toml").exists());
}

#[test]
fn a_replay_with_the_zero_file_results_in_the_steps_of_cells_without_offsets() {
    let (_folder, path) = folder();
    write_trial(&path.join("standing.parquet"), plantar::Side::Right, 350.0);
    let mut walk = synthetic::walk(&SyntheticWalk { steps: 3, ..Default::default() }).recording;
    walk.write(path.join("ideal.parquet")).expect("written");
    synthetic::add_sensor_errors(&mut walk, &offsets(), 0.0, 1);
    walk.write(path.join("walk.parquet")).expect("written");
    succeed(&path, "zero standing.parquet --out zero.toml");
    succeed(&path, "replay ideal.parquet --json ideal.json");
    succeed(&path, "replay walk.parquet --zero zero.toml --json zeroed.json --picture step.svg");
    let (ideal, zeroed) = (json(&path.join("ideal.json")), json(&path.join("zeroed.json")));
    let steps = |of: &Value| of.as_array().expect("steps").clone();
    assert_eq!((steps(&ideal).len(), steps(&zeroed).len()), (3, 3));
    for (ideal, zeroed) in steps(&ideal).iter().zip(steps(&zeroed)) {
        for key in ["start_s", "duration_s"] {
            assert_eq!(ideal[key], zeroed[key]);
        }
        for (region, ideal) in ideal["regions"].as_object().expect("regions") {
            let zeroed = &zeroed["regions"][region];
            // The resolution of the protocol is 0.1 N and 1 mm2.
            for (key, tolerance) in [("measured_force_peak_n", 0.1), ("area_peak_mm2", 1.0)] {
                let [ideal, zeroed] = [ideal, zeroed].map(|of| of[key].as_f64().expect(key));
                assert!((ideal - zeroed).abs() <= 1.001 * tolerance, "{region} {key}: {zeroed}, not {ideal}");
            }
        }
    }
}

#[test]
fn a_zero_file_of_another_layout_is_refused() {
    let (_folder, path) = folder();
    write_trial(&path.join("standing.parquet"), plantar::Side::Left, 350.0);
    succeed(&path, "zero standing.parquet --out zero.toml");
    succeed(&path, "import synthetic --side right --out walk.parquet");
    for command in ["replay", "emulate"] {
        fail(&path, &format!("{command} walk.parquet --zero zero.toml"), &["zero.toml", "no zero of the right foot"]);
    }
    succeed(&path, IMPORT);
    fail(&path, "replay walk.parquet --zero zero.toml", &["zero.toml", "240 offsets", "the 4 cells of this recording"]);
    fail(&path, "replay walk.parquet --zero nowhere.toml", &["nowhere.toml"]);
    std::fs::write(path.join("zero.toml"), "version = 1\n[left]\nlayout_id = x\n").expect("written");
    fail(&path, "replay walk.parquet --zero zero.toml", &["zero.toml:3", "plantar zero"]);
}

#[test]
fn the_version_has_the_commit() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = succeed(folder.path(), "--version");
    let version = text.trim().strip_prefix("plantar ").expect("the name of the program");
    let commit = version.strip_prefix(env!("CARGO_PKG_VERSION")).expect("the version of the package");
    // A build of sources that are not a git checkout has no commit.
    let is_commit = |commit: &str| commit.len() >= 7 && commit.bytes().all(|b| b.is_ascii_hexdigit());
    assert!(commit.is_empty() || commit.strip_prefix('+').is_some_and(is_commit), "{version}");
}

#[test]
fn an_export_of_both_feet_is_recognised_and_becomes_a_pair_on_one_clock() {
    let (_folder, path) = folder();
    // A seed of the fuzz target `vendor`: an export of a computed step. Its first byte selects the format, and is no part of
    // the export.
    let seed =
        std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/vendor/xsensor")).expect("a seed");
    std::fs::write(path.join("walk.dat"), &seed[1..]).expect("written");
    for (command, name) in [("auto", "a"), ("xsensor", "b")] {
        let text = succeed(&path, &format!("import {command} walk.dat --out {name}.parquet"));
        assert!(text.contains("differs from the vendor's"), "{text}");
        let [left, right] =
            ["left", "right"].map(|foot| Recording::read(path.join(format!("{name}.{foot}.parquet"))).expect("a foot"));
        assert_eq!((left.side, right.side), (plantar::Side::Left, plantar::Side::Right));
        assert_eq!(left.t_s, right.t_s);
    }
    succeed(&path, "import auto walk.dat --side left --out one.parquet");
    succeed(&path, "info one.parquet");
    fail(
        &path,
        "import auto walk.dat walk.dat --out c.parquet",
        &["same foot more than once", "its own --out", "--side"],
    );
    std::fs::create_dir(path.join("walks")).expect("made");
    for out in ["walks", "walks/", "absent/"] {
        fail(&path, &format!("import auto walk.dat --out {out}"), &[out, "name a file"]);
    }
    fail(&path, "import auto walk.dat --side left --out absent/", &["absent/", "name a file"]);
    assert!(std::fs::read_dir(path.join("walks")).expect("a folder").next().is_none());
    fail(&path, "import tekscan walk.dat --out c.parquet", &["walk.dat", "ASCII_DATA"]);
    fail(&path, "import auto frames.csv --out c.parquet", &["frames.csv", "import csv"]);
    std::fs::write(path.join("empty.txt"), "").expect("written");
    fail(&path, "import auto empty.txt --out c.parquet", &["empty.txt", "empty"]);
}

#[cfg(unix)]
#[test]
fn a_closed_output_ends_a_command_without_a_message() {
    let (_folder, path) = folder();
    succeed(&path, "import synthetic --steps 1 --out walk.parquet");
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let mut command = Command::new(env!("CARGO_BIN_EXE_plantar"));
    let output = command.args(["info", "walk.parquet"]).current_dir(&path).stdout(writer).output().expect("it starts");
    assert_eq!((output.status.code(), String::from_utf8_lossy(&output.stderr).as_ref()), (Some(141), ""));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_device_as_output_is_an_error() {
    let (_folder, path) = folder();
    succeed(&path, "import synthetic --steps 1 --out walk.parquet");
    let full = std::fs::File::options().write(true).open("/dev/full").expect("Linux has this device");
    let mut command = Command::new(env!("CARGO_BIN_EXE_plantar"));
    let output = command.args(["info", "walk.parquet"]).current_dir(&path).stdout(full).output().expect("it starts");
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("error: the output cannot be written: No space left"), "{text}");
}

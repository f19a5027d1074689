//! The import of computed files in the format of Tekscan.

mod common;

use common::{COLUMNS, ROWS, STANCE, SWING, assert_message, assert_step, pressure_kpa};
use plantar::Side;
use recording::{Export, Format, MAX_CELLS, Result};

/// Area of a cell, mm2: a square with a side of 0.4 inches, 10.16 mm.
const CELL_MM2: f64 = 10.16 * 10.16;

/// A file of one step in this unit, with this spacing of rows and columns. A pressure of 1 kPa is `per_kpa` units.
fn text(side: Side, unit: &str, per_kpa: f64, spacing: &str) -> String {
    let mut text = format!(
        "DATA_TYPE MOVIE\r\nFILENAME C:\\walks\\step{}.fsx\r\nSENSOR_TYPE F-SCAN\r\nROWS {ROWS}\r\nCOLS {COLUMNS}\r\n\
         ROW_SPACING {spacing}\r\nCOL_SPACING {spacing}\r\nSECONDS_PER_FRAME 0.01\r\n\
         CALIBRATION_POINT_1 50.0 (Kgs) 5000 (Raw Sum) 99 (Number of Loaded Cells)\r\nUNITS {unit}\r\nASCII_DATA @@\r\n",
        if side == Side::Left { "L" } else { "R" }
    );
    for frame in 0..STANCE + SWING {
        text += &format!("\r\nFrame {}\r\n", frame + 1);
        for row in 0..ROWS {
            let field = |column: usize| match (row, column) {
                // `B` stands for a cell outside of the sensor.
                (0, 0) => "B".to_owned(),
                _ => format!("{:.3}", pressure_kpa(side, frame, row, column) * per_kpa),
            };
            text += &(0..COLUMNS).map(field).collect::<Vec<_>>().join(",");
            text += "\r\n";
        }
    }
    text + "@@\r\n"
}

fn parse(text: &str) -> Result<Export> {
    common::parse(Format::Tekscan, "walk.asf", text.as_bytes(), None)
}

#[test]
fn exports_in_different_units_result_in_the_same_step() {
    for side in [Side::Left, Side::Right] {
        for (unit, per_kpa, spacing) in [
            ("KPa", 1.0, "10.16 mm"),
            ("PSI", 0.145_037_7, "1.016 centimeters"),
            ("kg/cm2", 0.010_197_16, "0.4 inches"),
        ] {
            let export = parse(&text(side, unit, per_kpa, spacing)).unwrap();
            let [foot] = &export.feet[..] else { panic!("one foot") };
            assert_step(foot, side, CELL_MM2, 3e-3);
            assert!((foot.rate_hz - 100.0).abs() < 1e-6);
        }
    }
}

/// Loaded cells of a single column in front of the toes do not extend the foot, but count in the region of the toes.
#[test]
fn load_in_front_of_the_foot_is_named() {
    let clean = text(Side::Right, "KPa", 1.0, "10.16 mm");
    let ghost = |kpa: &str| format!("{}{kpa}{}\r\n", "0,".repeat(3), ",0".repeat(COLUMNS - 4)).repeat(4);
    let mut with_ghosts = clean.replace(&format!("ROWS {ROWS}\r\n"), &format!("ROWS {}\r\n", ROWS + 4));
    for frame in 1..=STANCE + SWING {
        let (title, kpa) =
            (format!("\r\nFrame {frame}\r\n"), if frame > STANCE / 2 && frame <= STANCE { "90" } else { "0" });
        with_ghosts = with_ghosts.replace(&title, &format!("{title}{}", ghost(kpa)));
    }
    let remark = |text: &str| {
        let export = parse(text).unwrap();
        let remark = export.remarks.into_iter().find(|remark| remark.contains("in front of it"));
        assert_eq!(export.feet[0].source.contains("in front of it"), remark.is_some(), "{}", export.feet[0].source);
        remark
    };
    assert_eq!(remark(&clean), None);
    let remark = remark(&with_ghosts).expect("a remark");
    assert!(remark.starts_with("Right foot: loaded cells") && remark.contains("of the sensor: 4."), "{remark}");
    assert!(remark.contains("mask them"), "{remark}");
}

/// 70 rows of 70 loaded cells, in ten frames, are more cells than a recording may have.
#[test]
fn the_merge_of_many_cells_is_stated_once() {
    let step = text(Side::Right, "KPa", 1.0, "3 mm");
    let (header, _) = step.split_once("\r\nFrame 1\r\n").expect("a frame");
    let header = header.replace(&format!("ROWS {ROWS}"), "ROWS 70").replace(&format!("COLS {COLUMNS}"), "COLS 70");
    let table = format!("{}\r\n", ["20"; 70].join(",")).repeat(70);
    let frames: String = (1..=10).map(|frame| format!("\r\nFrame {frame}\r\n{table}")).collect();
    let export = parse(&format!("{header}{frames}@@\r\n")).unwrap();
    let foot = &export.feet[0];
    assert!(foot.cells() <= MAX_CELLS && (foot.force_n(0) - 20.0 * 0.21 * 0.21 * 1e3).abs() < 0.1);
    assert_eq!(foot.source.matches("4900 cells").count(), 1, "{}", foot.source);
    let states = |remark: &String| remark.starts_with("Right foot: Merged 4900 cells into ");
    assert!(export.remarks.iter().any(states), "{:?}", export.remarks);
}

/// The exports of both feet of a measurement can begin with different frames.
#[test]
fn times_follow_from_the_numbers_of_the_frames() {
    let from_1 = text(Side::Right, "KPa", 1.0, "10.16 mm");
    let title = |number: usize| format!("\r\nFrame {number}\r\n");
    let renumber = |text: String, number| text.replace(&title(number), &title(number - 1));
    let from_0 = (1..=STANCE + SWING).fold(from_1.clone(), renumber);
    for (whole, first) in [(from_1, 1), (from_0, 0)] {
        let (header, frames) = whole.split_once(&title(first)).unwrap();
        let part = format!("{header}{}{}", title(11), frames.split_once(&title(11)).unwrap().1);
        for (text, number) in [(&whole, first), (&part, 11)] {
            let t_s = parse(text).unwrap().feet.remove(0).t_s[0];
            assert!((t_s - number as f64 * 0.01).abs() < 1e-9, "frame {number}: {t_s} s");
        }
    }
}

/// A program that stores the export as a table writes quotes around names and values.
#[test]
fn names_and_values_of_the_header_may_have_quotes() {
    let plain = text(Side::Right, "KPa", 1.0, "10.16 mm");
    let (header, frames) = plain.split_once("ASCII_DATA @@\r\n").unwrap();
    let quoted = header.lines().map(|line| format!("\"{}\"\r\n", line.replacen(' ', "\",\"", 1)));
    let quoted = format!("{}\"ASCII_DATA\",\"@@\"\r\n{frames}", quoted.collect::<String>());
    assert!(quoted.contains("\"ROWS\",\"30\""));
    assert_eq!(parse(&quoted).unwrap().feet, parse(&plain).unwrap().feet);
}

#[test]
fn the_type_of_the_sensor_is_short_and_printable_in_the_name_of_the_layout() {
    let text = text(Side::Right, "KPa", 1.0, "10.16 mm");
    let name = |sensor: &str| parse(&text.replacen("F-SCAN", sensor, 1)).unwrap().feet.remove(0).layout.name;
    assert_eq!(name("F-SCAN"), "Tekscan F-SCAN, 30 x 11 cells");
    let shown = format!("Tekscan F-SCAN [2J{}..., 30 x 11 cells", "x".repeat(50));
    assert_eq!(name(&format!("F-SCAN\u{1b}[2J{}", "x".repeat(100))), shown);
}

#[test]
fn an_export_that_ends_before_its_last_frame_is_imported_with_a_remark() {
    let whole = text(Side::Right, "KPa", 1.0, "10.16 mm");
    let last = STANCE + SWING;
    for (stated, has_remark) in [(last, false), (last + 1, true)] {
        let export = parse(&whole.replace("UNITS", &format!("END_FRAME {stated}\r\nUNITS"))).unwrap();
        assert_eq!(export.remarks.iter().any(|remark| remark.contains("cut off")), has_remark, "{:?}", export.remarks);
    }
}

#[test]
fn raw_values_are_converted_with_the_calibration_or_refused() {
    // In the calibration of the file, the raw values under a mass of 50 kg have the sum 5000.
    let n_per_raw = 50.0 * 9.806_65 / 5000.0;
    let raw = text(Side::Right, "Raw", CELL_MM2 * 1e-3 / n_per_raw, "10.16 mm");
    let export = parse(&raw).unwrap();
    assert_step(&export.feet[0], Side::Right, CELL_MM2, 3e-3);
    assert!(export.remarks.iter().any(|remark| remark.contains("raw")));
    let uncalibrated: String =
        raw.lines().filter(|line| !line.starts_with("CALIBRATION")).map(|line| format!("{line}\n")).collect();
    assert_message(parse(&uncalibrated), "walk.asf:9: ", &["raw", "calibrate"]);
}

#[test]
fn decimal_commas_yield_the_same_recording() {
    let text = text(Side::Right, "KPa", 1.0, "10.16 mm");
    let frames = text.find("Frame").unwrap();
    for separator in [";", "\t"] {
        let with_commas = text[frames..].replace(',', separator).replace('.', ",");
        let export = parse(&format!("{}{with_commas}", &text[..frames])).unwrap();
        assert_eq!(export.feet, parse(&text).unwrap().feet);
    }
}

#[test]
fn raw_values_of_a_calibration_with_two_loads_are_refused() {
    let two = "CALIBRATION_POINT_2 20.0 (Kgs) 2600 (Raw Sum) 99 (Number of Loaded Cells)\r\nUNITS";
    let raw = |text: String| parse(&text.replacen("UNITS", two, 1));
    assert_message(raw(text(Side::Right, "Raw", 1.0, "10.16 mm")), "walk.asf:11: ", &["CALIBRATION_POINT_2", "kPa"]);
    assert!(raw(text(Side::Right, "KPa", 1.0, "10.16 mm")).is_ok());
}

#[test]
fn the_source_states_the_time_and_the_settings_of_the_measurement() {
    let time = "Thursday, 16 February 2017 11:26:22 a.m.";
    let stated = format!("HARDWARE 116-1974-1\r\nNOISE_THRESHOLD 3\r\nTIME {time}\r\nUNITS");
    let export = parse(&text(Side::Right, "KPa", 1.0, "10.16 mm").replacen("UNITS", &stated, 1)).unwrap();
    let source = &export.feet[0].source;
    let settings = "The export states CALIBRATION_POINT_1 50.0 (Kgs) 5000 (Raw Sum) 99 (Number of Loaded Cells); HARDWARE \
                    116-1974-1; NOISE_THRESHOLD 3.";
    assert!(source.contains(&format!("Measured at `{time}`.")) && source.contains(settings), "{source}");
    assert_eq!(recording::export::time_of(source), Some(time));
    let untimed = parse(&text(Side::Right, "KPa", 1.0, "10.16 mm")).unwrap();
    assert_eq!(recording::export::time_of(&untimed.feet[0].source), None);
}

#[test]
fn a_mirrored_export_is_refused_with_its_line() {
    let text = text(Side::Right, "KPa", 1.0, "10.16 mm");
    let with = |row: &str, column: &str| {
        parse(&text.replacen("ASCII_DATA", &format!("MIRROR_ROW {row}\r\nMIRROR_COL {column}\r\nASCII_DATA"), 1))
    };
    assert_eq!(with("0", "0").unwrap().feet, parse(&text).unwrap().feet);
    assert_message(with("1", "0"), "walk.asf:11: ", &["MIRROR_ROW is `1`", "undo the mirroring"]);
    assert_message(with("0", "1"), "walk.asf:12: ", &["MIRROR_COL is `1`", "undo the mirroring"]);
}

/// The foot of an insole must be stated; that of a plate follows from the footprint.
#[test]
fn f_scan_insoles_are_recognised_by_name_number_and_grid() {
    let row = ["10"; 21].join(",");
    let import = |sensor: &str, rows: usize, spacing: &str| {
        let table = format!("{row}\n").repeat(rows);
        let header = format!(
            "SENSOR_TYPE {sensor}\nROWS {rows}\nCOLS 21\nROW_SPACING {spacing}\nCOL_SPACING {spacing}\n\
             SECONDS_PER_FRAME 0.01\nUNITS KPa\nASCII_DATA @@\n"
        );
        let frames: String = (1..=2).map(|frame| format!("Frame {frame}\n{table}")).collect();
        parse(&format!("{header}{frames}"))
    };
    for sensor in ["F-Scan 60x21", "FSCAN", "3000", "3000E", "Model 3000 Sport"] {
        assert_message(import(sensor, 50, "5 mm"), "walk.asf: ", &["the foot is unknown"]);
    }
    assert_message(import("9811", 60, "5.08 mm"), "walk.asf: ", &["the foot is unknown"]);
    for (rows, spacing) in [(60, "5 mm"), (59, "5.08 mm")] {
        assert_eq!(import("9811", rows, spacing).unwrap().feet.len(), 1);
    }
}

#[test]
fn the_name_of_the_file_or_an_argument_states_the_foot() {
    let unnamed = text(Side::Right, "KPa", 1.0, "10.16 mm").replace("stepR", "step");
    assert_message(common::parse(Format::Tekscan, "walk.asf", unnamed.as_bytes(), None), "walk.asf: ", &["--side"]);
    for name in ["normal.asf", "walker.asf", "upright.asf", "HEEL.asf"] {
        assert_message(common::parse(Format::Tekscan, name, unnamed.as_bytes(), None), name, &["--side"]);
    }
    for name in ["right.asf", "walkRight.asf", "trial 3 r.asf"] {
        let right = common::parse(Format::Tekscan, name, unnamed.as_bytes(), None).unwrap();
        assert_eq!(right.feet[0].side, Side::Right, "{name}");
    }
    let by_name = common::parse(Format::Tekscan, "walk_R.asf", unnamed.as_bytes(), None).unwrap();
    assert_eq!(by_name.feet[0].side, Side::Right);
    let stated = common::parse(Format::Tekscan, "walk.asf", unnamed.as_bytes(), Some(Side::Right)).unwrap();
    assert_eq!(stated.feet[0], by_name.feet[0].clone_with_source(&stated.feet[0].source));
    let contradicted = common::parse(Format::Tekscan, "walk_R.asf", unnamed.as_bytes(), Some(Side::Left)).unwrap();
    assert!(contradicted.remarks.iter().any(|remark| remark.contains("one of the right foot")));
    // If the file is imported as a left foot, its footprint is mirrored, which leads to a warning.
    let wrong = common::parse(Format::Tekscan, "walk.asf", unnamed.as_bytes(), Some(Side::Left)).unwrap();
    assert!(recording::footprint::warnings(&wrong.feet[0])[0].contains("mirrored"));
    assert!(recording::footprint::warnings(&stated.feet[0]).is_empty());
}

/// A copy with another source, to compare all other fields.
trait WithSource {
    fn clone_with_source(&self, source: &str) -> Self;
}

impl WithSource for recording::Recording {
    fn clone_with_source(&self, source: &str) -> Self {
        Self { source: source.to_owned(), ..self.clone() }
    }
}

#[test]
fn damaged_files_are_refused_with_the_line_and_a_remedy() {
    let text = text(Side::Right, "KPa", 1.0, "10.16 mm");
    let without =
        |name: &str| parse(&text.lines().filter(|line| !line.starts_with(name)).collect::<Vec<_>>().join("\n"));
    for name in ["ROWS", "COLS", "ROW_SPACING", "COL_SPACING", "SECONDS_PER_FRAME", "UNITS"] {
        assert_message(without(name), "walk.asf: ", &[name, "export"]);
    }
    assert_message(without("ASCII_DATA"), "walk.asf: ", &["ASCII_DATA", "cut off"]);
    let changed = |from: &str, to: &str| parse(&text.replacen(from, to, 1));
    assert_message(changed("UNITS KPa", "UNITS stone"), "walk.asf:10: ", &["stone", "kPa"]);
    assert_message(changed("ROWS 30", "ROWS 99999"), "walk.asf:4: ", &["99999", "1 to"]);
    assert_message(changed("10.16 mm", "10.16 miles"), "walk.asf:6: ", &["miles", "inches"]);
    let (long, shown) = (format!("10.16 {}", "x".repeat(100)), format!("`{}...`", "x".repeat(60)));
    assert_message(changed("10.16 mm", &long), "walk.asf:6: ", &[&shown]);
    assert_message(changed("10.16 mm", "0 mm"), "walk.asf:6: ", &["0 mm"]);
    assert_message(changed("PER_FRAME 0.01", "PER_FRAME 0.00005"), "walk.asf:8: ", &["5e-5 s", "1e-4 to 0.5 s"]);
    assert_message(changed("COLS 11", "COLS 12"), "walk.asf:14: ", &["11 values", "12"]);
    assert_message(changed("B,0.000,", "X,0.000,"), "walk.asf:14: ", &["column 1", "`X`"]);
    assert_message(changed("Frame 2", "Frame 1"), "walk.asf:45: ", &["frame 1 follows", "order"]);
    assert_message(parse(&text[..text.len() / 2]), "walk.asf", &["cut off"]);
    // All digits are 0, except those of the number of rows.
    assert_message(
        parse(&text.replace(|c: char| c.is_ascii_digit() && c != '0', "0").replace("ROWS 00", "ROWS 30")),
        "walk.asf",
        &[],
    );
    assert_message(parse(""), "walk.asf: ", &["empty"]);
    assert_message(common::parse(Format::Tekscan, "walk.asf", &[0, 1, 2, 0], None), "walk.asf:1: ", &["not text"]);
}

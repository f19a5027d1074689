//! The import of computed files in the format of pliance.

mod common;

use common::{COLUMNS, ROWS, STANCE, assert_message, assert_step, pressure_kpa};
use plantar::Side;
use recording::{Export, Format, Result};

/// Width and height of a sensor, cm.
const WIDTH_CM: f64 = 0.8;
const HEIGHT_CM: f64 = 0.9;

/// A file with a step. The sensors have the numbers 2, 4, 6 and so on, column by column, from the top.
fn text(side: Side) -> String {
    let sensors: Vec<(usize, usize)> =
        (0..COLUMNS).flat_map(|column| (0..ROWS).map(move |row| (row, column))).collect();
    let names: Vec<_> = (1..=sensors.len()).map(|sensor| (2 * sensor).to_string()).collect();
    let mut text = format!(
        "file name: a.mat\nmat type s2160\npressure values in kPa\n\nelectrical:\ntime[secs] {}\n",
        names.join(" ")
    );
    for frame in 0..STANCE {
        let values: Vec<_> =
            sensors.iter().map(|&(row, column)| format!("{:.3}", pressure_kpa(side, frame, row, column))).collect();
        text += &format!("{:.5} {}\n", 5.0 + frame as f64 * 0.01, values.join(" "));
    }
    text += "MVP 1 2 3\n\nmasks:\ntime[secs] 1\n5.0 1\n\ncorner[cm]\n";
    for (corner, right, up) in [("0", 0.0, 1.0), ("1", 0.0, 0.0), ("2", 1.0, 0.0), ("3", 1.0, 1.0), ("c", 0.5, 0.5)] {
        let x = sensors.iter().map(|(_, column)| format!("{:.4}", (*column as f64 + right) * WIDTH_CM));
        let y = sensors.iter().map(|(row, _)| format!("{:.4}", ((ROWS - 1 - row) as f64 + up) * HEIGHT_CM));
        text += &format!("x[{corner}] {}\n", x.collect::<Vec<_>>().join(" "));
        text += &format!("y[{corner}] {}\n", y.collect::<Vec<_>>().join(" "));
    }
    text + "area" + &format!(" {:.4}", WIDTH_CM * HEIGHT_CM).repeat(sensors.len()) + "\n"
}

/// The text with corners that are numbered from 1 on.
fn from_one(text: &str) -> String {
    (0..4)
        .rev()
        .fold(text.to_owned(), |text, corner| text.replace(&format!("[{corner}]"), &format!("[{}]", corner + 1)))
}

fn parse(text: &str) -> Result<Export> {
    common::parse(Format::Pliance, "step.asc", text.as_bytes(), None)
}

#[test]
fn a_step_is_imported_and_its_foot_is_recognised() {
    for side in [Side::Left, Side::Right] {
        let text = text(side);
        assert_eq!(Format::recognise(text.as_bytes(), "step.asc".as_ref()).unwrap(), Format::Pliance);
        let export = parse(&text).unwrap();
        assert!((export.feet[0].rate_hz - 100.0).abs() < 0.01);
        assert_step(&export.feet[0], side, 100.0 * WIDTH_CM * HEIGHT_CM, 1e-3);
    }
}

#[test]
fn the_source_states_the_time_of_the_measurement() {
    let timed = text(Side::Right).replace("a.mat\n", "a.mat date/time 25.04.23 10.49\n");
    let source = &parse(&timed).unwrap().feet[0].source;
    assert!(source.contains("Measured at `25.04.23 10.49`."), "{source}");
}

#[test]
fn the_name_of_the_file_states_the_foot() {
    let import = |name| common::parse(Format::Pliance, name, text(Side::Right).as_bytes(), None).unwrap();
    let right = import("S1_R.asc");
    assert_eq!(right.feet[0].side, Side::Right);
    assert!(!right.remarks.join(" ").contains("--side"), "{:?}", right.remarks);
    assert!(right.feet[0].source.contains("not on one clock"), "{}", right.feet[0].source);
    let wrong = import("S1_L.asc");
    assert_eq!(wrong.feet[0].side, Side::Left);
    assert!(wrong.remarks.join(" ").contains("shape of the right foot"), "{:?}", wrong.remarks);
}

#[test]
fn corners_are_numbered_from_zero_or_one() {
    let text = text(Side::Right);
    let from_one = from_one(&text);
    assert!(from_one.contains("\ny[4] ") && !from_one.contains("[0]"));
    assert_eq!(Format::recognise(from_one.as_bytes(), "step.asc".as_ref()).unwrap(), Format::Pliance);
    assert_eq!(parse(&from_one).unwrap().feet, parse(&text).unwrap().feet);
}

#[test]
fn decimal_commas_yield_the_same_recording() {
    let text = text(Side::Right);
    let (with_points, with_commas) = (parse(&text).unwrap(), parse(&text.replace('.', ",")).unwrap());
    assert_eq!(with_commas.feet, with_points.feet);
}

#[test]
fn empty_lines_between_frames_are_skipped_and_another_measurement_is_refused() {
    let text = text(Side::Right);
    let whole = parse(&text).unwrap();
    for empty in ["\n", "\n\n  \n"] {
        for time in ["5.00000", "5.01000"] {
            let with_empty = text.replacen(&format!("\n{time} "), &format!("\n{empty}{time} "), 1);
            assert_eq!(parse(&with_empty).unwrap().feet, whole.feet, "{time}");
        }
    }
    let table = &text[text.find("time[secs]").unwrap()..text.find("MVP").unwrap()];
    let twice = text.replacen("MVP", &format!("MVP\n\n{table}\nMVP"), 1);
    assert_message(parse(&twice), "step.asc:", &["another measurement", "file of its own"]);
}

/// If a row with a damaged time counted as the end of the table, the frames below it would be left out without a message.
#[test]
fn a_damaged_time_is_refused_with_its_line() {
    let text = text(Side::Right);
    for damaged in ["5.0l000", "?.01000", "S.01000", "NaN", "5.01.000"] {
        let result = parse(&text.replacen("\n5.01000 ", &format!("\n{damaged} "), 1));
        assert_message(result, "step.asc:8: ", &[damaged, "number"]);
    }
}

#[test]
fn damaged_files_are_refused_with_the_place_and_a_remedy() {
    let text = text(Side::Right);
    let changed = |from: &str, to: &str| parse(&text.replacen(from, to, 1));
    assert_message(changed("kPa", "stone"), "step.asc:3: ", &["stone"]);
    // Without its header, the table of pressures is skipped, and the table of masks, which has one sensor, is taken for it. The
    // lines with the corners then have too many coordinates.
    assert_message(changed("time[secs]", "time"), "step.asc: ", &["x[0]", "corners"]);
    assert_message(changed("y[3]", "z[3]"), "step.asc: ", &["y[3]", "corners"]);
    assert_message(changed("x[2] 0.8000", "x[2] 1.6000"), "step.asc: ", &["rectangles"]);
    // A sensor that is 4095.9 rows above the lowest one: the index of its row is rounded to 4096, one more than the largest.
    let raised = text.replacen("y[1] 26.1000", "y[1] 3686.3100", 1).replacen("y[2] 26.1000", "y[2] 3686.3100", 1);
    let raised = raised.replacen("y[3] 27.0000", "y[3] 3687.2100", 1).replacen("y[0] 27.0000", "y[0] 3687.2100", 1);
    assert_message(parse(&raised), "step.asc: ", &["rectangles"]);
    // The first sensor gets the corners of the second one.
    let doubled = text.lines().map(|line| match *line.split(' ').collect::<Vec<_>>() {
        [name, _, second, ref others @ ..] if name.starts_with("x[") || name.starts_with("y[") => {
            [&[name, second, second], others].concat().join(" ") + "\n"
        }
        _ => format!("{line}\n"),
    });
    assert_message(parse(&doubled.collect::<String>()), "step.asc: ", &["same place"]);
    assert_message(changed("\n5.01000 0.000", "\n5.01000"), "step.asc:8: ", &["330 columns"]);
    assert_message(changed("\n5.01000 0.000", "\n5.01000 x"), "step.asc:8: ", &["column 2", "`x`"]);
}

#[test]
fn a_negative_pressure_is_read_as_zero_with_a_remark() {
    let text = text(Side::Right);
    let clean = parse(&text).unwrap();
    let negative = parse(&text.replacen("\n5.01000 0.000", "\n5.01000 -1.25", 1)).unwrap();
    assert_eq!(negative.feet[0].pressure_kpa, clean.feet[0].pressure_kpa);
    let remarks = negative.remarks.join(" ");
    assert!(remarks.contains("together: 1. The lowest one is -1.25 kPa."), "{remarks}");
    assert!(!clean.remarks.join(" ").contains("negative"));
}

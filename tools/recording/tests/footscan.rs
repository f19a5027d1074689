//! The import of computed files in the formats of footscan: text, and one Excel file.

mod common;

use common::{COLUMNS, ROWS, STANCE, assert_message, assert_step, exported_frames, pressure_kpa};
use plantar::Side;
use recording::{Export, Format, Result};

/// Area of a cell, mm2.
const CELL_MM2: f64 = 7.62 * 5.08;

/// The text of a step of a foot. Rows are written from the lower edge of the plate. If `is_turned`, the person walks towards
/// this edge.
fn foot(side: Side, is_turned: bool) -> String {
    let name = if side == Side::Left { "Left" } else { "Right" };
    let mut text = format!("\n{name} foot data\n\n{name} rectangle position\nRectangle height\n{ROWS}\n\n");
    for frame in 0..STANCE {
        text += &format!("Frame {frame} ({:.2} ms)\n", frame as f64 * 2.0);
        for row in 0..ROWS {
            let force = |column: usize| {
                let kpa = match is_turned {
                    true => pressure_kpa(side, frame, row, COLUMNS - 1 - column),
                    false => pressure_kpa(side, frame, ROWS - 1 - row, column),
                };
                format!("{:.5}", kpa * CELL_MM2 * 1e-3)
            };
            text += &((0..COLUMNS).map(force).collect::<Vec<_>>().join("\t") + "\n");
        }
        text += "\n";
    }
    text
}

fn file(feet: &str) -> String {
    format!("Dynamic Roll off for measurement: Barefoot\nScanning speed; for the right foot: 500.00 Hertz\n{feet}")
}

fn parse(text: &str) -> Result<Export> {
    common::parse(Format::Footscan, "step.txt", text.as_bytes(), None)
}

#[test]
fn a_second_step_of_a_foot_is_refused_with_its_line() {
    let once = file(&foot(Side::Right, false));
    let line = once.lines().count() + 2;
    let twice = once + &foot(Side::Right, false);
    assert_message(parse(&twice), &format!("step.txt:{line}: "), &["second step", "file of its own"]);
}

/// Number of unloaded frames that the import adds at each end of those of the file: 0.4 s at 500 Hz.
const ADDED: usize = 200;

#[test]
fn a_step_that_is_loaded_in_the_first_frame_begins_after_frames_without_load() {
    let export = parse(&file(&foot(Side::Right, false))).unwrap();
    let foot = &export.feet[0];
    assert_eq!(foot.frames(), ADDED + STANCE + ADDED);
    assert!((0..ADDED).chain(ADDED + STANCE..foot.frames()).all(|frame| foot.force_n(frame) == 0.0));
    assert!(foot.force_n(ADDED) > 0.0);
    assert!(foot.t_s.iter().enumerate().all(|(i, t_s)| (t_s - i as f64 * 0.002).abs() < 1e-9), "{:?}", foot.t_s);
    assert!(foot.source.contains("0.4 s without load"), "{}", foot.source);
}

/// Times in whole ms at 300 Hz: their median interval is 3 ms.
#[test]
fn the_added_frames_without_load_have_the_mean_interval() {
    let mut text = file(&foot(Side::Right, false));
    for frame in (0..STANCE).rev() {
        let rounded_ms = (frame as f64 / 0.3).round();
        let from = format!("Frame {frame} ({:.2} ms)", frame as f64 * 2.0);
        text = text.replacen(&from, &format!("Frame {frame} ({rounded_ms:.2} ms)"), 1);
    }
    let rate_hz = parse(&text).unwrap().feet[0].rate_hz;
    assert!((rate_hz / 300.0 - 1.0).abs() < 0.01, "{rate_hz} Hz");
}

#[test]
fn frames_at_a_higher_rate_than_any_plate_records_are_refused() {
    let text = "Right foot data\nFrame 0 (0.00 ms)\n1\t1\n1\t1\nFrame 1 (0.01 ms)\n1\t1\n1\t1\n";
    assert_message(parse(text), "step.txt: ", &["1e-5 s", "times"]);
}

#[test]
fn a_step_is_imported_in_both_directions_of_walking() {
    for side in [Side::Left, Side::Right] {
        for is_turned in [false, true] {
            let export = parse(&file(&foot(side, is_turned))).unwrap();
            assert_eq!(export.feet.len(), 1);
            assert!((export.feet[0].rate_hz - 500.0).abs() < 1e-6);
            assert_step(&exported_frames(&export.feet[0], ADDED), side, CELL_MM2, 1e-3);
            assert!(recording::footprint::warnings(&export.feet[0]).is_empty());
        }
    }
}

/// The text of a step of a right foot that walks across the plate: the rows of the plate are the columns of [`foot`].
fn foot_across() -> String {
    let mut text = format!("\nRight foot data\n\nRight rectangle position\nRectangle height\n{COLUMNS}\n\n");
    for frame in 0..STANCE {
        text += &format!("Frame {frame} ({:.2} ms)\n", frame as f64 * 2.0);
        for column in 0..COLUMNS {
            let force = |row: usize| {
                format!(
                    "{:.5}",
                    pressure_kpa(Side::Right, frame, ROWS - 1 - row, COLUMNS - 1 - column) * CELL_MM2 * 1e-3
                )
            };
            text += &((0..ROWS).map(force).collect::<Vec<_>>().join("\t") + "\n");
        }
        text += "\n";
    }
    text
}

/// In the coordinates of a foot across the plate, a cell is 7.62 mm wide and 5.08 mm long. The edges of the first cells are
/// on the axes.
#[test]
fn the_cells_of_a_foot_across_the_plate_touch_the_axes() {
    let export = parse(&file(&foot_across())).unwrap();
    let cells = &export.feet[0].layout.cells;
    let least = |along: fn(&recording::Cell) -> f64| cells.iter().map(along).fold(f64::INFINITY, f64::min);
    assert!((least(|cell| cell.x_mm) - 7.62 / 2.0).abs() < 1e-9, "{}", least(|cell| cell.x_mm));
    assert!((least(|cell| cell.y_mm) - 5.08 / 2.0).abs() < 1e-9, "{}", least(|cell| cell.y_mm));
}

#[test]
fn an_excel_file_is_imported() {
    // A seed of the fuzz targets: a computed step on eight rows and five columns. Its first byte selects the format.
    let seed = include_bytes!("../../../fuzz/corpus/vendor/footscan-xls");
    let export = common::parse(Format::Footscan, "step.xls", &seed[1..], None).unwrap();
    let foot = &export.feet[0];
    assert_eq!((foot.side, foot.frames(), foot.cells()), (Side::Right, 70, 40));
    assert!((foot.rate_hz - 50.0).abs() < 1e-6);
    for frame in 0..30 {
        let kpa = |row: usize, column: usize| {
            let late = (7 - row) as f64 / 8.0 - frame as f64 / 30.0;
            (200.0 * (1.0 - 9.0 * late * late).max(0.0) * (1.0 - 0.1 * column as f64)).round()
        };
        // The computed step has 0.1 N for each kPa of a cell.
        let true_n: f64 = (0..40).map(|cell| 0.1 * kpa(cell / 5, cell % 5)).sum();
        // At 50 Hz, the import adds 20 unloaded frames before those of the file.
        assert!((foot.force_n(20 + frame) - true_n).abs() < 1e-3 * true_n + 1e-6, "frame {frame}");
    }
}

#[test]
fn an_excel_file_with_a_record_that_exceeds_the_file_is_refused_with_the_place() {
    let mut file = include_bytes!("../../../fuzz/corpus/vendor/footscan-xls")[1..].to_vec();
    // The stream with the workbook follows the header of the file, which has 512 bytes. The last number of the sheet is in a
    // record of type 0x0203 with 14 bytes.
    let at = file.windows(4).rposition(|bytes| bytes == [0x03, 0x02, 14, 0]).expect("a number");
    file[at + 2..at + 4].copy_from_slice(&[0xff, 0xff]);
    let place = format!("byte {} ", at - 512);
    assert_message(common::parse(Format::Footscan, "step.xls", &file, None), "step.xls: ", &["no end", &place]);
}

#[test]
fn both_feet_of_a_file_are_imported() {
    let export = parse(&file(&(foot(Side::Left, false) + &foot(Side::Right, false)))).unwrap();
    for (recording, side) in export.feet.iter().zip([Side::Left, Side::Right]) {
        assert_step(&exported_frames(recording, ADDED), side, CELL_MM2, 1e-3);
    }
    assert_eq!(export.feet.len(), 2);
}

#[test]
fn two_feet_that_begin_loaded_at_the_same_time_lead_to_a_remark() {
    let has_remark = |right: &str| {
        let export = parse(&file(&(foot(Side::Left, false) + right))).unwrap();
        export.remarks.iter().any(|remark| remark.contains("Do not compare times between the feet"))
    };
    let right = foot(Side::Right, false);
    assert!(has_remark(&right));
    // The right foot begins 1 s later, or with a frame without load.
    let later = (0..STANCE).rev().fold(right.clone(), |text, frame| {
        let ms = frame as f64 * 2.0;
        text.replacen(&format!("({ms:.2} ms)"), &format!("({:.2} ms)", ms + 1000.0), 1)
    });
    assert!(!has_remark(&later));
    let frame = right.find("Frame 0").expect("a frame")..right.find("Frame 1 ").expect("a second frame");
    let values = right[frame.clone()].replace(|c: char| ('1'..='9').contains(&c), "0");
    let unloaded = right.replacen(&right[frame], &values, 1);
    assert!(!has_remark(&unloaded));
    // A file of one foot has no such remark.
    let of_one_foot = parse(&file(&right)).unwrap().remarks.join(" ");
    assert!(!of_one_foot.contains("between the feet"));
}

/// Both feet are cut off in the middle of their steps.
#[test]
fn the_remark_on_a_cut_contact_names_the_foot() {
    let half = |side: Side| foot(side, false).split_inclusive("\n\nFrame ").take(STANCE / 2).collect::<String>();
    let half = |side: Side| half(side).trim_end_matches("Frame ").to_owned() + "\n";
    let remarks = parse(&file(&(half(Side::Left) + &half(Side::Right)))).unwrap().remarks;
    for foot in ["Left", "Right"] {
        let begin = format!("{foot} foot: the last frame carries ");
        assert_eq!(remarks.iter().filter(|remark| remark.starts_with(&begin)).count(), 1, "{remarks:?}");
    }
}

/// The export has forces: -0.1 N on a cell of 7.62 mm by 5.08 mm.
#[test]
fn a_negative_force_is_read_as_a_pressure_of_zero_with_a_remark() {
    let text = file(&foot(Side::Right, false));
    let export = parse(&text.replacen("(0.00 ms)\n0.00000", "(0.00 ms)\n-0.10000", 1)).unwrap();
    let remarks = export.remarks.join(" ");
    let [mut foot, mut clean] = [export, parse(&text).unwrap()].map(|export| export.feet[0].clone());
    (foot.source, clean.source) = (String::new(), String::new());
    assert_eq!(foot, clean);
    assert!(remarks.contains("in all frames together: 1. The lowest one is -2.58 kPa"), "{remarks}");
}

#[test]
fn a_unit_of_pressure_in_the_header_is_refused_also_after_a_long_field() {
    let text = file(&foot(Side::Right, false));
    let with_header = |row: &str| parse(&text.replacen("Right foot data\n", &format!("Right foot data\n{row}\n"), 1));
    let long = "x".repeat(5000);
    for row in ["unit: kPa".to_owned(), format!("{long}\tunit: kPa")] {
        assert_message(with_header(&row), "step.txt:", &["pressures in kPa", "expected forces in N"]);
    }
    assert_eq!(with_header(&long).unwrap().feet, parse(&text).unwrap().feet);
}

#[test]
fn damaged_files_are_refused_with_the_line_and_a_remedy() {
    let text = file(&foot(Side::Right, false));
    let first_row = text.lines().position(|line| line.starts_with("Frame 0")).unwrap() + 2;
    let at = |line: usize| format!("step.txt:{line}: ");
    let changed = |from: &str, to: &str| parse(&text.replacen(from, to, 1));
    assert_message(changed("(0.00 ms)\n0.00000", "(0.00 ms)\nzero"), &at(first_row), &["column 1", "zero"]);
    assert_message(changed("(0.00 ms)\n0.00000\t", "(0.00 ms)\n"), &at(first_row + 1), &["11 values", "10"]);
    assert_message(changed("Frame 1 (2.00 ms)", "Frame 1 (0.00 ms)"), &at(first_row + 31), &["not later"]);
    assert_message(changed("Frame 1 (2.00 ms)", "Frame one"), &at(first_row + 31), &["Frame one"]);
    // The export ends after 20 of the 30 rows of its last frame. Each frame has 32 lines.
    let last_frame = first_row - 1 + 32 * (STANCE - 1);
    let cut: String = text.split_inclusive('\n').take(last_frame + 20).collect();
    assert_message(parse(&cut), &at(last_frame), &["20 rows", "30", "cut off"]);
    // The complete other foot can be imported.
    let both = file(&foot(Side::Left, false)) + &cut[cut.find("Right foot data").expect("the foot is named")..];
    assert_message(parse(&both), "step.txt:", &["20 rows"]);
    let left = common::parse(Format::Footscan, "step.txt", both.as_bytes(), Some(Side::Left)).unwrap();
    assert_eq!(left.feet[0].side, Side::Left);
    assert_message(parse("Right foot data\n"), "step.txt: ", &["no frame"]);
    // With zeros instead of all digits, all frames have the same time.
    assert_message(parse(&text.replace(|c: char| c.is_ascii_digit() && c != '0', "0")), "step.txt", &[]);
    let other_foot = common::parse(Format::Footscan, "step.txt", text.as_bytes(), Some(Side::Left));
    assert_message(other_foot, "step.txt: ", &["left foot"]);
    let damaged = [&[0xd0, 0xcf, 0x11, 0xe0, 0xa1, 0xb1, 0x1a, 0xe1][..], &[7; 600]].concat();
    assert_message(common::parse(Format::Footscan, "step.xls", &damaged, None), "step.xls: ", &["Excel", "again"]);
}

//! The import of computed files in the format of XSENSOR.

mod common;

use common::{COLUMNS, ROWS, STANCE, SWING, assert_message, assert_step, force_n, pressure_kpa};
use plantar::Side;
use recording::{Export, Format, Result};

/// Side length of a cell, cm.
const CELL_CM: f64 = 0.86;
const CELL_MM2: f64 = CELL_CM * CELL_CM * 100.0;

/// How a file is written.
#[derive(Clone, Copy)]
struct Style {
    unit: &'static str,
    /// Number of units in 1 kPa.
    per_kpa: f64,
    separator: &'static str,
    line_end: &'static str,
    /// The byte order mark at the start of the file, or no text.
    mark: &'static str,
    /// Whether all fields are in quotes.
    is_quoted: bool,
    /// Whether a row of empty fields follows each line.
    blank_rows: bool,
}

const USUAL: Style = Style {
    unit: "mmHg",
    per_kpa: 7.500_617,
    separator: ",",
    line_end: "\r\n",
    mark: "\u{feff}",
    is_quoted: false,
    blank_rows: true,
};

/// The lines of a file with two steps of each foot. Each line is a list of fields.
fn lines(style: Style) -> Vec<Vec<String>> {
    let line = |fields: &[&str]| fields.iter().map(|field| field.to_string()).collect::<Vec<_>>();
    let mut lines = vec![line(&["File:", "C:\\walks\\first, second.XSN"]), line(&["Units:", style.unit])];
    lines.push(line(&["Threshold:", "37.5"]));
    for frame in 0..2 * (STANCE + SWING) {
        let time_s = 21.0 + frame as f64 * 0.01;
        lines.push(line(&["FRAME", &(1464 + frame).to_string()]));
        lines.push(line(&["Date", " 2022 Aug 16"]));
        lines.push(line(&["Time", &format!(" 08:20:{time_s:06.3}")]));
        for (side, name) in [(Side::Left, "HX.11.30-LF S0073"), (Side::Right, "HX.11.30-RF S0073")] {
            lines.push(line(&["SENSOR", name]));
            lines.push(line(&["Rows", &ROWS.to_string()]));
            lines.push(line(&["Columns", &COLUMNS.to_string()]));
            lines.push(line(&["Sensel Width (cm)", &CELL_CM.to_string()]));
            lines.push(line(&["Sensel Height (cm)", &CELL_CM.to_string()]));
            // The left foot walks half a cycle later.
            let phase = (frame + if side == Side::Left { (STANCE + SWING) / 2 } else { 0 }) % (STANCE + SWING);
            let cells = (0..ROWS * COLUMNS).filter(|i| pressure_kpa(side, phase, i / COLUMNS, i % COLUMNS) > 0.0);
            lines.push(line(&["Contact Area (cm2)", &format!("{:.2}", cells.count() as f64 * CELL_MM2 / 100.0)]));
            lines.push(line(&["Est. Load (N)", &format!("{:.2}", force_n(side, phase, CELL_MM2))]));
            lines.push(line(&["SENSELS"]));
            for row in 0..ROWS {
                let kpa = (0..COLUMNS).map(|column| pressure_kpa(side, phase, row, column) * style.per_kpa);
                lines.push(kpa.map(|value| format!("{value:.3}")).collect());
            }
        }
        // A group repeats the values of some cells. The import skips it.
        lines.push(line(&["GROUP", "1"]));
        lines.push(line(&["Name", "Left Heel"]));
        lines.push(line(&["Est. Load (N)", "1"]));
        lines.push(line(&["SENSELS"]));
        lines.push(line(&["1", "2", "3"]));
    }
    lines
}

fn text(style: Style, lines: &[Vec<String>]) -> String {
    let mut text = style.mark.to_owned();
    let quoted = |field: &String| match style.is_quoted || field.contains(style.separator) {
        true => format!("\"{field}\""),
        false => field.clone(),
    };
    for line in lines {
        text += &line.iter().map(quoted).collect::<Vec<_>>().join(style.separator);
        text += style.line_end;
        if style.blank_rows {
            text += &style.separator.repeat(10);
            text += style.line_end;
        }
    }
    text
}

fn parse(text: &str) -> Result<Export> {
    common::parse(Format::Xsensor, "walk.csv", text.as_bytes(), None)
}

/// Checks that both feet of the computed walk were imported on one clock, and agree with the vendor's totals.
fn assert_both_feet(export: &Export) {
    let [left, right] = &export.feet[..] else { panic!("{} feet", export.feet.len()) };
    assert!((left.rate_hz - 100.0).abs() < 0.01, "{} Hz", left.rate_hz);
    assert_eq!(left.t_s, right.t_s, "both feet are on one clock");
    assert_step(right, Side::Right, CELL_MM2, 1e-3);
    let second_half = (STANCE + SWING) / 2;
    let mut step = left.clone();
    step.pressure_kpa.drain(..second_half * left.cells());
    step.t_s.drain(..second_half);
    assert_step(&step, Side::Left, CELL_MM2, 1e-3);
    for (foot, name) in [(left, "Left"), (right, "Right")] {
        assert!(recording::footprint::warnings(foot).is_empty());
        let remark = export
            .remarks
            .iter()
            .find(|remark| remark.starts_with(name))
            .expect("a comparison with the vendor's totals");
        assert!(remark.contains("force differs from the vendor's by") && remark.contains("contact area"), "{remark}");
        assert!(!remark.contains("Check the unit"), "{remark}");
    }
}

#[test]
fn both_feet_are_imported_with_their_forces_sides_and_clock() {
    assert_both_feet(&parse(&text(USUAL, &lines(USUAL))).unwrap());
}

#[test]
fn files_in_all_styles_yield_the_same_recordings() {
    let unix = Style { line_end: "\n", mark: "", blank_rows: false, ..USUAL };
    let quoted = Style { is_quoted: true, ..USUAL };
    let semicolons = Style { separator: ";", unit: "kPa", per_kpa: 1.0, ..USUAL };
    let psi = Style { unit: "PSI", per_kpa: 0.145_037_7, separator: "\t", ..USUAL };
    let newtons = Style { unit: "N/cm²", per_kpa: 0.1, ..USUAL };
    for style in [unix, quoted, semicolons, psi, newtons] {
        assert_both_feet(&parse(&text(style, &lines(style))).unwrap());
    }
    let utf16: Vec<u8> = text(USUAL, &lines(USUAL)).encode_utf16().flat_map(u16::to_le_bytes).collect();
    assert_both_feet(&common::parse(Format::Xsensor, "walk.csv", &utf16, None).unwrap());
}

#[test]
fn pressures_in_another_unit_than_stated_lead_to_a_remark() {
    let mut lines = lines(USUAL);
    lines[1][1] = "kPa".to_owned();
    let export = parse(&text(USUAL, &lines)).unwrap();
    assert!(export.remarks.iter().any(|remark| remark.contains("Check the unit")), "{:?}", export.remarks);
}

/// The walk takes 1.6 s, in which whole seconds do not determine the frame rate.
#[test]
fn whole_seconds_in_a_short_walk_are_refused() {
    let mut lines = lines(USUAL);
    for line in lines.iter_mut().filter(|line| line[0] == "Time") {
        line[1].truncate(" 08:20:21".len());
    }
    assert_message(parse(&text(USUAL, &lines)), "walk.csv:", &["not later"]);
}

/// The index of the line that begins the section of this name with the number `n`, counted from 0.
fn section(lines: &[Vec<String>], name: &str, n: usize) -> usize {
    (0..lines.len()).filter(|&i| lines[i][0] == name).nth(n).expect("a section")
}

#[test]
fn a_foot_that_is_missing_in_a_frame_is_interpolated() {
    let mut lines = lines(USUAL);
    let begin = section(&lines, "SENSOR", 2 * 30 + 1);
    let end = section(&lines, "GROUP", 30);
    lines.drain(begin..end);
    let export = parse(&text(USUAL, &lines)).unwrap();
    assert!(
        export.remarks.iter().any(|r| r.starts_with("Right foot: Lost frames that were interpolated linearly: 1")),
        "{:?}",
        export.remarks
    );
    let right = &export.feet[1];
    let (before, lost, after) = (right.force_n(29), right.force_n(30), right.force_n(31));
    assert!((lost - (before + after) / 2.0).abs() < 0.01);
    assert_eq!(export.feet[0].frames(), right.frames());
}

#[test]
fn empty_and_negative_pressures_are_read_as_zero_and_counted() {
    let mut lines = lines(USUAL);
    let row = section(&lines, "SENSELS", 0) + 1;
    (lines[row][0], lines[row][1]) = (String::new(), "-3.5".to_owned());
    let export = parse(&text(USUAL, &lines)).unwrap();
    let [left, right] = &export.feet[..] else { panic!("two feet") };
    assert!(left.source.contains("foot: 2 fields"), "{}", left.source);
    assert!(!right.source.contains("2 fields"), "{}", right.source);
    assert!(
        export.remarks.iter().any(|r| {
            r.starts_with("Left foot: 2 fields in all frames together are empty, negative or placeholders")
        })
    );
}

#[test]
fn a_single_foot_can_be_selected() {
    let bytes = text(USUAL, &lines(USUAL)).into_bytes();
    let export = common::parse(Format::Xsensor, "walk.csv", &bytes, Some(Side::Left)).unwrap();
    assert_eq!(export.feet.iter().map(|foot| foot.side).collect::<Vec<_>>(), [Side::Left]);
}

#[test]
fn a_layout_upside_down_or_mirrored_leads_to_a_warning() {
    let turned = |turn: fn(&mut [Vec<String>])| {
        let mut lines = lines(USUAL);
        let tables: Vec<usize> = (0..lines.len()).filter(|&i| lines[i][0] == "SENSELS").collect();
        for start in tables {
            // The table of a group has fewer columns, and remains.
            if lines[start + 1].len() != COLUMNS {
                continue;
            }
            turn(&mut lines[start + 1..=start + ROWS]);
        }
        recording::footprint::warnings(&parse(&text(USUAL, &lines)).unwrap().feet[1])
    };
    let upside_down = turned(|rows| {
        rows.reverse();
        rows.iter_mut().for_each(|row| row.reverse());
    });
    assert!(upside_down.len() == 1 && upside_down[0].contains("upside down"), "{upside_down:?}");
    let mirrored = turned(|rows| rows.iter_mut().for_each(|row| row.reverse()));
    assert!(mirrored.len() == 1 && mirrored[0].contains("mirrored") && mirrored[0].contains("--side"), "{mirrored:?}");
}

#[test]
fn damaged_files_are_refused_with_the_line_and_a_remedy() {
    let style = Style { blank_rows: false, ..USUAL };
    let lines = lines(style);
    let first_row = section(&lines, "SENSELS", 0) + 1;
    let changed = |at: usize, field: usize, value: &str| {
        let mut lines = lines.clone();
        lines[at][field] = value.to_owned();
        parse(&text(style, &lines))
    };
    let at = |index: usize| format!("walk.csv:{}: ", index + 1);
    assert_message(changed(1, 1, "furlong"), &at(1), &["furlong", "kPa"]);
    assert_message(changed(first_row, 3, "1,2,3"), &at(first_row), &["column 4", "number"]);
    assert_message(changed(first_row, 3, "Rows"), &at(first_row), &["Rows", "number"]);
    assert_message(changed(5, 1, "noon"), &at(5), &["noon", "time"]);
    assert_message(changed(7, 1, "0"), &at(7), &["rows", "1 to"]);
    assert_message(changed(9, 1, "-1"), &at(9), &["cell"]);
    // The insole of a later frame has another size.
    let later = section(&lines, "Rows", 2);
    assert_message(changed(later, 1, "31"), &at(later), &["rows", "differs"]);
    let mixed = {
        let mut lines = lines.clone();
        lines.insert(3, vec!["Units:".to_owned(), "kPa".to_owned()]);
        parse(&text(style, &lines))
    };
    assert_message(mixed, &at(3), &["unit changes"]);
    let long_label = {
        let mut lines = lines.clone();
        lines[7] = vec![format!("Rows ({})", "x".repeat(100)), "0".to_owned()];
        parse(&text(style, &lines))
    };
    assert_message(long_label, &at(7), &[&format!("rows ({}..., expected", "x".repeat(54))]);
    let cut = parse(&text(style, &lines[..first_row + 7]));
    assert_message(cut, "walk.csv:", &["7 of 30 rows", "cut off"]);
    let without_time: Vec<_> = lines.iter().filter(|line| line[0] != "Time").cloned().collect();
    assert_message(parse(&text(style, &without_time)), &at(3), &["without Time"]);
    assert_message(parse(""), "walk.csv: ", &["empty"]);
    assert_message(parse("Units:,mmHg\n"), "walk.csv: ", &["FRAME"]);
    let other = text(style, &lines).replace("-LF ", "-BK ").replace("-RF ", "-ST ");
    assert_message(parse(&other), "walk.csv: ", &["LF or RF"]);
}

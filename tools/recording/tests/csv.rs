//! The CSV import: valid files are imported. For invalid files the error names the file, the line and a remedy.

use plantar::{Region, Side};
use recording::{Recording, Result, Span, csv};
use std::fmt::Write;
use tempfile::TempDir;

const LAYOUT: &str = "cell,x_mm,y_mm,area_mm2,region\n\
                      0,5,5,100,heel\n\
                      1,15,5,100,toe_2\n";
const FRAMES: &str = "t_s,c0,c1\n0.00,1,2\n0.01,3,4\n0.02,5,6\n";

fn import(layout: &str, frames: &str) -> Result<Recording> {
    import_at(None, layout, frames)
}

/// Imports the files, and resamples them to `rate_hz`.
fn import_at(rate_hz: Option<f64>, layout: &str, frames: &str) -> Result<Recording> {
    let folder = TempDir::new().unwrap();
    let (layout_path, frames_path) = (folder.path().join("layout.csv"), folder.path().join("frames.csv"));
    std::fs::write(&layout_path, layout).unwrap();
    std::fs::write(&frames_path, frames).unwrap();
    csv::import(layout_path, frames_path, Side::Left, Span::default(), rate_hz, &mut |_, _| {})
}

#[track_caller]
fn assert_refused(layout: &str, frames: &str, expected: &[&str]) {
    let error = import(layout, frames).unwrap_err().to_string();
    for part in expected {
        assert!(error.contains(part), "`{part}` not in: {error}");
    }
}

#[test]
fn valid_files_are_imported() {
    let recording = import(LAYOUT, FRAMES).unwrap();
    assert_eq!(recording.side, Side::Left);
    assert_eq!(recording.pressure_kpa, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    assert!((recording.rate_hz - 100.0).abs() < 1e-9);
    assert_eq!(recording.layout.cells[1].region, Region::Toe2);
    assert_eq!(recording.layout.cells[1].x_mm, 15.0);
}

#[test]
fn an_error_names_the_line_for_both_line_ends_and_after_blank_lines() {
    for end in ["\n", "\r\n"] {
        for (last, blank) in [("", ""), (end, ""), (end, end)] {
            let lines = ["t_s,c0,c1", "0.00,1,2", "0.01,3,4", "0.02,5"].join(end);
            let frames = lines.replacen("0.02", &format!("{blank}0.02"), 1) + last;
            assert_refused(LAYOUT, &frames, &[if blank.is_empty() { "frames.csv:4:" } else { "frames.csv:5:" }]);
            let layout = LAYOUT.replace("toe_2", "toe_9").replace("\n1,", &format!("\n{blank}1,")).replace('\n', end);
            assert_refused(&layout, FRAMES, &[if blank.is_empty() { "layout.csv:3:" } else { "layout.csv:4:" }]);
        }
    }
}

#[test]
fn order_spaces_and_a_byte_order_mark_do_not_matter() {
    let layout = "\u{feff}region, cell, area_mm2, y_mm, x_mm\ntoe_2, 1, 100, 5, 15\nheel,0,100,5,5\n";
    let frames = FRAMES.replace(',', " , ").replace('\n', "\r\n");
    let (plain, other) = (import(LAYOUT, FRAMES).unwrap(), import(layout, &frames).unwrap());
    assert_eq!((other.layout, other.t_s, other.pressure_kpa), (plain.layout, plain.t_s, plain.pressure_kpa));
}

#[test]
fn without_regions_the_template_assigns_them() {
    let layout = "cell,x_mm,y_mm,area_mm2\n0,30,10,100\n1,10,260,100\n";
    let recording = import(layout, FRAMES).unwrap();
    assert_eq!(recording.layout.cells[0].region, Region::Heel);
    assert!(recording.layout.cells[1].region > Region::Metatarsals35);
}

#[test]
fn times_rounded_to_milliseconds_result_in_the_true_rate() {
    let mut frames = String::from("t_s,c0,c1\n");
    for k in 0..300 {
        writeln!(frames, "{:.3},0,0", f64::from(k) / 300.0).unwrap();
    }
    let recording = import(LAYOUT, &frames).unwrap();
    assert!((recording.rate_hz - 300.0).abs() < 0.5);
}

#[test]
fn a_change_of_the_rate_is_rejected_at_its_line() {
    let times = (0..500).map(|i| if i < 250 { f64::from(i) * 0.01 } else { 2.5 + f64::from(i - 250) * 0.014 });
    let frames: String = times.map(|t_s| format!("{t_s:.3},1,2\n")).collect();
    assert_refused(LAYOUT, &format!("t_s,c0,c1\n{frames}"), &["frames.csv:252:", "the rate changes"]);
}

#[test]
fn times_in_milliseconds_are_rejected() {
    assert_refused(LAYOUT, "t_s,c0,c1\n0,0,0\n10,0,0\n20,0,0\n", &["frames.csv", "every 10.000 s", "times in seconds"]);
}

/// A virtual insole counts the time between frames in whole microseconds.
#[test]
fn times_less_than_a_microsecond_apart_are_rejected() {
    let frames = "t_s,c0,c1\n0,0,0\n1e-7,0,0\n2e-7,0,0\n";
    assert_refused(LAYOUT, frames, &["frames.csv", "at most 1000000 Hz", "times in seconds"]);
}

#[test]
fn progress_ends_at_the_size_of_the_file() {
    let folder = TempDir::new().unwrap();
    let paths = ["layout.csv", "frames.csv"].map(|name| folder.path().join(name));
    std::fs::write(&paths[0], LAYOUT).unwrap();
    let mut frames = String::from("t_s,c0,c1\n");
    for k in 0..5000 {
        writeln!(frames, "{:.2},0,0", f64::from(k) / 100.0).unwrap();
    }
    std::fs::write(&paths[1], &frames).unwrap();
    let mut reports = Vec::new();
    csv::import(&paths[0], &paths[1], Side::Left, Span::default(), None, &mut |done, total| {
        reports.push((done, total));
    })
    .unwrap();
    assert!(reports.len() > 3 && reports.is_sorted());
    assert_eq!(reports.last(), Some(&(frames.len() as u64, frames.len() as u64)));
}

#[test]
fn unknown_and_missing_layout_columns_are_rejected() {
    let refused = |from: &str, to: &str, expected: &[&str]| {
        assert_refused(&LAYOUT.replace(from, to), FRAMES, expected);
    };
    let header = "the header is cell,x_mm,y_mm,area_mm2";
    refused("area_mm2", "area_cm2", &["layout.csv:1", "`area_cm2`", header]);
    refused("region", "cell", &["layout.csv:1", "appears twice"]);
    assert_refused("cell,x_mm,y_mm\n0,1,1\n", FRAMES, &["layout.csv:1", "no column `area_mm2`", header]);
    assert_refused("", FRAMES, &["layout.csv:1", "the file is empty"]);
}

/// As a spreadsheet of a region with decimal commas writes them.
#[test]
fn semicolons_with_decimal_commas_or_points_yield_the_same_recording() {
    let (layout, frames) =
        (LAYOUT.replace(",15,", ",15.25,"), FRAMES.replace(",3,", ",-0.5,").replace(",6\n", ",6.75\n"));
    let usual = import(&layout, &frames).unwrap();
    assert_eq!((usual.layout.cells[1].x_mm, usual.pressure_kpa[5]), (15.25, 6.75));
    let with_points = |text: &str| text.replace(',', ";");
    let with_commas = |text: &str| with_points(text).replace('.', ",");
    for (layout, frames) in [
        (with_commas(&layout), with_commas(&frames)),
        (with_points(&layout), with_points(&frames)),
        (with_commas(&layout), frames.clone()),
        (layout.clone(), format!("\u{feff}{}", with_commas(&frames).replace('\n', "\r\n"))),
    ] {
        assert_eq!(import(&layout, &frames).unwrap(), usual, "{layout}{frames}");
    }
    assert_refused(LAYOUT, &with_commas(FRAMES).replace(";3;", ";3,5,5;"), &["frames.csv:3", "column c0"]);
    // The separator of 1.028 may separate thousands.
    let thousands = with_commas(FRAMES).replace(";3;4", ";1.028;750");
    assert_refused(LAYOUT, &thousands, &["frames.csv:3", "`1.028`", "thousands"]);
}

#[test]
fn tabs_between_the_fields_are_named() {
    let with_tabs = |text: &str| text.replace(',', "\t");
    let expected = ["a tab separates", "expected `,`", "decimal points"];
    assert_refused(&with_tabs(LAYOUT), FRAMES, &[&["layout.csv:1"][..], &expected].concat());
    assert_refused(LAYOUT, &with_tabs(FRAMES), &[&["frames.csv:1"][..], &expected].concat());
}

/// As after the subtraction of a baseline.
#[test]
fn negative_pressures_are_read_as_zero_and_counted_in_the_source() {
    let recording = import(LAYOUT, &FRAMES.replace("0.01,3,4", "0.01,-0.5,-2.25")).unwrap();
    assert_eq!(recording.pressure_kpa, [1.0, 2.0, 0.0, 0.0, 5.0, 6.0]);
    let counted =
        "Left foot: negative pressures that were read as 0, in all frames together: 2. The lowest one is -2.25 kPa.";
    assert!(recording.source.ends_with(counted), "{}", recording.source);
    assert!(!import(LAYOUT, FRAMES).unwrap().source.contains("negative"));
}

#[test]
fn empty_rows_of_a_spreadsheet_are_named() {
    let remedy = ["an empty field in column", "fill the field", "at the end of the file are empty, delete them"];
    assert_refused(LAYOUT, &format!("{FRAMES},,\n"), &[&["frames.csv:5", "t_s"][..], &remedy].concat());
    assert_refused(&format!("{LAYOUT},,,,\n"), FRAMES, &[&["layout.csv:4", "cell"][..], &remedy].concat());
}

#[test]
fn invalid_layout_rows_are_rejected() {
    let refused = |from: &str, to: &str, expected: &[&str]| {
        assert_refused(&LAYOUT.replace(from, to), FRAMES, expected);
    };
    refused("1,15,5,100,toe_2", "1,15,5,100", &["layout.csv:3", "4 columns"]);
    refused("1,15", "1,NaN", &["layout.csv:3", "`NaN` in column x_mm"]);
    refused("1,15", "1,inf", &["layout.csv:3", "`inf` in column x_mm"]);
    refused("15,5,100", "15,5,0", &["layout.csv:3", "positive area"]);
    refused("15,5,100", "15,5,-4", &["layout.csv:3", "positive area"]);
    refused("toe_2", "thumb", &["layout.csv:3", "`thumb`", "use one of heel, posterior_midfoot", "toes_35"]);
    refused("1,15", "0,15", &["layout.csv:3", "cell 0 is already on line 2"]);
    refused("1,15", "2,15", &["layout.csv:3", "cell 1 is missing"]);
    refused("1,15", "one,15", &["layout.csv:3", "`one` is not a cell number"]);
    let (long, shown) = ("x".repeat(100), format!("`{}...`", "x".repeat(60)));
    refused("toe_2", &long, &["layout.csv:3", &shown]);
    refused("1,15", &format!("{long},15"), &["layout.csv:3", &shown]);
    refused("toe_2", "toe\u{1b}2", &["layout.csv:3", "`toe 2`"]);
    assert_refused("cell,x_mm,y_mm,area_mm2\n", FRAMES, &["layout.csv", "at least one cell"]);
}

/// The layout of a matrix of 4 by 4 cells with this size, in which cell 5 is shifted medially by `shift_mm`.
fn matrix((width_mm, length_mm): (f64, f64), shift_mm: f64) -> (String, String) {
    let (mut layout, mut frames) = (String::from("cell,x_mm,y_mm,area_mm2\n"), String::from("t_s"));
    for cell in 0..16 {
        let (x_mm, y_mm) = (f64::from(cell % 4) * width_mm, f64::from(cell / 4) * length_mm);
        let x_mm = if cell == 5 { x_mm - shift_mm } else { x_mm };
        writeln!(layout, "{cell},{x_mm},{y_mm},{}", width_mm * length_mm).unwrap();
        write!(frames, ",c{cell}").unwrap();
    }
    for frame in 0..3 {
        write!(frames, "\n0.0{frame}{}", ",1".repeat(16)).unwrap();
    }
    (layout, frames)
}

#[test]
fn the_error_for_an_overlap_names_both_cells() {
    let (layout, frames) = matrix((10.0, 10.0), 3.0);
    assert_refused(&layout, &frames, &["layout.csv:7", "cell 4 (line 6)", "cell 5 (line 7)", "30 %"]);
    let (layout, frames) = matrix((10.0, 10.0), 2.0);
    assert!(import(&layout, &frames).is_ok());
    let at_one_place = LAYOUT.replace("1,15", "1,5");
    assert_refused(&at_one_place, FRAMES, &["layout.csv:3", "cell 0 (line 2)", "cell 1 (line 3)", "100 %"]);
}

#[test]
fn cells_may_be_rectangles() {
    for size in [(5.0, 10.0), (14.0, 7.0), (4.0, 13.0), (21.0, 3.5)] {
        let (layout, frames) = matrix(size, 0.0);
        assert!(import(&layout, &frames).is_ok(), "{size:?}");
        let (layout, frames) = matrix(size, 0.6 * size.0);
        assert_refused(&layout, &frames, &["cell 4", "cell 5", "overlap"]);
    }
}

#[test]
fn too_many_cells_are_rejected() {
    let mut layout = String::from("cell,x_mm,y_mm,area_mm2\n");
    for cell in 0..4097 {
        writeln!(layout, "{cell},{},{},1", cell % 64, cell / 64).unwrap();
    }
    assert_refused(&layout, FRAMES, &["layout.csv", "4097 cells", "4096"]);
}

#[test]
fn frame_columns_that_do_not_match_the_layout_are_rejected() {
    let refused = |from: &str, to: &str, expected: &[&str]| {
        assert_refused(LAYOUT, &FRAMES.replace(from, to), expected);
    };
    refused("t_s", "time", &["frames.csv:1", "`time`, expected `t_s`"]);
    refused("c0,c1", "c1,c0", &["frames.csv:1", "`c1`, expected `c0`"]);
    assert_refused(LAYOUT, "t_s,c0\n0,1\n", &["frames.csv:1", "1 cell columns", "layout.csv", "2 cells"]);
}

#[test]
fn invalid_frame_rows_are_rejected() {
    let refused = |from: &str, to: &str, expected: &[&str]| {
        assert_refused(LAYOUT, &FRAMES.replace(from, to), expected);
    };
    refused("0.01,3,4", "0.01,3", &["frames.csv:3", "2 columns, the header has 3"]);
    refused("0.01,3,4", "0.01,3,4,5", &["frames.csv:3", "4 columns"]);
    for bad in ["NaN", "inf", "-inf", "three", "1e999"] {
        refused("0.01,3,", &format!("0.01,{bad},"), &["frames.csv:3", "column c0", "finite number"]);
    }
    refused("0.01,3,", "0.01,,", &["frames.csv:3", "an empty field in column c0", "fill the field"]);
    refused("0.01,3,", "0.01,1e300,", &["frames.csv:3", "c0"]);
    let (long, shown) = (format!("0.01,{}x,", "0".repeat(100)), format!("`{}...` in column c0", "0".repeat(60)));
    refused("0.01,3,", &long, &["frames.csv:3", &shown]);
    refused("0.01,3,", "0.01,60000,", &["frames.csv:3", "c0", "60000 kPa", "0 to 50000 kPa"]);
    refused("0.02,", "0.00,", &["frames.csv:4", "backwards"]);
    refused("0.02,", "0.01,", &["frames.csv:4", "repeated", "export them with more digits"]);
    refused("0.02,", "soon,", &["frames.csv:4", "`soon` in column t_s"]);
}

#[test]
fn the_error_for_a_gap_in_time_names_its_line() {
    // A blank line counts as a line but not as a frame.
    let frames = FRAMES.replace("0.01,3,4\n", "0.01,3,4\n\n") + "0.06,1,1\n0.07,1,1\n";
    assert_refused(LAYOUT, &frames, &["frames.csv:6", "0.040000 s after", "split the recording"]);
}

/// Times that are not uniform, and a pressure that is too large, are outside of the span.
#[test]
fn frames_outside_of_the_span_are_not_checked() {
    let folder = tempfile::tempdir().expect("a folder");
    let paths = ["layout.csv", "frames.csv"].map(|name| folder.path().join(name));
    let frames = "t_s,c0,c1\n0,60000,1\n1,2,3\n1.01,4,5\n1.02,6,7\n3,8,9\n";
    std::fs::write(&paths[0], LAYOUT).and_then(|()| std::fs::write(&paths[1], frames)).expect("written");
    let span = Span { from_s: 0.5, to_s: 2.0 };
    let recording = csv::import(&paths[0], &paths[1], Side::Left, span, None, &mut |_, _| {}).unwrap();
    assert_eq!((recording.t_s, recording.pressure_kpa), (vec![1.0, 1.01, 1.02], vec![2.0, 3.0, 4.0, 5.0, 6.0, 7.0]));
    assert!(
        recording
            .source
            .ends_with("only the frames from 0.5 to 2 s of this measurement. Frames that were left out: 2.")
    );
    let span = Span { to_s: 1.01, ..span };
    let short = csv::import(&paths[0], &paths[1], Side::Left, span, None, &mut |_, _| {}).unwrap();
    assert_eq!(short.frames(), 2);
    // A message names the line of the file.
    let span = Span { from_s: 0.0, to_s: 1.01 };
    let error =
        csv::import(&paths[0], &paths[1], Side::Left, span, Some(50.0), &mut |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("frames.csv:3"), "{error}");
}

/// Resampling would refuse the longer gap, too.
#[test]
fn the_error_for_a_gap_in_time_offers_resampling_only_if_it_accepts_the_gap() {
    for (after_s, is_offered) in [(0.06, true), (0.2, false)] {
        let frames = format!("{FRAMES}{after_s},1,1\n{},1,1\n", after_s + 0.01);
        let error = import_at(None, LAYOUT, &frames).unwrap_err().to_string();
        assert!(error.contains("frames.csv:5") && error.contains("split the recording at this frame"), "{error}");
        assert_eq!(error.contains("--rate"), is_offered, "{error}");
    }
}

/// Both pressures are linear functions of time, so that linear interpolation is exact.
#[test]
fn times_with_jitter_are_resampled_and_gaps_are_not() {
    let text = |t_s: &[f64]| {
        let row = |t_s: &f64| format!("{t_s:.4},{:.4},{:.4}\n", 10.0 * t_s, 50.0 - t_s);
        format!("t_s,c0,c1\n{}", t_s.iter().map(row).collect::<String>())
    };
    let mut t_s: Vec<f64> = (0..=300).map(|i| f64::from(i / 3) * 0.03 + [0.0, 0.01, 0.026][i as usize % 3]).collect();
    assert_refused(LAYOUT, &text(&t_s), &["frames.csv:4:", "0.016000 s after", "plantar import csv", "--rate"]);
    let recording = import_at(Some(50.0), LAYOUT, &text(&t_s)).unwrap();
    assert_eq!((recording.rate_hz, recording.frames()), (50.0, 151));
    assert!(recording.source.contains("times the median one"), "{}", recording.source);
    assert!(recording.source.contains(": 100. The longest one is 0.0160 s."), "{}", recording.source);
    for (i, now_s) in recording.t_s.iter().enumerate() {
        assert!((now_s - 0.02 * i as f64).abs() < 1e-9, "frame {i} at {now_s} s");
        let expected_kpa = [10.0 * now_s, 50.0 - now_s];
        for (kpa, expected_kpa) in recording.frame(i).iter().zip(expected_kpa) {
            assert!((f64::from(*kpa) - expected_kpa).abs() < 1e-3, "frame {i}: {kpa} kPa, not {expected_kpa} kPa");
        }
    }
    t_s.iter_mut().skip(150).for_each(|t_s| *t_s += 0.2);
    let error = import_at(Some(50.0), LAYOUT, &text(&t_s)).unwrap_err().to_string();
    for part in ["frames.csv:152:", "at most 0.10 s", "split the recording"] {
        assert!(error.contains(part), "`{part}` not in: {error}");
    }
}

#[test]
fn fewer_than_two_frames_are_rejected() {
    assert_refused(LAYOUT, "t_s,c0,c1\n", &["frames.csv", "no frames", "at least two"]);
    assert_refused(LAYOUT, "t_s,c0,c1\n0,1,1\n", &["frames.csv", "single frame"]);
}

#[test]
fn the_error_names_a_missing_file() {
    let error = csv::import("nowhere.csv", "nothing.csv", Side::Left, Span::default(), None, &mut |_, _| {})
        .unwrap_err()
        .to_string();
    assert!(error.starts_with("nowhere.csv: "), "{error}");
}

#[test]
fn times_that_cannot_be_seconds_are_rejected() {
    let frames = "t_s,c0,c1\n-1e308,0,0\n1e308,0,0\n";
    assert_refused(LAYOUT, frames, &["frames.csv:2", "-1", "number of seconds from -1e10 to 1e10"]);
}

//! The import of computed files in the format of Moticon OpenGo.

mod common;

use common::assert_message;
use plantar::{Region, Side};
use recording::{Export, Format, Options, Result, Span};
use std::path::Path;

/// Areas of the cells, cm².
const AREAS_CM2: [f64; 16] =
    [12.4, 11.1, 13.4, 13.1, 13.1, 13.0, 18.0, 18.2, 15.7, 12.4, 12.5, 12.7, 10.2, 10.1, 12.5, 6.4];

/// Pressure of a cell in a frame, N/cm². The peaks of the cells are at different times.
fn pressure_n_cm2(frame: usize, cell: usize) -> f64 {
    let distance = (frame as f64 - 6.0 * cell as f64 - 10.0) / 20.0;
    // The export has a resolution of 0.25 N/cm².
    (30.0 * (1.0 - distance * distance).max(0.0) * 4.0).round() / 4.0
}

/// The force on all cells in a frame, N.
fn total_n(frame: usize) -> f64 {
    (0..16).map(|cell| pressure_n_cm2(frame, cell) * AREAS_CM2[cell]).sum::<f64>()
}

/// A file of both feet. The right foot lacks the frames `lost`.
fn text(lost: &[usize]) -> String {
    let mut text = "# Start time: 27.09.2023 10:21:14.922\n# Size: 7\n# time".to_owned();
    for side in ["left", "right"] {
        for cell in 1..=16 {
            text += &format!("\t{side} pressure {cell}[N/cm²]");
        }
        text += &format!("\t{side} acceleration X[g]\t{side} total force[N]");
    }
    text += "\n";
    for frame in 0..150 {
        text += &format!("{:.2}", frame as f64 * 0.01);
        for foot in 0..2 {
            if foot == 1 && lost.contains(&frame) {
                text += &"\t".repeat(18);
                continue;
            }
            for cell in 0..16 {
                text += &format!("\t{:.2}", pressure_n_cm2(frame, cell));
            }
            text += &format!("\t0.01\t{:.2}", total_n(frame).round());
        }
        text += "\n";
    }
    text
}

fn parse(text: &str) -> Result<Export> {
    common::parse(Format::Moticon, "walk.txt", text.as_bytes(), None)
}

#[test]
fn the_areas_and_the_total_force_are_recovered() {
    let export = parse(&text(&[])).unwrap();
    assert_eq!(export.feet.iter().map(|foot| foot.side).collect::<Vec<_>>(), [Side::Left, Side::Right]);
    for foot in &export.feet {
        let errors = (0..foot.frames()).map(|i| (foot.force_n(i) - total_n(i)).powi(2));
        let rms_n = (errors.sum::<f64>() / foot.frames() as f64).sqrt();
        assert!(rms_n < 0.5, "{rms_n} N");
        for (cell, area_cm2) in foot.layout.cells.iter().zip(AREAS_CM2) {
            assert!((cell.area_mm2 / (100.0 * area_cm2) - 1.0).abs() < 0.01, "{} mm2", cell.area_mm2);
        }
        for region in Region::ALL {
            assert!(foot.layout.cells.iter().any(|cell| cell.region == region), "{region:?}");
        }
        assert_eq!(foot.layout.cells[0].region, Region::Heel);
        assert_eq!(foot.layout.cells[13].region, Region::Hallux);
        assert!(foot.layout.cells[0].x_mm < foot.layout.cells[1].x_mm, "the first cell is medial");
    }
}

#[test]
fn the_source_states_the_time_and_the_size() {
    for foot in parse(&text(&[])).unwrap().feet {
        let stated = "Measured at `27.09.2023 10:21:14.922`. The export states size 7.";
        assert!(foot.source.contains(stated), "{}", foot.source);
    }
}

#[test]
fn lost_frames_are_interpolated_and_those_at_the_beginning_are_left_out() {
    let export = parse(&text(&[0, 1, 2, 60, 61])).unwrap();
    let [left, right] = &export.feet[..] else { panic!("two feet") };
    assert_eq!((left.frames(), right.frames()), (150, 147));
    // Both feet have the same clock.
    assert!((right.t_s[0] - 0.03).abs() < 1e-9 && left.t_s[0] == 0.0);
    let expected = |share: f64| total_n(59) * (1.0 - share) + total_n(62) * share;
    assert!((right.force_n(57) - expected(1.0 / 3.0)).abs() < 1.0);
    assert!(
        export.remarks.iter().any(|r| r.starts_with("Right foot: Lost frames that were interpolated linearly: 2")),
        "{:?}",
        export.remarks
    );
}

/// The right foot lacks the frames from 0.8 to 0.99 s. Alone, only its longest part remains; the span selects the other one, of
/// both feet, in the same layout.
#[test]
fn a_span_selects_the_frames_of_both_feet_before_a_gap_is_searched_for() {
    let text = text(&(80..100).collect::<Vec<_>>());
    let whole = parse(&text).unwrap();
    let [left, right] = &whole.feet[..] else { panic!("two feet") };
    assert_eq!((left.frames(), right.frames(), right.t_s[79]), (150, 80, 0.79));
    let remark = "only the longest part without such a gap was imported, 0 to 0.79 s. Frames that were left out: 50.";
    assert!(right.source.contains(remark) && !left.source.contains(remark), "{}", right.source);

    let options = Options { span: Span { from_s: 1.0, to_s: 1.4 }, ..Options::default() };
    let later = Format::Moticon.parse(text.as_bytes(), Path::new("walk.txt"), options).unwrap();
    for (foot, whole) in later.feet.iter().zip(&whole.feet) {
        assert_eq!((foot.frames(), foot.t_s[0], foot.t_s[40]), (41, 1.0, 1.4));
        assert_eq!(foot.layout, whole.layout);
        for i in 0..41 {
            assert!((foot.force_n(i) - total_n(100 + i)).abs() < 1.0, "frame {i}");
        }
        assert!(
            foot.source.contains("foot: The recording has only the frames from 1 to 1.4 s of this measurement."),
            "{}",
            foot.source
        );
        assert!(!foot.source.contains("Frames are missing"), "{}", foot.source);
    }
    let options = Options { span: Span { from_s: 1.5, ..Span::default() }, ..Options::default() };
    let nothing = Format::Moticon.parse(text.as_bytes(), Path::new("walk.txt"), options);
    assert_message(
        nothing,
        "walk.txt: no frame from 1.5 s; the frames are from 0 to 1.49 s",
        &["state times within these"],
    );
}

#[test]
fn a_measurement_with_few_loaded_cells_has_typical_areas_for_the_others() {
    // Only the frames from 0.10 s to 0.19 s.
    let standing: String = text(&[])
        .lines()
        .filter(|line| line.starts_with('#') || line.starts_with("0.1"))
        .map(|line| format!("{line}\n"))
        .collect();
    let export = parse(&standing).unwrap();
    for cell in &export.feet[0].layout.cells {
        assert!((400.0..2500.0).contains(&cell.area_mm2), "{} mm2", cell.area_mm2);
    }
}

#[test]
fn damaged_files_are_refused_with_the_line_and_a_remedy() {
    let text = text(&[]);
    let changed = |from: &str, to: &str| parse(&text.replacen(from, to, 1));
    assert_message(changed("# time", "# hour"), "walk.txt: ", &["# time"]);
    assert_message(changed("pressure 3[N/cm²]", "pressure 3[psi]"), "walk.txt:3: ", &["N/cm²"]);
    assert_message(changed("left pressure 3[N/cm²]", "left pressure[N/cm²]"), "walk.txt:3: ", &["16"]);
    assert_message(changed("left total force", "left force"), "walk.txt:3: ", &["total force"]);
    assert_message(changed("\n0.01\t", "\n0.00\t"), "walk.txt:5: ", &["repeated"]);
    assert_message(changed("\n0.01\t", "\nsoon\t"), "walk.txt:5: ", &["soon"]);
    assert_message(parse(&text[..text.len() - 40]), "walk.txt:153: ", &["columns", "cut off"]);
    assert_message(parse(text.lines().take(3).collect::<Vec<_>>().join("\n").as_str()), "walk.txt: ", &["no frame"]);
}

#[test]
fn another_unit_of_the_total_force_is_refused_and_ascii_names_of_units_are_read() {
    let text = text(&[]);
    assert_message(parse(&text.replace("total force[N]", "total force[lbf]")), "walk.txt:3: ", &["[lbf]", "in N"]);
    assert_eq!(parse(&text.replace("N/cm²", "N/cm2")).unwrap().feet, parse(&text).unwrap().feet);
    let with_tabs = text.lines().map(|line| format!("{line}{}\n", if line.starts_with('#') { "" } else { "\t" }));
    assert_eq!(parse(&with_tabs.collect::<String>()).unwrap().feet, parse(&text).unwrap().feet);
}

//! The import of computed files in the format of emed.

mod common;

use common::{COLUMNS, ROWS, STANCE, assert_message, assert_step, exported_frames, force_n, pressure_kpa};
use plantar::Side;
use recording::{Export, Format, Result};

/// Area of a cell, mm2.
const CELL_MM2: f64 = 100.0;
/// The number of the first row and column in the table.
const FIRST: usize = 20;

/// A page with a frame. If `is_turned`, the picture is turned by 180 degrees: the person walks towards its lower edge.
fn page(side: Side, frame: usize, title: &str, is_turned: bool) -> String {
    let kpa = |row: usize, column: usize| match is_turned {
        true => pressure_kpa(side, frame, ROWS - 1 - row, COLUMNS - 1 - column),
        false => pressure_kpa(side, frame, row, column),
    };
    let columns: Vec<_> = (0..COLUMNS).map(|column| (FIRST + column).to_string()).collect();
    let mut text = format!(
        "\n\t\t\t\tPage {0}\n\n\tFile: 2.dat \tMatrix: 64x95 \n\tSensor area: 1.00 cm²\tTime/picture:10.0 ms\n\tMV over frames\n\
         \tSensor size: 1.000x1.000 cm\n\tnovel munich\n{title}\n\n\t{1}\tForce\n",
        frame + 1,
        columns.join("\t")
    );
    let mut columns_n = [0.0; COLUMNS];
    for row in 0..ROWS {
        let values: Vec<f64> = (0..COLUMNS).map(|column| kpa(row, column)).collect();
        columns_n.iter_mut().zip(&values).for_each(|(sum, kpa)| *sum += kpa * CELL_MM2 * 1e-3);
        let force = values.iter().sum::<f64>() * CELL_MM2 * 1e-3;
        let fields: Vec<_> = values.iter().map(|kpa| format!("{kpa:.2}")).collect();
        text += &format!("{}\t{}\t{force:.2}\n", FIRST + row, fields.join("\t"));
    }
    let fields: Vec<_> = columns_n.iter().map(|n| format!("{n:.2}")).collect();
    text + &format!("Force\t{}\t{:.2}\n\x0c", fields.join("\t"), force_n(side, frame, CELL_MM2))
}

/// A file with a step and a summary page (MVP), which is no frame, in Latin-1 as the vendor's program writes it.
fn file(side: Side, is_turned: bool) -> Vec<u8> {
    let mut text = String::new();
    for frame in 0..STANCE {
        text += &page(side, frame, &format!("\tPict-No.: {frame}  Force[N]=sum*sensor_area in row/column"), is_turned);
    }
    text += &page(side, 30, "\tMVP  Force[N]=sum*sensor_area in row/column", is_turned);
    text.chars().map(|c| c as u8).collect()
}

fn parse(bytes: &[u8]) -> Result<Export> {
    common::parse(Format::Emed, "step.lst", bytes, None)
}

/// Number of unloaded frames that the import adds before and after those of the file: 0.4 s.
const ADDED: usize = 40;

#[test]
fn a_step_that_is_loaded_in_the_first_picture_begins_after_frames_without_load() {
    let export = parse(&file(Side::Right, false)).unwrap();
    let foot = &export.feet[0];
    assert_eq!(foot.frames(), ADDED + STANCE + ADDED);
    assert!((0..ADDED).chain(ADDED + STANCE..foot.frames()).all(|frame| foot.force_n(frame) == 0.0));
    assert!(foot.force_n(ADDED) > 70.0, "{} N", foot.force_n(ADDED));
    assert!(foot.t_s.iter().enumerate().all(|(i, t_s)| (t_s - i as f64 * 0.01).abs() < 1e-9), "{:?}", foot.t_s);
    assert!(foot.source.contains("0.4 s without load"), "{}", foot.source);
}

#[test]
fn an_export_that_ends_within_the_contact_is_imported_with_a_remark() {
    let whole = file(Side::Right, false);
    let half: Vec<u8> = whole.split_inclusive(|&byte| byte == 0x0c).take(STANCE / 2).flatten().copied().collect();
    for (bytes, has_remark) in [(whole, false), (half, true)] {
        let remarks = parse(&bytes).unwrap().remarks;
        assert_eq!(remarks.iter().any(|remark| remark.contains("last frame carries")), has_remark, "{remarks:?}");
    }
}

#[test]
fn a_step_is_imported_in_both_directions_of_walking_and_its_foot_is_recognised() {
    for side in [Side::Left, Side::Right] {
        for is_turned in [false, true] {
            let export = parse(&file(side, is_turned)).unwrap();
            assert!((export.feet[0].rate_hz - 100.0).abs() < 1e-6);
            assert_step(&exported_frames(&export.feet[0], ADDED), side, CELL_MM2, 1e-6);
            let remarks = export.remarks.join(" ");
            assert!(remarks.contains("60 frames") && remarks.contains("One page without a frame"), "{remarks}");
            assert!(remarks.contains(side.name()), "{remarks}");
        }
    }
}

#[test]
fn the_name_of_the_file_states_the_foot_and_a_contradiction_has_a_remark() {
    let import = |name, side, stated| common::parse(Format::Emed, name, &file(side, false), stated).unwrap();
    for (name, side) in [("S1_L.lst", Side::Left), ("step right.lst", Side::Right)] {
        let export = import(name, side, None);
        assert_step(&exported_frames(&export.feet[0], ADDED), side, CELL_MM2, 1e-6);
        assert!(!export.remarks.join(" ").contains("--side"), "{:?}", export.remarks);
        assert!(export.feet[0].source.contains("not on one clock"), "{}", export.feet[0].source);
    }
    let wrong = import("S1_L.lst", Side::Right, None);
    assert_eq!(wrong.feet[0].side, Side::Left);
    let remarks = wrong.remarks.join(" ");
    assert!(remarks.contains("it is the left foot") && remarks.contains("shape of the right foot"), "{remarks}");
    let corrected = import("S1_L.lst", Side::Right, Some(Side::Right));
    assert_step(&exported_frames(&corrected.feet[0], ADDED), Side::Right, CELL_MM2, 1e-6);
    let remarks = corrected.remarks.join(" ");
    assert!(remarks.contains("one of the left foot") && !remarks.contains("shape"), "{remarks}");
}

/// The load moves from the heel to the toes, and is the same on both sides of the foot.
#[test]
fn a_symmetric_footprint_does_not_show_the_foot() {
    let page = |frame: usize| {
        let row = |row: usize| {
            let kpa = if (11 - row).abs_diff(frame) <= 2 { 100 } else { 0 };
            format!("{row}\t{kpa}\t{kpa}\t{kpa}\n")
        };
        let rows: String = (0..12).map(row).collect();
        format!("\tTime/picture:10.0 ms\n\tSensor size: 2.000x2.000 cm\n\tPict-No.: {frame}\n\t1\t2\t3\n{rows}\x0c")
    };
    let export = parse((0..12).map(page).collect::<String>().as_bytes()).unwrap();
    assert_eq!(export.feet[0].side, Side::Right);
    let remarks = export.remarks.join(" ");
    assert!(remarks.contains("assumed to be the right foot") && remarks.contains("--side"), "{remarks}");
    assert!(!remarks.contains("By the shape"), "{remarks}");
}

#[test]
fn missing_pictures_are_interpolated_and_exchanged_ones_are_refused() {
    let whole = parse(&file(Side::Right, false)).unwrap();
    let mut pages =
        file(Side::Right, false).split_inclusive(|&byte| byte == 0x0c).map(<[u8]>::to_vec).collect::<Vec<_>>();
    pages.drain(10..14);
    let export = parse(&pages.concat()).unwrap();
    let (t_s, whole_s) = (&export.feet[0].t_s, &whole.feet[0].t_s);
    assert_eq!(t_s.len(), whole_s.len());
    assert!(t_s.iter().zip(whole_s).all(|(t_s, whole_s)| (t_s - whole_s).abs() < 1e-9), "{t_s:?}");
    assert!(export.remarks.iter().any(|remark| remark.contains("interpolated linearly: 4")), "{:?}", export.remarks);
    pages.swap(1, 2);
    assert_message(parse(&pages.concat()), "step.lst:", &["picture 1", "on its own"]);
}

/// The times of the frames are rounded, so that the mean interval may be slightly below the limit.
#[test]
fn the_shortest_time_between_frames_is_a_tenth_of_a_millisecond() {
    let text: String = file(Side::Right, false).into_iter().map(char::from).collect();
    let export = parse(text.replace("picture:10.0 ms", "picture:0.1 ms").as_bytes()).unwrap();
    assert!((export.feet[0].rate_hz / 1e4 - 1.0).abs() < 1e-6, "{} Hz", export.feet[0].rate_hz);
}

#[test]
fn a_negative_pressure_is_read_as_zero_with_a_remark() {
    let text: String = file(Side::Right, false).into_iter().map(char::from).collect();
    let export = parse(text.replacen("\n20\t0.00\t", "\n20\t-1.25\t", 1).as_bytes()).unwrap();
    let remarks = export.remarks.join(" ");
    let [mut foot, mut clean] =
        [export, parse(&file(Side::Right, false)).unwrap()].map(|export| export.feet[0].clone());
    assert!(foot.source.contains("The lowest one is -1.25 kPa"), "{}", foot.source);
    (foot.source, clean.source) = (String::new(), String::new());
    assert_eq!(foot, clean);
    assert!(
        remarks.contains("right foot") && remarks.contains("together: 1. The lowest one is -1.25 kPa"),
        "{remarks}"
    );
}

#[test]
fn damaged_files_are_refused_with_the_line_and_a_remedy() {
    let text: String = file(Side::Right, false).into_iter().map(char::from).collect();
    let changed = |from: &str, to: &str| parse(text.replacen(from, to, 1).as_bytes());
    let first_row = text.lines().position(|line| line.starts_with("20\t")).unwrap() + 1;
    let at = |line: usize| format!("step.lst:{line}: ");
    assert_message(changed("\n20\t0.00\t", "\n20\t9.00\t"), &at(first_row), &["0.90 N", "Force"]);
    assert_message(changed("\n20\t0.00\t", "\n20\t"), &at(first_row), &["11 values"]);
    assert_message(changed("\n20\t", "\n9999999\t"), &at(first_row), &["9999999", "row"]);
    assert_message(changed("\n20\t0.00\t", "\n20\tNaN\t"), &at(first_row), &["NaN", "number"]);
    assert_message(changed("\n21\t", "\n20\t"), &at(first_row + 1), &["row number is repeated", "damaged"]);
    assert_message(changed("\t20\t21\t", "\t20\t20\t"), &at(first_row - 1), &["column number is repeated", "damaged"]);
    let forces = text.lines().position(|line| line.starts_with("Force\t")).unwrap();
    let total = text.lines().nth(forces).and_then(|line| line.rsplit('\t').next()).unwrap();
    assert_message(changed(&format!("\t{total}\n\x0c"), "\t999.00\n\x0c"), &at(forces + 1), &["999.00 N", "Force"]);
    let cut: String = text.split_inclusive('\n').take(forces).collect();
    assert_message(parse(cut.as_bytes()), &at(first_row - 1), &["total Force", "cut off"]);
    // The last page ends before or within the line with the numbers of the columns.
    let second = text.find('\x0c').unwrap() + 1;
    let cut_within_second = |part: &str| parse(&text.as_bytes()[..second + text[second..].find(part).unwrap()]);
    let first_line = text[..second].matches('\n').count() + 1;
    let columns = text[second..].lines().position(|line| line.starts_with("\t20\t21")).unwrap();
    assert_message(cut_within_second("\t20\t21"), &at(first_line), &["picture has no table", "cut off"]);
    assert_message(cut_within_second("\t24\t25"), &at(first_line + columns), &["no rows", "cut off"]);
    assert_message(changed("1.000x1.000 cm", "1.000x1.000 cubits"), &at(7), &["cubits"]);
    assert_message(changed("Time/picture:10.0 ms", "Time/picture:10.0 min"), &at(5), &["10.0 min", "unit"]);
    // The area is used only without a size.
    assert!(changed("1.00 cm²", "1.00 in²").is_ok());
    let without_size = text.replace("\tSensor size: 1.000x1.000 cm\n", "").replacen("1.00 cm²", "1.00 in²", 1);
    assert_message(parse(without_size.as_bytes()), &at(5), &["1.00 in²", "unit"]);
    assert_message(changed("Time/picture:10.0 ms", ""), &at(1), &["time between pictures"]);
    assert_message(changed("picture:10.0 ms", "picture:0.05 ms"), &at(5), &["5e-5 s", "1e-4 to 0.5 s"]);
    assert_message(changed("picture:10.0 ms", "picture:0 ms"), &at(5), &["every 0 s"]);
    assert_message(parse(b"File: 2.dat\nMVP\n"), "step.lst: ", &["no page"]);
    assert_message(parse(b""), "step.lst: ", &["empty"]);
}

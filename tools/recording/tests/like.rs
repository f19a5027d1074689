//! Imports in the layout of an earlier recording, of computed files and of recordings of people.

mod common;

use common::{COLUMNS, ROWS, STANCE, SWING, assert_message, pressure_kpa};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::{Region, Side};
use recording::{
    Cell, EarlierRecording, Export, FootZero, Format, Layout, Options, Recording, Result, StandingTrial, VirtualInsole,
};
use std::collections::BTreeMap;
use std::path::Path;

/// Side of a cell, mm.
const PITCH_MM: f64 = 10.16;
/// Frames of a computed step, and those in which it loads only heel and midfoot.
const STEP: usize = STANCE + SWING;
const EARLY: usize = 24;

/// A pressure, kPa, by frame, row and column.
type Pressure<'a> = &'a dyn Fn(usize, usize, usize) -> f64;

/// The Tekscan export of an insole with this number of frames, at this rate.
fn insole(side: Side, frames: usize, rate_hz: f64, pressure: Pressure<'_>) -> String {
    let mut text = format!(
        "FILENAME C:\\walks\\step{}.fsx\nSENSOR_TYPE F-SCAN\nROWS {ROWS}\nCOLS {COLUMNS}\nROW_SPACING {PITCH_MM} mm\n\
         COL_SPACING {PITCH_MM} mm\nSECONDS_PER_FRAME {}\nUNITS KPa\nASCII_DATA @@\n",
        if side == Side::Left { "L" } else { "R" },
        1.0 / rate_hz
    );
    for frame in 0..frames {
        text += &format!("Frame {}\n", frame + 1);
        for row in 0..ROWS {
            let fields = (0..COLUMNS).map(|column| format!("{:.2}", pressure(frame, row, column)));
            text += &fields.collect::<Vec<_>>().join(",");
            text += "\n";
        }
    }
    text
}

/// The export of the first frames of a step.
fn step(side: Side, frames: usize) -> String {
    insole(side, frames, 100.0, &|frame, row, column| pressure_kpa(side, frame, row, column))
}

fn parse_like(format: Format, text: &str, side: Option<Side>, earlier: &[EarlierRecording]) -> Result<Export> {
    format.parse(text.as_bytes(), Path::new("walk.asf"), Options { side, earlier, ..Options::default() })
}

/// The recording of the only foot of a Tekscan export, with the layout of an earlier recording, if there is one.
fn import(text: &str, earlier: &[EarlierRecording]) -> Recording {
    let export = parse_like(Format::Tekscan, text, None, earlier).expect("the export is read");
    let [foot] = <[Recording; 1]>::try_from(export.feet).expect("one foot");
    foot
}

/// The recording as an earlier one of this name, which was written and is read.
fn earlier_as(recording: &Recording, name: &str) -> EarlierRecording {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(name);
    recording.write(&path).expect("written");
    EarlierRecording::open(&path).expect("a recording")
}

fn earlier(recording: &Recording) -> [EarlierRecording; 1] {
    [earlier_as(recording, "first.parquet")]
}

/// The row and the column of each cell of a step's recording. They follow from the positions, because the sensors that a step
/// loads are known.
fn sensors(layout: &Layout, side: Side) -> Vec<(usize, usize)> {
    let is_loaded = |row, column| (0..STANCE).any(|frame| pressure_kpa(side, frame, row, column) > 0.0);
    let first_row = (0..ROWS).find(|&row| (0..COLUMNS).any(|column| is_loaded(row, column))).expect("a row");
    let is_loaded_column = |&column: &usize| (0..ROWS).any(|row| is_loaded(row, column));
    let medial =
        if side == Side::Right { (0..COLUMNS).find(is_loaded_column) } else { (0..COLUMNS).rfind(is_loaded_column) };
    let front_mm = layout.cells.iter().map(|cell| cell.y_mm).fold(0.0, f64::max);
    let medial_mm = layout.cells.iter().map(|cell| cell.x_mm).fold(f64::INFINITY, f64::min);
    let sensor = |cell: &Cell| {
        let row = first_row + ((front_mm - cell.y_mm) / PITCH_MM).round() as usize;
        let lateral = ((cell.x_mm - medial_mm) / PITCH_MM).round() as usize;
        let medial = medial.expect("a column");
        (row, if side == Side::Right { medial + lateral } else { medial - lateral })
    };
    layout.cells.iter().map(sensor).collect()
}

#[test]
fn a_part_of_a_step_has_the_layout_of_the_whole_step() {
    for side in [Side::Left, Side::Right] {
        let (whole, part) = (step(side, STEP), step(side, EARLY));
        let first = import(&whole, &[]);
        let alone = import(&part, &[]);
        assert_ne!(alone.layout, first.layout);
        let export = parse_like(Format::Tekscan, &part, None, &earlier(&first)).unwrap();
        let like = &export.feet[0];
        assert_eq!(like.layout, first.layout);
        for (frame, t_s) in like.t_s.iter().enumerate() {
            assert_eq!(*t_s, alone.t_s[frame]);
            assert!((like.force_n(frame) - alone.force_n(frame)).abs() < 1e-3, "frame {frame}");
            for (&kpa, (row, column)) in like.frame(frame).iter().zip(sensors(&first.layout, side)) {
                assert_eq!(kpa, pressure_kpa(side, frame, row, column) as f32, "frame {frame}, {row}, {column}");
            }
        }
        let remark = "foot: the cells and regions are those of first.parquet.";
        assert!(export.remarks.iter().any(|found| found.ends_with(remark)), "{:?}", export.remarks);
        // The part of a step alone is remarked on as one of a part of the foot, which is wrong of the layout of a whole one.
        assert!(like.source.ends_with(remark) && alone.source.contains("a part of the foot"), "{}", like.source);
        // A recording that was imported in this way serves for further imports, and so does the same export.
        assert_eq!(
            import(&whole, &earlier(like)),
            Recording { source: import(&whole, &earlier(like)).source, ..first }
        );
    }
}

#[test]
fn both_feet_of_an_export_have_the_layouts_of_a_pair() {
    let text = |frames: usize| {
        let mut text = "Units:,kPa\n".to_owned();
        for frame in 0..frames {
            text += &format!("FRAME,{}\nTime,08:20:{:06.3}\n", frame + 1, 1.0 + frame as f64 * 0.01);
            for (side, name) in [(Side::Left, "LF"), (Side::Right, "RF")] {
                text += &format!("SENSOR,HX-{name}\nRows,{ROWS}\nColumns,{COLUMNS}\nSensel Width (cm),0.86\n");
                text += "Sensel Height (cm),0.97\nSENSELS\n";
                for row in 0..ROWS {
                    let fields = (0..COLUMNS).map(|column| format!("{:.2}", pressure_kpa(side, frame, row, column)));
                    text += &(fields.collect::<Vec<_>>().join(",") + "\n");
                }
            }
        }
        text
    };
    let import = |frames, side, earlier: &[EarlierRecording]| parse_like(Format::Xsensor, &text(frames), side, earlier);
    let first = import(STEP, None, &[]).unwrap().feet;
    let pair: Vec<_> =
        first.iter().map(|foot| earlier_as(foot, &format!("first.{}.parquet", foot.side.name()))).collect();
    let alone = import(EARLY, None, &[]).unwrap().feet;
    let like = import(EARLY, None, &pair).unwrap().feet;
    for ((first, like), alone) in first.iter().zip(&like).zip(&alone) {
        assert_eq!((like.side, &like.layout), (first.side, &first.layout));
        assert_ne!(alone.layout, first.layout);
        assert!((0..EARLY).all(|i| (like.force_n(i) - alone.force_n(i)).abs() < 1e-3));
    }
    assert_eq!(import(EARLY, Some(Side::Right), &pair).unwrap().feet, like[1..]);
    assert_message(
        import(EARLY, None, &pair[..1]),
        "walk.asf: ",
        &[
            "measurement of the right foot",
            "first.left.parquet",
            "recording of the left foot",
            "NAME.right.parquet",
            "--side",
        ],
    );
}

/// One sensor beside the foot, in row 0 and column 10, carries 50 kPa in one frame.
#[test]
fn load_outside_of_the_earlier_layout_is_stated() {
    let side = Side::Right;
    let first = import(&step(side, STEP), &[]);
    let beside = |frame, row, column| match (frame, row, column) {
        (40, 0, 10) => 50.0,
        _ => pressure_kpa(side, frame, row, column),
    };
    assert_eq!((0..STANCE).map(|frame| pressure_kpa(side, frame, 0, 10)).sum::<f64>(), 0.0);
    let text = insole(side, STEP, 100.0, &beside);
    let export = parse_like(Format::Tekscan, &text, None, &earlier(&first)).unwrap();
    let all_kpa: f64 = first.pressure_kpa.iter().map(|&kpa| f64::from(kpa)).sum();
    let percent = 100.0 * 50.0 / (all_kpa + 50.0);
    // 50 kPa on 103.2 mm2 are 5.2 N.
    let remark = format!(
        "carry load, which was left out: 1, {percent:.2} % of the load of all frames, and at most 5.2 N in a frame."
    );
    assert!(export.remarks.iter().any(|found| found.ends_with(&remark)), "{remark}: {:?}", export.remarks);
    assert!(export.feet[0].source.ends_with(&remark));
    assert_eq!(export.feet[0].pressure_kpa, first.pressure_kpa);
}

#[test]
fn a_considerable_load_outside_of_the_earlier_layout_is_refused() {
    let heel = import(&step(Side::Right, EARLY), &[]);
    let text = step(Side::Right, STEP);
    let whole = import(&text, &[]);
    let sum_kpa = |(row, column): (usize, usize), frames: usize| -> f64 {
        (0..frames).map(|frame| pressure_kpa(Side::Right, frame, row, column)).sum()
    };
    let (of_heel, others): (Vec<_>, Vec<_>) =
        sensors(&whole.layout, Side::Right).into_iter().partition(|&sensor| sum_kpa(sensor, EARLY) > 0.0);
    assert_eq!(of_heel.len(), heel.cells());
    let [heel_kpa, other_kpa] =
        [&of_heel, &others].map(|sensors| sensors.iter().map(|&sensor| sum_kpa(sensor, STANCE)).sum::<f64>());
    let percent = 100.0 * other_kpa / (heel_kpa + other_kpa);
    assert_message(
        parse_like(Format::Tekscan, &text, None, &earlier(&heel)),
        "walk.asf: ",
        &[&format!("{percent:.1} % of the load"), &format!("{} sensors", others.len()), "first.parquet", "a walk"],
    );
}

/// The reading of an unloaded sensor, kPa.
fn offset_kpa(row: usize, column: usize) -> f64 {
    let is_loaded = (0..STANCE).any(|frame| pressure_kpa(Side::Right, frame, row, column) > 0.0);
    if is_loaded { ((row + 2 * column) % 4) as f64 * 3.0 } else { 0.0 }
}

/// A trial of 6 s with the foot lifted, 12 s of standing and 6 s with the foot lifted, at 25 Hz. The person stands on the heel
/// and the forefoot, so that the toes and the arch carry no load.
fn standing() -> String {
    insole(Side::Right, 600, 25.0, &|frame, row, column| {
        let stands = (150..450).contains(&frame);
        let load_kpa = |frame| 0.4 * pressure_kpa(Side::Right, frame, row, column);
        offset_kpa(row, column) + if stands { load_kpa(12).max(load_kpa(42)) } else { 0.0 }
    })
}

fn virtual_insole(recording: &Recording) -> VirtualInsole {
    VirtualInsole::new(recording, ContactRule::COUNTED, StanceRule::ADAPTIVE)
}

#[test]
fn the_zero_of_a_standing_trial_applies_to_the_walk_of_its_layout() {
    let side = Side::Right;
    let walk = insole(side, 2 * STEP, 100.0, &|frame, row, column| {
        pressure_kpa(side, frame % STEP, row, column) + offset_kpa(row, column)
    });
    let walk = import(&walk, &[]);
    let measured = |standing: &Recording| {
        let trial = StandingTrial::find(standing, "standing").expect("a standing trial");
        FootZero::measure(standing, &trial, "standing").expect("a zero")
    };
    // The layouts of the two differ, because the sensors without an offset that carry load do.
    let alone = measured(&import(&standing(), &[]));
    let error = alone.apply_to(&mut virtual_insole(&walk), "zero.toml").expect_err("refused").to_string();
    assert!(error.contains("other cells") && error.contains("--like"), "{error}");

    let standing = import(&standing(), &earlier(&walk));
    let zero = measured(&standing);
    let mut insole = virtual_insole(&walk);
    zero.apply_to(&mut insole, "zero.toml").expect("the same layout");
    for frame in [0, 12, 42, STANCE + 5] {
        for (kpa, (row, column)) in insole.measured_kpa(walk.frame(frame)).into_iter().zip(sensors(&walk.layout, side))
        {
            let true_kpa = pressure_kpa(side, frame, row, column);
            assert!(
                (f64::from(kpa) - true_kpa).abs() < 0.3,
                "frame {frame}, {row}, {column}: {kpa}, not {true_kpa} kPa"
            );
        }
    }
}

#[test]
fn another_sensor_is_refused() {
    let text = step(Side::Right, EARLY);
    let first = import(&step(Side::Right, STEP), &[]);
    let refused = |text: &str, earlier: &[EarlierRecording], words: &[&str]| {
        let error = parse_like(Format::Tekscan, text, None, earlier).expect_err("refused").to_string();
        words.iter().for_each(|word| assert!(error.contains(word), "`{word}` is not in: {error}"));
    };
    let left = import(&step(Side::Left, STEP), &[]);
    refused(&text, &earlier(&left), &["walk.asf: ", "right foot", "first.parquet", "left foot"]);
    let other_type = text.replace("F-SCAN", "FSCAN 3000");
    refused(
        &other_type,
        &earlier(&first),
        &["first.parquet: ", "`Tekscan F-SCAN, 30 x 11 cells`", "`Tekscan FSCAN 3000"],
    );
    let with_another_column = |line: &str| match line.starts_with(|c: char| c.is_ascii_digit()) {
        true => format!("{line},0\n"),
        false => format!("{line}\n").replace("COLS 11", "COLS 12"),
    };
    let wider: String = text.lines().map(with_another_column).collect();
    refused(&wider, &earlier(&first), &["first.parquet: ", "30 x 11", "30 x 12", "leave out --like"]);
    let other_pitch = text.replace("ROW_SPACING 10.16", "ROW_SPACING 10.00");
    refused(&other_pitch, &earlier(&first), &["first.parquet: ", "rows", "10.160 mm", "10.000 mm"]);
    let in_inches = text.replace("10.16 mm", "0.4 inches");
    assert_eq!(import(&in_inches, &earlier(&first)).layout, first.layout);
}

#[test]
fn a_recording_without_rows_and_columns_is_refused_with_the_remedy() {
    let text = step(Side::Right, STEP);
    let first = import(&text, &[]);
    let without = Recording { layout: Layout { sheet: None, ..first.layout.clone() }, ..first.clone() };
    let refused = |recording: &Recording, words: &[&str]| {
        let error = parse_like(Format::Tekscan, &text, None, &earlier(recording)).expect_err("refused").to_string();
        assert!(error.contains("first.parquet: ") && error.contains("import that measurement again"), "{error}");
        words.iter().for_each(|word| assert!(error.contains(word), "`{word}` is not in: {error}"));
    };
    refused(&without, &["rows and columns", "an earlier version"]);
    refused(&first.binned(64).expect("64 cells"), &["64 cells", "--cells"]);
    let mut moved = first.clone();
    moved.layout.cells[5].x_mm += 3.0;
    refused(&moved, &["not in the rows and columns"]);
    let mut twice = first;
    twice.layout.cells[5] = twice.layout.cells[6];
    refused(&twice, &["not in the rows and columns"]);
}

#[test]
fn formats_without_a_fitted_insole_are_refused() {
    let first = earlier(&import(&step(Side::Right, STEP), &[]));
    for (format, words) in [
        (Format::Emed, "plate or mat"),
        (Format::Footscan, "plate or mat"),
        (Format::Pliance, "plate or mat"),
        (Format::Loadsol, "the same in all recordings"),
        (Format::Gaitpdb, "the same in all recordings"),
    ] {
        assert_message(parse_like(format, "", None, &first), "walk.asf: ", &[words, "leave out --like"]);
    }
    let plate = step(Side::Right, STEP).replace("F-SCAN", "HR MAT");
    assert_message(
        parse_like(Format::Tekscan, &plate, None, &first),
        "walk.asf: ",
        &["plate or mat", "leave out --like"],
    );
}

/// Areas of the cells of a Moticon insole, cm2.
const AREAS_CM2: [f64; 16] =
    [12.4, 11.1, 13.4, 13.1, 13.1, 13.0, 18.0, 18.2, 15.7, 12.4, 12.5, 12.7, 10.2, 10.1, 12.5, 6.4];

/// A Moticon export of the right foot with cells of these areas times `scale`, in which the cells are loaded one after the other,
/// beginning with frame `start`. The total forces are rounded, so that the areas depend on the frames.
fn moticon(start: usize, scale: f64) -> String {
    let mut text = "# time".to_owned();
    (1..=16).for_each(|cell| text += &format!("\tright pressure {cell}[N/cm²]"));
    text += "\tright total force[N]\n";
    for frame in start..start + 60 {
        let n_cm2: [f64; 16] = std::array::from_fn(|cell| {
            let distance = (frame as f64 - 6.0 * cell as f64 - 10.0) / 20.0;
            (30.0 * (1.0 - distance * distance).max(0.0) * 4.0).round() / 4.0
        });
        let total_n: f64 = n_cm2.iter().zip(AREAS_CM2).map(|(n_cm2, cm2)| n_cm2 * cm2 * scale).sum();
        let fields = n_cm2.map(|n_cm2| format!("\t{n_cm2:.2}")).concat();
        text += &format!("{:.2}{fields}\t{:.0}\n", frame as f64 * 0.01, total_n);
    }
    text
}

#[test]
fn a_moticon_walk_has_the_areas_of_an_earlier_one() {
    let import = |text: &str, earlier: &[EarlierRecording]| parse_like(Format::Moticon, text, None, earlier);
    let first = import(&moticon(0, 1.0), &[]).unwrap().feet.remove(0);
    let first_file = earlier(&first);
    let alone = import(&moticon(20, 1.0), &[]).unwrap().feet.remove(0);
    let export = import(&moticon(20, 1.0), &first_file).unwrap();
    let like = &export.feet[0];
    assert_ne!(alone.layout, first.layout);
    assert_eq!((&like.layout, &like.pressure_kpa), (&first.layout, &alone.pressure_kpa));
    let zero = FootZero { layout_id: virtual_insole(&first).setup.layout_id, offset_kpa: vec![0.5; 16] };
    assert!(zero.apply_to(&mut virtual_insole(&alone), "zero.toml").is_err());
    zero.apply_to(&mut virtual_insole(like), "zero.toml").expect("the same layout");
    let remark = "Right foot: the cells, areas and regions are those of first.parquet, ";
    assert!(export.remarks[0].starts_with(remark) && like.source.contains(remark), "{:?}", export.remarks);

    // The next size has areas that are larger by 9 %.
    let words = ["first.parquet", "of the vendor's", "another size", "leave out --like"];
    assert_message(import(&moticon(20, 1.09), &first_file), "walk.asf: ", &words);
    let left = moticon(20, 1.0).replace("right", "left");
    assert_message(import(&left, &first_file), "walk.asf: ", &["left foot", "first.parquet", "right foot"]);
    let reduced = earlier(&first.binned(12).expect("12 cells"));
    let error = import(&moticon(20, 1.0), &reduced).expect_err("refused").to_string();
    assert!(error.contains("first.parquet: ") && error.contains("without --cells"), "{error}");
    let f_scan = earlier(&self::import(&step(Side::Right, STEP), &[]));
    let error = import(&moticon(20, 1.0), &f_scan).expect_err("refused").to_string();
    assert!(error.contains("`Tekscan F-SCAN") && error.contains("`Moticon OpenGo insole`"), "{error}");
}

#[test]
#[ignore = "needs the source archive of moticon-opengo: cargo xtask test"]
fn the_areas_of_one_moticon_walk_reproduce_the_forces_of_the_next() {
    let archive =
        std::env::var_os("PLANTAR_MOTICON").expect("PLANTAR_MOTICON names the source archive of moticon-opengo");
    let text = |name: &str| {
        let member = format!("moticon_opengo-1.0.3/tests/testdata/{name}");
        let output = std::process::Command::new("tar").arg("-xzOf").arg(&archive).arg(&member).output();
        String::from_utf8(output.expect("tar can be started").stdout).expect("UTF-8")
    };
    let import = |name: &str, earlier: &[EarlierRecording]| parse_like(Format::Moticon, &text(name), None, earlier);
    let first = import("230927_102114.txt", &[]).unwrap().feet;
    let pair: Vec<_> = first.iter().map(|foot| earlier_as(foot, &format!("{}.parquet", foot.side.name()))).collect();
    for name in ["230927_102137.txt", "230927_102231.txt"] {
        let (alone, like) = (import(name, &[]).unwrap().feet, import(name, &pair).unwrap().feet);
        for ((alone, like), first) in alone.iter().zip(&like).zip(&first) {
            assert_ne!(alone.layout, like.layout);
            assert_eq!((&like.layout, &like.pressure_kpa), (&first.layout, &alone.pressure_kpa));
            // The vendor's total force is that of the import alone, to within 0.3 N.
            let difference_n = |i: usize| (like.force_n(i) - alone.force_n(i)).abs();
            let most_n = (0..like.frames()).map(difference_n).fold(0.0, f64::max);
            assert!(most_n < 1.0, "{name}, {}: {most_n} N", like.side.name());
        }
    }
    let other_size = import("walk_data_with_events/text_export.txt", &pair);
    assert_message(other_size, "walk.asf: ", &["another size"]);
}

/// The two halves of each walk, of some three steps each.
#[test]
#[ignore = "needs recordings of people, which are not public: PLANTAR_RECORDINGS"]
fn the_halves_of_an_f_scan_walk_have_one_layout() {
    // For each cell, its row and column.
    let regions = |layout: &Layout| -> BTreeMap<(i64, i64), Region> {
        let sheet = layout.sheet.expect("an insole in rows and columns");
        let index = |distance_mm: f64, step_mm: f64| (distance_mm / step_mm).round() as i64;
        let sensor =
            |cell: &Cell| (index(cell.y_mm - sheet.y_mm, sheet.row_mm), index(cell.x_mm - sheet.x_mm, sheet.column_mm));
        layout.cells.iter().map(|cell| (sensor(cell), cell.region)).collect()
    };
    for (name, expected) in [("fscan/FrasP01L.asf", [462, 0]), ("fscan/FrasP01R.asf", [540, 35])] {
        let bytes = std::fs::read(common::recordings().join(name)).expect("an export");
        let text: String = bytes.iter().map(|&byte| char::from(byte)).collect();
        let starts: Vec<usize> =
            text.match_indices("Frame ").map(|(at, _)| at).filter(|at| text[..*at].ends_with('\n')).collect();
        let (head, middle) = (&text[..starts[0]], starts[starts.len() / 2]);
        let (one, other) = (text[..middle].to_owned(), format!("{head}{}", &text[middle..]));
        let parse =
            |text: &str, earlier: &[EarlierRecording]| parse_like(Format::Tekscan, text, None, earlier).expect("read");
        let first = parse(&one, &[]).feet.remove(0);
        let alone = parse(&other, &[]).feet.remove(0);
        assert_ne!(alone.layout, first.layout, "{name}");
        // The sensors that carry load in both halves, and those of them that are in another region if each is imported alone.
        let (first_regions, alone_regions) = (regions(&first.layout), regions(&alone.layout));
        let common = || first_regions.iter().filter_map(|(sensor, region)| Some((region, alone_regions.get(sensor)?)));
        assert_eq!([common().count(), common().filter(|(one, other)| one != other).count()], expected, "{name}");
        let Export { feet, remarks } = parse(&other, &earlier(&first));
        assert_eq!(feet[0].layout, first.layout, "{name}");
        let sum_n = |foot: &Recording| (0..foot.frames()).map(|i| foot.force_n(i)).sum::<f64>();
        let lost = 1.0 - sum_n(&feet[0]) / sum_n(&alone);
        assert!((0.0..0.01).contains(&lost), "{name}: {lost}");
        let stated = format!("{:.2} % of the load", 100.0 * lost);
        assert!(remarks.iter().any(|remark| remark.contains(&stated)), "{stated}: {remarks:?}");
    }
}

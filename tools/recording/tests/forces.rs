//! The imports of insoles with a few force sensors: loadsol and PhysioNet's gaitpdb, from computed files in their formats.

mod common;

use common::assert_message;
use plantar::{Region, Side};
use recording::{Export, Format, Result};

/// The force on a sensor of a foot in a frame, N: the load moves from the first to the last sensor.
fn force_n(foot: usize, frame: usize, sensor: usize, sensors: usize) -> f64 {
    let time = ((frame + 50 * foot) % 100) as f64 / 60.0 - sensor as f64 / sensors as f64;
    (300.0 * (1.0 - (time / 0.3).powi(2)).max(0.0) * 100.0).round() / 100.0
}

fn gaitpdb_file() -> String {
    let line = |frame: usize| {
        let feet = [0, 1].map(|foot| (0..8).map(|sensor| force_n(foot, frame, sensor, 8)).collect::<Vec<_>>());
        let fields = feet.iter().flatten().map(|n| format!("{n:.2}")).collect::<Vec<_>>().join("\t");
        let [left_n, right_n] = feet.each_ref().map(|foot| foot.iter().sum::<f64>());
        format!("{:.2}\t{fields}\t{left_n:.2}\t{right_n:.2}\n", frame as f64 * 0.01)
    };
    (0..200).map(line).collect()
}

/// A loadsol export of both feet. The zones of the right foot are in another order than those of the left foot, and frame 40
/// of the right foot is lost.
fn loadsol_file() -> String {
    let mut text = "walk_2024_05_01_10_00_00_000.txt\n\n\tA1-L:heel\tA1-L:medial\tA1-L:lateral\tA1-L\tA1-L:xAcc\t\
                    \tA1-R:lateral\tA1-R:medial\tA1-R:heel\tA1-R\tNotes\n\
                    [sec]\t[N]\t[N]\t[N]\t[N]\t[g]\t[sec]\t[N]\t[N]\t[N]\t[N]\t\n"
        .to_owned();
    for frame in 0..200 {
        let feet = [0, 1].map(|foot| [0, 1, 2].map(|zone| force_n(foot, frame, zone, 3)));
        let time = format!("{:.3}", frame as f64 * 0.01);
        let [left, right] = feet;
        text += &format!("{time}\t{:.2}\t{:.2}\t{:.2}\t0\t0.1\t", left[0], left[1], left[2]);
        text += &match frame {
            40 => "-\t-\t-\t-\t-\t\n".to_owned(),
            _ => format!("{time}\t{:.2}\t{:.2}\t{:.2}\t0\t\n", right[2], right[1], right[0]),
        };
    }
    text
}

fn parse(format: Format, text: &str) -> Result<Export> {
    common::parse(format, "walk.txt", text.as_bytes(), None)
}

/// The force on a zone in [`app_file`], N: in the stance it increases by 1 N from frame to frame.
fn app_force_n(frame: usize, zone: usize) -> f64 {
    if (100..260).contains(&frame) { (frame + 50 * zone) as f64 } else { 0.0 }
}

/// A loadsol export of both feet at 200 Hz with the structure of the app's files: units behind the names of the quantities, a
/// second time and motion for each foot, and empty fields at the end. In each foot, two rows have the time and the forces of the
/// row after them, and 11 frames of the left foot are lost within the stance.
fn app_file() -> String {
    let foot = |name: &str, zones: [&str; 3]| {
        let zones = zones.map(|zone| format!("\t{name}::{zone}")).concat();
        let motion = ["xAcc", "yAcc", "zAcc", "xGyro", "yGyro", "zGyro"].map(|of| format!("\t{name}::{of}")).concat();
        format!("{zones}\t{name}\t{motion}\t")
    };
    let units =
        format!("Time[secs]{}\tTime[secs]{}{}\t", "\tForce[N]".repeat(4), "\t[g]".repeat(3), "\t[rad/s]".repeat(3));
    let left = foot("ABC123-L", ["heel", "medial", "lateral"]);
    let mut text =
        format!("walk.loadflux\ncomment walk\n{left}{}\t\n", foot("ABC124-R", ["lateral", "medial", "heel"]));
    text += &format!("{}\n", units.repeat(2));
    for frame in 0..400 {
        let foot = |repeated: [usize; 2], zones: [usize; 3], is_lost: bool| {
            let frame = frame + usize::from(repeated.contains(&frame));
            let time = format!("{:.3}", frame as f64 * 0.005);
            if is_lost {
                return format!("{time}{}\t0.000\t{time}{}\t", "\t-1.000".repeat(3), "\t-".repeat(6));
            }
            let forces = zones.map(|zone| format!("\t{:.3}", app_force_n(frame, zone))).concat();
            let total_n: f64 = zones.iter().map(|zone| app_force_n(frame, *zone)).sum();
            format!("{time}{forces}\t{total_n:.3}\t{time}{}\t", "\t0.125".repeat(6))
        };
        let left = foot([39, 199], [0, 1, 2], (150..161).contains(&frame));
        text += &format!("{left}{}\t\n", foot([120, 320], [2, 1, 0], false));
    }
    text + "\n"
}

/// Checks the feet, times and forces of an import from `sensors` sensors of each foot. Frame 40 is not compared, because it is
/// lost in the loadsol file.
fn assert_both_feet(export: &Export, sensors: usize) {
    assert_eq!(export.feet.iter().map(|foot| foot.side).collect::<Vec<_>>(), [Side::Left, Side::Right]);
    assert_eq!(export.feet[0].t_s, export.feet[1].t_s);
    for (foot, recording) in export.feet.iter().enumerate() {
        assert!((recording.rate_hz - 100.0).abs() < 1e-6);
        for frame in (0..200).filter(|frame| *frame != 40) {
            let true_n: f64 = (0..sensors).map(|sensor| force_n(foot, frame, sensor, sensors)).sum();
            assert!((recording.force_n(frame) - true_n).abs() < 1e-3 * true_n + 0.01, "foot {foot}, frame {frame}");
        }
        assert!(recording::footprint::warnings(recording).is_empty());
        assert_eq!(recording.source.matches("nominal").count(), 1, "{}", recording.source);
    }
    assert!(export.remarks.iter().any(|remark| remark.contains("nominal")));
}

#[test]
fn forces_of_gaitpdb_are_conserved_from_heel_to_toes() {
    let text = gaitpdb_file();
    assert_eq!(Format::recognise(text.as_bytes(), "walk.txt".as_ref()).unwrap(), Format::Gaitpdb);
    let export = parse(Format::Gaitpdb, &text).unwrap();
    assert_both_feet(&export, 8);
    let cells = &export.feet[1].layout.cells;
    assert_eq!(cells[0].region, Region::Heel);
    assert_eq!((cells[5].region, cells[6].region), (Region::Metatarsals35, Region::Metatarsals12));
    assert!(cells[7].region >= Region::Hallux);
    assert!(export.remarks[0].contains("+0.00 %"), "{}", export.remarks[0]);
}

#[test]
fn forces_of_loadsol_are_conserved_and_a_lost_frame_is_interpolated() {
    let text = loadsol_file();
    assert_eq!(Format::recognise(text.as_bytes(), "walk.txt".as_ref()).unwrap(), Format::Loadsol);
    let export = parse(Format::Loadsol, &text).unwrap();
    assert_both_feet(&export, 3);
    assert!(
        export.remarks.iter().any(|r| r.starts_with("Right foot: Lost frames that were interpolated linearly: 1")),
        "{:?}",
        export.remarks
    );
    // The heel is loaded first in both feet, in spite of the order of their columns.
    for (foot, frame) in [(0, 5), (1, 55)] {
        let recording = &export.feet[foot];
        let most = recording.layout.cells.iter().zip(recording.frame(frame)).max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
        assert_eq!(most.0.region, Region::Heel);
    }
}

#[test]
fn lost_frames_and_repeated_rows_of_the_loadsol_app_are_interpolated() {
    let text = app_file();
    assert_eq!(Format::recognise(text.as_bytes(), "walk.txt".as_ref()).unwrap(), Format::Loadsol);
    let export = parse(Format::Loadsol, &text).unwrap();
    assert_eq!(export.feet.iter().map(|foot| foot.side).collect::<Vec<_>>(), [Side::Left, Side::Right]);
    for recording in &export.feet {
        assert_eq!((recording.frames(), recording.cells()), (400, 3));
        assert!((recording.rate_hz - 200.0).abs() < 1e-6);
        for frame in 0..400 {
            assert!((recording.t_s[frame] - frame as f64 * 0.005).abs() < 1e-9);
            let true_n: f64 = (0..3).map(|zone| app_force_n(frame, zone)).sum();
            assert!((recording.force_n(frame) - true_n).abs() < 0.01, "frame {frame}: {}", recording.force_n(frame));
        }
    }
    for (foot, frames) in [("Left", 13), ("Right", 2)] {
        let remark = format!("{foot} foot: Lost frames that were interpolated linearly: {frames}.");
        assert!(export.remarks.contains(&remark), "{:?}", export.remarks);
        let agrees = |remark: &String| remark.starts_with(foot) && remark.contains("+0.00 %");
        assert!(export.remarks.iter().any(agrees), "{:?}", export.remarks);
    }
}

#[test]
fn loadsol_rows_that_are_cut_off_or_repeat_only_the_time_are_refused() {
    let text = app_file();
    let other = text.replacen("\n1.000\t200.000\t", "\n1.000\t201.000\t", 1);
    assert_message(parse(Format::Loadsol, &other), "walk.txt:205: ", &["time 1 s is repeated"]);
    // The last row ends within its first force, or behind it.
    let (whole, _) = text.rsplit_once("0.000\t0.000\t0.000\t0.000\t1.995").expect("a last row");
    for (end, fields) in [("0.0", 14), ("0.000\t", 15)] {
        assert_message(
            parse(Format::Loadsol, &format!("{whole}{end}")),
            "walk.txt:404: ",
            &[format!("the row ends after {fields} of 24 fields").as_str(), "export or copy the measurement again"],
        );
    }
}

#[test]
fn loadsol_insoles_without_zones_are_named_as_such() {
    let text = "walk.loadflux\ncomment walk\n\tABC123-L\t\tABC124-R\t\t\nTime[secs]\tForce[N]\tTime[secs]\tForce[N]\t\n\
                0.000\t25.000\t0.000\t877.500\t\t\n0.005\t25.000\t0.005\t873.990\t\t\n";
    assert_eq!(Format::recognise(text.as_bytes(), "walk.txt".as_ref()).unwrap(), Format::Loadsol);
    assert_message(parse(Format::Loadsol, text), "walk.txt:3: ", &["ABC123-L", "no zone", "total force alone"]);
    // Without zones, a table with commas can be that of any program.
    assert!(Format::recognise(text.replace('\t', ",").as_bytes(), "walk.txt".as_ref()).is_err());
}

#[test]
fn damaged_files_are_refused_with_the_line_and_a_remedy() {
    let text = gaitpdb_file();
    assert_message(parse(Format::Gaitpdb, &text.replacen("\n0.01\t", "\n", 1)), "walk.txt:2: ", &["18 columns"]);
    assert_message(parse(Format::Gaitpdb, &text.replacen("\n0.01\t", "\n0.00\t", 1)), "walk.txt:2: ", &["repeated"]);
    assert_message(parse(Format::Gaitpdb, &text.replacen("\n0.01\t", "\nNaN\t", 1)), "walk.txt:2: ", &["the time"]);
    let text = loadsol_file();
    assert_message(parse(Format::Loadsol, &text.replace("[N]", "[lb]")), "walk.txt:3: ", &["[lb]", "in N"]);
    assert_message(parse(Format::Loadsol, &text.replace("A1-", "A1")), "walk.txt: ", &["L or R"]);
    assert_message(parse(Format::Loadsol, &text.replacen("\n0.010\t", "\n0,0,1\t", 1)), "walk.txt:6: ", &["the time"]);
}

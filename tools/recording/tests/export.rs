//! Recognition of the formats of exports, and the import of real exports.

mod common;

use plantar::{Region, Side};
use recording::{Error, Format, Options, Recording, footprint};
use std::path::Path;
use std::process::Command;

fn recognised(text: &str) -> Result<Format, String> {
    Format::recognise(text.as_bytes(), Path::new("file.dat")).map_err(|error: Error| error.to_string())
}

#[test]
fn formats_are_recognised_by_the_content_of_a_file() {
    let xsensor = "\u{feff}File:,a.XSN\nUnits:,mmHg\nFRAME,1\nTime,08:00:00\nSENSOR,X-LF\nRows,31\nSENSELS\n0,0\n";
    let quoted = "\"Units:\";\"kPa\"\n\"Frame:\";\"1\"\n\"Sensor:\";\"X-RF\"\n\"Sensels:\"\n";
    let tekscan = "DATA_TYPE MOVIE\nROWS 60\nCOLS 21\nROW_SPACING 5.08 mm\nASCII_DATA @@\n";
    let tekscan_csv = "DATA_TYPE,MOVIE\nROWS,60\nCOLS,21\nROW_SPACING,5.08 mm\nASCII_DATA @@\n";
    let emed = "\n\tPage 1\n\tSensor area: 0.25 cm\n\tPict-No.: 1  Force[N]=sum\n";
    let footscan = "Dynamic Roll off\nRight foot data\nFrame 0 (0.00 ms)\n0\t1\n";
    let moticon = "# Size: 7\n# time\tleft pressure 1[N/cm²]\tleft total force[N]\n0.00\t1\t2\n";
    for (text, format) in [
        (xsensor, Format::Xsensor),
        (quoted, Format::Xsensor),
        (tekscan, Format::Tekscan),
        (tekscan_csv, Format::Tekscan),
        (emed, Format::Emed),
        (footscan, Format::Footscan),
        (moticon, Format::Moticon),
    ] {
        assert_eq!(recognised(text), Ok(format), "{text}");
    }
    assert_eq!(
        Format::recognise(&[0xd0, 0xcf, 0x11, 0xe0, 0xa1, 0xb1, 0x1a, 0xe1], Path::new("a")).unwrap(),
        Format::Footscan
    );
}

#[test]
fn other_files_are_refused_with_the_command_that_reads_them() {
    let refused = |text: &str| recognised(text).unwrap_err();
    assert!(refused("file name: a\npressure values in kPa\ntime[secs] 1 2\n").contains("import pedar with --geometry"));
    for text in ["t_s,c0,c1\n", "t_s;c0;c1\n0,01;2,5;3\n", "cell;x_mm;y_mm;area_mm2\n"] {
        assert!(refused(text).contains("import csv"), "{}", refused(text));
    }
    let tabs = refused("t_s\tc0\tc1\n0,01\t2,5\t3\n");
    assert!(tabs.contains("a tab separates the fields, expected `,`"), "{tabs}");
    assert!(refused("PAR1").contains("plantar info"));
    // In UTF-8, the first character has two bytes, so this text does not begin as an HDF5 file.
    assert!(refused("\u{89}HDF").contains("not recognised"));
    assert!(refused("Dear reader,\n").contains("xsensor"));
    assert!(refused("").contains("empty"));
    for message in ["t_s,c0", "PAR1", "Dear reader", ""].map(refused) {
        assert!(message.starts_with("file.dat: "), "{message}");
    }
}

/// Checks that the largest force is within `least_n..most_n`, that the import has no warning of an upside down or mirrored
/// foot, and that each region has a cell.
fn check_walk(recording: &Recording, least_n: f64, most_n: f64) {
    let largest_n = (0..recording.frames()).map(|i| recording.force_n(i)).fold(0.0, f64::max);
    assert!((least_n..most_n).contains(&largest_n), "{largest_n} N");
    assert_eq!(footprint::warnings(recording), Vec::<String>::new());
    for region in Region::ALL {
        assert!(recording.layout.cells.iter().any(|cell| cell.region == region), "{region:?}");
    }
}

#[test]
#[ignore = "needs the source archive of moticon-opengo: cargo xtask test"]
fn moticon_walks_agree_with_the_vendors_total_force_within_half_a_newton() {
    let archive =
        std::env::var_os("PLANTAR_MOTICON").expect("PLANTAR_MOTICON names the source archive of moticon-opengo");
    for (name, size_mm2) in [
        ("230927_102114.txt", 20_480.0),
        ("230927_102137.txt", 20_480.0),
        ("230927_102231.txt", 20_480.0),
        ("walk_data_with_events/text_export.txt", 14_400.0),
    ] {
        let member = format!("moticon_opengo-1.0.3/tests/testdata/{name}");
        let output = Command::new("tar").arg("-xzOf").arg(&archive).arg(&member).output().expect("tar can be started");
        assert!(output.status.success(), "{member} is in the archive");
        let export =
            Format::Moticon.parse(&output.stdout, Path::new(name), Options::default()).expect("the export is read");
        assert_eq!(export.feet.iter().map(|foot| foot.side).collect::<Vec<_>>(), [Side::Left, Side::Right]);
        let text = String::from_utf8(output.stdout).expect("UTF-8");
        for foot in &export.feet {
            let rms_n = difference_n(foot, &text);
            assert!(rms_n < 0.5, "{name}, {}: {rms_n} N", foot.side.name());
            let area_mm2: f64 = foot.layout.cells.iter().map(|cell| cell.area_mm2).sum();
            assert!((area_mm2 / size_mm2 - 1.0).abs() < 0.01, "{area_mm2} mm2");
            check_walk(foot, 800.0, 1500.0);
        }
    }
}

/// The root mean square, N, of the differences between the forces of a recording and the total forces in its export.
fn difference_n(foot: &Recording, text: &str) -> f64 {
    let head: Vec<&str> = text.lines().find(|line| line.starts_with("# time")).expect("a header").split('\t').collect();
    let column =
        head.iter().position(|name| name.starts_with(&format!("{} total force", foot.side.name()))).expect("totals");
    let rows = text.lines().filter(|line| !line.starts_with('#')).map(|line| line.split('\t').collect::<Vec<_>>());
    let squares: Vec<f64> = rows
        .filter_map(|row| Some((row[0].parse::<f64>().ok()?, row.get(column)?.parse::<f64>().ok()?)))
        .filter_map(|(t_s, total_n)| {
            let frame = foot.t_s.iter().position(|frame_s| (frame_s - t_s).abs() < 1e-3)?;
            Some((foot.force_n(frame) - total_n).powi(2))
        })
        .collect();
    assert!(squares.len() > 400);
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// Tests with recordings of people, which are not public.
mod unpublished {
    use super::check_walk;
    use super::common::recordings;
    use plantar::Side;
    use recording::{Export, Options, export, footprint};

    fn import(name: &str) -> Export {
        export::import(recordings().join(name), Options::default()).expect("the export is read")
    }

    #[test]
    #[ignore = "needs recordings of people, which are not public: PLANTAR_RECORDINGS"]
    fn f_scan_insoles_of_either_foot_are_imported() {
        for (name, side) in [("fscan/FrasP01L.asf", Side::Left), ("fscan/FrasP01R.asf", Side::Right)] {
            let export = import(name);
            let foot = &export.feet[0];
            assert_eq!((foot.side, foot.frames()), (side, 205));
            assert!((foot.rate_hz - 31.25).abs() < 1e-9);
            check_walk(foot, 700.0, 1000.0);
        }
    }

    #[test]
    #[ignore = "needs recordings of people, which are not public: PLANTAR_RECORDINGS"]
    fn a_step_on_an_emed_plate_agrees_with_the_column_of_forces() {
        let export = import("emed/emed_test.lst");
        assert_eq!((export.feet[0].side, export.feet[0].frames()), (Side::Right, 40 + 106 + 40));
        assert!(export.remarks[0].contains("by up to 0.0"), "{}", export.remarks[0]);
        check_walk(&export.feet[0], 700.0, 900.0);
    }

    #[test]
    #[ignore = "needs recordings of people, which are not public: PLANTAR_RECORDINGS"]
    fn a_step_on_a_footscan_plate_is_imported_from_an_excel_file() {
        let export = import("footscan/footscan_test.xls");
        assert_eq!((export.feet[0].side, export.feet[0].frames()), (Side::Right, 200 + 329 + 200));
        assert!((export.feet[0].rate_hz - 500.0).abs() < 1e-6);
        check_walk(&export.feet[0], 650.0, 800.0);
    }

    #[test]
    #[ignore = "needs recordings of people, which are not public: PLANTAR_RECORDINGS"]
    fn a_recording_with_a_mirrored_layout_has_a_warning() {
        for name in ["fscan/FrasP01L.asf", "fscan/FrasP01R.asf", "emed/emed_test.lst", "footscan/footscan_test.xls"] {
            let mut foot = import(name).feet.remove(0);
            let width_mm = foot.layout.cells.iter().map(|cell| cell.x_mm).fold(0.0, f64::max);
            foot.layout.cells.iter_mut().for_each(|cell| cell.x_mm = width_mm - cell.x_mm);
            recording::template::assign(&mut foot.layout.cells);
            let warnings = footprint::warnings(&foot);
            assert!(warnings.len() == 1 && warnings[0].contains("mirrored"), "{name}: {warnings:?}");
        }
    }
}

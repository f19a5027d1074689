//! Recognition of the formats of exports.

mod common;

use recording::{Error, Format};
use std::path::Path;

fn recognised(text: &str) -> Result<Format, String> {
    Format::recognise(text.as_bytes(), Path::new("file.dat")).map_err(|error: Error| error.to_string())
}

#[test]
fn each_format_is_recognised_by_its_content() {
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
    assert!(refused("t_s,c0,c1\n").contains("import csv"));
    assert!(refused("PAR1").contains("plantar info"));
    assert!(refused("\u{89}HDF").contains("not recognised"));
    assert!(refused("Dear reader,\n").contains("xsensor"));
    assert!(refused("").contains("empty"));
    for message in ["t_s,c0", "PAR1", "Dear reader", ""].map(refused) {
        assert!(message.starts_with("file.dat: "), "{message}");
    }
}

/// The real exports, which are not part of this repository.
mod real {
    use super::common::recordings;
    use plantar::{Region, Side};
    use recording::{Export, Recording, export, footprint};

    fn import(name: &str) -> Export {
        export::import(recordings().join(name), None).expect("the export is read")
    }

    /// Checks that each step begins at the heel and ends at the forefoot, and that the largest force is that of a person.
    fn check_walk(recording: &Recording, least_n: f64, most_n: f64) {
        let largest_n = (0..recording.frames()).map(|i| recording.force_n(i)).fold(0.0, f64::max);
        assert!((least_n..most_n).contains(&largest_n), "{largest_n} N");
        assert_eq!(footprint::warnings(recording), Vec::<String>::new());
        for region in Region::ALL {
            assert!(recording.layout.cells.iter().any(|cell| cell.region == region), "{region:?}");
        }
    }

    #[test]
    #[ignore = "needs recordings of people, which are not public: PLANTAR_RECORDINGS"]
    fn f_scan_insoles_are_imported_as_both_feet() {
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
        assert_eq!((export.feet[0].side, export.feet[0].frames()), (Side::Right, 106));
        assert!(export.remarks[0].contains("by up to 0.0"), "{}", export.remarks[0]);
        check_walk(&export.feet[0], 700.0, 900.0);
    }

    #[test]
    #[ignore = "needs recordings of people, which are not public: PLANTAR_RECORDINGS"]
    fn a_step_on_a_footscan_plate_is_imported_from_a_file_of_excel() {
        let export = import("footscan/footscan_test.xls");
        assert_eq!((export.feet[0].side, export.feet[0].frames()), (Side::Right, 329));
        assert!((export.feet[0].rate_hz - 500.0).abs() < 1e-6);
        check_walk(&export.feet[0], 650.0, 800.0);
    }

    #[test]
    #[ignore = "needs recordings of people, which are not public: PLANTAR_RECORDINGS"]
    fn a_recording_as_the_other_foot_looks_mirrored() {
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

//! `plantar import`: the names of its files, and what it states about the exports.

use recording::Recording;
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

/// Runs the program. Returns whether it succeeded, and its texts on stdout and on stderr.
fn plantar(folder: &TempDir, arguments: &str) -> (bool, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_plantar"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .output()
        .expect("the program starts");
    let text = |bytes| String::from_utf8(bytes).expect("text");
    (output.status.success(), text(output.stdout), text(output.stderr))
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a folder")
}

/// Writes the export of a computed step, a seed of the fuzz target `vendor`, to a file. The first byte of the seed selects the
/// format, and is no part of the export.
fn write_export(folder: &TempDir, seed: &str, from: &str, to: &str, name: &str) {
    let seed = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/vendor").join(seed);
    let text = String::from_utf8(std::fs::read(seed).expect("a seed")[1..].to_vec()).expect("text");
    assert!(text.contains(from), "{text}");
    std::fs::write(folder.path().join(name), text.replace(from, to)).expect("written");
}

#[test]
fn a_recording_does_not_get_the_ending_of_another_format() {
    let folder = folder();
    for name in ["walk.csv", "walk.Parquet", "walk.txt"] {
        let (is_ok, _, text) = plantar(&folder, &format!("import synthetic --steps 1 --out {name}"));
        assert!(!is_ok && text.contains(name) && text.contains(".parquet"), "{text}");
        assert!(text.contains("plantar export csv") && !folder.path().join(name).exists(), "{text}");
    }
    // The name is checked before the export is read.
    let (is_ok, _, text) = plantar(&folder, "import auto absent.asf --out walk.csv");
    assert!(!is_ok && text.contains("walk.csv") && !text.contains("absent"), "{text}");
    let (is_ok, _, text) = plantar(&folder, "import synthetic --steps 1 --out trial-1.1");
    assert!(is_ok && folder.path().join("trial-1.1").exists(), "{text}");
}

#[test]
fn a_folder_of_exports_is_refused_with_the_remedy() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("exports")).expect("made");
    for arguments in ["auto exports", "tekscan exports"] {
        let (is_ok, _, text) = plantar(&folder, &format!("import {arguments} --out walk.parquet"));
        assert!(!is_ok && text.contains("exports is a folder: name the exported files in it"), "{text}");
    }
}

#[test]
fn the_name_of_a_pair_leads_to_the_recordings_of_its_feet() {
    let folder = folder();
    let (is_ok, _, text) = plantar(&folder, "info walk.parquet");
    assert!(!is_ok && !text.contains("name the recording of a foot"), "{text}");
    for (side, words) in [
        ("left", "name the recording of a foot: walk.left.parquet"),
        ("right", "name the recording of a foot: walk.left.parquet or walk.right.parquet"),
    ] {
        let import = format!("import synthetic --steps 1 --side {side} --out walk.{side}.parquet");
        assert!(plantar(&folder, &import).0);
        for command in ["info walk.parquet", "replay walk.parquet"] {
            let (is_ok, _, text) = plantar(&folder, command);
            assert!(!is_ok && text.contains(words), "{text}");
        }
    }
}

#[test]
fn feet_of_different_measurements_are_noted() {
    let folder = folder();
    write_export(&folder, "tekscan", "walkL", "walkL", "walkL.asf");
    write_export(&folder, "tekscan", "walkL", "walkR", "walkR.asf");
    write_export(&folder, "tekscan", "walkL", "jumpR", "jumpR.asf");
    let (is_ok, _, text) = plantar(&folder, "import auto walkL.asf walkR.asf --out a.parquet");
    assert!(is_ok && !text.contains("note:"), "{text}");
    let (is_ok, _, text) = plantar(&folder, "import auto walkL.asf jumpR.asf --out b.parquet");
    assert!(is_ok && text.contains("note:") && text.contains("walkL.asf") && text.contains("jumpR.asf"), "{text}");
    assert!(folder.path().join("b.left.parquet").exists() && folder.path().join("b.right.parquet").exists());
}

#[test]
fn feet_that_were_measured_at_different_times_are_noted() {
    let folder = folder();
    let write = |foot: &str, time: &str| {
        write_export(
            &folder,
            "tekscan",
            "FILENAME walkL",
            &format!("TIME {time}\nFILENAME walk{foot}"),
            &format!("walk{foot}.asf"),
        );
    };
    write("L", "16 February 2017 11:26:22 a.m.");
    for (time, is_noted) in [("16 February 2017 11:26:22 a.m.", false), ("16 February 2017 11:31:07 a.m.", true)] {
        write("R", time);
        let (is_ok, _, text) = plantar(&folder, "import auto walkL.asf walkR.asf --out a.parquet");
        let words = ["note:", "different times", "11:26:22", "11:31:07"];
        assert!(is_ok && words.iter().all(|word| text.contains(word)) == is_noted, "{text}");
        assert_eq!(text.contains("note:"), is_noted, "{text}");
    }
}

/// Each emed export is one contact, so that the two feet were not on the plate at the same moment.
#[test]
fn two_single_contacts_are_noted_as_not_on_one_clock() {
    let folder = folder();
    write_export(&folder, "emed", "Pict-No", "Pict-No", "S1_L.lst");
    write_export(&folder, "emed", "Pict-No", "Pict-No", "S1_R.lst");
    let is_noted =
        |text: &str| ["note:", "S1_L.lst", "S1_R.lst", "not on one clock"].iter().all(|word| text.contains(word));
    let (is_ok, _, text) = plantar(&folder, "import auto S1_L.lst S1_R.lst --out a.parquet");
    assert!(is_ok && is_noted(&text), "{text}");
    // The statement remains in the recordings.
    let (_, _, text) = plantar(&folder, "gait a.left.parquet a.right.parquet");
    assert!(is_noted(&text), "{text}");
}

#[test]
fn a_side_with_several_files_is_refused() {
    let folder = folder();
    write_export(&folder, "tekscan", "walkL", "walkL", "walkL.asf");
    write_export(&folder, "tekscan", "walkL", "walkR", "walkR.asf");
    let (is_ok, out, text) = plantar(&folder, "import auto walkL.asf walkR.asf --side right --out a.parquet");
    assert!(!is_ok && out.is_empty(), "{out}");
    assert!(text.contains("--side right with 2 files") && text.contains("each file with its own --side"), "{text}");
}

/// The seed has fewer than 99 frames.
#[test]
fn a_remark_names_its_file_and_remains_in_the_recording() {
    let folder = folder();
    write_export(&folder, "tekscan", "UNITS", "END_FRAME 99\nUNITS", "walkL.asf");
    write_export(&folder, "tekscan", "walkL", "walkR", "walkR.asf");
    let (is_ok, out, text) = plantar(&folder, "import auto walkL.asf walkR.asf --out a.parquet");
    assert!(is_ok && out.contains("walkL.asf: The header states frames up to 99"), "{out}{text}");
    for (foot, is_cut_off) in [("left", true), ("right", false)] {
        let (_, out, _) = plantar(&folder, &format!("info a.{foot}.parquet"));
        assert_eq!(out.contains("The header states frames up to 99"), is_cut_off, "{out}");
    }
}

/// 20 kPa on 2000 mm2 are 40 N, as 200 kPa, 400 N, are if they are read in N/cm2.
#[test]
fn a_warning_about_the_unit_of_the_pressures_remains_in_the_recording() {
    let folder = folder();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    write("layout.csv", "cell,x_mm,y_mm,area_mm2,region\n0,40,30,1000,heel\n1,40,200,1000,hallux\n");
    for (kpa, is_warned) in [(20, true), (200, false)] {
        let frames: String = (0..50).map(|i| format!("0.{i:02},{kpa},{kpa}\n")).collect();
        write("frames.csv", &format!("t_s,c0,c1\n{frames}"));
        let import = "import csv --layout layout.csv --frames frames.csv --side left --out walk.parquet";
        let (is_ok, _, text) = plantar(&folder, import);
        assert!(is_ok && text.contains("warning: The largest force on the left foot is 40.0 N") == is_warned, "{text}");
        let (_, out, _) = plantar(&folder, "info walk.parquet");
        assert_eq!(out.contains("check the unit of the pressures"), is_warned, "{out}");
    }
}

#[test]
fn the_number_of_merged_cells_is_stated_once() {
    let folder = folder();
    let (is_ok, out, text) = plantar(&folder, "import synthetic --steps 1 --cells 96 --out walk.parquet");
    let layout = out.lines().find(|line| line.starts_with("layout")).unwrap_or_default();
    assert!(is_ok && layout.ends_with(" cells"), "{out}{text}");
    let mut parts = layout.rsplit(", ");
    assert_ne!(parts.next(), parts.next(), "{out}");
}

/// In the later measurements, the last column of the sensor carries no load, so that their own layouts are narrower.
#[test]
fn exports_are_imported_in_the_layouts_of_an_earlier_pair() {
    let folder = folder();
    let read = |name: &str| Recording::read(folder.path().join(name)).expect("a recording");
    write_export(&folder, "tekscan", "walkL", "walkL", "firstL.asf");
    write_export(&folder, "tekscan", "walkL", "walkR", "firstR.asf");
    let (is_ok, _, text) = plantar(&folder, "import auto firstL.asf firstR.asf --out first.parquet");
    assert!(is_ok, "{text}");
    for foot in ["L", "R"] {
        let text = std::fs::read_to_string(folder.path().join(format!("first{foot}.asf"))).expect("an export");
        let (head, frames) = text.split_once("ASCII_DATA").expect("frames");
        // Without the last values of each row.
        let clipped = |line: &str| match line.rsplit_once(',') {
            Some((rest, _)) if line.starts_with(|c: char| c.is_ascii_digit() || c == 'B') => format!("{rest},0\n"),
            _ => format!("{line}\n"),
        };
        let frames: String = frames.lines().map(clipped).collect();
        std::fs::write(folder.path().join(format!("later{foot}.asf")), format!("{head}ASCII_DATA{frames}"))
            .expect("written");
    }
    let import = |arguments: &str| {
        let (is_ok, out, text) = plantar(&folder, &format!("import {arguments}"));
        assert!(is_ok, "{arguments}: {text}");
        out
    };
    import("auto laterL.asf laterR.asf --out alone.parquet");
    for like in ["first.parquet", "first"] {
        let out = import(&format!("auto laterL.asf laterR.asf --like {like} --out later.parquet"));
        for foot in ["left", "right"] {
            let [first, alone, later] = ["first", "alone", "later"].map(|name| read(&format!("{name}.{foot}.parquet")));
            assert_ne!(alone.layout, first.layout);
            assert_eq!(later.layout, first.layout);
            assert!((0..later.frames()).all(|i| (later.force_n(i) - alone.force_n(i)).abs() < 1e-3));
            assert!(out.contains(&format!("the cells and regions are those of first.{foot}.parquet")), "{out}");
        }
    }
    // One foot, and the recording of one foot.
    for like in ["first.parquet", "first.right.parquet"] {
        import(&format!("tekscan laterR.asf --like {like} --out one.parquet"));
        assert_eq!(read("one.parquet").layout, read("first.right.parquet").layout);
    }
}

#[test]
fn the_options_from_and_to_select_a_part_of_any_export() {
    let folder = folder();
    write_export(&folder, "tekscan", "walkL", "walkL", "walkL.asf");
    let (is_ok, _, text) = plantar(&folder, "import auto walkL.asf --out walk.parquet");
    assert!(is_ok, "{text}");
    let whole = Recording::read(folder.path().join("walk.parquet")).expect("a recording");
    let (from_s, to_s) = (whole.t_s[2], whole.t_s[6]);
    for format in ["auto", "tekscan"] {
        let arguments = format!("import {format} walkL.asf --from {from_s} --to {to_s} --out part.parquet");
        let (is_ok, text, _) = plantar(&folder, &arguments);
        assert!(is_ok && text.contains("only the frames from"), "{text}");
        let part = Recording::read(folder.path().join("part.parquet")).expect("a recording");
        assert_eq!((&part.t_s[..], &part.layout), (&whole.t_s[2..7], &whole.layout));
    }
    for (options, words) in [
        ("--from 2 --to 1", &["from 2 s to 1 s", "end after it begins"][..]),
        ("--from nan", &["--from", "a time in seconds"]),
        ("--to -0.5", &["walkL.asf: no frame up to -0.5 s; the frames are from 0", "state times within these"]),
        ("--from 1e6", &["walkL.asf: no frame from 1e6 s", "state times within these"]),
    ] {
        let (is_ok, _, text) = plantar(&folder, &format!("import auto walkL.asf {options} --out none.parquet"));
        assert!(!is_ok && words.iter().all(|word| text.contains(word)), "{options}: {text}");
        assert!(!folder.path().join("none.parquet").exists());
    }
}

#[test]
fn a_layout_that_does_not_apply_is_refused() {
    let folder = folder();
    write_export(&folder, "tekscan", "walkL", "walkL", "walkL.asf");
    let (is_ok, _, text) = plantar(&folder, "import auto walkL.asf --out walk.parquet");
    assert!(is_ok, "{text}");
    for (arguments, words) in [
        ("tekscan walkL.asf --like absent.parquet --out a.parquet", &["absent.parquet", "check the path"][..]),
        ("tekscan walkL.asf --like walk.parquet --cells 64 --out a.parquet", &["--like", "--cells 64", "leave out"]),
        ("tekscan walkL.asf --like walk.parquet --out walk.parquet", &["walk.parquet", "input of this command"]),
        (
            "tekscan walkL.asf --side right --like walk.parquet --out a.parquet",
            &["right foot", "walk.parquet", "left foot"],
        ),
        ("loadsol walkL.asf --like walk.parquet --out a.parquet", &["walkL.asf", "not fitted", "leave out --like"]),
        ("pedar a.asc --geometry g.csv --like walk.parquet --out a.parquet", &["--like", "g.csv", "leave out --like"]),
        (
            "csv --layout l.csv --frames f.csv --side left --like walk.parquet --out a.parquet",
            &["--like", "l.csv", "leave out --like"],
        ),
    ] {
        let (is_ok, _, text) = plantar(&folder, &format!("import {arguments}"));
        assert!(!is_ok && words.iter().all(|word| text.contains(word)), "{arguments}: {text}");
        assert!(!folder.path().join("a.parquet").exists());
    }
}

/// The Parquet library panics on some damaged files.
#[test]
fn a_damaged_recording_leads_to_nothing_but_the_error() {
    let folder = folder();
    let (is_ok, _, text) = plantar(&folder, "import synthetic --steps 1 --cells 8 --out walk.parquet");
    assert!(is_ok, "{text}");
    let path = folder.path().join("walk.parquet");
    let bytes = std::fs::read(&path).expect("a recording");
    let is_panic = |damaged: &[u8]| {
        let read = Recording::parse(damaged.to_vec(), &path);
        read.is_err_and(|error| error.to_string().contains("the file is damaged"))
    };
    let flipped = (0..bytes.len()).map(|at| {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1 << (at % 8);
        damaged
    });
    let damaged: Vec<_> = flipped.filter(|damaged| is_panic(damaged)).collect();
    assert!(!damaged.is_empty(), "the library panics on none of the damaged files");
    for damaged in damaged.iter().take(10) {
        std::fs::write(&path, damaged).expect("written");
        let (is_ok, _, text) = plantar(&folder, "info walk.parquet");
        assert!(!is_ok && text.lines().count() == 1, "{text}");
        assert!(text.starts_with("error: walk.parquet: the file is damaged; copy it again"), "{text}");
    }
}

//! The file format: a written recording is read back unchanged, for invalid files the error names the row or column, and a failed
//! output leaves existing files as they are. Also: recordings in several parts, and the scans of a file.

use parquet::data_type::{DoubleType, FloatType};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use rayon::prelude::*;
use recording::synthetic::{self, SyntheticWalk};
use recording::{MAX_CELLS, Recording, RecordingReader, VirtualInsole, Zero, output};
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::TempDir;

const TWO_CELLS: &str = r#"{"version":1,"side":"right","rate_hz":100,"source":"Test.","layout":{"name":"two",
    "cells":[{"x_mm":5,"y_mm":5,"area_mm2":100,"region":"heel"},
             {"x_mm":15,"y_mm":5,"area_mm2":100,"region":"toe_2"}]}}"#;

/// Writes a file as another program may write it: with one row group, in which no column may contain nulls.
fn write(path: &Path, metadata: Option<&str>, names: [&str; 3], t_s: &[f64], columns_kpa: [&[f32]; 2]) {
    write_with(EnabledStatistics::Chunk, path, metadata, names, t_s, columns_kpa);
}

fn write_with(
    statistics: EnabledStatistics,
    path: &Path,
    metadata: Option<&str>,
    names: [&str; 3],
    t_s: &[f64],
    columns_kpa: [&[f32]; 2],
) {
    write_groups(statistics, path, metadata, names, &[(t_s, columns_kpa)]);
}

/// Writes a row group for each of `groups`: its times, s, and the pressures of its cells, kPa.
fn write_groups(
    statistics: EnabledStatistics,
    path: &Path,
    metadata: Option<&str>,
    names: [&str; 3],
    groups: &[(&[f64], [&[f32]; 2])],
) {
    let [time, first, second] = names;
    let schema = parse_message_type(&format!(
        "message test {{ required double {time}; required float {first}; required float {second}; }}"
    ))
    .unwrap();
    let metadata = metadata.map(|json| vec![KeyValue::new("plantar".to_owned(), json.to_owned())]);
    let properties =
        WriterProperties::builder().set_key_value_metadata(metadata).set_statistics_enabled(statistics).build();
    let file = File::create(path).unwrap();
    let mut writer = SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties)).unwrap();
    for (t_s, columns_kpa) in groups {
        let mut group = writer.next_row_group().unwrap();
        let mut times = group.next_column().unwrap().unwrap();
        times.typed::<DoubleType>().write_batch(t_s, None, None).unwrap();
        times.close().unwrap();
        for values in columns_kpa {
            let mut column = group.next_column().unwrap().unwrap();
            column.typed::<FloatType>().write_batch(values, None, None).unwrap();
            column.close().unwrap();
        }
        group.close().unwrap();
    }
    writer.close().unwrap();
}

/// A temporary folder, and the path of a file in it that does not exist yet.
fn in_folder() -> (TempDir, PathBuf) {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("foot.parquet");
    (folder, path)
}

#[track_caller]
fn assert_refused(path: &Path, expected: &[&str]) {
    let error = Recording::read(path).unwrap_err().to_string();
    assert!(error.contains(path.to_str().unwrap()), "{error}");
    for part in expected {
        assert!(error.contains(part), "`{part}` not in: {error}");
    }
}

/// Asserts that frames of two cells, stated to be at 100 Hz, are rejected.
#[track_caller]
fn assert_frames_refused(t_s: &[f64], first_kpa: &[f32], second_kpa: &[f32], expected: &[&str]) {
    let (_folder, path) = in_folder();
    let names = ["t_s", "c0_kpa", "c1_kpa"];
    write(&path, Some(TWO_CELLS), names, t_s, [first_kpa, second_kpa]);
    assert_refused(&path, expected);
}

#[test]
fn a_written_recording_is_read_back_unchanged() {
    let (_folder, path) = in_folder();
    // There are more frames than fit into a row group, and the number of cells is not a multiple of the 16 columns that the
    // reader transposes at a time.
    let mut written = synthetic::walk(&SyntheticWalk {
        side: Side::Left,
        cells: 37,
        steps: 34,
        rate_hz: 500.0,
        ..SyntheticWalk::default()
    })
    .recording;
    assert!(written.frames() > 16_384);
    written.layout.name = "a \"quoted\" näme".into();
    written.write(&path).unwrap();
    assert!(written == Recording::read(&path).unwrap());
}

/// A file may come from anywhere, and its texts are printed.
#[test]
fn texts_of_a_file_do_not_control_a_terminal() {
    let (_folder, path) = in_folder();
    let mut written = synthetic::walk(&SyntheticWalk { steps: 1, ..SyntheticWalk::default() }).recording;
    written.source = "a\u{1b}[2Jb".into();
    written.layout.name = "a\u{9b}2Jb\u{7}".into();
    written.write(&path).unwrap();
    let read = Recording::read(&path).unwrap();
    assert_eq!((read.source.as_str(), read.layout.name.as_str()), ("a [2Jb", "a 2Jb "));
    // Messages about refused files quote a side, a region, a column and a key.
    let side = TWO_CELLS.replace("right", r"\u001b[2J");
    let region = TWO_CELLS.replace("toe_2", r"\u001b[2J");
    let column = "\u{1b}[2J";
    for (json, names) in [
        (side.as_str(), ["t_s", "c0_kpa", "c1_kpa"]),
        (region.as_str(), ["t_s", "c0_kpa", "c1_kpa"]),
        (TWO_CELLS, ["t_s", column, "c1_kpa"]),
    ] {
        write(&path, Some(json), names, &[0.0], [&[1.0], &[1.0]]);
        assert_refused(&path, &["` [2J`"]);
    }
    let zero = Zero::parse("version = 1\n\"\\u001b[2J\" = 1", Path::new("zero.toml")).unwrap_err().to_string();
    assert!(zero.contains("` [2J`"), "{zero}");
}

#[test]
fn a_failed_write_leaves_an_existing_recording_as_it_is() {
    let (_folder, path) = in_folder();
    let walk = synthetic::walk(&SyntheticWalk { steps: 1, ..SyntheticWalk::default() }).recording;
    walk.write(&path).unwrap();
    let incomplete = path.with_extension("parquet.incomplete");
    assert!(!incomplete.exists());
    // A recording is written in the same way.
    let written = output::file(&path, |to| {
        to.write_all(b"PAR1")?;
        Err(io::Error::other("the disk is full"))
    });
    let error = written.unwrap_err().to_string();
    assert!(error.starts_with(path.to_str().unwrap()) && error.contains("the disk is full"), "{error}");
    assert!(walk == Recording::read(&path).unwrap());
    assert!(!incomplete.exists());
}

#[test]
fn a_separator_at_the_end_of_a_path_names_a_folder() {
    let folder = TempDir::new().unwrap();
    output::at(&folder.path().join("study/"), |incomplete| {
        std::fs::create_dir(incomplete)?;
        std::fs::write(incomplete.join("README.md"), "a study")
    })
    .unwrap();
    assert!(folder.path().join("study/README.md").is_file());
    let error = output::file(&folder.path().join("walk.csv/"), |_| Ok(())).unwrap_err().to_string();
    assert!(error.contains("walk.csv/") && error.contains("name a file"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[cfg(unix)]
#[test]
fn output_to_a_link_whose_target_does_not_exist_creates_the_target() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::create_dir(path("data")).unwrap();
    std::os::unix::fs::symlink("data/walk.csv", path("link.csv")).unwrap();
    std::os::unix::fs::symlink("link.csv", path("other.csv")).unwrap();
    output::file(&path("other.csv"), |to| to.write_all(b"t_s")).unwrap();
    assert!(path("other.csv").is_symlink() && path("link.csv").is_symlink());
    assert_eq!(std::fs::read_to_string(path("data/walk.csv")).unwrap(), "t_s");
}

#[test]
fn a_users_folder_that_has_the_name_of_the_temporary_file_remains() {
    let (_folder, path) = in_folder();
    let walk = synthetic::walk(&SyntheticWalk { steps: 1, ..SyntheticWalk::default() }).recording;
    let incomplete = path.with_extension("parquet.incomplete");
    std::fs::create_dir(&incomplete).unwrap();
    std::fs::write(incomplete.join("notes.txt"), "of the user").unwrap();
    let error = walk.write(&path).unwrap_err().to_string();
    assert!(error.starts_with(incomplete.to_str().unwrap()) && error.contains("rename it"), "{error}");
    assert_eq!(std::fs::read_to_string(incomplete.join("notes.txt")).unwrap(), "of the user");
    assert!(!path.exists());
}

/// macOS writes hidden files such as `._foot.parquet` beside other files.
#[test]
fn hidden_files_are_not_parts_of_a_recording() {
    let (folder, path) = in_folder();
    let walk = synthetic::walk(&SyntheticWalk { steps: 1, ..SyntheticWalk::default() }).recording;
    walk.write(&path).unwrap();
    std::fs::write(folder.path().join("._foot.parquet"), "attributes").unwrap();
    assert!(walk == Recording::read(folder.path()).unwrap());
}

#[test]
fn a_gap_after_a_part_without_frames_is_refused() {
    let folder = TempDir::new().unwrap();
    let part = |name: &str, t_s: &[f64]| {
        let kpa = vec![1.0; t_s.len()];
        write(&folder.path().join(name), Some(TWO_CELLS), ["t_s", "c0_kpa", "c1_kpa"], t_s, [&kpa, &kpa]);
    };
    part("part-0.parquet", &[0.0, 0.01]);
    part("part-1.parquet", &[]);
    part("part-2.parquet", &[0.02, 0.03]);
    assert_eq!(Recording::read(folder.path()).unwrap().frames(), 4);
    part("part-2.parquet", &[0.023, 0.033]);
    let error = RecordingReader::open(folder.path()).err().expect("an error").to_string();
    assert!(error.contains("part-2.parquet") && error.contains("gap in time"), "{error}");
}

/// `part-10` is before `part-2` in the order of names.
#[test]
fn parts_are_joined_in_the_order_of_their_times() {
    let folder = TempDir::new().unwrap();
    for i in 0..12 {
        let path = folder.path().join(format!("part-{}.parquet", i + 1));
        let kpa: &[f32] = &[i as f32];
        write(&path, Some(TWO_CELLS), ["t_s", "c0_kpa", "c1_kpa"], &[0.01 * f64::from(i)], [kpa, kpa]);
    }
    let recording = Recording::read(folder.path()).unwrap();
    assert!(recording.pressure_kpa.chunks_exact(2).enumerate().all(|(i, frame)| frame[0] == i as f32));
}

#[test]
fn a_gap_between_parts_with_row_groups_without_rows_is_refused() {
    let folder = TempDir::new().unwrap();
    let part = |name: &str, groups: &[(&[f64], [&[f32]; 2])]| {
        let path = folder.path().join(name);
        write_groups(EnabledStatistics::Chunk, &path, Some(TWO_CELLS), ["t_s", "c0_kpa", "c1_kpa"], groups);
    };
    let empty: (&[f64], [&[f32]; 2]) = (&[], [&[], &[]]);
    let kpa: [&[f32]; 2] = [&[1.0, 2.0], &[3.0, 4.0]];
    part("part-0.parquet", &[(&[0.0, 0.01], kpa), empty]);
    part("part-1.parquet", &[empty, (&[0.02, 0.03], kpa)]);
    assert_eq!(Recording::read(folder.path()).unwrap().t_s, [0.0, 0.01, 0.02, 0.03]);
    part("part-1.parquet", &[empty, (&[0.023, 0.033], kpa)]);
    let error = RecordingReader::open(folder.path()).err().expect("an error").to_string();
    assert!(error.contains("part-1.parquet") && error.contains("gap in time"), "{error}");
}

#[test]
fn the_source_of_joined_parts_contains_each_source_once() {
    let folder = TempDir::new().unwrap();
    for (i, source) in ["First.", "Second.", "Second.", "Third.", "First."].iter().enumerate() {
        let path = folder.path().join(format!("part-{i}.parquet"));
        let begin_s = 0.02 * i as f64;
        let t_s = [begin_s, begin_s + 0.01];
        let metadata = TWO_CELLS.replace("Test.", source);
        write(&path, Some(&metadata), ["t_s", "c0_kpa", "c1_kpa"], &t_s, [&[1.0, 1.0], &[1.0, 1.0]]);
    }
    assert_eq!(Recording::read(folder.path()).unwrap().source, "First. Second. Third.");
}

/// A temporary folder, and a folder in it for the parts of a recording.
fn folder_for_parts() -> (TempDir, PathBuf) {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("walk.parquet");
    std::fs::create_dir(&path).unwrap();
    (folder, path)
}

#[test]
fn parts_in_memory_are_read_like_a_folder() {
    let (_folder, path) = folder_for_parts();
    let names = ["t_s", "c0_kpa", "c1_kpa"];
    write(&path.join("part-0.parquet"), Some(TWO_CELLS), names, &[0.0, 0.01], [&[1.0, 2.0], &[3.0, 4.0]]);
    write(&path.join("part-1.parquet"), Some(TWO_CELLS), names, &[0.02], [&[5.0], &[6.0]]);
    let mut parts: Vec<_> = ["part-0.parquet", "part-1.parquet"]
        .map(|name| (path.join(name), std::fs::read(path.join(name)).unwrap()))
        .into();
    let recording = Recording::parse_parts(parts.clone(), &path).unwrap();
    assert_eq!(recording.t_s, [0.0, 0.01, 0.02]);
    assert_eq!(recording.pressure_kpa, [1.0, 3.0, 2.0, 4.0, 5.0, 6.0]);
    assert!(recording == Recording::read(&path).unwrap());
    parts.reverse();
    let error = Recording::parse_parts(parts, &path).unwrap_err().to_string();
    assert!(error.contains("part-0.parquet") && error.contains("gap in time"), "{error}");
    let error = Recording::parse_parts(vec![], &path).unwrap_err().to_string();
    assert!(error.contains("walk.parquet: the folder has no .parquet file"), "{error}");
}

#[test]
fn a_file_of_another_writer_with_the_metadata_is_read() {
    let (_folder, path) = in_folder();
    write(
        &path,
        Some(TWO_CELLS),
        ["t_s", "c0_kpa", "c1_kpa"],
        &[0.0, 0.01, 0.02],
        [&[1.0, 2.0, 3.0], &[4.0, 5.0, 6.0]],
    );
    let recording = Recording::read(&path).unwrap();
    assert_eq!(recording.pressure_kpa, [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]);
    assert_eq!(recording.t_s, [0.0, 0.01, 0.02]);
    assert!((recording.force_n(1) - 0.7).abs() < 1e-12);
}

#[test]
fn a_file_that_is_missing_or_not_parquet_is_rejected() {
    let (_folder, path) = in_folder();
    assert_refused(&path, &["check the path"]);
    std::fs::write(&path, "t_s,c0\n0,1\n").unwrap();
    assert_refused(&path, &["not a Parquet file", "plantar import csv"]);
}

#[test]
fn truncated_files_are_rejected() {
    let (_folder, path) = in_folder();
    let walk = synthetic::walk(&SyntheticWalk { steps: 1, ..SyntheticWalk::default() });
    walk.recording.write(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    for part in 0..10 {
        std::fs::write(&path, &bytes[..bytes.len() * part / 10]).unwrap();
        assert_refused(&path, if part == 0 { &["not a Parquet file"] } else { &["cut off", "import"] });
    }
}

/// A file with a damaged bit may be read or rejected, but must not cause a panic.
#[test]
fn damaged_files_are_read_or_rejected() {
    let (_folder, path) = in_folder();
    let walk = synthetic::walk(&SyntheticWalk { steps: 1, cells: 8, ..SyntheticWalk::default() });
    walk.recording.write(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    for at in (0..bytes.len()).step_by(3) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1 << (at % 8);
        std::fs::write(&path, damaged).unwrap();
        if let Ok(recording) = Recording::read(&path) {
            assert_eq!(recording.pressure_kpa.len(), recording.frames() * recording.cells(), "byte {at}");
        }
    }
}

/// The Parquet library allocates memory for as many values as a page claims.
#[test]
fn pages_that_claim_more_values_than_they_hold_are_rejected() {
    let (_folder, path) = in_folder();
    let mut recording = synthetic::walk(&SyntheticWalk { cells: 8, ..SyntheticWalk::default() }).recording;
    recording.t_s.truncate(24);
    recording.pressure_kpa.truncate(24 * 8);
    recording.write(&path).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    // In the header of the dictionary page of the times (Thrift's compact protocol), the number of values follows the header of
    // its struct, 0x4c, and that of its own field, 0x15, and precedes the header of the next field, 0x15. It is stored as a
    // zigzag varint, which contains twice the number.
    let at = bytes.windows(4).position(|window| window == [0x4c, 0x15, 2 * 24, 0x15]).unwrap();
    bytes[at + 2] = 2 * 25;
    std::fs::write(&path, bytes).unwrap();
    assert_refused(&path, &["column t_s", "25 values in a page, at most 24 fit"]);
}

#[test]
fn missing_or_invalid_metadata_is_rejected() {
    let refused = |metadata: Option<&str>, expected: &[&str]| {
        let (_folder, path) = in_folder();
        let names = ["t_s", "c0_kpa", "c1_kpa"];
        write(&path, metadata, names, &[0.0], [&[0.0], &[0.0]]);
        assert_refused(&path, expected);
    };
    refused(None, &["without the metadata", "plantar import csv"]);
    refused(Some(r#"{"version":2,"feet":[]}"#), &["version 2", "update plantar"]);
    refused(Some("{}"), &["cannot be understood", "version"]);
    refused(Some(&TWO_CELLS.replace("toe_2", "thumb")), &["unknown region `thumb`", "metatarsals_12"]);
    refused(Some(&TWO_CELLS.replace("\"right\"", "\"both\"")), &["unknown side `both`"]);
    refused(Some(&TWO_CELLS.replace("\"area_mm2\":100", "\"area_mm2\":0")), &["cell 0", "0.0625 to 4000"]);
    refused(Some(&TWO_CELLS.replace("\"rate_hz\":100", "\"rate_hz\":0")), &["positive rate"]);
    refused(Some(&TWO_CELLS.replace("\"rate_hz\":100", "\"rate_hz\":3e6")), &["3000000 Hz", "at most 1000000 Hz"]);
}

#[test]
fn columns_that_do_not_match_the_layout_are_rejected() {
    let three =
        TWO_CELLS.replace("\"cells\":[", "\"cells\":[{\"x_mm\":50,\"y_mm\":5,\"area_mm2\":9,\"region\":\"heel\"},");
    let refused = |metadata: &str, names: [&str; 3], expected: &[&str]| {
        let (_folder, path) = in_folder();
        write(&path, Some(metadata), names, &[0.0], [&[0.0], &[0.0]]);
        assert_refused(&path, expected);
    };
    refused(&three, ["t_s", "c0_kpa", "c1_kpa"], &["3 columns", "requires 4"]);
    refused(TWO_CELLS, ["t_s", "c1_kpa", "c0_kpa"], &["column 2", "expected `c0_kpa`"]);
}

#[test]
fn impossible_pressures_are_rejected() {
    let t_s = [0.0, 0.01];
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        assert_frames_refused(
            &t_s,
            &[0.0, 0.0],
            &[1.0, bad],
            &["row 2", "column c1_kpa", &format!("pressure {bad} kPa")],
        );
    }
}

#[test]
fn times_that_are_not_uniform_and_increasing_are_rejected() {
    let zeros = [0.0; 4];
    let refused = |t_s: [f64; 4], expected: &[&str]| {
        assert_frames_refused(&t_s, &zeros, &zeros, expected);
    };
    refused([0.0, 0.01, 0.005, 0.03], &["row 3", "backwards"]);
    refused([0.0, 0.01, 0.01, 0.02], &["row 3", "repeated"]);
    refused([0.0, 0.01, 0.04, 0.05], &["row 3", "0.030000 s after", "0.010000 s"]);
    refused([0.0, f64::NAN, 0.02, 0.03], &["row 2", "time NaN is not"]);
    refused([0.0, 0.012, 0.024, 0.039], &["stated rate is 100.000 Hz"]);
    assert_frames_refused(&[], &[], &[], &["no frames"]);
}

#[test]
fn a_wrong_rate_of_all_parts_together_is_reported_for_their_folder() {
    let (_folder, path) = folder_for_parts();
    let names = ["t_s", "c0_kpa", "c1_kpa"];
    let zeros = [0.0; 20];
    // The frames come every 10.2 ms, and not every 10 ms: the difference is significant only after 26 frames.
    for part in 0..2 {
        let t_s: Vec<f64> = (0..20).map(|frame| 0.0102 * f64::from(20 * part + frame)).collect();
        write(&path.join(format!("part-{part}.parquet")), Some(TWO_CELLS), names, &t_s, [&zeros, &zeros]);
    }
    let error = Recording::read(&path).unwrap_err().to_string();
    assert!(error.contains("walk.parquet: the frames come at 98.039 Hz"), "{error}");
    assert!(Recording::read(path.join("part-0.parquet")).is_ok());
}

#[test]
fn jitter_of_less_than_half_a_frame_is_accepted() {
    let (_folder, path) = in_folder();
    let zeros = [0.0; 4];
    write(&path, Some(TWO_CELLS), ["t_s", "c0_kpa", "c1_kpa"], &[0.0, 0.014, 0.019, 0.03], [&zeros, &zeros]);
    assert_eq!(Recording::read(&path).unwrap().frames(), 4);
}

/// The reader decodes columns, while a recording in memory has frames.
#[test]
fn the_scans_of_a_file_equal_those_of_the_recording_in_memory() {
    let (_folder, path) = in_folder();
    let walk = SyntheticWalk { cells: 37, steps: 34, rate_hz: 500.0, ..SyntheticWalk::default() };
    let mut recording = synthetic::walk(&walk).recording;
    recording.pressure_kpa[5] = 1300.0;
    recording.write(&path).unwrap();
    let reader = RecordingReader::open(&path).unwrap();
    assert_eq!((reader.frames(), reader.largest_kpa().unwrap()), (recording.frames(), 1300.0));
    let in_memory = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let of_file = VirtualInsole::up_to(1300.0, &reader.head, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let (mut expected, mut scans) = (in_memory.scans(&recording), of_file.scans(reader));
    while let Some(expected) = expected.next_scan().unwrap() {
        let scan = scans.next_scan().unwrap().expect("a scan");
        assert_eq!((scan.index, scan.t_s, scan.codes), (expected.index, expected.t_s, expected.codes));
    }
    assert!(scans.next_scan().unwrap().is_none());
}

#[test]
fn waiting_for_scans_on_all_global_threads_does_not_deadlock() {
    let (_folder, path) = in_folder();
    let walk = synthetic::walk(&SyntheticWalk { cells: 37, steps: 1, ..SyntheticWalk::default() }).recording;
    walk.write(&path).unwrap();
    let insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let count = |_| {
        let mut scans = insole.scans(RecordingReader::open(&path).unwrap());
        std::iter::from_fn(|| scans.next_scan().unwrap().map(|_| ())).count()
    };
    let counts: Vec<usize> = (0..64).into_par_iter().map(count).collect();
    assert_eq!(counts, [insole.frames(&walk); 64]);
}

#[test]
fn the_largest_pressure_is_known_with_and_without_statistics_of_the_columns() {
    let (_folder, path) = in_folder();
    let names = ["t_s", "c0_kpa", "c1_kpa"];
    for statistics in [EnabledStatistics::None, EnabledStatistics::Chunk, EnabledStatistics::Page] {
        write_with(statistics, &path, Some(TWO_CELLS), names, &[0.0, 0.01], [&[1.0, 2.0], &[4.5, 3.0]]);
        assert_eq!(RecordingReader::open(&path).unwrap().largest_kpa().unwrap(), 4.5);
    }
}

#[test]
fn pressures_above_the_statistics_of_their_column_are_rejected() {
    let (_folder, path) = in_folder();
    let names = ["t_s", "c0_kpa", "c1_kpa"];
    write(&path, Some(TWO_CELLS), names, &[0.0, 0.01], [&[1.0, 2.0], &[3.0, 4.5]]);
    let mut bytes = std::fs::read(&path).unwrap();
    // The value itself comes first, and the statistics are at the end of the file.
    let values: Vec<usize> = (0..bytes.len() - 4).filter(|&at| bytes[at..at + 4] == 4.5f32.to_le_bytes()).collect();
    for &at in &values[1..] {
        bytes[at..at + 4].copy_from_slice(&3.5f32.to_le_bytes());
    }
    std::fs::write(&path, bytes).unwrap();
    assert_refused(&path, &["row 2", "column c1_kpa", "4.5 kPa", "at most 3.5 kPa"]);
}

#[test]
fn an_error_in_a_file_is_returned_by_its_scans() {
    let (_folder, path) = in_folder();
    write(&path, Some(TWO_CELLS), ["t_s", "c0_kpa", "c1_kpa"], &[0.0, 0.03], [&[1.0, 2.0], &[4.0, 3.0]]);
    let reader = RecordingReader::open(&path).unwrap();
    let insole = VirtualInsole::up_to(4.0, &reader.head, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let mut scans = insole.scans(reader);
    let error = scans.next_scan().err().expect("an error").to_string();
    assert!(error.contains("row 2, column t_s: 0.030000 s after"), "{error}");
    assert!(matches!(scans.next_scan(), Ok(None)));
}

#[test]
fn too_many_cells_are_not_written() {
    let (_folder, path) = in_folder();
    let layout = synthetic::insole(MAX_CELLS + 1);
    let recording = Recording {
        side: Side::Left,
        rate_hz: 100.0,
        source: "Test.".into(),
        t_s: vec![0.0],
        pressure_kpa: synthetic::loaded_frame(&layout),
        layout,
    };
    let error = recording.write(&path).unwrap_err().to_string();
    assert!(error.contains("4097 cells, at most 4096"), "{error}");
    assert!(!path.exists());
}

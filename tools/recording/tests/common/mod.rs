//! A computed step on a matrix sensor, and helpers for tests of importers.
#![allow(dead_code, reason = "each test uses a part of it")]

use plantar::{Region, Side};
use recording::{Error, Export, Format, Options, Recording};
use std::path::{Path, PathBuf};

/// Rows and columns of the sensor.
pub const ROWS: usize = 30;
pub const COLUMNS: usize = 11;
/// Frames of the stance, and of the swing after it.
pub const STANCE: usize = 60;
pub const SWING: usize = 20;

/// The pressure, kPa, of a cell in a frame of a step, seen from above with the toes in the first row. Heel, lateral midfoot,
/// forefoot, hallux and lesser toes are loaded one after the other.
pub fn pressure_kpa(side: Side, frame: usize, row: usize, column: usize) -> f64 {
    if frame >= STANCE {
        return 0.0;
    }
    let time = frame as f64 / STANCE as f64;
    let forward = 1.0 - (row as f64 + 0.5) / ROWS as f64;
    let right = (column as f64 + 0.5) / COLUMNS as f64;
    let lateral = if side == Side::Right { right } else { 1.0 - right };
    // For each loaded part of the foot: its position forward and lateral as fractions of length and width, its radius as a
    // fraction of the length, its largest pressure, kPa, and the time of this pressure as a fraction of stance.
    let parts = [
        (0.14, 0.5, 0.16, 250.0, 0.2),
        (0.42, 0.75, 0.13, 60.0, 0.45),
        (0.68, 0.45, 0.16, 220.0, 0.7),
        (0.91, 0.25, 0.08, 240.0, 0.85),
        (0.86, 0.65, 0.07, 60.0, 0.85),
    ];
    let kpa: f64 = parts
        .iter()
        .map(|&(y, x, radius, largest_kpa, peak_time)| {
            let distance = ((forward - y).powi(2) + (0.4 * (lateral - x)).powi(2)) / (radius * radius);
            largest_kpa * (1.0 - distance).max(0.0) * (1.0 - ((time - peak_time) / 0.28).powi(2)).max(0.0)
        })
        .sum();
    // Vendors' systems read pressures below a threshold as 0.
    if kpa < 5.0 { 0.0 } else { (kpa * 100.0).round() / 100.0 }
}

/// The force on all cells in a frame, N, for cells of this area.
pub fn force_n(side: Side, frame: usize, area_mm2: f64) -> f64 {
    let cells = (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |column| (row, column)));
    cells.map(|(row, column)| pressure_kpa(side, frame, row, column)).sum::<f64>() * area_mm2 * 1e-3
}

/// Parses a text as a file of this name.
pub fn parse(format: Format, name: &str, text: &[u8], side: Option<Side>) -> recording::Result<Export> {
    format.parse(text, Path::new(name), Options { side, ..Options::default() })
}

/// Checks that an import fails with a message that begins with `place`, the file and perhaps the line, and contains `words`.
pub fn assert_message(result: recording::Result<Export>, place: &str, words: &[&str]) {
    let error = result.expect_err("the file is refused");
    assert!(matches!(error, Error::Content { .. }));
    let message = error.to_string();
    assert!(message.starts_with(place), "{message}");
    for word in words {
        assert!(message.contains(word), "`{word}` is not in: {message}");
    }
}

/// Checks that the computed step was imported: its forces, to within the fraction `tolerance`, the order in which heel and
/// forefoot are loaded, and that midfoot and hallux are loaded on the correct side.
pub fn assert_step(recording: &Recording, side: Side, area_mm2: f64, tolerance: f64) {
    assert_eq!(recording.side, side);
    for frame in 0..recording.frames().min(STANCE) {
        let (imported_n, true_n) = (recording.force_n(frame), force_n(side, frame, area_mm2));
        assert!(
            (imported_n - true_n).abs() <= tolerance * true_n + 0.01,
            "frame {frame}: {imported_n} N, not {true_n} N"
        );
    }
    assert_eq!(region_of_largest(recording, 10), Region::Heel);
    let late = region_of_largest(recording, 52);
    assert!([Region::Hallux, Region::Metatarsals12, Region::Metatarsals35].contains(&late), "{late:?}");
    let x_mm = |frame: usize, from: f64, to: f64| {
        let length_mm = recording.layout.cells.iter().map(|c| c.y_mm).fold(0.0, f64::max);
        let cells = recording.layout.cells.iter().zip(recording.frame(frame));
        let band = cells.filter(|(c, _)| (from * length_mm..to * length_mm).contains(&c.y_mm));
        let sum = band.fold((0.0, 0.0), |s, (c, &kpa)| (s.0 + c.x_mm * f64::from(kpa), s.1 + f64::from(kpa)));
        sum.0 / sum.1
    };
    assert!(x_mm(27, 0.36, 0.48) > x_mm(12, 0.0, 0.3) + 8.0, "the load of the midfoot is lateral of that of the heel");
    assert!(x_mm(51, 0.92, 1.0) < x_mm(42, 0.6, 0.75) - 4.0, "the hallux is medial of the middle of the forefoot");
}

/// The region of the cell with the largest pressure.
fn region_of_largest(recording: &Recording, frame: usize) -> Region {
    let cells = recording.layout.cells.iter().zip(recording.frame(frame));
    cells.max_by(|a, b| a.1.total_cmp(b.1)).expect("cells").0.region
}

/// The folder with recordings of people.
///
/// # Panics
/// Panics if the environment variable `PLANTAR_RECORDINGS`, which contains its path, is not set.
pub fn recordings() -> PathBuf {
    PathBuf::from(
        std::env::var_os("PLANTAR_RECORDINGS").expect("PLANTAR_RECORDINGS names a folder with recordings of people"),
    )
}

/// The frames of an import that are in the export, without the `added` unloaded frames before and after them.
pub fn exported_frames(recording: &Recording, added: usize) -> Recording {
    let mut exported = recording.clone();
    let range = added..recording.frames() - added;
    exported.t_s = recording.t_s[range.clone()].to_vec();
    exported.pressure_kpa =
        recording.pressure_kpa[range.start * recording.cells()..range.end * recording.cells()].to_vec();
    exported
}

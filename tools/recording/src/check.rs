//! The rules that every recording obeys. They are checked when a recording is read, imported or written.

use crate::gaps::is_filled;
use crate::table::check_later;
use crate::{Error, Layout, MAX_CELLS, Recording, Result};
use plantar::pipeline::region::{MAX_CELL_MM2, MIN_CELL_MM2};

/// The part of a recording that violates a rule. The caller's `place` converts it to text for the message: the name of a file
/// with a line, row or column.
#[derive(Clone, Copy)]
pub enum At {
    /// The recording as a whole.
    Whole,
    /// A frame, counted from 0.
    Frame(usize),
    /// The pressure of one cell in one frame.
    Value { frame: usize, cell: usize },
}

/// Checks all rules. `place` converts the part of the recording that violates a rule to text for the message.
pub fn recording(recording: &Recording, place: &dyn Fn(At) -> String) -> Result<()> {
    layout(&recording.layout, &place(At::Whole))?;
    let (frames, cells) = (recording.frames(), recording.cells());
    if recording.pressure_kpa.len() != frames * cells {
        return Err(Error::content(
            place(At::Whole),
            format!("{} pressures for {frames} frames of {cells} cells", recording.pressure_kpa.len()),
            "provide one pressure for each frame and cell",
        ));
    }
    let mut time_check = TimeCheck::new(recording.rate_hz, place)?;
    time_check.add(&recording.t_s, place)?;
    time_check.finish(place)?;
    pressures(&recording.pressure_kpa, cells, place)
}

/// Largest coordinate of a cell, mm. A larger value must be in another unit.
const MAX_COORDINATE_MM: f64 = 10_000.0;
/// Largest time, s: three hundred years. A larger value must be in another unit.
const MAX_TIME_S: f64 = 1e10;
/// Largest frame rate, Hz, because a virtual insole counts the time between frames in whole microseconds. A larger value must be
/// in another unit.
pub const MAX_HZ: f64 = 1e6;
/// Largest pressure, kPa: ten times the pressure of a hard edge under a heel. A larger value must be in another unit.
pub const MAX_KPA: f32 = 50_000.0;

/// The remedy for times that are not uniform.
pub const RESAMPLE: &str = "resample it to uniform time, as plantar import csv does with --rate";

/// Largest number of pressures in a recording; they occupy 8 GiB. Without this limit, a small file could exhaust the memory,
/// because equal values are compressed, cells without load are not stored, and gaps are filled. The limit is lower for fuzzing,
/// which reads many files.
const MAX_VALUES: u64 = if cfg!(fuzzing) { 1 << 22 } else { 1 << 31 };

/// Checks that a recording with this number of frames and cells fits into memory. Messages begin with `place`.
pub fn value_count(frames: u64, cells: usize, place: &str) -> Result<()> {
    if frames <= MAX_VALUES / cells.max(1) as u64 {
        return Ok(());
    }
    Err(Error::content(
        place,
        format!("{frames} frames of {cells} cells, more than this program can hold in memory"),
        "split the recording, or copy or import the file again",
    ))
}

/// Checks the number of cells and their geometry. Messages begin with `place`.
pub fn layout(layout: &Layout, place: &str) -> Result<()> {
    cell_count(layout.cells.len(), place)?;
    geometry(layout, place)
}

/// Checks the positions and the areas of the cells. Messages begin with `place`.
pub fn geometry(layout: &Layout, place: &str) -> Result<()> {
    for (i, cell) in layout.cells.iter().enumerate() {
        if !(cell.x_mm.abs() <= MAX_COORDINATE_MM && cell.y_mm.abs() <= MAX_COORDINATE_MM) {
            return Err(Error::content(
                place,
                format!("cell {i} lies at ({}, {}) mm", cell.x_mm, cell.y_mm),
                "state the coordinates of each cell in mm, within 10 m",
            ));
        }
        let (least_mm2, most_mm2) = (f64::from(MIN_CELL_MM2), f64::from(MAX_CELL_MM2));
        if !(least_mm2..=most_mm2).contains(&cell.area_mm2) {
            return Err(Error::content(
                place,
                format!("cell {i} has an area of {} mm²", cell.area_mm2),
                format!("state the area of each cell in mm², {least_mm2} to {most_mm2}"),
            ));
        }
    }
    Ok(())
}

/// Checks that the number of cells is 1 to [`MAX_CELLS`]. Messages begin with `place`.
pub fn cell_count(cells: usize, place: &str) -> Result<()> {
    if cells == 0 {
        return Err(Error::content(place, "no cells", "describe at least one cell"));
    }
    if cells > MAX_CELLS {
        return Err(Error::content(
            place,
            format!("{cells} cells, at most {MAX_CELLS} are supported"),
            "merge neighbouring cells before the import",
        ));
    }
    Ok(())
}

/// Checks the times of a recording, which can come in blocks: each frame follows the previous one after `1 / rate_hz`, to within
/// half of this interval, and the mean rate is `rate_hz`, to within 1 % (in a short recording, to within half an interval).
#[derive(Clone)]
pub struct TimeCheck {
    rate_hz: f64,
    frames: usize,
    first_s: f64,
    last_s: f64,
}

impl TimeCheck {
    /// Checks the rate.
    pub fn new(rate_hz: f64, place: &dyn Fn(At) -> String) -> Result<Self> {
        rate(rate_hz, place)?;
        Ok(Self { rate_hz, frames: 0, first_s: 0.0, last_s: 0.0 })
    }

    /// Checks the times of the next frames. `place` counts frames from the first one of these.
    pub fn add(&mut self, t_s: &[f64], place: &dyn Fn(At) -> String) -> Result<()> {
        let (&[first_s, ..], &[.., last_s]) = (t_s, t_s) else { return Ok(()) };
        times(t_s, place)?;
        if self.frames == 0 {
            self.first_s = first_s;
        } else {
            interval(self.last_s, first_s, self.rate_hz, &|| place(At::Frame(0)))?;
        }
        intervals(t_s, self.rate_hz, place)?;
        self.last_s = last_s;
        self.frames += t_s.len();
        Ok(())
    }

    /// Checks the number of frames and the mean rate. If every interval is slightly too long, each one passes [`TimeCheck::add`],
    /// but the mean rate is wrong.
    pub fn finish(&self, place: &dyn Fn(At) -> String) -> Result<()> {
        if self.frames == 0 {
            return Err(Error::content(place(At::Whole), "no frames", "record at least one frame"));
        }
        let (intervals, span_s, rate_hz) = ((self.frames - 1) as f64, self.last_s - self.first_s, self.rate_hz);
        if (span_s * rate_hz - intervals).abs() > (0.01 * intervals).max(0.5) {
            return Err(Error::content(
                place(At::Whole),
                format!("the frames come at {:.3} Hz, the stated rate is {rate_hz:.3} Hz", intervals / span_s),
                "correct the stated rate",
            ));
        }
        Ok(())
    }
}

/// Checks that a frame rate is positive, and at most [`MAX_HZ`].
pub fn rate(rate_hz: f64, place: &dyn Fn(At) -> String) -> Result<()> {
    if rate_hz > 0.0 && rate_hz <= MAX_HZ {
        return Ok(());
    }
    Err(Error::content(
        place(At::Whole),
        format!("a rate of {rate_hz} Hz"),
        format!("state a positive rate of at most {MAX_HZ} Hz, and times in seconds"),
    ))
}

/// Checks that all times are finite, and at most [`MAX_TIME_S`] in magnitude.
pub fn times(t_s: &[f64], place: &dyn Fn(At) -> String) -> Result<()> {
    let Some(i) = t_s.iter().position(|t| !(-MAX_TIME_S..=MAX_TIME_S).contains(t)) else { return Ok(()) };
    Err(Error::content(
        place(At::Frame(i)),
        format!("time {} is not a number of seconds from -{MAX_TIME_S:e} to {MAX_TIME_S:e}", t_s[i]),
        "state the time of each frame in seconds",
    ))
}

/// Checks that each frame follows the previous one after `1 / rate_hz`, to within half of this interval.
pub fn intervals(t_s: &[f64], rate_hz: f64, place: &dyn Fn(At) -> String) -> Result<()> {
    for (i, pair) in t_s.windows(2).enumerate() {
        interval(pair[0], pair[1], rate_hz, &|| place(At::Frame(i + 1)))?;
    }
    Ok(())
}

/// Checks that the frame at `after_s` follows the frame at `before_s` after `1 / rate_hz`, to within half of this interval.
fn interval(before_s: f64, after_s: f64, rate_hz: f64, place: &dyn Fn() -> String) -> Result<()> {
    check_later(after_s, Some(before_s), place)?;
    let (interval_s, expected_s) = (after_s - before_s, 1.0 / rate_hz);
    if (interval_s * rate_hz - 1.0).abs() <= 0.5 {
        return Ok(());
    }
    let problem = format!("{interval_s:.6} s after the frame before, expected {expected_s:.6} s at {rate_hz:.6} Hz");
    let split = "split the recording at this frame, as plantar import does with --from and --to";
    // Resampling does not accept longer intervals.
    let remedy = if is_filled(interval_s, expected_s) { format!("{split}, or {RESAMPLE}") } else { split.into() };
    Err(Error::content(place(), problem, remedy))
}

/// Checks that all pressures are finite, not negative, and at most [`MAX_KPA`].
pub fn pressures(pressure_kpa: &[f32], cells: usize, place: &dyn Fn(At) -> String) -> Result<()> {
    let valid = |kpa: f32| (0.0..=MAX_KPA).contains(&kpa);
    for (frame, row) in pressure_kpa.chunks_exact(cells).enumerate() {
        // `fold` tests every value, so that the compiler can vectorise the loop. The cell is then searched in invalid rows
        // only.
        if row.iter().fold(true, |all, &kpa| all & valid(kpa)) {
            continue;
        }
        if let Some(cell) = row.iter().position(|&kpa| !valid(kpa)) {
            return Err(Error::content(
                place(At::Value { frame, cell }),
                format!("pressure {} kPa", row[cell]),
                format!(
                    "pressures must be finite, 0 to {MAX_KPA} kPa; convert other units to kPa, or repair or remove the frame"
                ),
            ));
        }
    }
    Ok(())
}

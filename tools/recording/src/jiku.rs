//! Import of the open data set SpeedPP2DS (Pataky and Crompton) from the package `jiku-data`: barefoot steps of ten walkers on
//! a pressure plate at 500 Hz, one HDF5 file for each walker.
//!
//! Each trial is one step. The rows of its images were resampled before they were stored; the import recovers the native rows
//! of the plate. The data set does not state the unit of force. The import assumes 0.1 N for one stored unit, with which the
//! body masses are plausible. In the stored images the hallux is at small columns, as in a right foot seen from above, so all
//! steps are imported as right feet.

mod native;
mod registration;

use crate::check::{self, At};
use crate::error::caught;
use crate::table::file_name;
use crate::{Cell, Error, Layout, Recording, Result, template};
use hdf5_reader::Hdf5File;
use native::{Step, Unusable};
use plantar::{Region, Side};
use registration::Shift;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Number of walkers in the data set.
pub const WALKERS: usize = 10;
/// Number of trials of each walker.
pub const TRIALS: usize = 60;
/// Frame rate of the plate, Hz.
pub const RATE_HZ: f64 = 500.0;
/// Unloaded time that is inserted before the first step, between successive steps and after the last step, s.
pub const SWING_S: f64 = 0.4;
/// Number of frames in this time.
const SWING_FRAMES: usize = (SWING_S * RATE_HZ).round() as usize;

/// Extent of a native cell along the foot, mm.
const CELL_LENGTH_MM: f64 = 7.62;
/// Extent of a native cell across the foot, mm.
const CELL_WIDTH_MM: f64 = 5.08;
/// The remedy for a file that is damaged or has another content.
const REMEDY: &str = "install jiku-data again";
/// The force that one stored unit is assumed to mean, N.
const UNIT_N: f64 = 0.1;

/// Concatenates trials of one walker to one recording. The recording is not a continuous walk: each trial is a separate step
/// over the plate, and unloaded frames for [`SWING_S`] are inserted before the first step, between successive steps and after the
/// last one.
///
/// Each step is shifted by whole native cells to the best overlap with the previous steps, so that no reading is interpolated.
/// It is not rotated. The layout contains all cells that are loaded in at least one frame. A trial that is empty, still loaded in
/// its last frame, or with rows that were not resampled as expected, is left out; [`Recording::source`] lists these trials, each
/// with the reason.
///
/// `dir` is the folder of the data set, or its subfolder `data_y`. Walkers and trials are numbered from 0; the trials are
/// imported in the given order. `progress` receives the size of the file, bytes, times the fraction of the trials that have been
/// processed, and the size itself.
///
/// # Errors
/// Fails if the data set has no walker or trial of this number, the file or a trial is missing or cannot be read, no trial is
/// usable, or the recording violates a rule of recordings or does not fit into memory.
pub fn import(
    dir: impl AsRef<Path>,
    walker: usize,
    trials: impl IntoIterator<Item = usize>,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Recording> {
    let path = walker_file(dir.as_ref(), walker)?;
    let total_bytes = std::fs::metadata(&path).map_err(Error::io(&path))?.len();
    let trials: Vec<usize> = trials.into_iter().collect();
    let mut progress = |share| progress((total_bytes as f64 * share) as u64, total_bytes);
    caught(&path.display().to_string(), REMEDY, || read(Hdf5File::open(&path), &path, walker, &trials, &mut progress))
}

/// As [`import`], from the content of a walker's file. In messages the file is called `subj000.h5`.
///
/// # Errors
/// Fails in the same cases as [`import`].
pub fn parse(bytes: &[u8], trials: &[usize]) -> Result<Recording> {
    let name = "subj000.h5";
    caught(name, REMEDY, || read(Hdf5File::from_bytes(bytes), Path::new(name), 0, trials, &mut |_| {}))
}

/// As [`import`], from an opened file. `progress` receives the fraction of the trials that have been processed.
fn read(
    file: std::result::Result<Hdf5File, hdf5_reader::error::Error>,
    path: &Path,
    walker: usize,
    trials: &[usize],
    progress: &mut dyn FnMut(f64),
) -> Result<Recording> {
    let file = file.map_err(|error| {
        Error::content(path.display().to_string(), format!("not a readable HDF5 file ({error})"), REMEDY)
    })?;
    if let Some(trial) = trials.iter().find(|trial| **trial >= TRIALS) {
        return Err(Error::content(
            path.display().to_string(),
            format!("no trial {trial}"),
            format!("choose trials from 0 to {}", TRIALS - 1),
        ));
    }
    if trials.is_empty() {
        return Err(Error::content(path.display().to_string(), "no trials to import", "import at least one trial"));
    }
    let mut used = Vec::new();
    let mut left_out = Vec::new();
    let mut steps = Vec::new();
    for (done, &trial) in trials.iter().enumerate() {
        progress(done as f64 / trials.len() as f64);
        match native::read(&file, trial) {
            Ok(step) if step.is_empty() => left_out.push(format!("{trial} (empty)")),
            Ok(step) if step.is_cut_off() => left_out.push(format!("{trial} (cut off)")),
            Ok(step) => {
                used.push(trial.to_string());
                steps.push(step);
            }
            Err(Unusable::NotResampled(reason)) => left_out.push(format!("{trial} ({reason})")),
            // With fewer trials than in the data set, results would change without a message.
            Err(Unusable::Damaged(reason)) => return Err(damaged(path, trial, &reason)),
        }
    }
    progress(1.0);
    if steps.is_empty() {
        return Err(Error::content(
            path.display().to_string(),
            format!("no usable step; trials left out: {}", left_out.join(", ")),
            format!("import other trials, 0 to {}, or another walker", TRIALS - 1),
        ));
    }
    let shifts = registration::shifts(&steps);
    let grid = Grid::of(&steps, &shifts);
    let name = path.display().to_string();
    check::cell_count(grid.indices.len(), &name)?;
    let frames = frame_count(&steps, grid.indices.len(), &name)?;
    let mut source = format!(
        "SpeedPP2DS (Pataky and Crompton, jiku-data), {}: {} separate barefoot steps on a pressure \
         plate (trials {}), concatenated with {SWING_S} s without load before, between and after them; \
         native rows recovered, assuming {UNIT_N} N per stored unit, steps aligned by shifts of whole cells, \
         imported as right feet, regions by template.",
        file_name(path),
        steps.len(),
        used.join(", ")
    );
    if !left_out.is_empty() {
        source += &format!(" Trials left out: {}.", left_out.join(", "));
    }
    let recording = Recording {
        side: Side::Right,
        layout: Layout { name: format!("pressure plate, walker {walker}"), cells: grid.cells(), sheet: None },
        rate_hz: RATE_HZ,
        source,
        t_s: (0..frames).map(|frame| frame as f64 / RATE_HZ).collect(),
        pressure_kpa: concatenate(&steps, &shifts, &grid, frames),
    };
    check::recording(&recording, &|at| match at {
        At::Whole => name.clone(),
        At::Frame(frame) => format!("{name}, at {} s of the recording", recording.t_s[frame]),
        At::Value { frame, cell } => format!("{name}, at {} s of the recording, cell {cell}", recording.t_s[frame]),
    })?;
    Ok(recording)
}

/// The error for a trial that is missing in a file or cannot be read.
fn damaged(path: &Path, trial: usize, reason: &str) -> Error {
    let remedy = match trial {
        0 => REMEDY.to_owned(),
        _ => format!("{REMEDY}, or import only the trials before it (`--trials {trial}`)"),
    };
    Error::content(path.display().to_string(), format!("trial {trial} is missing or damaged ({reason})"), remedy)
}

/// The path of the file of a walker, in `dir` or in its subfolder `data_y`.
fn walker_file(dir: &Path, walker: usize) -> Result<PathBuf> {
    if walker >= WALKERS {
        return Err(Error::content(
            dir.display().to_string(),
            format!("no walker {walker}"),
            format!("choose a walker from 0 to {}", WALKERS - 1),
        ));
    }
    let name = format!("subj{walker:03}.h5");
    [dir.join(&name), dir.join("data_y").join(&name)].into_iter().find(|path| path.is_file()).ok_or_else(|| {
        Error::content(
            dir.display().to_string(),
            format!("no file {name}"),
            "give the folder SpeedPP2DS of an installed jiku-data",
        )
    })
}

/// The cells of the plate that are loaded in at least one step. Their coordinates are common to all steps.
struct Grid {
    /// The index in a frame of the cell at (row, column) of the plate. Rows are numbered from heel to toes.
    indices: BTreeMap<(isize, isize), usize>,
}

impl Grid {
    /// The cells that are loaded in at least one of these steps after their shifts.
    fn of(steps: &[Step], shifts: &[Shift]) -> Self {
        let mut indices = BTreeMap::new();
        for (step, shift) in steps.iter().zip(shifts) {
            for cell in step.loaded_cells() {
                indices.insert(shift.apply(cell), 0);
            }
        }
        for (i, index) in indices.values_mut().enumerate() {
            *index = i;
        }
        Self { indices }
    }

    /// The cells in foot coordinates, in the order of their indices.
    fn cells(&self) -> Vec<Cell> {
        let least = |axis: fn(&(isize, isize)) -> isize| self.indices.keys().map(axis).min();
        let (Some(back), Some(medial)) = (least(|k| k.0), least(|k| k.1)) else {
            return Vec::new();
        };
        let mut cells: Vec<Cell> = self
            .indices
            .keys()
            .map(|(row, column)| Cell {
                x_mm: ((column - medial) as f64 + 0.5) * CELL_WIDTH_MM,
                y_mm: ((row - back) as f64 + 0.5) * CELL_LENGTH_MM,
                area_mm2: CELL_LENGTH_MM * CELL_WIDTH_MM,
                // Replaced by the template below.
                region: Region::Heel,
            })
            .collect();
        template::assign(&mut cells);
        cells
    }
}

/// The number of frames of the concatenated steps, swing included. `cells` is the number of cells of the recording.
///
/// # Errors
/// Fails if the recording does not fit into memory. The message begins with `file`.
fn frame_count(steps: &[Step], cells: usize, file: &str) -> Result<usize> {
    let frames = (steps.len() + 1) * SWING_FRAMES + steps.iter().map(Step::frames).sum::<usize>();
    check::value_count(frames as u64, cells, file)?;
    Ok(frames)
}

/// The pressures of all frames, kPa, frame by frame: swing, step, swing, step, ..., swing. Their number is `frames`.
fn concatenate(steps: &[Step], shifts: &[Shift], grid: &Grid, frames: usize) -> Vec<f32> {
    let kpa_per_unit = (UNIT_N / (CELL_LENGTH_MM * CELL_WIDTH_MM) * 1e3) as f32;
    let cells = grid.indices.len();
    let mut pressure_kpa = vec![0.0; frames * cells];
    let mut start = SWING_FRAMES * cells;
    for (step, shift) in steps.iter().zip(shifts) {
        for cell in step.loaded_cells() {
            let index = grid.indices[&shift.apply(cell)];
            for (frame, &units) in pressure_kpa[start..].chunks_exact_mut(cells).zip(step.series(cell)) {
                frame[index] = f32::from(units) * kpa_per_unit;
            }
        }
        start += (step.frames() + SWING_FRAMES) * cells;
    }
    pressure_kpa
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step with many frames and one with many cells may be small, but the recording has the frames and the cells of both.
    #[test]
    fn frames_that_do_not_fit_into_memory_are_refused() {
        let step = |frames: usize| Step::new(1, frames, vec![1; frames]);
        let count = |frames| frame_count(&[step(frames), step(10)], 4096, "subj000.h5").map_err(|e| e.to_string());
        assert_eq!(count(50), Ok(60 + 3 * 200));
        let error = count(1 << 20).unwrap_err();
        assert!(error.starts_with("subj000.h5: 1049186 frames of 4096 cells, more than"), "{error}");
    }
}

//! One trial on the native grid of the plate.
//!
//! The stored rows are 5.08 mm apart. They were interpolated linearly from native rows that are 7.62 mm apart. So two native
//! rows, n0 and n1, result in three stored rows, r0, r1 and r2. In the next group, n0' and r0' correspond to n0 and r0:
//!
//! ```text
//! r0 = n0    r1 = n0/3 + 2 n1/3    r2 = 2 n1/3 + n0'/3    r0' = n0'
//! ```
//!
//! Hence n0 = r0, and n1 has two estimates: (3 r1 - r0)/2 and (3 r2 - r0')/2. The number of rows before the first full group of
//! three differs between trials. The right number is the one for which both estimates agree to within rounding.

use hdf5_reader::Hdf5File;
use hdf5_reader::error::Error;
use std::ops::Range;

/// Largest accepted difference between the doubled estimates. r0 and r0' are native integers and were not rounded. Rounding
/// changed r1 and r2 by up to half a unit each, and each doubled estimate multiplies one of the two by three.
const TOLERANCE: i32 = 3;

/// Largest number of values in a trial. A real trial has about 60 x 40 x 500 values; a damaged file may claim any number.
const MAX_VALUES: u64 = 1 << 22;

/// Row and column of a cell on the native grid of one step.
pub type NativeCell = (usize, usize);

/// A trial, all of its frames; the methods return those from the first to the last loaded one.
pub struct Step {
    columns: usize,
    stored_frames: usize,
    /// The frames from the first to the last loaded one.
    loaded: Range<usize>,
    /// Stored units, rows x columns x stored frames.
    units: Vec<u16>,
}

impl Step {
    /// A step from its units, rows x columns x stored frames.
    pub fn new(columns: usize, stored_frames: usize, units: Vec<u16>) -> Self {
        let mut loaded = stored_frames..0;
        for series in units.chunks_exact(stored_frames) {
            if let Some(first) = series.iter().position(|&u| u > 0) {
                let last = series.iter().rposition(|&u| u > 0).unwrap_or(first);
                loaded = loaded.start.min(first)..loaded.end.max(last + 1);
            }
        }
        Self { columns, stored_frames, loaded, units }
    }

    /// True if no cell is loaded in any frame.
    pub fn is_empty(&self) -> bool {
        self.loaded.is_empty()
    }

    /// True if the foot was still on the plate when the trial ended.
    pub fn is_cut_off(&self) -> bool {
        self.loaded.end == self.stored_frames
    }

    /// Number of frames from the first to the last loaded frame.
    pub fn frames(&self) -> usize {
        self.loaded.len()
    }

    /// The cells that are loaded in at least one frame.
    pub fn loaded_cells(&self) -> impl Iterator<Item = NativeCell> {
        self.units
            .chunks_exact(self.stored_frames)
            .enumerate()
            .filter(|(_, series)| series.iter().any(|&u| u > 0))
            .map(|(i, _)| (i / self.columns, i % self.columns))
    }

    /// The readings of one cell from the first to the last loaded frame of the step, stored units.
    pub fn series(&self, (row, column): NativeCell) -> &[u16] {
        let start = (row * self.columns + column) * self.stored_frames;
        &self.units[start..][self.loaded.clone()]
    }
}

/// Why a trial cannot be used, with the reason as text.
pub enum Unusable {
    /// Its rows were not resampled as expected. This is a property of the data.
    NotResampled(String),
    /// The file does not contain the trial, or the trial cannot be read.
    Damaged(String),
}

/// Reads one trial, numbered from 0.
///
/// # Errors
/// See [`Unusable`].
pub fn read(file: &Hdf5File, trial: usize) -> Result<Step, Unusable> {
    let unreadable = |error: Error| Unusable::Damaged(format!("not readable: {error}"));
    let dataset = file.dataset(&format!("/img{trial:03}")).map_err(unreadable)?;
    let values = dataset.num_elements().map_err(unreadable)?;
    if values > MAX_VALUES {
        return Err(Unusable::Damaged(format!("{values} values, a trial has at most {MAX_VALUES}")));
    }
    let stored = dataset.read_array::<u16>().map_err(unreadable)?;
    let &[rows, columns, frames] = stored.shape() else {
        let reason = format!("{} dimensions, expected rows, columns and frames", stored.ndim());
        return Err(Unusable::Damaged(reason));
    };
    if stored.is_empty() {
        return Ok(Step::new(columns, frames.max(1), Vec::new()));
    }
    let row_length = columns * frames;
    let values: Vec<u16> = stored.iter().copied().collect();
    match native_rows(&values, rows, row_length) {
        Ok(units) => Ok(Step::new(columns, frames, units)),
        Err(difference_units) => Err(Unusable::NotResampled(format!(
            "not resampled from 7.62 mm rows: the estimates of a native row differ by {difference_units:.1} units"
        ))),
    }
}

/// Recovers the native rows.
///
/// # Errors
/// Fails if the estimates do not agree for any number of rows before the first full group. The error is the largest difference
/// between two estimates, in units, for the number of rows with the best agreement.
fn native_rows(values: &[u16], rows: usize, row_length: usize) -> Result<Vec<u16>, f64> {
    let aligned = [0, 1, 2].map(|phase| Aligned::new(values, rows, row_length, phase));
    let mut best = (i32::MAX, &aligned[0]);
    for candidate in &aligned {
        let difference = candidate.disagreement();
        if difference < best.0 {
            best = (difference, candidate);
        }
    }
    match best {
        (difference, aligned) if difference <= TOLERANCE => Ok(aligned.native_rows()),
        (difference, _) => Err(f64::from(difference) / 2.0),
    }
}

/// The stored rows in groups of three, padded with unloaded rows before and after.
struct Aligned {
    row_length: usize,
    /// The values, padded to complete groups, and one more row.
    values: Vec<u16>,
}

impl Aligned {
    /// An alignment with `phase` rows before the first full group.
    fn new(values: &[u16], rows: usize, row_length: usize, phase: usize) -> Self {
        let before = (3 - phase) % 3;
        let groups = (before + rows).div_ceil(3);
        let mut padded = vec![0; before * row_length];
        padded.extend_from_slice(values);
        padded.resize((3 * groups + 1) * row_length, 0);
        Self { row_length, values: padded }
    }

    /// The rows r0, r1, r2 and r0' of each group.
    fn groups(&self) -> impl Iterator<Item = [&[u16]; 4]> {
        let row = |i: usize| &self.values[i * self.row_length..(i + 1) * self.row_length];
        let groups = self.values.len() / self.row_length / 3;
        (0..groups).map(move |i| std::array::from_fn(|k| row(3 * i + k)))
    }

    /// Largest difference between the two doubled estimates of a native row.
    fn disagreement(&self) -> i32 {
        self.groups()
            .filter(is_within_foot)
            .flat_map(|rows| estimates(rows).map(|(a, b)| (a - b).abs()))
            .max()
            .unwrap_or(0)
    }

    /// Rows x columns x frames on the native grid.
    fn native_rows(&self) -> Vec<u16> {
        let mut native = Vec::with_capacity(self.values.len() / 3 * 2);
        for rows in self.groups() {
            native.extend_from_slice(rows[0]);
            if is_within_foot(&rows) {
                // Both estimates are doubled: their mean is a quarter of the sum, rounded.
                let mean = |(a, b): (i32, i32)| ((a + b + 2) / 4).clamp(0, i32::from(u16::MAX)) as u16;
                native.extend(estimates(rows).map(mean));
            } else {
                native.resize(native.len() + self.row_length, 0);
            }
        }
        native
    }
}

/// True if a group has a loaded row. Only these groups are compared: the images were trimmed to the foot before they were
/// resampled, and padded afterwards, so in the group before the foot r2 may lack the contribution of r0'.
fn is_within_foot(rows: &[&[u16]; 4]) -> bool {
    rows[..3].iter().any(|row| row.iter().any(|&u| u > 0))
}

/// The two estimates of n1, each multiplied by two so that it is an integer: from r1 and from r2, for each value of a row.
fn estimates([r0, r1, r2, next_r0]: [&[u16]; 4]) -> impl Iterator<Item = (i32, i32)> {
    let doubled = |third: u16, end: u16| 3 * i32::from(third) - i32::from(end);
    (0..r0.len()).map(move |i| (doubled(r1[i], r0[i]), doubled(r2[i], next_r0[i])))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Native rows of four values, large and small, with unloaded rows before and after.
    fn native() -> Vec<[u16; 4]> {
        let value = |row: u16, column: u16| (row * 977 + column * 331) % 1500;
        let mut rows = vec![[0; 4]; 2];
        rows.extend((0..20).map(|row| std::array::from_fn(|column| value(row, column as u16))));
        rows.extend([[0; 4]; 3]);
        rows
    }

    /// The stored rows: linear interpolation at 2/3 of the native spacing, rounded.
    fn stored(native: &[[u16; 4]]) -> Vec<[u16; 4]> {
        (0..(native.len() - 1) * 3 / 2)
            .map(|i| {
                let (before, thirds) = (i * 2 / 3, (i * 2 % 3) as f64);
                std::array::from_fn(|column| {
                    let [a, b] = [before, before + 1].map(|row| f64::from(native[row][column]));
                    (a + (b - a) * thirds / 3.0).round() as u16
                })
            })
            .collect()
    }

    /// Twenty rows, as many as [`native`] has loaded ones, from the first loaded row on.
    fn loaded(rows: &[u16]) -> Vec<&[u16]> {
        rows.chunks_exact(4).skip_while(|row| row.iter().all(|&u| u == 0)).take(20).collect()
    }

    fn assert_recovered(stored: &[[u16; 4]], native: &[[u16; 4]]) {
        let recovered = native_rows(stored.as_flattened(), stored.len(), 4).unwrap();
        let (recovered, truth) = (loaded(&recovered), loaded(native.as_flattened()));
        assert_eq!(recovered.len(), truth.len());
        for (recovered, truth) in recovered.iter().zip(truth) {
            for (a, b) in recovered.iter().zip(truth) {
                assert!(a.abs_diff(*b) <= 1, "{recovered:?} {truth:?}");
            }
        }
    }

    #[test]
    fn native_rows_are_recovered_from_every_phase() {
        let native = native();
        for padding in 0..3 {
            let mut rows = vec![[0; 4]; padding];
            rows.extend(stored(&native));
            assert_recovered(&rows, &native);
        }
    }

    #[test]
    fn native_rows_are_recovered_from_an_image_trimmed_before_resampling() {
        let native = native();
        for padding in 3..6 {
            let mut rows = vec![[0; 4]; padding];
            rows.extend(stored(&native[2..]));
            assert_recovered(&rows, &native);
        }
    }

    #[test]
    fn rows_that_were_not_resampled_are_rejected() {
        let native = native();
        let difference = native_rows(native.as_flattened(), native.len(), 4).unwrap_err();
        assert!(difference > 100.0, "{difference}");
    }

    #[test]
    fn empty_and_cut_off_steps_are_recognised() {
        assert!(Step::new(1, 4, vec![0; 8]).is_empty());
        let step = Step::new(1, 4, vec![0, 0, 7, 0, 0, 5, 0, 0]);
        assert!(!step.is_empty() && !step.is_cut_off());
        assert_eq!(step.frames(), 2);
        assert_eq!(step.series((0, 0)), [0, 7]);
        assert!(Step::new(1, 4, vec![0, 0, 7, 1]).is_cut_off());
    }
}

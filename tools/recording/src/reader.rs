//! A recording that is read in blocks of frames, so that the memory in use does not grow with its length.

use crate::check::{self, At, TimeCheck};
use crate::columns::{ColumnFile, DECODERS};
use crate::{Error, Recording, Result, output, parts};
use plantar::Side;
use rayon::prelude::*;
use std::iter::from_fn;
use std::path::{Path, PathBuf};

/// Number of columns and rows that are transposed at a time, so that the cache holds the parts of the rows that are written.
const COLUMNS_PER_BLOCK: usize = 16;
const ROWS_PER_BLOCK: usize = 128;

/// A stored recording, one file or a folder with its parts.
pub struct RecordingReader {
    /// The description of the recording: a recording without frames.
    pub head: Recording,
    /// The files in the order of time; at least one.
    files: Vec<ColumnFile>,
    /// The path of the file or of the folder, for messages about all frames.
    place: Box<str>,
    /// The check of the times, before the first frame.
    time_check: TimeCheck,
}

/// Successive frames.
pub(crate) struct Block<T> {
    /// Time of each frame, s.
    pub t_s: Vec<f64>,
    /// The values of the first frame, then those of the second frame, and so on.
    pub values: Vec<T>,
}

/// Names the recordings of the feet, which an import writes for the name of a pair, if `path` is such a name and no file.
fn check_feet(path: &Path) -> Result<()> {
    let feet = [Side::Left, Side::Right].map(|side| output::of_foot(path, side));
    let feet: Vec<_> = feet.iter().filter(|path| path.exists()).map(|path| path.display().to_string()).collect();
    if path.exists() || feet.is_empty() {
        return Ok(());
    }
    let remedy = format!("name the recording of a foot: {}", feet.join(" or "));
    Err(Error::content(path.display().to_string(), "there is no such file", remedy))
}

impl RecordingReader {
    /// Opens a recording: a file, or a folder with its parts. The rules that concern frames are checked when these are read.
    ///
    /// # Errors
    /// Fails if a file cannot be read or is not a recording, or if a part does not continue the one before it.
    pub fn open(path: &Path) -> Result<Self> {
        let (head, files) = if path.is_dir() {
            parts::open(path)?
        } else {
            check_feet(path)?;
            let (head, file) = ColumnFile::open(path)?;
            (head, vec![file])
        };
        Self::new(head, files, path)
    }

    /// As [`RecordingReader::open`], from the content of a file. Messages name `path` as the file.
    ///
    /// # Errors
    /// Fails in the same cases as [`RecordingReader::open`].
    pub fn parse(bytes: Vec<u8>, path: &Path) -> Result<Self> {
        let (head, file) = ColumnFile::parse(bytes, path)?;
        Self::new(head, vec![file], path)
    }

    /// As [`RecordingReader::open`], from the paths and the contents of the parts in `folder`, which are in the order of time.
    ///
    /// # Errors
    /// Fails in the same cases as [`RecordingReader::open`].
    pub fn parse_parts(parts: Vec<(PathBuf, Vec<u8>)>, folder: &Path) -> Result<Self> {
        let parts = parts.into_iter().map(|(path, bytes)| ColumnFile::parse(bytes, &path));
        let (head, files) = parts::join(folder, parts)?;
        Self::new(head, files, folder)
    }

    fn new(head: Recording, files: Vec<ColumnFile>, path: &Path) -> Result<Self> {
        let time_check = TimeCheck::new(head.rate_hz, &|at| files[0].place(at))?;
        Ok(Self { head, files, place: path.display().to_string().into(), time_check })
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.files.iter().map(ColumnFile::frames).fold(0, usize::saturating_add)
    }

    /// The largest pressure, kPa, from the statistics of the columns. Row groups without statistics are read.
    ///
    /// # Errors
    /// Fails if pressures that are read violate a rule of recordings.
    pub fn largest_kpa(&self) -> Result<f32> {
        let largest = |all_kpa: Vec<f32>| all_kpa.into_iter().fold(0.0, f32::max);
        let mut largest_kpa = 0.0f32;
        for (file, group, first_row) in self.groups() {
            largest_kpa = largest_kpa.max(match file.stated_largest_kpa(group) {
                Some(stated_kpa) => stated_kpa,
                None => largest(file.pressures(group, first_row, &|_, kpa| vec![largest(kpa)])?.concat()),
            });
        }
        Ok(largest_kpa)
    }

    /// Calls `each` with the pressures of each frame, kPa, in the order of the cells.
    ///
    /// # Errors
    /// Fails if the frames violate a rule of recordings.
    pub fn for_each_frame(&self, mut each: impl FnMut(&[f32])) -> Result<()> {
        let order: Vec<usize> = (0..self.head.cells()).collect();
        for block in self.blocks(&order, &|_, kpa| kpa) {
            block?.values.chunks_exact(order.len().max(1)).for_each(&mut each);
        }
        Ok(())
    }

    /// Reads all frames.
    ///
    /// # Errors
    /// Fails if the frames violate a rule of recordings, or if there are more pressures than this program holds in memory.
    pub fn whole(&self) -> Result<Recording> {
        let mut recording = self.head.clone();
        check::value_count(self.frames() as u64, recording.cells(), &self.place)?;
        let order: Vec<usize> = (0..recording.cells()).collect();
        for block in self.blocks(&order, &|_, kpa| kpa) {
            let Block { t_s, values } = block?;
            recording.t_s.extend(t_s);
            recording.pressure_kpa.extend(values);
        }
        Ok(recording)
    }

    /// For each row group: its file, its index in the file, and the number of rows before it in the file.
    fn groups(&self) -> impl Iterator<Item = (&ColumnFile, usize, usize)> {
        self.files.iter().flat_map(|file| {
            (0..file.groups()).scan(0, move |row, group| {
                let first_row = *row;
                *row += file.rows(group);
                Some((file, group, first_row))
            })
        })
    }

    /// The frames of each row group, or the violation of a rule. For each value of a frame, `order` contains the index of its
    /// cell in the recording. `convert` converts the pressures of the cell with this index in all frames of the row group, kPa,
    /// to values.
    pub(crate) fn blocks<T: Copy + Default + Send + Sync>(
        &self,
        order: &[usize],
        convert: &(dyn Fn(usize, Vec<f32>) -> Vec<T> + Sync),
    ) -> impl Iterator<Item = Result<Block<T>>> {
        let mut groups = self.groups();
        let mut time_check = Some(self.time_check.clone());
        from_fn(move || {
            let Some((file, group, first_row)) = groups.next() else {
                let checked = time_check.take()?.finish(&|_| self.place.to_string());
                return checked.err().map(Err);
            };
            let mut block = || {
                let t_s = file.times(group, first_row)?;
                time_check.as_mut().map_or(Ok(()), |time_check| {
                    time_check.add(&t_s, &|at| match at {
                        At::Frame(frame) => file.place(At::Frame(first_row + frame)),
                        other => file.place(other),
                    })
                })?;
                let columns = file.pressures(group, first_row, convert)?;
                Ok(Block { values: frames_of(&columns, order, t_s.len()), t_s })
            };
            Some(block())
        })
    }
}

/// Transposes columns to `frames` frames. `order` contains the index of the column of each value of a frame.
fn frames_of<T: Copy + Default + Send + Sync>(columns: &[Vec<T>], order: &[usize], frames: usize) -> Vec<T> {
    let mut values = vec![T::default(); frames * order.len()];
    let transpose = |(block, rows): (usize, &mut [T])| {
        let first_row = block * ROWS_PER_BLOCK;
        for start in (0..order.len()).step_by(COLUMNS_PER_BLOCK) {
            for index in start..order.len().min(start + COLUMNS_PER_BLOCK) {
                let column = &columns[order[index]][first_row..];
                rows.chunks_exact_mut(order.len()).zip(column).for_each(|(row, &value)| row[index] = value);
            }
        }
    };
    DECODERS.install(|| values.par_chunks_mut(ROWS_PER_BLOCK * order.len()).enumerate().for_each(transpose));
    values
}

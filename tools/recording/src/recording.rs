//! A recording in memory.

use crate::check::{self, At};
use crate::{Layout, RecordingReader, Result, Span, bins, file, rate};
use plantar::Side;
use std::path::{Path, PathBuf};

/// The pressure under one foot over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The foot.
    pub side: Side,
    /// The cells, in the order of a frame's values.
    pub layout: Layout,
    /// Frames per second, at most 1 MHz.
    pub rate_hz: f64,
    /// Provenance: the origin of the measurement and its processing, in sentences.
    pub source: String,
    /// Time of each frame, s; strictly increasing at `rate_hz`.
    pub t_s: Vec<f64>,
    /// Pressure, 0 to 50,000 kPa. All cells of the first frame come first, then those of the second frame, and so on.
    pub pressure_kpa: Vec<f32>,
}

impl Recording {
    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.t_s.len()
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.layout.cells.len()
    }

    /// The pressures of frame `i`, kPa, one for each cell.
    ///
    /// # Panics
    /// Panics if the recording has no frame `i`.
    pub fn frame(&self, i: usize) -> &[f32] {
        let cells = self.cells();
        &self.pressure_kpa[i * cells..(i + 1) * cells]
    }

    /// Force on all cells in frame `i`, N: the sum of pressure times area.
    ///
    /// # Panics
    /// Panics if the recording has no frame `i`.
    pub fn force_n(&self, i: usize) -> f64 {
        self.layout.force_n(self.frame(i))
    }

    /// The largest pressure of all cells and frames, kPa.
    pub fn largest_kpa(&self) -> f32 {
        self.pressure_kpa.iter().copied().fold(0.0, f32::max)
    }

    /// Reads a recording from Parquet: a file, or a folder with its parts.
    ///
    /// # Errors
    /// Fails if the file cannot be read, is not a recording, has more pressures than this program holds in memory, or violates a
    /// rule of recordings: pressures are 0 to 50,000 kPa, the times increase uniformly at the stated rate, and there are 1 to
    /// [`crate::MAX_CELLS`] cells of plausible size and position.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        RecordingReader::open(path.as_ref())?.whole()
    }

    /// As [`Recording::read`], from the content of a file. Messages name `path` as the file.
    ///
    /// # Errors
    /// Fails in the same cases as [`Recording::read`].
    pub fn parse(bytes: Vec<u8>, path: &Path) -> Result<Self> {
        RecordingReader::parse(bytes, path)?.whole()
    }

    /// As [`Recording::read`], from the paths and the contents of the parts in `folder`, which are in the order of time.
    ///
    /// # Errors
    /// Fails in the same cases as [`Recording::read`].
    pub fn parse_parts(parts: Vec<(PathBuf, Vec<u8>)>, folder: &Path) -> Result<Self> {
        RecordingReader::parse_parts(parts, folder)?.whole()
    }

    /// Checks the rules of recordings. `name` names the recording in messages.
    ///
    /// # Errors
    /// Fails if the recording violates a rule that [`Recording::read`] checks.
    pub fn check(&self, name: &str) -> Result<()> {
        check::recording(self, &|at| match at {
            At::Whole => name.to_string(),
            At::Frame(frame) => format!("{name}: frame {frame}"),
            At::Value { frame, cell } => format!("{name}: frame {frame}, cell {cell}"),
        })
    }

    /// The frames within `span`, with their times. The source then states the span, unless these are all frames. `name` names the
    /// recording in messages.
    ///
    /// # Errors
    /// Fails if there is no such frame.
    pub fn part(mut self, span: Span, name: &str) -> Result<Self> {
        let Some((frames, sentence)) = span.part(&self.t_s, Path::new(name))? else { return Ok(self) };
        let cells = self.cells();
        self.source = format!("{} {sentence}", self.source);
        self.t_s.truncate(frames.end);
        self.t_s.drain(..frames.start);
        self.pressure_kpa.truncate(frames.end * cells);
        self.pressure_kpa.drain(..frames.start * cells);
        Ok(self)
    }

    /// Writes the recording to Parquet: a column `t_s` in seconds, columns `c0_kpa`, `c1_kpa`, ..., and side, rate, source and
    /// layout as JSON under the metadata key `plantar`.
    ///
    /// # Errors
    /// Fails if the file cannot be written or the recording violates a rule that [`Recording::read`] checks.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        file::write(self, path.as_ref())
    }

    /// The same recording resampled to `rate_hz` by linear interpolation between frames. The times are rounded to 1 ns.
    ///
    /// No filter is applied: on downsampling, content above half the new rate aliases.
    ///
    /// # Errors
    /// Fails if `rate_hz` is not a positive number up to 1 MHz or results in more than [`u32::MAX`] frames or more pressures than
    /// this program holds in memory, or if the recording has no frame.
    pub fn at_rate(&self, rate_hz: f64) -> Result<Self> {
        rate::at_rate(self, rate_hz)
    }

    /// The same load on at most `max_cells` cells. A recording that has no more cells is returned unchanged.
    ///
    /// First, cells that are never loaded are dropped, unless no cell is ever loaded. If that does not suffice, cells of the same
    /// region within one square of a regular grid are merged. The pitch of the grid is the smallest multiple of 0.1 mm that
    /// suffices. A merged cell has the sum of the areas, the area-weighted centroid and the area-weighted mean pressure, so the
    /// force on every region is conserved in every frame.
    ///
    /// # Errors
    /// Fails if `max_cells` is smaller than the number of loaded regions, or a merged cell would be larger than 4,000 mm².
    pub fn binned(&self, max_cells: usize) -> Result<Self> {
        bins::binned(self, max_cells)
    }
}

use crate::{Layout, Result, bins, file, rate};
use plantar::Side;
use std::path::Path;

/// What the pressure sensors under one foot read over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The foot.
    pub side: Side,
    /// The sensors, in the order of a frame's values.
    pub layout: Layout,
    /// Frames per second.
    pub rate_hz: f64,
    /// Where the measurement comes from and what was done to it, in sentences.
    pub source: String,
    /// The time of each frame, s; strictly increasing at `rate_hz`.
    pub t_s: Vec<f64>,
    /// Pressure, kPa; frames x cells, row-major.
    pub pressure_kpa: Vec<f32>,
}

impl Recording {
    /// The number of frames.
    pub fn frames(&self) -> usize {
        self.t_s.len()
    }

    /// The number of cells.
    pub fn cells(&self) -> usize {
        self.layout.cells.len()
    }

    /// The pressures of frame `i`, kPa, one per cell.
    ///
    /// # Panics
    /// When there is no frame `i`.
    pub fn frame(&self, i: usize) -> &[f32] {
        let cells = self.cells();
        &self.pressure_kpa[i * cells..(i + 1) * cells]
    }

    /// The force on all cells in frame `i`, N: the sum of pressure times area.
    ///
    /// # Panics
    /// When there is no frame `i`.
    pub fn force_n(&self, i: usize) -> f64 {
        self.layout.force_n(self.frame(i))
    }

    /// Reads a recording from Parquet.
    ///
    /// # Errors
    /// When the file cannot be read, is no Parquet file of ours, or breaks a rule of a recording:
    /// finite pressures of at least zero, uniform increasing time, at most [`crate::MAX_CELLS`] cells.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        file::read(path.as_ref())
    }

    /// As [`Recording::read`], from a file's content; `path` is for messages.
    ///
    /// # Errors
    /// As [`Recording::read`].
    pub fn parse(bytes: Vec<u8>, path: &Path) -> Result<Self> {
        file::parse(bytes, path)
    }

    /// Writes the recording to Parquet: a column `t_s` in seconds, columns `c0_kpa`, `c1_kpa`, ... and
    /// the rest as JSON under the file's key `plantar`.
    ///
    /// # Errors
    /// When the file cannot be written or the recording breaks a rule that [`Recording::read`] checks.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        file::write(self, path.as_ref())
    }

    /// The same recording on a uniform clock of `rate_hz`, interpolated linearly between frames.
    ///
    /// Nothing is filtered: content above half the new rate aliases when the rate goes down.
    ///
    /// # Errors
    /// When `rate_hz` is not a positive number or asks for more than [`u32::MAX`] frames, or there are none.
    pub fn at_rate(&self, rate_hz: f64) -> Result<Self> {
        rate::at_rate(self, rate_hz)
    }

    /// A virtual insole of at most `max_cells` cells; unchanged when the recording already fits.
    ///
    /// First the cells that are never loaded are dropped. If that does not suffice, cells of the same
    /// region within one square of a regular grid are merged, at the smallest pitch that fits (to 0.1 mm).
    /// A merged cell has the sum of the areas, the area-weighted centroid and the area-weighted mean
    /// pressure, so the force on every region is conserved in every frame.
    ///
    /// # Errors
    /// When `max_cells` is less than the number of loaded regions.
    pub fn binned(&self, max_cells: usize) -> Result<Self> {
        bins::binned(self, max_cells)
    }
}

//! The frames of a text file, with the number of the line of each.

use crate::negatives::Negatives;
use std::ops::Range;

/// The frames of one foot. All values are finite, the times increase, and no pressure is negative.
#[derive(Default)]
pub struct NumberedFrames {
    /// Time of each frame, s.
    pub t_s: Vec<f64>,
    /// The line of each frame in the file.
    pub lines: Vec<u64>,
    /// All cells of the first frame, then those of the second one, and so on.
    pub pressure_kpa: Vec<f32>,
    pub negatives: Negatives,
}

impl NumberedFrames {
    /// These frames of `cells` cells each, without the others. The negative pressures remain those of all frames.
    pub fn part(mut self, part: Range<usize>, cells: usize) -> Self {
        self.t_s = self.t_s[part.clone()].to_vec();
        self.lines = self.lines[part.clone()].to_vec();
        self.pressure_kpa = self.pressure_kpa[part.start * cells..part.end * cells].to_vec();
        self
    }
}

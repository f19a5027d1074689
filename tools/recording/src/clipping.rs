//! Recognition of pressures that the range of a sensor limits.

use crate::Recording;
use crate::text::significant;

/// Pressures seem to be limited if several cells have exactly the largest pressure in at least this number of frames.
const LEAST_FRAMES: usize = 3;
/// Pressures from this share of the largest one on are close to it. Without a limit, there are more of them than of the largest
/// one, even with a coarse resolution, as long as it is finer than a tenth of the largest pressure.
const CLOSE: f32 = 0.9;

/// Whether the largest pressure of a recording seems to be a limit.
#[derive(Clone, Copy, Debug)]
pub struct Clipping {
    largest_kpa: f32,
    /// Number of frames in which several cells have the largest pressure.
    frames: usize,
    /// Number of times that a cell has the largest pressure in a frame.
    largest: usize,
    /// Number of times that a cell has a smaller pressure that is close to it.
    close: usize,
}

impl Clipping {
    /// Before the first frame of a recording with this largest pressure, kPa.
    pub fn new(largest_kpa: f32) -> Self {
        Self { largest_kpa, frames: 0, largest: 0, close: 0 }
    }

    /// That of a recording in memory.
    pub fn of(recording: &Recording) -> Self {
        let mut clipping = Self::new(recording.largest_kpa());
        (0..recording.frames()).for_each(|i| clipping.add(recording.frame(i)));
        clipping
    }

    /// The largest pressure, kPa.
    pub fn largest_kpa(&self) -> f32 {
        self.largest_kpa
    }

    /// Adds a frame with these pressures, kPa.
    pub fn add(&mut self, pressure_kpa: &[f32]) {
        let from_close = pressure_kpa.iter().filter(|kpa| **kpa > 0.0 && **kpa >= CLOSE * self.largest_kpa).count();
        let largest = pressure_kpa.iter().filter(|kpa| **kpa > 0.0 && **kpa == self.largest_kpa).count();
        self.largest += largest;
        self.close += from_close - largest;
        self.frames += usize::from(largest > 1);
    }

    /// A sentence for the user if the range of the sensor seems to limit the pressures.
    pub fn warning(&self) -> Option<String> {
        // A pressure that never changes is not close to the largest one before it reaches it.
        (self.frames >= LEAST_FRAMES && self.largest > self.close && self.close > 0).then(|| {
            format!(
                "In {} frames, several cells have exactly the largest pressure, {} kPa. If the range of the sensor ends there, \
                 the true pressures and forces are larger: use a setting of the sensor with a larger range.",
                self.frames,
                significant(self.largest_kpa.into())
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a warning is given for the pressures of two cells over a stance, each limited to `limit_kpa` and rounded to
    /// multiples of 5 kPa.
    fn warns(peaks_kpa: [f32; 2], limit_kpa: f32) -> bool {
        let frame = |i: u8| {
            peaks_kpa.map(|peak_kpa| {
                let kpa = peak_kpa * (std::f32::consts::PI * f32::from(i) / 70.0).sin();
                (kpa.min(limit_kpa) / 5.0).round() * 5.0
            })
        };
        let frames: Vec<_> = (0..=70).map(frame).collect();
        let mut clipping = Clipping::new(frames.iter().flatten().copied().fold(0.0, f32::max));
        frames.iter().for_each(|frame| clipping.add(frame));
        clipping.warning().is_some()
    }

    #[test]
    fn a_limit_is_distinguished_from_the_peak_of_a_coarse_resolution() {
        assert!(warns([400.0, 380.0], 300.0));
        assert!(warns([300.0, 280.0], 200.0));
        assert!(!warns([300.0, 280.0], 600.0));
        // Both cells have the same peak, in several frames, without a limit.
        assert!(!warns([300.0, 300.0], 600.0));
        assert!(!warns([0.0, 0.0], 600.0));
        // Only one cell reaches the limit.
        assert!(!warns([400.0, 180.0], 300.0));
        // A constant load.
        let mut clipping = Clipping::new(50.0);
        (0..100).for_each(|_| clipping.add(&[50.0; 2]));
        assert_eq!(clipping.warning(), None);
    }
}

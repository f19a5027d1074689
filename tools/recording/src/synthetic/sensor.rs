//! The errors of a real sensor: the offsets and the noise of its cells.

use super::Random;
use crate::Recording;
use crate::insole::{EXPONENT, FULL_KPA};
use plantar::pipeline::calibrate::FULL_CODE;

/// Replaces the pressures by the readings of a sensor with a full scale of 1000 kPa. `offset_kpa` contains the reading of each
/// cell without load, kPa. The noise is uniform within `noise_codes` codes above and below 0; equal seeds result in equal
/// noise.
///
/// As in a real sensor, offset and noise are added to the code. With a power law this is not a sum of pressures: with an offset
/// of 5 kPa, a pressure of 100 kPa is read as 112 kPa.
///
/// # Panics
/// Panics if the number of offsets is not the number of cells.
pub fn add_sensor_errors(recording: &mut Recording, offset_kpa: &[f32], noise_codes: f64, seed: u64) {
    assert_eq!(offset_kpa.len(), recording.cells(), "one offset for each cell");
    let (full_kpa, full_code, exponent) = (f64::from(FULL_KPA), f64::from(FULL_CODE), f64::from(EXPONENT));
    let code = |kpa: f32| full_code * (f64::from(kpa) / full_kpa).powf(exponent);
    let offsets: Vec<f64> = offset_kpa.iter().map(|&kpa| code(kpa)).collect();
    let mut random = Random(seed);
    for frame in recording.pressure_kpa.chunks_exact_mut(offsets.len()) {
        for (kpa, offset) in frame.iter_mut().zip(&offsets) {
            let noise = noise_codes * (random.around_one(1.0) - 1.0);
            let read = (code(*kpa) + offset + noise).clamp(0.0, full_code);
            *kpa = (full_kpa * (read / full_code).powf(1.0 / exponent)) as f32;
        }
    }
}

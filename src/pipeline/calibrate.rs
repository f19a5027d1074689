//! Calibration: from codes to pressure.
//!
//! The conductance of a resistive cell rises with pressure by a power law. With the column at a virtual ground, the code of the
//! converter, minus that of the unloaded cell, is proportional to the conductance. The inverse of the law is tabulated once; a
//! frame then requires one lookup for each cell.

use crate::num::Real;
use serde::{Deserialize, Serialize};

/// The code of a cell at full scale: the sum of 16 conversions of 12 bits, as an STM32's hardware oversampler delivers it.
pub const FULL_CODE: u16 = 16 * 4095;

/// The sensor law, `code = FULL_CODE * (p / full_kpa)^exponent`, common to all cells of an insole.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorLaw {
    /// Pressure at full scale, kPa, positive and at most 100,000.
    pub full_kpa: f32,
    /// Exponent of the power law, 0.3 to 3; 1 is a linear sensor.
    pub exponent: f32,
}

impl SensorLaw {
    /// True if both numbers are in range.
    pub fn is_valid(&self) -> bool {
        self.full_kpa > 0.0 && self.full_kpa <= 1e5 && self.exponent >= 0.3 && self.exponent <= 3.0
    }
}

/// The deviation of one cell from the sensor law.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellCalibration {
    /// Mean code of the unloaded cell (see [`zero_offset`]), below half of [`FULL_CODE`]. It is subtracted before the law is
    /// applied.
    pub offset: u16,
    /// Ratio of the pressure of this cell to the pressure of the sensor law at the same code, 0.1 to 10.
    pub gain: f32,
}

impl CellCalibration {
    /// No deviation.
    pub const IDEAL: Self = Self { offset: 0, gain: 1.0 };

    /// True if both numbers are in range.
    pub fn is_valid(&self) -> bool {
        self.gain >= 0.1 && self.gain <= 10.0 && self.offset < FULL_CODE / 2
    }
}

/// Zero offset of a cell: the mean of its codes over an unloaded interval, rounded up. `None` without codes.
pub fn zero_offset(unloaded_codes: impl IntoIterator<Item = u16>) -> Option<u16> {
    let (sum, count) =
        unloaded_codes.into_iter().fold((0u64, 0u64), |(sum, count), code| (sum + u64::from(code), count + 1));
    // The mean of u16 numbers fits into a u16.
    (count > 0).then(|| sum.div_ceil(count) as u16)
}

/// True if a code is at full scale: the true pressure may then be higher than the reported pressure.
pub fn is_saturated(code: u32) -> bool {
    code >= u32::from(FULL_CODE)
}

/// Number of segments of a [`Curve`].
const SEGMENTS: usize = 256;
/// Number of low bits of a code that are its position within a segment.
const SEGMENT_SHIFT: u32 = 16 - SEGMENTS.ilog2();

/// The inverse of a [`SensorLaw`], from code to pressure, as straight segments. For an exponent of 0.8, it is within 0.1 % of
/// the law for pressures of at least 1 % of [`SensorLaw::full_kpa`]. At exponents above 1, the pressures of its first segment,
/// that is of codes below 256, are too low.
///
/// The table is in single precision on every machine, so that all machines evaluate the same curve.
///
/// ```
/// use plantar::pipeline::calibrate::{Curve, FULL_CODE, SensorLaw};
///
/// let mut curve = Curve::new();
/// curve.set(&SensorLaw { full_kpa: 1000.0, exponent: 1.0 });
/// let half_kpa: f64 = curve.pressure_kpa(i32::from(FULL_CODE / 2));
/// assert!((half_kpa - 500.0).abs() < 0.01);
/// // A code is 0.0153 kPa: the first one at 10 kPa or more is number 656.
/// assert_eq!(curve.first_code_at(10.0), 656);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Curve {
    /// For each segment: the pressure on its extension at code 0, kPa, and its slope, kPa per code.
    segments: [(f32, f32); SEGMENTS],
}

impl Curve {
    /// A curve of zeros, to be replaced by [`Curve::set`].
    pub const fn new() -> Self {
        Self { segments: [(0.0, 0.0); SEGMENTS] }
    }

    /// Tabulates `law`, which must be valid ([`SensorLaw::is_valid`]).
    pub fn set(&mut self, law: &SensorLaw) {
        let inverse_exponent = 1.0 / law.exponent;
        let pressure_kpa = |code: u32| match code {
            0 => 0.0,
            _ => law.full_kpa * Real::exp2(Real::log2(code as f32 / f32::from(FULL_CODE)) * inverse_exponent),
        };
        let mut start_kpa = 0.0;
        for (i, segment) in self.segments.iter_mut().enumerate() {
            let code = (i as u32) << SEGMENT_SHIFT;
            let end_kpa = pressure_kpa(code + (1 << SEGMENT_SHIFT));
            let slope = (end_kpa - start_kpa) / (1 << SEGMENT_SHIFT) as f32;
            *segment = (start_kpa - slope * code as f32, slope);
            start_kpa = end_kpa;
        }
    }

    /// Pressure, kPa, at `code`, 0 to 65,535, from which the offset was subtracted.
    #[inline(always)]
    pub fn pressure_kpa<R: Real>(&self, code: i32) -> R {
        // The remainder has no effect for codes in range, and avoids a bounds check.
        let (base, slope) = self.segments[(code >> SEGMENT_SHIFT) as usize % SEGMENTS];
        R::of_f32(base) + R::of_f32(slope) * R::of_i32(code)
    }

    /// The smallest code with at least `pressure_kpa`, kPa; [`u16::MAX`] if the pressure is beyond the curve.
    pub fn first_code_at(&self, pressure_kpa: f32) -> u16 {
        let (mut low, mut high) = (0u16, u16::MAX);
        while low < high {
            let middle = low + (high - low) / 2;
            if self.pressure_kpa::<f32>(i32::from(middle)) >= pressure_kpa { high = middle } else { low = middle + 1 }
        }
        high
    }
}

impl Default for Curve {
    fn default() -> Self {
        Self::new()
    }
}

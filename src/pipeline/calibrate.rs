//! Codes to pressure.
//!
//! A resistive cell's conductance grows with pressure by a power law; read against a virtual ground, the converter's code
//! is proportional to conductance. The inverse of that law is tabulated once; a frame then costs one table step a cell.

use crate::num::Real;
use serde::{Deserialize, Serialize};

/// The code of a cell at full scale: the sum of 16 conversions of 12 bits, as an STM32's hardware oversampler delivers it.
pub const FULL_CODE: u16 = 16 * 4095;

/// The sensor's law, `code = FULL_CODE * (p / full_kpa)^exponent`, common to all cells of an insole.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorLaw {
    /// Pressure at full scale, kPa, positive.
    pub full_kpa: f32,
    /// Exponent of the power law, 0.3 to 3; 1 is a linear sensor.
    pub exponent: f32,
}

impl SensorLaw {
    /// True when both numbers are finite and in range.
    pub fn is_valid(&self) -> bool {
        self.full_kpa > 0.0 && self.full_kpa <= 1e5 && self.exponent >= 0.3 && self.exponent <= 3.0
    }
}

/// What one cell departs by from the common law.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellCalibration {
    /// Mean code of the unloaded cell (see [`zero_offset`]); subtracted before the law.
    pub offset: u16,
    /// Pressure factor of this cell against the law, 0.1 to 10.
    pub gain: f32,
}

impl CellCalibration {
    /// No departure.
    pub const IDEAL: Self = Self { offset: 0, gain: 1.0 };

    /// True when the gain is finite and in range and the offset leaves half of the scale.
    pub fn is_valid(&self) -> bool {
        self.gain >= 0.1 && self.gain <= 10.0 && self.offset < FULL_CODE / 2
    }
}

/// Zero offset of one cell from its codes over an unloaded interval: the mean, rounded up. `None` without codes.
pub fn zero_offset(unloaded_codes: impl IntoIterator<Item = u16>) -> Option<u16> {
    let (sum, count) =
        unloaded_codes.into_iter().fold((0u64, 0u64), |(sum, count), code| (sum + u64::from(code), count + 1));
    // A mean of u16 fits u16.
    (count > 0).then(|| sum.div_ceil(count) as u16)
}

/// True when the converter is at its end: the pressure is at least the one reported.
pub fn is_saturated(code: u32) -> bool {
    code >= u32::from(FULL_CODE)
}

const SEGMENTS: usize = 256;
const SEGMENT_SHIFT: u32 = 16 - SEGMENTS.ilog2();

/// The inverse of a [`SensorLaw`] as straight segments; within 0.1 % of the law above 1 % of full scale at exponent 0.8. At
/// exponents above 1 the first segment, 1/256 of full scale, reads low.
///
/// Single precision on every machine: the table is a parameter, and all evaluate the same one.
#[derive(Clone, Copy, Debug)]
pub struct Curve {
    /// Per segment: pressure extrapolated to code 0 and slope, kPa and kPa per code.
    segments: [(f32, f32); SEGMENTS],
}

impl Curve {
    /// An all-zero curve, to be replaced by [`Curve::set`].
    pub const fn new() -> Self {
        Self { segments: [(0.0, 0.0); SEGMENTS] }
    }

    /// Tabulates `law`.
    pub fn set(&mut self, law: &SensorLaw) {
        let inverse_exponent = 1.0 / law.exponent;
        let pressure_kpa = |code: u32| match code {
            0 => 0.0,
            _ => law.full_kpa * Real::exp(Real::ln(code as f32 / f32::from(FULL_CODE)) * inverse_exponent),
        };
        let mut below_kpa = 0.0;
        for (i, segment) in self.segments.iter_mut().enumerate() {
            let code = (i as u32) << SEGMENT_SHIFT;
            let above_kpa = pressure_kpa(code + (1 << SEGMENT_SHIFT));
            let slope = (above_kpa - below_kpa) / (1 << SEGMENT_SHIFT) as f32;
            *segment = (below_kpa - slope * code as f32, slope);
            below_kpa = above_kpa;
        }
    }

    /// Pressure at `code` (offset already subtracted, 0 to 65,535), kPa.
    #[inline(always)]
    pub fn pressure_kpa<R: Real>(&self, code: i32) -> R {
        // The remainder changes nothing in range and spares the check of bounds.
        let (base, slope) = self.segments[(code >> SEGMENT_SHIFT) as usize % SEGMENTS];
        R::of_f32(base) + R::of_f32(slope) * R::of_i32(code)
    }

    /// The smallest code that reads at least `pressure_kpa`; [`u16::MAX`] where none does.
    pub fn first_code_at(&self, pressure_kpa: f32) -> u16 {
        let (mut below, mut at) = (0u16, u16::MAX);
        while below < at {
            let middle = below + (at - below) / 2;
            if self.pressure_kpa::<f32>(i32::from(middle)) >= pressure_kpa { at = middle } else { below = middle + 1 }
        }
        at
    }
}

impl Default for Curve {
    fn default() -> Self {
        Self::new()
    }
}

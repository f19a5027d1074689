//! The arithmetic of the data path: [`Real`] is `f32` on a device, and `f32` or `f64` on a host.
//!
//! Transcendental functions are those of `libm` on all targets (for the angle of an ellipse, of `micromath`), or are defined
//! here, and never those of `std`, so that a host in `f32` computes exactly the same bits as a device. The square root is an
//! instruction of the FPU if there is one. The instruction is correctly rounded, as the function of `libm` is, so both have
//! equal results.

use core::fmt::Debug;
use core::iter::Sum;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// A real number of the data path.
///
/// ```
/// use plantar::Real;
///
/// fn hypotenuse<R: Real>(a: R, b: R) -> R {
///     (a * a + b * b).sqrt()
/// }
/// assert_eq!((hypotenuse(3.0_f32, 4.0), hypotenuse(3.0_f64, 4.0)), (5.0, 5.0));
/// ```
pub trait Real:
    Copy
    + Debug
    + Default
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + Sum
    + 'static
{
    /// The number 0.
    const ZERO: Self;
    /// The number 1.
    const ONE: Self;

    /// Converts a constant or a parameter; rounded to nearest.
    fn of(value: f64) -> Self;
    /// Converts a parameter that is stored in single precision; exact.
    fn of_f32(value: f32) -> Self;
    /// Converts a count or a code; exact below 2^24.
    fn of_u32(value: u32) -> Self;
    /// Converts an integer; rounded to nearest.
    fn of_i32(value: i32) -> Self;
    /// Converts an integer; rounded to nearest.
    fn of_i64(value: i64) -> Self;
    /// Converts to double precision; exact.
    fn to_f64(self) -> f64;
    /// Converts to single precision; rounded to nearest.
    fn to_f32(self) -> f32;
    /// The integer part, limited to the range of `u32`; 0 for NaN.
    fn to_u32(self) -> u32;
    /// Nearest integer within 0..=65535, 0 for NaN; for the scaled integers of the protocol.
    fn round_u16(self) -> u16;
    /// Nearest integer within -32768..=32767, 0 for NaN.
    fn round_i16(self) -> i16;
    /// Square root, correctly rounded; NaN for negative numbers.
    fn sqrt(self) -> Self;
    /// Logarithm to the base 2 of a finite number that is not negative.
    fn log2(self) -> Self;
    /// 2 to the power of this number, which is not NaN.
    fn exp2(self) -> Self;

    /// The larger number; `other` if one of the two is NaN.
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    /// The smaller number; `other` if one of the two is NaN.
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
}

impl Real for f64 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;

    fn of(value: f64) -> Self {
        value
    }
    fn of_f32(value: f32) -> Self {
        value as f64
    }
    fn of_u32(value: u32) -> Self {
        value as f64
    }
    fn of_i32(value: i32) -> Self {
        value as f64
    }
    fn of_i64(value: i64) -> Self {
        value as f64
    }
    fn to_f64(self) -> f64 {
        self
    }
    fn to_f32(self) -> f32 {
        self as f32
    }
    fn to_u32(self) -> u32 {
        self as u32
    }
    fn round_u16(self) -> u16 {
        (self + 0.5) as u16
    }
    fn round_i16(self) -> i16 {
        if self < 0.0 { (self - 0.5) as i16 } else { (self + 0.5) as i16 }
    }
    fn sqrt(self) -> Self {
        libm::sqrt(self)
    }
    fn log2(self) -> Self {
        libm::log2(self)
    }
    fn exp2(self) -> Self {
        libm::exp2(self)
    }
}

impl Real for f32 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;

    fn of(value: f64) -> Self {
        value as f32
    }
    fn of_f32(value: f32) -> Self {
        value
    }
    fn of_u32(value: u32) -> Self {
        value as f32
    }
    fn of_i32(value: i32) -> Self {
        value as f32
    }
    fn of_i64(value: i64) -> Self {
        value as f32
    }
    fn to_f64(self) -> f64 {
        self as f64
    }
    fn to_f32(self) -> f32 {
        self
    }
    fn to_u32(self) -> u32 {
        self as u32
    }
    #[inline(always)]
    fn round_u16(self) -> u16 {
        // The number is converted to i32 first, because the FPU has an instruction for this conversion with saturation, and the
        // processor has one for the limits.
        ((self + 0.5) as i32).clamp(0, i32::from(u16::MAX)) as u16
    }
    #[inline(always)]
    fn round_i16(self) -> i16 {
        // The conversion is that of `round_u16`.
        let rounded = if self < 0.0 { self - 0.5 } else { self + 0.5 };
        (rounded as i32).clamp(i16::MIN.into(), i16::MAX.into()) as i16
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        fpu::sqrt(self)
    }
    /// The logarithm of the significand is computed by a polynomial for the inverse hyperbolic tangent with an absolute error of
    /// at most 7e-9, so the result is accurate to 1.2e-7, relative to the larger of 1 and itself. This takes half the
    /// instructions of the function of `libm`, which also treats subnormal and infinite numbers: here, numbers below 1.2e-38
    /// count as 0.
    #[inline(always)]
    fn log2(self) -> Self {
        /// The bits of the square root of 1/2, the smallest significand.
        const LEAST: u32 = 0x3f35_04f3;
        /// The polynomial of 3rd order in s^2 that minimises the largest relative error from log2((1 + s) / (1 - s)) / s; highest
        /// order first.
        const SERIES: [f32; 4] = [0.431_735_78, 0.576_714_4, 0.961_798_85, 2.885_39];
        if self < f32::MIN_POSITIVE {
            return f32::NEG_INFINITY;
        }
        // The exponent for which the significand is within the square roots of 1/2 and 2.
        let exponent = (self.to_bits().wrapping_sub(LEAST) as i32) >> 23;
        let fraction = f32::from_bits(self.to_bits().wrapping_sub((exponent << 23) as u32)) - 1.0;
        let s = fraction / (fraction + 2.0);
        let squared = s * s;
        let series = SERIES.into_iter().reduce(|sum, next| sum * squared + next).unwrap_or(0.0);
        s * series + exponent as f32
    }
    /// The fractional part is evaluated by a polynomial that is accurate to 1.6e-7, so that the result is accurate to 2.5e-7.
    /// This takes half the instructions of the function of `libm`, which also treats subnormal results: here, results below
    /// 2^-125 are 0, and those above 2^125 are infinite. The model computes two powers for each region and frame.
    #[inline(always)]
    fn exp2(self) -> Self {
        /// 1.5 * 2^23: adding this number to a small one rounds the small one to the nearest integer, which is then in the low
        /// bits of the sum. Subtracting it returns that integer.
        const TO_INTEGER: f32 = 12_582_912.0;
        /// The polynomial of 5th order that minimises the largest relative error from 2^x within -1/2 and 1/2; highest order
        /// first.
        const SERIES: [f32; 6] = [1.327_647_2e-3, 9.675_541e-3, 5.550_713e-2, 0.240_221_2, 0.693_146_94, 1.000_000_1];
        if self.abs() > 125.0 {
            return if self < 0.0 { 0.0 } else { f32::INFINITY };
        }
        let shifted = self + TO_INTEGER;
        let fraction = self - (shifted - TO_INTEGER);
        let power = SERIES.into_iter().reduce(|sum, next| sum * fraction + next).unwrap_or(1.0);
        // The integer is added to the exponent. `power` is within 0.7 and 1.5.
        f32::from_bits(power.to_bits().wrapping_add(shifted.to_bits() << 23))
    }
}

#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
mod fpu {
    // The instruction is in a function of its own, because inline assembly has no single-precision register class on this target.
    core::arch::global_asm!(
        ".fpu fpv4-sp-d16",
        ".section .text.plantar_sqrt, \"ax\", %progbits",
        ".global plantar_sqrt",
        ".type plantar_sqrt, %function",
        ".thumb_func",
        "plantar_sqrt:",
        "vsqrt.f32 s0, s0",
        "bx lr",
        ".text",
    );

    unsafe extern "C" {
        fn plantar_sqrt(x: f32) -> f32;
    }

    #[inline(always)]
    pub fn sqrt(x: f32) -> f32 {
        // SAFETY: the routine receives its argument and returns its result in s0, as this ABI requires. It changes no other
        // register and no memory, and is defined for all x.
        unsafe { plantar_sqrt(x) }
    }
}

#[cfg(not(all(target_arch = "arm", target_abi = "eabihf")))]
mod fpu {
    #[inline(always)]
    pub fn sqrt(x: f32) -> f32 {
        libm::sqrtf(x)
    }
}

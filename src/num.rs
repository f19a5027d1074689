//! The arithmetic of the data path: [`Real`] is `f32` on a device, and `f32` or `f64` on a host.
//!
//! Transcendental functions are those of `libm` on all targets, never those of `std`, so that a host in `f32` computes exactly
//! the same bits as a device. The square root is an instruction of the FPU if there is one. The instruction is correctly rounded,
//! as the function of `libm` is, so both have equal results.

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
    /// Nearest integer within 0..=65535, 0 for NaN; for the scaled integers of the protocol.
    fn round_u16(self) -> u16;
    /// Nearest integer within -32768..=32767, 0 for NaN.
    fn round_i16(self) -> i16;
    /// Square root, correctly rounded; NaN for negative numbers.
    fn sqrt(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Exponential.
    fn exp(self) -> Self;

    /// The larger number; `other` if this one is NaN.
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    /// The smaller number; `other` if this one is NaN.
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
    fn round_u16(self) -> u16 {
        (self + 0.5) as u16
    }
    fn round_i16(self) -> i16 {
        if self < 0.0 { (self - 0.5) as i16 } else { (self + 0.5) as i16 }
    }
    fn sqrt(self) -> Self {
        libm::sqrt(self)
    }
    fn ln(self) -> Self {
        libm::log(self)
    }
    fn exp(self) -> Self {
        libm::exp(self)
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
    #[inline(always)]
    fn round_u16(self) -> u16 {
        // The number is converted to u32 first, because the FPU has an instruction for this conversion with saturation.
        ((self + 0.5) as u32).min(u32::from(u16::MAX)) as u16
    }
    fn round_i16(self) -> i16 {
        if self < 0.0 { (self - 0.5) as i16 } else { (self + 0.5) as i16 }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        fpu::sqrt(self)
    }
    fn ln(self) -> Self {
        libm::logf(self)
    }
    fn exp(self) -> Self {
        libm::expf(self)
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

//! The one place of arithmetic: [`Real`] is `f32` on the device and `f32` or `f64` on a host.
//!
//! Transcendental functions come from `libm` on every target, never from `std`, so that a host in `f32` computes the very
//! bits that the device computes. The square root is the FPU's own instruction where there is one: both are correctly
//! rounded, so the bits agree there too.

use core::fmt::Debug;
use core::iter::Sum;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// A real number of the data path.
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
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;

    /// From a constant or a parameter; rounds to nearest.
    fn of(value: f64) -> Self;
    /// From a parameter stored in single precision; exact.
    fn of_f32(value: f32) -> Self;
    /// From a count or a code; exact below 2^24.
    fn of_u32(value: u32) -> Self;
    /// From a whole number; rounds to nearest.
    fn of_i32(value: i32) -> Self;
    /// From a whole number; rounds to nearest.
    fn of_i64(value: i64) -> Self;
    /// For output.
    fn to_f64(self) -> f64;
    /// For output.
    fn to_f32(self) -> f32;
    /// Nearest integer within 0..=65535, NaN to 0: for the scaled integers of the wire.
    fn round_u16(self) -> u16;
    /// Nearest integer within -32768..=32767, NaN to 0.
    fn round_i16(self) -> i16;
    /// Square root, correctly rounded; NaN below 0.
    fn sqrt(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Exponential.
    fn exp(self) -> Self;

    /// The larger; the other one where this is NaN.
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    /// The smaller; the other one where this is NaN.
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
        // To u32 and then down: the FPU converts to 32 bits, saturating, in one instruction.
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
    // Out of line: inline assembly has no single-precision register class on this target.
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
        // SAFETY: the routine above takes and returns s0 as this ABI says, touches nothing else and is defined for all x.
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

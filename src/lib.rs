//! The hardware-free core of Plantar: raw codes of an insole in, regional loads and steps out.
#![no_std]
#![warn(missing_docs)]

pub mod num; // one square root instruction: the only unsafe code of the library

#[forbid(unsafe_code)]
pub mod checksum;
#[forbid(unsafe_code)]
pub mod sequence;
#[forbid(unsafe_code)]
pub mod pipeline;
#[forbid(unsafe_code)]
pub mod faults;
#[forbid(unsafe_code)]
pub mod insole;
#[forbid(unsafe_code)]
pub mod protocol;
#[forbid(unsafe_code)]
pub mod storage;
#[cfg(feature = "firmware")]
#[forbid(unsafe_code)]
mod log;
#[cfg(feature = "firmware")]
#[forbid(unsafe_code)]
pub mod firmware;

pub use num::Real;
pub use pipeline::region::{Region, Side};

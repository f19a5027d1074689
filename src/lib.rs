//! The hardware-free core of Plantar: raw codes of an insole in, regional loads and steps out.
//!
//! The files are the stages, in the order that the data passes them. Parameters are plain data and can be replaced while
//! running; state is kept apart; no stage does I/O. [`insole::Insole`] strings the stages together.
#![no_std]
#![warn(missing_docs)]

pub mod num; // one square root instruction: the only unsafe code of the data path

#[forbid(unsafe_code)]
pub mod calibrate;
#[forbid(unsafe_code)]
pub mod contact;
#[forbid(unsafe_code)]
pub mod region;
#[forbid(unsafe_code)]
pub mod template;
#[forbid(unsafe_code)]
pub mod ellipse;
#[forbid(unsafe_code)]
pub mod model;
#[forbid(unsafe_code)]
pub mod live;
#[forbid(unsafe_code)]
pub mod stance;
#[forbid(unsafe_code)]
pub mod smooth;
#[forbid(unsafe_code)]
pub mod step;
#[forbid(unsafe_code)]
pub mod fault;
#[forbid(unsafe_code)]
pub mod insole;
#[forbid(unsafe_code)]
pub mod wire;
#[forbid(unsafe_code)]
pub mod fragment;
#[forbid(unsafe_code)]
pub mod pace;
#[forbid(unsafe_code)]
pub mod clock;
#[forbid(unsafe_code)]
pub mod link;
#[forbid(unsafe_code)]
pub mod store;
#[forbid(unsafe_code)]
pub mod map;
#[forbid(unsafe_code)]
pub mod update;
#[forbid(unsafe_code)]
pub mod boot;
#[forbid(unsafe_code)]
pub mod watch;
#[forbid(unsafe_code)]
pub mod emulation;

#[cfg(feature = "device")]
#[forbid(unsafe_code)]
pub mod app;
#[cfg(feature = "device")]
#[forbid(unsafe_code)]
pub mod ble;
#[cfg(feature = "device")]
pub mod device; // below the data path: stack, faults and resets of the boards

pub use num::Real;
pub use region::{Region, Side};

//! Plantar: firmware for instrumented insoles. This crate is the part that is independent of hardware and operating system:
//! `no_std`, without allocation, generic over `f32` and `f64`.
//!
//! The firmware scans the sensor matrix of an insole, determines the contact area and a fitted ellipse in each of eight regions
//! of the foot, and evaluates a viscoelastic model of the plantar tissue on the insole itself (DeBerardinis, Dufek, Trabia, J.
//! Biomech. 92, 2019, 137-145). The output is small: live regional loads, and one record for each step.
//!
//! Plantar is for people who wear instrumented insoles and want to see their regional loads, for biomechanists with recordings
//! who want area, ellipses, deformation and force of each region and step, and for firmware engineers, who can run and test
//! everything in an emulator. The same code runs on a device in single precision, and on a host in single or double precision.
//!
//! ```text
//! recording, or sensor matrix
//!   |
//!   v   scan       one frame of raw codes, u16 for each cell
//!   |   calibrate  codes -> pressure, kPa: zero offset, sensor law, gain
//!   |   baseline   minus the pressure of the cell under the lifted foot
//!   |   contact    the share of each cell that is in contact, 0 to 1
//!   |   region     area, measured force, centre of pressure of each region
//!   |   ellipse    second moments of the contact area -> centre, radii, angle
//!   |   model      area and area rate -> tissue deformation, model force
//!   v   stance     heel strike and toe off; stores the curves of the stance
//!   |   step       curves -> step record
//!   v   protocol   messages <-> bytes
//!   |   session    hello, commands, live frames, load records
//!   v
//! host: phone, command line
//! ```
//!
//! | module | content |
//! |---|---|
//! | [`pipeline`] | the stages from calibration to step, and their configuration |
//! | [`insole`] | one insole: connects the stages and the fault detection |
//! | [`faults`] | detection and masking of sensor faults |
//! | [`protocol`] | messages, their encoding, and the session of a device with a host |
//! | [`storage`] | settings, steps and firmware updates in NOR flash |
//! | `firmware` | the loops of a device; a board implements a few traits for them (feature `firmware`) |
//! | [`num`] | [`Real`], the arithmetic |
//! | [`checksum`], [`sequence`] | CRC-32, wrapping sequence numbers |
//!
//! # A step
//!
//! Four cells of 100 mm2 under the heel are pressed by up to 300 kPa: a peak force of 120 N.
//!
//! ```
//! use plantar::insole::Insole;
//! use plantar::pipeline::calibrate::{CellCalibration, FULL_CODE, SensorLaw};
//! use plantar::pipeline::{contact::ContactRule, region::Cell, stance_rule::StanceRule};
//! use plantar::pipeline::setup::{Setup, SetupCell};
//! use plantar::{Region, Side};
//!
//! let sensor = SensorLaw { full_kpa: 1000.0, exponent: 1.0 };
//! let (contact, stance) = (ContactRule::COUNTED, StanceRule::ADAPTIVE);
//! let setup = Setup { side: Side::Left, layout_id: 1, period_us: 10_000, sensor, contact, stance };
//! let cells = [(20.0, 20.0), (30.0, 20.0), (20.0, 30.0), (30.0, 30.0)].map(|(x_mm, y_mm)| {
//!     let cell = Cell { region: Region::Heel, x_mm, y_mm, area_mm2: 100.0 };
//!     SetupCell::new(cell, CellCalibration::IDEAL, 0)
//! });
//! let mut insole = Insole::<f64, 4>::new();
//! insole.set_up(setup, cells.into_iter()).unwrap();
//! let pressure_kpa = |frame: u32| 300.0 * (f64::from(frame % 100) / 60.0 * std::f64::consts::PI).sin().max(0.0);
//! let code = |frame| (pressure_kpa(frame) / 1000.0 * f64::from(FULL_CODE)) as u16;
//! // Two steps at 100 Hz, each with a stance of 0.6 s.
//! let step = |frame| insole.frame(frame, &[code(frame); 4]).then(|| insole.whole_step().unwrap());
//! let steps: Vec<_> = (0..200).filter_map(step).collect();
//! let peaks_n: Vec<f64> = steps.iter().map(|step| step.regions[Region::Heel as usize].measured_peak_n).collect();
//! assert!(peaks_n.len() == 2 && peaks_n.iter().all(|peak_n| (peak_n - 120.0).abs() < 0.1));
//! ```
#![no_std]

pub mod num; // contains the only unsafe code of the library: the square root instruction

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

//! Plantar pressure recordings: the type in memory, the file format, and the importers.
//!
//! A [`Recording`] is the pressure under one foot over time. It is stored in a Parquet file ([`Recording::read`],
//! [`Recording::write`]) and comes from one of the importers ([`csv`], [`pedar`], [`jiku`]) or from a computed walk with known
//! true values ([`synthetic`]). Where the source names no regions, [`template`] assigns them. [`VirtualInsole`] converts the
//! pressures of a recording to the codes of a sensor. The [`Zero`] of an insole is computed from a [`StandingTrial`].

pub mod csv;
pub mod jiku;
pub mod pedar;
pub mod synthetic;
pub mod template;

mod bins;
mod check;
mod error;
mod file;
mod insole;
mod layout;
mod names;
mod pages;
mod parts;
mod rate;
mod recording;
mod standing;
mod streamed;
mod table;
mod zero;

pub use error::{Error, Result};
pub use insole::VirtualInsole;
pub use layout::{Cell, Layout, MAX_CELLS};
pub use recording::Recording;
pub use standing::StandingTrial;
pub use streamed::StreamedCells;
pub use zero::{FootZero, Zero};

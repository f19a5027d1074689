//! Plantar pressure recordings: one in-memory type, one file format, and the ways into it.
//!
//! A [`Recording`] is what one foot's sensors read over time. It is kept in a Parquet file
//! ([`Recording::read`], [`Recording::write`]) and comes from one of the importers
//! ([`csv`], [`pedar`], [`jiku`]) or from a computed walk whose truth is known ([`synthetic`]).
//! [`template`] finds the region of cells whose source names none. A [`StandingTrial`] gives an insole its [`Zero`].

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
mod rate;
mod recording;
mod standing;
mod table;
mod zero;

pub use error::{Error, Result};
pub use insole::VirtualInsole;
pub use layout::{Cell, Layout, MAX_CELLS};
pub use recording::Recording;
pub use standing::StandingTrial;
pub use zero::{FootZero, Zero};

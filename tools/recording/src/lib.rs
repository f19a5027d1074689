//! Plantar pressure recordings: their type in memory, their file format, and the importers.
//!
//! A [`Recording`] is the pressure under one foot over time. It is stored in a Parquet file ([`Recording::read`],
//! [`Recording::write`]), which [`RecordingReader`] reads in blocks of frames. One of the importers creates it ([`export`] for
//! the exports of other systems, [`csv`], [`pedar`], [`jiku`]), [`StreamedCells`] collects it from the stream of an insole, or it
//! is computed from known true values ([`synthetic`]). If the source names no regions, [`template`] assigns them. An import can
//! use the layout of an [`EarlierRecording`] instead.
//! [`VirtualInsole`] converts the pressures of a recording to the codes of a sensor; [`Scans`] are these codes. The zero of an
//! insole, [`Zero`], is computed from a [`StandingTrial`]. [`Plateaus`] are its readings under known pressures.

pub mod csv;
pub mod emed;
pub mod export;
pub mod footprint;
pub mod footscan;
pub mod gaitpdb;
pub mod jiku;
pub mod loadsol;
pub mod moticon;
pub mod output;
pub mod pedar;
pub mod pliance;
pub mod synthetic;
pub mod tekscan;
pub mod template;
pub mod xsensor;

mod assembly;
mod bins;
mod check;
mod clipping;
mod clock;
mod columns;
mod earlier;
mod error;
mod file;
mod gaps;
mod grid;
mod insole;
mod layout;
mod least_squares;
mod names;
mod negatives;
mod numbered;
mod origin;
mod pages;
mod parts;
mod plateaus;
mod rate;
mod reader;
mod recording;
mod rows;
mod scans;
mod separators;
mod source;
mod span;
mod standing;
mod streamed;
mod table;
mod text;
mod totals;
mod units;
mod xls;
mod zero;

pub use check::MAX_KPA;
pub use clipping::Clipping;
pub use earlier::EarlierRecording;
pub use error::{Error, Result};
pub use export::{Export, Format, Options};
pub use insole::VirtualInsole;
pub use layout::{Cell, Layout, MAX_CELLS, Sheet};
pub use names::{area_title, without_side};
pub use origin::{note_unless_same_sensor, note_unless_same_walk};
pub use parts::{files, is_parquet};
pub use plateaus::{MAX_PLATEAU_KPA, MAX_PLATEAUS, MIN_PLATEAU_KPA, Plateau, PlateauCell, Plateaus, is_plateau_kpa};
pub use rate::is_same_rate;
pub use reader::RecordingReader;
pub use recording::Recording;
pub use rows::Rows;
pub use scans::{FrameSource, Scan, Scans};
pub use span::Span;
pub use standing::StandingTrial;
pub use streamed::StreamedCells;
pub use zero::{FootZero, Zero};

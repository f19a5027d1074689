//! The stages of the data path, in the order that the data passes them: raw codes in, regional loads and steps out.
//!
//! A stage knows only the stages before it. Parameters are plain data and can be replaced while running; state is kept apart;
//! no stage does I/O.

pub mod calibrate;
pub mod contact;
pub mod region;
pub mod template;
pub mod outline;
pub mod ellipse;
pub mod model;
pub mod tissue;
pub mod live;
pub mod stance;
pub mod smooth;
pub mod step;
pub mod cadence;
pub mod setup;
pub(crate) mod marks;
pub(crate) mod cell;

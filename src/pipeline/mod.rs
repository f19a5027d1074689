//! The stages of the data path, in the order in which the data passes them: from raw codes to regional loads and steps.
//!
//! A stage depends only on the stages before it. No stage performs I/O or allocates memory. The parameters of the model are
//! plain data, separate from state, and can be replaced while running; a new set-up of the cells resets the state of the
//! measurement ([`Insole::set_up`](crate::insole::Insole::set_up)). The stages are generic over [`Real`](crate::Real), except
//! where a host must obtain the same bits as the insole: calibration tables, baselines, contact, alerts and cadence are computed
//! in single precision and integers on every machine.
//!
//! | stage | module | result |
//! |---|---|---|
//! | calibration | [`calibrate`] | pressure of a cell, kPa |
//! | baseline | [`baseline`] | pressure of a cell above that of the lifted foot, kPa |
//! | contact | [`contact`] | share of a cell that is in contact |
//! | regions | [`region`] | area, force, centre of pressure and second moments of a region |
//! | ellipse | [`ellipse`] | contact ellipse |
//! | model | [`model`], [`live`] | tissue deformation and model force of a frame |
//! | lift | `lift` | whether the foot is lifted |
//! | curves | [`curves`] | stored curves of a stance |
//! | bouts | `window`, [`bout`] | load outside steps |
//! | cumulative load | [`cumulative`] | dose, squared pressure and sustained load of a day |
//! | alerts | [`alert`] | requests to unload a region |
//! | stance | [`stance`] | heel strike and toe off |
//! | measures | [`measures`] | the standard measures of a region and of the foot in a step |
//! | step | [`step`] | step record: the quantities of each region |
//! | tracking | [`track`] | force laws that follow the wearer |
//! | cadence | [`cadence`] | steps per minute |
//!
//! [`setup`], [`stance_rule`] and [`tissue`] are the configuration of the stages. [`outline`] and [`template`] describe soles.

pub mod calibrate;
pub mod baseline;
pub mod contact;
mod side;
pub mod region;
pub mod template;
pub mod outline;
pub mod ellipse;
pub mod model;
pub mod tissue;
pub mod live;
pub(crate) mod lift;
pub mod curves;
pub mod stance_rule;
mod window;
pub mod bout;
pub mod cumulative;
pub mod alert;
pub mod stance;
pub mod measures;
pub mod step;
pub mod track;
pub mod cadence;
pub mod setup;
pub(crate) mod marks;
pub(crate) mod cell;

//! Exports recordings to the formats of other programs.
//!
//! A [`Session`] contains the exported data: the quantities that the insole's own code computes in every frame of a recording,
//! the steps and the recorded pressures, of one foot or of both feet on one clock. Each module writes one format. A file is
//! written under a temporary name, and receives its final name when it is complete.

pub mod c3d;
pub mod csv;
pub mod mat;
pub mod mcap;
pub mod motion_bids;
pub mod opensim;

mod channel;
mod session;

pub use channel::{Channel, Quantity};
pub use session::{Event, EventKind, Foot, Frame, RegionFrame, Session, TimedStep};

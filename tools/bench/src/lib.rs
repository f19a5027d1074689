//! Shared parts of the programs of this package: the output of figures, simulated walks that the firmware's loops process on this
//! computer, and the studies of the ten barefoot walkers on a pressure plate.

mod figures;
pub mod host_loops;
pub mod studies;

pub use figures::{Figures, raise};

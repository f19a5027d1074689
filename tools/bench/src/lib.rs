//! What several programs of this package share: the output of figures, walks on the host loops, and the studies of the ten
//! barefoot walkers on a pressure plate.

mod figures;
pub mod host_loops;
pub mod studies;

pub use figures::Figures;

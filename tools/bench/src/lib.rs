//! The parts that the benchmarks and the endurance test share: the output of figures, and walks on the host loops.

mod figures;
pub mod host_loops;

pub use figures::Figures;

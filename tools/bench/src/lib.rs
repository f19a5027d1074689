//! The part that the benchmarks and the endurance test share: figures, printed and written as JSON.

mod figures;
pub mod host_loops;

pub use figures::Figures;

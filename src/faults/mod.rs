//! Sensor faults, detected while walking, and the masking of faulty cells.
//!
//! Detection has two parts. In stance, a cell records evidence (`pipeline/cell.rs`) in the rarely executed code that runs when
//! the contact of the cell changes; so a frame with the foot on the ground costs only a few more comparisons, independent of the
//! number of cells. In swing, once the foot is lifted (`pipeline/lift.rs`), all cells are reviewed, a few in each frame: their
//! evidence of the stance, and their unloaded reading, which their baseline also follows (`pipeline/baseline.rs`). Most faults
//! are reported once two steps have shown them; `docs/faults.md` has the rules. A line is a row or a column of the matrix.
//!
//! A masked cell reads the mean of the nearest healthy cells of its region, or zero if there are none nearby.

mod detector;
mod kinds;
mod lines;
mod masking;
mod matrix;
mod neighbourhood;
mod review;
mod rows;

pub(crate) use detector::FaultDetector;
pub use kinds::{Fault, FaultKind, Faults, MAX_FAULTS, Place};
pub(crate) use matrix::MatrixRows;
pub(crate) use neighbourhood::FrameContext;

/// Largest number of masked cells that are interpolated: one line of the matrix and a few more. Further masked cells read zero.
pub const MAX_INTERPOLATED: usize = 24;
/// Largest number of cells of an insole with known rows and columns, 16 by 16. Only such an insole is searched for faulty lines.
pub const MATRIX_CELLS: usize = 256;

/// Smallest number of cells of a line that must agree before the line counts as faulty.
const MIN_LINE_CELLS: u32 = 4;

//! Sensor faults, detected while walking, and the masking of faulty cells.
//!
//! Detection has two parts, and neither adds more than a comparison to a loaded frame. In stance, a cell records changes of its
//! contact (`pipeline/cell.rs`), in the rarely executed code that runs when the contact changes. In swing, once the contact has
//! been small and constant for `SETTLE_MS`, all cells are reviewed, a few in each frame: their records of the stance, and their
//! unloaded reading. A fault is reported once two steps have shown it; `docs/faults.md` has the rules.
//!
//! A masked cell reads the mean of the nearest healthy cells of its region, or nothing where there are none.

mod detector;
mod kinds;
mod lines;
mod masking;
mod neighbourhood;
mod review;
mod rows;

pub(crate) use detector::FaultDetector;
pub use kinds::{Fault, FaultKind, Faults, MAX_FAULTS, Place};
pub(crate) use neighbourhood::FrameContext;

/// Masked cells that are interpolated: one line of the matrix and some more. Further ones read nothing.
pub const MAX_INTERPOLATED: usize = 24;
/// Cells of the largest matrix with known rows and columns, 16 by 16.
pub const MATRIX_CELLS: usize = 256;

/// Time for which the contact must be small and constant before the foot counts as lifted, ms: by then the toes are unloaded.
/// The review takes as long again, and a swing lasts three times as long.
const SETTLE_MS: u32 = 100;
/// Cells of a line that must agree before the line counts as faulty.
const MIN_LINE_CELLS: u32 = 4;

//! Kinds of faults, their places, and the report of the detected faults.

use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Largest number of listed faults. Further faults are counted, and treated in the same way.
pub const MAX_FAULTS: usize = 16;

/// The kind of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FaultKind {
    /// No response to load.
    Open,
    /// Full scale without load.
    Short,
    /// A constant reading, regardless of the load.
    Stuck,
    /// Full scale in stance while the neighbouring cells read little: a damaged cell, or an object or a bone that presses on it.
    /// A single such cell is not masked.
    Saturated,
    /// The unloaded reading of a cell drifts farther than its baseline can follow.
    Drift,
    /// All cells of a row read a part of the row's load.
    Crosstalk,
}

impl FaultKind {
    /// All kinds, in the order of their numbers in encoded messages.
    pub const ALL: [Self; 6] = [Self::Open, Self::Short, Self::Stuck, Self::Saturated, Self::Drift, Self::Crosstalk];

    /// Name in output: one word in lower case.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Short => "short",
            Self::Stuck => "stuck",
            Self::Saturated => "saturated",
            Self::Drift => "drift",
            Self::Crosstalk => "crosstalk",
        }
    }
}

/// The place of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Place {
    /// This cell, by its index in a frame.
    Cell(u16),
    /// This row of the matrix.
    Row(u8),
    /// This column of the matrix.
    Column(u8),
}

impl core::fmt::Display for Place {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Cell(cell) => write!(f, "cell {cell}"),
            Self::Row(row) => write!(f, "row {row}"),
            Self::Column(column) => write!(f, "column {column}"),
        }
    }
}

/// One fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fault {
    /// The kind.
    pub kind: FaultKind,
    /// The place.
    pub place: Place,
    /// Time of its detection, ms since the first scan; `u32::MAX` for a time that is as long or longer (49.7 days).
    pub found_ms: u32,
}

/// The faults that an insole has detected since its start.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Faults {
    /// Number of all faults, listed or not.
    pub found: u32,
    /// Number of times that the baseline of a cell was corrected, for all cells together.
    pub rezeroed: u32,
    /// Number of masked cells of each region; 255 stands for 255 or more.
    pub masked_cells: [u8; 8],
    /// Number of cells of each region without a new baseline: in the last swing, they read more than a baseline can have
    /// ([`MAX_RESIDUAL_KPA`](crate::pipeline::baseline::MAX_RESIDUAL_KPA)), so their former baseline remains in force. 255 stands
    /// for 255 or more.
    pub with_former_baseline: [u8; 8],
    /// The first [`MAX_FAULTS`] faults, in the order of their detection.
    pub list: Vec<Fault, MAX_FAULTS>,
}

impl Faults {
    /// No faults.
    pub const NONE: Self =
        Self { found: 0, rezeroed: 0, masked_cells: [0; 8], with_former_baseline: [0; 8], list: Vec::new() };

    /// Bit i: region i has masked cells.
    pub fn masked(&self) -> u8 {
        self.masked_cells.iter().enumerate().fold(0, |bits, (i, &cells)| bits | u8::from(cells > 0) << i)
    }
}

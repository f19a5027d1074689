//! A calibration of all cells, sent and stored in blocks.

use crate::checksum::crc32;
use crate::pipeline::calibrate::CellCalibration;
use crate::pipeline::setup::DEVICE_CELLS;

/// Cells in a [`CalibrationBlock`].
pub const BLOCK_CELLS: usize = 16;

/// Blocks of the largest calibration.
pub const CALIBRATION_BLOCKS: usize = DEVICE_CELLS / BLOCK_CELLS;

/// Calibrations of [`BLOCK_CELLS`] cells; those beyond the last cell are ignored.
pub type CalibrationBlock = [CellCalibration; BLOCK_CELLS];

/// Computes the identifier of a calibration, cell by cell.
#[derive(Default)]
pub struct CalibrationId(u32);

impl CalibrationId {
    /// No cells yet.
    pub const fn new() -> Self {
        Self(0)
    }

    /// Adds cells.
    pub fn add(&mut self, cells: &[CellCalibration]) {
        for cell in cells {
            let mut bytes = [0; 10];
            let (before, after) = bytes.split_at_mut(4);
            before.copy_from_slice(&self.0.to_le_bytes());
            after[..2].copy_from_slice(&cell.offset.to_le_bytes());
            after[2..].copy_from_slice(&cell.gain.to_le_bytes());
            self.0 = crc32(&bytes);
        }
    }

    /// The identifier; never 0, which stands for the built-in calibration.
    pub fn id(&self) -> u32 {
        self.0.max(1)
    }
}

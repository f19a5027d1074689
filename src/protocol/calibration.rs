//! A calibration of all cells, sent and stored in blocks.

use crate::checksum::crc32;
use crate::pipeline::calibrate::CellCalibration;
use crate::pipeline::setup::DEVICE_CELLS;

/// Number of cells in a [`CalibrationBlock`].
pub const BLOCK_CELLS: usize = 16;

/// Number of blocks of the largest calibration, one with [`DEVICE_CELLS`] cells.
pub const CALIBRATION_BLOCKS: usize = DEVICE_CELLS / BLOCK_CELLS;

/// Calibrations of [`BLOCK_CELLS`] successive cells. In the last block, those beyond the last cell of the insole are ignored.
pub type CalibrationBlock = [CellCalibration; BLOCK_CELLS];

/// Computes the identifier of a calibration, cell by cell: the CRC-32 of the identifier up to the previous cell, and the cell's
/// offset and gain.
#[derive(Default)]
pub struct CalibrationId(u32);

impl CalibrationId {
    /// The state before the first cell.
    pub const fn new() -> Self {
        Self(0)
    }

    /// Adds the calibrations of the next cells.
    pub fn add(&mut self, cells: &[CellCalibration]) {
        for cell in cells {
            let mut bytes = [0; 10];
            let (previous_id, calibration) = bytes.split_at_mut(4);
            previous_id.copy_from_slice(&self.0.to_le_bytes());
            calibration[..2].copy_from_slice(&cell.offset.to_le_bytes());
            calibration[2..].copy_from_slice(&cell.gain.to_le_bytes());
            self.0 = crc32(&bytes);
        }
    }

    /// The identifier; never 0, which stands for the built-in calibration.
    pub fn id(&self) -> u32 {
        self.0.max(1)
    }
}

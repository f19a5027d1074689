//! The file of `plantar calibrate` with the readings at known pressures: it is refused, or it has a valid calibration for each
//! cell, or the reason why it has none.

use fit::calibration::{Calibration, CalibrationError};
use plantar::pipeline::calibrate::CellCalibration;
use recording::Plateaus;
use std::path::Path;

/// Checks one input.
pub fn check(data: &[u8]) {
    let Ok(plateaus) = Plateaus::parse(data, Path::new("fuzz.json")) else { return };
    match Calibration::of(&plateaus) {
        Ok(calibration) => {
            assert_eq!(calibration.cells.len(), plateaus.cells.len());
            assert_eq!(calibration.failures.len(), plateaus.cells.len());
            assert!(calibration.cells.iter().all(CellCalibration::is_valid), "{:?}", calibration.cells);
            assert!(calibration.gains.iter().all(|gain| (0.1..=10.0).contains(gain)));
            assert!(calibration.law.is_none_or(|law| law.sensor.is_valid()), "{:?}", calibration.law);
        }
        Err(CalibrationError::TooManyFailing { failing, cells, cell, .. }) => assert!(failing <= cells && cell < cells),
        Err(_) => {}
    }
}

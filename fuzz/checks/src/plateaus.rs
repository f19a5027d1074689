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
            assert!(calibration.cells.iter().all(CellCalibration::is_valid), "{:?}", calibration.cells);
            assert!(calibration.failing.iter().all(|(cell, _)| *cell < plateaus.cells.len()));
            let exponent = calibration.law.map(|law| law.exponent);
            assert!(exponent.is_none_or(f64::is_finite), "{exponent:?}");
        }
        Err(CalibrationError::TooManyFailing { failing, cells, cell, .. }) => assert!(failing <= cells && cell < cells),
        Err(_) => {}
    }
}

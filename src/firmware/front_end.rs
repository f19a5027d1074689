//! The figures of the reference board's analogue front end and of its scan, in one place: the firmware uses them,
//! `tools/hardware` draws, lists and simulates the circuit with them, and the simulated sensors of the tests add noise of up to
//! [`NOISE_CODES`].
//!
//! A column amplifier holds its column at the virtual ground, a fixed part of the supply. The selected row is at ground, so that
//! a cell of resistance R adds `FEEDBACK_OHM / R` times the virtual ground to the amplifier's output. The supply is also the
//! converter's reference, so that it cancels:
//!
//! ```
//! use plantar::firmware::front_end::{FEEDBACK_OHM, FULL_SCALE_OHM, UNLOADED_CODE, code};
//! use plantar::pipeline::calibrate::FULL_CODE;
//!
//! assert_eq!(code(f64::INFINITY) as u16, UNLOADED_CODE);
//! // By the sensor law, a cell at the full-scale pressure is `FULL_CODE` above an unloaded cell. This is beyond the range of
//! // the converter: a cell saturates at a lower pressure (docs/hardware.md).
//! assert!((code(f64::from(FULL_SCALE_OHM)) - f64::from(FULL_CODE) * 12.0 / 11.0).abs() < 0.01);
//! assert_eq!(FEEDBACK_OHM, 11 * FULL_SCALE_OHM);
//! ```

use crate::pipeline::calibrate::FULL_CODE;

/// The virtual ground is the supply voltage divided by this number.
pub const REFERENCE_DIVISOR: u16 = 11;
/// Feedback resistor of a column amplifier, ohm.
pub const FEEDBACK_OHM: u32 = 33_000;
/// Resistance of a cell at the full-scale pressure of the sensor law, ohm.
pub const FULL_SCALE_OHM: u32 = FEEDBACK_OHM / REFERENCE_DIVISOR as u32;
/// Code of an unloaded cell: the output of its amplifier is at the virtual ground.
pub const UNLOADED_CODE: u16 = FULL_CODE / REFERENCE_DIVISOR;
/// Codes from here on count as full scale, because an amplifier may saturate up to 33 mV, 1 % of its supply, below the supply.
pub const CLIPPED_CODE: u16 = FULL_CODE - FULL_CODE / 100;

/// Time from switching on the supply of the front end to the first row, us: longer than the simulated start
/// (docs/hardware.md).
pub const START_US: u32 = 500;
/// Time from the selection of a row to the first conversion, us: longer than the simulated settling of a sheet at 300 kPa, but
/// not of a sheet at full load everywhere (docs/hardware.md).
pub const SETTLE_US: u32 = 37;
/// Clock of the converter, kHz.
pub const ADC_KHZ: u32 = 64_000;
/// Sampling time of a conversion, half cycles of the converter's clock.
pub const SAMPLE_HALF_CYCLES: u32 = 25;
/// Time of a conversion after sampling, half cycles of the converter's clock (RM0434, ADC timing, 12 bits).
pub const CONVERT_HALF_CYCLES: u32 = 25;
/// Number of conversions that a code is the sum of.
pub const CONVERSIONS: u32 = 16;
/// Allowance for set-up, interrupts and wake-ups of a row, us, which was not measured. Between the end of settling and the start
/// of the first conversion, the driver of the converter executes some 1,100 instructions (counted in the machine code), which
/// alone take 18 us at 64 MHz without wait states.
pub const ALLOWANCE_US: u32 = 35;
/// Shortest supported time between frames, us: enough for a scan with this allowance, 2.79 ms, and for the measurement of the
/// supply every ten seconds.
pub const LEAST_PERIOD_US: u32 = 3_000;

/// Largest noise of the simulated sensors of the tests, codes. It exceeds three standard deviations of the noise that the
/// simulated front end has at an unloaded cell; with the whole sheet at 300 kPa, the standard deviation is larger
/// (docs/hardware.md).
pub const NOISE_CODES: f64 = 12.0;

/// The code of a cell with this resistance, ohm, before it is rounded and limited to [`FULL_CODE`].
pub fn code(cell_ohm: f64) -> f64 {
    f64::from(FULL_CODE) / f64::from(REFERENCE_DIVISOR) * (1.0 + f64::from(FEEDBACK_OHM) / cell_ohm)
}

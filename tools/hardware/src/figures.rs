//! The figures of the front end, and the bars that they must meet.

use crate::analyses::{
    self, Crosstalk, FULL_LOAD_OHM, Loop, Noise, ROW, SATURATING_OHM, Settling, WALKING_OHM, changes, crosstalk, extreme_change, loop_gain, loops,
    noise, noises, row_s, sampling_error_codes, sheet_crosstalk, supply_a, transfer,
};
use crate::data_sheet::{
    AMPLIFIER_OFFSET_V, MULTIPLEXER_ON_OHM, MULTIPLEXER_TYPICAL_OHM, PRECISE_OFFSET_V, SWITCH_ON_OHM,
};
use crate::netlist::Netlist;
use crate::spice::Conditions;
use anyhow::Result;
use plantar::firmware::front_end::{self, CLIPPED_CODE, NOISE_CODES, SETTLE_US};
use plantar::firmware::layout::{PERIOD_US, ROWS};

/// A figure with its bar.
pub struct Figure {
    /// The key in JSON.
    pub key: String,
    /// The value.
    pub value: f64,
    /// The smallest and the largest allowed value.
    pub bar: Option<(f64, f64)>,
    /// The meaning, with the unit.
    pub meaning: String,
}

impl Figure {
    /// True if the value misses its bar.
    pub fn is_missed(&self) -> bool {
        self.bar.is_some_and(|(least, most)| !(least..=most).contains(&self.value))
    }

    /// The value as it is printed, with three or more digits.
    pub fn value_text(&self) -> String {
        match self.value.abs() {
            ..1.0 => format!("{:.3}", self.value),
            ..100.0 => format!("{:.2}", self.value),
            _ => format!("{:.0}", self.value),
        }
    }

    /// The bar as it is printed.
    pub fn bar_text(&self) -> String {
        match self.bar {
            Some((0.0, most)) => format!("at most {most}"),
            Some((least, f64::INFINITY)) => format!("at least {least}"),
            Some((least, most)) => format!("{least} to {most}"),
            None => String::new(),
        }
    }
}

/// All results of the simulation.
pub struct Results {
    /// The figures with their bars.
    pub figures: Vec<Figure>,
    /// Resistances of a cell, ohm, with the simulated codes.
    pub transfer: Vec<(f64, f64)>,
    /// The changes of row.
    pub settling: Vec<Settling>,
    /// On-resistance of a row switch, ohm, with the error of a cell whose row is at full load, percent.
    pub row_error: Vec<(f64, f64)>,
    /// The loop gains.
    pub loops: Vec<Loop>,
    /// The noise.
    pub noise: Vec<Noise>,
}

/// Largest crosstalk, percent of a neighbour at full load.
const CROSSTALK_PERCENT: f64 = 0.5;
/// Smallest phase margin, degrees.
const PHASE_MARGIN_DEG: f64 = 45.0;
/// Largest error of sampling: half a step of 12 bits in a code, which is the sum of 16 conversions.
const SAMPLING_CODES: f64 = 8.0;
/// Largest error of the transfer function, percent of the reading.
const TRANSFER_PERCENT: f64 = 0.5;

/// The resistances at which the transfer function is simulated, ohm.
const CELLS_OHM: [f64; 11] = [
    f64::INFINITY,
    300_000.0,
    100_000.0,
    30_000.0,
    10_000.0,
    WALKING_OHM,
    5_000.0,
    4_000.0,
    FULL_LOAD_OHM,
    2_000.0,
    SATURATING_OHM,
];

/// Runs all simulations.
///
/// # Errors
/// If ngspice is missing or fails.
pub fn simulate(board: &Netlist) -> Result<Results> {
    let mut figures = Vec::new();
    let mut add = |key: &str, value: f64, bar: Option<(f64, f64)>, meaning: &str| {
        figures.push(Figure { key: key.into(), value, bar, meaning: meaning.into() });
    };
    let at_most = |most: f64| Some((0.0, most));

    let codes = transfer(board, &CELLS_OHM)?;
    let transfer: Vec<(f64, f64)> = CELLS_OHM.into_iter().zip(codes).collect();
    let unloaded = transfer[0].1;
    let error = |(ohm, code): &(f64, f64)| {
        let expected = front_end::code(*ohm) - front_end::code(f64::INFINITY);
        ((code - unloaded) / expected - 1.0).abs() * 100.0
    };
    let linear = transfer.iter().filter(|(ohm, _)| ohm.is_finite() && *ohm >= FULL_LOAD_OHM);
    let error_percent = linear.map(error).fold(0.0, f64::max);
    add("transfer_error_percent", error_percent, at_most(TRANSFER_PERCENT), "largest deviation from 1 + Rf / R, % of the reading");
    let saturated = transfer[CELLS_OHM.len() - 1].1;
    let clipped = f64::from(CLIPPED_CODE);
    add("saturated_code", saturated, Some((clipped, f64::INFINITY)), "code of a saturated amplifier, cell of 1 kohm");

    let mut settling =
        changes().into_iter().map(|(name, c)| analyses::settling(board, name, c)).collect::<Result<Vec<_>>>()?;
    let settled_us = settling.iter().map(|change| change.settled_s * 1e6).fold(0.0, f64::max);
    add("settling_us", settled_us, at_most(SETTLE_US.into()), "slowest change of row to half a step of 12 bits, us");
    let long_lines = changes()
        .into_iter()
        .map(|(name, c)| analyses::settling(board, name, Conditions { line_f: 2.0 * c.line_f, ..c }))
        .collect::<Result<Vec<_>>>()?;
    let long_us = long_lines.iter().map(|change| change.settled_s * 1e6).fold(0.0, f64::max);
    add("settling_long_lines_us", long_us, None, "the same with lines of 400 pF, us");
    let (name, conditions) = extreme_change();
    let extreme = analyses::settling(board, name, conditions)?;
    let at_conversion = extreme.error_lsb.iter().find(|(t_s, _)| *t_s >= f64::from(SETTLE_US) * 1e-6);
    let remaining_lsb = at_conversion.map_or(f64::NAN, |(_, lsb)| lsb.abs());
    add("settling_extreme_us", extreme.settled_s * 1e6, None, "the same with the whole sheet at full load, us");
    add("settling_extreme_lsb", remaining_lsb, None, "its error at the first conversion, LSB of 12 bits");
    settling.push(extreme);
    let sampling = sampling_error_codes(board)?;
    add("sampling_error_codes", sampling.abs(), at_most(SAMPLING_CODES), "error of an open cell after a cell at full load, codes");

    let talk = crosstalk(board, SWITCH_ON_OHM.value)?;
    let Crosstalk { row_one, row_all, column_one, diagonal, saturated } = talk;
    let bar = at_most(CROSSTALK_PERCENT);
    add("crosstalk_row_one_percent", row_one, bar, "one neighbour in the row, % of its reading");
    add("crosstalk_row_all_percent", row_all, bar, "all 15 neighbours in the row, % of one reading");
    add("crosstalk_column_percent", column_one, bar, "one neighbour in the column, largest offsets, % of its reading");
    add("crosstalk_diagonal_percent", diagonal, bar, "one neighbour in the next column and another row, largest offsets, %");
    let sheet = |cell_ohm: f64, offset_v: f64| sheet_crosstalk(board, cell_ohm, offset_v);
    let walking = sheet(WALKING_OHM, AMPLIFIER_OFFSET_V.value)?;
    add("crosstalk_sheet_percent", walking, None, "all cells of the other rows at 300 kPa, largest offsets, %");
    let full = sheet(FULL_LOAD_OHM, AMPLIFIER_OFFSET_V.value)?;
    add("crosstalk_sheet_full_percent", full, None, "all cells of the other rows at full load, largest offsets, %");
    let precise = sheet(WALKING_OHM, PRECISE_OFFSET_V.value)?;
    add("crosstalk_sheet_precise_percent", precise, None, "all cells of the other rows at 300 kPa, with OPA4376, %");
    add("crosstalk_saturated_percent", saturated, None, "a saturated neighbour of 1 kohm, % of a reading at full load");
    let mut row_error = Vec::new();
    for ohm in [0.1, SWITCH_ON_OHM.value, 1.0, 2.0, 4.0, MULTIPLEXER_TYPICAL_OHM.value, MULTIPLEXER_ON_OHM.value, 25.0, 70.0] {
        row_error.push((ohm, crosstalk(board, ohm)?.row_all));
    }
    let multiplexer = |ohm: f64| row_error.iter().find(|(of, _)| *of == ohm).map_or(f64::NAN, |(_, percent)| *percent);
    add(
        "crosstalk_row_all_adg706_percent",
        multiplexer(MULTIPLEXER_TYPICAL_OHM.value),
        None,
        "all 15 neighbours in the row with an ADG706, typical, %",
    );
    add(
        "crosstalk_row_all_adg706_max_percent",
        multiplexer(MULTIPLEXER_ON_OHM.value),
        None,
        "all 15 neighbours in the row with an ADG706, largest resistance, %",
    );

    let loops = loops().into_iter().map(|(name, c)| loop_gain(board, name, &c)).collect::<Result<Vec<_>>>()?;
    let margin = |of: &str| {
        let loops = loops.iter().filter(|one| one.name.starts_with(of));
        loops.map(|one| one.phase_margin_deg).fold(f64::INFINITY, f64::min)
    };
    let bar = Some((PHASE_MARGIN_DEG, f64::INFINITY));
    add("phase_margin_column_deg", margin("column"), bar, "smallest phase margin of a column amplifier, degrees");
    add("phase_margin_reference_deg", margin("virtual ground"), bar, "smallest phase margin of the virtual ground, degrees");

    let pessimistic_deg = margin("pessimistic");
    add("phase_margin_pessimistic_deg", pessimistic_deg, None, "a column amplifier with 600 ohm of output impedance, degrees");

    let noise = noises().into_iter().map(|(name, c)| noise(board, name, &c)).collect::<Result<Vec<_>>>()?;
    let unloaded_codes = noise[0].code_rms;
    add("noise_codes", unloaded_codes, at_most(NOISE_CODES / 3.0), "noise of an unloaded cell, codes, standard deviation");
    let loaded_codes = noise[noise.len() - 1].code_rms;
    add("noise_loaded_codes", loaded_codes, None, "noise with the whole sheet at 300 kPa, codes, standard deviation");

    let scanning_a = supply_a(board, &Conditions::selected(ROW).with_row(ROW, WALKING_OHM))?;
    let between_a = supply_a(board, &Conditions::idle())?;
    let off_a = supply_a(board, &Conditions { is_powered: false, ..Conditions::idle() })?;
    let connected = ROWS as f64 * row_s() / (f64::from(PERIOD_US) * 1e-6);
    let mean_a = between_a + (scanning_a - between_a) * connected;
    add("supply_scanning_ma", scanning_a * 1e3, at_most(9.0), "front end, a row with 16 cells at 300 kPa selected, mA");
    add("supply_between_ma", between_a * 1e3, at_most(6.5), "front end between scans, mA");
    add("supply_mean_ma", mean_a * 1e3, None, "front end at 100 Hz with such rows, mean, mA");
    add("supply_off_ua", off_a * 1e6, at_most(10.0), "front end switched off, uA");
    Ok(Results { figures, transfer, settling, row_error, loops, noise })
}

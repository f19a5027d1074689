//! The figures of the front end, and the limits that they must meet.

use crate::analyses::{
    FULL_LOAD_OHM, Loop, Noise, ROW, SATURATING_OHM, Settling, WALKING_OHM, crosstalk, extreme_change, loop_conditions,
    loop_gain, noise, noise_conditions, row_changes, row_crosstalk, row_s, sampling_error_codes, scan_s, settling,
    sheet_crosstalk, slowest_change, start_s, supply_a, transfer,
};
use crate::data_sheet::{
    AMPLIFIER_OFFSET_V, MULTIPLEXER_ON_OHM, MULTIPLEXER_TYPICAL_OHM, PRECISE_OFFSET_V, SWITCH_ON_OHM,
};
use crate::netlist::Netlist;
use crate::spice::{Conditions, Power};
use anyhow::Result;
use plantar::firmware::front_end::{self, CLIPPED_CODE, LEAST_PERIOD_US, NOISE_CODES, SETTLE_US, START_US};
use plantar::firmware::layout::{PERIOD_US, ROWS};

/// A figure with its limit.
pub struct Figure {
    /// The key in JSON.
    pub key: &'static str,
    /// The value.
    pub value: f64,
    /// The smallest and the largest allowed value; `None` without a limit.
    pub limit: Option<(f64, f64)>,
    /// The meaning, with the unit.
    pub meaning: &'static str,
}

impl Figure {
    /// True if the value misses its limit.
    pub fn is_missed(&self) -> bool {
        self.limit.is_some_and(|(least, most)| !(least..=most).contains(&self.value))
    }

    /// The value as it is printed: with three decimals below 1, with two below 100, and without decimals from 100 on.
    pub fn value_text(&self) -> String {
        match self.value.abs() {
            ..1.0 => format!("{:.3}", self.value),
            ..100.0 => format!("{:.2}", self.value),
            _ => format!("{:.0}", self.value),
        }
    }

    /// The limit as it is printed.
    pub fn limit_text(&self) -> String {
        match self.limit {
            Some((0.0, most)) => format!("at most {most}"),
            Some((least, f64::INFINITY)) => format!("at least {least}"),
            Some((least, most)) => format!("{least} to {most}"),
            None => String::new(),
        }
    }
}

/// All results of the simulation.
pub struct Results {
    /// The figures with their limits.
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

/// Largest allowed crosstalk, percent of the reading of a cell at full load.
pub const CROSSTALK_PERCENT: f64 = 0.5;
/// Smallest allowed phase margin, degrees.
const PHASE_MARGIN_DEG: f64 = 45.0;
/// Largest allowed error of sampling, codes: half a step of 12 bits in a code, which is the sum of 16 conversions.
const SAMPLING_CODES: f64 = 8.0;
/// Largest allowed error of the transfer function, percent of the reading.
const TRANSFER_PERCENT: f64 = 0.5;

/// Largest allowed supply current of the front end while a row is connected, mA.
const SCANNING_MA: f64 = 9.0;
/// Largest allowed supply current of the front end while it is supplied and no row is connected, mA.
const BETWEEN_MA: f64 = 6.5;
/// Largest allowed supply current of the front end while it is switched off, uA.
const OFF_UA: f64 = 10.0;

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
    let mut figures = Figures::default();
    let transfer = simulate_transfer(board, &mut figures)?;
    let settling = simulate_timing(board, &mut figures)?;
    let row_error = simulate_crosstalk(board, &mut figures)?;
    let loops = simulate_stability(board, &mut figures)?;
    let noise = simulate_noise(board, &mut figures)?;
    simulate_supply(board, &mut figures)?;
    Ok(Results { figures: figures.0, transfer, settling, row_error, loops, noise })
}

#[derive(Default)]
struct Figures(Vec<Figure>);

impl Figures {
    fn add(&mut self, key: &'static str, value: f64, meaning: &'static str) {
        self.0.push(Figure { key, value, limit: None, meaning });
    }

    fn at_most(&mut self, key: &'static str, value: f64, most: f64, meaning: &'static str) {
        self.0.push(Figure { key, value, limit: Some((0.0, most)), meaning });
    }

    fn at_least(&mut self, key: &'static str, value: f64, least: f64, meaning: &'static str) {
        self.0.push(Figure { key, value, limit: Some((least, f64::INFINITY)), meaning });
    }
}

fn simulate_transfer(board: &Netlist, figures: &mut Figures) -> Result<Vec<(f64, f64)>> {
    let transfer: Vec<_> = CELLS_OHM.into_iter().zip(transfer(board, &CELLS_OHM)?).collect();
    let (unloaded, saturated) = (transfer[0].1, transfer[CELLS_OHM.len() - 1].1);
    let error = |(ohm, code): &(f64, f64)| {
        let expected = front_end::code(*ohm) - front_end::code(f64::INFINITY);
        ((code - unloaded) / expected - 1.0).abs() * 100.0
    };
    let linear = transfer.iter().filter(|(ohm, _)| ohm.is_finite() && *ohm >= FULL_LOAD_OHM);
    let error_percent = linear.map(error).fold(0.0, f64::max);
    figures.at_most(
        "transfer_error_percent",
        error_percent,
        TRANSFER_PERCENT,
        "largest deviation of a cell's reading from the firmware's formula, up to full load, %",
    );
    figures.at_least(
        "saturated_code",
        saturated,
        CLIPPED_CODE.into(),
        "code of a saturated amplifier; the firmware reports saturation from the limit on",
    );
    Ok(transfer)
}

fn simulate_timing(board: &Netlist, figures: &mut Figures) -> Result<Vec<Settling>> {
    let run = |(name, conditions): (&'static str, Conditions)| settling(board, name, conditions);
    let mut settling = row_changes().into_iter().map(run).collect::<Result<Vec<_>>>()?;
    let settled_us = settling.iter().map(|change| change.settled_s * 1e6).fold(0.0, f64::max);
    figures.at_most(
        "settling_us",
        settled_us,
        SETTLE_US.into(),
        "slowest change of row until half a step of 12 bits remains, us; the limit is the time that the firmware waits",
    );
    figures.at_most(
        "start_us",
        start_s(board)? * 1e6,
        START_US.into(),
        "start of the supply until half a step of 12 bits remains, us; the limit is the time that the firmware waits",
    );
    let (name, conditions) = slowest_change();
    let long_lines = run((name, Conditions { line_f: 2.0 * conditions.line_f, ..conditions }))?;
    figures.add("settling_long_lines_us", long_lines.settled_s * 1e6, "slowest change of row with lines of 400 pF, us");
    let extreme = run(extreme_change())?;
    let at_conversion = extreme.error_lsb.iter().find(|(t_s, _)| *t_s >= f64::from(SETTLE_US) * 1e-6);
    let remaining_lsb = at_conversion.map_or(f64::NAN, |(_, lsb)| lsb.abs());
    figures.add("settling_extreme_us", extreme.settled_s * 1e6, "change of row with the whole sheet at full load, us");
    figures.add(
        "settling_extreme_lsb",
        remaining_lsb,
        "error at the first conversion with the whole sheet at full load, steps of 12 bits",
    );
    settling.push(extreme);
    figures.at_most(
        "scan_us",
        scan_s() * 1e6,
        LEAST_PERIOD_US.into(),
        "computed time of a scan, us; the limit is a frame at the highest supported rate",
    );
    figures.at_most(
        "sampling_error_codes",
        sampling_error_codes(board)?.abs(),
        SAMPLING_CODES,
        "error of an open cell that is converted after a cell at full load, codes",
    );
    Ok(settling)
}

fn simulate_crosstalk(board: &Netlist, figures: &mut Figures) -> Result<Vec<(f64, f64)>> {
    let crosstalk = crosstalk(board)?;
    let row_all_percent = row_crosstalk(board, SWITCH_ON_OHM.value)?;
    let limit = CROSSTALK_PERCENT;
    figures.at_most(
        "crosstalk_row_one_percent",
        crosstalk.row_one_percent,
        limit,
        "one neighbour at full load in the row of a cell at full load, % of the cell's reading",
    );
    figures.at_most(
        "crosstalk_row_all_percent",
        row_all_percent,
        limit,
        "15 neighbours at full load in the row of a cell at full load, % of the cell's reading",
    );
    figures.at_most(
        "crosstalk_column_percent",
        crosstalk.column_one_percent,
        limit,
        "one cell at full load in the column of an open cell, largest offsets, % of a reading at full load",
    );
    figures.at_most(
        "crosstalk_diagonal_percent",
        crosstalk.diagonal_percent,
        limit,
        "a cell at full load in the next column and another row, beside a cell at full load in the column of an open \
         cell, largest offsets, % of a reading at full load",
    );
    let mut sheet = |key, cell_ohm, offset_v, meaning| -> Result<()> {
        figures.add(key, sheet_crosstalk(board, cell_ohm, offset_v)?, meaning);
        Ok(())
    };
    let offset_v = AMPLIFIER_OFFSET_V.value;
    sheet(
        "crosstalk_sheet_percent",
        WALKING_OHM,
        offset_v,
        "all other rows at 300 kPa, largest offsets, % of a reading at full load",
    )?;
    sheet(
        "crosstalk_sheet_full_percent",
        FULL_LOAD_OHM,
        offset_v,
        "all other rows at full load, largest offsets, % of a reading at full load",
    )?;
    sheet(
        "crosstalk_sheet_precise_percent",
        WALKING_OHM,
        PRECISE_OFFSET_V.value,
        "all other rows at 300 kPa, offsets of the OPA4376, % of a reading at full load",
    )?;
    figures.add(
        "crosstalk_saturated_percent",
        crosstalk.saturated_percent,
        "a saturated neighbour of 1 kohm in the row of an open cell, with a cell at full load in another row of \
         each of the two columns, % of a reading at full load",
    );
    for (key, figure, meaning) in [
        (
            "crosstalk_row_all_adg706_percent",
            MULTIPLEXER_TYPICAL_OHM,
            "15 neighbours at full load in the row with an ADG706, typical resistance, % of the cell's reading",
        ),
        (
            "crosstalk_row_all_adg706_max_percent",
            MULTIPLEXER_ON_OHM,
            "15 neighbours at full load in the row with an ADG706, largest resistance, % of the cell's reading",
        ),
    ] {
        figures.add(key, row_crosstalk(board, figure.value)?, meaning);
    }
    [0.1, 0.2, 0.4, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]
        .into_iter()
        .map(|ohm| Ok((ohm, row_crosstalk(board, ohm)?)))
        .collect()
}

fn simulate_stability(board: &Netlist, figures: &mut Figures) -> Result<Vec<Loop>> {
    let run = |(name, conditions): (&'static str, Conditions)| loop_gain(board, name, &conditions);
    let loops = loop_conditions().into_iter().map(run).collect::<Result<Vec<_>>>()?;
    let smallest_deg = |prefix: &str| {
        let loops = loops.iter().filter(|one| one.name.starts_with(prefix));
        loops.map(|one| one.phase_margin_deg).fold(f64::INFINITY, f64::min)
    };
    let limit = PHASE_MARGIN_DEG;
    figures.at_least(
        "phase_margin_column_deg",
        smallest_deg("column"),
        limit,
        "smallest phase margin of a column amplifier with the typical output impedance, degrees",
    );
    figures.at_least(
        "phase_margin_reference_deg",
        smallest_deg("virtual ground"),
        limit,
        "smallest phase margin of the virtual ground's buffer, degrees",
    );
    figures.add(
        "phase_margin_pessimistic_deg",
        smallest_deg("pessimistic"),
        "phase margin of a column amplifier with an output impedance of 600 ohm, degrees",
    );
    Ok(loops)
}

fn simulate_noise(board: &Netlist, figures: &mut Figures) -> Result<Vec<Noise>> {
    let run = |(name, conditions): (&'static str, Conditions)| noise(board, name, &conditions);
    let noise = noise_conditions().into_iter().map(run).collect::<Result<Vec<_>>>()?;
    figures.at_most(
        "noise_codes",
        noise[0].deviation_codes,
        NOISE_CODES / 3.0,
        "noise of an unloaded cell, codes, standard deviation; the limit is a third of the largest noise of the \
         sensors that the firmware's tests simulate",
    );
    let loaded_codes = noise[noise.len() - 1].deviation_codes;
    figures.add("noise_loaded_codes", loaded_codes, "noise with the whole sheet at 300 kPa, codes, standard deviation");
    Ok(noise)
}

fn simulate_supply(board: &Netlist, figures: &mut Figures) -> Result<()> {
    let scanning_a = supply_a(board, &Conditions::selected(ROW).with_row(ROW, WALKING_OHM))?;
    let between_a = supply_a(board, &Conditions::idle())?;
    let off_a = supply_a(board, &Conditions { power: Power::Off, ..Conditions::idle() })?;
    let connected_share = ROWS as f64 * row_s() / (f64::from(PERIOD_US) * 1e-6);
    let mean_a = between_a + (scanning_a - between_a) * connected_share;
    figures.at_most(
        "supply_scanning_ma",
        scanning_a * 1e3,
        SCANNING_MA,
        "front end while a row with 16 cells at 300 kPa is connected, mA",
    );
    figures.at_most("supply_between_ma", between_a * 1e3, BETWEEN_MA, "front end supplied, no row connected, mA");
    figures.add(
        "supply_mean_ma",
        mean_a * 1e3,
        "front end, mean at 100 Hz with rows of 16 cells at 300 kPa if it were not switched off between scans, mA",
    );
    figures.at_most("supply_off_ua", off_a * 1e6, OFF_UA, "front end switched off, uA");
    Ok(())
}

//! The simulated analyses of the front end: transfer, settling, start, sampling, crosstalk, stability, noise and supply current.

use crate::data_sheet::{
    AMPLIFIER_LARGE_OUTPUT_OHM, AMPLIFIER_OFFSET_V, CONVERTER_NOISE_LSB, LOAD_SWITCH_OPEN_ON_S,
    LOAD_SWITCH_OPEN_V_PER_S, LOAD_SWITCH_SLOW_ON_S, LOAD_SWITCH_SLOW_V_PER_S, SUPPLY_V,
};
use crate::netlist::{Netlist, amplifier, input_net};
use crate::ngspice::Run;
use crate::parts::Model;
use crate::spice::{Conditions, Gate, Power, SAMPLED, SUPPLY_SOURCE, circuit, probed_node};
use anyhow::{Context, Result, bail, ensure};
use plantar::firmware::front_end::{
    self, ADC_KHZ, ALLOWANCE_US, CONVERSIONS, CONVERT_HALF_CYCLES, SAMPLE_HALF_CYCLES, SETTLE_US,
};
use plantar::firmware::layout::{COLUMNS, ROWS};
use plantar::pipeline::calibrate::FULL_CODE;

/// The row of the measured cell.
pub const ROW: usize = 5;
/// The column of the measured cell.
pub const COLUMN: usize = 5;
/// The column beside that of the measured cell.
const NEXT_COLUMN: usize = COLUMN + 1;
/// Resistance of a cell at full load, ohm: the smallest round resistance that does not saturate the amplifier. It stands for
/// 855 kPa by the sensor law.
pub const FULL_LOAD_OHM: f64 = 3_400.0;
/// Resistance of a cell at a pressure of 300 kPa, as under a heel in walking, ohm.
pub const WALKING_OHM: f64 = 7_900.0;
/// The smallest resistance that a cell is assumed to reach, ohm. It saturates the amplifier of the column.
pub const SATURATING_OHM: f64 = 1_000.0;
/// Number of codes in one LSB of the converter: a code is the sum of this number of conversions.
pub const CODES_PER_LSB: f64 = CONVERSIONS as f64;

/// Half a cycle of the converter's clock, s.
const HALF_CYCLE_S: f64 = 0.5e-3 / ADC_KHZ as f64;

/// The code, not rounded, of this voltage at the converter.
pub fn code(volt: f64) -> f64 {
    volt / SUPPLY_V.value * f64::from(FULL_CODE)
}

/// Duration of a conversion's sampling, s.
fn sample_s() -> f64 {
    f64::from(SAMPLE_HALF_CYCLES) * HALF_CYCLE_S
}

/// Duration of a conversion, s.
fn conversion_s() -> f64 {
    f64::from(SAMPLE_HALF_CYCLES + CONVERT_HALF_CYCLES) * HALF_CYCLE_S
}

/// Time for which a row is connected, s: settling, and the conversions of all columns.
pub fn row_s() -> f64 {
    f64::from(SETTLE_US) * 1e-6 + COLUMNS as f64 * f64::from(CONVERSIONS) * conversion_s()
}

/// Duration of a scan, s: all rows, and a first code of one column, which is discarded. Each row and the discarded code include
/// [`ALLOWANCE_US`].
pub fn scan_s() -> f64 {
    let allowance_s = f64::from(ALLOWANCE_US) * 1e-6;
    ROWS as f64 * (row_s() + allowance_s) + f64::from(CONVERSIONS) * conversion_s() + allowance_s
}

/// The voltages at the converter's inputs in the steady state, V, by column.
///
/// # Errors
/// If ngspice is missing or finds no solution.
pub fn inputs_v(board: &Netlist, conditions: &Conditions) -> Result<Vec<f64>> {
    let vectors = (0..COLUMNS).map(|column| format!("v({}) ", input_net(column))).collect::<String>();
    let tables = Run::of(circuit(board, conditions)).table("op", &vectors).tables()?;
    // The first number of the row is the scale, which has no meaning for an operating point.
    Ok(tables[0][0][1..].to_vec())
}

/// The code, not rounded, of the measured cell in the steady state.
fn measured_code(board: &Netlist, conditions: &Conditions) -> Result<f64> {
    Ok(code(inputs_v(board, conditions)?[COLUMN]))
}

/// The codes of the measured cell at these resistances, ohm, with all other cells open.
///
/// # Errors
/// If ngspice is missing or finds no solution.
pub fn transfer(board: &Netlist, cell_ohm: &[f64]) -> Result<Vec<f64>> {
    let code = |ohm: &f64| measured_code(board, &Conditions::selected(ROW).with_cell(ROW, COLUMN, *ohm));
    cell_ohm.iter().map(code).collect()
}

/// A curve: pairs of abscissa and value.
pub type Points = Vec<(f64, f64)>;

/// The approach of the converter's input to its final voltage after another row was selected.
pub struct Settling {
    /// Description of the change of row.
    pub name: &'static str,
    /// Times after the selection, s, with the distances from the final voltage, LSB of 12 bits.
    pub error_lsb: Points,
    /// Time from the selection until the distance remains below half an LSB, s.
    pub settled_s: f64,
}

/// Time from the start of a simulation to the deselection of the previous row, s.
const DESELECTED_S: f64 = 1e-6;
/// Time between the deselection of a row and the selection of the next one, s: four address lines are written in between.
const BREAK_S: f64 = 0.2e-6;
/// Duration of a simulation of settling, s.
const SETTLING_S: f64 = 81e-6;
/// Largest share of the simulated time after a change until the converter's input has settled. Distances are taken from the last
/// sample, so an input that still changes has a distance of more than half an LSB until shortly before the end.
const SETTLED_SHARE: f64 = 0.75;

/// The changes from row `ROW - 1` to row `ROW` after which the settling is simulated: name and conditions.
pub fn row_changes() -> Vec<(&'static str, Conditions)> {
    let (before, open) = (ROW - 1, f64::INFINITY);
    let idle = Conditions::idle();
    let walking = idle.clone().with_all(WALKING_OHM).with_row(before, FULL_LOAD_OHM).with_cell(ROW, COLUMN, open);
    vec![
        ("open cell to full load", idle.clone().with_cell(ROW, COLUMN, FULL_LOAD_OHM)),
        ("full load to open cell", idle.clone().with_cell(before, COLUMN, FULL_LOAD_OHM)),
        ("row at full load to open row", idle.clone().with_row(before, FULL_LOAD_OHM)),
        ("row at full load to open cell, sheet at 300 kPa", walking),
        ("saturated cell to open cell", idle.with_cell(before, COLUMN, SATURATING_OHM)),
        slowest_change(),
    ]
}

/// The slowest of the [`row_changes`]. 300 kPa on the whole sheet are some 6 kN.
pub fn slowest_change() -> (&'static str, Conditions) {
    let conditions = Conditions::idle().with_all(WALKING_OHM).with_row(ROW - 1, SATURATING_OHM);
    ("saturated row to open cell, sheet at 300 kPa", conditions.with_cell(ROW, COLUMN, f64::INFINITY))
}

/// A change of row on a sheet that is at full load everywhere, some 17 kN, which no person reaches.
pub fn extreme_change() -> (&'static str, Conditions) {
    let conditions = Conditions::idle().with_all(FULL_LOAD_OHM).with_cell(ROW, COLUMN, f64::INFINITY);
    ("sheet at full load, to open cell", conditions)
}

/// Simulates the settling after the change from row `ROW - 1` to row `ROW`.
///
/// # Errors
/// If ngspice is missing or finds no solution, or if the input does not settle.
pub fn settling(board: &Netlist, name: &'static str, mut conditions: Conditions) -> Result<Settling> {
    let selected_s = DESELECTED_S + BREAK_S;
    conditions.gates[ROW - 1] = Gate::OnUntil(DESELECTED_S);
    conditions.gates[ROW] = Gate::OnFrom(selected_s);
    let error_lsb = approach(board, &conditions, "50n", selected_s, SETTLING_S)?;
    let settled_s = settled_s(&error_lsb, 0.0)?;
    Ok(Settling { name, error_lsb, settled_s })
}

/// Simulates the measured cell's input of the converter until `end_s`; `dt` is the time step with its unit, as ngspice reads it.
/// Returns the times after `from_s`, s, with the distances from the final voltage, LSB of 12 bits.
fn approach(board: &Netlist, conditions: &Conditions, dt: &str, from_s: f64, end_s: f64) -> Result<Points> {
    let analysis = format!("tran {dt} {end_s:e} 0 {dt}");
    let vector = format!("v({})", input_net(COLUMN));
    let table = Run::of(circuit(board, conditions)).table(&analysis, &vector).tables()?.remove(0);
    let final_v = table[table.len() - 1][1];
    let distance = |row: &Vec<f64>| (row[0] - from_s, (code(row[1]) - code(final_v)) / CODES_PER_LSB);
    Ok(table.iter().filter(|row| row[0] >= from_s).map(distance).collect())
}

/// The time from which the distance from the last sample remains below half an LSB, s. `error_lsb` contains times, s, with these
/// distances, LSB. At `changed_s`, s, the change ends after which the input settles.
///
/// # Errors
/// If the input has not settled within three quarters of the time after the change, because the last sample may not be the final
/// voltage then.
pub fn settled_s(error_lsb: &[(f64, f64)], changed_s: f64) -> Result<f64> {
    let (end_s, _) = *error_lsb.last().context("the simulation has no sample")?;
    let last = error_lsb.iter().rposition(|(_, lsb)| lsb.abs() > 0.5);
    let settled_s = last.map_or(0.0, |i| error_lsb[(i + 1).min(error_lsb.len() - 1)].0);
    let latest_s = changed_s + SETTLED_SHARE * (end_s - changed_s);
    ensure!(
        settled_s <= latest_s,
        "the converter's input has not settled within {:.0} us: simulate a longer time",
        latest_s * 1e6
    );
    Ok(settled_s)
}

/// Capacitance at the load switch's pin CT from which on the data sheet states times per farad, farad.
const SLOW_RISE_F: f64 = 100e-12;
/// The share of the supply voltage that the output has reached at the end of the turn-on time.
const TURNED_ON_SHARE: f64 = 0.9;
/// Time for which the simulation of the start continues after the supply has risen, s.
const AFTER_RISE_S: f64 = 1e-3;

/// The times from enabling the load switch to the beginning and to the end of the rise of its output, s. The turn-on time and the
/// time per volt are interpolated between those of the data sheet, linearly in the capacitance at CT. Above [`SLOW_RISE_F`] they
/// are proportional to it.
///
/// # Errors
/// If no capacitor is at CT.
fn rise_s(board: &Netlist) -> Result<(f64, f64)> {
    let Model::Capacitor(rise_f) = board.part("C2").kind.model else { bail!("C2, at CT, must be a capacitor") };
    let share = rise_f / SLOW_RISE_F;
    let between = |open: f64, slow: f64| if share < 1.0 { open + (slow - open) * share } else { slow * share };
    let turn_on_s = between(LOAD_SWITCH_OPEN_ON_S.value, LOAD_SWITCH_SLOW_ON_S.value);
    let s_per_v = between(1.0 / LOAD_SWITCH_OPEN_V_PER_S.value, 1.0 / LOAD_SWITCH_SLOW_V_PER_S.value);
    let rise_s = SUPPLY_V.value * s_per_v;
    Ok((turn_on_s - TURNED_ON_SHARE * rise_s, turn_on_s + (1.0 - TURNED_ON_SHARE) * rise_s))
}

/// Time from enabling the load switch until the converter's input of the measured cell remains within half an LSB of its final
/// voltage, s: the longer one of those of an open cell and of a cell at full load.
///
/// # Errors
/// If no capacitor is at CT, if ngspice is missing or finds no solution, or if the input does not settle.
pub fn start_s(board: &Netlist) -> Result<f64> {
    let (from_s, until_s) = rise_s(board)?;
    let start_s = |cell_ohm| {
        let conditions = Conditions {
            power: Power::Rising { from_s, until_s },
            ..Conditions::selected(ROW).with_cell(ROW, COLUMN, cell_ohm)
        };
        settled_s(&approach(board, &conditions, "1u", 0.0, until_s + AFTER_RISE_S)?, until_s)
    };
    Ok(start_s(f64::INFINITY)?.max(start_s(FULL_LOAD_OHM)?))
}

/// The error of the code of an open cell that is converted directly after a cell at full load, codes: at the first of its
/// conversions, the sampling capacitor still has the voltage of the column before.
///
/// # Errors
/// If ngspice is missing or finds no solution.
pub fn sampling_error_codes(board: &Netlist) -> Result<f64> {
    let start_s = 0.5e-6;
    let count = CONVERSIONS as usize;
    let mut conditions = Conditions::selected(ROW).with_cell(ROW, COLUMN - 1, FULL_LOAD_OHM);
    conditions.samples = (0..2 * count)
        .map(|i| {
            let at_s = start_s + i as f64 * conversion_s();
            (COLUMN - 1 + i / count, at_s, at_s + sample_s())
        })
        .collect();
    let end_s = start_s + 2.0 * count as f64 * conversion_s();
    let run = Run::of(circuit(board, &conditions)).table(&format!("tran 5n {end_s:e} 0 5n"), &format!("v({SAMPLED})"));
    let table = run.tables()?.remove(0);
    let steady_v = inputs_v(board, &Conditions { samples: Vec::new(), ..conditions.clone() })?[COLUMN];
    // After a sampling window, the capacitor holds its voltage, which is read 10 ns, two time steps, after the window.
    let held_v = |end_s: f64| {
        let after = table.iter().find(|row| row[0] >= end_s + 10e-9).context("the simulation ends too early")?;
        Ok::<_, anyhow::Error>(after[1])
    };
    let windows = conditions.samples[count..].iter();
    let sum_v = windows.map(|(.., end_s)| held_v(*end_s)).sum::<Result<f64>>()?;
    Ok(code(sum_v / count as f64) - code(steady_v))
}

/// How far loaded neighbours change the reading of a cell, in percent of a cell's reading at full load.
pub struct Crosstalk {
    /// One neighbour in the row of a cell at full load, through the resistance of switch and line.
    pub row_one_percent: f64,
    /// One neighbour in the column of an open cell, through the amplifiers' offsets, at their maximum.
    pub column_one_percent: f64,
    /// One cell in the next column and another row, beside a loaded cell of the measured column, also through the offsets at
    /// their maximum.
    pub diagonal_percent: f64,
    /// A saturated cell beside the measured one, while one cell of each of the two columns is loaded in another row: the column
    /// of the saturated cell is not at the virtual ground.
    pub saturated_percent: f64,
}

/// The code of a cell at full load minus that of an unloaded cell, with row switches of `switch_ohm`. All other cells of its
/// row have `beside_ohm`.
fn reading_beside(board: &Netlist, switch_ohm: f64, beside_ohm: f64) -> Result<f64> {
    let mut row = Conditions::selected(ROW).with_row(ROW, beside_ohm).with_cell(ROW, COLUMN, FULL_LOAD_OHM);
    row.row_switch.on_ohm = switch_ohm;
    Ok(measured_code(board, &row)? - front_end::code(f64::INFINITY))
}

/// How far 15 neighbours at full load change the reading of a cell at full load in the same row, in percent, with row switches
/// of `switch_ohm`.
///
/// # Errors
/// If ngspice is missing or finds no solution.
pub fn row_crosstalk(board: &Netlist, switch_ohm: f64) -> Result<f64> {
    let alone = reading_beside(board, switch_ohm, f64::INFINITY)?;
    Ok(((reading_beside(board, switch_ohm, FULL_LOAD_OHM)? / alone - 1.0) * 100.0).abs())
}

/// Simulates the crosstalk.
///
/// # Errors
/// If ngspice is missing or finds no solution.
pub fn crosstalk(board: &Netlist) -> Result<Crosstalk> {
    let base = Conditions::selected(ROW);
    let other_row = ROW + 2;
    let full_codes = front_end::code(FULL_LOAD_OHM) - front_end::code(f64::INFINITY);
    let change_percent = |before: &Conditions, after: &Conditions| -> Result<f64> {
        Ok(((measured_code(board, after)? - measured_code(board, before)?) / full_codes * 100.0).abs())
    };
    let alone = base.clone().with_cell(ROW, COLUMN, FULL_LOAD_OHM);
    let offset = base.clone().with_offset_against(COLUMN, AMPLIFIER_OFFSET_V.value);
    let column = offset.clone().with_cell(other_row, COLUMN, FULL_LOAD_OHM);
    let pair = base.with_cell(other_row, COLUMN, FULL_LOAD_OHM).with_cell(other_row, NEXT_COLUMN, FULL_LOAD_OHM);
    let beside_loaded = alone.clone().with_cell(ROW, NEXT_COLUMN, FULL_LOAD_OHM);
    let with_diagonal = column.clone().with_cell(other_row, NEXT_COLUMN, FULL_LOAD_OHM);
    let beside_saturated = pair.clone().with_cell(ROW, NEXT_COLUMN, SATURATING_OHM);
    Ok(Crosstalk {
        row_one_percent: change_percent(&alone, &beside_loaded)?,
        column_one_percent: change_percent(&offset, &column)?,
        diagonal_percent: change_percent(&column, &with_diagonal)?,
        saturated_percent: change_percent(&pair, &beside_saturated)?,
    })
}

/// How far the cells of all other rows, each of `cell_ohm`, change the reading of an open cell, in percent of a cell's reading
/// at full load. The offset is `offset_v` at the amplifier of the open cell, and `-offset_v` at those of the other columns.
///
/// # Errors
/// If ngspice is missing or finds no solution.
pub fn sheet_crosstalk(board: &Netlist, cell_ohm: f64, offset_v: f64) -> Result<f64> {
    let open = Conditions::selected(ROW).with_offset_against(COLUMN, offset_v);
    let mut loaded = open.clone().with_all(cell_ohm);
    loaded.cell_ohm[ROW] = open.cell_ohm[ROW];
    let full_codes = front_end::code(FULL_LOAD_OHM) - front_end::code(f64::INFINITY);
    Ok(((measured_code(board, &loaded)? - measured_code(board, &open)?) / full_codes * 100.0).abs())
}

/// The loop gain of an amplifier.
pub struct Loop {
    /// The conditions.
    pub name: &'static str,
    /// Frequency, Hz, and loop gain, dB.
    pub gain_db: Points,
    /// Frequency, Hz, and distance of the phase from that of an oscillation, degrees.
    pub margin_deg: Points,
    /// The phase margin: the distance at the frequency at which the loop gain is 1, degrees.
    pub phase_margin_deg: f64,
}

/// The conditions under which the stability is simulated.
pub fn loop_conditions() -> Vec<(&'static str, Conditions)> {
    let open = Conditions::selected(ROW);
    let column = Some(amplifier(COLUMN));
    let probed = |conditions: &Conditions| Conditions { probe: column.clone(), ..conditions.clone() };
    let mut large = probed(&open);
    large.amplifier.output_ohm = AMPLIFIER_LARGE_OUTPUT_OHM.value;
    vec![
        ("column, all cells open", probed(&open)),
        ("column, sheet at full load", probed(&open.clone().with_all(FULL_LOAD_OHM))),
        ("column, lines of 400 pF", Conditions { line_f: 2.0 * open.line_f, ..probed(&open) }),
        ("pessimistic output impedance", large),
        ("virtual ground, all cells open", Conditions { probe: Some(("U5".into(), "A")), ..open.clone() }),
        (
            "virtual ground, sheet at full load",
            Conditions { probe: Some(("U5".into(), "A")), ..open.with_all(FULL_LOAD_OHM) },
        ),
    ]
}

/// Simulates the loop gain of the probed amplifier.
///
/// # Errors
/// If no amplifier is probed, if ngspice is missing or finds no solution, or if the gain does not cross 1.
///
/// # Panics
/// If the board has no such amplifier.
pub fn loop_gain(board: &Netlist, name: &'static str, conditions: &Conditions) -> Result<Loop> {
    let (designator, unit) = conditions.probe.as_ref().context("no amplifier is probed")?;
    let feedback = board.part(designator).net(&format!("{unit} -"));
    let probed = probed_node(designator, unit);
    let ratio = format!("v({feedback})/v({probed})");
    let run = Run::of(circuit(board, conditions)).command("set units=degrees");
    let table = run.table("ac dec 100 1k 100meg", &format!("db({ratio}) ph({ratio})")).tables()?.remove(0);
    let gain_db: Points = table.iter().map(|row| (row[0], row[1])).collect();
    // The loop gain is the negative ratio, so that its phase plus 180 degrees is that of the ratio.
    let margin_deg: Points = table.iter().map(|row| (row[0], row[2])).collect();
    let crossing = gain_db.iter().position(|(_, db)| *db < 0.0).filter(|i| *i > 0);
    let phase_margin_deg = margin_deg[crossing.context("the loop gain does not cross 1")?].1;
    Ok(Loop { name, gain_db, margin_deg, phase_margin_deg })
}

/// The noise of the front end at the converter's input.
pub struct Noise {
    /// The conditions.
    pub name: &'static str,
    /// Frequency, Hz, and density, V/sqrt(Hz).
    pub density: Points,
    /// Standard deviation of a code, codes, including the noise of the converter.
    pub deviation_codes: f64,
}

/// The conditions under which the noise is simulated.
pub fn noise_conditions() -> Vec<(&'static str, Conditions)> {
    let open = Conditions::selected(ROW);
    vec![
        ("all cells open", open.clone()),
        ("cell at full load", open.clone().with_cell(ROW, COLUMN, FULL_LOAD_OHM)),
        ("sheet at 300 kPa", open.with_all(WALKING_OHM)),
    ]
}

/// Simulates the noise. The front end's noise is assumed to be the same in all conversions of a code, which is its worst case;
/// that of the converter is independent between conversions.
///
/// # Errors
/// If ngspice is missing or finds no solution.
pub fn noise(board: &Netlist, name: &'static str, conditions: &Conditions) -> Result<Noise> {
    let run = Run::of(circuit(board, conditions))
        .command(&format!("noise v({}) {SUPPLY_SOURCE} dec 20 10 1g", input_net(COLUMN)))
        .table("setplot noise1", "onoise_spectrum")
        .table("setplot noise2", "onoise_total");
    let tables = run.tables()?;
    let density = tables[0].iter().map(|row| (row[0], row[1])).collect();
    let front_end_codes = code(tables[1][0][1]);
    let converter_codes = CONVERTER_NOISE_LSB.value * f64::from(CONVERSIONS).sqrt();
    Ok(Noise { name, density, deviation_codes: front_end_codes.hypot(converter_codes) })
}

/// The supply current of the front end, A.
///
/// # Errors
/// If ngspice is missing or finds no solution.
pub fn supply_a(board: &Netlist, conditions: &Conditions) -> Result<f64> {
    let run = Run::of(circuit(board, conditions)).table("op", &format!("i({SUPPLY_SOURCE})"));
    Ok(-run.tables()?[0][0][1])
}

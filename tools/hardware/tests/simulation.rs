//! The simulated front end, compared with closed forms.

use hardware::analyses::{COLUMN, FULL_LOAD_OHM, Points, ROW, loop_gain, noise, row_crosstalk, settled_s, transfer};
use hardware::data_sheet::{SHEET_LINE_OHM, SUPPLY_V, SWITCH_ON_OHM};
use hardware::figures::simulate;
use hardware::netlist::{Netlist, amplifier};
use hardware::ngspice::Run;
use hardware::parts::{CAPACITOR_47P, DIVIDER_LOWER, DIVIDER_UPPER, FILTER, Model, RESISTOR_10K, SERIES};
use hardware::spice::{Conditions, Gate, Power, circuit};
use plantar::firmware::front_end::{self, FEEDBACK_OHM, UNLOADED_CODE};
use plantar::firmware::layout;
use plantar::pipeline::calibrate::Curve;
use plantar::pipeline::region::Side;
use std::f64::consts::TAU;

/// Boltzmann's constant times the temperature of the simulation, 27 °C, J.
const KT: f64 = 1.380_649e-23 * 300.15;

fn ohm(model: Model) -> f64 {
    match model {
        Model::Resistor(ohm) => ohm,
        other => panic!("{other:?} is no resistor"),
    }
}

fn farad(model: Model) -> f64 {
    match model {
        Model::Capacitor(farad) => farad,
        other => panic!("{other:?} is no capacitor"),
    }
}

/// Asserts that a value is as expected, within a relative tolerance.
fn assert_near(value: f64, expected: f64, tolerance: f64, quantity: &str) {
    assert!((value / expected - 1.0).abs() <= tolerance, "{quantity}: {value}, expected {expected}");
}

#[test]
#[ignore = "needs ngspice: cargo xtask test"]
fn all_figures_meet_their_limits() {
    let results = simulate(&Netlist::reference()).expect("the simulation runs");
    for figure in results.figures {
        assert!(!figure.is_missed(), "{} is {}, but {}", figure.key, figure.value, figure.limit_text());
    }
}

#[test]
#[ignore = "needs ngspice: cargo xtask test"]
fn the_transfer_is_that_of_a_non_inverting_amplifier() {
    let cells_ohm = [f64::INFINITY, 100_000.0, 10_000.0, FULL_LOAD_OHM];
    // The current flows through both lines and the switch.
    let in_series_ohm = SWITCH_ON_OHM.value + 2.0 * SHEET_LINE_OHM.value;
    let codes = transfer(&Netlist::reference(), &cells_ohm).expect("the simulation runs");
    for (ohm, code) in cells_ohm.into_iter().zip(codes) {
        assert_near(code, front_end::code(ohm + in_series_ohm), 5e-4, &format!("{ohm} ohm"));
    }
}

#[test]
#[ignore = "needs ngspice: cargo xtask test"]
fn the_simulated_codes_are_those_of_the_firmwares_sensor_law() {
    let sensor = layout::setup(Side::Left).sensor;
    let mut curve = Curve::new();
    curve.set(&sensor);
    let kpa = [50.0, 100.0, 300.0, 800.0];
    let share = kpa.map(|kpa: f64| (kpa / f64::from(sensor.full_kpa)).powf(f64::from(sensor.exponent)));
    let cells_ohm = share.map(|share| f64::from(front_end::FULL_SCALE_OHM) / share);
    let codes = transfer(&Netlist::reference(), &cells_ohm).expect("the simulation runs");
    for (kpa, code) in kpa.into_iter().zip(codes) {
        let measured_kpa: f64 = curve.pressure_kpa(code.round() as i32 - i32::from(UNLOADED_CODE));
        assert_near(measured_kpa, kpa, 5e-3, "pressure");
    }
}

#[test]
#[ignore = "needs ngspice: cargo xtask test"]
fn a_row_returns_to_the_virtual_ground_with_its_time_constant() {
    let mut conditions = Conditions::idle();
    conditions.gates[ROW] = Gate::OnUntil(0.5e-6);
    let switch = conditions.row_switch;
    let tau_s = ohm(RESISTOR_10K.model) * (conditions.line_f + switch.drain_f + switch.gate_drain_f);
    let run = Run::of(circuit(&Netlist::reference(), &conditions));
    let table =
        run.table("tran 10n 12u 0 10n", &format!("v(sheet_row{ROW})")).tables().expect("the simulation runs").remove(0);
    let remaining_v = |at_s: f64| {
        let row = table.iter().find(|row| row[0] >= at_s).expect("the simulation is long enough");
        (row[0], SUPPLY_V.value / f64::from(front_end::REFERENCE_DIVISOR) - row[1])
    };
    let ((early_s, early_v), (late_s, late_v)) = (remaining_v(3e-6), remaining_v(9e-6));
    assert_near(early_v / late_v, ((late_s - early_s) / tau_s).exp(), 0.02, "decay");
}

/// A distance of 4096 LSB that decays with the time constant tau is half an LSB after tau * ln(8192), 9.01 tau.
#[test]
fn an_input_that_still_changes_at_the_end_of_a_simulation_is_an_error() {
    let (tau_s, step_s) = (1e-6, 10e-9);
    // The decay begins with the first sample, at the time `before_s`.
    let decay = |samples: u32, before_s: f64| -> Points {
        let error_lsb = |t_s: f64| 4096.0 * (-t_s / tau_s).exp();
        let times_s = (0..=samples).map(|i| f64::from(i) * step_s);
        let final_lsb = error_lsb(f64::from(samples) * step_s);
        times_s.map(|t_s| (before_s + t_s, error_lsb(t_s) - final_lsb)).collect()
    };
    let settled = |samples| settled_s(&decay(samples, 0.0), 0.0);
    let found_s = settled(2_000).expect("the input settles within 20 us");
    assert!((found_s - tau_s * 8192f64.ln()).abs() <= step_s, "{found_s} s");
    for samples in [100, 500, 900, 1_100] {
        assert!(settled(samples).is_err(), "the input counts as settled after {samples} samples");
    }
    // Only the time after the change counts: 9 of 13 us.
    let delayed = decay(1_300, 10e-6);
    assert!(settled_s(&delayed, 10e-6).is_ok() && settled_s(&delayed, 0.0).is_err());
}

/// A filter with the time constant tau approaches a ramp that is delayed by tau. After the end of the ramp, the distance from
/// the final voltage decays exponentially.
#[test]
#[ignore = "needs ngspice: cargo xtask test"]
fn the_virtual_ground_follows_a_rising_supply_with_its_time_constant() {
    let (from_s, until_s) = (10e-6, 110e-6);
    let conditions = Conditions { power: Power::Rising { from_s, until_s }, ..Conditions::idle() };
    let (upper, lower) = (ohm(DIVIDER_UPPER.model), ohm(DIVIDER_LOWER.model));
    let tau_s = upper * lower / (upper + lower) * farad(FILTER.model);
    let run = Run::of(circuit(&Netlist::reference(), &conditions));
    let table = run.table("tran 100n 200u 0 100n", "v(DIVIDER)").tables().expect("the simulation runs").remove(0);
    let final_v = table[table.len() - 1][1];
    assert_near(final_v, SUPPLY_V.value / f64::from(front_end::REFERENCE_DIVISOR), 0.001, "virtual ground");
    let slope_v_per_s = final_v / (until_s - from_s);
    for at_s in [60e-6, until_s, until_s + 2.0 * tau_s] {
        let row = table.iter().find(|row| row[0] >= at_s).expect("the simulation is long enough");
        let (ramp_s, decay_s) = (row[0].min(until_s) - from_s, (row[0] - until_s).max(0.0));
        let missing_v = slope_v_per_s * tau_s * (1.0 - (-ramp_s / tau_s).exp()) * (-decay_s / tau_s).exp();
        // The load switch delays the ramp by 1 % of tau, because it also charges the decoupling.
        assert_near(slope_v_per_s * ramp_s - row[1], missing_v, 0.02, &format!("{at_s} s"));
    }
}

#[test]
#[ignore = "needs ngspice: cargo xtask test"]
fn the_noise_at_low_frequencies_is_the_sum_of_its_sources() {
    let board = Netlist::reference();
    let feedback_ohm = f64::from(FEEDBACK_OHM);
    let (upper, lower) = (ohm(DIVIDER_UPPER.model), ohm(DIVIDER_LOWER.model));
    for cell_ohm in [1e12, FULL_LOAD_OHM] {
        let conditions = Conditions::selected(ROW).with_cell(ROW, COLUMN, cell_ohm);
        let simulated = noise(&board, "", &conditions).expect("the simulation runs").density[0].1;
        let gain = feedback_ohm / cell_ohm;
        // The noise of amplifier, buffer and divider is amplified by the noise gain.
        let at_input =
            2.0 * conditions.amplifier.noise_v_per_sqrt_hz.powi(2) + 4.0 * KT * upper * lower / (upper + lower);
        let resistors = 4.0 * KT * (feedback_ohm + cell_ohm * gain.powi(2) + ohm(SERIES.model));
        let expected = (at_input * (1.0 + gain).powi(2) + resistors).sqrt();
        assert_near(simulated, expected, 0.02, &format!("{cell_ohm} ohm"));
    }
}

#[test]
#[ignore = "needs ngspice: cargo xtask test"]
fn neighbours_in_a_row_share_the_resistance_of_switch_and_line() {
    let simulated = row_crosstalk(&Netlist::reference(), SWITCH_ON_OHM.value).expect("the simulation runs");
    let shared_ohm = SWITCH_ON_OHM.value + SHEET_LINE_OHM.value;
    let own_ohm = FULL_LOAD_OHM + SHEET_LINE_OHM.value;
    let expected = 100.0 * (1.0 - (own_ohm + shared_ohm) / (own_ohm + 16.0 * shared_ohm));
    assert_near(simulated, expected, 0.02, "percent");
}

/// The loop gain of an amplifier with one pole, whose phase margin follows from the impedances at its inverting input.
#[test]
#[ignore = "needs ngspice: cargo xtask test"]
fn the_phase_margin_is_that_of_the_feedback_network() {
    let mut conditions = Conditions::selected(ROW);
    conditions.amplifier.output_ohm = 1e-3;
    conditions.amplifier.second_pole_hz = 1e12;
    // The feedback network divides by 1 + (input admittance) / (feedback admittance).
    let input_f = conditions.line_f + conditions.amplifier.input_f;
    let feedback = |hz: f64| (1.0 / f64::from(FEEDBACK_OHM), TAU * hz * farad(CAPACITOR_47P.model));
    let gain = |hz: f64| {
        let (real, imaginary) = feedback(hz);
        let sum_imaginary = imaginary + TAU * hz * input_f;
        let magnitude = real.hypot(imaginary) / real.hypot(sum_imaginary) * conditions.amplifier.gain_bandwidth_hz / hz;
        (magnitude, imaginary.atan2(real) - sum_imaginary.atan2(real))
    };
    let crossing_hz =
        (0..10_000).map(|i| 1e4 * 1.001f64.powi(i)).find(|hz| gain(*hz).0 < 1.0).expect("the gain crosses 1");
    // The open-loop gain lags by 90 degrees.
    let expected = 90.0 + gain(crossing_hz).1.to_degrees();
    for column in [0, COLUMN] {
        let probed = Conditions { probe: Some(amplifier(column)), ..conditions.clone() };
        let simulated = loop_gain(&Netlist::reference(), "", &probed).expect("the simulation runs").phase_margin_deg;
        assert!((simulated - expected).abs() < 1.0, "column {column}: {simulated} degrees, expected {expected}");
    }
}

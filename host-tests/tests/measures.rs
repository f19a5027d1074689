//! The standard measures of a step equal those of an independent implementation.

use crate::common;
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::measures::{FootMeasures, RegionMeasures};
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::step::StepRecord;
use recording::synthetic::{self, SyntheticWalk};
use recording::{Recording, VirtualInsole, jiku};
use serde_json::json;

/// A step, and the pressures of all cells from heel strike to toe off, frame by frame, kPa.
type MeasuredStep = (StepRecord<f64>, Vec<Vec<f32>>);

/// The virtual insole of a recording, and the steps that an insole finds in the recording.
fn steps(recording: &Recording) -> (VirtualInsole, Vec<MeasuredStep>) {
    let virtual_insole = VirtualInsole::new(recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let mut insole = Box::new(Insole::<f64, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("a recording's insole is valid");
    let mut codes = vec![0; virtual_insole.cells.len()];
    let mut steps = Vec::new();
    for i in 0..virtual_insole.frames(recording) {
        virtual_insole.codes_of(recording, i, &mut codes);
        if insole.frame(i as u32, &codes) {
            let step = insole.whole_step().expect("the insole is set up");
            let period_us = u64::from(virtual_insole.setup.period_us);
            let (start, frames) = ((step.start_us / period_us) as usize, u64::from(step.duration_us) / period_us);
            let pressures = (start..start + frames as usize).map(|i| virtual_insole.measured_kpa(recording.frame(i)));
            steps.push((step, pressures.collect()));
        }
    }
    (virtual_insole, steps)
}

/// The measures of the foot, in the order in which measures.py prints them.
fn of_foot(foot: &FootMeasures<f64>) -> Vec<f64> {
    let humps = [foot.first_peak, foot.valley, foot.second_peak].map(|extremum| [extremum.force_n, extremum.t_s]);
    let mut values = vec![foot.peak_n];
    values.extend(humps.concat());
    values.push(foot.integral_n_s);
    values.extend(foot.gait_line_mm.iter().flat_map(|(x_mm, y_mm)| [x_mm, y_mm]));
    values.extend([foot.gait_length_mm, foot.gait_width_mm, foot.gait_velocity_mm_s]);
    // The script prints 0 without an index.
    values.extend([foot.excursion_index.unwrap_or(0.0), foot.arch_index]);
    values
}

/// The measures of a region, in the order in which measures.py prints them.
fn of_region(region: &RegionMeasures<f64>) -> Vec<f64> {
    vec![
        region.peak_pressure_kpa,
        region.peak_pressure_s,
        region.pressure_integral_kpa_s,
        region.mean_pressure_kpa,
        region.loading_rate_n_s,
        region.contact_start_s,
    ]
}

/// Tolerance of values that follow from forces and areas, which the curves store without rounding: forces in N, their integral in
/// N s, their slope in N/s, and the arch index.
const FORCE_N: f64 = 1e-6;
/// Tolerance of times, which are multiples of the frame time, s.
const TIME_S: f64 = 1e-6;
/// Tolerance of the time of the largest pressure, s: several samples near a flat peak can have the same stored pressure, and
/// the first of them counts.
const PEAK_TIME_S: f64 = 0.03;
/// Tolerance of pressures and their integrals, kPa and kPa s: the curves store multiples of 0.1 kPa.
const PRESSURE_KPA: f64 = 0.05;
/// Tolerance of positions, lengths and velocities, mm and mm/s: the curves store positions in multiples of 1/64 mm.
const POSITION_MM: f64 = 0.02;
/// Tolerance of the excursion index: of a position relative to the width of a forefoot of at least 50 mm.
const EXCURSION_INDEX: f64 = POSITION_MM / 50.0;

/// The tolerance of a measure in addition to 0.1 %. Part 0 is the foot, and the further parts are the regions. `index` is the
/// position of the measure in the result of [`of_foot`] or [`of_region`].
fn tolerance(part: usize, index: usize) -> f64 {
    match (part, index) {
        (0, 2 | 4 | 6) | (1.., 5) => TIME_S,
        (1.., 1) => PEAK_TIME_S,
        (0, ..8 | 22) | (1.., 4) => FORCE_N,
        (0, 21) => EXCURSION_INDEX,
        (0, _) => POSITION_MM,
        _ => PRESSURE_KPA,
    }
}

/// Asserts that all measures of a recording equal those of NumPy, within 0.1 % and the resolution of the stored curves.
fn compare(recording: &Recording) {
    let (virtual_insole, steps) = steps(recording);
    assert!(steps.len() > 3);
    let cells = recording.layout.cells.iter();
    let input = json!({
        "rate_hz": recording.rate_hz,
        "cells": cells.map(|cell| [cell.x_mm, cell.y_mm, cell.area_mm2, f64::from(cell.region as u8)]).collect::<Vec<_>>(),
        "on_kpa": virtual_insole.setup.contact.on_kpa,
        "off_kpa": virtual_insole.setup.contact.off_kpa,
        "steps": steps.iter().map(|(_, pressures)| pressures).collect::<Vec<_>>(),
    });
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/measures.py");
    let text = common::run_python(&[script], &input.to_string());
    assert_eq!(text.lines().count(), steps.len());
    let mut compared = 0;
    for ((step, _), line) in steps.iter().zip(text.lines()) {
        let expected: Vec<Vec<f64>> = serde_json::from_str(line).expect("JSON");
        let found =
            [of_foot(&step.foot)].into_iter().chain(step.regions.iter().map(|region| of_region(&region.measures)));
        for (part, (found, expected)) in found.zip(expected).enumerate() {
            assert_eq!(found.len(), expected.len());
            for (i, (found, expected)) in found.into_iter().zip(expected).enumerate() {
                let tolerance = expected.abs() * 1e-3 + tolerance(part, i);
                let step = step.step;
                assert!((found - expected).abs() <= tolerance, "step {step}, part {part}, {i}: {found} not {expected}");
                compared += 1;
            }
        }
    }
    println!("{compared} measures of {} steps agree", steps.len());
}

#[test]
#[ignore = "needs Python with NumPy: cargo xtask test"]
fn measures_of_a_computed_walk_equal_those_of_numpy() {
    for rate_hz in [50.0, 100.0, 200.0] {
        compare(
            &synthetic::walk(&SyntheticWalk { steps: 6, rate_hz, variation: 0.1, ..SyntheticWalk::default() })
                .recording,
        );
    }
}

#[test]
#[ignore = "needs Python with NumPy, and the data set SpeedPP2DS: cargo xtask test"]
fn measures_of_recorded_steps_equal_those_of_numpy() {
    let walk = jiku::import(common::jiku(), 2, 0..10, &mut |_, _| ()).expect("the data set can be read");
    let walk = walk.at_rate(100.0).and_then(|walk| walk.binned(DEVICE_CELLS));
    compare(&walk.expect("a walk can be binned"));
}

#[test]
#[ignore = "needs the data set SpeedPP2DS: cargo xtask test"]
fn no_peak_between_the_samples_of_a_long_stance_is_missed() {
    let walk = jiku::import(common::jiku(), 2, 0..10, &mut |_, _| ()).expect("the data set can be read");
    let walk = walk.binned(DEVICE_CELLS).expect("a walk can be binned");
    assert!(walk.rate_hz > 300.0);
    let (virtual_insole, steps) = steps(&walk);
    let (mut decimated, mut between) = (0, 0);
    for (step, pressures) in &steps {
        decimated += u32::from(step.sample_us > virtual_insole.setup.period_us);
        for (region, found) in step.regions.iter().enumerate().filter(|(_, found)| found.contact_s > 0.0) {
            let cells: Vec<_> =
                walk.layout.cells.iter().enumerate().filter(|(_, cell)| cell.region as usize == region).collect();
            let region_n =
                |kpa: &[f32]| -> f64 { cells.iter().map(|(i, cell)| f64::from(kpa[*i]) * cell.area_mm2 * 1e-3).sum() };
            let force_n = pressures.iter().map(|kpa| region_n(kpa)).fold(0.0, f64::max);
            let all_kpa = pressures.iter().flat_map(|kpa| cells.iter().map(|(i, _)| f64::from(kpa[*i])));
            let (kpa, found_kpa) = (all_kpa.fold(0.0, f64::max), found.measures.peak_pressure_kpa);
            let name = plantar::Region::ALL[region];
            assert!((found_kpa - kpa).abs() < 0.06, "{name:?}: {found_kpa} not {kpa}");
            assert!(
                (found.measured_peak_n - force_n).abs() < 1e-3,
                "{name:?}: {} not {force_n}",
                found.measured_peak_n
            );
            // Several frames can have the largest force, up to rounding, so the reported frame is checked by its force.
            let at = ((found.measures.contact_start_s + found.time_to_peak_s) * walk.rate_hz).round() as usize;
            assert!((region_n(&pressures[at]) - force_n).abs() < 1e-3, "{name:?}: not in frame {at}");
            between += u32::from(!(at as u32 * virtual_insole.setup.period_us).is_multiple_of(step.sample_us));
        }
    }
    assert!(steps.len() > 3 && decimated > 3 && between > 10, "{decimated} steps, {between} peaks between samples");
}

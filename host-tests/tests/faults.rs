//! Sensor faults: their detection during a walk, the absence of false alarms, and the effect of masked cells on the model's
//! force.

use crate::common;
use emulator::{FAULT_EXAMPLES, SensorFault};
use plantar::Region;
use plantar::faults::{FaultKind, Faults, Place};
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::{Setup, SetupCell};
use plantar::pipeline::stance_rule::StanceRule;
use proptest::prelude::*;
use recording::{Recording, synthetic};
use std::f64::consts::PI;
use testkit::faults::{Clean, barefoot, computed, detection, in_shoe, model_error, walk};
use testkit::wear::{find, noisy_walk};
use testkit::{LAW, SETUP, cell, code_of};

fn assert_no_fault_is_reported(recordings: &[Clean]) {
    for clean in recordings {
        for contact in [ContactRule::COUNTED, ContactRule::COVERED] {
            let outcome = walk(&clean.recording, contact, None, &[]);
            let found = &outcome.faults;
            println!("{}: {} steps, {} faults reported", clean.name, outcome.toe_offs_s.len(), found.found);
            assert_eq!((found.found, found.rezeroed), (0, 0), "{}: {:?}", clean.name, found.list);
        }
    }
}

#[test]
fn no_fault_is_reported_for_computed_recordings() {
    assert_no_fault_is_reported(&computed());
}

#[test]
#[ignore = "needs the data set SpeedPP2DS: cargo xtask test"]
fn no_fault_is_reported_for_barefoot_recordings() {
    assert_no_fault_is_reported(&barefoot(&common::jiku()));
}

/// The walks are long and no two steps are equal, because a rare false alarm would not appear in a short walk.
#[test]
fn no_fault_is_reported_in_long_walks() {
    for seed in 1..=4 {
        for rate_hz in [50.0, 100.0, 400.0] {
            let long = synthetic::SyntheticWalk { steps: 400, rate_hz, seed, ..Default::default() };
            let faults = walk(&synthetic::walk(&long).recording, ContactRule::COUNTED, None, &[]).faults;
            assert_eq!(faults, Faults::NONE, "seed {seed}, {rate_hz} Hz");
        }
    }
}

/// In some steps of these walks, the heavily loaded foot covers a whole row of cells of the midfoot, and in others only a part of
/// the row.
#[test]
fn no_fault_is_reported_in_short_walks_of_varying_steps() {
    for seed in 0..40 {
        for peak_n in [600.0, 650.0, 715.0, 750.0, 800.0] {
            for variation in [0.1, 0.2] {
                let short = synthetic::SyntheticWalk { steps: 10, peak_n, variation, seed, ..Default::default() };
                let found = find(&noisy_walk(&short), ContactRule::COUNTED, StanceRule::ADAPTIVE);
                assert_eq!(found.faults, Faults::NONE, "seed {seed}, {peak_n} N, variation {variation}");
            }
        }
    }
}

/// The recording with all steps from `step` on placed flat: every cell that the step loads carries its share of the load from the
/// first moment to the last.
fn with_flat_steps(recording: &Recording, step: usize) -> Recording {
    let mut flat = recording.clone();
    let cells = recording.cells();
    let frames: Vec<&[f32]> = recording.pressure_kpa.chunks(cells).collect();
    let is_loaded = |frame: &&[f32]| frame.iter().any(|&kpa| kpa > 0.0);
    let mut end = 0;
    for index in 0.. {
        let Some(start) = (end..frames.len()).find(|&frame| is_loaded(&frames[frame])) else { break };
        end = (start..frames.len()).find(|&frame| !is_loaded(&frames[frame])).unwrap_or(frames.len());
        if index < step {
            continue;
        }
        for cell in 0..cells {
            let peak_kpa = frames[start..end].iter().map(|frame| frame[cell]).fold(0.0, f32::max);
            for frame in start..end {
                // Loaded and unloaded within 15 % of the stance each.
                let passed = (frame - start) as f32 / (end - start) as f32;
                let share = (passed.min(1.0 - passed) / 0.15).min(1.0);
                flat.pressure_kpa[frame * cells + cell] = peak_kpa * share;
            }
        }
    }
    flat
}

/// A foot that is placed flat, as on stairs or by a tired wearer, covers all cells of most rows at once.
#[test]
fn no_crosstalk_is_reported_when_the_wearer_begins_to_place_the_foot_flat() {
    for seed in 0..8 {
        for rate_hz in [50.0, 100.0, 400.0] {
            for peak_n in [500.0, 800.0, 1200.0] {
                let walk = synthetic::SyntheticWalk { steps: 14, rate_hz, peak_n, seed, ..Default::default() };
                let flat = with_flat_steps(&synthetic::walk(&walk).recording, 6);
                let found = find(&flat, ContactRule::COUNTED, StanceRule::ADAPTIVE);
                assert_eq!(found.faults, Faults::NONE, "seed {seed}, {rate_hz} Hz, {peak_n} N");
            }
        }
    }
}

/// A drift that zero tracking corrects, at any time, counts as found: it is not reported as a fault.
#[test]
fn every_kind_of_fault_is_found_within_two_steps() {
    for (seed, clean) in computed().iter().enumerate() {
        println!("{}:", clean.name);
        for result in detection(clean, 20, seed as u64) {
            println!(
                "  {:<13} {} of {} found, the slowest after {:.2} s; {} false alarms",
                result.name, result.found, result.injected, result.longest_s, result.false_alarms
            );
            assert!(result.injected > 0, "{}", result.name);
            assert_eq!(
                (result.found, result.false_alarms),
                (result.injected, 0),
                "{}: {:?}",
                result.name,
                result.missed
            );
        }
    }
}

/// Checks that masked cells increase the error of the model's force by at most half.
fn assert_masked_cells_cost_little(recordings: &[Clean]) {
    assert!(!recordings.is_empty(), "no recording has the selected name");
    for clean in recordings {
        let error = model_error(clean, 6, 1);
        println!("{}: {:.2} % without faults", clean.name, error.clean_percent);
        for (percent, mean, largest) in error.masked {
            let times = mean / error.clean_percent;
            println!(
                "  {percent} % of the cells masked: {mean:.2} %, {times:.2} times as much; largest {largest:.2} %"
            );
            assert!(times <= 1.5, "{}", clean.name);
        }
    }
}

#[test]
fn masked_cells_change_the_model_force_of_a_computed_walk_little() {
    let mut recordings = computed();
    recordings.retain(|clean| clean.name.ends_with("100 Hz"));
    assert_masked_cells_cost_little(&recordings);
}

#[test]
#[ignore = "needs the data set SpeedPP2DS: cargo xtask test"]
fn masked_cells_change_the_model_force_of_a_barefoot_walker_little() {
    let mut recordings = barefoot(&common::jiku());
    recordings.retain(|clean| clean.name.contains("walker 2, 100"));
    assert_masked_cells_cost_little(&recordings);
}

/// Tests with recordings of people, which are not public.
mod unpublished {
    use super::*;

    #[test]
    #[ignore = "needs recordings of people, which are not public: PLANTAR_RECORDINGS"]
    fn no_fault_is_reported_for_in_shoe_recordings() {
        assert_no_fault_is_reported(&in_shoe(&common::recordings()));
    }
}

#[test]
fn fault_notation_is_parsed_and_errors_contain_examples() {
    let (examples, _) = FAULT_EXAMPLES.split_once(", each").expect("the text has a list of examples");
    for text in examples.split(", ") {
        let fault: SensorFault = text.parse().expect("an example can be parsed");
        assert_eq!(format!("{text}@1.5").parse(), Ok(SensorFault { from_s: 1.5, ..fault }));
    }
    let drift = SensorFault { kind: FaultKind::Drift, place: Place::Cell(17), value: -50.0, from_s: 2.0 };
    assert_eq!("drift:17=-50/s@2".parse(), Ok(drift));
    for (text, reason) in [
        ("open:17", "kind of fault is unknown"),
        ("open-cell", "KIND:PLACE"),
        ("open-cell:x", "numbers from 0"),
        ("open-row:16", "0 to 15"),
        ("open-column:300", "0 to 15"),
        ("open-cell:17=3", "takes no value"),
        ("stuck:17", "takes a value"),
        ("stuck:17=x", "not a number"),
        ("stuck:17=65521", "0 to 65520"),
        ("crosstalk:3=1.5", "0 to 1"),
        ("drift:17=x/s", "codes per second"),
        ("drift:17=nan", "codes per second"),
        ("open-cell:17@-1", "0 s or later"),
        ("open-cell:17@soon", "in seconds"),
    ] {
        let Err(error) = text.parse::<SensorFault>() else { panic!("{text} must be refused") };
        let error = error.to_string();
        assert!(error.contains(text) && error.contains(reason) && error.contains("write for example"), "{error}");
    }
}

/// The heel of an insole: eight rows of eight cells of 10 mm by 10 mm.
fn heel_cells() -> impl Iterator<Item = SetupCell> + Clone {
    (0..64u8).map(|i| SetupCell {
        row_column: i,
        ..cell(Region::Heel, f32::from(i % 8) * 10.0, f32::from(i / 8) * 10.0, 100.0)
    })
}

/// All cells have the same pressure, but different gains, and so different codes.
#[test]
fn a_masked_cell_has_the_pressure_of_its_neighbours_whatever_their_gains() {
    const OPEN: usize = 27;
    let gain = |i: usize| if (i + i / 8).is_multiple_of(2) { 0.5 } else { 2.0 };
    let cells = heel_cells().enumerate().map(|(i, cell)| SetupCell { offset: 100, gain: gain(i), ..cell });
    for contact in [ContactRule::COUNTED, ContactRule::COVERED] {
        let mut insole = Box::new(Insole::<f64, 64>::new());
        insole.set_up(Setup { contact, ..SETUP }, cells.clone()).expect("the set-up is accepted");
        let mut codes = [0u16; 64];
        let mut largest = [(0.0, 0.0); 2];
        for seq in 0..1_000 {
            // Sixty frames of stance, with at most 120 kPa, are followed by forty frames of swing. From frame 500 on, one cell
            // is open.
            let kpa = 120.0 * (PI * f64::from(seq % 100) / 60.0).sin().max(0.0);
            codes.iter_mut().enumerate().for_each(|(i, code)| *code = 100 + code_of(&LAW, kpa / f64::from(gain(i))));
            let is_open = seq >= 500;
            if is_open {
                codes[OPEN] = 100;
            }
            insole.frame(seq, &codes);
            let load = &insole.loads()[Region::Heel as usize];
            let (force_n, area_mm2) = &mut largest[usize::from(is_open)];
            // The cell is masked after the first steps in which it is open.
            if !is_open || seq >= 800 {
                *force_n = load.frame.force.force_n.max(*force_n);
                *area_mm2 = load.frame.area.area_mm2::<f64>().max(*area_mm2);
            }
        }
        assert_eq!(insole.masked(), 1 << Region::Heel as usize);
        let [(force_n, area_mm2), (masked_n, masked_mm2)] = largest;
        assert!((force_n - 0.12 * 6400.0).abs() < 0.002 * force_n, "{force_n} N");
        assert!((masked_n - force_n).abs() < 0.001 * force_n, "{masked_n} N, without a fault {force_n} N");
        assert!((masked_mm2 - area_mm2).abs() < 0.005 * 100.0, "{masked_mm2} mm2, without a fault {area_mm2} mm2");
    }
}

/// A stone in the shoe does this: it loads one cell beyond the end of the scale, and the cell is unloaded in swing. Without this
/// pressure, the insole would give no alert.
#[test]
fn a_cell_that_is_saturated_in_stance_only_is_reported_once_and_remains_in_use() {
    const PRESSED: usize = 27;
    let mut insole = Box::new(Insole::<f64, 64>::new());
    insole.set_up(SETUP, heel_cells()).expect("the set-up is accepted");
    for seq in 0..1_000 {
        // Sixty frames of stance are followed by forty frames of swing.
        let kpa = 120.0 * (PI * f64::from(seq % 100) / 60.0).sin().max(0.0);
        let mut codes = [code_of(&LAW, kpa); 64];
        let is_pressed = kpa > 60.0;
        if is_pressed {
            codes[PRESSED] = u16::MAX;
        }
        insole.frame(seq, &codes);
        assert_eq!(insole.loads()[Region::Heel as usize].frame.saturated, is_pressed, "frame {seq}");
    }
    let faults = insole.faults();
    let listed: Vec<_> = faults.list.iter().map(|fault| (fault.kind, fault.place)).collect();
    assert_eq!(listed, [(FaultKind::Saturated, Place::Cell(PRESSED as u16))]);
    assert_eq!((faults.found, faults.masked_cells, insole.masked()), (1, [0; 8], 0));
}

/// The message has the time in ms as a `u32`, which is at most 49.7 days.
#[test]
fn the_time_of_a_fault_saturates() {
    const OPEN: u16 = 27;
    // The time at which the open cell is reported if the first frame has this number.
    let found_ms = |first: u32| {
        let mut insole = Box::new(Insole::<f32, 64>::new());
        insole.set_up(SETUP, heel_cells()).expect("the set-up is accepted");
        for frame in 0..800 {
            // Sixty frames of stance are followed by forty frames of swing. From frame 500 on, one cell is open.
            let kpa = 120.0 * (PI * f64::from(frame % 100) / 60.0).sin().max(0.0);
            let mut codes = [code_of(&LAW, kpa); 64];
            if frame >= 500 {
                codes[usize::from(OPEN)] = 0;
            }
            insole.frame(first.wrapping_add(frame), &codes);
        }
        let open = insole.faults().list.iter().find(|fault| fault.place == Place::Cell(OPEN));
        open.expect("the open cell is reported").found_ms
    };
    let ms = found_ms(0);
    assert!((5_000..8_000).contains(&ms), "{ms}");
    // At 100 Hz, the cell is reported in the last frame whose time is in the range of the message, or in the frame after it.
    let first = (u32::MAX - ms) / 10;
    assert_eq!((found_ms(first), found_ms(first + 1)), (u32::MAX - 5, u32::MAX));
    // The frame number wraps before the cell is reported.
    assert_eq!(found_ms(u32::MAX - 250), u32::MAX);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..ProptestConfig::default() })]

    /// Forces are finite and not negative for any codes, even if cells are masked.
    #[test]
    fn any_codes_give_finite_forces(seed in any::<u64>(), faulty_cells in 1u32..8) {
        let cells: Vec<SetupCell> = (0..64u8)
            .map(|i| SetupCell { row_column: i, ..cell(Region::Heel, f32::from(i % 8) * 10.0, f32::from(i / 8) * 10.0, 100.0) })
            .collect();
        let mut insole = Box::new(Insole::<f32, 64>::new());
        insole.set_up(SETUP, cells.into_iter()).expect("the set-up is accepted");
        let mut random = fastrand::Rng::with_seed(seed);
        let mut codes = [0u16; 64];
        for seq in 0..1_000 {
            // Fifty frames of stance, with random codes in six of seven cells, are followed by fifty frames of swing. The other
            // codes are 0 or, at random and in every thirteenth cell, those of a faulty cell.
            for (i, code) in codes.iter_mut().enumerate() {
                let is_faulty = random.u32(..64) < faulty_cells;
                *code = match seq % 100 < 50 {
                    true if i % 7 > 0 => random.u16(..),
                    _ if is_faulty || i % 13 == 0 => *[0, 30_000, u16::MAX].get(random.usize(..3)).unwrap_or(&0),
                    _ => 0,
                };
            }
            insole.frame(seq, &codes);
            for load in insole.loads() {
                let force = &load.frame.force;
                prop_assert!(force.force_n.is_finite() && force.force_n >= 0.0, "{:?}", force);
                prop_assert!(load.frame.area.area_mm2::<f32>() >= 0.0);
            }
        }
    }
}

//! Walks in shoes that press on the insole even when the foot is lifted; people who do not walk; and walks that the insoles of
//! another vendor recorded.

use crate::common;
use plantar::Region;
use plantar::faults::FaultKind;
use plantar::insole::Insole;
use plantar::pipeline::baseline::MAX_RESIDUAL_KPA;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::SetupCell;
use plantar::pipeline::stance_rule::StanceRule;
use recording::Recording;
use recording::synthetic::{self, SyntheticStanding, SyntheticWalk};
use testkit::wear::{Found, LEVELS_KPA, Residual, compare, find, noisy_walk, with_residual};
use testkit::{LAW, SETUP, cell, code_of};

/// The shoe presses with up to 8 kPa. The walk has the noise of a sensor. Its steps vary differently for each kind of residual
/// pressure.
#[test]
fn steps_are_found_however_hard_the_shoe_presses() {
    let (mut walked, mut found) = (0, 0);
    for contact in [ContactRule::COUNTED, ContactRule::COVERED] {
        for (seed, residual) in (1..).zip(Residual::ALL) {
            let walk = noisy_walk(&SyntheticWalk { steps: 60, variation: 0.1, seed, ..SyntheticWalk::default() });
            for level_kpa in LEVELS_KPA {
                let result = compare(&walk, contact, residual, level_kpa);
                println!("{residual:?} {level_kpa} kPa: {result:?}");
                assert_eq!((result.faults, result.extra), (0, 0), "{residual:?} {level_kpa} kPa");
                assert!(result.force_error < 0.02, "{residual:?} {level_kpa} kPa: {}", result.force_error);
                walked += result.walked;
                found += result.found;
            }
        }
    }
    println!("{found} of {walked} steps found");
    assert!(found as f64 >= 0.995 * walked as f64, "{found} of {walked}");
}

/// The steps, load bouts and faults that an insole with the default rules finds.
fn found(recording: &Recording) -> Found {
    find(recording, ContactRule::COVERED, StanceRule::ADAPTIVE)
}

/// Children and heavy people, slow walkers and runners, at 50, 100 and 400 frames a second, barefoot and in a shoe that presses
/// with 4 kPa.
#[test]
fn the_steps_of_all_wearers_are_found() {
    // Peak force, N, stance time and swing time, s.
    let wearers = [
        // A child of 15 kg, a person of 65 kg and one of 180 kg.
        (160.0, 0.5, 0.35),
        (700.0, 0.65, 0.4),
        (1_950.0, 0.8, 0.45),
        // Two runners, and a very slow walker.
        (1_600.0, 0.20, 0.5),
        (300.0, 0.11, 0.4),
        (650.0, 2.2, 0.9),
    ];
    for (peak_n, stance_s, swing_s) in wearers {
        for rate_hz in [50.0, 100.0, 400.0] {
            let steps = 20;
            let walk = SyntheticWalk { steps, rate_hz, stance_s, swing_s, peak_n, ..SyntheticWalk::default() };
            let walk = noisy_walk(&walk);
            for recording in [walk.clone(), with_residual(walk, Residual::Everywhere, 4.0)] {
                let name = format!("{peak_n} N, {stance_s} s, {rate_hz} Hz");
                let found = found(&recording);
                assert_eq!((found.steps.len(), found.faults.found), (steps, 0), "{name}");
                for step in &found.steps {
                    let measured_s = step.frames as f64 / rate_hz;
                    assert!((measured_s - stance_s).abs() < 0.1 * stance_s + 1.5 / rate_hz, "{name}: {measured_s} s");
                    assert!((step.peak_n - peak_n).abs() < 0.06 * peak_n, "{name}: {} N", step.peak_n);
                }
            }
        }
    }
}

/// A hard spot in the shoe presses with more than the largest baseline: its cells are reported, and steps and other cells are not
/// affected.
#[test]
fn cells_without_a_new_baseline_are_reported_by_region() {
    let walk = noisy_walk(&SyntheticWalk { steps: 12, ..SyntheticWalk::default() });
    let expected_steps = found(&walk).steps.len();
    let mut pressed = walk.clone();
    let spot: Vec<_> = [(Region::Heel, 6), (Region::Metatarsals12, 3)]
        .into_iter()
        .flat_map(|(region, count)| {
            let cells = walk.layout.cells.iter().enumerate().filter(move |(_, cell)| cell.region == region);
            cells.map(|(index, _)| index).take(count)
        })
        .collect();
    // The pressure creeps, as in every shoe: a constant code is that of a stuck cell.
    for (i, frame) in pressed.pressure_kpa.chunks_exact_mut(walk.cells()).enumerate() {
        let creep_kpa = 2.0 * i as f32 / walk.frames() as f32;
        spot.iter().for_each(|&cell| frame[cell] += 2.0 * MAX_RESIDUAL_KPA + creep_kpa);
    }
    let Found { faults, steps, .. } = found(&pressed);
    assert_eq!(faults.with_former_baseline, [6, 0, 0, 3, 0, 0, 0, 0]);
    assert_eq!((faults.found, steps.len()), (0, expected_steps));

    // The reported number is that of the last swing, in which the spot no longer presses.
    let released_at = walk.pressure_kpa.len() / 2;
    pressed.pressure_kpa[released_at..].copy_from_slice(&walk.pressure_kpa[released_at..]);
    assert_eq!(found(&pressed).faults.with_former_baseline, [0; 8]);
}

/// A shoe that is laced tighter, or toes that rest on the insole, press on several cells, more from swing to swing. A single cell
/// that reads more from swing to swing drifts.
#[test]
fn a_pressure_that_grows_on_several_cells_is_no_drift() {
    let walk = noisy_walk(&SyntheticWalk { steps: 14, ..SyntheticWalk::default() });
    let heel = walk.layout.cells.iter().enumerate().filter(|(_, cell)| cell.region == Region::Heel);
    let heel: Vec<_> = heel.map(|(index, cell)| (index, cell.x_mm, cell.y_mm)).collect();
    let (middle, x_mm, y_mm) = heel[heel.len() / 2];
    let distance_mm = |(_, x, y): &(usize, f64, f64)| (x - x_mm).abs().max((y - y_mm).abs());
    let mut adjacent = heel.clone();
    adjacent.sort_by(|a, b| distance_mm(a).total_cmp(&distance_mm(b)));
    let growing = |cells: &[usize]| {
        let mut pressed = walk.clone();
        let kpa_per_frame = 3.0 * MAX_RESIDUAL_KPA / walk.frames() as f32;
        for (i, frame) in pressed.pressure_kpa.chunks_exact_mut(walk.cells()).enumerate() {
            cells.iter().for_each(|&cell| frame[cell] += kpa_per_frame * i as f32);
        }
        found(&pressed).faults
    };
    let faults = growing(&adjacent[..4].iter().map(|(index, ..)| *index).collect::<Vec<_>>());
    assert_eq!((faults.found, faults.with_former_baseline), (0, [4, 0, 0, 0, 0, 0, 0, 0]), "{faults:?}");
    let faults = growing(&[middle]);
    assert_eq!((faults.found, faults.list[0].kind), (1, FaultKind::Drift), "{faults:?}");
}

/// A cell under residual pressure can read a higher code than the cell with the highest pressure above its baseline.
#[test]
fn the_peak_pressure_is_that_above_the_baseline() {
    const RESIDUAL_KPA: f64 = 10.0;
    let cells = (0..64u8).map(|i| {
        let at = cell(Region::Heel, f32::from(i % 8) * 10.0, f32::from(i / 8) * 10.0, 100.0);
        SetupCell { row_column: i, ..at }
    });
    let mut insole = Box::new(Insole::<f64, 64>::new());
    insole.set_up(SETUP, cells).expect("the set-up is accepted");
    let mut codes = [0u16; 64];
    let mut push = |seq: u32, pressures_kpa: [f64; 2]| {
        codes[0] = code_of(&LAW, RESIDUAL_KPA + pressures_kpa[0]);
        codes[1] = code_of(&LAW, pressures_kpa[1]);
        insole.frame(seq, &codes);
        insole.loads()[Region::Heel as usize].frame.peak_kpa
    };
    // The first reading of a lifted foot becomes the baseline.
    for seq in 0..100 {
        push(seq, [0.0, 0.0]);
    }
    // In the last frame, the pressures have fallen so far that only the cell with the lower pressure reads a code near that of
    // the previous peak, because of its residual pressure.
    let rising = [[20.0, 0.0], [20.0, 24.0], [20.0, 30.0], [30.0, 28.0], [30.0, 34.0]];
    for (seq, pressures_kpa) in (100..).zip(rising.into_iter().chain([[8.0, 12.0]])) {
        let (peak_kpa, expected_kpa) = (push(seq, pressures_kpa), pressures_kpa[0].max(pressures_kpa[1]));
        assert!((peak_kpa - expected_kpa).abs() < 0.1, "{peak_kpa} kPa, not {expected_kpa}");
    }
}

/// The pressure of a lifted foot counts with the gain of its cells: a shoe that presses with 12 kPa from the first frame on is
/// recognised, and a constant load of 20 kPa is not.
#[test]
fn a_lifted_foot_is_recognised_by_pressures_and_not_by_codes() {
    for gain in [0.5, 1.0, 2.0] {
        let cells = (0..64u8).map(|i| {
            let at = cell(Region::Heel, f32::from(i % 8) * 10.0, f32::from(i / 8) * 10.0, 100.0);
            SetupCell { row_column: i, offset: 0, gain, ..at }
        });
        let mut insole = Box::new(Insole::<f64, 64>::new());
        let mut steps_with = |shoe_kpa: f64| {
            insole.set_up(SETUP, cells.clone()).expect("the set-up is accepted");
            let stances = (0..6).flat_map(|_| [(60, 100.0), (40, 0.0)]);
            let phases = [(40, 0.0)].into_iter().chain(stances);
            let frames = phases.flat_map(|(frames, load_kpa)| (0..frames).map(move |_| load_kpa));
            let codes = frames.map(|load_kpa| code_of(&LAW, (shoe_kpa + load_kpa) / f64::from(gain)));
            (0..).zip(codes).filter(|&(seq, code)| insole.frame(seq, &[code; 64])).count()
        };
        // The shoe presses with 77 N, which is more than the force of toe off.
        assert_eq!(steps_with(12.0), 6, "gain {gain}");
        assert_eq!(steps_with(20.0), 0, "gain {gain}");
    }
}

/// The zero follows the sensor downwards, as in the cold, but not a single disturbed reading, because it never rises again.
#[test]
fn two_successive_swings_lower_the_zero() {
    const ZERO: u16 = 3_000;
    const LOAD_KPA: f64 = 100.0;
    const CELLS: u8 = 64;
    /// Number of frames of a stance, and of a swing.
    const FRAMES: u32 = 60;
    let load = code_of(&LAW, LOAD_KPA);
    // `below` has one number for each swing: by how many codes the cells then read less than the calibrated zero. The result is
    // the number of codes below the calibrated zero from which the pressure under load is measured.
    let lowered = |below: &[u16]| {
        let cells = (0..CELLS).map(|i| {
            let at = cell(Region::Heel, f32::from(i % 8) * 10.0, f32::from(i / 8) * 10.0, 100.0);
            SetupCell { row_column: i, offset: ZERO, gain: 1.0, ..at }
        });
        let mut insole = Box::new(Insole::<f64, 64>::new());
        insole.set_up(SETUP, cells).expect("the set-up is accepted");
        let phases = below.iter().flat_map(|below| [ZERO - below, ZERO + load]);
        let frames = phases.flat_map(|code| (0..FRAMES).map(move |_| code));
        (0..).zip(frames).for_each(|(seq, code)| {
            insole.frame(seq, &[code; CELLS as usize]);
        });
        i32::from(code_of(&LAW, insole.loads()[Region::Heel as usize].frame.peak_kpa)) - i32::from(load)
    };
    for (below, expected) in [
        (&[0, 0, 400, 0, 0][..], 0),
        (&[0, 0, 400, 0, 400, 0], 0),
        (&[0, 0, 400, 300, 0], 300),
        (&[0, 0, 400, 400, 400, 0], 400),
        // A shift that the baseline can follow is no fault of the cells.
        (&[0, 0, 1_500, 1_500, 1_500, 0], 1_500),
        // The first reading after the start lowers the zero at once, without a second one that confirms it.
        (&[400, 0], 400),
    ] {
        let measured = lowered(below);
        assert!((measured - expected).abs() <= 2, "{below:?}: {measured} codes");
    }
}

/// The foot is lifted, stands, and is lifted again; or it stands from the first frame on.
#[test]
fn a_standing_foot_never_becomes_the_baseline() {
    for standing_n in [150.0, 350.0, 900.0] {
        for (lifted_s, sway) in [(2.0, 0.0), (0.0, 0.0), (2.0, 0.03)] {
            let trial = SyntheticStanding {
                standing_n,
                sway,
                stand_s: 20.0,
                lifted_s: [lifted_s, 2.0],
                transition_s: 0.3,
                ..SyntheticStanding::default()
            };
            let recording = synthetic::standing(&trial);
            let (totals_n, middle) = (found(&recording).totals_n, recording.frames() / 2);
            let error = (totals_n[middle] - recording.force_n(middle)).abs() / standing_n;
            assert!(error < 0.01, "{standing_n} N, lifted for {lifted_s} s: {} N", totals_n[middle]);
        }
    }
}

/// A recording of a foot that carries this force for this time.
fn standing(standing_n: f64, stand_s: f64) -> Recording {
    let trial = SyntheticStanding {
        standing_n,
        stand_s,
        lifted_s: [0.0; 2],
        transition_s: 0.2,
        sway: 0.0,
        ..Default::default()
    };
    synthetic::standing(&trial)
}

/// Checks that the insole measures the 350 N of a foot that stands at the end of a recording. The recording begins with the
/// lifted foot, and then has these parts.
fn assert_measures_standing_after(parts: &[&Recording]) {
    let (mut recording, upright) = (standing(1e-6, 1.0), standing(350.0, 3.0));
    for part in parts.iter().chain(&[&upright]) {
        recording.pressure_kpa.extend_from_slice(&part.pressure_kpa);
    }
    let frames = recording.pressure_kpa.len() / recording.cells();
    recording.t_s = (0..frames).map(|i| i as f64 / recording.rate_hz).collect();
    let totals_n = found(&recording).totals_n;
    let last = frames - upright.frames() / 2;
    assert!((totals_n[last] - 350.0).abs() < 3.5, "{} N", totals_n[last]);
}

/// A person sits down and stands up with the feet on the ground. The load of the seated foot is the weight of the lower leg, and
/// is as constant as the pressure of a shoe.
#[test]
fn a_seated_foot_does_not_become_the_baseline() {
    let (lifted, upright, seated) = (standing(1e-6, 1.0), standing(350.0, 3.0), standing(30.0, 4.0));
    assert_measures_standing_after(&[&upright, &lifted, &seated, &upright, &seated, &upright, &seated]);
}

/// A seated person lifts a foot and puts it down again, with more than the force of a heel strike.
#[test]
fn a_seated_foot_that_moves_does_not_become_the_baseline() {
    let (lifted, upright, seated) = (standing(1e-6, 1.0), standing(350.0, 3.0), standing(45.0, 2.0));
    assert_measures_standing_after(&[&upright, &lifted, &seated, &lifted, &seated, &lifted, &seated]);
}

/// The vendor's reports have 42 steps of three walks, slow to fast, in shoes.
#[test]
#[ignore = "needs Python, and the source archive of moticon-opengo: cargo xtask test"]
fn steps_agree_with_those_of_another_vendor() {
    let agreement = testkit::moticon::compare(&common::python(), &common::moticon());
    println!("{agreement:?}");
    assert_eq!((agreement.steps, agreement.found), (42, 42));
    assert!(agreement.contact_ms <= 10.0 && agreement.toe_off_ms <= 15.0 && agreement.peak_n <= 1.0, "{agreement:?}");
    assert!(agreement.stride_ms <= 15.0 && agreement.step_ms <= 15.0, "{agreement:?}");
    assert!(agreement.double_support_ms <= 15.0 && agreement.both_phases_ms <= 35.0, "{agreement:?}");
    // Stride times, step times, first phases of double support, and double supports of strides.
    assert_eq!(agreement.compared, [32, 36, 33, 33]);
}

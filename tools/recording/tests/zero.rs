//! The zero of each cell is measured in a standing trial. An insole with these zeros measures the same as one without offsets.

use plantar::insole::Insole;
use plantar::pipeline::calibrate::{FULL_CODE, zero_offset};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use recording::synthetic::{self, SyntheticStanding, SyntheticWalk};
use recording::{
    FootZero, Format, FrameSource, MAX_CELLS, Options, Recording, RecordingReader, StandingTrial, VirtualInsole, Zero,
};
use std::path::Path;

/// The code of a pressure by the law of the virtual sensor at its default full scale, implemented independently.
fn code(kpa: f32) -> f64 {
    f64::from(FULL_CODE) * (f64::from(kpa) / 1000.0).powf(0.8)
}

/// Offsets of up to 20 kPa, which are all different.
fn offsets_kpa(cells: usize) -> Vec<f32> {
    (0..cells).map(|i| 20.0 * ((i * 37) % cells) as f32 / cells as f32).collect()
}

/// A standing trial with offsets and some noise.
fn trial(parameters: &SyntheticStanding) -> Recording {
    let mut recording = synthetic::standing(parameters);
    let offset_kpa = offsets_kpa(parameters.cells);
    synthetic::add_sensor_errors(&mut recording, &offset_kpa, 8.0, 7);
    recording
}

fn virtual_insole(recording: &Recording) -> VirtualInsole {
    VirtualInsole::new(recording, ContactRule::COUNTED, StanceRule::ADAPTIVE)
}

fn measured(recording: &Recording) -> (StandingTrial, FootZero) {
    let found = StandingTrial::find(recording, "trial").expect("a standing trial");
    let zero = FootZero::measure(recording, &found, "trial").expect("a zero");
    (found, zero)
}

/// The frames between two times, s.
fn cut(recording: &Recording, s: std::ops::Range<f64>) -> Recording {
    let frames = (s.start * recording.rate_hz) as usize..((s.end * recording.rate_hz) as usize).min(recording.frames());
    let cells = recording.cells();
    Recording {
        t_s: recording.t_s[frames.clone()].to_vec(),
        pressure_kpa: recording.pressure_kpa[frames.start * cells..frames.end * cells].to_vec(),
        ..recording.clone()
    }
}

#[test]
fn the_parts_of_a_proper_trial_are_found_at_any_rate_and_duration() {
    for rate_hz in [50.0, 100.0, 400.0] {
        for (lifted_s, stand_s) in [([5.0, 5.0], 10.0), ([8.0, 8.0], 14.0), ([2.5, 12.0], 6.5)] {
            // Strong sway at the beginning or end of standing resembles standing up, so the boundary is less accurate. The
            // error is at most the guard time.
            for (sway, tolerance_s) in [(0.0, 0.2), (0.05, 0.2), (0.1, 0.5)] {
                let parameters =
                    SyntheticStanding { cells: 60, rate_hz, lifted_s, stand_s, sway, ..Default::default() };
                let recording = trial(&parameters);
                let (found, _) = measured(&recording);
                let stands = lifted_s[0] + parameters.transition_s..lifted_s[0] + parameters.transition_s + stand_s;
                let sits = stands.end + parameters.transition_s..stands.end + parameters.transition_s + lifted_s[1];
                // The parts that are found exclude a guard time of half a second at both ends.
                let [before, after] = &found.lifted;
                for (frames, truth_s) in [(before, 0.0..lifted_s[0]), (&found.standing, stands), (after, sits)] {
                    let start_s = frames.start as f64 / rate_hz - 0.5;
                    let end_s = frames.end as f64 / rate_hz + 0.5;
                    let is_close =
                        (start_s - truth_s.start).abs() <= tolerance_s && (end_s - truth_s.end).abs() <= tolerance_s;
                    assert!(is_close, "{rate_hz} Hz, sway {sway}: {start_s} to {end_s} s, not {truth_s:?}");
                }
            }
        }
    }
}

/// The codes are rounded to integers and their mean is rounded up, so the offset is -0.5 to +1 codes from the true one. With
/// noise, four standard errors of the mean are added to the tolerance.
#[test]
fn offsets_are_recovered_to_one_code_despite_noise() {
    let parameters = SyntheticStanding::default();
    for noise_codes in [0.0, 2.0, 8.0] {
        let mut recording = synthetic::standing(&parameters);
        synthetic::add_sensor_errors(&mut recording, &offsets_kpa(parameters.cells), noise_codes, 7);
        let (found, zero) = measured(&recording);
        let mut insole = virtual_insole(&recording);
        zero.apply_to(&mut insole, "zero").expect("this insole's zero");
        let frames = found.lifted[0].len() + found.lifted[1].len();
        let error = 4.0 * noise_codes / (3.0 * frames as f64).sqrt();
        // The order of the insole: by region, and within a region as recorded.
        let mut truth: Vec<_> =
            recording.layout.cells.iter().map(|c| c.region).zip(offsets_kpa(parameters.cells)).collect();
        truth.sort_by_key(|&(region, _)| region);
        for (cell, (region, kpa)) in insole.cells.iter().zip(truth) {
            assert_eq!(cell.region, region);
            let above = f64::from(cell.offset) - code(kpa);
            // Codes are not negative, so noise about an offset of 0 raises the mean.
            let most = if kpa > 0.0 { 1.0 + error } else { 1.0 + 0.5 * noise_codes };
            assert!(
                (-0.52 - error..=most + 0.02).contains(&above),
                "{kpa} kPa, noise {noise_codes}: {above} codes above"
            );
        }
    }
}

/// Without noise, the offset from the file is the code of the unloaded cell if the full scale is the same as in the trial. With
/// another full scale, it differs by at most one code.
#[test]
fn a_zero_is_exact_at_its_own_full_scale_and_accurate_to_one_code_at_others() {
    let parameters = SyntheticStanding { sway: 0.0, ..Default::default() };
    let mut recording = synthetic::standing(&parameters);
    synthetic::add_sensor_errors(&mut recording, &offsets_kpa(parameters.cells), 0.0, 1);
    let (_, zero) = measured(&recording);
    let text = Zero { right: Some(zero), left: None }.to_toml();
    let zero = Zero::parse(&text, Path::new("zero.toml")).expect("its own file");
    assert_eq!(zero.to_toml(), text);
    for largest_kpa in [0.0, 1000.0, 7000.0] {
        let mut walk = cut(&recording, 0.0..0.1);
        walk.pressure_kpa[parameters.cells] = largest_kpa;
        let mut insole = virtual_insole(&walk);
        zero.apply_to(&mut insole, "zero.toml").expect("this insole's zero");
        let mut unloaded = vec![0; insole.cells.len()];
        insole.codes(walk.frame(0), &mut unloaded);
        for (cell, &code) in insole.cells.iter().zip(&unloaded) {
            // The zero was measured in whole codes at a full scale of 1000 kPa. At a larger full scale, the same pressure need
            // not be a whole number of codes.
            assert!(cell.offset.abs_diff(code) <= u16::from(largest_kpa > 0.0));
            assert_eq!(zero_offset([code]), Some(code));
        }
    }
}

#[test]
fn the_mean_force_while_standing_is_the_applied_one() {
    let parameters = SyntheticStanding { standing_n: 412.0, ..Default::default() };
    let recording = trial(&parameters);
    let (found, zero) = measured(&recording);
    let mut insole = virtual_insole(&recording);
    zero.apply_to(&mut insole, "zero").expect("this insole's zero");
    let frames = found.standing.len() as f64;
    let measured_n = |i| recording.layout.force_n(&insole.measured_kpa(recording.frame(i)));
    let mean_n = found.standing.clone().map(measured_n).sum::<f64>() / frames;
    // A sway of 3 % over slightly more than three periods averages to 0.3 %.
    assert!((mean_n - 412.0).abs() < 0.01 * 412.0, "{mean_n} N");
    for i in found.lifted.iter().cloned().flatten() {
        assert!(measured_n(i) < 1.0, "{} N on the lifted foot", measured_n(i));
    }
}

/// The systems of other vendors state pressures. The pressure of a shoe adds to that of the foot, not to the code of the virtual
/// sensor.
#[test]
fn the_zero_of_an_import_is_subtracted_from_its_pressures() {
    let import = |mut recording: Recording, offsets_kpa: &[f32]| {
        recording.layout.name = "pressure insole".into();
        let cells = recording.cells();
        for frame in recording.pressure_kpa.chunks_exact_mut(cells) {
            frame.iter_mut().zip(offsets_kpa).for_each(|(kpa, offset)| *kpa += offset);
        }
        recording
    };
    let offsets_kpa = offsets_kpa(240);
    let walk = synthetic::walk(&SyntheticWalk::default()).recording;
    let recorded = import(walk.clone(), &offsets_kpa);
    let (_, zero) = measured(&import(synthetic::standing(&SyntheticStanding::default()), &offsets_kpa));
    let mut insole = virtual_insole(&recorded);
    zero.apply_to(&mut insole, "zero").expect("this insole's zero");
    assert!(insole.cells.iter().all(|cell| cell.offset == 0));
    for i in 0..walk.frames() {
        for (true_kpa, kpa) in walk.frame(i).iter().zip(insole.measured_kpa(recorded.frame(i))) {
            // A code is 0.01 kPa, and the zero is rounded up by at most one. The insole's table of the law is coarse near zero.
            let tolerance_kpa = if *true_kpa < 5.0 { 0.1 } else { 0.03 };
            assert!((kpa - true_kpa).abs() < tolerance_kpa, "frame {i}: {kpa} kPa, not {true_kpa}");
        }
    }
    // The cells of a file are decoded one after the other.
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("walk.parquet");
    recorded.write(&path).expect("written");
    let reader = RecordingReader::open(&path).expect("a recording");
    let mut scans = insole.scans(FrameSource::from(reader));
    let mut codes = vec![0; 240];
    while let Some(scan) = scans.next_scan().expect("the file") {
        insole.codes_of(&recorded, scan.index, &mut codes);
        assert_eq!(scan.codes, codes);
    }
}

/// Replays a recording. Returns the area, mm2, and the force, N, of each region in each frame; and the number of steps.
fn replay(recording: &Recording, insole: &VirtualInsole) -> (Vec<[(f64, f64); 8]>, usize) {
    let mut device = Box::new(Insole::<f64, MAX_CELLS>::new());
    device.set_up(insole.setup, insole.cells.iter().copied()).expect("a set-up");
    let mut codes = vec![0; insole.cells.len()];
    let mut steps = 0;
    let frames = (0..insole.frames(recording)).map(|i| {
        insole.codes_of(recording, i, &mut codes);
        steps += usize::from(device.frame(i as u32, &codes));
        device.loads().each_ref().map(|load| (load.frame.area.area_mm2(), load.frame.force.force_n))
    });
    (frames.collect(), steps)
}

#[test]
fn a_walk_with_offsets_and_its_zero_equals_a_walk_without_offsets() {
    let ideal = synthetic::walk(&SyntheticWalk::default()).recording;
    let mut recorded = ideal.clone();
    synthetic::add_sensor_errors(&mut recorded, &offsets_kpa(240), 0.0, 1);
    let (_, zero) = measured(&trial(&SyntheticStanding::default()));
    let mut insole = virtual_insole(&recorded);
    let without_zero = insole.clone();
    Zero { right: Some(zero), left: None }.apply_to(&mut insole, "zero").expect("this insole's zero");
    let (expected, steps) = replay(&ideal, &virtual_insole(&ideal));
    let (found, found_steps) = replay(&recorded, &insole);
    assert_eq!((steps, found_steps), (10, 10));
    let cell_mm2 = ideal.layout.cells[0].area_mm2;
    let mut different_areas = 0;
    for (expected, found) in expected.iter().flatten().zip(found.iter().flatten()) {
        // The offsets are accurate to two codes. A code is about 0.01 kPa at 10 to 200 kPa, or 1 mN on a cell.
        assert!((expected.1 - found.1).abs() <= 0.05, "{} N, not {}", found.1, expected.1);
        // A cell within two codes of the contact threshold may be in contact in only one of the two walks. This may concern two
        // cells at once, because the ellipses of the computed walk are symmetric.
        assert!((expected.0 - found.0).abs() <= 2.001 * cell_mm2, "{} mm2, not {}", found.0, expected.0);
        different_areas += usize::from((expected.0 - found.0).abs() > 1.0);
    }
    assert!(different_areas * 1000 < expected.len() * 8, "{different_areas} areas differ");
    // Without the zero the forces differ.
    let (raw, _) = replay(&recorded, &without_zero);
    assert!(raw[0].iter().map(|r| r.1).sum::<f64>() > 150.0);
}

#[test]
fn recordings_that_are_not_standing_trials_are_rejected_with_the_reason() {
    let trial_of = |lifted_s, stand_s| trial(&SyntheticStanding { cells: 60, lifted_s, stand_s, ..Default::default() });
    let good = trial_of([5.0, 5.0], 10.0);
    let (stand, sit) = (cut(&good, 6.0..16.0), cut(&good, 0.0..5.0));
    let joined = |parts: &[&Recording]| {
        let pressure_kpa: Vec<f32> = parts.iter().flat_map(|part| part.pressure_kpa.iter().copied()).collect();
        let t_s = (0..pressure_kpa.len() / 60).map(|i| i as f64 * 0.01).collect();
        Recording { t_s, pressure_kpa, ..good.clone() }
    };
    assert!(StandingTrial::find(&joined(&[&sit, &stand, &sit]), "trial").is_ok());
    let mut walk = synthetic::walk(&SyntheticWalk { cells: 60, steps: 20, ..Default::default() }).recording;
    synthetic::add_sensor_errors(&mut walk, &offsets_kpa(60), 8.0, 7);
    for (recording, reason) in [
        (stand.clone(), "cannot be distinguished"),
        (joined(&[&sit, &sit]), "cannot be distinguished"),
        (walk.clone(), "standing still lasts 0."),
        (joined(&[&sit, &walk, &sit]), "standing still lasts 0."),
        (trial_of([5.0, 5.0], 4.0), "standing still lasts 3."),
        (joined(&[&sit, &stand]), "no lifted foot after standing, which lasts from 5.0 s to 15.0 s"),
        (joined(&[&stand, &sit]), "no lifted foot before standing"),
        (joined(&[&stand, &sit, &stand]), "no lifted foot before standing"),
        (trial_of([2.3, 2.3], 10.0), "lifted for 2."),
        (trial_of([1.0, 6.0], 10.0), "no lifted foot before"),
        (cut(&good, 0.0..3.0), "3.0 s are too short"),
    ] {
        let error = StandingTrial::find(&recording, "trial.parquet").expect_err(reason).to_string();
        assert!(error.starts_with("trial.parquet: ") && error.contains(reason), "{reason}: {error}");
        assert!(error.contains("sit and lift both feet"), "{error}");
    }
}

/// People may rest their feet on the floor before they lift them and before they stand up.
#[test]
fn feet_that_rest_on_the_floor_do_not_count_as_lifted() {
    let mut recording = synthetic::standing(&SyntheticStanding { lifted_s: [12.0, 12.0], ..Default::default() });
    let standing = recording.frame(1800).to_vec();
    for i in (0..300).chain(800..1200).chain(2400..2700) {
        let frame = &mut recording.pressure_kpa[i * 240..(i + 1) * 240];
        frame.iter_mut().zip(&standing).for_each(|(kpa, standing)| *kpa = kpa.max(0.2 * standing));
    }
    synthetic::add_sensor_errors(&mut recording, &offsets_kpa(240), 8.0, 7);
    let (found, _) = measured(&recording);
    let seconds = |part: &std::ops::Range<usize>| (part.start as f64 * 0.01, part.end as f64 * 0.01);
    let is_close =
        |found: (f64, f64), truth: (f64, f64)| (found.0 - truth.0).abs() < 0.2 && (found.1 - truth.1).abs() < 0.2;
    assert!(is_close(seconds(&found.lifted[0]), (3.5, 7.5)), "{found:?}");
    assert!(is_close(seconds(&found.lifted[1]), (27.5, 35.5)), "{found:?}");
}

#[test]
fn a_zero_of_other_cells_or_above_half_of_the_scale_is_rejected() {
    let recording = synthetic::standing(&SyntheticStanding::default());
    let (_, zero) = measured(&recording);
    let refused = |zero: &FootZero, words: &[&str]| {
        let error = zero.apply_to(&mut virtual_insole(&recording), "zero.toml").expect_err("refused").to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{words:?}: {error}");
    };
    refused(&FootZero { layout_id: 1, ..zero.clone() }, &["zero.toml", "other cells", "--cells"]);
    refused(&FootZero { offset_kpa: vec![1.0; 239], ..zero.clone() }, &["239 offsets", "240"]);
    for kpa in [421.0, 999.0, 1e9] {
        let mut high = zero.clone();
        high.offset_kpa[17] = kpa;
        refused(&high, &["x ", "half of its scale"]);
    }
    let only_left = Zero { left: Some(zero), right: None };
    let error = only_left.apply_to(&mut virtual_insole(&recording), "zero.toml").expect_err("refused").to_string();
    assert!(error.contains("no zero of the right foot, only of the left"), "{error}");

    let mut broken = recording.clone();
    let mut offset_kpa = offsets_kpa(240);
    offset_kpa[100] = 500.0;
    synthetic::add_sensor_errors(&mut broken, &offset_kpa, 0.0, 1);
    let found = StandingTrial::find(&broken, "trial").expect("a standing trial");
    let error = FootZero::measure(&broken, &found, "trial").expect_err("refused").to_string();
    assert!(error.contains("500 kPa unloaded"), "{error}");
}

/// A system that reads small pressures as 0: other cells are never loaded in the trial than in the walk.
#[test]
fn cells_that_differ_because_of_a_merge_are_rejected_with_the_remedy() {
    let clipped = |unloaded: usize| {
        let mut recording = synthetic::standing(&SyntheticStanding { cells: 300, ..Default::default() });
        recording.pressure_kpa.iter_mut().skip(unloaded).step_by(300).for_each(|kpa| *kpa = 0.0);
        recording.binned(256).expect("256 cells")
    };
    let (_, zero) = measured(&clipped(0));
    let error = zero.apply_to(&mut virtual_insole(&clipped(150)), "zero.toml").expect_err("refused").to_string();
    assert!(error.contains("other cells") && error.contains("without --cells"), "{error}");
}

/// The pressures are the same in both recordings, but the total forces, to which the import fits the areas, are not.
#[test]
fn the_zero_of_a_moticon_recording_does_not_apply_to_another_one() {
    let measurement = |newtons_per_n_cm2: usize| {
        let mut text = "# time".to_owned();
        (1..=16).for_each(|cell| text += &format!("\tleft pressure {cell}[N/cm²]"));
        text += "\tleft total force[N]\n";
        for frame in 0..50 {
            let loaded = if frame < 25 { 10 } else { 0 };
            text += &format!("0.{frame:02}{}\t{}\n", format!("\t{loaded}").repeat(16), loaded * 16 * newtons_per_n_cm2);
        }
        Format::Moticon
            .parse(text.as_bytes(), Path::new("walk.txt"), Options::default())
            .expect("a recording")
            .feet
            .remove(0)
    };
    let [standing, walk] = [12, 13].map(measurement);
    let id = virtual_insole(&standing).setup.layout_id;
    let zero = FootZero { layout_id: id, offset_kpa: vec![0.0; 16] };
    zero.apply_to(&mut virtual_insole(&standing), "zero.toml").expect("the same recording");
    let error = zero.apply_to(&mut virtual_insole(&walk), "zero.toml").expect_err("refused").to_string();
    for words in ["other cells", "Moticon", "F-Scan", "standing trial with --like", "measure the zero again"] {
        assert!(error.contains(words), "`{words}` is not in: {error}");
    }
}

#[test]
fn the_error_for_a_malformed_file_names_the_line() {
    let zero = FootZero { layout_id: 7, offset_kpa: vec![0.25; 20] };
    let good = Zero { left: Some(zero), right: None }.to_toml();
    let line = |text: &str| good.lines().position(|line| line.contains(text)).expect(text) + 1;
    let id = "layout_id = 7";
    for (from, to, at, words) in [
        ("version = 1", "version = 2", None, "version 2"),
        // A newer version may have further fields.
        ("version = 1", "version = 2\ncreated = 1_700_000_000", None, "update plantar"),
        (id, "layout_id = seven", Some(line(id)), ""),
        (id, "layout = 7", Some(line(id)), "layout"),
        ("[left]", "[both]", Some(line("[left]")), "both"),
        ("    0.25, ", "    -0.25, ", Some(line("    0.25")), "-0.25 kPa"),
        ("    0.25, ", "    nan, ", Some(line("    0.25")), "NaN kPa"),
        ("    0.25, ", "    0,25 ", Some(line("    0.25")), ""),
    ] {
        let error = Zero::parse(&good.replacen(from, to, 1), Path::new("zero.toml")).expect_err(to).to_string();
        let place = at.map_or("zero.toml: ".into(), |line| format!("zero.toml:{line}: "));
        assert!(error.starts_with(&place) && error.contains(words), "{to}: {error}");
    }
    let error = Zero::parse("version = 1", Path::new("zero.toml")).expect_err("empty").to_string();
    assert!(error.contains("neither [left] nor [right]"), "{error}");
}

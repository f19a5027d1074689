//! The import of the data set SpeedPP2DS from the package jiku-data.

use plantar::Region;
use recording::{Recording, jiku};
use std::path::PathBuf;

/// The folder of the installed data set.
///
/// # Panics
/// Panics if the environment variable `PLANTAR_JIKU`, which contains its path, is not set.
fn folder() -> PathBuf {
    std::env::var_os("PLANTAR_JIKU").expect("PLANTAR_JIKU names the folder SpeedPP2DS of jiku-data").into()
}

fn import(folder: &PathBuf, walker: usize, trials: impl IntoIterator<Item = usize>) -> Recording {
    jiku::import(folder, walker, trials, &mut |_, _| {}).unwrap()
}

/// The peak force of each step, N. At least 50 frames without load, a tenth of a second, separate two steps.
fn step_peaks_n(recording: &Recording) -> Vec<f64> {
    let mut peaks_n = Vec::new();
    let mut unloaded = usize::MAX;
    for i in 0..recording.frames() {
        let force_n = recording.force_n(i);
        if force_n == 0.0 {
            unloaded = unloaded.saturating_add(1);
            continue;
        }
        match peaks_n.last_mut() {
            Some(peak_n) if unloaded < 50 => *peak_n = f64::max(*peak_n, force_n),
            _ => peaks_n.push(force_n),
        }
        unloaded = 0;
    }
    peaks_n
}

#[test]
#[ignore = "needs the data set SpeedPP2DS: cargo xtask test"]
fn peak_forces_are_plausible_for_the_mass_of_a_person() {
    let folder = folder();
    for walker in [0, 2, 9] {
        let walk = import(&folder, walker, [0, 20, 40]);
        let peaks_n = step_peaks_n(&walk);
        assert_eq!(peaks_n.len(), 3, "walker {walker}");
        for peak_n in peaks_n {
            assert!((600.0..1100.0).contains(&peak_n), "walker {walker}: {peak_n} N");
        }
    }
}

#[test]
#[ignore = "needs the data set SpeedPP2DS: cargo xtask test"]
fn a_walk_has_the_documented_layout_and_provenance() {
    let folder = folder();
    let walk = import(&folder, 0, [3, 1]);
    assert_eq!(walk.rate_hz, 500.0);
    for part in ["subj000.h5", "2 separate barefoot steps", "trials 3, 1", "0.4 s"] {
        assert!(walk.source.contains(part), "{}", walk.source);
    }
    // Frames of swing before and after each step: 0.4 s at 500 Hz.
    let swing = 200;
    let (first, last) = (walk.force_n(swing), walk.force_n(walk.frames() - swing - 1));
    assert!(first > 0.0 && last > 0.0);
    assert!((0..swing).all(|i| walk.force_n(i) == 0.0));
    for cell in &walk.layout.cells {
        assert!((cell.area_mm2 - 7.62 * 5.08).abs() < 1e-9);
        assert!((0.0..140.0).contains(&cell.x_mm) && (0.0..310.0).contains(&cell.y_mm));
    }
    // The heel is loaded first, the toes are loaded last.
    let region_of_largest_pressure = |i: usize| {
        let frame = walk.frame(i);
        let cell = (0..walk.cells()).max_by(|&a, &b| frame[a].total_cmp(&frame[b]));
        walk.layout.cells[cell.unwrap()].region
    };
    assert_eq!(region_of_largest_pressure(swing + 5), Region::Heel);
    assert!(region_of_largest_pressure(walk.frames() - swing - 10) >= Region::Hallux);
}

#[test]
#[ignore = "needs the data set SpeedPP2DS: cargo xtask test"]
fn ten_aligned_steps_load_less_than_one_and_a_half_times_the_cells_of_one() {
    let folder = folder();
    // If the steps were not shifted onto each other, ten steps together would load far more cells than one step.
    let one_step = import(&folder, 1, [0]).cells();
    let ten_steps = import(&folder, 1, 0..10).cells();
    assert!(ten_steps < one_step * 3 / 2, "{one_step} {ten_steps}");
}

fn refused(folder: &PathBuf, walker: usize, trials: &[usize]) -> String {
    jiku::import(folder, walker, trials.iter().copied(), &mut |_, _| {}).unwrap_err().to_string()
}

#[test]
fn errors_name_the_missing_walker_or_file() {
    let nowhere = PathBuf::from("no-such-folder");
    assert!(refused(&nowhere, 10, &[0]).contains("a walker from 0 to 9"));
    let error = refused(&nowhere, 3, &[0]);
    assert!(error.contains("no-such-folder") && error.contains("no file subj003.h5"));
}

#[test]
#[ignore = "needs the data set SpeedPP2DS: cargo xtask test"]
fn errors_name_the_missing_trials() {
    assert!(refused(&folder(), 0, &[60]).contains("trials from 0 to 59"));
    assert!(refused(&folder(), 0, &[]).contains("no trials to import"));
}

#[test]
fn a_file_that_is_not_hdf5_is_rejected() {
    let folder = tempfile::TempDir::new().unwrap();
    std::fs::write(folder.path().join("subj000.h5"), "no data").unwrap();
    let error = jiku::import(folder.path(), 0, [0], &mut |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("subj000.h5: not a readable HDF5 file"), "{error}");
}

/// A file that contains a computed trial twice.
const COMPUTED: &[u8] = include_bytes!("../../../fuzz/corpus/jiku/contiguous");

#[test]
fn a_computed_trial_is_read() {
    let walk = jiku::parse(COMPUTED, &[0, 1]).unwrap();
    assert_eq!(step_peaks_n(&walk).len(), 2);
}

/// The computed trials. The dimensions in the damaged header of the first one claim more values than a trial can have.
fn with_a_trial_of_impossible_size() -> Vec<u8> {
    let mut bytes = COMPUTED.to_vec();
    let dimensions = [6u64, 2, 8].map(u64::to_le_bytes).concat();
    let at = bytes.windows(dimensions.len()).position(|window| window == dimensions).unwrap();
    bytes[at + 5] = 1;
    bytes
}

/// The computed trials. The stored rows of a trial are interpolated from the rows of the plate. A value in the second row of the
/// second trial is too large for such an interpolation, so the import assumes that this trial was not resampled.
fn with_a_trial_that_was_not_resampled() -> Vec<u8> {
    let mut bytes = COMPUTED.to_vec();
    let units = [57u16, 95, 95, 57].map(u16::to_le_bytes).concat();
    let at = bytes.windows(units.len()).rposition(|window| window == units).unwrap();
    bytes[at..at + 2].copy_from_slice(&5000u16.to_le_bytes());
    bytes
}

/// The computed trials with 120 times their pressures. Each trial has 6 x 2 x 8 values, and both are at the end of the file.
fn with_impossible_pressures() -> Vec<u8> {
    let mut bytes = COMPUTED.to_vec();
    let data = bytes.len() - 2 * (6 * 2 * 8) * size_of::<u16>();
    for units in bytes[data..].as_chunks_mut::<2>().0 {
        *units = (120 * u16::from_le_bytes(*units)).to_le_bytes();
    }
    bytes
}

/// The largest pressure of the first loaded frame is 44 MPa, that of the second one is 71 MPa.
#[test]
fn impossible_pressures_are_refused_with_the_name_of_the_file() {
    let error = jiku::parse(&with_impossible_pressures(), &[0, 1]).unwrap_err().to_string();
    assert!(error.starts_with("subj000.h5, at 0.402 s of the recording, cell "), "{error}");
    assert!(error.contains("0 to 50000 kPa"), "{error}");
}

#[test]
fn a_trial_that_was_not_resampled_is_left_out_with_the_reason() {
    let walk = jiku::parse(&with_a_trial_that_was_not_resampled(), &[0, 1]).unwrap();
    assert_eq!(step_peaks_n(&walk).len(), 1);
    for part in ["(trials 0)", "left out: 1 (not resampled", "units)"] {
        assert!(walk.source.contains(part), "{}", walk.source);
    }
}

#[test]
fn a_trial_that_is_missing_or_damaged_is_refused_with_a_remedy() {
    for (bytes, trials, parts) in [
        (with_a_trial_of_impossible_size(), [0, 1], ["trial 0 is", "values, a trial has at most", "install"]),
        // The file has only two trials.
        (COMPUTED.to_vec(), [1, 2], ["trial 2 is", "img002", "`--trials 2`"]),
    ] {
        let error = jiku::parse(&bytes, &trials).unwrap_err().to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{error}");
        // An import of no trials is not a remedy.
        assert!(!error.contains("`--trials 0`"), "{error}");
    }
}

#[test]
fn a_request_without_a_usable_trial_is_refused_with_the_reason() {
    let error = jiku::parse(&with_a_trial_that_was_not_resampled(), &[1]).unwrap_err().to_string();
    for part in ["no usable step", "1 (not resampled from 7.62 mm rows", "another walker"] {
        assert!(error.contains(part), "{error}");
    }
    let error = jiku::parse(COMPUTED, &[]).unwrap_err().to_string();
    assert!(error.contains("no trials to import") && error.contains("at least one"), "{error}");
}

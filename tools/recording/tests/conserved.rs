//! Binning conserves the force on each region; resampling conserves the force-time integral.

use plantar::{Region, Side};
use recording::synthetic::{self, SyntheticWalk};
use recording::{Cell, Layout, Recording};

fn region_force_n(recording: &Recording, frame: usize, region: Region) -> f64 {
    recording
        .layout
        .cells
        .iter()
        .zip(recording.frame(frame))
        .filter(|(cell, _)| cell.region == region)
        .map(|(cell, &kpa)| cell.area_mm2 * f64::from(kpa) * 1e-3)
        .sum()
}

fn two_cells(t_s: Vec<f64>, rate_hz: f64, pressure_kpa: Vec<f32>) -> Recording {
    let cell = |x_mm, area_mm2| Cell { x_mm, y_mm: 10.0, area_mm2, region: Region::Heel };
    Recording {
        side: Side::Left,
        layout: Layout { name: "two cells".into(), cells: vec![cell(5.0, 100.0), cell(20.0, 300.0)], sheet: None },
        rate_hz,
        source: "Test.".into(),
        t_s,
        pressure_kpa,
    }
}

#[test]
fn binning_conserves_the_force_on_every_region() {
    let full = synthetic::walk(&SyntheticWalk::default()).recording;
    for max_cells in [150, 60, 8] {
        let binned = full.binned(max_cells).unwrap();
        assert!(binned.cells() <= max_cells);
        assert!(binned.cells() * 2 > max_cells, "{} of {max_cells}", binned.cells());
        for frame in 0..full.frames() {
            for region in Region::ALL {
                let (before, after) = (region_force_n(&full, frame, region), region_force_n(&binned, frame, region));
                assert!((before - after).abs() <= 1e-5 * before, "{region:?} {before} {after}");
            }
        }
    }
}

#[test]
fn a_merged_cell_has_the_area_weighted_means_of_its_cells() {
    let merged = two_cells(vec![0.0], 100.0, vec![40.0, 80.0]).binned(1).unwrap();
    let cell = merged.layout.cells[0];
    assert_eq!((cell.x_mm, cell.y_mm, cell.area_mm2, cell.region), (16.25, 10.0, 400.0, Region::Heel));
    assert_eq!(merged.pressure_kpa, [70.0]);
}

#[test]
fn binning_first_drops_cells_that_are_never_loaded() {
    let reduced = two_cells(vec![0.0], 100.0, vec![0.0, 80.0]).binned(1).unwrap();
    assert_eq!(reduced.layout.cells[0].x_mm, 20.0);
    assert_eq!(reduced.pressure_kpa, [80.0]);
}

#[test]
fn binning_an_unloaded_recording_conserves_its_area() {
    let merged = two_cells(vec![0.0], 100.0, vec![0.0, 0.0]).binned(1).unwrap();
    assert_eq!(merged.layout.cells[0].area_mm2, 400.0);
}

#[test]
fn binning_does_not_change_a_recording_with_few_enough_cells() {
    let full = two_cells(vec![0.0], 100.0, vec![0.0, 80.0]);
    assert_eq!(full.binned(2).unwrap(), full);
}

#[test]
fn binning_refuses_fewer_cells_than_regions() {
    let full = synthetic::walk(&SyntheticWalk::default()).recording;
    let error = full.binned(7).unwrap_err().to_string();
    assert!(error.contains("allow at least 8 cells"), "{error}");
}

#[test]
fn binning_refuses_a_merged_cell_of_more_than_4000_mm2() {
    let mut full = two_cells(vec![0.0], 100.0, vec![40.0, 80.0]);
    full.layout.cells.iter_mut().for_each(|cell| cell.area_mm2 = 2_500.0);
    let error = full.binned(1).unwrap_err().to_string();
    assert!(error.contains("5000 mm², but a cell has at most 4000 mm²; allow more cells"), "{error}");
}

#[test]
fn resampling_reproduces_a_straight_line() {
    let times = |n: usize, rate_hz: f64| (0..n).map(move |k| 2.0 + k as f64 / rate_hz);
    let ramp = |t_s: f64| [(10.0 * (t_s - 2.0)) as f32, (30.0 - 5.0 * t_s) as f32];
    let slow = two_cells(times(31, 30.0).collect(), 30.0, times(31, 30.0).flat_map(ramp).collect());
    for rate_hz in [30.0, 100.0, 7.0] {
        let fast = slow.at_rate(rate_hz).unwrap();
        assert_eq!(fast.frames(), rate_hz as usize + 1);
        assert_eq!(fast.rate_hz, rate_hz);
        for (i, t_s) in times(fast.frames(), rate_hz).enumerate() {
            // Computed times are rounded to 1 ns.
            assert!((fast.t_s[i] - t_s).abs() < 0.6e-9);
            for (got, want) in fast.frame(i).iter().zip(ramp(t_s)) {
                assert!((got - want).abs() < 1e-4, "{got} {want}");
            }
        }
    }
}

#[test]
fn resampling_conserves_the_force_time_integral_of_a_walk() {
    let integral_n_s = |r: &Recording| (0..r.frames()).map(|i| r.force_n(i)).sum::<f64>() / r.rate_hz;
    let slow = synthetic::walk(&SyntheticWalk::default()).recording;
    let fast = slow.at_rate(333.0).unwrap();
    assert!((integral_n_s(&fast) / integral_n_s(&slow) - 1.0).abs() < 1e-3);
}

#[test]
fn resampling_rejects_a_rate_that_is_not_positive_or_above_1_mhz() {
    let full = two_cells(vec![0.0, 0.01], 100.0, vec![0.0; 4]);
    for rate_hz in [0.0, -1.0, f64::NAN, 3e6, f64::INFINITY] {
        let error = full.at_rate(rate_hz).unwrap_err().to_string();
        assert!(error.contains("positive rate"), "{error}");
    }
}

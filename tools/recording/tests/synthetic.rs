//! The computed walk agrees with its parameters and its true values.

use plantar::Region;
use recording::synthetic::{self, SyntheticWalk, Walk};

fn walk() -> Walk {
    synthetic::walk(&SyntheticWalk::default())
}

#[test]
fn an_insole_has_exactly_the_requested_number_of_cells() {
    for cells in [8, 99, 239, 240, 241, 1000] {
        let layout = synthetic::insole(cells);
        assert_eq!(layout.cells.len(), cells);
    }
    let layout = synthetic::insole(240);
    for region in Region::ALL {
        let own = layout.cells.iter().filter(|c| c.region == region).count();
        assert!(own >= 8, "{region:?} has {own} cells");
    }
    let area_mm2: f64 = layout.cells.iter().map(|c| c.area_mm2).sum();
    assert!((17_000.0..22_000.0).contains(&area_mm2), "{area_mm2} mm²");
}

#[test]
fn a_loaded_frame_loads_every_cell() {
    let layout = synthetic::insole(240);
    let frame = synthetic::loaded_frame(&layout);
    assert_eq!(frame.len(), 240);
    assert!(frame.iter().all(|kpa| (20.0..=200.0).contains(kpa)));
}

#[test]
fn the_forces_on_the_cells_add_up_to_the_true_force() {
    let walk = walk();
    for (i, force_n) in walk.force_n.iter().enumerate() {
        let truth_n: f64 = force_n.iter().sum();
        assert!((walk.recording.force_n(i) - truth_n).abs() < 1e-3);
    }
}

#[test]
fn the_force_has_two_peaks_of_the_requested_size() {
    let walk = synthetic::walk(&SyntheticWalk { steps: 1, variation: 0.0, ..SyntheticWalk::default() });
    let total_n: Vec<f64> = walk.force_n.iter().map(|f| f.iter().sum()).collect();
    let peaks = (1..total_n.len() - 1)
        .filter(|&i| total_n[i - 1] < total_n[i] && total_n[i] >= total_n[i + 1])
        .collect::<Vec<_>>();
    assert_eq!(peaks.len(), 2);
    for &i in &peaks {
        assert!((total_n[i] - 800.0).abs() < 3.0, "{} N", total_n[i]);
    }
    let dip_n = total_n[peaks[0]..peaks[1]].iter().copied().fold(f64::INFINITY, f64::min);
    assert!((0.7..0.8).contains(&(dip_n / 800.0)));
    // Stance and swing have the requested durations.
    let loaded = total_n.iter().filter(|&&n| n > 0.0).count();
    assert!((62..=65).contains(&loaded), "{loaded} frames");
    assert_eq!(total_n.iter().position(|&n| n > 0.0), Some(41));
}

#[test]
fn the_contact_area_of_small_cells_is_that_of_the_true_ellipse() {
    // At the edge of the ellipse the pressure is 0.4 of its peak. With small cells, a cell belongs to the contact if it reads
    // more than half of this pressure.
    let walk = synthetic::walk(&SyntheticWalk { cells: 3000, steps: 1, ..SyntheticWalk::default() });
    let recording = &walk.recording;
    for i in (45..100).step_by(10) {
        for region in Region::ALL {
            let truth_mm2 = walk.contact_mm2[i][region as usize];
            if truth_mm2 < 300.0 {
                continue;
            }
            let own = || {
                let cells = recording.layout.cells.iter().zip(recording.frame(i));
                cells.filter(|(cell, _)| cell.region == region)
            };
            let most_kpa = own().map(|(_, &kpa)| kpa).fold(0.0, f32::max);
            let counted_mm2: f64 =
                own().filter(|&(_, &kpa)| kpa > 0.5 * 0.4 * most_kpa).map(|(cell, _)| cell.area_mm2).sum();
            let ratio = counted_mm2 / truth_mm2;
            assert!((0.92..1.08).contains(&ratio), "{region:?} frame {i}: {ratio}");
        }
    }
}

#[test]
fn load_rolls_from_heel_to_toes() {
    let walk = walk();
    let first = |region: Region| walk.force_n.iter().position(|f| f[region as usize] > 0.0).unwrap();
    assert!(first(Region::Heel) < first(Region::PosteriorMidfoot));
    assert!(first(Region::PosteriorMidfoot) <= first(Region::AnteriorMidfoot));
    assert!(first(Region::AnteriorMidfoot) <= first(Region::Metatarsals12));
    assert!(first(Region::Metatarsals12) < first(Region::Hallux));
    let peak_kpa = walk.recording.pressure_kpa.iter().copied().fold(0.0, f32::max);
    assert!((150.0..600.0).contains(&peak_kpa), "{peak_kpa} kPa");
}

#[test]
fn equal_seeds_result_in_equal_walks_and_other_seeds_do_not() {
    assert!(walk() == walk());
    let other = synthetic::walk(&SyntheticWalk { seed: 2, ..SyntheticWalk::default() });
    assert!(walk().recording.pressure_kpa != other.recording.pressure_kpa);
}

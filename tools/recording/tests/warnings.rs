//! Warnings about the layout and the forces of a recording.

use plantar::{Region, Side};
use recording::{Cell, Layout, Recording, footprint};

/// A foot of ten cells in one row of the length `length_mm`. In each contact, the load moves by `moves` cells. It is about 300 N:
/// up to 100 kPa on one of five cells of 10 cm2, and together twice this on the other four.
fn contacts(length_mm: f64, moves: &[f64]) -> Recording {
    let cell = |i: usize| Cell { x_mm: 20.0, y_mm: length_mm * i as f64 / 9.0, area_mm2: 1000.0, region: Region::Heel };
    let mut pressure_kpa: Vec<f32> = Vec::new();
    for by in moves {
        for frame in 0..30 {
            let loaded = 4.5 + by * (f64::from(frame) / 29.0 - 0.5);
            pressure_kpa.extend((0..10).map(|i| (100.0 * (1.0 - (f64::from(i) - loaded).abs() / 3.0)).max(0.0) as f32));
        }
        pressure_kpa.extend([0.0; 10 * 20]);
    }
    Recording {
        side: Side::Left,
        layout: Layout { name: "row".into(), cells: (0..10).map(cell).collect(), sheet: None },
        rate_hz: 100.0,
        source: String::new(),
        t_s: (0..pressure_kpa.len() / 10).map(|frame| frame as f64 * 0.01).collect(),
        pressure_kpa,
    }
}

#[test]
fn standing_does_not_hide_that_a_foot_is_upside_down() {
    let warns = |moves: &[f64]| footprint::warnings(&contacts(250.0, moves)).iter().any(|w| w.contains("upside down"));
    assert!(warns(&[-8.0, -8.0]));
    assert!(warns(&[0.0, -8.0, -8.0]));
    assert!(!warns(&[8.0, -8.0]));
    assert!(!warns(&[0.0, 0.0]));
}

#[test]
fn layouts_in_cm_and_with_exchanged_axes_lead_to_a_warning() {
    let in_cm = contacts(25.0, &[8.0]);
    assert!(footprint::warnings(&in_cm)[0].contains("in mm2"), "{:?}", footprint::warnings(&in_cm));
    let mut in_cm2 = contacts(250.0, &[8.0]);
    in_cm2.layout.cells.iter_mut().for_each(|cell| cell.area_mm2 = 1.0);
    assert!(footprint::warnings(&in_cm2)[0].contains("10 mm2 in total"), "{:?}", footprint::warnings(&in_cm2));
    let mut exchanged = contacts(250.0, &[8.0]);
    for cell in &mut exchanged.layout.cells {
        (cell.x_mm, cell.y_mm) = (cell.y_mm, cell.x_mm);
    }
    assert!(footprint::warnings(&exchanged)[0].contains("exchanged"), "{:?}", footprint::warnings(&exchanged));
    assert!(footprint::warnings(&contacts(250.0, &[8.0])).is_empty());
}

/// The weight of a child of 20 kg is 196 N.
#[test]
fn a_force_that_no_step_has_leads_to_a_warning_about_the_unit() {
    let walk = contacts(250.0, &[8.0]);
    let warnings = |factor: f32| {
        let mut walk = walk.clone();
        let most_n = (0..walk.frames()).map(|i| walk.force_n(i)).fold(0.0, f64::max) as f32;
        walk.pressure_kpa.iter_mut().for_each(|kpa| *kpa *= factor / most_n);
        footprint::warnings(&walk)
    };
    for usual_n in [0.0, 196.0, 850.0, 3500.0] {
        assert_eq!(warnings(usual_n), Vec::<String>::new(), "{usual_n} N");
    }
    // Those of an adult with 990 N in N/cm2, PSI and mmHg, read as kPa, and those in kPa, read as N/cm2.
    for (wrong_n, stated) in [(99.0, "99.0 N"), (144.0, "144 N"), (7426.0, "7426 N"), (9900.0, "9900 N")] {
        let warnings = warnings(wrong_n);
        assert!(
            warnings.len() == 1 && warnings[0].contains(stated) && warnings[0].contains("pressures or forces"),
            "{warnings:?}"
        );
    }
}

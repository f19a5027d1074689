//! The layout and the wiring of the reference insole.

use plantar::firmware::layout::{self, CELLS, COLUMNS, ROWS, WIRING};
use plantar::insole::Insole;
use plantar::pipeline::region::{Region, Side};
use std::collections::BTreeSet;

#[test]
fn the_layout_is_accepted_as_a_set_up() {
    let mut insole = Insole::<f32, CELLS>::new();
    assert_eq!(insole.set_up(layout::setup(Side::Left), layout::cells()), Ok(()));
    assert_eq!(insole.cells(), CELLS);
    assert_eq!(insole.setup().map(|setup| setup.period_us), Some(layout::PERIOD_US));
}

#[test]
fn every_cell_is_wired_once() {
    assert_eq!((WIRING.len(), WIRING[0].len()), (ROWS, COLUMNS));
    let wired: Vec<u8> = WIRING.iter().flatten().flatten().copied().collect();
    let cells: BTreeSet<u8> = wired.iter().copied().collect();
    assert_eq!((wired.len(), cells.len()), (CELLS, CELLS));
    assert_eq!(cells.last().map(|&cell| usize::from(cell)), Some(CELLS - 1));
}

/// The order of the columns is that of the regions.
#[test]
fn the_regions_have_the_documented_numbers_of_cells() {
    let counts = Region::ALL.map(|region| layout::cells().filter(|cell| cell.region == region).count().to_string());
    let row = format!("| {} |", counts.join(" | "));
    assert!(include_str!("../../docs/hardware.md").contains(&row), "docs/hardware.md has no row {row}");
}

#[test]
fn the_matrix_is_folded_at_half_the_length() {
    let cells: Vec<_> = layout::cells().collect();
    for (row, columns) in WIRING.iter().enumerate() {
        for (column, cell) in columns.iter().enumerate().filter_map(|(i, cell)| Some((i, usize::from((*cell)?)))) {
            // The first half of the columns has the cells of the rear half of the insole, and the second half those of the front.
            // The rows of both halves form 32 lines, which divide the length of 270 mm.
            let line = row + ROWS * (column / (COLUMNS / 2));
            let y_mm = (line as f32 + 0.5) * 270.0 / 32.0;
            assert!((cells[cell].y_mm - y_mm).abs() < 1e-3, "row {row} column {column}");
        }
        for half in [&columns[..COLUMNS / 2], &columns[COLUMNS / 2..]] {
            let x_mm: Vec<f32> = half.iter().flatten().map(|&cell| cells[usize::from(cell)].x_mm).collect();
            assert!(x_mm.is_sorted(), "the cells of row {row} must be in order from medial to lateral");
        }
    }
}

#[test]
fn cells_and_sole_have_the_right_size() {
    let mut total_mm2 = 0.0;
    for region in Region::ALL {
        let areas: Vec<f32> = layout::cells().filter(|c| c.region == region).map(|c| c.area_mm2).collect();
        assert!(areas.len() >= 4, "{} has only {} cells", region.name(), areas.len());
        assert!(areas.iter().all(|area| (50.0..=130.0).contains(area)), "{}: {areas:?}", region.name());
        total_mm2 += areas.iter().sum::<f32>();
    }
    // A sole that is 270 mm long and 98 mm wide fills about three quarters of its bounding box.
    assert!((0.70..0.85).contains(&(total_mm2 / (270.0 * 98.0))), "{total_mm2} mm2");
}

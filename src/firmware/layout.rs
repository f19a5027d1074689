//! The reference insole: the positions of 240 cells in an outline of EU size 42, and their wiring to a matrix of 16 by 16.
//!
//! From heel to toes there are 32 lines of up to 8 cells each. Electrically they are folded into 16 by 16: row `r` drives the
//! lines `r` and `r + 16`; columns 0 to 7 read the lines of the rear half, columns 8 to 15 the lines of the front half, both from
//! medial to lateral. A square matrix needs the fewest wires; because a foot is nearly three times as long as wide, the folding
//! makes the cells nearly square. Left and right insoles are mirror images, with the same foot coordinates.

use super::front_end::UNLOADED_CODE;
use crate::pipeline::calibrate::{CellCalibration, SensorLaw};
use crate::pipeline::contact::ContactRule;
use crate::pipeline::outline::REFERENCE_INSOLE;
use crate::pipeline::region::{Cell, Region, Side};
use crate::pipeline::setup::{Setup, SetupCell};
use crate::pipeline::stance_rule::StanceRule;
use crate::pipeline::template::region_at;

/// Time between frames, us: 100 Hz, the rate of common clinical systems.
pub const PERIOD_US: u32 = 10_000;

/// Number of electrical rows.
pub const ROWS: usize = 16;
/// Number of electrical columns.
pub const COLUMNS: usize = 16;
/// Number of cells; 16 positions of the matrix at the ends of the foot are outside of the outline.
pub const CELLS: usize = 240;

/// Identifies the layout and the sensor law: size 42, first version. An insole accepts a stored calibration by this number and
/// the number of cells, so the number must change with the positions of the cells and with the sensor law in [`setup`]: the gains
/// of a calibration belong to the law with which they were determined.
const LAYOUT_ID: u32 = 4201;
const LENGTH_MM: f32 = REFERENCE_INSOLE.length_mm() as f32;
/// Number of lines across the foot.
const LINES: usize = 2 * ROWS;
/// Number of cells on a full line.
const ACROSS: usize = COLUMNS / 2;

/// The built-in calibration of every cell, to be replaced by a measured one.
const UNLOADED: CellCalibration = CellCalibration { offset: UNLOADED_CODE, gain: 1.0 };

/// Number of cells on a line: fewer at the ends of the foot, where the outline is narrow.
const fn cells_on(line: usize) -> usize {
    match line {
        0 | 30 => 4,
        1 => 6,
        31 => 2,
        _ => ACROSS,
    }
}

/// Cell number `across` of a line, from the medial edge. Its area extends half way to its neighbours.
const fn cell(line: usize, across: usize) -> Cell {
    let x_fraction = (across as f32 + 0.5) / cells_on(line) as f32;
    let y_fraction = (line as f32 + 0.5) / LINES as f32;
    let [medial_mm, lateral_mm] = REFERENCE_INSOLE.edges_mm(y_fraction as f64 * REFERENCE_INSOLE.length_mm());
    let (medial_mm, width_mm) = (medial_mm as f32, lateral_mm as f32 - medial_mm as f32);
    Cell {
        region: region_at(x_fraction, y_fraction),
        x_mm: medial_mm + x_fraction * width_mm,
        y_mm: y_fraction * LENGTH_MM,
        area_mm2: (width_mm / cells_on(line) as f32) * (LENGTH_MM / LINES as f32),
    }
}

struct Layout {
    cells: [Cell; CELLS],
    row_columns: [u8; CELLS],
    wiring: [[Option<u8>; COLUMNS]; ROWS],
}

/// Numbers the cells by region, in the order of the codes in a frame, and records the row and column of each.
const fn lay_out() -> Layout {
    let none = Cell { region: Region::Heel, x_mm: 0.0, y_mm: 0.0, area_mm2: 0.0 };
    let mut layout = Layout { cells: [none; CELLS], row_columns: [0; CELLS], wiring: [[None; COLUMNS]; ROWS] };
    let (mut region, mut count) = (0, 0);
    while region < Region::ALL.len() {
        let mut line = 0;
        while line < LINES {
            let mut across = 0;
            while across < cells_on(line) {
                let cell = cell(line, across);
                if cell.region as usize == region {
                    // A short line uses the middle columns.
                    let column = (ACROSS - cells_on(line)) / 2 + across + ACROSS * (line / ROWS);
                    layout.wiring[line % ROWS][column] = Some(count as u8);
                    layout.cells[count] = cell;
                    layout.row_columns[count] = (line % ROWS * COLUMNS + column) as u8;
                    count += 1;
                }
                across += 1;
            }
            line += 1;
        }
        region += 1;
    }
    assert!(count == CELLS, "the lines hold CELLS cells");
    layout
}

static LAYOUT: Layout = lay_out();

/// The cell at each row and column, by its index in a frame.
pub static WIRING: &[[Option<u8>; COLUMNS]; ROWS] = &LAYOUT.wiring;

/// The cells in the order of a frame.
pub fn cells() -> impl Iterator<Item = SetupCell> + Clone {
    let cells = LAYOUT.cells.iter().zip(&LAYOUT.row_columns);
    cells.map(|(&cell, &row_column)| SetupCell::new(cell, UNLOADED, row_column))
}

/// The set-up of the reference insole with the default rules. The feedback resistors of its amplifiers are chosen for this full
/// scale. The exponent is a typical value for a piezoresistive sheet and must be replaced by a measured one. Another law
/// needs another `LAYOUT_ID`, because the gains of a stored calibration would otherwise remain in force.
pub fn setup(side: Side) -> Setup {
    Setup {
        side,
        layout_id: LAYOUT_ID,
        period_us: PERIOD_US,
        sensor: SensorLaw { full_kpa: 1000.0, exponent: 0.8 },
        contact: ContactRule::COVERED,
        stance: StanceRule::ADAPTIVE,
    }
}

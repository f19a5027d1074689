//! The insole of computed recordings.

use crate::{Cell, Layout, template};
use plantar::Region;
use plantar::pipeline::outline::GENERIC_SOLE;

/// A generic insole of EU size 42 with exactly this many square cells. [`template`] assigns their regions.
///
/// The cells lie on a regular grid. Its pitch is the widest at which at least `cells` of them lie inside [`GENERIC_SOLE`].
/// Surplus cells are removed at the tip of the toes.
///
/// # Panics
/// Panics if `cells` is 0.
pub fn insole(cells: usize) -> Layout {
    assert!(cells > 0, "an insole has at least one cell");
    const PITCH_STEP_MM: f64 = 0.001;
    let widest_mm = 1.5 * (GENERIC_SOLE.length_mm() * GENERIC_SOLE.width_mm() / cells as f64).sqrt();
    let mut grid = (0..)
        .map(|k| widest_mm - f64::from(k) * PITCH_STEP_MM)
        .map(inside_outline)
        .find(|grid| grid.len() >= cells)
        .expect("the number of cells grows without limit as the pitch approaches zero");
    grid.truncate(cells);
    template::assign(&mut grid);
    Layout::computed(grid)
}

/// The cells of a square grid whose centres lie inside [`GENERIC_SOLE`], from heel to toes.
fn inside_outline(pitch_mm: f64) -> Vec<Cell> {
    let centres =
        |until_mm: f64| (0..).map(move |k| (f64::from(k) + 0.5) * pitch_mm).take_while(move |&at_mm| at_mm < until_mm);
    centres(GENERIC_SOLE.length_mm())
        .flat_map(|y_mm| {
            let [medial_mm, lateral_mm] = GENERIC_SOLE.edges_mm(y_mm);
            let in_row = move |x_mm: &f64| (medial_mm..lateral_mm).contains(x_mm);
            centres(GENERIC_SOLE.width_mm()).filter(in_row).map(move |x_mm| Cell {
                x_mm,
                y_mm,
                area_mm2: pitch_mm * pitch_mm,
                // Replaced by the template.
                region: Region::Heel,
            })
        })
        .collect()
}

//! Comparison of an import with the totals that the vendor's program wrote into the same file.

use crate::footprint::capitalised;
use plantar::Side;

/// Frames with more than this fraction of the largest total are compared: in the others, rounding dominates.
const COMPARED_SHARE: f64 = 0.1;
/// Largest relative difference between totals that agree. It covers the rounding of the size of a cell.
const TOLERANCE: f64 = 0.005;

/// The totals of each frame: first that of the imported cells, then that which the vendor states.
#[derive(Default)]
pub struct Totals {
    force_n: Vec<(f64, f64)>,
    area_mm2: Vec<(f64, f64)>,
}

impl Totals {
    /// Adds the force of a frame, N. A frame without the vendor's value is not compared.
    pub fn push_force(&mut self, imported_n: f64, stated_n: Option<f64>) {
        self.force_n.extend(stated_n.map(|stated_n| (imported_n, stated_n)));
    }

    /// Adds the contact area of a frame, mm2. A frame without the vendor's value is not compared.
    pub fn push_area(&mut self, imported_mm2: f64, stated_mm2: Option<f64>) {
        self.area_mm2.extend(stated_mm2.map(|stated_mm2| (imported_mm2, stated_mm2)));
    }

    /// Sentences about the differences; `None` if no frame is compared.
    pub fn remark(&self, side: Side) -> Option<String> {
        let parts = [("force", &self.force_n), ("contact area", &self.area_mm2)].map(|(what, totals)| {
            let (mean, largest, frames) = differences(totals)?;
            let text = format!(
                "{what} differs from the vendor's by {:+.2} % on average and by up to {:.2} % ({frames} frames)",
                100.0 * mean,
                100.0 * largest
            );
            Some((text, largest > TOLERANCE))
        });
        let parts: Vec<_> = parts.into_iter().flatten().collect();
        let advice = match parts.iter().any(|(_, differs)| *differs) {
            true => " Check the unit and the size of the cells in the export.",
            false => "",
        };
        let texts: Vec<_> = parts.into_iter().map(|(text, _)| text).collect();
        (!texts.is_empty()).then(|| format!("{} foot: {}.{advice}", capitalised(side), texts.join("; ")))
    }
}

/// The mean and the largest relative difference, and the number of compared frames; `None` if no frame is compared.
fn differences(totals: &[(f64, f64)]) -> Option<(f64, f64, usize)> {
    let largest_stated = totals.iter().map(|(_, stated)| *stated).fold(0.0, f64::max);
    let relative: Vec<f64> = totals
        .iter()
        .filter(|(_, stated)| *stated > COMPARED_SHARE * largest_stated)
        .map(|(imported, stated)| imported / stated - 1.0)
        .collect();
    let largest = relative.iter().map(|difference| difference.abs()).fold(0.0, f64::max);
    (!relative.is_empty()).then(|| (relative.iter().sum::<f64>() / relative.len() as f64, largest, relative.len()))
}

//! Negative pressures, as after the subtraction of a baseline. They are read as 0, and counted.

use crate::footprint::capitalised;
use crate::text::significant;
use plantar::Side;

/// The negative pressures of a foot in all frames.
#[derive(Default)]
pub struct Negatives {
    count: usize,
    /// The lowest pressure, kPa; 0 if none is negative.
    lowest_kpa: f32,
}

impl Negatives {
    /// The pressure, kPa; 0 instead of a negative one, which is counted.
    pub fn clip(&mut self, kpa: f32) -> f32 {
        self.count += usize::from(kpa < 0.0);
        self.lowest_kpa = self.lowest_kpa.min(kpa);
        kpa.max(0.0)
    }

    /// A remark with the number of negative pressures and the lowest one; `None` if there are none.
    pub fn remark(&self, side: Side) -> Option<String> {
        (self.count > 0).then(|| {
            format!(
                "{} foot: negative pressures that were read as 0, in all frames together: {}. The lowest one is {} kPa.",
                capitalised(side),
                self.count,
                significant(self.lowest_kpa.into())
            )
        })
    }
}

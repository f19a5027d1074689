//! The template determines the region of a cell from its position under the foot, for layouts that do not state regions.
//!
//! The template is defined in fractions of the foot: y from the back of the heel (0) to the tip of the toes (1), x from the
//! medial edge (0) to the lateral edge (1) of the foot at that y.
//!
//! ```text
//!  y = 1   hallux | toe 2 | toes 3-5
//!          ------.________           toes begin at 0.825 medially, 0.72 laterally
//!          metatarsals 1-2 | 3-5     divided at x = 0.45
//!          ---------_______          metatarsals begin at 0.60 medially, 0.50 laterally
//!          anterior midfoot
//!          ---------------- 0.42
//!          posterior midfoot
//!          ---------------- 0.29
//!  y = 0   heel
//! ```
//!
//! The boundaries were chosen from barefoot and in-shoe pressures of a dozen feet. The template is a convention for comparing
//! feet, not anatomy; a layout with known anatomical regions should state them. The template assumes a sensor sheet about as long
//! as the foot. On a sheet that extends far beyond the toes, it assigns the toes to the metatarsals.

use super::region::Region;

/// Boundary between heel and posterior midfoot, fraction of the length of the foot.
const HEEL_END: f32 = 0.29;
/// Boundary between posterior and anterior midfoot.
const MIDFOOT_MIDDLE: f32 = 0.42;
/// Start of the metatarsals, at the medial and at the lateral edge.
const METATARSALS_START: [f32; 2] = [0.60, 0.50];
/// Start of the toes, at the medial and at the lateral edge.
const TOES_START: [f32; 2] = [0.825, 0.72];
/// The boundary of the toes is at a constant y from the medial edge to this fraction of the width, and slants towards the heel
/// from there on.
const TOES_LEVEL_UNTIL: f32 = 0.60;
/// Boundary between metatarsals 2 and 3, fraction of the width.
const METATARSALS_SPLIT: f32 = 0.45;
/// Boundaries between hallux and toe 2, and between toes 2 and 3.
const TOES_SPLIT: [f32; 2] = [0.40, 0.58];

/// The region at a fraction of the width (0 medial, 1 lateral) and of the length (0 heel, 1 toes). A position outside of 0..=1
/// has the region of the nearest position inside.
///
/// ```
/// use plantar::{Region, pipeline::template::region_at};
///
/// assert_eq!(region_at(0.5, 0.1), Region::Heel);
/// assert_eq!(region_at(0.2, 0.9), Region::Hallux);
/// ```
pub const fn region_at(x_fraction: f32, y_fraction: f32) -> Region {
    let slant = (x_fraction - TOES_LEVEL_UNTIL) / (1.0 - TOES_LEVEL_UNTIL);
    if y_fraction < HEEL_END {
        Region::Heel
    } else if y_fraction < MIDFOOT_MIDDLE {
        Region::PosteriorMidfoot
    } else if y_fraction < between(METATARSALS_START, x_fraction) {
        Region::AnteriorMidfoot
    } else if y_fraction < between(TOES_START, slant) {
        if x_fraction < METATARSALS_SPLIT { Region::Metatarsals12 } else { Region::Metatarsals35 }
    } else if x_fraction < TOES_SPLIT[0] {
        Region::Hallux
    } else if x_fraction < TOES_SPLIT[1] {
        Region::Toe2
    } else {
        Region::Toes35
    }
}

/// Interpolates linearly between the values at the medial and at the lateral edge.
const fn between([medial, lateral]: [f32; 2], x_fraction: f32) -> f32 {
    medial + (lateral - medial) * x_fraction.clamp(0.0, 1.0)
}

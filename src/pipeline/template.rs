//! Regions for cells whose layout names none, from where they lie under the foot.
//!
//! The template is drawn in fractions of the foot: y from the back of the heel (0) to the tip of the
//! toes (1), x from the medial edge (0) to the lateral edge (1) of the foot at that y. The edges run
//! straight from the heel's to the forefoot's, so a foot may stand obliquely on its sheet; beyond the
//! forefoot the width stays that of the forefoot.
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
//! It was drawn over barefoot and in-shoe pressure of a dozen feet. It is a convention for comparing
//! feet, not anatomy: a layout that knows better should bring its own regions. It expects a sheet about
//! as long as the foot; on one that reaches far beyond the toes, they fall under the metatarsals.

use super::region::Region;

/// The heel ends and the posterior midfoot begins, fraction of the foot's length.
const HEEL_END: f32 = 0.29;
/// The posterior midfoot ends and the anterior midfoot begins.
const MIDFOOT_MIDDLE: f32 = 0.42;
/// The metatarsals begin, at the medial and at the lateral edge.
const METATARSALS_START: [f32; 2] = [0.60, 0.50];
/// The toes begin, at the medial and at the lateral edge.
const TOES_START: [f32; 2] = [0.825, 0.72];
/// The toes' boundary stays level from the medial edge to here, then slants: fraction of the width.
const TOES_LEVEL_UNTIL: f32 = 0.60;
/// Metatarsal 2 ends and metatarsal 3 begins.
const METATARSALS_SPLIT: f32 = 0.45;
/// The hallux ends and toe 2 begins; toe 2 ends and toe 3 begins.
const TOES_SPLIT: [f32; 2] = [0.40, 0.58];

/// The region at a fraction of the width (0 medial, 1 lateral) and of the length (0 heel, 1 toes).
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

const fn between([medial, lateral]: [f32; 2], x_fraction: f32) -> f32 {
    medial + (lateral - medial) * x_fraction.clamp(0.0, 1.0)
}

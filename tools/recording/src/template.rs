//! Regions for cells whose source names none, from where they lie under the foot.
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

use crate::Cell;
use plantar::Region;

/// The heel ends and the posterior midfoot begins, fraction of the foot's length.
const HEEL_END: f64 = 0.29;
/// The posterior midfoot ends and the anterior midfoot begins.
const MIDFOOT_MIDDLE: f64 = 0.42;
/// The metatarsals begin, at the medial and at the lateral edge.
const METATARSALS_START: [f64; 2] = [0.60, 0.50];
/// The toes begin, at the medial and at the lateral edge.
const TOES_START: [f64; 2] = [0.825, 0.72];
/// The toes' boundary stays level from the medial edge to here, then slants: fraction of the width.
const TOES_LEVEL_UNTIL: f64 = 0.60;
/// Metatarsal 2 ends and metatarsal 3 begins.
const METATARSALS_SPLIT: f64 = 0.45;
/// The hallux ends and toe 2 begins; toe 2 ends and toe 3 begins.
const TOES_SPLIT: [f64; 2] = [0.40, 0.58];

/// Where the widths of heel and forefoot are taken, fractions of the foot's length.
const HEEL_BAND: [f64; 2] = [0.05, 0.25];
const FOREFOOT_BAND: [f64; 2] = [0.60, 0.78];

/// The region at a fraction of the width (0 medial, 1 lateral) and of the length (0 heel, 1 toes).
pub fn region_of(x_frac: f64, y_frac: f64) -> Region {
    let between = |[medial, lateral]: [f64; 2], x: f64| medial + (lateral - medial) * x.clamp(0.0, 1.0);
    let slant = (x_frac - TOES_LEVEL_UNTIL) / (1.0 - TOES_LEVEL_UNTIL);
    if y_frac < HEEL_END {
        Region::Heel
    } else if y_frac < MIDFOOT_MIDDLE {
        Region::PosteriorMidfoot
    } else if y_frac < between(METATARSALS_START, x_frac) {
        Region::AnteriorMidfoot
    } else if y_frac < between(TOES_START, slant) {
        if x_frac < METATARSALS_SPLIT { Region::Metatarsals12 } else { Region::Metatarsals35 }
    } else if x_frac < TOES_SPLIT[0] {
        Region::Hallux
    } else if x_frac < TOES_SPLIT[1] {
        Region::Toe2
    } else {
        Region::Toes35
    }
}

/// Gives every cell its region by [`region_of`], with length and edges taken from the cells themselves.
///
/// The cells must be those under the foot, in foot coordinates; their present regions are ignored.
pub fn assign(cells: &mut [Cell]) {
    let length = extent(cells, |c| c.y_mm);
    let y_frac = |y_mm: f64| (y_mm - length.low_mm) / (length.high_mm - length.low_mm);
    let edges = |band: [f64; 2]| {
        let within: Vec<Cell> =
            cells.iter().filter(|c| (band[0]..=band[1]).contains(&y_frac(c.y_mm))).copied().collect();
        // A sheet without cells there is taken as a rectangle.
        extent(if within.is_empty() { cells } else { &within }, |c| c.x_mm)
    };
    let (heel, forefoot) = (edges(HEEL_BAND), edges(FOREFOOT_BAND));
    let middle = |band: [f64; 2]| (band[0] + band[1]) / 2.0;
    let (heel_y, forefoot_y) = (middle(HEEL_BAND), middle(FOREFOOT_BAND));
    for cell in cells {
        let y = y_frac(cell.y_mm);
        let toward_forefoot = (y - heel_y) / (forefoot_y - heel_y);
        let centre_mm = heel.centre_mm() + (forefoot.centre_mm() - heel.centre_mm()) * toward_forefoot;
        let width_mm = heel.width_mm() + (forefoot.width_mm() - heel.width_mm()) * toward_forefoot.clamp(0.0, 1.0);
        cell.region = region_of((cell.x_mm - centre_mm) / width_mm + 0.5, y);
    }
}

/// How far cells reach along one axis.
struct Extent {
    low_mm: f64,
    high_mm: f64,
}

impl Extent {
    fn centre_mm(&self) -> f64 {
        (self.low_mm + self.high_mm) / 2.0
    }

    fn width_mm(&self) -> f64 {
        self.high_mm - self.low_mm
    }
}

fn extent(cells: &[Cell], along: fn(&Cell) -> f64) -> Extent {
    let start = Extent { low_mm: f64::INFINITY, high_mm: f64::NEG_INFINITY };
    cells.iter().fold(start, |reach, cell| Extent {
        low_mm: reach.low_mm.min(along(cell) - cell.half_side_mm()),
        high_mm: reach.high_mm.max(along(cell) + cell.half_side_mm()),
    })
}

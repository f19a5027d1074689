//! Cells to regions: area, measured force, centre of pressure and second moments in one pass over the cells.

use crate::num::Real;
use serde::{Deserialize, Serialize};

/// The eight plantar regions of the paper (Fig. 1), in wire order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Region {
    Heel,
    PosteriorMidfoot,
    AnteriorMidfoot,
    Metatarsals12,
    Metatarsals35,
    Hallux,
    Toe2,
    Toes35,
}

impl Region {
    /// All regions, heel to toes; the position is the region's index everywhere.
    pub const ALL: [Region; 8] = [
        Region::Heel,
        Region::PosteriorMidfoot,
        Region::AnteriorMidfoot,
        Region::Metatarsals12,
        Region::Metatarsals35,
        Region::Hallux,
        Region::Toe2,
        Region::Toes35,
    ];

    /// The name used in files and on screens, in snake case.
    pub const fn name(self) -> &'static str {
        match self {
            Region::Heel => "heel",
            Region::PosteriorMidfoot => "posterior_midfoot",
            Region::AnteriorMidfoot => "anterior_midfoot",
            Region::Metatarsals12 => "metatarsals_12",
            Region::Metatarsals35 => "metatarsals_35",
            Region::Hallux => "hallux",
            Region::Toe2 => "toe_2",
            Region::Toes35 => "toes_35",
        }
    }

    /// The region with this [`Region::name`].
    pub fn from_name(name: &str) -> Option<Region> {
        Region::ALL.into_iter().find(|r| r.name() == name)
    }
}

/// Which foot an insole is worn on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Side {
    Left,
    Right,
}

/// One cell of a layout in foot coordinates: x to the lateral side, y from heel to toe, origin at the back of the heel on
/// the medial edge.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    pub region: Region,
    /// Centroid, mm.
    pub x_mm: f32,
    pub y_mm: f32,
    /// Sensitive area, mm2, positive.
    pub area_mm2: f32,
}

/// A cell as the sums of its region need it, with coordinates from the region's reference point so that single precision
/// suffices.
#[derive(Clone, Copy, Debug)]
pub struct RegionCell<R> {
    /// Centroid from the reference point, mm.
    x_mm: R,
    y_mm: R,
    area_mm2: R,
    /// Force at the pressure of 1 kPa on the common curve, N.
    n_per_kpa: R,
}

impl<R: Real> RegionCell<R> {
    /// `cell` seen from `(x_mm, y_mm)`, reading `gain` times the common curve.
    pub fn new(cell: &Cell, gain: f32, x_mm: f32, y_mm: f32) -> Self {
        let area_mm2 = R::of_f32(cell.area_mm2);
        Self {
            x_mm: R::of_f32(cell.x_mm) - R::of_f32(x_mm),
            y_mm: R::of_f32(cell.y_mm) - R::of_f32(y_mm),
            area_mm2,
            // 1 kPa on 1 mm2 is 1e-3 N.
            n_per_kpa: area_mm2 * R::of_f32(gain) * R::of(1e-3),
        }
    }

    /// The cell's area, mm2.
    #[inline(always)]
    pub fn area_mm2(&self) -> R {
        self.area_mm2
    }
}

/// Zeroth to second moments of a region's contact area about its reference point: mm2, mm3, mm4.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AreaMoments<R> {
    pub area_mm2: R,
    pub x_mm3: R,
    pub y_mm3: R,
    pub xx_mm4: R,
    pub xy_mm4: R,
    pub yy_mm4: R,
    /// Sum of the cells' areas times their own areas: twelve times what their extents add to `xx_mm4` and `yy_mm4`.
    pub own_mm4: R,
}

impl<R: Real> AreaMoments<R> {
    /// Nothing in contact.
    pub const NONE: Self = Self {
        area_mm2: R::ZERO,
        x_mm3: R::ZERO,
        y_mm3: R::ZERO,
        xx_mm4: R::ZERO,
        xy_mm4: R::ZERO,
        yy_mm4: R::ZERO,
        own_mm4: R::ZERO,
    };

    /// Adds `area_mm2` of a cell's area. The part in contact keeps the cell's centre and extent: a square of the cell's
    /// whole area, variance area / 12 an axis.
    #[inline(always)]
    pub fn add(&mut self, cell: &RegionCell<R>, area_mm2: R) {
        let (x_mm3, y_mm3) = (area_mm2 * cell.x_mm, area_mm2 * cell.y_mm);
        self.area_mm2 += area_mm2;
        self.x_mm3 += x_mm3;
        self.y_mm3 += y_mm3;
        self.xx_mm4 += x_mm3 * cell.x_mm;
        self.xy_mm4 += x_mm3 * cell.y_mm;
        self.yy_mm4 += y_mm3 * cell.y_mm;
        self.own_mm4 += area_mm2 * cell.area_mm2;
    }
}

/// Measured force of a region and its first moments about the reference point. Every cell counts, in contact or not.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ForceMoments<R> {
    pub force_n: R,
    pub x_n_mm: R,
    pub y_n_mm: R,
}

impl<R: Real> ForceMoments<R> {
    /// No force.
    pub const NONE: Self = Self { force_n: R::ZERO, x_n_mm: R::ZERO, y_n_mm: R::ZERO };

    /// Adds a cell that reads `curve_kpa` on the common curve.
    #[inline(always)]
    pub fn add(&mut self, cell: &RegionCell<R>, curve_kpa: R) {
        let force_n = curve_kpa * cell.n_per_kpa;
        self.force_n += force_n;
        self.x_n_mm += force_n * cell.x_mm;
        self.y_n_mm += force_n * cell.y_mm;
    }

    /// Centre of pressure from the reference point, mm; `None` without force.
    pub fn centre_of_pressure_mm(&self) -> Option<(R, R)> {
        (self.force_n > R::ZERO).then(|| (self.x_n_mm / self.force_n, self.y_n_mm / self.force_n))
    }
}

/// What the cells say of one region in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegionFrame<R> {
    pub area: AreaMoments<R>,
    pub force: ForceMoments<R>,
    /// A cell was at the end of its scale: area stands, force is a lower bound.
    pub saturated: bool,
}

impl<R: Real> RegionFrame<R> {
    /// Unloaded.
    pub const NONE: Self = Self { area: AreaMoments::NONE, force: ForceMoments::NONE, saturated: false };
}

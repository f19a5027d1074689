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

/// A cell's part in the sums of its region: area times 1, x, y, x^2, xy, y^2 of the cell's own extent, with coordinates from
/// the region's reference point so that single precision suffices.
#[derive(Clone, Copy, Debug)]
pub struct CellMoments<R> {
    area: R,
    x: R,
    y: R,
    xx: R,
    xy: R,
    yy: R,
    centre_x: R,
    centre_y: R,
}

impl<R: Real> CellMoments<R> {
    /// Moments of `cell` about `(x_mm, y_mm)`. The cell is taken as a square of its area, variance area / 12 an axis.
    pub fn new(cell: &Cell, x_mm: f32, y_mm: f32) -> Self {
        let area = R::of_f32(cell.area_mm2);
        let (dx, dy) = (R::of_f32(cell.x_mm) - R::of_f32(x_mm), R::of_f32(cell.y_mm) - R::of_f32(y_mm));
        let own_variance = area / R::of(12.0);
        Self {
            area,
            x: area * dx,
            y: area * dy,
            xx: area * (dx * dx + own_variance),
            xy: area * dx * dy,
            yy: area * (dy * dy + own_variance),
            centre_x: dx,
            centre_y: dy,
        }
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
}

impl<R: Real> AreaMoments<R> {
    /// Nothing in contact.
    pub const NONE: Self =
        Self { area_mm2: R::ZERO, x_mm3: R::ZERO, y_mm3: R::ZERO, xx_mm4: R::ZERO, xy_mm4: R::ZERO, yy_mm4: R::ZERO };

    /// Adds a cell that is wholly in contact.
    #[inline(always)]
    pub fn add(&mut self, cell: &CellMoments<R>) {
        self.area_mm2 += cell.area;
        self.x_mm3 += cell.x;
        self.y_mm3 += cell.y;
        self.xx_mm4 += cell.xx;
        self.xy_mm4 += cell.xy;
        self.yy_mm4 += cell.yy;
    }

    /// Adds a cell of which `share` (0 to 1) is in contact. The part in contact keeps the cell's centre and extent.
    #[inline(always)]
    pub fn add_share(&mut self, cell: &CellMoments<R>, share: R) {
        self.area_mm2 += cell.area * share;
        self.x_mm3 += cell.x * share;
        self.y_mm3 += cell.y * share;
        self.xx_mm4 += cell.xx * share;
        self.xy_mm4 += cell.xy * share;
        self.yy_mm4 += cell.yy * share;
    }
}

/// Measured force of a region and its first moments: N and N mm about the reference point. Every cell counts, in contact or
/// not.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ForceMoments<R> {
    pub force_n: R,
    pub x_n_mm: R,
    pub y_n_mm: R,
}

impl<R: Real> ForceMoments<R> {
    /// No force.
    pub const NONE: Self = Self { force_n: R::ZERO, x_n_mm: R::ZERO, y_n_mm: R::ZERO };

    /// Adds a cell's pressure, kPa (1 kPa mm2 = 1e-3 N).
    #[inline(always)]
    pub fn add(&mut self, cell: &CellMoments<R>, pressure_kpa: R) {
        let force_mn = pressure_kpa * cell.area;
        self.force_n += force_mn;
        self.x_n_mm += force_mn * cell.centre_x;
        self.y_n_mm += force_mn * cell.centre_y;
    }

    /// From the mN of [`ForceMoments::add`] to N, once a region instead of once a cell.
    pub(crate) fn scaled(self) -> Self {
        let n_per_mn = R::of(1e-3);
        Self { force_n: self.force_n * n_per_mn, x_n_mm: self.x_n_mm * n_per_mn, y_n_mm: self.y_n_mm * n_per_mn }
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

//! Regions: area, measured force and centre of pressure, which are updated in each frame, and second moments of the contact area,
//! which are computed only when an ellipse is needed.

use super::contact::{ContactCell, WHOLE};
pub use super::side::Side;
use crate::num::Real;
use serde::{Deserialize, Serialize};

/// The eight plantar regions of the paper that [`super::model`] implements (Fig. 1), in the order of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Region {
    /// Heel.
    Heel,
    /// Heel-side half of the midfoot.
    PosteriorMidfoot,
    /// Toe-side half of the midfoot.
    AnteriorMidfoot,
    /// Heads of metatarsals 1 and 2.
    Metatarsals12,
    /// Heads of metatarsals 3 to 5.
    Metatarsals35,
    /// Big toe.
    Hallux,
    /// Second toe.
    Toe2,
    /// Third to fifth toe.
    Toes35,
}

impl Region {
    /// All regions, from heel to toes. The position of a region in this array is its index everywhere.
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

    /// Name in files and output, in snake case.
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

    /// The region with this [`Region::name`]; `None` for other names.
    pub fn from_name(name: &str) -> Option<Region> {
        Region::ALL.into_iter().find(|region| region.name() == name)
    }
}

/// One cell of a layout in foot coordinates: x to the lateral side, y from heel to toes, origin at the back of the heel on the
/// medial edge.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Region.
    pub region: Region,
    /// x of the centroid, mm.
    pub x_mm: f32,
    /// y of the centroid, mm.
    pub y_mm: f32,
    /// Sensitive area, mm2, [`MIN_CELL_MM2`] to [`MAX_CELL_MM2`].
    pub area_mm2: f32,
}

/// Number of units of a cell's area in 1 mm2. The units of area and of coordinates are so small that rounding is below the
/// accuracy of any layout, and so large that, within the limits below, the area of a cell and a coordinate fit into 16 bits, the
/// area of a region in units of [`ContactArea`] into 32 bits, and its moments into 64 bits.
const PER_MM2: f32 = 16.0;
/// Number of units of a cell's coordinates in 1 mm.
pub(crate) const PER_MM: f32 = 64.0;
/// Number of units of a [`ContactArea`] in 1 mm2 that is entirely in contact.
const SHARES_PER_MM2: f32 = PER_MM2 * WHOLE as f32;

/// Smallest area of a cell, mm2: one unit.
pub const MIN_CELL_MM2: f32 = 1.0 / PER_MM2;
/// Largest area of a cell, mm2.
pub const MAX_CELL_MM2: f32 = 4_000.0;
/// Largest area of a region, mm2: many times the area of a foot.
pub const MAX_REGION_MM2: f32 = 500_000.0;
/// Largest distance of a cell from its region's reference point along an axis, mm.
pub const MAX_DISTANCE_MM: f32 = 500.0;

/// A cell in the form from which the sums of its region are computed. Coordinates are relative to the reference point of the
/// region, so that single precision suffices.
#[derive(Clone, Copy, Debug)]
pub struct RegionCell<R> {
    /// Force of the cell, N, for 1 kPa on the sensor curve that all cells share: its area times its gain.
    n_per_kpa: R,
    /// First moments of this force about the reference point, N mm.
    x_n_mm_per_kpa: R,
    y_n_mm_per_kpa: R,
    /// Centroid relative to the reference point, in units of 1/[`PER_MM`] mm.
    x: i16,
    y: i16,
    /// Area, in units of 1/[`PER_MM2`] mm2.
    area: u16,
}

impl<R: Real> RegionCell<R> {
    /// A cell of a region with the reference point `(x_mm, y_mm)`, at most [`MAX_DISTANCE_MM`] away along each axis. `gain` is
    /// the ratio of the pressure of the cell to the pressure on the sensor curve that all cells share.
    pub fn new(cell: &Cell, gain: f32, x_mm: f32, y_mm: f32) -> Self {
        let (dx_mm, dy_mm) = (cell.x_mm - x_mm, cell.y_mm - y_mm);
        // 1 kPa on 1 mm2 is 1e-3 N.
        let n_per_kpa = R::of_f32(cell.area_mm2) * R::of_f32(gain) * R::of(1e-3);
        Self {
            n_per_kpa,
            x_n_mm_per_kpa: n_per_kpa * R::of_f32(dx_mm),
            y_n_mm_per_kpa: n_per_kpa * R::of_f32(dy_mm),
            x: (dx_mm * PER_MM).round_i16(),
            y: (dy_mm * PER_MM).round_i16(),
            area: (cell.area_mm2 * PER_MM2).round_u16(),
        }
    }

    /// Force of the cell, N, at a pressure on the sensor curve that all cells share, kPa.
    pub(crate) fn force_n(&self, kpa: R) -> R {
        self.n_per_kpa * kpa
    }

    /// Area of the whole cell, in units of 1/[`SHARES_PER_MM2`] mm2.
    pub(crate) fn whole(&self) -> i32 {
        i32::from(self.area) * i32::from(WHOLE)
    }

    /// Side of a square with the area of the cell, in the units of [`RegionCell::position`].
    pub(crate) fn side(&self) -> i32 {
        // 4 is the root of the 16 units of area in 1 mm2.
        (PER_MM as i32) * u32::from(self.area).isqrt() as i32 / 4
    }

    /// Position of the cell relative to the reference point of its region, in units of 1/[`PER_MM`] mm.
    pub(crate) fn position(&self) -> (i32, i32) {
        (i32::from(self.x), i32::from(self.y))
    }

    /// Position of the cell relative to another cell of the same region, in the same units.
    pub(crate) fn offset_from(&self, other: &Self) -> (i32, i32) {
        (i32::from(self.x) - i32::from(other.x), i32::from(self.y) - i32::from(other.y))
    }
}

/// Contact area of a region. It is an integer, so that changes accumulate no error, and all machines compute the same area.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ContactArea(i32);

impl ContactArea {
    /// No contact.
    pub const NONE: Self = Self(0);

    /// Updates the area after the share of `cell` that is in contact has changed by `share`, in units of 1/[`WHOLE`].
    #[inline(always)]
    pub fn change<R>(&mut self, cell: &RegionCell<R>, share: i32) {
        self.0 += share * i32::from(cell.area);
    }

    /// Adds `other`, an area or the change of an area.
    #[inline(always)]
    pub(crate) fn add(&mut self, other: Self) {
        self.0 += other.0;
    }

    /// The area in units of 1/[`SHARES_PER_MM2`] mm2.
    #[inline(always)]
    pub(crate) fn units(&self) -> i32 {
        self.0
    }

    /// The area in mm2.
    #[inline(always)]
    pub fn area_mm2<R: Real>(&self) -> R {
        R::of_i32(self.0) * R::of(f64::from(1.0 / SHARES_PER_MM2))
    }
}

/// Zeroth to second moments of the contact area of a region about its reference point. They are integers, so that all machines
/// compute the same moments.
///
/// ```
/// use plantar::Region;
/// use plantar::pipeline::contact::WHOLE;
/// use plantar::pipeline::region::{AreaMoments, Cell, RegionCell};
///
/// // A cell of 100 mm2, half of it in contact, 3 mm lateral of the reference point at (40, 20) mm.
/// let cell = Cell { region: Region::Heel, x_mm: 43.0, y_mm: 20.0, area_mm2: 100.0 };
/// let mut moments = AreaMoments::NONE;
/// moments.add(&RegionCell::<f64>::new(&cell, 1.0, 40.0, 20.0), WHOLE / 2);
/// assert_eq!(moments.area().area_mm2::<f64>(), 50.0);
/// let second = moments.second_moments::<f64>().unwrap();
/// assert_eq!((second.x_mm, second.y_mm), (3.0, 0.0));
/// // A square has a variance of its area / 12 along each axis.
/// assert!((second.variance_x_mm2 - 100.0 / 12.0).abs() < 1e-3);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AreaMoments {
    area: ContactArea,
    /// Sums of the area times x, y and their products, with coordinates in units of 1/[`PER_MM`] mm.
    x: i64,
    y: i64,
    xx: i64,
    xy: i64,
    yy: i64,
}

impl AreaMoments {
    /// No contact.
    pub const NONE: Self = Self { area: ContactArea::NONE, x: 0, y: 0, xx: 0, xy: 0, yy: 0 };

    /// Adds a cell of which `share` is in contact, in units of 1/[`WHOLE`]. The part in contact is assumed to have the centre and
    /// the extent of the whole cell: a square of the cell's area, with a variance of area / 12 along each axis.
    pub fn add<R>(&mut self, cell: &RegionCell<R>, share: u16) {
        let area = i32::from(share) * i32::from(cell.area);
        let (x, y) = (i32::from(cell.x), i32::from(cell.y));
        let own_variance = i32::from(cell.area) * (PER_MM * PER_MM / PER_MM2) as i32 / 12;
        let weighted = |moment: i32| i64::from(area) * i64::from(moment);
        self.area.0 += area;
        self.x += weighted(x);
        self.y += weighted(y);
        self.xx += weighted(x * x + own_variance);
        self.xy += weighted(x * y);
        self.yy += weighted(y * y + own_variance);
    }

    /// Contact area.
    pub fn area(&self) -> ContactArea {
        self.area
    }

    /// Mean position and covariance of the contact area; `None` without contact.
    pub fn second_moments<R: Real>(&self) -> Option<SecondMoments<R>> {
        let ContactArea(units) = self.area;
        if units <= 0 {
            return None;
        }
        // The moments are first shifted, in integers, to the mean, truncated to whole coordinate units. Without this shift, the
        // variance of a contact far from the reference point would be a small difference of large squares, which is inaccurate
        // in single precision.
        let area = i64::from(units);
        let (centre_x, centre_y) = (self.x / area, self.y / area);
        let (x, y) = (self.x - centre_x * area, self.y - centre_y * area);
        let xx = self.xx - centre_x * (self.x + x);
        let yy = self.yy - centre_y * (self.y + y);
        let xy = self.xy - centre_x * self.y - centre_y * x;
        let per_area = R::ONE / R::of_i32(units);
        let mean = |sum: i64| R::of_i64(sum) * per_area;
        let (dx, dy) = (mean(x), mean(y));
        let (unit_mm, unit_mm2) = (R::of(f64::from(1.0 / PER_MM)), R::of(f64::from(1.0 / (PER_MM * PER_MM))));
        Some(SecondMoments {
            x_mm: (R::of_i64(centre_x) + dx) * unit_mm,
            y_mm: (R::of_i64(centre_y) + dy) * unit_mm,
            variance_x_mm2: (mean(xx) - dx * dx) * unit_mm2,
            variance_y_mm2: (mean(yy) - dy * dy) * unit_mm2,
            covariance_mm2: (mean(xy) - dx * dy) * unit_mm2,
        })
    }
}

/// Mean position and covariance of a contact area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondMoments<R> {
    /// x of the mean position relative to the reference point of the region, mm.
    pub x_mm: R,
    /// y of the mean position relative to the reference point of the region, mm.
    pub y_mm: R,
    /// Variance along x, mm2.
    pub variance_x_mm2: R,
    /// Variance along y, mm2.
    pub variance_y_mm2: R,
    /// Covariance, mm2.
    pub covariance_mm2: R,
}

/// Measured force of a region and its first moments about the reference point. All cells contribute, whether in contact or not.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ForceMoments<R> {
    /// Force, N.
    pub force_n: R,
    /// First moment in x: sum of force times x, N mm.
    pub x_n_mm: R,
    /// First moment in y: sum of force times y, N mm.
    pub y_n_mm: R,
}

impl<R: Real> ForceMoments<R> {
    /// No force.
    pub const NONE: Self = Self { force_n: R::ZERO, x_n_mm: R::ZERO, y_n_mm: R::ZERO };

    /// Adds the force of a cell. `curve_kpa` is its pressure on the sensor curve that all cells share, before its gain, kPa.
    #[inline(always)]
    pub fn add(&mut self, cell: &RegionCell<R>, curve_kpa: R) {
        self.force_n += curve_kpa * cell.n_per_kpa;
        self.x_n_mm += curve_kpa * cell.x_n_mm_per_kpa;
        self.y_n_mm += curve_kpa * cell.y_n_mm_per_kpa;
    }

    /// Subtracts the residual force of the shoe. If nothing remains, the result is no force.
    #[inline(always)]
    pub(crate) fn subtract(&mut self, residual: &Self) {
        self.force_n -= residual.force_n;
        self.x_n_mm -= residual.x_n_mm;
        self.y_n_mm -= residual.y_n_mm;
        if self.force_n <= R::ZERO {
            *self = Self::NONE;
        }
    }

    /// Centre of pressure relative to the reference point, mm; `None` without force.
    pub fn centre_of_pressure_mm(&self) -> Option<(R, R)> {
        (self.force_n > R::ZERO).then(|| (self.x_n_mm / self.force_n, self.y_n_mm / self.force_n))
    }
}

/// The measured quantities of one region in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegionFrame<R> {
    /// Contact area.
    pub area: ContactArea,
    /// Measured force.
    pub force: ForceMoments<R>,
    /// Largest pressure of a cell above its baseline, kPa. Masked cells are not considered.
    pub peak_kpa: R,
    /// Code of the cell with this pressure, minus the highest code of a baseline in the region; both are codes above zero
    /// pressure. In the next frame, the search for the largest pressure first compares only cells with a code above zero pressure
    /// of more than seven eighths of this value, and all cells only if another one may have the largest pressure.
    pub peak_code: i32,
    /// A cell is saturated: the area is valid, the force is a lower bound.
    pub saturated: bool,
    /// A cell came into contact or lost it in this frame.
    pub is_count_changed: bool,
    /// The sum of the whole areas of all cells in contact, and the largest such sum since the last heel strike, up to the frame
    /// before the sum last changed. Both are in units of 1/16 mm2.
    pub counted: (i32, i32),
}

impl<R: Real> RegionFrame<R> {
    /// The unloaded region.
    pub const NONE: Self = Self {
        area: ContactArea::NONE,
        force: ForceMoments::NONE,
        peak_kpa: R::ZERO,
        peak_code: 0,
        saturated: false,
        is_count_changed: false,
        counted: (0, 0),
    };

    /// Passes the code of a cell to [`ContactCell::update`], and updates the areas of the region.
    #[inline(always)]
    pub(crate) fn update_contact(
        &mut self,
        cell: &RegionCell<R>,
        contact: &mut ContactCell,
        code: u32,
        zero: u16,
        curve_kpa: f32,
    ) {
        let was_loaded = contact.is_loaded();
        let share = contact.update(code, zero, curve_kpa);
        self.area.change(cell, share);
        if contact.is_loaded() != was_loaded {
            // Between two changes in the same frame, the sum is the area of no frame, so only the sum before the first one
            // counts.
            if !self.is_count_changed {
                self.is_count_changed = true;
                self.counted.1 = self.counted_peak();
            }
            self.counted.0 += if was_loaded { -i32::from(cell.area) } else { cell.area.into() };
        }
    }

    /// Restarts the search for the largest counted area with this frame.
    pub(crate) fn restart_count(&mut self) {
        self.counted.1 = self.counted.0;
    }

    /// The largest area of all cells in contact, each with its whole area, since the last heel strike, in units of 1/16 mm2.
    fn counted_peak(&self) -> i32 {
        self.counted.0.max(self.counted.1)
    }

    /// The same in mm2.
    pub(crate) fn counted_peak_mm2(&self) -> R {
        R::of_i32(self.counted_peak()) * R::of(f64::from(1.0 / PER_MM2))
    }
}

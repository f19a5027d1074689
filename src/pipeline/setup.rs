//! The configuration of an insole: geometry, calibration and rules; and its checks.

use super::calibrate::{CellCalibration, SensorLaw};
use super::contact::ContactRule;
use super::measures::Extent;
use super::region::{Cell, MAX_CELL_MM2, MAX_DISTANCE_MM, MAX_REGION_MM2, MIN_CELL_MM2, Region, Side};
use super::stance_rule::StanceRule;
use core::fmt;
use core::ops::Range;
use serde::{Deserialize, Serialize};

/// Largest number of cells that a device processes; a host can process more.
pub const DEVICE_CELLS: usize = 256;

/// Range of the time between frames, us: 500 Hz to 20 Hz. Devices can be set to 50 to 400 Hz.
pub const PERIOD_US: core::ops::RangeInclusive<u32> = 2_000..=50_000;

/// Largest coordinate of a cell, mm; a larger one indicates a wrong unit.
const MAX_COORDINATE_MM: f32 = 10_000.0;

/// The configuration of an insole, except its cells and the tissue parameters of its wearer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// The foot.
    pub side: Side,
    /// Identifies the layout in each hello.
    pub layout_id: u32,
    /// Time between frames, us, within [`PERIOD_US`].
    pub period_us: u32,
    /// The sensor law, common to all cells.
    pub sensor: SensorLaw,
    /// The contact rule.
    pub contact: ContactRule,
    /// The stance rule.
    pub stance: StanceRule,
}

impl Setup {
    /// No configuration, all zeros.
    pub(crate) const NONE: Self = Self {
        side: Side::Left,
        layout_id: 0,
        period_us: 0,
        sensor: SensorLaw { full_kpa: 0.0, exponent: 0.0 },
        contact: ContactRule { on_kpa: 0.0, off_kpa: 0.0, full_kpa: 0.0 },
        stance: StanceRule {
            strike_n: 0.0,
            release_n: 0.0,
            min_stance_ms: 0,
            min_swing_ms: 0,
            max_stance_ms: 0,
            is_adaptive: false,
        },
    };
}

/// The configuration of one cell. Cells are in the order of their codes in a frame, grouped by region in the order of
/// [`Region::ALL`]. An insole stores up to 256 of them in RAM, so the fields are not grouped: with a [`Cell`] and a
/// [`CellCalibration`], which have unused bytes, a configuration would have 28 bytes instead of 20.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SetupCell {
    /// Region.
    pub region: Region,
    /// As [`Cell::x_mm`].
    pub x_mm: f32,
    /// As [`Cell::y_mm`].
    pub y_mm: f32,
    /// As [`Cell::area_mm2`].
    pub area_mm2: f32,
    /// As [`CellCalibration::offset`].
    pub offset: u16,
    /// As [`CellCalibration::gain`].
    pub gain: f32,
    /// Position in the matrix, row times 16 plus column, from which faults of whole rows and columns are recognised. It is
    /// ignored in an insole with more than [`crate::faults::MATRIX_CELLS`] cells.
    pub row_column: u8,
}

impl SetupCell {
    /// The configuration of a cell.
    pub const fn new(cell: Cell, calibration: CellCalibration, row_column: u8) -> Self {
        let Cell { region, x_mm, y_mm, area_mm2 } = cell;
        let CellCalibration { offset, gain } = calibration;
        Self { region, x_mm, y_mm, area_mm2, offset, gain, row_column }
    }

    /// Position, area and region.
    pub const fn cell(&self) -> Cell {
        Cell { region: self.region, x_mm: self.x_mm, y_mm: self.y_mm, area_mm2: self.area_mm2 }
    }

    /// Calibration.
    pub const fn calibration(&self) -> CellCalibration {
        CellCalibration { offset: self.offset, gain: self.gain }
    }

    /// The same cell with another calibration.
    #[must_use]
    pub const fn calibrated(&self, calibration: CellCalibration) -> Self {
        Self { offset: calibration.offset, gain: calibration.gain, ..*self }
    }
}

/// The reason why a configuration was rejected. The previous configuration remains in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetupError {
    /// The frame period is outside of [`PERIOD_US`].
    Period,
    /// The sensor law is out of range.
    Sensor,
    /// The pressures of the contact rule are out of range or not in order.
    Contact,
    /// The forces and times of the stance rule are out of range or not in order.
    Stance,
    /// The configuration has more cells than this device can hold.
    TooManyCells,
    /// The configuration has no cells.
    NoCells,
    /// The cell with this index has a coordinate that exceeds 10 m or is not finite, an area out of range, or an invalid
    /// calibration; or with this cell the extent or the area of its region is too large.
    Cell(u16),
    /// The cell with this index belongs to a region before that of the previous cell.
    RegionOrder(u16),
}

impl fmt::Display for SetupError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Period => write!(f, "frame period outside of {} to {} us", PERIOD_US.start(), PERIOD_US.end()),
            Self::Sensor => f.write_str("sensor law: needs 0 < full_kpa <= 100000, 0.3 <= exponent <= 3"),
            Self::Contact => f.write_str(
                "contact: needs 0 < off_kpa <= on_kpa <= 1000, and full_kpa = 0 or on_kpa <= full_kpa <= 2000",
            ),
            // The text fits into a hello: at most `MAX_FAULT_TEXT` bytes.
            Self::Stance => f.write_str(
                "stance: needs 0 < strike_n, release_n <= 1000, min_stance_ms < max_stance_ms, min_swing_ms > 0",
            ),
            Self::TooManyCells => f.write_str("more cells than this device holds"),
            Self::NoCells => f.write_str("no cells"),
            Self::Cell(i) => {
                write!(f, "cell {i}: coordinates, area or calibration out of range, or its region is too large")
            }
            Self::RegionOrder(i) => write!(f, "cell {i} belongs to a region before that of the previous cell"),
        }
    }
}

impl core::error::Error for SetupError {}

/// The division of the cells into regions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Division {
    /// Index after the last cell of each region; for a region without cells, that of the region before it.
    pub(crate) ends: [usize; 8],
    /// Reference point of each region, foot coordinates, mm: the middle of its extent.
    pub(crate) origins_mm: [(f32, f32); 8],
    /// Extent of the centres of the cells of each region along each axis, mm.
    pub(crate) extents_mm: [(f32, f32); 8],
}

impl Division {
    pub(crate) const NONE: Self = Self { ends: [0; 8], origins_mm: [(0.0, 0.0); 8], extents_mm: [(0.0, 0.0); 8] };

    /// The extent of all cells.
    pub(crate) fn extent(&self) -> Extent {
        // Lowest and highest coordinate of some regions along an axis.
        let range = |regions: Range<usize>, along: fn((f32, f32)) -> f32| {
            regions.filter(|&region| !self.cells(region).is_empty()).fold(
                (f32::MAX, f32::MIN),
                |(low, high), region| {
                    let (origin, half) = (along(self.origins_mm[region]), along(self.extents_mm[region]) * 0.5);
                    (low.min(origin - half), high.max(origin + half))
                },
            )
        };
        let (heel_mm, toe_mm) = range(0..8, |(_, y_mm)| y_mm);
        let metatarsals = Region::Metatarsals12 as usize..Region::Metatarsals35 as usize + 1;
        let (medial_mm, lateral_mm) = range(metatarsals, |(x_mm, _)| x_mm);
        Extent { heel_mm, toe_mm, forefoot_width_mm: lateral_mm - medial_mm }
    }

    /// Index of the region of the cell with index `cell`.
    pub(crate) fn region(&self, cell: usize) -> usize {
        self.ends.partition_point(|&end| end <= cell)
    }

    /// Indices of the cells of a region.
    #[inline]
    pub(crate) fn cells(&self, region: usize) -> Range<usize> {
        let start = region.checked_sub(1).map_or(0, |previous| self.ends[previous]);
        start..self.ends[region]
    }
}

/// Checks a configuration for an insole of at most `capacity` cells. Returns the division of the cells into regions.
///
/// # Errors
/// The first error. The rules are checked first, then the cells in their order.
pub(crate) fn check_setup(
    setup: &Setup,
    cells: impl Iterator<Item = SetupCell>,
    capacity: usize,
) -> Result<Division, SetupError> {
    let checks = [
        (PERIOD_US.contains(&setup.period_us), SetupError::Period),
        (setup.sensor.is_valid(), SetupError::Sensor),
        (setup.contact.is_valid(), SetupError::Contact),
        (setup.stance.is_valid(), SetupError::Stance),
    ];
    match checks.into_iter().find(|(holds, _)| !holds) {
        Some((_, error)) => Err(error),
        None => divide(cells, capacity),
    }
}

/// Checks the cells and divides them into regions.
///
/// # Errors
/// If a cell is invalid, or there are too many cells or none.
fn divide(cells: impl Iterator<Item = SetupCell>, capacity: usize) -> Result<Division, SetupError> {
    let mut counts = [0usize; 8];
    let mut areas_mm2 = [0.0f32; 8];
    let mut corners = [((f32::MAX, f32::MAX), (f32::MIN, f32::MIN)); 8];
    let mut last_region = 0;
    let mut count = 0;
    for cell in cells {
        let number = count as u16;
        count += 1;
        if count > capacity {
            return Err(SetupError::TooManyCells);
        }
        let has_area = (MIN_CELL_MM2..=MAX_CELL_MM2).contains(&cell.area_mm2);
        let is_near = cell.x_mm.abs() <= MAX_COORDINATE_MM && cell.y_mm.abs() <= MAX_COORDINATE_MM;
        if !is_near || !has_area || !cell.calibration().is_valid() {
            return Err(SetupError::Cell(number));
        }
        let region = cell.region as usize;
        if region < last_region {
            return Err(SetupError::RegionOrder(number));
        }
        last_region = region;
        counts[region] += 1;
        areas_mm2[region] += cell.area_mm2;
        let (low, high) = &mut corners[region];
        *low = (low.0.min(cell.x_mm), low.1.min(cell.y_mm));
        *high = (high.0.max(cell.x_mm), high.1.max(cell.y_mm));
        let extent_mm = (high.0 - low.0).max(high.1 - low.1);
        if extent_mm > 2.0 * MAX_DISTANCE_MM || areas_mm2[region] > MAX_REGION_MM2 {
            return Err(SetupError::Cell(number));
        }
    }
    if count == 0 {
        return Err(SetupError::NoCells);
    }
    let mut division = Division::NONE;
    let mut end = 0;
    for region in 0..8 {
        end += counts[region];
        division.ends[region] = end;
        if counts[region] > 0 {
            let (low, high) = corners[region];
            division.origins_mm[region] = ((low.0 + high.0) * 0.5, (low.1 + high.1) * 0.5);
            division.extents_mm[region] = (high.0 - low.0, high.1 - low.1);
        }
    }
    Ok(division)
}

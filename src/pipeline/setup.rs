//! What is configured about an insole: geometry, calibration and rules, and the checks that refuse a configuration.

use super::calibrate::{CellCalibration, SensorLaw};
use super::contact::ContactRule;
use super::region::{Cell, MAX_CELL_MM2, MAX_REACH_MM, MAX_REGION_MM2, MIN_CELL_MM2, Side};
use super::stance::StanceRule;
use core::fmt;
use serde::{Deserialize, Serialize};

/// Cells that a device holds; a host may hold more.
pub const DEVICE_CELLS: usize = 256;

/// Shortest and longest time between frames, us: 500 Hz to 20 Hz. Devices run at 50 to 400 Hz, recordings beyond.
pub const PERIOD_US: core::ops::RangeInclusive<u32> = 2_000..=50_000;

/// Cells lie within this distance of the origin along an axis, mm: any sheet, in any unit that was meant.
const FARTHEST_MM: f32 = 10_000.0;

/// Everything that is set about an insole except its cells and its wearer's tissue.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// The foot.
    pub side: Side,
    /// Identifies the layout in every hello.
    pub layout_id: u32,
    /// Time between frames, us, within [`PERIOD_US`].
    pub period_us: u32,
    /// The cells' common law.
    pub sensor: SensorLaw,
    /// What counts as contact.
    pub contact: ContactRule,
    /// What counts as a step.
    pub stance: StanceRule,
}

impl Setup {
    /// All zero.
    pub(crate) const NONE: Self = Self {
        side: Side::Left,
        layout_id: 0,
        period_us: 0,
        sensor: SensorLaw { full_kpa: 0.0, exponent: 0.0 },
        contact: ContactRule { on_kpa: 0.0, off_kpa: 0.0, full_kpa: 0.0 },
        stance: StanceRule { strike_n: 0.0, release_n: 0.0, min_stance_ms: 0, min_swing_ms: 0, max_stance_ms: 0 },
    };
}

/// One cell as it is set up: where it lies and how it reads. Cells come in the order of their codes in a frame, grouped by
/// region in the order of [`super::region::Region::ALL`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SetupCell {
    /// Where it lies.
    pub cell: Cell,
    /// How it reads.
    pub calibration: CellCalibration,
    /// Position in the matrix, row times 16 plus column: lets faults of a whole line be recognised. Ignored in an insole of more
    /// than [`crate::faults::MATRIX_CELLS`] cells.
    pub row_column: u8,
}

/// Why a set-up was refused; the one before stays in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetupError {
    /// The frame period is outside of [`PERIOD_US`].
    Period,
    /// Sensor law out of range.
    Sensor,
    /// Contact rule out of range or order.
    Contact,
    /// Stance rule out of range or order.
    Stance,
    /// More cells than this device holds.
    TooManyCells,
    /// No cells at all.
    NoCells,
    /// This cell is not finite or metres away, has no or too much area, lies too far from its region, or has a bad calibration.
    Cell(u16),
    /// This cell's region comes before the one of the cell before it.
    RegionOrder(u16),
}

impl fmt::Display for SetupError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Period => write!(f, "frame period outside of {} to {} us", PERIOD_US.start(), PERIOD_US.end()),
            Self::Sensor => f.write_str("sensor law out of range"),
            Self::Contact => f.write_str("contact rule out of range: needs 0 < off_kpa <= on_kpa <= full_kpa"),
            Self::Stance => {
                f.write_str("stance rule out of range: needs 0 < release_n <= strike_n and rising durations")
            }
            Self::TooManyCells => f.write_str("more cells than this device holds"),
            Self::NoCells => f.write_str("no cells"),
            Self::Cell(i) => write!(
                f,
                "cell {i} is not finite, has no or too much area, lies too far from its region, or has a bad calibration"
            ),
            Self::RegionOrder(i) => write!(f, "cell {i} is out of the order of regions"),
        }
    }
}

impl core::error::Error for SetupError {}
/// How the cells divide into regions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Division {
    /// One past the last cell of each region.
    pub(crate) ends: [usize; 8],
    /// The middle of each region in foot coordinates, mm: the reference point of its moments.
    pub(crate) origins_mm: [(f32, f32); 8],
}

impl Division {
    pub(crate) const NONE: Self = Self { ends: [0; 8], origins_mm: [(0.0, 0.0); 8] };
}

/// Checks a whole configuration for an insole of at most `capacity` cells; how the cells divide into regions.
///
/// # Errors
/// The first [`SetupError`] in the order of its variants.
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

/// The division of these cells, or what is wrong with them.
fn divide(cells: impl Iterator<Item = SetupCell>, capacity: usize) -> Result<Division, SetupError> {
    let mut counts = [0usize; 8];
    let mut areas_mm2 = [0.0f32; 8];
    let mut corners = [((f32::MAX, f32::MAX), (f32::MIN, f32::MIN)); 8];
    let mut last = 0;
    let mut count = 0;
    for SetupCell { cell, calibration, .. } in cells {
        let number = count as u16;
        count += 1;
        if count > capacity {
            return Err(SetupError::TooManyCells);
        }
        let has_area = (MIN_CELL_MM2..=MAX_CELL_MM2).contains(&cell.area_mm2);
        let is_near = cell.x_mm.abs() <= FARTHEST_MM && cell.y_mm.abs() <= FARTHEST_MM;
        if !is_near || !has_area || !calibration.is_valid() {
            return Err(SetupError::Cell(number));
        }
        let region = cell.region as usize;
        if region < last {
            return Err(SetupError::RegionOrder(number));
        }
        last = region;
        counts[region] += 1;
        areas_mm2[region] += cell.area_mm2;
        let (low, high) = &mut corners[region];
        *low = (low.0.min(cell.x_mm), low.1.min(cell.y_mm));
        *high = (high.0.max(cell.x_mm), high.1.max(cell.y_mm));
        let extent_mm = (high.0 - low.0).max(high.1 - low.1);
        if extent_mm > 2.0 * MAX_REACH_MM || areas_mm2[region] > MAX_REGION_MM2 {
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
        }
    }
    Ok(division)
}

//! The orientation of a foot on its sensor, from the distribution of the pressure over space and time.
//!
//! In a stance, the centre of pressure moves from the heel to the toes, the load of the midfoot is on its lateral side, and the
//! hallux carries more than the lesser toes. These rules hold for most people, not for all. So they determine the orientation
//! only where an export does not state it; where it does, a contradiction leads to a warning.

use crate::template::{self, FOREFOOT, HEEL};
use crate::text::significant;
use crate::{Cell, Clipping, Recording};
use plantar::{Region, Side};

/// Fraction of the largest force above which the foot is on the ground.
const IN_STANCE: f64 = 0.1;
/// Least movement of the centre of pressure in a step that shows the direction of walking, as a fraction of the length of the
/// foot.
const LEAST_MOVEMENT: f64 = 0.1;
/// Further bands across the foot. Like [`HEEL`] and [`FOREFOOT`], each lies between two fractions of the length of the foot.
const MIDFOOT: [f64; 2] = [0.32, 0.52];
const TOES: [f64; 2] = [0.84, 1.0];
/// Least asymmetry towards the wrong side that indicates a mirrored layout, as a fraction of the width of the forefoot.
const LEAST_ASYMMETRY: f64 = 0.05;
/// Least extent of the centres of the cells under a whole foot, mm. The number for the largest foot in cm, or for any foot in
/// inches, is smaller.
const LEAST_EXTENT_MM: f64 = 80.0;
/// Least total area of the cells under a whole foot, mm2. The number for an insole in cm2 is smaller.
const LEAST_AREA_MM2: f64 = 250.0;
/// Least plausible value of the largest force in a recording with a step, N. A child of 20 kg weighs 196 N. If pressures in N/cm2
/// were read as kPa, the force of a walking adult appears to be a tenth of its value, which is below this limit. With PSI, it
/// appears to be a seventh, which is below this limit for forces up to about 1030 N.
const LEAST_FORCE_N: f64 = 150.0;
/// Largest force on a foot that walking and running lead to, N: three times the weight of a runner of 135 kg.
const MOST_FORCE_N: f64 = 4000.0;
/// Largest asymmetry that rounding may cause, as a fraction of the width of the forefoot.
const NO_ASYMMETRY: f64 = 1e-3;

/// The pressures on the cells of a sensor. The origin of the cells' coordinates is arbitrary; the methods state the
/// directions of x and y that they require.
pub(crate) struct Footprint<'a> {
    pub cells: &'a [Cell],
    /// For each cell, whether it is under the foot. The other cells are ignored, because they may respond to noise.
    pub under_foot: &'a [bool],
    /// All cells of the first frame, then those of the second one, and so on.
    pub pressure_kpa: &'a [f32],
}

impl Footprint<'_> {
    /// The foot, determined from the distribution of its load; `None` if the distribution does not show it. y must point to the
    /// toes, and x to the right as seen from above.
    pub fn side(&self) -> Option<Side> {
        let asymmetry = self.lateral_asymmetry().filter(|asymmetry| asymmetry.abs() > NO_ASYMMETRY)?;
        Some(if asymmetry < 0.0 { Side::Left } else { Side::Right })
    }

    /// The direction from heel to toes: a unit vector along the longer extent of the foot. `None` if the centre of pressure
    /// does not clearly move along this extent.
    pub fn walking_direction(&self) -> Option<[f64; 2]> {
        let [width_mm, height_mm] = [|c: &Cell| c.x_mm, |c: &Cell| c.y_mm].map(|along| {
            let [low_mm, high_mm] = self.extent_mm(along);
            high_mm - low_mm
        });
        let (axis, length_mm) = if width_mm > height_mm { (0, width_mm) } else { (1, height_mm) };
        let movements_mm = self.movements_mm();
        let movement_mm = movements_mm.iter().map(|m| m[axis]).sum::<f64>() / movements_mm.len() as f64;
        let is_clear = movement_mm.abs() > LEAST_MOVEMENT * length_mm;
        let sign = movement_mm.signum();
        is_clear.then_some(if axis == 0 { [sign, 0.0] } else { [0.0, sign] })
    }

    /// The movement of the mean centre of pressure, mm, from the first to the last third of each stance.
    fn movements_mm(&self) -> Vec<[f64; 2]> {
        let centres: Vec<_> =
            self.pressure_kpa.chunks_exact(self.cells.len()).map(|frame| self.centre(frame)).collect();
        let largest_mn = centres.iter().map(|centre| centre.2).fold(0.0, f64::max);
        let is_stance = |centre: &(f64, f64, f64)| centre.2 > IN_STANCE * largest_mn;
        let stances = centres.chunk_by(|a, b| is_stance(a) == is_stance(b)).filter(|part| is_stance(&part[0]));
        stances
            .filter(|stance| stance.len() >= 3)
            .map(|stance| {
                let third = stance.len() / 3;
                let mean = |part: &[(f64, f64, f64)]| {
                    let sum = part.iter().fold((0.0, 0.0, 0.0), |s, c| (s.0 + c.0 * c.2, s.1 + c.1 * c.2, s.2 + c.2));
                    [sum.0 / sum.2, sum.1 / sum.2]
                };
                let (first, last) = (mean(&stance[..third]), mean(&stance[stance.len() - third..]));
                [last[0] - first[0], last[1] - first[1]]
            })
            .collect()
    }

    /// The centre of pressure of a frame, mm, and the force on the foot in this frame, mN.
    fn centre(&self, frame: &[f32]) -> (f64, f64, f64) {
        let mut sum = (0.0, 0.0, 0.0);
        for ((cell, &kpa), _) in self.cells.iter().zip(frame).zip(self.under_foot).filter(|(_, is_under)| **is_under) {
            let force_mn = f64::from(kpa) * cell.area_mm2;
            sum = (sum.0 + cell.x_mm * force_mn, sum.1 + cell.y_mm * force_mn, sum.2 + force_mn);
        }
        if sum.2 > 0.0 { (sum.0 / sum.2, sum.1 / sum.2, sum.2) } else { (0.0, 0.0, 0.0) }
    }

    /// The least and the largest coordinate of the cells under the foot, mm.
    fn extent_mm(&self, along: fn(&Cell) -> f64) -> [f64; 2] {
        let under = self.cells.iter().zip(self.under_foot).filter(|(_, is_under)| **is_under);
        extent_mm(under.map(|(cell, _)| cell), along)
    }

    /// How far the load of the midfoot lies to the +x side of the line through the centres of load of heel and forefoot, plus
    /// how far the load of the toes lies to its -x side, as a fraction of the width of the forefoot. It is positive if +x is
    /// lateral. y must point to the toes. `None` if the heel or the forefoot is never loaded, or the forefoot has no width.
    fn lateral_asymmetry(&self) -> Option<f64> {
        let mut pressure_sum_kpa = vec![0.0f64; self.cells.len()];
        for frame in self.pressure_kpa.chunks_exact(self.cells.len()) {
            pressure_sum_kpa.iter_mut().zip(frame).for_each(|(sum, &kpa)| *sum += f64::from(kpa));
        }
        let [back_mm, front_mm] = self.extent_mm(|c| c.y_mm);
        let in_band = |band: [f64; 2]| {
            let range = band.map(|fraction| back_mm + fraction * (front_mm - back_mm));
            let cells = self.cells.iter().zip(&pressure_sum_kpa).zip(self.under_foot);
            cells
                .filter(move |((cell, _), is_under)| **is_under && (range[0]..=range[1]).contains(&cell.y_mm))
                .map(|(c, _)| c)
        };
        let centre_mm = |band: [f64; 2]| {
            let sum = in_band(band).fold((0.0, 0.0), |sum, (cell, pressure_sum_kpa)| {
                (sum.0 + cell.x_mm * pressure_sum_kpa * cell.area_mm2, sum.1 + pressure_sum_kpa * cell.area_mm2)
            });
            (sum.1 > 0.0).then(|| sum.0 / sum.1)
        };
        let (heel_mm, forefoot_mm) = (centre_mm(HEEL)?, centre_mm(FOREFOOT)?);
        let x_mm = || in_band(FOREFOOT).map(|(cell, _)| cell.x_mm);
        let width_mm = x_mm().fold(f64::NEG_INFINITY, f64::max) - x_mm().fold(f64::INFINITY, f64::min);
        let middle = |band: [f64; 2]| (band[0] + band[1]) / 2.0;
        let share = (middle(MIDFOOT) - middle(HEEL)) / (middle(FOREFOOT) - middle(HEEL));
        let arch_mm = centre_mm(MIDFOOT).map_or(0.0, |x_mm| x_mm - heel_mm - share * (forefoot_mm - heel_mm));
        // The toes are in front of the forefoot, so the line from heel to forefoot is extended to them: this value is above 1.
        let beyond = (middle(TOES) - middle(HEEL)) / (middle(FOREFOOT) - middle(HEEL));
        let toes_mm = centre_mm(TOES).map_or(0.0, |x_mm| x_mm - heel_mm - beyond * (forefoot_mm - heel_mm));
        (width_mm > 0.0).then_some((arch_mm - toes_mm) / width_mm)
    }
}

/// Warnings, each with a remedy. At most one concerns the layout, the first of these that applies: it seems to be in another
/// unit, to have exchanged axes, to be upside down or to be mirrored. A second one concerns pressures that seem to be in another
/// unit, unless the layout seems to be in another unit. A third one concerns pressures that the range of the sensor seems to
/// limit. Empty if none applies.
pub fn warnings(recording: &Recording) -> Vec<String> {
    let layout = size_warning(recording).or_else(|| orientation_warning(recording));
    let force = force_warning(recording, LEAST_FORCE_N);
    layout.into_iter().chain(force).chain(Clipping::of(recording).warning()).collect()
}

/// Those of the [`warnings`] that apply to any recording, whatever the person does: the layout seems to be in another unit or to
/// have exchanged axes, the largest force is larger than that of a person, and the range of the sensor seems to limit the
/// pressures.
pub fn unit_warnings(recording: &Recording) -> Vec<String> {
    let force = force_warning(recording, 0.0);
    size_warning(recording).into_iter().chain(force).chain(Clipping::of(recording).warning()).collect()
}

/// The least and the largest coordinate of cells, mm.
fn extent_mm<'c>(cells: impl Iterator<Item = &'c Cell>, along: fn(&Cell) -> f64) -> [f64; 2] {
    cells.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], cell| [low.min(along(cell)), high.max(along(cell))])
}

/// The extents of the centres of the cells of a layout, and the total area of the cells.
struct Size {
    width_mm: f64,
    length_mm: f64,
    area_mm2: f64,
}

impl Size {
    fn new(cells: &[Cell]) -> Self {
        let length_mm = |along: fn(&Cell) -> f64| {
            let [low_mm, high_mm] = extent_mm(cells.iter(), along);
            high_mm - low_mm
        };
        let area_mm2 = cells.iter().map(|cell| cell.area_mm2).sum();
        Self { width_mm: length_mm(|c| c.x_mm), length_mm: length_mm(|c| c.y_mm), area_mm2 }
    }

    /// True if the layout of a whole foot must be in another unit.
    fn is_in_other_unit(&self) -> bool {
        self.width_mm.max(self.length_mm) < LEAST_EXTENT_MM || self.area_mm2 < LEAST_AREA_MM2
    }
}

/// A warning if the layout seems to be in another unit, or to have exchanged axes.
fn size_warning(recording: &Recording) -> Option<String> {
    let size @ Size { width_mm, length_mm, area_mm2 } = &Size::new(&recording.layout.cells);
    let side = recording.side.name();
    if size.is_in_other_unit() {
        Some(format!(
            "The cells of the {side} foot extend over {:.1} mm, and have {area_mm2:.0} mm2 in total. If the layout is that of a \
             whole foot, it is in another unit, and the forces are wrong: state x_mm and y_mm in mm, and area_mm2 in mm2.",
            width_mm.max(*length_mm)
        ))
    } else if width_mm > length_mm {
        Some(format!(
            "The layout of the {side} foot is wider ({width_mm:.0} mm) than long ({length_mm:.0} mm): the axes may be \
             exchanged. x_mm increases from the medial to the lateral edge, and y_mm from the heel to the toes."
        ))
    } else {
        None
    }
}

/// A warning if the foot seems to be upside down or mirrored in its layout.
fn orientation_warning(recording: &Recording) -> Option<String> {
    let cells = &recording.layout.cells;
    let under_foot = vec![true; cells.len()];
    let footprint = Footprint { cells, under_foot: &under_foot, pressure_kpa: &recording.pressure_kpa };
    let movements_mm = footprint.movements_mm();
    let least_mm = LEAST_MOVEMENT * Size::new(cells).length_mm;
    // While a person stands, the centre of pressure does not move from end to end.
    let mut steps_mm = movements_mm.iter().map(|m| m[1]).filter(|y_mm| y_mm.abs() > least_mm).peekable();
    let is_upside_down = steps_mm.peek().is_some() && steps_mm.all(|y_mm| y_mm < 0.0);
    let is_mirrored = || {
        footprint.lateral_asymmetry().is_some_and(|asymmetry| asymmetry < -LEAST_ASYMMETRY)
            && lesser_toes_exceed_hallux(recording)
    };
    let side = recording.side.name();
    if is_upside_down {
        Some(format!(
            "The {side} foot looks upside down: the forefoot is loaded before the heel in every step. If the person \
             neither walked backwards or down stairs nor on the toes, turn the layout by 180 degrees in the vendor's program, \
             or correct y_mm in a layout file."
        ))
    } else if is_mirrored() {
        Some(format!(
            "The {side} foot looks mirrored: the lesser toes carry more than the hallux, and the load of midfoot and toes is \
             distributed as in the other foot. If it is the other foot, state it with --side; otherwise mirror the layout in \
             the vendor's program, or correct x_mm in a layout file."
        ))
    } else {
        None
    }
}

/// A warning if the largest force is less than `least_n` or larger than that of a person, because the pressures may be in another
/// unit. A recording without any load leads to none, and neither does a layout that seems to be in another unit.
fn force_warning(recording: &Recording, least_n: f64) -> Option<String> {
    if Size::new(&recording.layout.cells).is_in_other_unit() {
        return None;
    }
    let largest_n = (0..recording.frames()).map(|i| recording.force_n(i)).fold(0.0, f64::max);
    let reason = if largest_n > MOST_FORCE_N {
        "more than a foot carries in running: unless the recording contains jumps, check"
    } else if 0.0 < largest_n && largest_n < least_n {
        "less than that of a person of 20 kg in walking: if the recording contains a step on the whole foot, check"
    } else {
        return None;
    };
    Some(format!(
        "The largest force on the {} foot is {} N, {reason} the unit of the pressures or forces in the original data. Pressures \
         of a recording, and those in a file for `plantar import csv`, are in kPa.",
        recording.side.name(),
        significant(largest_n)
    ))
}

/// Whether the force-time integral of toes 3 to 5 exceeds that of the hallux, in the regions of the template.
fn lesser_toes_exceed_hallux(recording: &Recording) -> bool {
    let mut cells = recording.layout.cells.clone();
    template::assign(&mut cells);
    let mut integrals = [0.0; 8];
    for frame in recording.pressure_kpa.chunks_exact(cells.len()) {
        for (cell, &kpa) in cells.iter().zip(frame) {
            integrals[cell.region as usize] += f64::from(kpa) * cell.area_mm2;
        }
    }
    integrals[Region::Toes35 as usize] > integrals[Region::Hallux as usize]
}

/// The name of the foot with a capital letter, for the beginning of a sentence.
pub(crate) fn capitalised(side: Side) -> &'static str {
    match side {
        Side::Left => "Left",
        Side::Right => "Right",
    }
}

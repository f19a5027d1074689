//! Matrix sensors: equal cells in rows and columns, in an insole or a pressure plate.

use crate::assembly::UncheckedRecording;
use crate::earlier::{EarlierRecording, refuse_plate};
use crate::footprint::{Footprint, capitalised};
use crate::gaps::{GAP_INTERVALS, median_interval_s};
use crate::negatives::Negatives;
use crate::rate::MIN_HZ;
use crate::text::seconds;
use crate::{Cell, Error, Layout, Result, Sheet, check, template};
use plantar::pipeline::stance_rule::StanceRule;
use plantar::{Region, Side};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Largest number of rows and of columns. The largest plates have a few hundred of each.
pub const MAX_LINES: usize = 4096;
/// Largest plausible width and height of a cell, mm.
pub const MAX_CELL_MM: f64 = 60.0;

/// A plate's first and last frame carry less than this fraction of the largest load, unless a part of the contact is missing.
const CUT_SHARE: f32 = 0.3;

/// Unloaded time that [`Frames::with_swing`] adds before and after a step, s.
pub const SWING_S: f64 = crate::jiku::SWING_S;
/// Shortest plausible time between frames, s. No matrix sensor records faster, and with a shorter time the number of frames that
/// [`Frames::with_swing`] adds would have no limit.
const SHORTEST_PERIOD_S: f64 = 1e-4;
/// Longest time between frames of a measurement over time, s: that at the lowest plausible rate.
const LONGEST_PERIOD_S: f64 = 1.0 / MIN_HZ;

/// Checks that the time between frames, s, is plausible. Messages begin with `place`.
pub fn check_period(period_s: f64, place: &dyn Fn() -> String) -> Result<()> {
    /// Largest rounding error of a period that is computed from times, as a fraction of the period.
    const ROUNDING: f64 = 1e-6;
    if (SHORTEST_PERIOD_S * (1.0 - ROUNDING)..=LONGEST_PERIOD_S * (1.0 + ROUNDING)).contains(&period_s) {
        return Ok(());
    }
    let problem = format!(
        "a frame every {} s, expected one every {SHORTEST_PERIOD_S:e} to {LONGEST_PERIOD_S} s",
        seconds(period_s)
    );
    Err(Error::content(place(), problem, "export a measurement over time, with its times"))
}

/// The geometry of a matrix sensor as a picture: seen from above, with rows numbered from the top and columns from the left.
pub struct Grid {
    /// Distance between neighbouring rows, mm.
    pub row_mm: f64,
    /// Distance between neighbouring columns, mm.
    pub column_mm: f64,
    /// The direction of the toes in the picture.
    pub toes: Toes,
}

/// The direction of the toes in the picture of a matrix sensor.
#[derive(Clone, Copy, PartialEq)]
pub enum Toes {
    /// At the top, as in an insole.
    Top,
    /// Towards any of the four edges, as on a plate. The edge is determined from the movement of the centre of pressure along the
    /// longer extent of the footprint.
    AlongMovement,
}

/// The frames of one matrix sensor. Only loaded cells take memory.
#[derive(Default)]
pub struct Frames {
    /// Time of each frame, s.
    pub t_s: Vec<f64>,
    loads: Vec<Load>,
    negatives: Negatives,
}

/// The pressure of one loaded cell in one frame.
struct Load {
    frame: usize,
    /// Row and column.
    cell: (usize, usize),
    kpa: f32,
}

impl Frames {
    /// Begins a frame, to which the following loads belong.
    pub fn begin(&mut self, t_s: f64) {
        self.t_s.push(t_s);
    }

    /// Adds the pressure of the cell at this row and column to the last frame that began. A negative pressure counts as 0, and
    /// [`Foot::recording`] adds a remark about it.
    pub fn add(&mut self, row: usize, column: usize, kpa: f32) {
        let kpa = self.negatives.clip(kpa);
        if kpa > 0.0 {
            self.loads.push(Load { frame: self.t_s.len().saturating_sub(1), cell: (row, column), kpa });
        }
    }

    /// The same frames with unloaded frames for [`SWING_S`] before and after them. The interval between unloaded frames is the
    /// mean interval between successive frames, gaps excluded. The times of all frames are shifted by [`SWING_S`], so that
    /// several feet remain on a common clock.
    ///
    /// A plate records from the first contact on, so that its first frame may carry load. Without an unloaded frame before it,
    /// the analysis ignores the step, because a contact in the first frame of a recording may have begun earlier.
    ///
    /// This method must be called before gaps are filled. If the recording is then cut at a long gap, there are no unloaded
    /// frames at the cut, so that the cut is not mistaken for a heel strike or toe off.
    ///
    /// Adds to `remarks` if the export may be cut off within the contact of the foot `side`.
    ///
    /// # Errors
    /// Fails if the time between frames is not plausible: see [`check_period`]. The message names `path`.
    pub fn with_swing(mut self, side: Option<Side>, path: &Path, remarks: &mut Vec<String>) -> Result<Self> {
        let (Some(&first_s), Some(&last_s)) = (self.t_s.first(), self.t_s.last()) else { return Ok(self) };
        // A single frame has no rate. The check of the rate in `Foot::recording` reports this.
        let Some(median_s) = median_interval_s(&self.t_s) else { return Ok(self) };
        let mut intervals_s: Vec<f64> = self.t_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        intervals_s.retain(|interval_s| *interval_s <= GAP_INTERVALS * median_s);
        // If the times are rounded, the mean interval is hardly affected; the median is.
        let period_s = intervals_s.iter().sum::<f64>() / intervals_s.len() as f64;
        check_period(period_s, &|| path.display().to_string())?;
        self.note_cut(side, None, remarks);
        // The small addend includes a frame that would be left out only because of rounding.
        let added = ((SWING_S / period_s + 1e-6).floor() as usize).max(1);
        let mut t_s = Vec::with_capacity(self.t_s.len() + 2 * added);
        t_s.extend((1..=added).rev().map(|i| first_s + SWING_S - i as f64 * period_s));
        t_s.extend(self.t_s.iter().map(|now_s| now_s + SWING_S));
        t_s.extend((1..=added).map(|i| last_s + SWING_S + i as f64 * period_s));
        self.t_s = t_s;
        self.loads.iter_mut().for_each(|load| load.frame += added);
        Ok(self)
    }

    /// The number of frames in which some cell has a pressure of at least `kpa`, and the number of cells that reach this pressure
    /// in some frame.
    pub fn count_reaching(&self, kpa: f32) -> [usize; 2] {
        let reaching = || self.loads.iter().filter(|load| load.kpa >= kpa);
        let frames: BTreeSet<_> = reaching().map(|load| load.frame).collect();
        let cells: BTreeSet<_> = reaching().map(|load| load.cell).collect();
        [frames.len(), cells.len()]
    }

    /// The pressures of the cells at the rows and columns in `indices`, kPa: all of the first frame, then those of the second
    /// one, and so on. The loads of other sensors are left out. Messages name `file`.
    fn pressures(&self, indices: &BTreeMap<(usize, usize), usize>, file: &str) -> Result<Vec<f32>> {
        check::value_count(self.t_s.len() as u64, indices.len(), file)?;
        let mut pressure_kpa = vec![0.0; self.t_s.len() * indices.len()];
        for load in &self.loads {
            if let Some(index) = indices.get(&load.cell) {
                pressure_kpa[load.frame * indices.len() + index] = load.kpa;
            }
        }
        Ok(pressure_kpa)
    }

    /// The load on sensors at other rows and columns than those in `indices`.
    fn outside(&self, indices: &BTreeMap<(usize, usize), usize>) -> Outside {
        let outside = || self.loads.iter().filter(|load| !indices.contains_key(&load.cell));
        let mut sums_kpa = vec![0.0f32; self.t_s.len()];
        outside().for_each(|load| sums_kpa[load.frame] += load.kpa);
        let sum = |loads: &mut dyn Iterator<Item = &Load>| loads.map(|load| f64::from(load.kpa)).sum::<f64>();
        Outside {
            sensors: outside().map(|load| load.cell).collect::<BTreeSet<_>>().len(),
            share: sum(&mut outside()) / sum(&mut self.loads.iter()),
            most_kpa: sums_kpa.into_iter().fold(0.0, f32::max),
        }
    }

    /// The time of the first frame, s, if it carries load.
    pub fn loaded_start_s(&self) -> Option<f64> {
        self.t_s.first().copied().filter(|_| self.loads.iter().any(|load| load.frame == 0))
    }

    /// Adds to `remarks` if the first or last frame carries more than [`CUT_SHARE`] of the largest load or, without added
    /// frames, so much that stance detection finds no heel strike or no toe off. `cell_mm2` is the area of a cell, mm2; `None`
    /// if unloaded frames are added. The remark names the foot `side`, if it is known.
    pub fn note_cut(&self, side: Option<Side>, cell_mm2: Option<f64>, remarks: &mut Vec<String>) {
        let mut sums = vec![0.0; self.t_s.len()];
        self.loads.iter().for_each(|load| sums[load.frame] += load.kpa);
        let most = sums.iter().copied().fold(0.0, f32::max);
        let newtons = |sum: f32| cell_mm2.map_or(0.0, |mm2| f64::from(sum) * mm2 * 1e-3);
        let the = beginning(side);
        let ends = [("first", "heel strike", "before", sums.first()), ("last", "toe off", "after", sums.last())];
        for (name, event, place, sum) in ends {
            let Some(&sum) = sum else { continue };
            let (force_n, release_n) = (newtons(sum), f64::from(StanceRule::ADAPTIVE.release_n));
            if force_n >= release_n {
                remarks.push(format!(
                    "{the} {name} frame carries {force_n:.0} N: from {release_n:.0} N on, the contact does not become \
                     a step, because its {event} is missing; export unloaded frames {place} it."
                ));
            } else if sum > CUT_SHARE * most {
                let percent = 100.0 * sum / most;
                remarks.push(format!(
                    "{the} {name} frame carries {percent:.0} % of the largest load: a part of the contact may be \
                     missing; export all of it."
                ));
            }
        }
    }
}

/// A foot on a matrix sensor.
pub struct Foot<'a> {
    /// The foot, if the user or the content of the export states it.
    pub side: Option<Side>,
    /// The foot that the name of the file states. It is used if `side` is `None`. If both are `None`, the shape of the footprint
    /// decides; if the shape does not show which foot it is, the right foot is assumed.
    pub named: Option<Side>,
    pub grid: Grid,
    /// Earlier recordings, of which that of the same foot states the layout. If there are none, the layout is fitted to the
    /// loaded cells.
    pub earlier: &'a [EarlierRecording],
    pub frames: Frames,
    /// Name of the layout.
    pub name: String,
    /// Provenance, in sentences.
    pub source: String,
}

impl Foot<'_> {
    /// The recording of this foot. Its cells are those that carry load in at least one frame, or those of an earlier recording.
    /// Sentences about decisions of the import are added to `remarks`.
    ///
    /// # Errors
    /// Fails if no cell is ever loaded, the frames violate a rule of recordings, or the layout of the earlier recording does not
    /// apply. Messages name `path` or the earlier recording.
    pub fn recording(self, path: &Path, remarks: &mut Vec<String>) -> Result<UncheckedRecording> {
        let file = path.display().to_string();
        let mut indices: BTreeMap<_, usize> = self.frames.loads.iter().map(|load| (load.cell, 0)).collect();
        if indices.is_empty() {
            return Err(Error::content(
                file,
                "no cell is ever loaded",
                "export a measurement in which a foot carries load",
            ));
        }
        if let Some((row, column)) = indices.keys().find(|(row, column)| *row >= MAX_LINES || *column >= MAX_LINES) {
            let problem = format!("a load at row {row}, column {column}");
            let remedy = format!("export at most {MAX_LINES} rows and columns");
            return Err(Error::content(file, problem, remedy));
        }
        let side = self.side.or(self.named);
        let earlier = match side.filter(|_| self.grid.toes == Toes::Top) {
            _ if self.earlier.is_empty() => None,
            Some(side) => EarlierRecording::of(self.earlier, side, path)?,
            None => return Err(refuse_plate(path)),
        };
        if let Some(earlier) = earlier {
            return self.recording_like(earlier, path, remarks);
        }
        let Self { side: stated, named, grid, mut frames, name, source, .. } = self;
        indices.values_mut().enumerate().for_each(|(i, index)| *index = i);
        let pressure_kpa = frames.pressures(&indices, &file)?;
        drop(std::mem::take(&mut frames.loads));
        // In the plane of the picture, x to the right and y to the top.
        let area_mm2 = grid.row_mm * grid.column_mm;
        let mut cells: Vec<Cell> = indices
            .keys()
            .map(|&(row, column)| Cell {
                x_mm: column as f64 * grid.column_mm,
                y_mm: -(row as f64) * grid.row_mm,
                area_mm2,
                // Replaced by the template below.
                region: Region::Heel,
            })
            .collect();
        let under_foot = under_foot(&indices, &pressure_kpa);
        let mut half_mm = [grid.column_mm / 2.0, grid.row_mm / 2.0];
        if grid.toes == Toes::AlongMovement {
            check_one_foot(&cells, &under_foot, &file)?;
            if turn_toes_to_top(&mut cells, &under_foot, &pressure_kpa, side, remarks) {
                half_mm.reverse();
            }
        }
        let footprint = Footprint { cells: &cells, under_foot: &under_foot, pressure_kpa: &pressure_kpa };
        let by_shape = footprint.side();
        note_other_name(stated, named, remarks);
        if let (None, Some(named), Some(by_shape), Toes::AlongMovement) = (stated, named, by_shape, grid.toes)
            && by_shape != named
        {
            remarks.push(format!(
                "By the name of the file, it is the {} foot, and it was imported as such, but the footprint has the shape of \
                 the {} foot. If the name is wrong, use --side.",
                named.name(),
                by_shape.name()
            ));
        }
        let side = side.unwrap_or_else(|| {
            let side = by_shape.unwrap_or(Side::Right);
            let reason = match by_shape {
                Some(_) => "By the shape of the footprint, it is",
                None => "The shape of the footprint does not show it, so it is assumed to be",
            };
            remarks.push(format!(
                "The export does not name the foot. {reason} the {} foot; if it is not, use --side.",
                side.name()
            ));
            side
        });
        if side == Side::Left {
            cells.iter_mut().for_each(|cell| cell.x_mm = -cell.x_mm);
        }
        remarks.extend(frames.negatives.remark(side));
        place_at_origin(&mut cells, &under_foot, half_mm);
        note_partial_foot(&cells, &under_foot, half_mm, side, remarks);
        template::assign_within(&mut cells, &under_foot);
        note_cells_beyond_foot(&cells, &under_foot, &pressure_kpa, side, remarks);
        let sheet = sheet(&grid, side, &indices, &cells);
        let layout = Layout { name, cells, sheet };
        Ok(UncheckedRecording { side, layout, t_s: frames.t_s, pressure_kpa, source })
    }

    /// As [`Foot::recording`], in the layout of `earlier`, a recording of this foot.
    fn recording_like(
        self,
        earlier: &EarlierRecording,
        path: &Path,
        remarks: &mut Vec<String>,
    ) -> Result<UncheckedRecording> {
        let Self { side: stated, named, grid, mut frames, name, source, .. } = self;
        let (side, file) = (earlier.side(), path.display().to_string());
        earlier.check_sensor(&name)?;
        let indices = earlier.sensors(&grid)?;
        let outside = frames.outside(&indices);
        if outside.share > MOST_OUTSIDE {
            return Err(Error::content(
                file,
                format!(
                    "{:.1} % of the load on the {} foot is on {} sensors that {} does not contain, because they carry no load \
                     there",
                    100.0 * outside.share,
                    side.name(),
                    outside.sensors,
                    earlier.path().display()
                ),
                "name a recording in which the whole foot is loaded, such as a walk; if this is one, the foot or the insole has \
                 moved: leave out --like",
            ));
        }
        let pressure_kpa = frames.pressures(&indices, &file)?;
        drop(std::mem::take(&mut frames.loads));
        note_other_name(stated, named, remarks);
        remarks.extend(frames.negatives.remark(side));
        let from = format!("{} foot: the cells and regions are those of {}.", capitalised(side), earlier.name());
        remarks.push(match outside.sensors {
            0 => from,
            sensors => format!(
                "{from} Sensors that it does not contain carry load, which was left out: {sensors}, {:.2} % of the load of all \
                 frames, and at most {:.1} N in a frame.",
                100.0 * outside.share,
                f64::from(outside.most_kpa) * grid.row_mm * grid.column_mm * 1e-3
            ),
        });
        let layout = earlier.layout().clone();
        Ok(UncheckedRecording { side, layout, t_s: frames.t_s, pressure_kpa, source })
    }
}

/// Largest share of the load, summed over all frames, on sensors that an earlier layout does not contain. Between trials of the
/// same foot, only sensors at its edge differ, which carry little.
const MOST_OUTSIDE: f64 = 0.03;

/// The load on sensors that a layout does not contain.
struct Outside {
    /// Number of these sensors.
    sensors: usize,
    /// Their share of the load of all sensors, summed over all frames.
    share: f64,
    /// The largest sum of their pressures in a frame, kPa.
    most_kpa: f32,
}

/// Adds to `remarks` if the name of the export states another foot than the user.
fn note_other_name(stated: Option<Side>, named: Option<Side>, remarks: &mut Vec<String>) {
    if let Some((stated, named)) = stated.zip(named).filter(|(stated, named)| stated != named) {
        remarks.push(format!(
            "The export is named as one of the {} foot, but it was imported as the {} foot.",
            named.name(),
            stated.name()
        ));
    }
}

/// The place of an insole's matrix sensor, of which `indices` has the row and column of each of the `cells`. `None` for a plate,
/// on which the foot has another place in each contact.
fn sheet(grid: &Grid, side: Side, indices: &BTreeMap<(usize, usize), usize>, cells: &[Cell]) -> Option<Sheet> {
    let (&(row, column), &index) = indices.first_key_value().filter(|_| grid.toes == Toes::Top)?;
    let column_mm = if side == Side::Left { -grid.column_mm } else { grid.column_mm };
    let row_mm = -grid.row_mm;
    Some(Sheet {
        x_mm: cells[index].x_mm - column as f64 * column_mm,
        y_mm: cells[index].y_mm - row as f64 * row_mm,
        row_mm,
        column_mm,
    })
}

/// For each cell, whether it belongs to a square of two by two loaded cells. A single row or column of cells may respond to
/// noise, and must not extend the foot. If there is no such square, all cells belong to the foot.
fn under_foot(indices: &BTreeMap<(usize, usize), usize>, pressure_kpa: &[f32]) -> Vec<bool> {
    /// A cell under the foot exceeds this fraction of the largest pressure in at least one frame.
    const LOADED: f32 = 0.02;
    let mut most_kpa = vec![0.0f32; indices.len()];
    for frame in pressure_kpa.chunks_exact(indices.len()) {
        most_kpa.iter_mut().zip(frame).for_each(|(most, &kpa)| *most = most.max(kpa));
    }
    let least_kpa = LOADED * most_kpa.iter().copied().fold(0.0, f32::max);
    let loaded = |row: usize, column: usize| indices.get(&(row, column)).copied().filter(|&i| most_kpa[i] > least_kpa);
    let mut under_foot = vec![false; indices.len()];
    for &(row, column) in indices.keys() {
        let square = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(down, right)| loaded(row + down, column + right));
        if let [Some(a), Some(b), Some(c), Some(d)] = square {
            [a, b, c, d].into_iter().for_each(|i| under_foot[i] = true);
        }
    }
    if under_foot.contains(&true) { under_foot } else { vec![true; indices.len()] }
}

/// Checks that a plate has no more than one footprint. Two feet side by side are not detected.
fn check_one_foot(cells: &[Cell], under_foot: &[bool], file: &str) -> Result<()> {
    /// Length of the longest plausible foot, mm: about EU size 60.
    const LONGEST_MM: f64 = 400.0;
    let extents_mm = [|c: &Cell| c.x_mm, |c: &Cell| c.y_mm].map(|along| {
        let foot = || cells.iter().zip(under_foot).filter(|(_, is_under)| **is_under).map(|(cell, _)| along(cell));
        foot().fold(f64::NEG_INFINITY, f64::max) - foot().fold(f64::INFINITY, f64::min)
    });
    let length_mm = extents_mm[0].max(extents_mm[1]);
    if length_mm <= LONGEST_MM {
        return Ok(());
    }
    let problem = format!("the loaded cells extend over {length_mm:.0} mm, more than the length of a foot");
    Err(Error::content(file, problem, "select one step in the vendor's program, and export it alone"))
}

/// Turns the picture, so that the toes point to its top. Returns true for a quarter turn, which exchanges the width and the
/// length of the cells. If the direction cannot be determined, adds a sentence to `remarks` and changes nothing. The sentence
/// names the foot `side`, if it is known.
fn turn_toes_to_top(
    cells: &mut [Cell],
    under_foot: &[bool],
    pressure_kpa: &[f32],
    side: Option<Side>,
    remarks: &mut Vec<String>,
) -> bool {
    let footprint = Footprint { cells, under_foot, pressure_kpa };
    let Some([x, y]) = footprint.walking_direction() else {
        remarks.push(format!(
            "{} direction of walking cannot be determined, because the pressure does not move along the foot: the toes are \
             assumed to point to the upper edge of the plate, as seen from above.",
            beginning(side)
        ));
        return false;
    };
    for cell in cells {
        // The direction (x, y) becomes (0, 1).
        (cell.x_mm, cell.y_mm) = (y * cell.x_mm - x * cell.y_mm, x * cell.x_mm + y * cell.y_mm);
    }
    x != 0.0
}

/// Adds to `remarks` if the loaded cells do not extend over a whole foot, to which the template is fitted. `half_mm` is half the
/// size of a cell along x and y; the edges of the cells under the foot touch both axes.
fn note_partial_foot(cells: &[Cell], under_foot: &[bool], half_mm: [f64; 2], side: Side, remarks: &mut Vec<String>) {
    /// Smallest plausible ratio of length to width. That of a footprint of an adult is about 2.5, that of a small child above 2.
    const LEAST_RATIO: f64 = 2.0;
    let most = |along: fn(&Cell) -> f64| {
        let foot = cells.iter().zip(under_foot).filter(|(_, is_under)| **is_under);
        foot.map(|(cell, _)| along(cell)).fold(0.0, f64::max)
    };
    let (width_mm, length_mm) = (most(|c| c.x_mm) + half_mm[0], most(|c| c.y_mm) + half_mm[1]);
    if length_mm < LEAST_RATIO * width_mm {
        remarks.push(format!(
            "{} loaded cells are {length_mm:.0} mm long and {width_mm:.0} mm wide, so a part of the foot, such as the heel or the \
             toes, seems to carry no load in any frame, unless the foot is turned. The regions are those of a whole foot of this \
             length: import by `csv`, with a layout that states the regions, or include frames in which the whole foot is loaded.",
            beginning(Some(side))
        ));
    }
}

/// Adds to `remarks` if cells in front of the foot or behind it carry a considerable part of the load of a region, for example by
/// crosstalk. The extent of the foot does not include these cells, but their load counts in the regions next to them.
fn note_cells_beyond_foot(
    cells: &[Cell],
    under_foot: &[bool],
    pressure_kpa: &[f32],
    side: Side,
    remarks: &mut Vec<String>,
) {
    /// A region is named if cells beyond the foot carry at least this share of its load.
    const LEAST_SHARE: f64 = 0.1;
    let foot = || cells.iter().zip(under_foot).filter(|(_, is_under)| **is_under).map(|(cell, _)| cell.y_mm);
    let extent_mm = foot().fold(f64::INFINITY, f64::min)..=foot().fold(f64::NEG_INFINITY, f64::max);
    // The sums of the pressures of the cells beyond the foot, and of all cells, of each region. All cells have the same area.
    let mut sums = [[0.0; 2]; 8];
    let mut beyond = [0; 8];
    for (i, cell) in cells.iter().enumerate() {
        let sum: f64 = pressure_kpa.iter().skip(i).step_by(cells.len()).map(|&kpa| f64::from(kpa)).sum();
        let [sum_beyond, sum_of_all] = &mut sums[cell.region as usize];
        *sum_of_all += sum;
        if sum > 0.0 && !extent_mm.contains(&cell.y_mm) {
            *sum_beyond += sum;
            beyond[cell.region as usize] += 1;
        }
    }
    let shares = Region::ALL.into_iter().zip(sums).map(|(region, [beyond, all])| (region, beyond / all));
    let shares: Vec<_> = shares.filter(|(_, share)| *share >= LEAST_SHARE).collect();
    if !shares.is_empty() {
        let text = |(region, share): &(Region, f64)| format!("{:.0} % of {}", share * 100.0, region.name());
        let cells: usize = shares.iter().map(|(region, _)| beyond[*region as usize]).sum();
        remarks.push(format!(
            "{} foot: loaded cells in front of it or behind it, perhaps because of crosstalk of the sensor: {cells}. They \
             carry a part of the load: {}. If they are not under the foot, mask them in the vendor's program, and \
             export again.",
            capitalised(side),
            shares.iter().map(text).collect::<Vec<_>>().join(", ")
        ));
    }
}

/// The beginning of a remark about a foot; without its name, if it is not known.
fn beginning(side: Option<Side>) -> String {
    side.map_or("The".to_owned(), |side| format!("{} foot: the", capitalised(side)))
}

/// Moves the cells, so that the edges of the cells under the foot touch both axes. `half_mm` is half the size of a cell along x
/// and y.
fn place_at_origin(cells: &mut [Cell], under_foot: &[bool], half_mm: [f64; 2]) {
    let least = |along: fn(&Cell) -> f64| {
        let foot = cells.iter().zip(under_foot).filter(|(_, is_under)| **is_under);
        foot.map(|(cell, _)| along(cell)).fold(f64::INFINITY, f64::min)
    };
    let (medial_mm, back_mm) = (least(|c| c.x_mm) - half_mm[0], least(|c| c.y_mm) - half_mm[1]);
    for cell in cells {
        cell.x_mm -= medial_mm;
        cell.y_mm -= back_mm;
    }
}

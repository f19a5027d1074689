//! Import of the walks in PhysioNet's database "Gait in Parkinson's Disease" (gaitpdb), which insoles with eight force sensors
//! under each foot recorded.
//!
//! Each line of a file has 19 numbers: the time in s, the forces on the sensors of the left and of the right foot in N, and the
//! total forces of both feet. The database states approximate positions of the sensors in a unit of its own, and no areas. Here
//! the positions are scaled to a foot of 260 mm, and the areas are equal parts of its sole. So forces are measured, and
//! pressures, areas and ellipses are nominal.

use crate::assembly::{ParsedExport, UncheckedRecording};
use crate::table::{at_line, check_later, file_name};
use crate::text::{decode, number, parse_number};
use crate::totals::Totals;
use crate::{Cell, Error, Layout, Result, template};
use plantar::{Region, Side};
use std::path::Path;

/// Number of sensors under a foot.
const SENSORS: usize = 8;
/// Number of columns: the time, the sensors of both feet, and the total forces.
const COLUMNS: usize = 1 + 2 * SENSORS + 2;
/// Positions of the sensors in the order of their columns, in the unit of the database. The first coordinate increases from the
/// medial to the lateral side, the second from heel to toes. Source: the file `format.txt` of the database, in which the first
/// coordinate is the distance from the middle between the feet of a person who stands with parallel feet.
const POSITIONS: [[f64; 2]; SENSORS] = [
    [500.0, -800.0],
    [700.0, -400.0],
    [300.0, -400.0],
    [700.0, 0.0],
    [300.0, 0.0],
    [700.0, 400.0],
    [300.0, 400.0],
    [500.0, 800.0],
];
/// Length of one unit of [`POSITIONS`], mm, for a foot of 260 mm: the first and the last sensor are then 208 mm apart.
const UNIT_MM: f64 = 0.13;
/// Nominal area of a sensor, mm2: an eighth of the sole.
const AREA_MM2: f64 = 2_500.0;

/// The numbers of a line; `None` if a field is not a number.
fn numbers(line: &str) -> Option<Vec<f64>> {
    line.split_whitespace().map(parse_number).collect()
}

/// True for the text of a walk: its first 20 lines that are not blank have 19 numbers each, and each total force agrees with the
/// sum of the forces on the sensors of its foot to within 1 N plus 1 %.
pub fn recognise(text: &str) -> bool {
    let mut lines = text.lines().filter(|line| !line.trim().is_empty()).take(20).peekable();
    let is_walk = |line: &str| {
        let Some(values) = numbers(line).filter(|values| values.len() == COLUMNS) else { return false };
        [0, 1].into_iter().all(|foot| {
            let sum_n: f64 = values[1 + foot * SENSORS..1 + (foot + 1) * SENSORS].iter().sum();
            let total_n = values[COLUMNS - 2 + foot];
            (sum_n - total_n).abs() <= 1.0 + 0.01 * total_n.abs()
        })
    };
    lines.peek().is_some() && lines.all(is_walk)
}

/// Imports the feet of a walk. `side` restricts the import to one foot.
///
/// # Errors
/// Fails if a line violates the format, or if the frames violate a rule of recordings. The message names the file, the line or
/// the time, and a remedy.
pub(crate) fn parse(bytes: &[u8], path: &Path, side: Option<Side>) -> Result<ParsedExport> {
    let text = decode(bytes, path)?;
    let (mut t_s, mut forces_n, mut totals): (Vec<f64>, [Vec<f64>; 2], [Totals; 2]) = Default::default();
    for (line, row) in (1..).zip(text.lines()) {
        let place = || at_line(path, line);
        let fields: Vec<&str> = row.split_whitespace().collect();
        if fields.is_empty() {
            continue;
        }
        if fields.len() != COLUMNS {
            let problem = format!("{} columns, a walk of gaitpdb has {COLUMNS}", fields.len());
            return Err(Error::content(place(), problem, "copy the file from PhysioNet again"));
        }
        let now_s = number(fields[0], "the time", &place)?;
        check_later(now_s, t_s.last().copied(), &place)?;
        t_s.push(now_s);
        for foot in 0..2 {
            let first = 1 + foot * SENSORS;
            let mut sum_n = 0.0;
            for (sensor, field) in fields[first..first + SENSORS].iter().enumerate() {
                // A sensor without load may have a small negative force. It is read as 0, because a recording has no negative
                // pressures.
                let force_n = number(field, &format!("the force on sensor {}", sensor + 1), &place)?.max(0.0);
                sum_n += force_n;
                forces_n[foot].push(force_n);
            }
            totals[foot].push_force(sum_n, Some(number(fields[COLUMNS - 2 + foot], "the total force", &place)?));
        }
    }
    let mut export = ParsedExport::default();
    for ((foot, forces_n), totals) in [Side::Left, Side::Right].into_iter().zip(forces_n).zip(totals) {
        if side.is_some_and(|side| side != foot) {
            continue;
        }
        export.remarks.extend(totals.remark(foot));
        let unchecked = UncheckedRecording {
            side: foot,
            layout: Layout { name: "insole of gaitpdb".to_owned(), cells: cells(), sheet: None },
            t_s: t_s.clone(),
            pressure_kpa: forces_n.iter().map(|force_n| (force_n / AREA_MM2 * 1e3) as f32).collect(),
            source: format!(
                "Walk {} of PhysioNet's database gaitpdb, {} foot, regions by template.",
                file_name(path),
                foot.name()
            ),
        };
        export.feet.push(unchecked);
    }
    export.remarks.push(
        "The positions and areas of the sensors are nominal: forces are measured, pressures and areas are not."
            .to_owned(),
    );
    Ok(export)
}

/// The cells in foot coordinates, which are equal for both feet.
fn cells() -> Vec<Cell> {
    // 300 and -800 are the least coordinates, so the edges of the most medial cells and of the rearmost cell are on the axes.
    let half_mm = AREA_MM2.sqrt() / 2.0;
    let mut cells: Vec<Cell> = POSITIONS
        .iter()
        .map(|&[lateral, forward]| Cell {
            x_mm: (lateral - 300.0) * UNIT_MM + half_mm,
            y_mm: (forward + 800.0) * UNIT_MM + half_mm,
            area_mm2: AREA_MM2,
            // Replaced by the template below.
            region: Region::Heel,
        })
        .collect();
    template::assign(&mut cells);
    cells
}

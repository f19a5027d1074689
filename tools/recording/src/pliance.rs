//! Import of measurements on a mat of the pliance system (novel GmbH), from the ASCII export (`.asc`) with the corners of the
//! sensors.
//!
//! Below the line that begins with `time[secs]` and names the sensors, each line has the time and the pressures. Further tables
//! may follow. The lines from `x[0]` to `y[3]`, or from `x[1]` to `y[4]`, state the corners of the sensors in cm in the plan
//! view of the mat, with x to the right and y upwards. The sensors of a mat for feet are equal rectangles in rows and columns.

use crate::assembly::ParsedExport;
use crate::export::{ONE_CONTACT, measured_at};
use crate::grid::{Foot, Frames, Grid, MAX_LINES, Toes};
use crate::separators::Separators;
use crate::table::{another_measurement, at_line, check_blanks, check_later, check_width, file_name};
use crate::text::{decode, novel_time, number, parse_number, side_of, strip_name};
use crate::{Error, Result, units};
use plantar::Side;
use std::collections::BTreeSet;
use std::path::Path;

/// First word of the line that names the sensors.
const TIME_COLUMN: &str = "time[secs]";
/// The name of the first line with corners, for corners that are numbered from 0 and from 1.
const FIRST_CORNER: [&str; 2] = ["x[0]", "x[1]"];

/// True for the text of a pliance export with the corners of the sensors.
pub fn recognise(text: &str) -> bool {
    // Only the first 40 lines are searched for the table, because the header of a pliance export is short, and the text of
    // another format may be long. The corners are below the table, at any line.
    text.lines().take(40).any(|line| strip_name(line, TIME_COLUMN).is_some())
        && FIRST_CORNER.iter().any(|name| has_line(text, name))
}

/// True if a line begins with `name`.
fn has_line(text: &str, name: &str) -> bool {
    text.lines().any(|line| strip_name(line, name).is_some())
}

/// Imports one foot. `side` states which; without it, the end of the file's name (L, R, left or right) does. If this does not
/// state it either, the shape of the footprint decides.
///
/// # Errors
/// Fails if the table or the corners are missing, if the sensors are not equal rectangles, or if a line violates the format. The
/// message names the file, the line if there is one, and a remedy.
pub(crate) fn parse(bytes: &[u8], path: &Path, side: Option<Side>) -> Result<ParsedExport> {
    let text = decode(bytes, path)?;
    let mut lines = (1..).zip(text.lines());
    let (mut stated_unit, mut time) = (None, "");
    let sensors = loop {
        let Some((line, row)) = lines.next() else {
            let problem = format!("no line begins with {TIME_COLUMN}");
            return Err(Error::content(path.display().to_string(), problem, "export the measurement as ASCII (.asc)"));
        };
        time = novel_time(row).unwrap_or(time);
        units::update_stated(&mut stated_unit, row, &|| at_line(path, line))?;
        if let Some(names) = strip_name(row, TIME_COLUMN) {
            check_blanks(names, &|| at_line(path, line))?;
            break names.split_whitespace().count();
        }
    };
    let kpa_per_unit = stated_unit.as_ref().map_or(1.0, |unit| unit.kpa) as f32;
    let places = places(&text, sensors, path)?;
    let (mut frames, mut separators) = (Frames::default(), Separators::default());
    while let Some((line, row)) = lines.next() {
        // Some programs write decimal commas.
        let row_with_points = row.replace(',', ".");
        let fields: Vec<&str> = row_with_points.split_whitespace().collect();
        // The table ends with an empty line, the title of another table, or the mean and the maximum of all frames. Any
        // other first field is read as a time, even if it is damaged, and so is a title that a frame follows: if the table
        // ended there, the frames below would be left out without a message. For the same reason, an empty line that a frame
        // follows is skipped.
        let Some(first) = fields.first() else {
            while lines.clone().next().is_some_and(|(_, row)| row.trim().is_empty()) {
                lines.next();
            }
            if precedes_frame(&lines, sensors) {
                continue;
            }
            break;
        };
        if is_title(first) && !precedes_frame(&lines, sensors) {
            break;
        }
        let place = || at_line(path, line);
        let now_s = number(first, TIME_COLUMN, &place)?;
        check_width(fields.len(), 1 + sensors, &place)?;
        check_later(now_s, frames.t_s.last().copied(), &place)?;
        row.split_whitespace().skip(1).for_each(|field| separators.add(field, line));
        frames.begin(now_s);
        for (i, (field, (row, column))) in fields[1..].iter().zip(&places.cells).enumerate() {
            let value = number(field, &format!("the pressure in column {}", i + 2), &place)?;
            frames.add(*row, *column, value as f32 * kpa_per_unit);
        }
    }
    let is_table =
        |row: &str| strip_name(row, TIME_COLUMN).is_some_and(|names| names.split_whitespace().count() == sensors);
    if let Some((line, _)) = lines.find(|(_, row)| is_table(row)) {
        return Err(another_measurement(at_line(path, line)));
    }
    separators.check(path)?;
    let mut remarks = Vec::new();
    let named = side_of(&file_name(path));
    frames.note_cut(side.or(named), Some(places.row_mm * places.column_mm), &mut remarks);
    let foot = Foot {
        side,
        named,
        grid: Grid { row_mm: places.row_mm, column_mm: places.column_mm, toes: Toes::AlongMovement },
        earlier: &[],
        frames,
        name: format!("pliance mat, {sensors} sensors"),
        source: format!(
            "pliance measurement {}, regions by template. {ONE_CONTACT}{}{}",
            file_name(path),
            measured_at(time),
            if stated_unit.is_some() { "" } else { " The export states no unit: kPa is assumed." }
        ),
    };
    Ok(ParsedExport { feet: vec![foot.recording(path, &mut remarks)?], remarks })
}

/// True if the first field of a line begins a title and not a frame. `NaN` and `inf`, which Rust parses as numbers, are damaged
/// times and not titles.
fn is_title(first: &str) -> bool {
    first.starts_with(char::is_alphabetic) && first.parse::<f64>().is_err()
}

/// True if the next line is a frame of this number of sensors.
fn precedes_frame<'a>(lines: &(impl Iterator<Item = (u64, &'a str)> + Clone), sensors: usize) -> bool {
    lines.clone().next().is_some_and(|(_, next)| is_frame(next, sensors))
}

/// True if a line is a frame of this number of sensors.
fn is_frame(row: &str, sensors: usize) -> bool {
    let mut fields = row.split_whitespace();
    fields.next().and_then(parse_number).is_some() && fields.count() == sensors
}

/// The places of the sensors in the picture of the mat.
struct Places {
    row_mm: f64,
    column_mm: f64,
    /// The row and the column of each sensor.
    cells: Vec<(usize, usize)>,
}

/// The places of the sensors from their corners.
fn places(text: &str, sensors: usize, path: &Path) -> Result<Places> {
    let first = usize::from(!has_line(text, FIRST_CORNER[0]));
    let corner = |i: usize| {
        let name = format!("{}[{}]", ["x", "y"][i % 2], first + i / 2);
        let line = text.lines().find_map(|row| strip_name(row, &name));
        let values = line.map(|row| row.split_whitespace().filter_map(parse_number).collect::<Vec<f64>>());
        let values = values.filter(|values| values.len() == sensors && sensors > 0);
        values.ok_or_else(|| {
            let problem = format!("no line `{name}` with the coordinates of all {sensors} sensors");
            Error::content(
                path.display().to_string(),
                problem,
                "export the measurement with the corners of the sensors",
            )
        })
    };
    let coordinates = (0..8).map(corner).collect::<Result<Vec<Vec<f64>>>>()?;
    let extent = |axis: usize, sensor: usize| {
        let values = [0, 2, 4, 6].map(|corner| 10.0 * coordinates[corner + axis][sensor]);
        let fold = |start: f64, combine: fn(f64, f64) -> f64| values.into_iter().fold(start, combine);
        [fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max)]
    };
    let [column_mm, row_mm] = [0, 1].map(|axis| {
        let [low_mm, high_mm] = extent(axis, 0);
        high_mm - low_mm
    });
    let least = |axis: usize| (0..sensors).map(|sensor| extent(axis, sensor)[0]).fold(f64::INFINITY, f64::min);
    let [left_mm, lower_mm] = [0, 1].map(least);
    let is_regular = (0..sensors).all(|sensor| {
        [column_mm, row_mm].into_iter().zip([left_mm, lower_mm]).enumerate().all(|(axis, (pitch_mm, start_mm))| {
            let [low_mm, high_mm] = extent(axis, sensor);
            let index = (low_mm - start_mm) / pitch_mm;
            (high_mm - low_mm - pitch_mm).abs() < 0.05 * pitch_mm
                && (index - index.round()).abs() < 0.2
                && index.round() < MAX_LINES as f64
        })
    });
    if !is_regular || column_mm <= 0.0 || row_mm <= 0.0 {
        let problem = "the sensors are not equal rectangles in rows and columns";
        let remedy =
            "write sensors and pressures as CSV, and use plantar import csv with --layout, --frames and --side";
        return Err(Error::content(path.display().to_string(), problem, remedy));
    }
    let index = |axis: usize, sensor: usize, pitch_mm: f64, start_mm: f64| {
        ((extent(axis, sensor)[0] - start_mm) / pitch_mm).round() as usize
    };
    let cells: Vec<_> = (0..sensors)
        .map(|sensor| {
            // `Grid` numbers rows from the top, and y increases to the top.
            (MAX_LINES - 1 - index(1, sensor, row_mm, lower_mm), index(0, sensor, column_mm, left_mm))
        })
        .collect();
    // Of two sensors in the same place, only the pressure of the last one would be imported.
    if cells.iter().collect::<BTreeSet<_>>().len() < sensors {
        let problem = "two sensors are in the same place";
        let remedy = "export the measurement again, or correct the corners of the sensors";
        return Err(Error::content(path.display().to_string(), problem, remedy));
    }
    Ok(Places { row_mm, column_mm, cells })
}

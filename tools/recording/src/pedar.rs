//! Import of in-shoe measurements by the pedar system (novel GmbH), from its ASCII export (`.asc`) and a description of the
//! geometry of the insoles.
//!
//! Each line of the export contains the time in seconds and the pressures of both feet: first the left sensors, then the right
//! ones. An export may also contain one foot alone, or lack sensors that a mask excluded. If its header states no unit, kPa is
//! assumed. A negative pressure is read as 0. Lines with the mean or the maximum of all frames at the end are skipped.
//!
//! The geometry is a CSV file with the header `side,sensor,area_mm2,x1_mm,y1_mm,...,x4_mm,y4_mm` and optionally `insole`. Each of
//! its lines contains the area and the corners of one sensor, and the size of its insole. Both insoles are seen from above, with
//! x to the right and y from heel to toes; their place in this plane is arbitrary.
//!
//! The insoles of all sizes have the same sensor numbers, but other areas. The header of the export states the type of the
//! sensors, which begins with the size of the insole. A geometry that states another size is refused.

use crate::check::{self, At};
use crate::export::measured_at;
use crate::numbered::NumberedFrames;
use crate::separators::Separators;
use crate::span::Span;
use crate::table::{
    self, Lines, another_measurement, at_line, check_blanks, check_later, check_width, empty_field, file_name, number,
    unreadable,
};
use crate::text::{decode, first_number, novel_time, parse_number, seconds, shortened, strip_name};
use crate::units::StatedUnit;
use crate::{Cell, Error, Export, Layout, Recording, Result, rate, template, units};
use csv::StringRecord;
use plantar::{Region, Side};
use std::fs;
use std::path::Path;

/// Largest relative difference between the stated area of a sensor and the area of the polygon of its corners. They differ,
/// because real sensors have curved edges.
const AREA_TOLERANCE: f64 = 0.25;
/// The number of lines that are read between two calls of `progress`.
const LINES_PER_REPORT: usize = 1000;
/// Beginning of the line that states the duration of the measurement.
const TOTAL_TIME: &str = "total time [secs]";
/// Largest rounding error of the stated duration, s.
const TOTAL_ROUNDING_S: f64 = 0.05;
/// Beginning of the line that states the type of the sensors.
const SENSOR_TYPE: &str = "sensor type:";
/// First word of the line that names the columns.
const TIME_COLUMN: &str = "time[secs]";

/// Header of the file that describes the geometry, without the optional last column [`INSOLE`].
const GEOMETRY_HEADER: [&str; 11] =
    ["side", "sensor", "area_mm2", "x1_mm", "y1_mm", "x2_mm", "y2_mm", "x3_mm", "y3_mm", "x4_mm", "y4_mm"];
/// The column of the geometry with the size of the insole.
const INSOLE: &str = "insole";

/// Imports one foot of a measurement. `progress` receives the number of bytes of the decoded text of the export that have been
/// read, and the size of this text, bytes, which can differ from that of the file.
///
/// # Errors
/// Fails if a file cannot be read or a line violates the format. The message names file, line and remedy.
pub fn import(
    asc_path: impl AsRef<Path>,
    geometry_path: impl AsRef<Path>,
    side: Side,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Recording> {
    Ok(import_feet(asc_path, geometry_path, &[side], Span::default(), progress)?.feet.remove(0))
}

/// As [`import`], for each of these feet, of the frames within `span`. [`Export::remarks`] states if the export may be cut off,
/// if it is not known that the geometry is that of the measured insole size, and how many negative pressures were read as 0.
///
/// # Errors
/// Fails in the same cases as [`import`].
pub fn import_feet(
    asc_path: impl AsRef<Path>,
    geometry_path: impl AsRef<Path>,
    sides: &[Side],
    span: Span,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Export> {
    let (asc_path, geometry_path) = (asc_path.as_ref(), geometry_path.as_ref());
    let geometry = fs::read(geometry_path).map_err(Error::io(geometry_path))?;
    let asc = fs::read(asc_path).map_err(Error::io(asc_path))?;
    let mut export = Export { feet: Vec::new(), remarks: Vec::new() };
    for &side in sides {
        let (foot, remarks) = read(&asc, asc_path, &geometry, geometry_path, side, span, progress)?;
        export.feet.push(foot);
        for remark in remarks {
            // Most remarks are the same for both feet.
            if !export.remarks.contains(&remark) {
                export.remarks.push(remark);
            }
        }
    }
    Ok(export)
}

/// As [`import`], from text. In messages the two texts are called `measurement.asc` and `geometry.csv`.
///
/// # Errors
/// Fails if a line violates the format.
pub fn parse(asc: &[u8], geometry: &[u8], side: Side) -> Result<Recording> {
    Ok(read(
        asc,
        Path::new("measurement.asc"),
        geometry,
        Path::new("geometry.csv"),
        side,
        Span::default(),
        &mut |_, _| {},
    )?
    .0)
}

/// The recording of a foot, and the remarks, which [`Recording::source`] contains, too.
fn read(
    asc: &[u8],
    asc_path: &Path,
    geometry: &[u8],
    geometry_path: &Path,
    side: Side,
    span: Span,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<(Recording, Vec<String>)> {
    let text = decode(asc, asc_path)?;
    let mut lines = (1..).zip(text.lines());
    let header = read_header(&mut lines, asc_path)?;
    let (all_cells, states_insole) = read_geometry(geometry, geometry_path, side, header.sensor_type.as_ref())?;
    let sensors = header.sensors_of(side, all_cells.len(), asc_path, geometry_path)?;
    let cells: Vec<Cell> = sensors.iter().map(|(_, sensor)| all_cells[sensor - 1]).collect();
    let mut frames = read_frames(&text, lines, asc_path, &header, &sensors, side, progress)?;
    let last_s = frames.t_s.last().copied();
    let part = span.part(&frames.t_s, asc_path)?.map(|(part, sentence)| {
        frames = std::mem::take(&mut frames).part(part, cells.len());
        sentence
    });
    let place = |at: At| match at {
        At::Whole => asc_path.display().to_string(),
        At::Frame(frame) => at_line(asc_path, frames.lines[frame]),
        At::Value { frame, cell } => {
            format!("{}, {} {}", at_line(asc_path, frames.lines[frame]), side.name(), sensors[cell].1)
        }
    };
    let rate_hz = rate::of(&frames.t_s, &place)?;
    check::pressures(&frames.pressure_kpa, cells.len(), &place)?;
    let sensor_type = header.sensor_type.as_ref();
    let name = sensor_type.map_or_else(String::new, |known| format!(" {}, sensor type {}", known.insole(), known.name));
    let layout = Layout { name: format!("pedar insole{name}, {} sensors", cells.len()), cells, sheet: None };
    check::geometry(&layout, &geometry_path.display().to_string())?;
    let not_compared = match sensor_type {
        Some(_) if states_insole => None,
        Some(known) => Some(format!(
            "The sensor type {} is that of insole size {}. The geometry does not state its size: check that it is that of this \
             size, or add the column {INSOLE} with the size to it.",
            known.name,
            known.insole()
        )),
        None => Some(
            "The export states no sensor type: check that the geometry is that of the size of the measured insoles."
                .to_owned(),
        ),
    };
    let cut_off = header.total_s.zip(last_s).and_then(|(total_s, last_s)| {
        // The stated time may count the intervals between the frames or the frames, and be rounded.
        (total_s - last_s > 1.5 / rate_hz + TOTAL_ROUNDING_S).then(|| {
            format!(
                "The header states a total time of {} s, but the last frame is at {} s: the export may be cut off.",
                seconds(total_s),
                seconds(last_s)
            )
        })
    });
    let remarks: Vec<String> =
        part.into_iter().chain(not_compared).chain(cut_off).chain(frames.negatives.remark(side)).collect();
    let recording = Recording {
        side,
        layout,
        rate_hz,
        source: format!(
            "pedar measurement {}, {} insole{}, geometry {}, regions by template.{}{}{}{}",
            file_name(asc_path),
            side.name(),
            sensor_type.map_or_else(String::new, |known| format!(", sensor type {}", known.name)),
            file_name(geometry_path),
            measured_at(&header.time),
            match all_cells.len() - sensors.len() {
                0 => String::new(),
                1 => " 1 sensor is not in the export.".to_owned(),
                masked => format!(" {masked} sensors are not in the export."),
            },
            if header.unit.is_some() { "" } else { " The export states no unit: kPa is assumed." },
            remarks.iter().map(|remark| format!(" {remark}")).collect::<String>()
        ),
        t_s: frames.t_s,
        pressure_kpa: frames.pressure_kpa,
    };
    Ok((recording, remarks))
}

/// The cells of one insole in foot coordinates, in the order of the sensor numbers, and whether the file states the size of the
/// insole. `measured` is the type of the measured sensors, if it is known.
///
/// # Errors
/// Fails if a line violates the format, or states another size than that of `measured`.
fn read_geometry(text: &[u8], path: &Path, side: Side, measured: Option<&SensorType>) -> Result<(Vec<Cell>, bool)> {
    let mut reader = table::open(text, path)?;
    let header = table::header(&mut reader, path)?;
    let states_insole = header.iter().next_back() == Some(INSOLE);
    if !header.iter().take(header.len() - usize::from(states_insole)).eq(GEOMETRY_HEADER) {
        return Err(Error::content(
            at_line(path, 1),
            "not the header of an insole geometry",
            format!("the header is {} and optionally {INSOLE}", GEOMETRY_HEADER.join(",")),
        ));
    }
    let mut cells = Vec::new();
    let mut corners = Vec::new();
    let (lines, mut record) = (Lines::after_header(&reader), StringRecord::new());
    while reader.read_record(&mut record).map_err(|e| unreadable(path, e))? {
        let line = lines.of(&reader, record.position());
        let place = || at_line(path, line);
        check_width(record.len(), header.len(), &place)?;
        if record[0].is_empty() {
            return Err(empty_field("side", &place));
        }
        if !["left", "right"].contains(&&record[0]) {
            let problem = format!("unknown side `{}`", shortened(&record[0]));
            return Err(Error::content(place(), problem, "use left or right"));
        }
        if &record[0] != side.name() {
            continue;
        }
        if states_insole {
            let insole = &record[GEOMETRY_HEADER.len()];
            if insole.is_empty() {
                return Err(empty_field(INSOLE, &place));
            }
            if let Some(measured) = measured.filter(|measured| !measured.insole().eq_ignore_ascii_case(insole)) {
                return Err(Error::content(
                    place(),
                    format!(
                        "a sensor of insole size `{}`, but the export states sensor type `{}`, that of insole size \
                         `{}`",
                        shortened(insole),
                        measured.name,
                        measured.insole()
                    ),
                    format!("use the geometry of insole size {}", measured.insole()),
                ));
            }
        }
        if record[1].parse() != Ok(cells.len() + 1) {
            return Err(Error::content(
                place(),
                format!("sensor `{}`, expected {}", shortened(&record[1]), cells.len() + 1),
                "number the sensors of each side 1, 2, 3, ... without gaps",
            ));
        }
        let mut values = [0.0; 9];
        for (i, value) in values.iter_mut().enumerate() {
            *value = number(&record[i + 2], &header[i + 2], &place)?;
        }
        let [area_mm2, coordinates @ ..] = values;
        // Seen from above, the medial side of a right foot is at small x, that of a left foot at large x.
        let x_sign = match side {
            Side::Left => -1.0,
            Side::Right => 1.0,
        };
        let polygon: [[f64; 2]; 4] = std::array::from_fn(|i| [x_sign * coordinates[2 * i], coordinates[2 * i + 1]]);
        let (centroid, polygon_mm2) = centroid_and_area(&polygon);
        let similar = 1.0 - AREA_TOLERANCE..=1.0 + AREA_TOLERANCE;
        if !similar.contains(&(polygon_mm2 / area_mm2)) {
            return Err(Error::content(
                place(),
                format!("area {area_mm2} mm², but the corners enclose {polygon_mm2:.0} mm²"),
                "correct the area, or list the corners in order around the sensor",
            ));
        }
        corners.extend(polygon);
        cells.push(Cell {
            x_mm: centroid[0],
            y_mm: centroid[1],
            area_mm2,
            // Replaced by the template below.
            region: Region::Heel,
        });
    }
    if cells.is_empty() {
        let problem = format!("no sensor of the {} foot", side.name());
        let remedy = format!("add the sensors of the {} insole, or state the other foot with --side", side.name());
        return Err(Error::content(path.display().to_string(), problem, remedy));
    }
    check::cell_count(cells.len(), &path.display().to_string())?;
    let least = |axis: usize| corners.iter().map(|c| c[axis]).fold(f64::INFINITY, f64::min);
    let (medial_mm, back_mm) = (least(0), least(1));
    for cell in &mut cells {
        cell.x_mm -= medial_mm;
        cell.y_mm -= back_mm;
    }
    template::assign(&mut cells);
    Ok((cells, states_insole))
}

/// Centroid and area of a polygon by the shoelace formula. The corners may be listed clockwise or anticlockwise.
fn centroid_and_area(polygon: &[[f64; 2]; 4]) -> ([f64; 2], f64) {
    let (mut doubled_mm2, mut x, mut y) = (0.0, 0.0, 0.0);
    for (i, &[x1, y1]) in polygon.iter().enumerate() {
        let [x2, y2] = polygon[(i + 1) % polygon.len()];
        let cross = x1 * y2 - x2 * y1;
        doubled_mm2 += cross;
        x += (x1 + x2) * cross;
        y += (y1 + y2) * cross;
    }
    ([x / (3.0 * doubled_mm2), y / (3.0 * doubled_mm2)], doubled_mm2.abs() / 2.0)
}

/// The type of the sensors of both insoles.
struct SensorType {
    /// As in the export, such as `y-1865l-1870r-pxf306-11mar2021`.
    name: String,
}

impl SensorType {
    /// The size of the insole: the letters before the first hyphen.
    fn insole(&self) -> &str {
        self.name.split('-').next().unwrap_or_default()
    }
}

/// The header of an export.
struct Header {
    /// Number of the line that names the columns.
    line: u64,
    /// The duration of the measurement, s, if the export states it.
    total_s: Option<f64>,
    /// The unit of the pressures, if the export states it.
    unit: Option<StatedUnit>,
    sensor_type: Option<SensorType>,
    /// Date and time of the measurement, in the words of the export; empty if it states none.
    time: String,
    /// The numbers of the sensors of each foot in the export.
    feet: Vec<Vec<usize>>,
    /// The foot of an export of one foot, if the mask definition states it.
    side: Option<Side>,
}

impl Header {
    /// The columns of a foot, each with the number of its sensor. An export of one foot is assumed to be of `side`. `most` is
    /// the number of sensors in the geometry.
    fn sensors_of(&self, side: Side, most: usize, path: &Path, geometry_path: &Path) -> Result<Vec<(usize, usize)>> {
        if let Some(stated) = self.side.filter(|stated| *stated != side) {
            return Err(Error::content(
                at_line(path, self.line),
                format!("the mask definition states that these are sensors of the {} foot", stated.name()),
                format!("import the export with --side {}", stated.name()),
            ));
        }
        let is_known = |sensor: &usize| (1..=most).contains(sensor);
        let (first_column, sensors) = match (&self.feet[..], side) {
            ([sensors], _) | ([sensors, _], Side::Left) => (1, sensors),
            ([left, sensors], Side::Right) => (1 + left.len(), sensors),
            _ => (1, &Vec::new()),
        };
        if !sensors.is_empty() && self.feet.iter().flatten().all(is_known) {
            return Ok((first_column..).zip(sensors.iter().copied()).collect());
        }
        Err(Error::content(
            at_line(path, self.line),
            format!(
                "the columns are not those of one foot or of the left and the right one, with sensors from 1 to {most} \
                 as in {}",
                geometry_path.display()
            ),
            "use the geometry of this insole size, and export the pressures of both feet or of one",
        ))
    }

    /// Number of columns.
    fn width(&self) -> usize {
        1 + self.feet.iter().map(Vec::len).sum::<usize>()
    }
}

/// The number of feet in an export.
///
/// # Errors
/// Fails if the file cannot be read, or has no line that names the columns.
pub fn feet(asc_path: impl AsRef<Path>) -> Result<usize> {
    let path = asc_path.as_ref();
    let text = decode(&fs::read(path).map_err(Error::io(path))?, path)?;
    Ok(read_header(&mut (1..).zip(text.lines()), path)?.feet.len())
}

/// Consumes the lines up to the line that names the columns.
fn read_header<'a>(lines: &mut impl Iterator<Item = (u64, &'a str)>, path: &Path) -> Result<Header> {
    let (mut unit, mut total_s, mut sensor_type) = (None, None, None);
    let mut time = String::new();
    // The sensors of both feet by the mask definition.
    let mut masks = [Vec::new(), Vec::new()];
    for (line, row) in lines {
        let place = || at_line(path, line);
        units::update_stated(&mut unit, row, &place)?;
        if let Some(stated) = novel_time(row) {
            time = stated.to_owned();
        }
        if let Some(rest) = strip_name(row, TOTAL_TIME) {
            total_s = first_number(rest);
        }
        if let Some(name) = strip_name(row, SENSOR_TYPE).map(str::trim).filter(|name| !name.is_empty()) {
            sensor_type = Some(SensorType { name: shortened(name) });
        }
        for (mask, name) in masks.iter_mut().zip(["left insole:", "right insole:"]) {
            if let Some(numbers) = strip_name(row, name) {
                *mask = numbers.split(',').filter_map(|number| number.trim().parse().ok()).collect();
            }
        }
        let Some(labels) = strip_name(row, TIME_COLUMN) else { continue };
        check_blanks(labels, &place)?;
        let mut sensors = Vec::new();
        for label in labels.split_whitespace() {
            let Ok(sensor) = label.parse() else {
                let problem = format!("`{}` is not the number of a sensor", shortened(label));
                return Err(Error::content(place(), problem, "export the pressures of the sensors"));
            };
            sensors.push(sensor);
        }
        let (feet, side) = if masks.concat() == sensors {
            let side = match &masks {
                [_, right] if right.is_empty() => Some(Side::Left),
                [left, _] if left.is_empty() => Some(Side::Right),
                _ => None,
            };
            (masks.into_iter().filter(|foot| !foot.is_empty()).collect(), side)
        } else {
            // The sensor numbers of a foot increase, so a number that does not increase begins the second foot.
            (sensors.chunk_by(|before, sensor| before < sensor).map(<[usize]>::to_vec).collect(), None)
        };
        return Ok(Header { line, total_s, unit, sensor_type, time, feet, side });
    }
    Err(Error::content(
        path.display().to_string(),
        format!("no line begins with {TIME_COLUMN}"),
        "export the measurement as ASCII (.asc)",
    ))
}

/// Reads the lines below the header. `sensors` are the columns of the foot, each with the number of its sensor.
fn read_frames<'a>(
    text: &str,
    mut lines: impl Iterator<Item = (u64, &'a str)> + Clone,
    path: &Path,
    header: &Header,
    sensors: &[(usize, usize)],
    side: Side,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<NumberedFrames> {
    let total_bytes = text.len() as u64;
    let mut frames = NumberedFrames::default();
    let mut separators = Separators::default();
    let kpa_per_unit = header.unit.as_ref().map_or(1.0, |unit| unit.kpa) as f32;
    while let Some((line, row)) = lines.next() {
        // Some programs write decimal commas.
        let row_with_points = row.replace(',', ".");
        let fields: Vec<&str> = row_with_points.split_whitespace().collect();
        // Lines with the mean and the maximum of all frames are skipped.
        if fields.is_empty() || ["MVP", "MPP"].iter().any(|summary| fields[0].starts_with(summary)) {
            continue;
        }
        let place = || at_line(path, line);
        if parse_number(fields[0]).is_none() {
            let mut rest = std::iter::once((line, row)).chain(lines.clone());
            if let Some((line, _)) = rest.find(|(_, row)| strip_name(row, TIME_COLUMN).is_some()) {
                return Err(another_measurement(at_line(path, line)));
            }
        }
        check_width(fields.len(), header.width(), &place)?;
        if let Some(field) = row.split_whitespace().find(|field| field.matches([',', '.']).nth(1).is_some()) {
            return Err(Error::content(
                place(),
                format!("`{}` has more than one decimal or thousands separator", shortened(field)),
                "export the measurement without thousands separators",
            ));
        }
        row.split_whitespace().skip(1).for_each(|field| separators.add(field, line));
        let now_s = number(fields[0], TIME_COLUMN, &place)?;
        check_later(now_s, frames.t_s.last().copied(), &place)?;
        frames.t_s.push(now_s);
        frames.lines.push(line);
        for &(column, sensor) in sensors {
            let name = format!("{} {sensor}", side.name());
            let kpa = kpa_per_unit * number(fields[column], &name, &place)? as f32;
            frames.pressure_kpa.push(frames.negatives.clip(kpa));
        }
        if frames.lines.len().is_multiple_of(LINES_PER_REPORT) {
            let done_bytes = row.as_ptr() as usize - text.as_ptr() as usize;
            progress(done_bytes as u64, total_bytes);
        }
    }
    separators.check(path)?;
    progress(total_bytes, total_bytes);
    Ok(frames)
}

//! Import of measurements by Tekscan's F-Scan, I-Scan and plates, from the ASCII export (`.asf`, `.csv`).
//!
//! A header with a name and a value in each line states the numbers and the spacing of rows and columns, the time between
//! frames and the unit. Below `ASCII_DATA`, each frame begins with `Frame` and its number, and has a line for each row. `B`
//! stands for a cell outside of the sensor. Lines that begin with `@@`, such as the last one, have no values. Insoles are
//! exported with the toes in the first row, as seen from above. Mirrored exports are refused.

use crate::assembly::ParsedExport;
use crate::earlier::EarlierRecording;
use crate::export::measured_at;
use crate::grid::{Foot, Frames, Grid, MAX_CELL_MM, MAX_LINES, Toes, check_period};
use crate::separators::Separators;
use crate::table::{another_measurement, at_line, file_name};
use crate::text::{decode, first_number, number, parse_number, shortened, side_of};
use crate::{Error, Result, units};
use plantar::Side;
use std::path::Path;

/// True for the text of a Tekscan export.
pub fn recognise(text: &str) -> bool {
    let has = |name: &str| text.lines().take(100).any(|line| property(line).is_some_and(|(found, _)| found == name));
    has("ROW_SPACING") && (has("ROWS") || has("ASCII_DATA"))
}

/// Splits a line of the header into its name and its value, without their quotes.
fn property(line: &str) -> Option<(&str, &str)> {
    let line = line.trim().trim_matches(['"', ',']);
    let (name, value) = line.split_once([' ', ',', '\t', ':']).unwrap_or((line, ""));
    let name = name.trim_end_matches('"');
    (!name.is_empty()).then(|| (name, value.trim_matches([' ', ',', '\t', ':', '"'])))
}

/// Largest rounding error of SATURATION_PRESSURE and of a pressure, as a fraction.
const SATURATION_ROUNDING: f64 = 1e-3;
/// Names of lines that occur only in a header, by which a second measurement in the file is recognised.
const ONLY_IN_HEADER: [&str; 4] = ["DATA_TYPE", "FILENAME", "SENSOR_TYPE", "ROWS"];
/// Settings of a measurement that [`crate::Recording::source`] contains.
const SETTINGS: [&str; 4] = ["HARDWARE", "NOISE_THRESHOLD", "CALIBRATION_POINT_1", "SENSITIVITY"];
/// The remedy for raw values that cannot be converted.
const CALIBRATE: &str = "calibrate the measurement in the vendor's program, and export it in kPa";

/// The header of an export.
#[derive(Default)]
struct Header<'a> {
    rows: Option<usize>,
    columns: Option<usize>,
    row_mm: Option<f64>,
    column_mm: Option<f64>,
    period_s: Option<f64>,
    /// Number of the last frame.
    last_frame: Option<u64>,
    /// The unit and its line.
    unit: Option<(&'a str, u64)>,
    /// Force on the sensor, N, and sum of its raw values, in the measurement that calibrated it.
    calibration: Option<(f64, f64)>,
    /// True if the sensor was calibrated with a second load, by a law that the export does not state.
    has_second_point: bool,
    /// The pressure at which a cell is saturated, kPa.
    saturation_kpa: Option<f64>,
    file_name: &'a str,
    /// Date and time of the measurement; empty if the export does not state them.
    time: &'a str,
    /// Settings of the measurement, each with its name, for the source.
    settings: Vec<String>,
    /// The type of the sensor, for the name of the layout.
    sensor: String,
}

/// Imports one foot, that of `side`. Without `side`, the ends of the file's names in the header and in `path` state the foot: L,
/// R, left or right. If they state different feet, this is an error. If neither name states it, the foot is determined from the
/// shape of the footprint on a plate; for an insole, this is an error. If there are `earlier` recordings, that of the same foot
/// states the layout.
///
/// # Errors
/// Fails if a line violates the format, or the layout of an earlier recording does not apply. The message names file, line and
/// remedy.
pub(crate) fn parse(
    bytes: &[u8],
    path: &Path,
    side: Option<Side>,
    earlier: &[EarlierRecording],
) -> Result<ParsedExport> {
    let text = decode(bytes, path)?;
    let mut lines = (1..).zip(text.lines());
    let header = header(&mut lines, path)?;
    let missing = |name: &str| {
        let problem = format!("no line begins with {name} before the frames");
        Error::content(path.display().to_string(), problem, "export the measurement as ASCII, with its header")
    };
    let (rows, columns) = (header.rows.ok_or_else(|| missing("ROWS"))?, header.columns.ok_or_else(|| missing("COLS"))?);
    let row_mm = header.row_mm.ok_or_else(|| missing("ROW_SPACING"))?;
    let column_mm = header.column_mm.ok_or_else(|| missing("COL_SPACING"))?;
    let period_s = header.period_s.ok_or_else(|| missing("SECONDS_PER_FRAME"))?;
    let (unit, unit_line) = header.unit.ok_or_else(|| missing("UNITS"))?;
    let mut remarks = Vec::new();
    let kpa_per_unit = if unit.to_lowercase().starts_with("raw") {
        let (force_n, sum) = header.calibration.ok_or_else(|| {
            Error::content(at_line(path, unit_line), "raw values without a valid CALIBRATION_POINT_1", CALIBRATE)
        })?;
        if header.has_second_point {
            let problem = "raw values with a CALIBRATION_POINT_2, which are not in proportion to the load";
            return Err(Error::content(at_line(path, unit_line), problem, CALIBRATE));
        }
        remarks.push(
            "The values are raw: they were converted in proportion to the load of CALIBRATION_POINT_1.".to_owned(),
        );
        force_n / sum / (row_mm * column_mm) * 1e3
    } else {
        units::kpa(unit, &|| at_line(path, unit_line))?
    };
    let (frames, last_number) = read_frames(&mut lines, path, [rows, columns], period_s, kpa_per_unit)?;
    if let Some(stated) = header.last_frame.filter(|stated| *stated > last_number) {
        remarks.push(format!(
            "The header states frames up to {stated}, but the last one is frame {last_number}: the export may be cut off."
        ));
    }
    if let Some(saturation_kpa) = header.saturation_kpa {
        // The header rounds the pressure.
        let [frames, cells] = frames.count_reaching((saturation_kpa * (1.0 - SATURATION_ROUNDING)) as f32);
        if cells > 0 {
            remarks.push(format!(
                "Cells that reach SATURATION_PRESSURE, {saturation_kpa:.0} kPa: {cells}, in {frames} frames. Their true \
                 pressures may be higher."
            ));
        }
    }
    let is_insole = is_insole(&header.sensor, [rows, columns], [row_mm, column_mm]);
    let names = [header.file_name, &file_name(path)];
    let [in_header, of_file] = names.map(side_of);
    if side.is_none() && in_header.zip(of_file).is_some_and(|(in_header, of_file)| in_header != of_file) {
        let [in_header, of_file] = names.map(|name| shortened(name.rsplit(['\\', '/']).next().unwrap_or(name)));
        return Err(Error::content(
            path.display().to_string(),
            format!(
                "FILENAME in the header is `{in_header}`, but the file is named `{of_file}`: they state different feet"
            ),
            "state the foot with --side",
        ));
    }
    let named = in_header.or(of_file);
    let settings = match header.settings.is_empty() {
        true => String::new(),
        false => format!(" The export states {}.", header.settings.join("; ")),
    };
    if is_insole && side.or(named).is_none() {
        return Err(Error::content(
            path.display().to_string(),
            "the foot is unknown: neither FILENAME in the header nor the name of the file ends with the word left or right, or \
             with L or R",
            "state the foot with --side",
        ));
    }
    if !is_insole {
        frames.note_cut(side.or(named), Some(row_mm * column_mm), &mut remarks);
    }
    let foot = Foot {
        side,
        named,
        grid: Grid { row_mm, column_mm, toes: if is_insole { Toes::Top } else { Toes::AlongMovement } },
        earlier,
        frames,
        name: format!(
            "Tekscan {}, {rows} x {columns} cells",
            if header.sensor.is_empty() { "sensor" } else { header.sensor.as_str() }
        ),
        source: format!(
            "Tekscan measurement {}, regions by template.{}{settings}",
            file_name(path),
            measured_at(header.time)
        ),
    };
    Ok(ParsedExport { feet: vec![foot.recording(path, &mut remarks)?], remarks })
}

/// True for an F-Scan insole: by its name, by its number (3000, 3000E and the like), or by its 60 rows of 21 cells with a spacing
/// of 5.08 mm. All other sensors are plates and mats.
fn is_insole(sensor: &str, lines: [usize; 2], spacing_mm: [f64; 2]) -> bool {
    let name = sensor.to_uppercase().replace(['-', ' '], "");
    let has_grid = lines == [60, 21] && spacing_mm.iter().all(|mm| (mm - 5.08).abs() < 0.01);
    has_grid || ["FSCAN", "3000"].iter().any(|known| name.contains(known))
}

/// Reads the lines up to the first frame.
fn header<'a>(lines: &mut impl Iterator<Item = (u64, &'a str)>, path: &Path) -> Result<Header<'a>> {
    let mut header = Header::default();
    for (line, row) in lines {
        let place = || at_line(path, line);
        let Some((name, value)) = property(row) else { continue };
        if SETTINGS.contains(&name) && !value.is_empty() {
            header.settings.push(format!("{name} {}", shortened(value)));
        }
        match name {
            "ASCII_DATA" => return Ok(header),
            "ROWS" => header.rows = Some(count(value, name, &place)?),
            "COLS" => header.columns = Some(count(value, name, &place)?),
            "ROW_SPACING" => header.row_mm = Some(spacing_mm(value, name, &place)?),
            "COL_SPACING" => header.column_mm = Some(spacing_mm(value, name, &place)?),
            "SECONDS_PER_FRAME" => {
                let period_s = number(value, name, &place)?;
                check_period(period_s, &place)?;
                header.period_s = Some(period_s);
            }
            "END_FRAME" => header.last_frame = value.parse().ok(),
            "UNITS" => header.unit = Some((value, line)),
            "CALIBRATION_POINT_1" => header.calibration = calibration(value),
            "CALIBRATION_POINT_2" => header.has_second_point = calibration(value).is_some(),
            "SATURATION_PRESSURE" => {
                let unit = value.trim_start_matches(|c: char| c.is_ascii_digit() || ".,+ \t".contains(c));
                header.saturation_kpa = first_number(value)
                    .zip(units::kpa_of(unit))
                    .map(|(value, kpa)| value * kpa)
                    .filter(|kpa| *kpa > 0.0);
            }
            "MIRROR_ROW" | "MIRROR_COL" if !["", "0"].contains(&value) => {
                return Err(Error::content(
                    place(),
                    format!(
                        "{name} is `{}`: the picture is mirrored, which exchanges medial and lateral or heel and toes",
                        shortened(value)
                    ),
                    "undo the mirroring in the vendor's program, and export the measurement again",
                ));
            }
            "TIME" => header.time = value,
            "FILENAME" => header.file_name = value,
            "SENSOR_TYPE" => header.sensor = shortened(value),
            _ => {}
        }
    }
    Err(Error::content(
        path.display().to_string(),
        "no line begins with ASCII_DATA",
        "the export is cut off or of another kind: export the measurement as ASCII",
    ))
}

/// Reads the number of rows or columns.
fn count(value: &str, name: &str, place: &dyn Fn() -> String) -> Result<usize> {
    value.parse().ok().filter(|count| (1..=MAX_LINES).contains(count)).ok_or_else(|| {
        let problem = format!("{name} is `{}`, expected 1 to {MAX_LINES}", shortened(value));
        Error::content(place(), problem, "export the measurement again, and do not edit the file")
    })
}

/// Reads a distance with its unit, and converts it to mm.
fn spacing_mm(value: &str, name: &str, place: &dyn Fn() -> String) -> Result<f64> {
    let unit = value.trim_start_matches(|c: char| c.is_ascii_digit() || ".,-+ \t".contains(c));
    let mm = number(&value[..value.len() - unit.len()], name, place)?
        * units::mm(if unit.is_empty() { "mm" } else { unit }, place)?;
    if mm > 0.0 && mm <= MAX_CELL_MM {
        return Ok(mm);
    }
    Err(Error::content(
        place(),
        format!("{name} is {mm} mm"),
        format!("cells have a size of up to {MAX_CELL_MM} mm: export the measurement again"),
    ))
}

/// The force, N, and the sum of the raw values of a calibration such as `75.0 (Kgs) 4798 (Raw Sum) 240 (Number of Loaded
/// Cells)`.
fn calibration(value: &str) -> Option<(f64, f64)> {
    let (force, rest) = value.split_once('(')?;
    let (unit, rest) = rest.split_once(')')?;
    let (sum, kind) = rest.split_once('(')?;
    let (force_n, sum) = (parse_number(force)? * units::newtons_of(unit)?, first_number(sum)?);
    (kind.to_lowercase().starts_with("raw") && force_n > 0.0 && sum > 0.0).then_some((force_n, sum))
}

/// Reads the frames below the header. Returns the number of the last one, too.
fn read_frames<'a>(
    lines: &mut impl Iterator<Item = (u64, &'a str)>,
    path: &Path,
    [rows, columns]: [usize; 2],
    period_s: f64,
    kpa_per_unit: f64,
) -> Result<(Frames, u64)> {
    let (mut frames, mut separators) = (Frames::default(), Separators::default());
    let mut last: Option<u64> = None;
    // The number of rows that were read of the current frame; `rows` before the first frame.
    let mut rows_read = rows;
    let cut_off = |place: String, rows_read: usize| {
        let problem = format!("a frame ends after {rows_read} of {rows} rows");
        Error::content(place, problem, "the export is cut off or damaged: export or copy it again")
    };
    for (line, row) in lines {
        let place = || at_line(path, line);
        let row = row.trim().trim_end_matches([',', ';', '\t', ' ']);
        if row.is_empty() || row.starts_with("@@") {
            continue;
        }
        if let Some(rest) = row.trim_start_matches('"').strip_prefix("Frame") {
            if rows_read != rows {
                return Err(cut_off(place(), rows_read));
            }
            let next = last.map_or(1, |last| last + 1);
            let number = first_number(rest).filter(|n| *n < 1e12).map_or(next, |n| n as u64);
            if let Some(last) = last.filter(|&last| number <= last) {
                let problem = format!("frame {number} follows frame {last}");
                return Err(Error::content(place(), problem, "export the frames in order"));
            }
            last = Some(number);
            // The time follows from the number alone: the exports of both feet of a measurement can begin with different frames.
            frames.begin(number as f64 * period_s);
            rows_read = 0;
            continue;
        }
        // With other separators, a comma is a decimal comma.
        let delimiters: &[char] = if row.contains([';', '\t']) { &[';', '\t'] } else { &[','] };
        let fields = row.split(delimiters).map(str::trim);
        if rows_read == rows {
            if property(row).is_some_and(|(name, _)| ONLY_IN_HEADER.contains(&name)) {
                return Err(another_measurement(place()));
            }
            let problem = format!("`{}`, expected the beginning of a frame", shortened(row));
            return Err(Error::content(place(), problem, "export the measurement again, and do not edit the file"));
        }
        let width = fields.clone().count();
        if width == 1 && columns > 1 {
            let problem = format!("`{}`, expected {columns} values, as COLS states", shortened(row));
            let remedy = "export the values with commas, semicolons or tabs between them";
            return Err(Error::content(place(), problem, remedy));
        }
        if width != columns {
            let problem = format!("{width} values, expected {columns}, as COLS states");
            return Err(Error::content(place(), problem, "the export is cut off or damaged: export or copy it again"));
        }
        for (column, field) in fields.enumerate().filter(|(_, field)| !field.eq_ignore_ascii_case("B")) {
            let value = number(field, &format!("the value in column {}", column + 1), &place)?;
            separators.add(field, line);
            frames.add(rows_read, column, (value * kpa_per_unit) as f32);
        }
        rows_read += 1;
    }
    separators.check(path)?;
    match rows_read == rows {
        true => Ok((frames, last.unwrap_or(0))),
        false => Err(cut_off(path.display().to_string(), rows_read)),
    }
}

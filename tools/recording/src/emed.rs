//! Import of measurements on a plate of the emed system (novel GmbH), from the ASCII export (`.lst`).
//!
//! Each page contains one frame, which emed calls a picture, as a table of the loaded part of the plate in kPa: the first line
//! has the numbers of the columns, and each other line begins with the number of its row. The last column and the last line
//! contain forces in N, with which the import is compared. Pages of a summary, such as the maximum of all frames, are skipped.
//! Rows are numbered from the top, as seen from above.

use crate::assembly::ParsedExport;
use crate::export::ONE_CONTACT;
use crate::grid::{Foot, Frames, Grid, MAX_CELL_MM, MAX_LINES, SWING_S, Toes, check_period};
use crate::separators::Separators;
use crate::table::{at_line, file_name};
use crate::text::{decode, first_number, number, shortened, side_of};
use crate::{Error, Result, units};
use plantar::Side;
use std::collections::BTreeSet;
use std::path::Path;

/// Label of the number of a picture, in the header of its page.
const PICTURE: &str = "Pict-No";
/// Name of the column and of the line with forces.
const FORCE: &str = "Force";
/// Largest accepted difference between the force that the cells carry and the force in the file, as a fraction of the latter.
const FORCE_TOLERANCE: f64 = 0.005;
/// The remedy for a damaged table.
const CUT_OFF: &str = "the export is cut off or damaged: export or copy it again";

/// True for the text of an emed export.
pub fn recognise(text: &str) -> bool {
    let has = |word: &str| text.lines().take(60).any(|line| line.contains(word));
    has(PICTURE) && (has("Sensor size") || has("Sensor area"))
}

/// Imports a step. `side` states the foot; without it, the end of the file's name (L, R, left or right) does. If this does not
/// state it either, the shape of the footprint decides.
///
/// # Errors
/// Fails if a line violates the format. The message names file, line and remedy.
pub(crate) fn parse(bytes: &[u8], path: &Path, side: Option<Side>) -> Result<ParsedExport> {
    let text = decode(bytes, path)?;
    let mut pages = Pages {
        path,
        size_mm: None,
        period_s: None,
        pictures: None,
        frames: Frames::default(),
        separators: Separators::default(),
        summaries: 0,
        differences: Vec::new(),
    };
    let mut first_line = 1;
    for page in text.split('\x0c') {
        pages.page(page, first_line)?;
        first_line += page.matches('\n').count() as u64;
    }
    pages.separators.check(path)?;
    let Pages { size_mm: Some([width_mm, height_mm]), frames, summaries, differences, .. } = pages else {
        return Err(Error::content(
            path.display().to_string(),
            "no page with a frame",
            "export all pictures of the measurement",
        ));
    };
    let comparison = match differences.into_iter().reduce(f64::max) {
        Some(largest) => format!("their force differs from that in the file by up to {:.2} %", 100.0 * largest),
        None => "no frame has a stated force of more than 1 N, with which the import could be compared".to_owned(),
    };
    let mut remarks = vec![format!(
        "{} frames; {comparison}.{}",
        frames.t_s.len(),
        match summaries {
            0 => String::new(),
            1 => " One page without a frame was skipped.".to_owned(),
            _ => format!(" {summaries} pages without a frame were skipped."),
        },
    )];
    let named = side_of(&file_name(path));
    let foot = Foot {
        side,
        named,
        grid: Grid { row_mm: height_mm, column_mm: width_mm, toes: Toes::AlongMovement },
        earlier: &[],
        frames: frames.with_swing(side.or(named), path, &mut remarks)?,
        name: "emed plate".to_owned(),
        source: format!(
            "emed measurement {}, {SWING_S} s without load added before and after, regions by template. {ONE_CONTACT}",
            file_name(path)
        ),
    };
    Ok(ParsedExport { feet: vec![foot.recording(path, &mut remarks)?], remarks })
}

/// The values that were read from the pages so far.
struct Pages<'a> {
    path: &'a Path,
    /// Width and height of a cell, mm.
    size_mm: Option<[f64; 2]>,
    /// Time between two successive pictures, s.
    period_s: Option<f64>,
    /// Numbers of the first and of the last picture.
    pictures: Option<(f64, f64)>,
    frames: Frames,
    separators: Separators,
    /// Number of pages without a frame.
    summaries: usize,
    /// For each frame with a stated force of more than 1 N: the relative difference between its force and the stated one.
    differences: Vec<f64>,
}

impl Pages<'_> {
    /// Reads a page, which begins at this line of the file.
    fn page(&mut self, page: &str, first_line: u64) -> Result<()> {
        if page.trim().is_empty() {
            return Ok(());
        }
        let mut lines = (first_line..).zip(page.lines());
        let (mut size_mm, mut area_mm2, mut period, mut picture, mut is_frame) = (None, Ok(None), None, None, false);
        // The first line whose first non-empty field is a number contains the numbers of the columns.
        let columns = loop {
            let Some((line, row)) = lines.next() else {
                if is_frame {
                    let problem = "the page of a picture has no table";
                    return Err(Error::content(at_line(self.path, first_line), problem, CUT_OFF));
                }
                self.summaries += 1;
                return Ok(());
            };
            let place = || at_line(self.path, line);
            let value_of = |name: &str| {
                let value = row.split_once(name).map(|(_, value)| value.split('\t').next().unwrap_or(value));
                value.map(|value| value.trim_start_matches([':', ' ']))
            };
            if let Some(value) = value_of("Sensor size") {
                size_mm = Some(sizes_mm(value, &place)?);
            }
            if let Some(value) = value_of("Sensor area") {
                // The superscript 2 of the unit is not always readable.
                let mm2 = unit_in(value, [("cm", 100.0), ("mm", 1.0), ("", 100.0)], &place);
                area_mm2 = mm2.map(|mm2| first_number(value).map(|area| mm2 * area));
            }
            if let Some(value) = value_of("Time/picture") {
                let unit_s = unit_in(value, [("ms", 1e-3), ("s", 1.0), ("", 1.0)], &place)?;
                period = first_number(value).map(|time| (line, time * unit_s));
            }
            if let Some(value) = value_of(PICTURE) {
                is_frame = true;
                picture = first_number(value);
            }
            let mut fields = row.split('\t').map(str::trim).filter(|field| !field.is_empty());
            if fields.next().is_some_and(|field| field.parse::<usize>().is_ok()) {
                break (line, row);
            }
        };
        if !is_frame {
            self.summaries += 1;
            return Ok(());
        }
        let place = || at_line(self.path, first_line);
        // A page without the size of a sensor states its area; the sensor is then assumed to be square.
        let size_mm = match size_mm {
            Some(size_mm) => Some(size_mm),
            None => area_mm2?.map(|mm2| [mm2.sqrt(); 2]),
        };
        let size_mm = size_mm.filter(|size| size.iter().all(|mm| *mm > 0.0 && *mm <= MAX_CELL_MM));
        let (Some(size_mm), Some((period_line, period_s))) = (size_mm, period) else {
            let problem =
                format!("no sensor size of up to {MAX_CELL_MM} mm, or no time between pictures, on this page");
            return Err(Error::content(place(), problem, "export the measurement with the header of each page"));
        };
        check_period(period_s, &|| at_line(self.path, period_line))?;
        if self.size_mm.is_some_and(|before| before != size_mm)
            || self.period_s.is_some_and(|before| before != period_s)
        {
            let problem = "sensor size or time between pictures differs from that of the pages before";
            return Err(Error::content(place(), problem, "import each measurement on its own"));
        }
        (self.size_mm, self.period_s) = (Some(size_mm), Some(period_s));
        let t_s = self.time_s(picture, period_s, &place)?;
        self.table(columns, lines, t_s)
    }

    /// Time of a picture since the first one, s. It follows from the picture's number, because pictures may be missing. A
    /// picture without a number is given the number after that of the previous picture.
    fn time_s(&mut self, number: Option<f64>, period_s: f64, place: &dyn Fn() -> String) -> Result<f64> {
        let number = number.unwrap_or_else(|| self.pictures.map_or(0.0, |(_, last)| last + 1.0));
        if self.pictures.is_some_and(|(_, last)| number <= last) {
            let problem = format!("picture {number} follows a picture with the same or a greater number");
            return Err(Error::content(place(), problem, "import each measurement on its own"));
        }
        let first = self.pictures.map_or(number, |(first, _)| first);
        self.pictures = Some((first, number));
        Ok((number - first) * period_s)
    }

    /// Reads the table of the frame at this time. `columns` is the number and the text of the line with the columns' numbers.
    fn table<'a>(
        &mut self,
        columns: (u64, &str),
        mut lines: impl Iterator<Item = (u64, &'a str)>,
        t_s: f64,
    ) -> Result<()> {
        let place = || at_line(self.path, columns.0);
        let names: Vec<&str> = columns.1.split('\t').map(str::trim).filter(|name| !name.is_empty()).collect();
        let has_force = names.last() == Some(&FORCE);
        let numbers = names[..names.len() - usize::from(has_force)].iter().map(|name| index(name, "column", &place));
        let numbers = numbers.collect::<Result<Vec<usize>>>()?;
        // Of two rows or columns with the same number, only the last one would be imported.
        let repeated = |what: &str, place: &dyn Fn() -> String| {
            Error::content(place(), format!("a {what} number is repeated"), CUT_OFF)
        };
        if numbers.iter().collect::<BTreeSet<_>>().len() < numbers.len() {
            return Err(repeated("column", &place));
        }
        let mut rows = BTreeSet::new();
        let cell_mm2 = self.size_mm.map_or(0.0, |[width_mm, height_mm]| width_mm * height_mm);
        self.frames.begin(t_s);
        let (mut force_n, mut stated) = (0.0, None);
        for (line, row) in lines.by_ref() {
            let place = || at_line(self.path, line);
            if row.contains(PICTURE) {
                return Err(second_picture(place()));
            }
            let fields: Vec<&str> = row.trim_end().split('\t').map(str::trim).collect();
            if fields.iter().all(|field| field.is_empty()) {
                continue;
            }
            if fields[0] == FORCE {
                stated = fields.last().and_then(|field| first_number(field)).map(|stated_n| (line, stated_n));
                break;
            }
            let row_number = index(fields[0], "row", &place)?;
            if !rows.insert(row_number) {
                return Err(repeated("row", &place));
            }
            if fields.len() != names.len() + 1 {
                let problem = format!("{} values in a row, the table has {} columns", fields.len() - 1, names.len());
                return Err(Error::content(place(), problem, CUT_OFF));
            }
            let mut row_n = 0.0;
            fields[1..].iter().take(numbers.len()).for_each(|field| self.separators.add(field, line));
            for (field, &column) in fields[1..].iter().zip(&numbers) {
                let kpa = number(field, &format!("the pressure in column {column}"), &place)?;
                self.frames.add(row_number, column, kpa as f32);
                row_n += kpa.max(0.0) * cell_mm2 * 1e-3;
            }
            if has_force {
                check_force(row_n, number(fields[fields.len() - 1], "the force of the row", &place)?, &place)?;
            }
            force_n += row_n;
        }
        if let Some((line, _)) = lines.find(|(_, row)| row.contains(PICTURE)) {
            return Err(second_picture(at_line(self.path, line)));
        }
        // In known exports, the tables of all pictures have the same rows, so even that of a picture without load has some.
        if rows.is_empty() {
            return Err(Error::content(place(), "the table below has no rows", CUT_OFF));
        }
        let Some((line, stated_n)) = stated else {
            if has_force {
                let problem = "the table below ends without its total Force";
                return Err(Error::content(place(), problem, CUT_OFF));
            }
            return Ok(());
        };
        check_force(force_n, stated_n, &|| at_line(self.path, line))?;
        self.differences.extend((stated_n > 1.0).then(|| (force_n / stated_n - 1.0).abs()));
        Ok(())
    }
}

/// The error for a page with two pictures. `place` is the line of the second one.
fn second_picture(place: String) -> Error {
    let problem = "a second picture on this page: the form feeds between the pages are missing";
    Error::content(place, problem, "export the measurement again, and do not edit the file")
}

/// Checks the force on cells, N, against the force that the file states for them, N.
fn check_force(force_n: f64, stated_n: f64, place: &dyn Fn() -> String) -> Result<()> {
    // The file rounds forces to 0.01 N, and each pressure to 0.01 kPa.
    if (force_n - stated_n).abs() <= FORCE_TOLERANCE * stated_n + 0.02 {
        return Ok(());
    }
    Err(Error::content(
        place(),
        format!("the cells carry {force_n:.2} N, but the file states a Force of {stated_n:.2} N"),
        "export the measurement in kPa, and do not edit the file",
    ))
}

/// Parses the number of a row or a column; `what` is `row` or `column`.
fn index(field: &str, what: &str, place: &dyn Fn() -> String) -> Result<usize> {
    field.parse().ok().filter(|index| *index < MAX_LINES).ok_or_else(|| {
        let problem = format!("`{}` is not a {what} number from 0 to {}", shortened(field), MAX_LINES - 1);
        Error::content(place(), problem, CUT_OFF)
    })
}

/// The value of the unit after the number in a text. `units` lists beginnings of names of units with their values; the first one
/// that fits is used, and an empty name fits only a text without a unit.
///
/// # Errors
/// Fails for an unknown unit.
fn unit_in(text: &str, units: [(&str, f64); 3], place: &dyn Fn() -> String) -> Result<f64> {
    let unit = text.trim_start_matches(|c: char| !c.is_alphabetic()).to_lowercase();
    let fits = |name: &str| if name.is_empty() { unit.is_empty() } else { unit.starts_with(name) };
    units.into_iter().find(|(name, _)| fits(name)).map(|(_, value)| value).ok_or_else(|| {
        let problem = format!("unknown unit in `{}`", shortened(text));
        Error::content(place(), problem, "export the measurement with lengths in mm or cm, and times in ms or s")
    })
}

/// Width and height of a cell, mm, from a text such as `0.500x0.500 cm`.
fn sizes_mm(text: &str, place: &dyn Fn() -> String) -> Result<[f64; 2]> {
    let unit = text.trim().rsplit([' ', '\t']).next().unwrap_or("cm");
    let mm = units::mm(unit, place)?;
    let (width, height) = text.split_once('x').unwrap_or((text, text));
    match (first_number(width), first_number(height)) {
        (Some(width), Some(height)) => Ok([width * mm, height * mm]),
        _ => {
            let problem = format!("`{}` is not a size of a sensor", shortened(text));
            Err(Error::content(place(), problem, "export the measurement with the header of each page"))
        }
    }
}

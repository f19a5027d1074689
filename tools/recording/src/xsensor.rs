//! Import of in-shoe measurements by XSENSOR, from the CSV export of all frames.
//!
//! The header states the unit of pressure (`Units:`). Each frame begins with `FRAME` and its number, `Date` and `Time`. The
//! section of each insole begins with `SENSOR` and a name that contains LF or RF. It states the numbers of rows and columns,
//! the size of a cell, the vendor's contact area and load, and below `SENSELS` the pressures, from the toes to the heel and
//! as seen from above. Sections that begin with `GROUP` repeat cells and are skipped, as are the blank lines that XSENSOR's
//! program writes after each line. The fields of cells outside of the insole are empty, or contain a placeholder such as `B`
//! or `-`, a negative pressure or 0.

mod insole;

use crate::assembly::ParsedExport;
use crate::earlier::EarlierRecording;
use crate::separators::Separators;
use crate::table::{at_line, unreadable};
use crate::text::{decode, first_number, number, parse_number, shortened};
use crate::{Error, Result, clock, units};
use csv::{ReaderBuilder, StringRecord, Trim};
use insole::{Insole, check_equal, count, size_mm};
use plantar::Side;
use std::path::Path;

/// True for the text of an XSENSOR export.
pub fn recognise(text: &str) -> bool {
    let has = |word: &str| {
        text.lines().take(200).any(|line| label(line.split([',', ';', '\t']).next().unwrap_or("")) == word)
    };
    has("frame") && has("sensor") && (has("sensels") || has("units"))
}

/// Imports all feet of an export. `side` restricts the import to one foot. If there are `earlier` recordings, that of the same
/// foot states the layout.
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
    let mut reader = Reader {
        path,
        line: 0,
        kpa_per_unit: None,
        separators: Separators::default(),
        state: State::Header,
        frames: Vec::new(),
        insoles: [None, None],
    };
    let mut rows = ReaderBuilder::new()
        .trim(Trim::All)
        .flexible(true)
        .has_headers(false)
        .delimiter(delimiter(&text))
        .from_reader(text.as_bytes());
    let mut row = StringRecord::new();
    while rows.read_record(&mut row).map_err(|error| unreadable(path, error))? {
        // `rows` is at the beginning of the line after the record. The position of the record itself cannot be used, because it
        // is that of the first blank line before the record.
        reader.line = rows.position().line() - 1;
        reader.row(&row)?;
    }
    reader.check_no_open_table("the end of the file")?;
    reader.separators.check(path)?;
    reader.export(side, earlier)
}

/// A label in lower case, without quotation marks and colon.
fn label(field: &str) -> String {
    field.trim().trim_matches('"').trim_end_matches(':').trim().to_lowercase()
}

/// The delimiter of the fields: that of the first line that begins with `Units`, `FRAME` or `SENSOR`.
fn delimiter(text: &str) -> u8 {
    let labelled = text.lines().find(|line| {
        let line = line.trim_start_matches('"').to_lowercase();
        line.starts_with("units") || line.starts_with("frame") || line.starts_with("sensor")
    });
    let line = labelled.unwrap_or_default();
    *[b',', b';', b'\t'].iter().find(|&&c| line.as_bytes().contains(&c)).unwrap_or(&b',')
}

/// The part of the file in which the reader is.
#[derive(PartialEq)]
enum State {
    /// Before the first frame.
    Header,
    /// In a frame, but outside of the sections of insoles.
    Skipped,
    /// In the description of the insole of this foot.
    Sensor(Side),
    /// In the pressures of the insole of this foot, before this row.
    Sensels(Side, usize),
}

/// The description of a frame.
struct Frame {
    number: Option<u64>,
    /// Time of day, s.
    time_s: Option<f64>,
    /// Number of the line with `FRAME`.
    line: u64,
}

/// Reads an export line by line.
struct Reader<'a> {
    path: &'a Path,
    /// Number of the current line.
    line: u64,
    kpa_per_unit: Option<f64>,
    separators: Separators,
    state: State,
    frames: Vec<Frame>,
    /// Left and right.
    insoles: [Option<Insole>; 2],
}

/// The index of a foot in [`Reader::insoles`].
fn index(side: Side) -> usize {
    match side {
        Side::Left => 0,
        Side::Right => 1,
    }
}

impl Reader<'_> {
    fn place(&self) -> String {
        at_line(self.path, self.line)
    }

    fn insole(&mut self, side: Side) -> &mut Insole {
        self.insoles[index(side)].get_or_insert_default()
    }

    fn row(&mut self, row: &StringRecord) -> Result<()> {
        if row.iter().all(str::is_empty) {
            return Ok(());
        }
        let name = label(&row[0]);
        let value = row.get(1).unwrap_or("");
        let is_section = matches!(name.as_str(), "frame" | "sensor" | "group" | "sensels");
        if let State::Sensels(side, next) = self.state
            && !is_section
        {
            return self.pressures(row, side, next);
        }
        if is_section {
            self.check_no_open_table(&format!("`{}`", shortened(&row[0])))?;
        }
        match name.as_str() {
            "units" | "unit" => self.unit(value),
            "frame" => {
                let number = parse_number(value).filter(|n| (0.0..1e15).contains(n)).map(|n| n as u64);
                self.frames.push(Frame { number, time_s: None, line: self.line });
                self.state = State::Skipped;
                Ok(())
            }
            "time" => self.time(value),
            "sensor" => self.sensor(value),
            "group" => {
                self.state = State::Skipped;
                Ok(())
            }
            "sensels" => self.begin_table(),
            _ => self.property(&name, value),
        }
    }

    fn unit(&mut self, value: &str) -> Result<()> {
        let kpa = units::kpa(value, &|| self.place())?;
        if self.kpa_per_unit.is_some_and(|before| before != kpa) {
            let problem = format!("the unit changes to `{}` within the file", shortened(value));
            return Err(Error::content(self.place(), problem, "export all frames in one unit"));
        }
        self.kpa_per_unit = Some(kpa);
        Ok(())
    }

    fn time(&mut self, value: &str) -> Result<()> {
        let Some(frame) = self.frames.last_mut() else { return Ok(()) };
        frame.time_s = clock::time_of_day_s(value);
        if frame.time_s.is_some() {
            return Ok(());
        }
        Err(Error::content(
            self.place(),
            format!("`{}` is not a time of day", shortened(value)),
            "export the measurement with the time of each frame, such as 08:21:17.982",
        ))
    }

    /// Begins the description of a sensor. A sensor without the name of a foot is skipped.
    fn sensor(&mut self, name: &str) -> Result<()> {
        if self.frames.is_empty() {
            return Err(Error::content(self.place(), "a SENSOR before the first FRAME", "export all frames"));
        }
        let words = || name.split(|c: char| !c.is_ascii_alphanumeric());
        let has = |names: [&str; 2]| words().any(|word| names.iter().any(|name| word.eq_ignore_ascii_case(name)));
        let side = match (has(["LF", "LEFT"]), has(["RF", "RIGHT"])) {
            (true, false) => Side::Left,
            (false, true) => Side::Right,
            _ => {
                self.state = State::Skipped;
                return Ok(());
            }
        };
        let (frame, place) = (self.frames.len() - 1, self.place());
        let insole = self.insole(side);
        (insole.stated_force_n, insole.stated_area_mm2) = (None, None);
        if insole.indices.last() == Some(&frame) {
            let problem = format!("a second sensor of the {} foot in one frame", side.name());
            return Err(Error::content(place, problem, "export the insoles alone"));
        }
        self.state = State::Sensor(side);
        Ok(())
    }

    /// A line of the description of a sensor. Unknown names are ignored.
    fn property(&mut self, name: &str, value: &str) -> Result<()> {
        let State::Sensor(side) = self.state else { return Ok(()) };
        let place = self.place();
        let unit = name.split_once('(').map_or("", |(_, unit)| unit.trim_end_matches(')'));
        let property = name.split('(').next().unwrap_or(name).trim();
        let name = &shortened(name);
        let value_of = || number(value, name, &|| place.clone());
        let insole = self.insole(side);
        match property {
            "rows" => check_equal(&mut insole.rows, count(value, name, &place)?, name, &place),
            "columns" => check_equal(&mut insole.columns, count(value, name, &place)?, name, &place),
            "sensel width" => check_equal(&mut insole.cell_width_mm, size_mm(value_of()?, unit, &place)?, name, &place),
            "sensel height" => {
                check_equal(&mut insole.cell_height_mm, size_mm(value_of()?, unit, &place)?, name, &place)
            }
            "est. load" | "estimated load" | "load" => {
                insole.stated_force_n =
                    parse_number(value).zip(units::newtons_of(unit)).map(|(load, newtons)| load * newtons);
                Ok(())
            }
            "contact area" => {
                let mm = units::mm(unit.trim_end_matches(['2', '²', '^']), &|| place.clone()).ok();
                insole.stated_area_mm2 = first_number(value).zip(mm).map(|(area, mm)| area * mm * mm);
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn begin_table(&mut self) -> Result<()> {
        let State::Sensor(side) = self.state else { return Ok(()) };
        let (frame, place, unit) = (self.frames.len() - 1, self.place(), self.kpa_per_unit);
        let insole = self.insole(side);
        let missing = [
            (insole.rows.is_none(), "Rows"),
            (insole.columns.is_none(), "Columns"),
            (insole.cell_width_mm.is_none(), "Sensel Width"),
            (insole.cell_height_mm.is_none(), "Sensel Height"),
            (unit.is_none(), "Units"),
        ];
        if let Some((_, name)) = missing.iter().find(|(is_missing, _)| *is_missing) {
            let problem = format!("SENSELS without `{name}` before it");
            return Err(Error::content(
                place,
                problem,
                "export the measurement with the header and all sensor information",
            ));
        }
        insole.indices.push(frame);
        insole.frames.begin(frame as f64);
        (insole.pressure_sum_kpa, insole.loaded_cells) = (0.0, 0);
        self.state = State::Sensels(side, 0);
        Ok(())
    }

    /// Reads row `row_index`, counted from 0, of the pressures of an insole.
    fn pressures(&mut self, row: &StringRecord, side: Side, row_index: usize) -> Result<()> {
        let (place, kpa_per_unit) = (self.place(), self.kpa_per_unit.unwrap_or(1.0));
        let insole = self.insole(side);
        let (rows, columns) = (insole.rows.unwrap_or(0), insole.columns.unwrap_or(0));
        let found = (1..=row.len()).rev().find(|&i| !row[i - 1].is_empty()).unwrap_or(0);
        if found > columns || row.len() < columns {
            return Err(Error::content(
                place,
                format!(
                    "{} pressures, the sensor has {columns} columns",
                    if found > columns { found } else { row.len() }
                ),
                "export the measurement again, and do not edit the file",
            ));
        }
        for field in row.iter().take(columns) {
            self.separators.add(field, self.line);
        }
        let insole = self.insole(side);
        for (column, field) in row.iter().take(columns).enumerate() {
            let is_outside =
                field.is_empty() || matches!(field.to_uppercase().as_str(), "B" | "-" | "NAN" | "N/A" | "*");
            if is_outside {
                insole.without_pressure += 1;
                continue;
            }
            let kpa =
                kpa_per_unit * number(field, &format!("the pressure in column {}", column + 1), &|| place.clone())?;
            if kpa < 0.0 {
                insole.without_pressure += 1;
                continue;
            }
            insole.frames.add(row_index, column, kpa as f32);
            insole.pressure_sum_kpa += kpa;
            insole.loaded_cells += usize::from(kpa > 0.0);
        }
        self.state = State::Sensels(side, row_index + 1);
        if row_index + 1 == rows {
            self.end_table(side);
        }
        Ok(())
    }

    /// Ends a complete table of pressures, and adds its totals and those of the vendor to the comparison.
    fn end_table(&mut self, side: Side) {
        let insole = self.insole(side);
        let area_mm2 = insole.cell_width_mm.unwrap_or(0.0) * insole.cell_height_mm.unwrap_or(0.0);
        insole.totals.push_force(insole.pressure_sum_kpa * area_mm2 * 1e-3, insole.stated_force_n);
        insole.totals.push_area(insole.loaded_cells as f64 * area_mm2, insole.stated_area_mm2);
        self.state = State::Skipped;
    }

    /// Fails if the current table of pressures lacks rows. `found` describes the line that follows instead of the next row.
    fn check_no_open_table(&mut self, found: &str) -> Result<()> {
        let State::Sensels(side, rows_read) = self.state else { return Ok(()) };
        let rows = self.insole(side).rows.unwrap_or(0);
        Err(Error::content(
            self.place(),
            format!("{found} after {rows_read} of {rows} rows of pressures of the {} foot", side.name()),
            "the export is cut off or damaged, or a row has only empty fields, which count as a blank line: export or copy it \
             again, with a number for each cell",
        ))
    }

    /// The recordings of the feet.
    fn export(self, side: Option<Side>, earlier: &[EarlierRecording]) -> Result<ParsedExport> {
        let file = self.path.display().to_string();
        if self.frames.is_empty() {
            return Err(Error::content(file, "no line begins with FRAME", "export all frames as CSV"));
        }
        let mut times_s = Vec::with_capacity(self.frames.len());
        for frame in &self.frames {
            times_s.push(frame.time_s.ok_or_else(|| {
                let place = at_line(self.path, frame.line);
                Error::content(place, "a frame without Time", "export the measurement with the time of each frame")
            })?);
        }
        let numbers: Vec<u64> = self.frames.iter().filter_map(|frame| frame.number).collect();
        let t_s = clock::times_s(&numbers, &times_s);
        if let Some(i) = t_s.windows(2).position(|pair| pair[1] <= pair[0]) {
            let place = at_line(self.path, self.frames[i + 1].line);
            return Err(Error::content(
                place,
                "the time is not later than that of the frame before",
                "export the frames in order, with fractions of a second in their times; whole seconds suffice only for numbered \
                 frames and at least 6 s",
            ));
        }
        let mut export = ParsedExport::default();
        for (foot, insole) in [Side::Left, Side::Right].into_iter().zip(self.insoles) {
            let Some(insole) = insole.filter(|insole| !insole.indices.is_empty()) else { continue };
            if side.is_none_or(|side| side == foot) {
                insole.add_to(foot, &t_s, earlier, self.path, &mut export)?;
            }
        }
        if export.feet.is_empty() {
            let problem = match side {
                Some(side) => format!("no SENSOR of the {} foot, with LF or RF in its name", side.name()),
                None => "no SENSOR with LF or RF in its name".to_owned(),
            };
            let remedy = "export a measurement of insoles; if --side is given, check it";
            return Err(Error::content(file, problem, remedy));
        }
        Ok(export)
    }
}

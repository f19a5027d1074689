//! Import of measurements on a plate of the footscan system (RSscan), from the export "Dynamic Roll off": an Excel file
//! (`.xls`) or its text, in which tabs or semicolons separate the fields.
//!
//! `Left foot data` or `Right foot data` begins a foot. Each frame begins with `Frame`, its number and its time in ms, and
//! contains the force on each cell in N. The first row is at the lower edge of the picture of the plate in plan view.

use crate::assembly::ParsedExport;
use crate::export::ONE_CONTACT;
use crate::grid::{Foot, Frames, Grid, MAX_LINES, SWING_S, Toes};
use crate::table::{at_line, file_name};
use crate::text::{decode, first_number, number, shortened, side_of};
use crate::{Error, Result, units, xls};
use plantar::Side;
use std::path::Path;
use std::rc::Rc;

/// Extent of a cell along the plate, mm.
const CELL_LENGTH_MM: f64 = 7.62;
/// Extent of a cell across the plate, mm.
const CELL_WIDTH_MM: f64 = 5.08;
/// The first bytes of an Excel file, version 97 to 2003.
const XLS: &[u8] = &[0xd0, 0xcf, 0x11, 0xe0, 0xa1, 0xb1, 0x1a, 0xe1];
/// Longest field of the header that may state a unit, bytes. The cells of an Excel file share their texts, so that a small file
/// may have rows of very long ones.
const LONGEST_FIELD: usize = 1000;
/// The remedy for a frame without all of its values.
const CUT_OFF: &str = "the export is cut off or damaged: export or copy it again";

/// True for an Excel file, version 97 to 2003. Of all formats of [`crate::Format`], only footscan's export can be such a file.
pub fn is_xls(bytes: &[u8]) -> bool {
    bytes.starts_with(XLS)
}

/// True for the text of a footscan export.
pub fn recognise(text: &str) -> bool {
    text.lines().take(100).any(|line| frame_s(line).is_some())
}

/// The time of a frame, s, in a line such as `Frame 0 (0.00 ms)`.
fn frame_s(line: &str) -> Option<f64> {
    let (number, time) = line.trim().trim_matches('"').strip_prefix("Frame")?.split_once('(')?;
    let is_time = first_number(number).is_some() && time.contains("ms");
    is_time.then(|| first_number(time)).flatten().map(|ms| ms * 1e-3)
}

/// A foot of the export.
#[derive(Default)]
struct ReadFoot {
    /// The foot; `None` if the export does not state it.
    side: Option<Side>,
    frames: Frames,
    /// For each frame, its line and the number of its rows that were read.
    rows: Vec<(u64, usize)>,
    /// Number of columns of the last frame; `None` before its first row.
    columns: Option<usize>,
}

impl ReadFoot {
    /// Checks that all frames have the same number of rows. The export may be cut off between two rows of its last frame.
    fn check_rows(&self, path: &Path) -> Result<()> {
        for pair in self.rows.windows(2) {
            let ((_, before), (line, rows)) = (pair[0], pair[1]);
            if rows != before {
                let problem = format!("a frame of {rows} rows, the frame before has {before}");
                return Err(Error::content(at_line(path, line), problem, CUT_OFF));
            }
        }
        Ok(())
    }
}

/// Checks that a line of the header states no unit of pressure: the export is read as forces. Fields of more than
/// [`LONGEST_FIELD`] are ignored.
fn check_no_pressure_unit(fields: &[Rc<str>], place: &dyn Fn() -> String) -> Result<()> {
    let short: Vec<&str> = fields.iter().map(|field| &**field).filter(|field| field.len() <= LONGEST_FIELD).collect();
    let Some(unit) = units::stated(&short.join(" "), place)? else { return Ok(()) };
    let problem = format!("the header states pressures in {}, expected forces in N", unit.name);
    Err(Error::content(place(), problem, "export the dynamic roll off with the force on each cell, in N"))
}

/// Imports the feet of an export. `side` restricts the import to one foot, or states the foot if the export does not. Without it,
/// the end of the file's name (L, R, left or right) states the foot of such an export, or else the shape of the footprint does.
///
/// # Errors
/// Fails if the file is damaged or a line violates the format. The message names file, line and remedy.
pub(crate) fn parse(bytes: &[u8], path: &Path, side: Option<Side>) -> Result<ParsedExport> {
    let text;
    let rows: Vec<Vec<Rc<str>>> = if is_xls(bytes) {
        xls::rows(bytes).map_err(|reason| {
            let problem = format!("not a readable Excel file ({reason})");
            Error::content(path.display().to_string(), problem, "export or copy the measurement again")
        })?
    } else {
        text = decode(bytes, path)?;
        text.lines()
            .map(|line| line.split(['\t', ';']).map(|field| field.trim().trim_matches('"').into()).collect())
            .collect()
    };
    let mut feet: Vec<ReadFoot> = Vec::new();
    for (line, fields) in (1..).zip(&rows) {
        let place = || at_line(path, line);
        let filled = fields.iter().rposition(|field| !field.is_empty()).map_or(0, |last| last + 1);
        let fields = &fields[..filled];
        let Some(first) = fields.first() else { continue };
        let named = [("Left foot data", Side::Left), ("Right foot data", Side::Right)];
        if let Some((_, side)) = named.iter().find(|(name, _)| first.eq_ignore_ascii_case(name)) {
            if feet.iter().any(|foot| foot.side == Some(*side)) {
                let problem = format!("a second step of the {} foot begins here", side.name());
                return Err(Error::content(place(), problem, "export each step to a file of its own"));
            }
            feet.push(ReadFoot { side: Some(*side), ..ReadFoot::default() });
            continue;
        }
        if first.starts_with("Frame") {
            let Some(t_s) = frame_s(first) else {
                let problem = format!("`{}`, expected the number of a frame and its time in ms", shortened(first));
                return Err(Error::content(place(), problem, "export the measurement again, and do not edit the file"));
            };
            if feet.is_empty() {
                // The export does not state the foot.
                feet.push(ReadFoot::default());
            }
            let Some(foot) = feet.last_mut() else { continue };
            if foot.frames.t_s.last().is_some_and(|&before_s| t_s <= before_s) {
                let problem = format!("the time {t_s} s is not later than that of the frame before");
                return Err(Error::content(place(), problem, "export each measurement to a file of its own"));
            }
            foot.frames.begin(t_s);
            foot.rows.push((line, 0));
            foot.columns = None;
            continue;
        }
        // Before the first frame of a foot, lines describe the measurement.
        let begun = feet.last_mut().and_then(|foot| Some((&mut foot.frames, foot.rows.last_mut()?, &mut foot.columns)));
        let Some((frames, (_, rows_read), columns)) = begun else {
            check_no_pressure_unit(fields, &place)?;
            continue;
        };
        let expected = *columns.get_or_insert(filled);
        if expected != filled || *rows_read >= MAX_LINES || filled > MAX_LINES {
            if expected != filled {
                let problem = format!("{filled} values, the rows before have {expected}");
                return Err(Error::content(place(), problem, CUT_OFF));
            }
            let problem = format!("a frame of more than {MAX_LINES} rows or columns");
            return Err(Error::content(place(), problem, format!("export at most {MAX_LINES} rows and columns")));
        }
        for (column, field) in fields.iter().enumerate() {
            let force_n = number(field, &format!("the force in column {}", column + 1), &place)?;
            let kpa = force_n / (CELL_LENGTH_MM * CELL_WIDTH_MM) * 1e3;
            // `Grid` numbers rows from the top, and the first row of the export is at the lower edge.
            frames.add(MAX_LINES - 1 - *rows_read, column, kpa as f32);
        }
        *rows_read += 1;
    }
    let mut export = ParsedExport::default();
    feet.retain(|foot| !foot.rows.is_empty());
    let one_contact = if feet.len() == 1 { format!(" {ONE_CONTACT}") } else { String::new() };
    let wanted = feet.into_iter().filter(|foot| foot.side.is_none() || side.is_none() || foot.side == side);
    let mut starts_s = Vec::new();
    for foot in wanted {
        foot.check_rows(path)?;
        let ReadFoot { side: stated, frames, .. } = foot;
        let side = stated.or(side);
        // With the foot in the export, the name of the file is not needed, and may be that of both feet.
        let named = if stated.is_none() { side_of(&file_name(path)) } else { None };
        starts_s.extend(frames.loaded_start_s());
        let foot = Foot {
            side,
            named,
            grid: Grid { row_mm: CELL_LENGTH_MM, column_mm: CELL_WIDTH_MM, toes: Toes::AlongMovement },
            earlier: &[],
            frames: frames.with_swing(side.or(named), path, &mut export.remarks)?,
            name: "footscan plate".to_owned(),
            source: format!(
                "footscan measurement {}, {SWING_S} s without load added before and after, regions by \
                 template.{one_contact}",
                file_name(path)
            ),
        };
        export.feet.push(foot.recording(path, &mut export.remarks)?);
    }
    if let [left_s, right_s] = starts_s[..]
        && left_s == right_s
    {
        export.remarks.push(
            "Both feet carry load in their first frames, which have the same time: the times of each foot may begin with its own \
             contact. Do not compare times between the feet."
                .to_owned(),
        );
    }
    if export.feet.is_empty() {
        let problem =
            format!("no frame of {}", side.map_or("a foot".to_owned(), |side| format!("the {} foot", side.name())));
        let remedy = "export the dynamic roll off of one step; if --side is given, check it";
        return Err(Error::content(path.display().to_string(), problem, remedy));
    }
    Ok(export)
}

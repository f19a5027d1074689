//! Import from two CSV files: one describes the layout of the cells, the other contains the frames.
//!
//! The layout has the header `cell,x_mm,y_mm,area_mm2` and optionally `region`. Cells are numbered from 0 without gaps. Their
//! positions are in foot coordinates ([`Cell`]). If the layout has no regions, [`template`] assigns them. The frames have the
//! header `t_s,c0,c1,...`: time in seconds and the pressure of each cell in kPa. Unless the frames are resampled, the times must
//! be uniform. A negative pressure is read as 0. In both files, semicolons may separate the fields; numbers may then have decimal
//! commas.

use crate::check::{self, At};
use crate::numbered::NumberedFrames;
use crate::separators::Separators;
use crate::span::Span;
use crate::table::{self, Lines, at_line, check_later, check_width, empty_field, file_name, number, unreadable};
use crate::text::shortened;
use crate::{Cell, Error, Layout, Recording, Result, gaps, names, rate, template};
use ::csv::{ByteRecord, StringRecord};
use plantar::{Region, Side};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Largest overlap of two cells, as a fraction of the smaller cell. Some overlap is allowed, because drawn layouts are not
/// exact.
const MAX_OVERLAP: f64 = 0.25;
/// The ratios of medial-lateral width to heel-toe length that are tried for the cells of a layout, squares first. Because some
/// overlap is allowed, layouts of cells with any ratio from 1/7 to 7 pass.
const ASPECTS: [f64; 5] = [1.0, 2.0, 0.5, 4.0, 0.25];
/// The number of rows that are read between two calls of `progress`.
const ROWS_PER_REPORT: usize = 1000;

/// Imports one foot, of the frames within `span`. With `rate_hz`, they are resampled to this rate ([`Recording::at_rate`]), so
/// that the intervals between their times may differ; [`Recording::source`] states how many are longer than usual, and how many
/// negative pressures of the file were read as 0. `progress` receives the number of bytes that have been read from the file of
/// frames, and the size of that file.
///
/// # Errors
/// Fails if a file cannot be read, violates the format or contains impossible values. The message names the file and, if one
/// line is wrong, this line.
pub fn import(
    layout_path: impl AsRef<Path>,
    frames_path: impl AsRef<Path>,
    side: Side,
    span: Span,
    rate_hz: Option<f64>,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Recording> {
    let (layout_path, frames_path) = (layout_path.as_ref(), frames_path.as_ref());
    let layout = read_layout(File::open(layout_path).map_err(Error::io(layout_path))?, layout_path)?;
    let frames = File::open(frames_path).map_err(Error::io(frames_path))?;
    let total_bytes = frames.metadata().map_err(Error::io(frames_path))?.len();
    let mut progress = |done_bytes| progress(done_bytes, total_bytes);
    let frames = read_frames(frames, frames_path, layout_path, layout.cells.len(), &mut progress)?;
    progress(total_bytes);
    recording(layout, layout_path, frames, frames_path, side, span, rate_hz)
}

/// As [`import`], from text and without resampling. In messages the two texts are called `layout.csv` and `frames.csv`.
///
/// # Errors
/// Fails if a text violates the format or contains impossible values.
pub fn parse(layout: impl Read, frames: impl Read, side: Side) -> Result<Recording> {
    let (layout_path, frames_path) = (Path::new("layout.csv"), Path::new("frames.csv"));
    let layout = read_layout(layout, layout_path)?;
    let frames = read_frames(frames, frames_path, layout_path, layout.cells.len(), &mut |_| {})?;
    recording(layout, layout_path, frames, frames_path, side, Span::default(), None)
}

/// The recording of the frames within `span`, resampled to `resampled_hz` if it is given. Messages name the two files.
fn recording(
    layout: Layout,
    layout_path: &Path,
    mut frames: NumberedFrames,
    frames_path: &Path,
    side: Side,
    span: Span,
    resampled_hz: Option<f64>,
) -> Result<Recording> {
    let mut source = format!("CSV import of {} with the layout {}.", file_name(frames_path), file_name(layout_path));
    if let Some((part, sentence)) = span.part(&frames.t_s, frames_path)? {
        frames = frames.part(part, layout.cells.len());
        source += &format!(" {sentence}");
    }
    let place = |at: At| match at {
        At::Whole => frames_path.display().to_string(),
        At::Frame(frame) => at_line(frames_path, frames.lines[frame]),
        At::Value { frame, cell } => format!("{}, column c{cell}", at_line(frames_path, frames.lines[frame])),
    };
    let rate_hz = match resampled_hz {
        None => rate::of(&frames.t_s, &place)?,
        Some(_) => rate::of_uneven(&frames.t_s, &place)?,
    };
    check::pressures(&frames.pressure_kpa, layout.cells.len(), &place)?;
    if let Some(sentences) = resampled_hz.and_then(|_| gaps::long_intervals(&frames.t_s)) {
        source += &format!(" {sentences}");
    }
    if let Some(remark) = frames.negatives.remark(side) {
        source += &format!(" {remark}");
    }
    let recording = Recording { side, rate_hz, source, layout, t_s: frames.t_s, pressure_kpa: frames.pressure_kpa };
    match resampled_hz {
        None => Ok(recording),
        Some(rate_hz) => recording.at_rate(rate_hz),
    }
}

fn read_layout(from: impl Read, path: &Path) -> Result<Layout> {
    let mut reader = table::open(from, path)?;
    let header = table::header(&mut reader, path)?;
    let columns = layout_columns(&header, path)?;
    // (cell number, line, cell), sorted by number below.
    let mut rows: Vec<(usize, u64, Cell)> = Vec::new();
    let (lines, mut record) = (Lines::after_header(&reader), StringRecord::new());
    while reader.read_record(&mut record).map_err(|e| unreadable(path, e))? {
        let line = lines.of(&reader, record.position());
        let place = || at_line(path, line);
        check_width(record.len(), header.len(), &place)?;
        let value = |column: usize| number(&record[column], &header[column], &place);
        if record[columns.cell].is_empty() {
            return Err(empty_field("cell", &place));
        }
        let Ok(id) = record[columns.cell].parse::<usize>() else {
            return Err(Error::content(
                place(),
                format!("`{}` is not a cell number", shortened(&record[columns.cell])),
                "number the cells 0, 1, 2, ...",
            ));
        };
        let area_mm2 = value(columns.area_mm2)?;
        if area_mm2 <= 0.0 {
            return Err(Error::content(
                place(),
                format!("cell {id} has an area of {area_mm2} mm²"),
                "state a positive area for each cell",
            ));
        }
        let region = match columns.region {
            // Replaced by the template after all cells are read.
            None => Region::Heel,
            Some(column) => Region::from_name(&record[column]).ok_or_else(|| {
                Error::content(
                    place(),
                    format!("unknown region `{}`", shortened(&record[column])),
                    format!("use one of {}", names::all_regions()),
                )
            })?,
        };
        let cell = Cell { x_mm: value(columns.x_mm)?, y_mm: value(columns.y_mm)?, area_mm2, region };
        rows.push((id, line, cell));
    }
    check::cell_count(rows.len(), &path.display().to_string())?;
    rows.sort_by_key(|&(id, line, _)| (id, line));
    check_numbering(&rows, path)?;
    check_overlap(&rows, path)?;
    let mut cells: Vec<Cell> = rows.into_iter().map(|(_, _, cell)| cell).collect();
    if columns.region.is_none() {
        template::assign(&mut cells);
    }
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let layout = Layout { name, cells, sheet: None };
    check::layout(&layout, &path.display().to_string())?;
    Ok(layout)
}

/// The index of each column in the file of the layout.
struct LayoutColumns {
    cell: usize,
    x_mm: usize,
    y_mm: usize,
    area_mm2: usize,
    region: Option<usize>,
}

/// Finds the columns in the header of the layout.
fn layout_columns(header: &StringRecord, path: &Path) -> Result<LayoutColumns> {
    const KNOWN: [&str; 5] = ["cell", "x_mm", "y_mm", "area_mm2", "region"];
    let remedy = "the header is cell,x_mm,y_mm,area_mm2 and optionally region";
    for (i, name) in header.iter().enumerate() {
        let problem = if !KNOWN.contains(&name) {
            format!("unknown column `{}`", shortened(name))
        } else if header.iter().take(i).any(|earlier| earlier == name) {
            format!("column `{name}` appears twice")
        } else {
            continue;
        };
        return Err(Error::content(at_line(path, 1), problem, remedy));
    }
    let find = |name: &str| header.iter().position(|column| column == name);
    let need =
        |name: &str| find(name).ok_or_else(|| Error::content(at_line(path, 1), format!("no column `{name}`"), remedy));
    Ok(LayoutColumns {
        cell: need("cell")?,
        x_mm: need("x_mm")?,
        y_mm: need("y_mm")?,
        area_mm2: need("area_mm2")?,
        region: find("region"),
    })
}

/// Checks that the cell numbers of sorted rows are 0, 1, 2, ...
fn check_numbering(rows: &[(usize, u64, Cell)], path: &Path) -> Result<()> {
    for (expected, &(id, line, _)) in rows.iter().enumerate() {
        if id < expected {
            let (_, earlier, _) = rows[expected - 1];
            return Err(Error::content(
                at_line(path, line),
                format!("cell {id} is already on line {earlier}"),
                "number every cell once",
            ));
        }
        if id > expected {
            return Err(Error::content(
                at_line(path, line),
                format!("cell {expected} is missing; the next one is cell {id}"),
                "number the cells 0, 1, 2, ... without gaps",
            ));
        }
    }
    Ok(())
}

/// The inadmissible overlaps of the cells of a layout, if all cells are rectangles with the same ratio of width to length.
struct Overlaps {
    /// Number of pairs of cells.
    pairs: usize,
    /// Number and line of each cell of the first pair.
    cells: [(usize, u64); 2],
    /// The overlap of the first pair as a fraction of the smaller cell.
    fraction: f64,
    /// Ratio of width to length of each cell.
    aspect: f64,
}

/// Checks that cells do not overlap by more than [`MAX_OVERLAP`]. A layout states no widths, so it is accepted if this is the
/// case for rectangles with one of the [`ASPECTS`], parallel to the axes.
fn check_overlap(rows: &[(usize, u64, Cell)], path: &Path) -> Result<()> {
    let mut least: Option<Overlaps> = None;
    for aspect in ASPECTS {
        let Some(overlaps) = overlaps(rows, aspect) else { return Ok(()) };
        // With the true ratio, only cells with a wrong position or area overlap, so the ratio with the fewest overlaps is
        // reported.
        if least.as_ref().is_none_or(|least| overlaps.pairs < least.pairs) {
            least = Some(overlaps);
        }
    }
    let Some(Overlaps { cells: [(a, line_a), (b, line_b)], fraction, aspect, .. }) = least else { return Ok(()) };
    Err(Error::content(
        at_line(path, line_a.max(line_b)),
        format!(
            "if the width of each cell is {aspect} times its length, cell {a} (line {line_a}) and cell {b} (line {line_b}) overlap \
             by {:.0} % of the smaller cell",
            100.0 * fraction
        ),
        "correct the positions or areas of these cells",
    ))
}

/// The inadmissible overlaps of cells that are rectangles with this ratio of width to length; `None` if there are none.
fn overlaps(rows: &[(usize, u64, Cell)], aspect: f64) -> Option<Overlaps> {
    let half_extent_mm = |cell: &Cell| (cell.half_side_mm() * aspect.sqrt(), cell.half_side_mm() / aspect.sqrt());
    let mut by_x: Vec<_> = rows.iter().collect();
    by_x.sort_by(|(_, _, a), (_, _, b)| a.x_mm.total_cmp(&b.x_mm));
    let widest_mm = rows.iter().map(|(_, _, cell)| half_extent_mm(cell).0).fold(0.0, f64::max);
    let mut found: Option<Overlaps> = None;
    for (i, &(id, line, cell)) in by_x.iter().enumerate() {
        let (half_x_mm, half_y_mm) = half_extent_mm(cell);
        for (other_id, other_line, other) in &by_x[i + 1..] {
            if other.x_mm - cell.x_mm > half_x_mm + widest_mm {
                break;
            }
            let (other_half_x_mm, other_half_y_mm) = half_extent_mm(other);
            let shared_mm2 = shared_mm((cell.x_mm, half_x_mm), (other.x_mm, other_half_x_mm))
                * shared_mm((cell.y_mm, half_y_mm), (other.y_mm, other_half_y_mm));
            let fraction = shared_mm2 / cell.area_mm2.min(other.area_mm2);
            if fraction > MAX_OVERLAP {
                let cells = [(*id, *line), (*other_id, *other_line)];
                found.get_or_insert(Overlaps { pairs: 0, cells, fraction, aspect }).pairs += 1;
            }
        }
    }
    found
}

/// The common length of two intervals, given by their centres and half lengths.
fn shared_mm((a, half_a): (f64, f64), (b, half_b): (f64, f64)) -> f64 {
    ((a + half_a).min(b + half_b) - (a - half_a).max(b - half_b)).max(0.0)
}

fn read_frames(
    from: impl Read,
    path: &Path,
    layout_path: &Path,
    cells: usize,
    progress: &mut dyn FnMut(u64),
) -> Result<NumberedFrames> {
    let mut reader = table::open(from, path)?;
    let header = table::header(&mut reader, path)?;
    check_frames_header(&header, path, layout_path, cells)?;
    let has_decimal_commas = reader.get_ref().has_decimal_commas;
    let mut frames = NumberedFrames::default();
    let mut separators = Separators::default();
    let (lines, mut record) = (Lines::after_header(&reader), ByteRecord::new());
    while reader.read_byte_record(&mut record).map_err(|e| unreadable(path, e))? {
        let line = lines.of(&reader, record.position());
        let place = || at_line(path, line);
        check_width(record.len(), header.len(), &place)?;
        let field = |column: usize| std::str::from_utf8(&record[column]).unwrap_or("?");
        let now_s = number(field(0), &header[0], &place)?;
        check_later(now_s, frames.t_s.last().copied(), &place)?;
        frames.t_s.push(now_s);
        frames.lines.push(line);
        for column in 1..record.len() {
            if has_decimal_commas {
                separators.add(field(column), line);
            }
            let kpa = number(field(column), &header[column], &place)? as f32;
            frames.pressure_kpa.push(frames.negatives.clip(kpa));
        }
        if frames.lines.len().is_multiple_of(ROWS_PER_REPORT) {
            progress(reader.position().byte());
        }
    }
    separators.check(path)?;
    Ok(frames)
}

/// Checks that the header of the frames matches the number of cells of the layout.
fn check_frames_header(header: &StringRecord, path: &Path, layout_path: &Path, cells: usize) -> Result<()> {
    let problem = |problem: String, remedy: &str| Err(Error::content(at_line(path, 1), problem, remedy));
    for (i, name) in header.iter().enumerate() {
        let expected = match i {
            0 => "t_s".to_owned(),
            _ => format!("c{}", i - 1),
        };
        if name != expected {
            return problem(
                format!("column {} is `{}`, expected `{expected}`", i + 1, shortened(name)),
                "the header is t_s,c0,c1,... with one column for each cell",
            );
        }
    }
    if header.len() != cells + 1 {
        return problem(
            format!(
                "{} cell columns, but {} describes {cells} cells",
                header.len().saturating_sub(1),
                layout_path.display()
            ),
            "use a layout and frames of the same cells",
        );
    }
    Ok(())
}

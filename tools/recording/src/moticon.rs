//! Import of in-shoe measurements by Moticon's OpenGo insoles, from the text export.
//!
//! Lines that begin with `#` describe the measurement; the last one names the columns, which tabs separate. Each foot has the
//! pressures of 16 cells in N/cm², its total force in N and its centre of pressure. Empty fields mean that a frame was lost.
//!
//! The export states no geometry. The areas of the cells are those that reproduce the total force best. The centres of the
//! cells are those that reproduce the vendor's centre of pressure, as fractions of the length and the width of the insole; they
//! are the same in all sizes and for both feet. They were determined from the exports in the package `moticon-opengo`
//! (Apache-2.0, Moticon).

use crate::assembly::{ParsedExport, UncheckedRecording};
use crate::earlier::EarlierRecording;
use crate::export::measured_at;
use crate::footprint::capitalised;
use crate::least_squares;
use crate::table::{another_measurement, at_line, check_later, file_name};
use crate::text::{decode, number, shortened, strip_name};
use crate::{Cell, Error, Layout, Result, template, units};
use plantar::{Region, Side};
use std::path::Path;

/// Name of the layout.
const NAME: &str = "Moticon OpenGo insole";
/// Number of cells of an insole.
const CELLS: usize = 16;
/// The unit of the pressures, N/cm², in kPa.
const KPA_PER_UNIT: f64 = 10.0;
/// Centres of the cells, in the order of their numbers, relative to the middle of the insole: the distance towards the toes
/// as a fraction of the insole's length, and the distance towards the medial side as a fraction of its width.
const CENTRES: [[f64; 2]; CELLS] = [
    [-0.404, 0.109],
    [-0.417, -0.166],
    [-0.266, 0.089],
    [-0.287, -0.225],
    [-0.125, 0.061],
    [-0.152, -0.273],
    [0.080, 0.242],
    [-0.012, -0.392],
    [0.256, 0.274],
    [0.241, 0.064],
    [0.226, -0.116],
    [0.207, -0.294],
    [0.170, -0.462],
    [0.413, 0.178],
    [0.408, -0.082],
    [0.359, -0.312],
];
/// Typical areas of the cells as fractions of their sum. They replace areas that a measurement does not determine, because the
/// cells are hardly loaded. The other areas differ from them by at most half.
const AREAS: [f64; CELLS] = [
    0.0604, 0.0540, 0.0652, 0.0641, 0.0641, 0.0636, 0.0877, 0.0889, 0.0765, 0.0607, 0.0611, 0.0619, 0.0500, 0.0495,
    0.0611, 0.0312,
];
/// Length of an insole divided by the square root of the total area of its cells. A typical insole of size 45 is 297 mm long, and
/// its cells have 20,480 mm² in total.
const LENGTH: f64 = 2.07;
/// Width of an insole divided by its length.
const WIDTH: f64 = 0.345;
/// Assumed total area of the cells if the recording contains no load that determines it, mm2: about size 42.
const TYPICAL_MM2: f64 = 18_000.0;

/// True for the text of a Moticon OpenGo export.
pub fn recognise(text: &str) -> bool {
    text.lines()
        .take(60)
        .any(|line| line.starts_with('#') && line.contains(" pressure 1[") && line.contains("total force["))
}

/// The columns of a foot: those of its pressures, and that of its total force.
struct Columns {
    pressures: Vec<usize>,
    total: usize,
}

/// Imports the feet of an export. `side` restricts the import to one foot. If there are `earlier` recordings, that of the same
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
    let mut lines = (1..).zip(text.lines());
    let Some((header_line, header)) = lines.by_ref().find(|(_, line)| line.starts_with("# time")) else {
        let problem = "no line with the names of the columns, which begins with `# time`";
        return Err(Error::content(path.display().to_string(), problem, "export the measurement as text"));
    };
    let names: Vec<&str> = header.split('\t').map(str::trim).collect();
    if names.len() == 1 {
        let problem = "tabs do not separate the names of the columns";
        return Err(Error::content(at_line(path, header_line), problem, "export the measurement as text, with tabs"));
    }
    if let Some((line, _)) = lines.clone().find(|(_, row)| row.starts_with("# time")) {
        return Err(another_measurement(at_line(path, line)));
    }
    let rows: Vec<(u64, Vec<&str>)> = lines
        .filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'))
        .map(|(line, row)| {
            let mut fields: Vec<&str> = row.split('\t').map(str::trim).collect();
            // A program that edits the file may add a tab at the end of each line.
            while fields.len() > names.len() && fields.last().is_some_and(|last| last.is_empty()) {
                fields.pop();
            }
            (line, fields)
        })
        .collect();
    for (line, row) in &rows {
        if row.len() != names.len() {
            let problem = format!("{} columns, the header has {}", row.len(), names.len());
            return Err(Error::content(
                at_line(path, *line),
                problem,
                "the export is cut off or damaged: export or copy it again",
            ));
        }
    }
    let stated = |name: &str| {
        let mut header = text.lines().take_while(|row| row.starts_with('#'));
        header.find_map(|row| strip_name(row.trim_start_matches('#'), name)).map_or("", str::trim)
    };
    let mut circumstances = measured_at(stated("Start time:"));
    if !stated("Size:").is_empty() {
        circumstances += &format!(" The export states size {}.", shortened(stated("Size:")));
    }
    let mut export = ParsedExport::default();
    for foot in [Side::Left, Side::Right].into_iter().filter(|foot| side.is_none_or(|side| side == *foot)) {
        let columns = columns(&names, foot, &at_line(path, header_line))?;
        if let Some(columns) = columns {
            read_foot(foot, &columns, &rows, path, &circumstances, earlier, &mut export)?;
        }
    }
    if export.feet.is_empty() {
        let problem = "no frame with the pressures and the total force of a foot";
        return Err(Error::content(
            path.display().to_string(),
            problem,
            "export a measurement with pressures and total force; if --side is given, check it",
        ));
    }
    Ok(export)
}

/// The columns of a foot; `None` if the export has no pressures of this foot.
fn columns(names: &[&str], side: Side, place: &str) -> Result<Option<Columns>> {
    let find = |what: &str| {
        let name = format!("{} {what}", side.name());
        names.iter().position(|found| found.strip_prefix(name.as_str()).is_some_and(|unit| unit.starts_with('[')))
    };
    let pressures: Vec<usize> = (1..=CELLS).filter_map(|cell| find(&format!("pressure {cell}"))).collect();
    if pressures.is_empty() {
        return Ok(None);
    }
    let unit = |column: usize| names[column].rsplit_once('[').map_or("", |(_, unit)| unit.trim_end_matches(']'));
    if pressures.iter().any(|&column| units::kpa_of(unit(column)) != Some(KPA_PER_UNIT)) {
        return Err(Error::content(place, "pressures in another unit than N/cm²", "export the measurement in N/cm²"));
    }
    match find("total force") {
        Some(total) if units::newtons_of(unit(total)) != Some(1.0) => Err(Error::content(
            place,
            format!("the total force of the {} foot has the unit [{}]", side.name(), shortened(unit(total))),
            "export the total force in N",
        )),
        Some(total) if pressures.len() == CELLS => Ok(Some(Columns { pressures, total })),
        _ => Err(Error::content(
            place,
            format!("columns of the {} foot are missing: expected {CELLS} pressures and the total force", side.name()),
            "export the measurement with all pressures and the total force",
        )),
    }
}

/// Reads a foot. A foot without frames is left out. `circumstances` are sentences for the source, each with a blank before it.
fn read_foot(
    side: Side,
    columns: &Columns,
    rows: &[(u64, Vec<&str>)],
    path: &Path,
    circumstances: &str,
    earlier: &[EarlierRecording],
    export: &mut ParsedExport,
) -> Result<()> {
    let (mut t_s, mut pressure_kpa, mut totals_n): (Vec<f64>, Vec<f32>, Vec<f64>) = Default::default();
    for (line, row) in rows {
        let place = || at_line(path, *line);
        if columns.pressures.iter().chain([&columns.total]).any(|&column| row[column].is_empty()) {
            continue;
        }
        let now_s = number(row[0], "the time", &place)?;
        check_later(now_s, t_s.last().copied(), &place)?;
        t_s.push(now_s);
        totals_n.push(number(row[columns.total], "the total force", &place)?);
        for (cell, &column) in columns.pressures.iter().enumerate() {
            let n_cm2 = number(row[column], &format!("{} pressure {}", side.name(), cell + 1), &place)?;
            pressure_kpa.push((KPA_PER_UNIT * n_cm2) as f32);
        }
    }
    if t_s.is_empty() {
        return Ok(());
    }
    let earlier = EarlierRecording::of(earlier, side, path)?;
    let layout = match earlier {
        Some(earlier) => {
            earlier.check_sensor(NAME)?;
            earlier.check_cells(CELLS)?;
            earlier.layout().clone()
        }
        None => Layout { name: NAME.to_owned(), cells: cells(&areas_mm2(&pressure_kpa, &totals_n)), sheet: None },
    };
    let forces_n: Vec<f64> = pressure_kpa.chunks_exact(CELLS).map(|frame| layout.force_n(frame)).collect();
    if let Some(earlier) = earlier {
        check_size(&forces_n, &totals_n, earlier, path)?;
    }
    let squares = forces_n.iter().zip(&totals_n).map(|(force_n, total_n)| (force_n - total_n).powi(2));
    let rms_n = (squares.sum::<f64>() / totals_n.len() as f64).sqrt();
    let origin = match earlier {
        Some(earlier) => format!("the cells, areas and regions are those of {}", earlier.name()),
        None => "areas of the cells by least squares".to_owned(),
    };
    export.remarks.push(format!(
        "{} foot: {origin}, {:.0} mm2 in total; \
         the force differs from the vendor's by {rms_n:.2} N (root mean square of {} frames).",
        capitalised(side),
        layout.cells.iter().map(|cell| cell.area_mm2).sum::<f64>(),
        totals_n.len()
    ));
    let unchecked = UncheckedRecording {
        side,
        layout,
        t_s,
        pressure_kpa,
        source: format!(
            "Moticon OpenGo measurement {}, {} insole, regions by template.{circumstances}",
            file_name(path),
            side.name()
        ),
    };
    export.feet.push(unchecked);
    Ok(())
}

/// Checks that the forces on the cells of an earlier recording agree with the total forces of the export, N.
fn check_size(forces_n: &[f64], totals_n: &[f64], earlier: &EarlierRecording, path: &Path) -> Result<()> {
    /// Largest difference between the sums over all frames, as a fraction. With the areas from another walk in the same insole,
    /// it is less than 0.001. From one size to the next, the areas differ by some 0.09.
    const MOST_DIFFERENCE: f64 = 0.03;
    let sum = |forces_n: &[f64]| forces_n.iter().sum::<f64>();
    let (force_sum_n, total_sum_n) = (sum(forces_n), sum(totals_n));
    if (force_sum_n - total_sum_n).abs() <= MOST_DIFFERENCE * total_sum_n.abs() {
        return Ok(());
    }
    Err(Error::content(
        path.display().to_string(),
        format!(
            "with the areas of the cells in {}, the force on the {} foot is {:.1} % of the vendor's: the insole is of another \
             size",
            earlier.path().display(),
            earlier.side().name(),
            100.0 * force_sum_n / total_sum_n
        ),
        "name a recording of the same foot on the same insole, or leave out --like",
    ))
}

/// The areas with which the pressures, kPa, best reproduce the total forces, N.
fn areas_mm2(pressure_kpa: &[f32], totals_n: &[f64]) -> [f64; CELLS] {
    /// Weight of the squared deviations from the typical areas in the sum of squares, relative to the sum of the squared
    /// pressures over all frames, averaged over the cells. It affects only cells that are hardly loaded.
    const TYPICAL_WEIGHT: f64 = 1e-6;
    let frames = || pressure_kpa.as_chunks::<CELLS>().0.iter().map(|frame| frame.map(f64::from)).zip(totals_n);
    let (mut product, mut square) = (0.0, 0.0);
    for (frame, total_n) in frames() {
        let typical: f64 = frame.iter().zip(AREAS).map(|(kpa, area)| kpa * area * 1e-3).sum();
        product += typical * total_n;
        square += typical * typical;
    }
    let sum_mm2 = if square > 0.0 && product > 0.0 { product / square } else { TYPICAL_MM2 };
    let typical_mm2 = AREAS.map(|area| area * sum_mm2);
    // The normal equations of the deviations from the typical areas.
    let (mut matrix, mut right) = ([[0.0; CELLS]; CELLS], [0.0; CELLS]);
    for (frame, total_n) in frames() {
        let rest_n = total_n - frame.iter().zip(typical_mm2).map(|(kpa, mm2)| kpa * mm2 * 1e-3).sum::<f64>();
        for i in 0..CELLS {
            for j in 0..CELLS {
                matrix[i][j] += frame[i] * frame[j] * 1e-6;
            }
            right[i] += frame[i] * rest_n * 1e-3;
        }
    }
    let mean = (0..CELLS).map(|i| matrix[i][i]).sum::<f64>() / CELLS as f64;
    (0..CELLS).for_each(|i| matrix[i][i] += TYPICAL_WEIGHT * mean.max(f64::MIN_POSITIVE));
    let Some(deviation_mm2) = least_squares::solve(matrix, right) else { return typical_mm2 };
    // An area that differs from the typical one by more than half is not plausible.
    std::array::from_fn(|i| (typical_mm2[i] + deviation_mm2[i]).clamp(0.5 * typical_mm2[i], 1.5 * typical_mm2[i]))
}

/// The cells of an insole with these areas, in foot coordinates.
fn cells(areas_mm2: &[f64; CELLS]) -> Vec<Cell> {
    let length_mm = LENGTH * areas_mm2.iter().sum::<f64>().sqrt();
    let width_mm = WIDTH * length_mm;
    let mut cells: Vec<Cell> = CENTRES
        .iter()
        .zip(areas_mm2)
        .map(|(&[forward, medial], &area_mm2)| Cell {
            x_mm: (0.5 - medial) * width_mm,
            y_mm: (0.5 + forward) * length_mm,
            area_mm2,
            // Replaced by the template below.
            region: Region::Heel,
        })
        .collect();
    template::assign(&mut cells);
    cells
}

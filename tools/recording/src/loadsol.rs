//! Import of forces under zones of the foot by novel's loadsol insoles, from the text export.
//!
//! Below a description, a line names the columns, and the next one has their units; tabs separate the fields. Each insole has a
//! column with its time in s and one with the force in N for each zone, with heel, medial or lateral in its name. The name also
//! contains the foot, such as `-L`. Columns of totals and of motion are not read. `-` or an empty field means that a frame was
//! lost.
//!
//! This importer follows published programs that read such exports. It was not tested with a real export. The positions and
//! areas of the zones are nominal: forces are measured, and pressures, areas and ellipses are not.

use crate::assembly::UncheckedRecording;
use crate::table::{at_line, check_later, file_name};
use crate::text::{decode, number};
use crate::{Cell, Error, Export, Result};
use plantar::{Region, Side};
use std::path::Path;

/// Nominal area of a zone, mm2: the largest area that a cell may have.
const AREA_MM2: f64 = 4_000.0;
/// The zones: the word in the name of the column, the nominal distance of the centre from the medial edge and from the back of
/// the heel in mm, and the region.
const ZONES: [(&str, [f64; 2], Region); 3] = [
    ("heel", [45.0, 40.0], Region::Heel),
    ("medial", [30.0, 180.0], Region::Metatarsals12),
    ("lateral", [65.0, 165.0], Region::Metatarsals35),
];

/// The columns of an insole.
struct Insole {
    /// Column of the time.
    time_column: usize,
    /// Column and index in [`ZONES`] of each zone.
    zones: Vec<(usize, usize)>,
}

/// The index of the line with the units: fields such as `[sec]` and `[N]`.
fn units_line(text: &str) -> Option<usize> {
    text.lines().take(20).position(|line| {
        let units: Vec<String> = line.split('\t').map(unit).collect();
        units.iter().any(|unit| is_time(unit)) && units.iter().any(|unit| unit == "n")
    })
}

/// The unit in a field, without brackets and in lower case.
fn unit(field: &str) -> String {
    field.trim().trim_matches(['[', ']', '(', ')']).to_lowercase()
}

fn is_time(unit: &str) -> bool {
    ["s", "sec", "secs"].contains(&unit)
}

/// True for the text of a loadsol export.
pub fn recognise(text: &str) -> bool {
    let Some(units) = units_line(text) else { return false };
    let names = units.checked_sub(1).and_then(|line| text.lines().nth(line)).unwrap_or_default().to_lowercase();
    ZONES.iter().any(|(zone, ..)| names.contains(zone))
}

/// Imports the feet of an export. `side` restricts the import to one foot.
///
/// # Errors
/// Fails if a line violates the format. The message names file, line and remedy.
pub fn parse(bytes: &[u8], path: &Path, side: Option<Side>) -> Result<Export> {
    let text = decode(bytes, path)?;
    let file = path.display().to_string();
    let Some(units_index) = units_line(&text).filter(|line| *line > 0) else {
        let problem = "no line with the units of the columns, such as [sec] and [N]";
        return Err(Error::content(file, problem, "export the measurement as text"));
    };
    let lines: Vec<&str> = text.lines().collect();
    let names: Vec<&str> = lines[units_index - 1].split('\t').map(str::trim).collect();
    let units: Vec<String> = lines[units_index].split('\t').map(unit).collect();
    let mut export = Export { feet: Vec::new(), remarks: Vec::new() };
    for foot in [Side::Left, Side::Right] {
        let Some(insole) = insole(&names, &units, foot).filter(|_| side.is_none_or(|side| side == foot)) else {
            continue;
        };
        let (mut t_s, mut pressure_kpa): (Vec<f64>, Vec<f32>) = Default::default();
        for (line, row) in (units_index as u64 + 2..).zip(&lines[units_index + 1..]) {
            let fields: Vec<&str> = row.split('\t').map(str::trim).collect();
            let field = |column: usize| fields.get(column).copied().unwrap_or("");
            let columns = insole.zones.iter().map(|(column, _)| *column);
            if columns.clone().chain([insole.time_column]).any(|column| ["", "-"].contains(&field(column))) {
                continue;
            }
            let place = || at_line(path, line);
            let now_s = number(field(insole.time_column), "the time", &place)?;
            check_later(now_s, t_s.last().copied(), &place)?;
            t_s.push(now_s);
            for column in columns {
                // A zone without load may have a small negative force.
                let force_n = number(field(column), &format!("the force in column {}", column + 1), &place)?.max(0.0);
                pressure_kpa.push((force_n / AREA_MM2 * 1e3) as f32);
            }
        }
        if t_s.is_empty() {
            continue;
        }
        let cell = |&(_, zone): &(usize, usize)| {
            let (_, [x_mm, y_mm], region) = ZONES[zone];
            Cell { x_mm, y_mm, area_mm2: AREA_MM2, region }
        };
        let unchecked = UncheckedRecording {
            side: foot,
            cells: insole.zones.iter().map(cell).collect(),
            t_s,
            pressure_kpa,
            name: "loadsol insole".to_owned(),
            source: format!(
                "loadsol measurement {}, {} insole, nominal positions and areas of the zones.",
                file_name(path),
                foot.name()
            ),
        };
        export.feet.push(unchecked.recording(path, &mut export.remarks)?);
    }
    if export.feet.is_empty() {
        let problem = "no foot with a time and the forces of its zones: heel, medial, lateral";
        return Err(Error::content(
            file,
            problem,
            "export the forces of all zones, with L or R in the names of the insoles; if --side is given, check it",
        ));
    }
    export.remarks.push(
        "The positions and areas of the zones are nominal: forces are measured, pressures and areas are not."
            .to_owned(),
    );
    Ok(export)
}

/// The columns of a foot; `None` if it has no zones or no time. The time is the last column of seconds before the first zone.
fn insole(names: &[&str], units: &[String], side: Side) -> Option<Insole> {
    let letter = if side == Side::Left { "l" } else { "r" };
    let is_of_foot = |name: &str| {
        let name = name.to_lowercase();
        let words: Vec<&str> = name.split(|c: char| !c.is_ascii_alphanumeric()).collect();
        words.contains(&letter) || words.contains(&side.name())
    };
    let zones: Vec<(usize, usize)> = names
        .iter()
        .zip(units)
        .enumerate()
        .filter(|(_, (name, unit))| *unit == "n" && is_of_foot(name))
        .filter_map(|(column, (name, _))| {
            let name = name.to_lowercase();
            ZONES.iter().position(|(zone, ..)| name.contains(zone)).map(|zone| (column, zone))
        })
        .collect();
    let first_zone_column = zones.first()?.0;
    let time_column = units[..first_zone_column].iter().rposition(|unit| is_time(unit))?;
    Some(Insole { time_column, zones })
}

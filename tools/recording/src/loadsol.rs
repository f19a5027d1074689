//! Import of forces under zones of the foot by novel's loadsol insoles, from the text export.
//!
//! Below a description, a line names the columns, and the next one has their units, such as `[N]` or `Force[N]`; tabs separate
//! the fields. Each insole has a column with its time in s and one with the force in N for each zone, with heel, medial or
//! lateral in its name. The name also contains the foot, such as `-L`. The total, the column of which has the name of the insole
//! alone, is compared with the sum of the zones. Columns of motion are not read.
//!
//! A frame was lost if a field is empty or `-`, or if the forces of all zones are -1. About every 0.2 s, the app writes the time
//! and the forces of a frame also to the row before it, in place of another frame, which is lost, too.
//!
//! The positions and areas of the zones are nominal: forces are measured, and pressures, areas and ellipses are not.

use crate::assembly::{ParsedExport, UncheckedRecording};
use crate::separators::Separators;
use crate::table::{another_measurement, at_line, check_later, file_name};
use crate::text::{decode, number, parse_number, shortened};
use crate::totals::Totals;
use crate::{Cell, Error, Layout, Result, units};
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

/// The remedy for forces with unknown names.
const ENGLISH_NAMES: &str = "export the zones heel, medial and lateral with their English names";
/// The remedy for an insole without a known zone.
const NO_ZONE: &str = "insoles that measure their total force alone are not supported; if this one has zones, export heel, \
                       medial and lateral with their English names";
/// The force on each zone in a lost frame, N.
const LOST_N: f64 = -1.0;
/// Words in the name of a total besides those of the insole.
const TOTAL: [&str; 4] = ["total", "sum", "force", "gesamt"];

/// The columns of an insole.
struct Insole {
    /// Column of the time.
    time_column: usize,
    /// Column and index in [`ZONES`] of each zone.
    zones: Vec<(usize, usize)>,
    /// Column of the total.
    total: Option<usize>,
}

/// The index of the line with the units: fields such as `Time[secs]` and `[N]`, between which there is this separator.
fn units_line(text: &str, separator: char) -> Option<usize> {
    text.lines().take(20).position(|line| has_units(line, separator))
}

/// True for a line with a unit of time and a unit of force.
fn has_units(line: &str, separator: char) -> bool {
    let units: Vec<String> = line.split(separator).map(unit).collect();
    units.iter().any(|unit| is_time(unit)) && units.iter().any(|unit| unit == "n" || is_other_force(unit))
}

/// True for a unit of force other than N.
fn is_other_force(unit: &str) -> bool {
    // `g` is the unit of acceleration.
    ["kn", "%bw", "bw"].contains(&unit) || (!["n", "g"].contains(&unit) && units::newtons_of(unit).is_some())
}

/// The unit in a field, in lower case: the text in the last brackets, or all of it.
fn unit(field: &str) -> String {
    let field = field.trim().trim_end_matches([']', ')']);
    field.rsplit(['[', '(']).next().unwrap_or(field).to_lowercase()
}

fn is_time(unit: &str) -> bool {
    ["s", "sec", "secs"].contains(&unit)
}

/// Separators by which a file is recognised. Only tabs are read.
const SEPARATORS: [char; 3] = ['\t', ';', ','];

/// True for the text of a loadsol export. If tabs separate its fields, also for the export of insoles without zones, which
/// the import refuses with the reason.
pub fn recognise(text: &str) -> bool {
    let found = SEPARATORS.into_iter().find_map(|separator| units_line(text, separator).map(|line| (separator, line)));
    let Some((separator, units)) = found else { return false };
    let names = units.checked_sub(1).and_then(|line| text.lines().nth(line)).unwrap_or_default();
    let has_foot = |name: &ColumnName| !matches!(foot_of(&name.words, name.words.len()), Foot::None);
    // A table of another program, with commas or semicolons, can have forces of the left and the right foot, too.
    names.split(SEPARATORS).map(ColumnName::of).any(|name| name.zone.is_some() || separator == '\t' && has_foot(&name))
}

/// Imports the feet of an export. `side` restricts the import to one foot.
///
/// # Errors
/// Fails if a line violates the format. The message names file, line and remedy.
pub(crate) fn parse(bytes: &[u8], path: &Path, side: Option<Side>) -> Result<ParsedExport> {
    let text = decode(bytes, path)?;
    let file = path.display().to_string();
    let Some(units_index) = units_line(&text, '\t').filter(|line| *line > 0) else {
        if let Some(separator) = SEPARATORS.iter().find(|separator| units_line(&text, **separator).is_some()) {
            let problem = format!("`{separator}` separates the fields, expected tabs");
            return Err(Error::content(file, problem, "export the measurement as text, and do not convert the file"));
        }
        let problem = "no line with the units of the columns, such as [sec] and [N]";
        return Err(Error::content(file, problem, "export the measurement as text"));
    };
    let lines: Vec<&str> = text.lines().collect();
    let names: Vec<&str> = lines[units_index - 1].split('\t').map(str::trim).collect();
    let units: Vec<String> = lines[units_index].trim_end().split('\t').map(unit).collect();
    let mut export = ParsedExport::default();
    for foot in [Side::Left, Side::Right] {
        if side.is_some_and(|side| side != foot) {
            continue;
        }
        let Some(insole) = insole(&names, &units, foot, &at_line(path, units_index as u64))? else { continue };
        let (mut t_s, mut pressure_kpa): (Vec<f64>, Vec<f32>) = Default::default();
        let (mut totals, mut separators) = (Totals::default(), Separators::default());
        let mut before: Vec<&str> = Vec::new();
        for (line, row) in (units_index as u64 + 2..).zip(&lines[units_index + 1..]) {
            let fields: Vec<&str> = row.split('\t').map(str::trim).collect();
            let field = |column: usize| fields.get(column).copied().unwrap_or("");
            if has_units(row, '\t') {
                return Err(another_measurement(at_line(path, line)));
            }
            let place = || at_line(path, line);
            // A row of a frame begins with its time. Behind its last field, there may be empty ones.
            if fields.len() < units.len() && parse_number(field(0)).is_some() {
                let problem = format!("the row ends after {} of {} fields", fields.len(), units.len());
                let remedy = "the file is incomplete: export or copy the measurement again";
                return Err(Error::content(place(), problem, remedy));
            }
            let columns = insole.zones.iter().map(|(column, _)| *column);
            let values: Vec<&str> = columns.clone().chain([insole.time_column]).map(field).collect();
            let is_lost = columns.clone().all(|column| parse_number(field(column)) == Some(LOST_N));
            if is_lost || values.iter().any(|value| ["", "-"].contains(value)) || values == before {
                continue;
            }
            before = values;
            let now_s = number(field(insole.time_column), "the time", &place)?;
            check_later(now_s, t_s.last().copied(), &place)?;
            t_s.push(now_s);
            let mut sum_n = 0.0;
            for column in columns {
                separators.add(field(column), line);
                // A zone without load may have a small negative force.
                let force_n = number(field(column), &format!("the force in column {}", column + 1), &place)?.max(0.0);
                pressure_kpa.push((force_n / AREA_MM2 * 1e3) as f32);
                sum_n += force_n;
            }
            totals.push_force(sum_n, insole.total.and_then(|column| parse_number(field(column))));
        }
        separators.check(path)?;
        if t_s.is_empty() {
            continue;
        }
        export.remarks.extend(totals.remark(foot));
        let cell = |&(_, zone): &(usize, usize)| {
            let (_, [x_mm, y_mm], region) = ZONES[zone];
            Cell { x_mm, y_mm, area_mm2: AREA_MM2, region }
        };
        let unchecked = UncheckedRecording {
            side: foot,
            layout: Layout {
                name: "loadsol insole".to_owned(),
                cells: insole.zones.iter().map(cell).collect(),
                sheet: None,
            },
            t_s,
            pressure_kpa,
            source: format!("loadsol measurement {}, {} insole.", file_name(path), foot.name()),
        };
        export.feet.push(unchecked);
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
///
/// # Errors
/// Fails if a force of the foot is neither that of a zone nor the total, is not in N, or repeats a zone. Messages begin with
/// `place`.
fn insole(names: &[&str], units: &[String], side: Side, place: &str) -> Result<Option<Insole>> {
    let refused = |problem: String, remedy: &str| Err(Error::content(place, problem, remedy));
    let mut zones: Vec<(usize, usize)> = Vec::new();
    // Forces that are not those of a zone: the column, and the words of its name.
    let mut others: Vec<(usize, Vec<String>)> = Vec::new();
    // The words of the insole's name: those of the name of its first zone without the word of the zone.
    let mut insole_words: Option<Vec<String>> = None;
    for (column, (name, unit)) in names.iter().zip(units).enumerate() {
        let is_force = unit == "n";
        let ColumnName { mut words, zone } = ColumnName::of(name);
        if !is_force && (zone.is_none() || !is_other_force(unit)) {
            continue;
        }
        let name = shortened(name);
        match foot_of(&words, zone.map_or(words.len(), |(word, _)| word)) {
            Foot::None => continue,
            Foot::Both => {
                let remedy = "name each insole with one foot, L or R, next to the zone";
                return refused(format!("the column `{name}` names both feet"), remedy);
            }
            Foot::One(foot) if foot != side => continue,
            Foot::One(_) => {}
        }
        if !is_force {
            let remedy = "export the forces in N";
            return refused(format!("the force in the column `{name}` has the unit [{}]", shortened(unit)), remedy);
        }
        let Some((word, zone)) = zone else {
            others.push((column, words));
            continue;
        };
        if zones.iter().any(|(_, before)| *before == zone) {
            let problem = format!("`{name}` is a second {} zone of the {} foot", ZONES[zone].0, side.name());
            return refused(problem, "export the measurement of one person with one pair of insoles");
        }
        words.remove(word);
        insole_words.get_or_insert(words);
        zones.push((column, zone));
    }
    if let (Some((column, _)), true) = (others.first(), zones.is_empty()) {
        let problem =
            format!("the column `{}` has a force of the {} foot, but no zone", shortened(names[*column]), side.name());
        return refused(problem, NO_ZONE);
    }
    let mut total = None;
    for (column, words) in others {
        // The name of the total is that of the insole, without a zone.
        let is_total = insole_words
            .as_ref()
            .is_none_or(|insole| words.iter().filter(|word| !TOTAL.contains(&word.as_str())).eq(insole));
        if !is_total {
            let problem =
                format!("the force in the column `{}` is neither of a zone nor the total", shortened(names[column]));
            return refused(problem, ENGLISH_NAMES);
        }
        total = Some(column);
    }
    let Some(&(first_zone_column, _)) = zones.first() else { return Ok(None) };
    let time_column = units[..first_zone_column].iter().rposition(|unit| is_time(unit));
    Ok(time_column.map(|time_column| Insole { time_column, zones, total }))
}

/// The name of a column.
struct ColumnName {
    /// The words in lower case.
    words: Vec<String>,
    /// The index of the word that names the zone, and the index of this zone in [`ZONES`]; `None` if not exactly one word does.
    zone: Option<(usize, usize)>,
}

impl ColumnName {
    fn of(name: &str) -> Self {
        let name = name.to_lowercase();
        let words: Vec<String> =
            name.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).map(str::to_owned).collect();
        let zone_of = |word: &String| ZONES.iter().position(|(zone, ..)| word.contains(zone));
        let found: Vec<_> =
            words.iter().enumerate().filter_map(|(i, word)| zone_of(word).map(|zone| (i, zone))).collect();
        let zone = if let [zone] = found[..] { Some(zone) } else { None };
        Self { words, zone }
    }
}

/// The foot that a name states.
enum Foot {
    None,
    One(Side),
    Both,
}

/// The foot by the word that is nearest to the word `zone`: the name of a person or a trial may contain an L or R, too.
fn foot_of(words: &[String], zone: usize) -> Foot {
    let side_of = |word: &str| match word {
        "l" | "left" => Some(Side::Left),
        "r" | "right" => Some(Side::Right),
        _ => None,
    };
    let distance =
        |side| (0..words.len()).filter(|&i| side_of(&words[i]) == Some(side)).map(|i| i.abs_diff(zone)).min();
    match (distance(Side::Left), distance(Side::Right)) {
        (None, None) => Foot::None,
        (Some(left), Some(right)) if left == right => Foot::Both,
        (left, Some(right)) if left.is_none_or(|left| right < left) => Foot::One(Side::Right),
        _ => Foot::One(Side::Left),
    }
}

//! A participant's file in the table of a cohort: Parquet with one row per step and region.

use anyhow::Result;
use fit::trials::{Trial, Values, means};
use fit::variable::Variable;
use parquet::record::Field;
use plantar::{Region, Side};
use recording::Rows;
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use study::fits::DEFECT_SEPARATOR;

/// The metadata key under which a file stores the description of its inputs. A later run compares the description with the
/// present inputs to determine whether the file is up to date.
pub const MADE_FROM_KEY: &str = "plantar.made_from";

/// Largest number of rows of a file: sixty thousand steps of eight regions, which occupy 6 GiB. Without this limit, a small file
/// could exhaust the memory, because equal values are compressed.
const MAX_ROWS: usize = 1 << 19;

/// Reads a file: the description of its inputs, and its rows, of which only the columns that this module uses are read.
pub fn read(path: &Path) -> Result<(String, Vec<HashMap<String, Field>>)> {
    let is_needed = |name: &str| {
        ["recording", "side", "region", "defects"].contains(&name) || Variable::all().any(|of| of.name() == name)
    };
    let rows = Rows::open(path, is_needed, MAX_ROWS, "delete it and run the command again")?;
    let made_from = rows.metadata(MADE_FROM_KEY).unwrap_or_default().to_owned();
    Ok((made_from, rows.collect::<recording::Result<_>>()?))
}

/// The different defects in the rows, each with the names of its recording and region.
pub fn defects(rows: &[HashMap<String, Field>]) -> Vec<String> {
    let mut found = Vec::new();
    for row in rows {
        let text = |column: &str| if let Some(Field::Str(text)) = row.get(column) { text.as_str() } else { "" };
        for defect in text("defects").split(DEFECT_SEPARATOR).filter(|defect| !defect.is_empty()) {
            let defect = format!("{}, {}: {defect}", text("recording"), text("region"));
            if !found.contains(&defect) {
                found.push(defect);
            }
        }
    }
    found
}

/// The values of each recording: the means over its steps, of those that follow from a fit over the fitted ones.
pub fn trials(rows: &[HashMap<String, Field>]) -> Vec<Trial> {
    let variables: Vec<_> = Variable::all().map(Variable::name).collect();
    let mut recordings = BTreeMap::<&str, (Side, [Vec<Values>; 8])>::new();
    for row in rows {
        let text = |column: &str| if let Some(Field::Str(text)) = row.get(column) { Some(text.as_str()) } else { None };
        let (Some(name), Some(side), Some(region)) =
            (text("recording"), text("side"), text("region").and_then(Region::from_name))
        else {
            continue;
        };
        let side = if side == Side::Left.name() { Side::Left } else { Side::Right };
        let (_, regions) = recordings.entry(name).or_insert_with(|| (side, Default::default()));
        let value = |column: &Cow<str>| if let Some(Field::Double(v)) = row.get(&**column) { Some(*v) } else { None };
        regions[region as usize].push(variables.iter().map(value).collect());
    }
    let trial = |(name, (side, regions)): (&str, (Side, [Vec<Values>; 8]))| Trial {
        name: name.into(),
        side,
        regions: regions.map(|steps| means(&steps)),
    };
    recordings.into_iter().map(trial).collect()
}

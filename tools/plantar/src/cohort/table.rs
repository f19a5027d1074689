//! A participant's file in the table of a cohort: Parquet with one row per step and region.

use anyhow::{Context, Result, bail};
use fit::trials::{Trial, Values, means};
use fit::variable::Variable;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use plantar::{Region, Side};
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::path::Path;
use study::fits::DEFECT_SEPARATOR;

/// The metadata key under which a file stores the description of its inputs. A later run compares the description with the
/// present inputs to determine whether the file is up to date.
pub const MADE_FROM_KEY: &str = "plantar.made_from";

/// Reads a file: the description of its inputs, and its rows.
pub fn read(path: &Path) -> Result<(String, Vec<HashMap<String, Field>>)> {
    let read = || {
        let file = SerializedFileReader::new(File::open(path)?)?;
        let mut entries = file.metadata().file_metadata().key_value_metadata().into_iter().flatten();
        let made_from = entries.find(|entry| entry.key == MADE_FROM_KEY).and_then(|entry| entry.value.clone());
        let rows = file.get_row_iter(None)?.map(|row| Ok(row?.into_columns().into_iter().collect()));
        Ok((made_from.unwrap_or_default(), rows.collect::<Result<_>>()?))
    };
    // The Parquet library panics when it reads some damaged files.
    std::panic::catch_unwind(read)
        .unwrap_or_else(|_| bail!("the file is damaged"))
        .with_context(|| format!("cannot read {}: delete it and run the command again", path.display()))
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

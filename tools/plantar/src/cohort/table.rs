//! A participant's file in the table of a cohort: Parquet with one row per step and region.

use crate::table::{Row, Value};
use anyhow::{Result, bail};
use fit::trials::{Trial, Values, means};
use fit::variable::Variable;
use fit::{NotFitted, Options, RegionFit, Step};
use parameters::{InsoleSize, Participant};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use plantar::pipeline::contact::ContactRule;
use plantar::{Region, Side};
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::path::{Path, PathBuf};

/// The metadata key under which a file stores the description of its inputs. A later run compares the description with the
/// present inputs to determine whether the file is up to date.
pub const KEY: &str = "plantar.made_from";

/// The values that are the same in all rows of a recording.
pub struct Origin<'a> {
    pub size: InsoleSize,
    pub settings: &'a Participant,
    pub recording: &'a str,
    pub contact: ContactRule,
    pub options: Options,
}

/// The columns of the five identified parameters. Each has a value, the two ends of its 95 % interval, and whether the value is
/// at a bound of the search.
const PARAMETER_COLUMNS: [[&str; 4]; 5] = [
    ["ab_mm2", "ab_mm2_low", "ab_mm2_high", "ab_at_bound"],
    ["stiffness_pa", "stiffness_pa_low", "stiffness_pa_high", "stiffness_at_bound"],
    ["damping_pa_s", "damping_pa_s_low", "damping_pa_s_high", "damping_at_bound"],
    ["n", "n_low", "n_high", "n_at_bound"],
    ["m", "m_low", "m_high", "m_at_bound"],
];

/// The row of one region of a step: its origin, the quantities, then the parameters and the errors.
pub fn row(origin: &Origin, step: &Step, region: Region, fit: Result<RegionFit, NotFitted>) -> Row<Cow<'static, str>> {
    let text = |text: &str| Value::Text(Some(text.into()));
    let integer = |value: Option<usize>| Value::Integer(value.and_then(|v| i32::try_from(v).ok()));
    let real = |value: Option<f64>| Value::Real(value.filter(|v| v.is_finite()));
    let kpa = |value: f32| real(Some(value.into()));
    let Origin { contact, options, settings, .. } = origin;
    let (_, force_n, _) = step.regions[region as usize].of(options.filter);
    let origin: [(&'static str, Value); 19] = [
        ("insole_size", integer(Some(origin.size.eur().into()))),
        ("age_years", real(settings.age_years)),
        ("sex", Value::Text(settings.sex.map(|sex| sex.name().into()))),
        ("mass_kg", real(settings.mass_kg)),
        ("height_cm", real(settings.height_cm)),
        ("side", text(step.side.name())),
        ("recording", text(origin.recording)),
        ("step", integer(Some(step.number as usize))),
        ("start_s", real(Some(step.start_s))),
        ("duration_s", real(Some(step.duration_s))),
        ("region", text(region.name())),
        ("fitted", Value::Flag(Some(fit.is_ok()))),
        ("reason", Value::Text(fit.as_ref().err().map(NotFitted::to_string))),
        ("contact_on_kpa", kpa(contact.on_kpa)),
        ("contact_off_kpa", kpa(contact.off_kpa)),
        ("contact_full_kpa", kpa(contact.full_kpa)),
        ("filter", text(options.filter.name())),
        ("method", text(options.method.name())),
        ("measured_peak_n", real(Some(force_n.iter().copied().fold(0.0, f64::max)))),
    ];
    let mut row: Row<Cow<'static, str>> = origin.map(|(name, value)| (name.into(), value)).into();
    let fit = fit.ok();
    let fit = fit.as_ref();
    let value = |variable: Variable| (variable.name(), real(fit.and_then(|fit| variable.of(fit))));
    row.extend(Variable::quantities().map(value));
    for (i, [name, low, high, at_bound]) in PARAMETER_COLUMNS.into_iter().enumerate() {
        let unit = if i == 0 { 1e6 } else { 1.0 };
        let interval = fit.and_then(|fit| fit.uncertainty.as_ref()).map(|u| &u.intervals[i]);
        row.extend(Variable::all().filter(|variable| variable.name() == name).map(value));
        row.push((low.into(), real(interval.map(|i| i.jacobian[0] * unit))));
        row.push((high.into(), real(interval.map(|i| i.jacobian[1] * unit))));
        row.push((at_bound.into(), Value::Flag(interval.map(|i| i.at_bound))));
    }
    let rest: Vec<_> =
        Variable::all().map(value).filter(|(name, _)| row.iter().all(|(other, _)| other != name)).collect();
    row.extend(rest);
    let quality = fit.map(|fit| &fit.quality);
    row.push(("floor_percent".into(), real(quality.map(|q| q.floor * 100.0))));
    row.push(("peak_bias_percent".into(), real(quality.map(|q| q.peak_bias * 100.0))));
    row.push(("evaluations".into(), integer(fit.map(|fit| fit.evaluations))));
    row
}

/// The path of a participant's file in the table. Programs that read the table split the folder's name at `=` into a key and a
/// value, so special characters are encoded as in Hive.
pub fn path(table: &Path, participant: &str) -> PathBuf {
    let encode = |c: char| match c.is_ascii_control() || "\"#%'*/:=?\\{[]^".contains(c) {
        true => format!("%{:02X}", c as u32),
        false => c.into(),
    };
    let name: String = participant.chars().map(encode).collect();
    table.join(format!("participant={name}")).join("steps.parquet")
}

/// Reads a file: the description of its inputs, and its rows.
pub fn read(path: &Path) -> Result<(String, Vec<HashMap<String, Field>>)> {
    let read = || {
        let file = SerializedFileReader::new(File::open(path)?)?;
        let mut entries = file.metadata().file_metadata().key_value_metadata().into_iter().flatten();
        let made_from = entries.find(|entry| entry.key == KEY).and_then(|entry| entry.value.clone());
        let rows = file.get_row_iter(None)?.map(|row| Ok(row?.into_columns().into_iter().collect()));
        Ok((made_from.unwrap_or_default(), rows.collect::<Result<_>>()?))
    };
    // The Parquet library panics when it reads some damaged files.
    std::panic::catch_unwind(read).unwrap_or_else(|_| bail!("{} is damaged", path.display()))
}

/// The values of each recording: the means over its steps.
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
        if row.get("fitted") == Some(&Field::Bool(true)) {
            let value =
                |column: &Cow<str>| if let Some(Field::Double(v)) = row.get(&**column) { Some(*v) } else { None };
            regions[region as usize].push(variables.iter().map(value).collect());
        }
    }
    let trial = |(name, (side, regions)): (&str, (Side, [Vec<Values>; 8]))| Trial {
        name: name.into(),
        side,
        regions: regions.map(|steps| means(&steps)),
    };
    recordings.into_iter().map(trial).collect()
}

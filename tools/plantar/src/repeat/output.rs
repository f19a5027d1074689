//! The repeatability of trials as printed text, as CSV and as JSON.

use crate::summary::{self, REGION_LABELS};
use anyhow::Result;
use comfy_table::Table;
use fit::agreement::{Agreement, FootRepeatability, VariableRow};
use fit::results::significant;
use plantar::Region;
use recording::output;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Placeholder for a value that does not exist.
const NONE: &str = "-";

/// Prints, for each foot, the medians over the regions and then the values of each region.
pub fn print(feet: &[FootRepeatability]) {
    for foot in feet {
        print_medians(foot);
        print_regions(foot);
    }
    println!(
        "ICC(2,1): 1 if the trials of each person agree, 0 if they differ as much as people do. SEM: standard error of\n\
         measurement. MDC: minimal detectable change, 1.96 sqrt(2) SEM: two trials that differ by less may be of an unchanged\n\
         person.\n\
         A number in parentheses: only this number of people have a value in all compared trials.\n\
         The thickness d0 is assumed or measured, and does not follow from the trials."
    );
}

fn print_medians(foot: &FootRepeatability) {
    let mut table = summary::table();
    table.set_header(["median over the regions", "regions", "ICC(2,1)", "SEM", "MDC", "MDC % of mean"]);
    for row in &foot.rows {
        let regions = row.regions.iter().flatten().count();
        if regions > 0 {
            let median = |of: &dyn Fn(&Agreement) -> f64| row.median(|agreement| Some(of(agreement)));
            table.add_row([
                row.variable.title_and_unit(),
                regions.to_string(),
                row.median(|agreement| agreement.icc).map_or(NONE.into(), coefficient),
                median(&|agreement| agreement.sem).map_or(NONE.into(), compact),
                median(&|agreement| agreement.mdc).map_or(NONE.into(), compact),
                row.median(Agreement::mdc_percent).map_or(NONE.into(), compact),
            ]);
        }
    }
    summary::align(&mut table);
    println!("Repeatability, {}:\n{table}\n{}", foot.comparison(), foot.mdc_note());
}

/// Prints the ICC by region, unless there is only one person. Then prints SEM and MDC by region.
fn print_regions(foot: &FootRepeatability) {
    let side = foot.side.name();
    if foot.people.len() > 1 {
        let cell = |agreement: &Agreement| {
            let is_all = agreement.people == foot.people.len();
            let people = if is_all { String::new() } else { format!(" ({})", agreement.people) };
            agreement.icc.map_or(NONE.into(), |icc| coefficient(icc) + &people)
        };
        println!("ICC(2,1) by region, {side} foot:\n{}", by_region(foot, cell));
    }
    let cell = |agreement: &Agreement| format!("{} / {}", compact(agreement.sem), compact(agreement.mdc));
    println!("SEM / MDC by region, {side} foot:\n{}", by_region(foot, cell));
}

/// A table with a row for each variable and a column for each region.
fn by_region(foot: &FootRepeatability, cell: impl Fn(&Agreement) -> String) -> Table {
    let mut table = summary::table();
    table.set_header(std::iter::once("").chain(REGION_LABELS));
    for row in foot.rows.iter().filter(|row| row.regions.iter().any(Option::is_some)) {
        let cells = row.regions.iter().map(|agreement| agreement.as_ref().map_or(NONE.into(), &cell));
        table.add_row(std::iter::once(row.variable.title_and_unit()).chain(cells));
    }
    summary::align(&mut table);
    table
}

fn coefficient(icc: f64) -> String {
    format!("{icc:.2}")
}

/// Formats a value as [`significant`] does, but with a power of ten from 1e5 on.
fn compact(value: f64) -> String {
    if value.abs() < 1e5 { significant(value) } else { format!("{value:.2e}") }
}

/// The values of all rows and regions that have some.
fn values(foot: &FootRepeatability) -> impl Iterator<Item = (&VariableRow, Region, &Agreement)> {
    foot.rows.iter().flat_map(|row| {
        let regions = Region::ALL.into_iter().zip(&row.regions);
        regions.filter_map(move |(region, agreement)| Some((row, region, agreement.as_ref()?)))
    })
}

/// Writes a CSV file with one row for each foot, variable and region.
pub fn write_csv(path: &Path, feet: &[FootRepeatability]) -> Result<()> {
    let written = output::file(path, |to| {
        let mut file = csv::Writer::from_writer(to);
        file.write_record(["side", "variable", "region", "people", "trials", "mean", "icc_2_1", "sem", "mdc_95"])?;
        for foot in feet {
            for (row, region, agreement) in values(foot) {
                file.write_record([
                    foot.side.name().into(),
                    row.variable.name().into_owned(),
                    region.name().into(),
                    agreement.people.to_string(),
                    foot.trials.to_string(),
                    agreement.mean.to_string(),
                    agreement.icc.map_or(String::new(), |icc| icc.to_string()),
                    agreement.sem.to_string(),
                    agreement.mdc.to_string(),
                ])?;
            }
        }
        file.flush()
    });
    Ok(written?)
}

/// Makes the JSON object with all values. `left_out` has the reasons why people and recordings were not used, and `incomplete`
/// the defects of the fits.
pub fn to_json(feet: &[FootRepeatability], left_out: &[String], incomplete: &[String]) -> Value {
    let foot = |foot: &FootRepeatability| {
        let mut variables = Map::new();
        for (row, region, agreement) in values(foot) {
            let regions = variables.entry(row.variable.name()).or_insert_with(|| json!({}));
            regions[region.name()] = json!({
                "people": agreement.people, "mean": agreement.mean, "icc_2_1": agreement.icc, "sem": agreement.sem,
                "mdc_95": agreement.mdc,
            });
        }
        json!({
            "side": foot.side.name(), "people": foot.people, "trials": foot.trials, "most_trials": foot.most_trials,
            "variables": variables,
        })
    };
    json!({ "feet": feet.iter().map(foot).collect::<Vec<_>>(), "left_out": left_out, "incomplete": incomplete })
}

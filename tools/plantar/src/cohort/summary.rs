//! Means as in the paper: over the steps of each recording, over the recordings, then over the participants of a size.

use crate::summary;
use anyhow::{Context, Result};
use parquet::record::Field;
use plantar::Region;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// The columns of which means are computed: the paper's eight parameters, the combinations of them that a force determines, and
/// the errors.
const COLUMNS: [&str; 13] = [
    "a_mm",
    "b_mm",
    "c_mm",
    "d0_mm",
    "k_n_m3",
    "n",
    "c_n_s_m3",
    "m",
    "ab_mm2",
    "stiffness_pa",
    "damping_pa_s",
    "nrmse_percent",
    "nrmse_smoothed_percent",
];
/// Index of `nrmse_percent` in [`COLUMNS`].
const NRMSE: usize = 11;

/// The values of [`COLUMNS`].
type Values = [f64; COLUMNS.len()];

/// The means of a participant.
pub struct Means {
    size: i32,
    /// The means of each region, in the order of [`Region::ALL`]; `None` if the region was fitted in no step.
    regions: [Option<Values>; 8],
    /// Number of steps of all recordings.
    pub steps: usize,
}

impl Means {
    /// Computes the means from a participant's rows of the table.
    pub fn of(rows: &[HashMap<String, Field>]) -> Self {
        let mut trials: [BTreeMap<&str, Vec<Values>>; 8] = Default::default();
        for row in rows {
            let (Some(Field::Str(recording)), Some(Field::Str(region))) = (row.get("recording"), row.get("region"))
            else {
                continue;
            };
            let values = COLUMNS.map(|column| if let Some(Field::Double(v)) = row.get(column) { *v } else { f64::NAN });
            // The values of a region that was not fitted are null.
            if let Some(region) = Region::from_name(region).filter(|_| values.iter().all(|v| v.is_finite())) {
                trials[region as usize].entry(recording).or_default().push(values);
            }
        }
        let regions = trials.map(|trials| {
            let means: Vec<Values> = trials.values().filter_map(|steps| mean(steps)).collect();
            mean(&means)
        });
        let size = match rows.first().and_then(|row| row.get("insole_size")) {
            Some(Field::Int(size)) => *size,
            _ => 0,
        };
        Self { size, regions, steps: rows.len() / Region::ALL.len() }
    }
}

/// The mean of each column; `None` without values.
fn mean(all: &[Values]) -> Option<Values> {
    let mean = |i: usize| all.iter().map(|values| values[i]).sum::<f64>() / all.len() as f64;
    (!all.is_empty()).then(|| std::array::from_fn(mean))
}

/// The standard deviation of each column, with the divisor n - 1; `None` for fewer than two values.
fn standard_deviation(all: &[Values]) -> Option<Values> {
    let mean = mean(all).filter(|_| all.len() > 1)?;
    let squares = |i: usize| all.iter().map(|values| (values[i] - mean[i]).powi(2)).sum::<f64>();
    Some(std::array::from_fn(|i| (squares(i) / (all.len() - 1) as f64).sqrt()))
}

/// Groups the participants by pairs of insole sizes, as in the paper: 35-36, 37-38 and so on. The key is the smaller size.
fn by_size(participants: &[Means]) -> BTreeMap<i32, Vec<&Means>> {
    let mut sizes = BTreeMap::<_, Vec<_>>::new();
    for means in participants {
        sizes.entry(means.size - (means.size + 1) % 2).or_default().push(means);
    }
    sizes
}

/// The name of a pair of sizes.
fn pair(smaller: i32) -> String {
    format!("{smaller}-{}", smaller + 1)
}

/// Prints the NRMSE of each region for each pair of sizes.
pub fn print(participants: &[Means]) {
    let sizes = by_size(participants);
    let mut table = summary::table();
    let header = sizes.iter().map(|(size, means)| format!("{} ({})", pair(*size), means.len()));
    table.set_header(std::iter::once("region".to_string()).chain(header));
    for (i, region) in Region::ALL.iter().enumerate() {
        let cell = |means: &Vec<&Means>| {
            let fitted: Vec<Values> = means.iter().filter_map(|means| means.regions[i]).collect();
            let Some(mean) = mean(&fitted) else { return "-".into() };
            let sd = standard_deviation(&fitted).map_or(String::new(), |sd| format!(" ± {:.1}", sd[NRMSE]));
            let count = if fitted.len() < means.len() { format!(" ({})", fitted.len()) } else { String::new() };
            format!("{:.1}{sd}{count}", mean[NRMSE])
        };
        table.add_row(std::iter::once(region.name().to_string()).chain(sizes.values().map(cell)));
    }
    summary::align(&mut table);
    println!("NRMSE %, mean ± standard deviation over participants (number), by region and insole size:\n{table}");
    println!(
        "Each step is fitted separately to the measured force (NRMSE: Eq. 20). The means are taken over the steps of a"
    );
    println!(
        "recording, then over recordings, then over participants. As in the paper, all means are arithmetic, also\n\
         those of k, c, K and G, in which a few stiff steps can dominate."
    );
}

/// Writes a CSV file with one row for each pair of sizes and region.
pub fn write(path: &Path, participants: &[Means]) -> Result<()> {
    let rows = || -> Result<()> {
        let mut file = csv::Writer::from_path(path)?;
        let names = COLUMNS.iter().flat_map(|column| [format!("{column}_mean"), format!("{column}_sd")]);
        file.write_record(["insole_size", "region", "participants"].map(String::from).into_iter().chain(names))?;
        for (size, means) in by_size(participants) {
            for (i, region) in Region::ALL.iter().enumerate() {
                let fitted: Vec<Values> = means.iter().filter_map(|means| means.regions[i]).collect();
                let (mean, sd) = (mean(&fitted), standard_deviation(&fitted));
                let value = |of: Option<Values>, i: usize| of.map_or(String::new(), |values| values[i].to_string());
                let values = (0..COLUMNS.len()).flat_map(|i| [value(mean, i), value(sd, i)]);
                let start = [pair(size), region.name().into(), fitted.len().to_string()];
                file.write_record(start.into_iter().chain(values))?;
            }
        }
        Ok(file.flush()?)
    };
    rows().with_context(|| format!("cannot write {}", path.display()))
}

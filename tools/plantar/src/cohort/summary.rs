//! The participants (Table 1 of the paper), and the means by region and insole size.

use crate::summary;
use anyhow::Result;
use fit::cohort::{Person, SizeGroup};
use fit::trials::Moments;
use fit::variable::Variable;
use parameters::Participant;
use plantar::Region;
use recording::output;
use std::path::Path;

/// Prints each participant, and Table 1 of the paper: mean and standard deviation of age, mass and height for each group of two
/// adjacent insole sizes ([`SizeGroup`]).
pub fn print_participants(people: &[Person]) {
    let known = |value: Option<f64>| value.map_or("-".into(), |value| value.to_string());
    let mut table = summary::table();
    table.set_header(["participant", "size", "sex", "age years", "mass kg", "height m", "recordings", "steps"]);
    for person in people {
        let Participant { sex, age_years, mass_kg, .. } = person.settings;
        table.add_row([
            person.name.clone(),
            person.size_eur.to_string(),
            sex.map_or("-".into(), |sex| sex.name().into()),
            known(age_years),
            known(mass_kg),
            known(height_m(&person.settings)),
            person.trials.len().to_string(),
            person.steps.to_string(),
        ]);
    }
    summary::align(&mut table);
    println!("Participants:\n{table}");
    let mut table = summary::table();
    table.set_header(["insole size", "participants", "female/male", "age years", "mass kg", "height m"]);
    for group in SizeGroup::all(people) {
        let value = |moments: Option<Moments>, digits: usize| {
            moments.map_or("-".into(), |m| plus_minus(&m, digits) + &group.count_unless_all(&m))
        };
        table.add_row([
            group.name(),
            group.people.len().to_string(),
            group.sexes(),
            value(group.of_settings(|settings| settings.age_years), 1),
            value(group.of_settings(|settings| settings.mass_kg), 1),
            value(group.of_settings(height_m), 2),
        ]);
    }
    summary::align(&mut table);
    println!(
        "Participants by insole size, mean ± standard deviation (in parentheses: number of participants with a value, if not \
         all), in the form of Table 1 of the paper:\n{table}"
    );
}

/// Height in m, rounded to 1 mm.
fn height_m(settings: &Participant) -> Option<f64> {
    settings.height_cm.map(|cm| (cm * 10.0).round() / 1000.0)
}

/// Mean ± standard deviation; only the mean if there is a single value.
fn plus_minus(moments: &Moments, digits: usize) -> String {
    let deviation = moments.deviation.map_or(String::new(), |sd| format!(" ± {sd:.digits$}"));
    format!("{:.digits$}{deviation}", moments.mean)
}

/// Prints the NRMSE of each region for each group of two adjacent insole sizes.
pub fn print(people: &[Person]) {
    let sizes = SizeGroup::all(people);
    let mut table = summary::table();
    let header = sizes.iter().map(|group| format!("{} ({})", group.name(), group.people.len()));
    table.set_header(std::iter::once("region".to_string()).chain(header));
    for (i, region) in Region::ALL.iter().enumerate() {
        let cell = |group: &SizeGroup| {
            let Some(moments) = group.moments(i, Variable::nrmse()) else { return "-".into() };
            plus_minus(&moments, 1) + &group.count_unless_all(&moments)
        };
        table.add_row(std::iter::once(region.name().to_string()).chain(sizes.iter().map(cell)));
    }
    summary::align(&mut table);
    println!(
        "NRMSE %, mean ± standard deviation over participants (in parentheses: their number), by region and insole size:\n\
         {table}"
    );
    println!(
        "Each step is fitted separately. NRMSE: against the measured force (Eq. 20 of the paper). Means are taken over the steps"
    );
    println!(
        "of a recording, then over recordings, then over participants. As in the paper, all means are arithmetic. A few\n\
         stiff steps can dominate the means of the stiffness and damping coefficients (k, K, c, G), which are in the file of\n\
         --summary and in the report."
    );
}

/// Writes a CSV file with one row for each group of two adjacent insole sizes, such as 37-38, and each region. The column
/// `participants` is the number of participants in whom the region was fitted. Further columns have the mean, the standard
/// deviation, and the number of participants with a value of each [`Variable`], in the order of [`Variable::all`].
pub fn write(path: &Path, people: &[Person]) -> Result<()> {
    let written = output::file(path, |to| {
        let mut file = csv::Writer::from_writer(to);
        let names = Variable::all()
            .flat_map(|variable| ["mean", "sd", "participants"].map(|of| format!("{}_{of}", variable.name())));
        file.write_record(["insole_size", "region", "participants"].map(String::from).into_iter().chain(names))?;
        for group in SizeGroup::all(people) {
            for (i, region) in Region::ALL.iter().enumerate() {
                let values = Variable::all().flat_map(|variable| {
                    let moments = group.moments(i, variable);
                    let text = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
                    let count = moments.map_or(0, |moments| moments.count);
                    [text(moments.map(|m| m.mean)), text(moments.and_then(|m| m.deviation)), count.to_string()]
                });
                let start = [group.name(), region.name().into(), group.fitted(i).to_string()];
                file.write_record(start.into_iter().chain(values))?;
            }
        }
        file.flush()
    });
    Ok(written?)
}

//! The results of a fit as printed text.

use crate::setup::rule_in_words;
use crate::summary;
use fit::results::{significant, widest};
use fit::{RegionFit, Study};
use plantar::Region;

/// Prints the results.
pub fn print(study: &Study) {
    println!(
        "{}: {} steps of {} recordings, {} filter, {}",
        study.participant,
        study.steps.len(),
        study.sources.len(),
        study.options.filter.name(),
        rule_in_words(&study.contact)
    );
    for contact in &study.excluded_contacts {
        println!("left out: {} at {:.2} s, {}", study.sources[contact.recording].name, contact.at_s, contact.reason);
    }
    let mut table = summary::table();
    table.set_header(["region", "steps", "A B mm2", "K kPa", "G kPa s", "n", "m", "error %", "predicted %", "floor %"]);
    for (region, fit) in Region::ALL.iter().zip(&study.fits) {
        let mut row = vec![region.name().to_string()];
        match fit {
            Ok(fit) => {
                row.push(fit.steps.len().to_string());
                row.extend(five_in_words(fit));
                let percent = |share: f64| format!("{:.1}", share * 100.0);
                row.extend([percent(fit.quality.fitted), fit.quality.predicted.map_or("-".into(), percent)]);
                row.push(percent(fit.quality.floor));
            }
            Err(_) => row.extend(std::iter::repeat_n("-".to_string(), 9)),
        }
        table.add_row(row);
    }
    summary::align(&mut table);
    println!("{table}");
    println!(
        "Error: NRMSE of the model against the measured force (Eq. 20), mean over the steps. Predicted: the same\n\
         error if each step is predicted from the others. Floor: the least error of any force law without damping\n\
         for the measured areas. In brackets: 95 % intervals. A value with ! is at a bound of the search."
    );
    for (region, fit) in Region::ALL.iter().zip(&study.fits) {
        match fit {
            Ok(fit) => {
                println!("{}: {}", region.name(), fit.verdict);
                fit.warnings.iter().for_each(|warning| println!("    {warning}"));
            }
            Err(reason) => println!("{}: NOT FITTED, {reason}", region.name()),
        }
    }
}

/// Formats the five identified parameters A B (mm2), K (kPa), G (kPa s), n and m, each with the wider of its two intervals.
fn five_in_words(fit: &RegionFit) -> Vec<String> {
    let law = &fit.law;
    let units = [1e6, 1e-3, 1e-3, 1.0, 1.0];
    match &fit.uncertainty {
        Some(uncertainty) => uncertainty
            .intervals
            .iter()
            .zip(units)
            .map(|(interval, unit)| {
                if !interval.is_identifiable {
                    return "-".into();
                }
                let [low, high] = widest(interval).map(|end| significant(end * unit));
                let mark = if interval.at_bound { "!" } else { "" };
                format!("{}{mark} ({low}..{high})", significant(interval.value * unit))
            })
            .collect(),
        None => {
            let values = [law.ab_m2, law.stiffness_pa, law.damping_pa_s, law.n, law.m];
            values.iter().zip(units).map(|(value, unit)| significant(value * unit)).collect()
        }
    }
}

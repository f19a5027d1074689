//! The results of a fit as printed text.

use crate::setup::rule_in_words;
use crate::summary::{self, counted};
use fit::measures::{Quantity, SCALE_CHANGE};
use fit::results::{deformation_scale, significant, widest};
use fit::{RegionFit, Study};
use plantar::{Region, Side};

/// Prints the results.
pub fn print(study: &Study) {
    println!(
        "{}: {} of {}, {} filter, {}",
        study.participant,
        counted(study.steps.len(), "step"),
        counted(study.sources.len(), "recording"),
        study.options.filter.name(),
        rule_in_words(&study.contact)
    );
    if study.side().is_none() {
        let of = |side| study.steps.iter().filter(|step| step.side == side).count();
        println!(
            "Note: the parameters are those of both feet together: {} of the left foot and {} of the right foot; fit each foot \
             separately for its own parameters.",
            counted(of(Side::Left), "step"),
            counted(of(Side::Right), "step")
        );
    }
    for contact in &study.excluded_contacts {
        println!("left out: {} at {:.2} s, {}", study.sources[contact.recording].name, contact.at_s, contact.reason);
    }
    if study.fits.iter().any(Result::is_ok) {
        print_measures(study);
        print_sources(study);
        print_parameters(study);
    }
    for (region, fit) in Region::ALL.iter().zip(&study.fits) {
        match fit {
            Ok(fit) => {
                println!("{}: {}", region.name(), fit.verdict);
                fit.defects.iter().for_each(|defect| println!("    INCOMPLETE: {defect}"));
                fit.warnings.iter().for_each(|warning| println!("    {warning}"));
            }
            Err(reason) => println!("{}: NOT FITTED, {reason}", region.name()),
        }
    }
}

/// The number of regions with incomplete results and the reason, as the end of a line; empty if there are none.
pub fn incomplete(study: &Study) -> String {
    let defects: Vec<_> = study.fits.iter().flatten().map(|fit| &fit.defects).filter(|it| !it.is_empty()).collect();
    match &defects[..] {
        [] => String::new(),
        [first, others @ ..] => {
            let is_same = first.len() == 1 && others.iter().all(|other| other == first);
            let reason = if is_same { &first[0] } else { "see above for the reasons" };
            format!(", {} of them with incomplete results: {reason}", defects.len())
        }
    }
}

/// Prints the identified parameters and the errors of the regions, and what they mean.
fn print_parameters(study: &Study) {
    let mut table = summary::table();
    table.set_header([
        "region",
        "steps",
        "A B mm2",
        "K kPa",
        "G kPa s",
        "n",
        "m",
        "error %",
        "predicted %",
        "counted %",
        "floor %",
    ]);
    for ((region, fit), counted) in Region::ALL.iter().zip(&study.fits).zip(study.counted_nrmse) {
        let mut row = vec![region.name().to_string()];
        match fit {
            Ok(fit) => {
                row.push(fit.steps.len().to_string());
                row.extend(format_parameters(fit, study.options.prior.is_some()));
                let percent = |share: f64| format!("{:.1}", share * 100.0);
                let predicted = [fit.quality.predicted, counted].map(|error| error.map_or(NONE.into(), percent));
                row.push(percent(fit.quality.fitted));
                row.extend(predicted);
                row.push(percent(fit.quality.floor));
            }
            Err(_) => row.extend(std::iter::repeat_n(NONE.to_string(), 10)),
        }
        table.add_row(row);
    }
    summary::align(&mut table);
    println!("{table}");
    let undetermined = match study.options.prior {
        Some(_) => {
            "close to the usual value of other people, uncertain by a factor of more\n\
             than 100, or without meaning if G is 0"
        }
        None => "without meaning",
    };
    println!(
        "Error: NRMSE of the model against the measured force (Eq. 20 of the paper), mean over the steps. Predicted: the\n\
         same error if each step is predicted from the others. Counted: the predicted error if each cell counts with its\n\
         whole area, which only recordings of all cells show. Floor: the least error of any force law without damping\n\
         for the measured areas. In parentheses: 95 % intervals. A value with ! is at a bound of the search. A value\n\
         with * is not determined by the force: {undetermined}."
    );
    study.prior_note().iter().for_each(|note| println!("Note: {note}."));
}

/// Prints the mechanical quantities: a row for each quantity, and a column for each fitted region.
fn print_measures(study: &Study) {
    let fitted: Vec<_> =
        Region::ALL.iter().zip(&study.fits).filter_map(|(region, fit)| Some((region, fit.as_ref().ok()?))).collect();
    let mut table = summary::table();
    let names = fitted.iter().map(|(region, _)| region.name().to_string());
    table.set_header(std::iter::once(String::new()).chain(names));
    for quantity in Quantity::all() {
        let cells: Vec<String> = fitted.iter().map(|(_, fit)| format_measure(fit, quantity)).collect();
        if cells.iter().all(|cell| cell == NONE) {
            continue;
        }
        let (name, unit) = quantity.title();
        table.add_row(std::iter::once(format!("{name}, {unit}")).chain(cells));
    }
    summary::align(&mut table);
    println!("{table}");
    println!(
        "In parentheses: 95 % intervals. Not determined: the interval is wider than the value. Strains, and with them stiffness,\n\
         moduli and energies, depend on the thickness of the tissue and on what determines C."
    );
    println!("Note: {}.", study.measures_note());
}

/// Prints the sources of d0 and C of each region, and how much the results depend on the source of C.
fn print_sources(study: &Study) {
    let fitted: Vec<_> =
        Region::ALL.iter().zip(&study.fits).filter_map(|(region, fit)| Some((region, fit.as_ref().ok()?))).collect();
    if !fitted.iter().any(|(_, fit)| fit.scale_effect.is_some()) {
        return;
    }
    let mut table = summary::table();
    table.set_header(["region", "d0 mm", "C mm", "source of C", "assumed %", "C %", "stiffness %", "modulus %"]);
    for (region, fit) in fitted {
        let value = |quantity| fit.measure(quantity).map(|m| m.value);
        let source = if fit.fixed.is_thickness_measured { "measured" } else { "typical" };
        let effects = fit.scale_effect.map_or([NONE; 3].map(String::from), |effect| {
            let ends = [effect.at_less, effect.at_more];
            let changes = |base: Option<f64>, ends: [Option<f64>; 2]| match (base, ends) {
                (Some(base), [Some(less), Some(more)]) => {
                    format!("{:+.0} / {:+.0}", (less / base - 1.0) * 100.0, (more / base - 1.0) * 100.0)
                }
                _ => NONE.into(),
            };
            [
                changes(Some(fit.law.c_m), ends.map(|end| Some(end.c_m))),
                changes(value(Quantity::SecantStiffness), ends.map(|end| end.secant_stiffness_n_mm)),
                changes(value(Quantity::SecantModulus), ends.map(|end| end.secant_modulus_kpa)),
            ]
        });
        let lengths = [
            format!("{}, {source}", significant(fit.fixed.thickness_m * 1e3)),
            significant(fit.law.c_m * 1e3),
            fit.fixed.scale.to_string(),
            deformation_scale(&fit.fixed).assumed_percent().to_string(),
        ];
        table.add_row(std::iter::once(region.name().to_string()).chain(lengths).chain(effects));
    }
    summary::align(&mut table);
    println!("{table}");
    println!(
        "The force determines neither d0 nor C. Assumed: 0 % if C rests on measurements only, 50 % if either thickness or\n\
         compression is assumed, or if C follows from a curvature, 100 % if both are, or if C results from the search of the\n\
         paper; unless the share is 0, the results are those of a deformation (scaled by assumption). C of a curvature follows\n\
         from Eq. 14: an elastic half-space (Hertz) would be compressed twice as much. The last three columns: change of C\n\
         and of the secant stiffness and modulus at 20 % strain if the value of the source of C were {0:.0} % smaller / larger.",
        SCALE_CHANGE * 100.0
    );
}

/// Placeholder for a quantity that a region does not have.
const NONE: &str = "-";

/// Formats a quantity of a region with its interval.
fn format_measure(fit: &RegionFit, quantity: Quantity) -> String {
    let Some(measure) = fit.measure(quantity) else { return NONE.into() };
    match measure.interval {
        None => significant(measure.value),
        Some([low, high]) if measure.is_determined() => {
            format!("{} ({}..{})", significant(measure.value), significant(low), significant(high))
        }
        Some(_) => "not determined".into(),
    }
}

/// Formats the five identified parameters A B (mm2), K (kPa), G (kPa s), n and m, each with the wider of its two intervals
/// ([`widest`]). With a prior, every parameter has a value; without one, a parameter on which the force does not depend has
/// none.
fn format_parameters(fit: &RegionFit, has_prior: bool) -> Vec<String> {
    let law = &fit.law;
    // Factors from SI units to the units above.
    let factors = [1e6, 1e-3, 1e-3, 1.0, 1.0];
    match &fit.uncertainty {
        Some(uncertainty) => uncertainty
            .intervals
            .iter()
            .zip(factors)
            .map(|(interval, factor)| {
                if !interval.is_identifiable && !has_prior {
                    return NONE.into();
                }
                let [low, high] = widest(interval).map(|end| significant(end * factor));
                let mark = match (interval.at_bound, interval.is_identifiable) {
                    (true, _) => "!",
                    (false, false) => "*",
                    (false, true) => "",
                };
                format!("{}{mark} ({low}..{high})", significant(interval.value * factor))
            })
            .collect(),
        None => {
            let values = [law.ab_m2, law.stiffness_pa, law.damping_pa_s, law.n, law.m];
            values.iter().zip(factors).map(|(value, factor)| significant(value * factor)).collect()
        }
    }
}

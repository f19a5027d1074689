//! Prints steps and sensor faults as tables and lines for the terminal.

use crate::setup::rule_in_words;
use client::{Carrier, Client};
use comfy_table::{CellAlignment, ContentArrangement, Table, presets};
use fit::MIN_FORCE_N;
use parameters::{AssumedShare, DeformationScale, deformation_title};
use plantar::Region;
use plantar::faults::{Fault, Faults};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::Rejected;
use plantar::protocol::{Step, StepRegion};

/// Short names of the regions for narrow columns, in the order of [`Region::ALL`].
pub const REGION_LABELS: [&str; 8] =
    ["Heel", "P.midfoot", "A.midfoot", "Met 1-2", "Met 3-5", "Hallux", "Toe 2", "Toes 3-5"];

/// Prints a table with a row for each step, and a table with the means of each region. `starts_s` has the heel strikes on the
/// clock of a recording; without them, those on the clock of the insole are printed. `scales` states for each region whether the
/// scale of its deformation was measured or assumed.
pub fn print(steps: &[Step], starts_s: &[f64], scales: &[DeformationScale; 8]) {
    let Some(first) = steps.first() else {
        println!("no steps");
        return;
    };
    let mut table = table();
    let mut header = vec!["step".to_string(), "start s".into(), "stance s".into()];
    header.extend(REGION_LABELS.iter().map(|name| format!("{name} N")));
    table.set_header(header);
    for (i, step) in steps.iter().enumerate() {
        let start_s = starts_s.get(i).copied().unwrap_or(step.start_s());
        let mut row = vec![step.step.to_string(), format!("{start_s:.2}"), format!("{:.2}", step.duration_s())];
        row.extend(step.regions.iter().enumerate().map(|(i, r)| {
            let mark = |bits: u8, symbol| if bits >> i & 1 == 1 { symbol } else { "" };
            let model = if r.has_model() { format!("{:.0}", r.model_force_peak_n()) } else { "-".into() };
            format!(
                "{}{}{:.0} / {}{model}",
                if r.masked_cells > 0 { "~" } else { "" },
                mark(step.saturated, ">"),
                r.measured_force_peak_n(),
                mark(step.clamped, "*"),
            )
        }));
        table.add_row(row);
    }
    align(&mut table);
    println!("Peak force of each step, measured / model:\n{table}");
    if has_missing_number(steps) {
        println!(
            "Steps, load bouts and alerts are numbered together: a number that is missing in this table can be that of a load \
             bout or of an alert."
        );
    }
    print_changes(steps);
    if steps.iter().any(|step| step.saturated != 0) {
        println!("> A cell was at full scale: the measured force is a lower bound.");
    }
    if steps.iter().flat_map(|step| &step.regions).any(|region| region.masked_cells > 0) {
        println!("~ Faulty cells are masked: their values are interpolated from neighbouring cells.");
    }
    if steps.iter().any(|step| step.clamped != 0) {
        println!("* The contact exceeded the ellipsoid of the model: the model force is a lower bound.");
    }

    // An insole also sends stored steps from before a change of its contact rule.
    let mut rules = vec![first.contact_rule];
    for step in steps {
        if !rules.contains(&step.contact_rule) {
            rules.push(step.contact_rule);
        }
    }
    let area = recording::area_title(&first.contact_rule);
    let is_one_area = rules.iter().all(|rule| recording::area_title(rule) == area);
    let area = if is_one_area { area } else { "area (see below)" };
    let deformation = deformation_title(scales);
    let mut table = self::table();
    table.set_header([
        "region",
        "force N",
        "model N",
        &format!("{area} mm2"),
        "ellipse radii mm",
        &format!("{deformation} mm"),
        "contact s",
        "model error %",
    ]);
    for (i, region) in Region::ALL.iter().enumerate() {
        let loaded: Vec<_> = steps.iter().map(|s| &s.regions[i]).filter(|r| r.contact_ms > 0).collect();
        if loaded.is_empty() {
            table.add_row([region.name(), "-", "-", "-", "-", "-", "-", "-"]);
            continue;
        }
        let modelled: Vec<_> = loaded.iter().copied().filter(|r| r.has_model()).collect();
        let mean = |of: &[&StepRegion], digits: usize, value: fn(&StepRegion) -> f64| match of.len() {
            0 => "-".into(),
            count => format!("{:.digits$}", of.iter().map(|r| value(r)).sum::<f64>() / count as f64),
        };
        let radii = [StepRegion::ellipse_r_a_mm, StepRegion::ellipse_r_b_mm].map(|radius| mean(&loaded, 1, radius));
        table.add_row([
            region.name().to_string(),
            mean(&loaded, 1, StepRegion::measured_force_peak_n),
            mean(&modelled, 1, StepRegion::model_force_peak_n),
            mean(&loaded, 0, StepRegion::area_peak_mm2),
            radii.join(" x "),
            mean(&modelled, 2, StepRegion::deformation_peak_mm),
            mean(&loaded, 2, StepRegion::contact_time_s),
            model_error_percent(steps, i).map_or("-".into(), |percent| format!("{percent:.1}")),
        ]);
    }
    align(&mut table);
    println!(
        "Means of each region over the steps in which it was loaded, of {} in total. Force, model, area and deformation are the \
         peak values of a step. Force is measured: the sum over the cells. Model is the model force. The radii of the ellipse \
         (semi-axes) are those at the largest force:\n{table}",
        counted(steps.len(), "step")
    );
    if scales.iter().any(|scale| scale.assumed_percent() > 0) {
        println!(
            "Share of assumption in the scale of the deformation (50 % if either the thickness or the largest \
             compression of the tissue is assumed, or if it follows from a curvature, 100 % if both are assumed): {}.",
            AssumedShare(scales)
        );
    }
    println!("{}", contact_line(&rules));
}

/// True if a number is missing between two successive steps.
fn has_missing_number(steps: &[Step]) -> bool {
    steps.windows(2).any(|pair| pair[1].step > pair[0].step.saturating_add(1))
}

/// A line with the contact rules of the steps.
fn contact_line(rules: &[ContactRule]) -> String {
    let words = rules.iter().map(rule_in_words).collect::<Vec<_>>().join("; ");
    match rules.len() {
        1 => format!("Contact: {words}."),
        _ => format!("The steps have different contact rules, so their areas cannot be compared: {words}."),
    }
}

/// Prints the change of the stiffness K of each region since the identification, and a request for another identification, as
/// the insole determined them at the last step.
fn print_changes(steps: &[Step]) {
    let Some(last) = steps.last() else { return };
    let regions = REGION_LABELS.iter().zip(&last.regions).filter(|(_, region)| region.stiffness_change_percent != 0);
    let changes: Vec<_> =
        regions.map(|(name, region)| format!("{name} {:+} %", region.stiffness_change_percent)).collect();
    if !changes.is_empty() {
        println!("Change of the stiffness K since the identification: {}.", changes.join(", "));
    }
    if last.refit != 0 {
        println!(
            "The tissue, the shoe or the sensor, as by its temperature, has changed: check the position of the insole, and \
             identify the wearer again. A similar change in all regions indicates the sensor."
        );
    }
}

/// Requests the faults of an insole's sensor and prints them.
pub fn print_faults_of<C: Carrier>(client: &mut Client<C>) {
    match client.faults() {
        Ok(faults) => print_faults(&faults, client.hello().cells.into()),
        // This does not make the command fail: the insole retains its list of faults, and a later session can read it.
        Err(error) => eprintln!("note: the faults of the insole's sensor could not be read: {error}"),
    }
}

/// Prints the faults of a sensor; `cells` is the number of its cells.
pub fn print_faults(faults: &Faults, cells: usize) {
    faults_to_lines(faults, cells).iter().for_each(|line| println!("{line}"));
}

/// A line with the number of contacts that are no steps, by reason; `None` if there are none.
pub fn rejected_line(rejected: &Rejected) -> Option<String> {
    let reasons = [
        (rejected.short, "shorter than a step, or weak"),
        (rejected.long, "longer than a step, as in standing"),
        (rejected.broken, "with missing frames"),
    ];
    let reasons = reasons.iter().filter(|(contacts, _)| *contacts > 0);
    let reasons: Vec<_> = reasons.map(|(contacts, reason)| format!("{contacts} {reason}")).collect();
    (!reasons.is_empty()).then(|| format!("contacts that are no steps: {}", reasons.join(", ")))
}

/// One line for each fault, then lines with the number of masked cells, of cells with their former baseline, and of
/// corrected baselines.
fn faults_to_lines(faults: &Faults, cells: usize) -> Vec<String> {
    let fault = |fault: &Fault| {
        let found_s = f64::from(fault.found_ms) / 1e3;
        format!("sensor fault: {} {}, found {found_s:.1} s after the first scan", fault.place, fault.kind.name())
    };
    let mut lines: Vec<_> = faults.list.iter().map(fault).collect();
    let unlisted = faults.found.saturating_sub(faults.list.len() as u32);
    if unlisted > 0 {
        lines.push(format!("further sensor faults, not listed: {unlisted}"));
    }
    for (of_regions, state) in [
        (&faults.masked_cells, "masked"),
        (
            &faults.with_former_baseline,
            "with their former baseline, because they read a load while the foot was lifted",
        ),
    ] {
        let regions = REGION_LABELS.iter().zip(of_regions).filter(|&(_, &count)| count > 0);
        let regions: Vec<_> = regions.map(|(name, count)| format!("{name} {count}")).collect();
        if !regions.is_empty() {
            let count: u32 = of_regions.iter().map(|&count| u32::from(count)).sum();
            lines.push(format!("{count} of {cells} cells {state}: {}", regions.join(", ")));
        }
    }
    if faults.rezeroed > 0 {
        lines.push(format!("baselines of drifting cells were corrected {} times", faults.rezeroed));
    }
    lines
}

/// NRMSE of the model force against the measured force (Eq. 20 of the paper), %: mean over the steps in which the region with
/// this index was loaded and has a model force. `None` if there is none.
pub fn model_error_percent(steps: &[Step], region: usize) -> Option<f64> {
    let loaded: Vec<_> = steps.iter().map(|s| &s.regions[region]).filter(|r| r.has_model()).collect();
    let sum: f64 = loaded.iter().map(|r| r.model_error_nrmse_percent()).sum();
    (!loaded.is_empty()).then(|| sum / loaded.len() as f64)
}

/// As [`model_error_percent`], but only over steps in which the region carries at least [`MIN_FORCE_N`] and has no saturated
/// cell, so that the result can be compared with the error that a fit predicts: a fit does not use the other steps. With a
/// smaller force, the error is mainly that of single cells; with a saturated cell, the measured force is only a lower bound.
pub fn comparable_error_percent(steps: &[Step], region: usize) -> Option<f64> {
    let is_comparable =
        |step: &Step| step.saturated >> region & 1 == 0 && step.regions[region].measured_force_peak_n() >= MIN_FORCE_N;
    let comparable: Vec<Step> = steps.iter().copied().filter(is_comparable).collect();
    model_error_percent(&comparable, region)
}

/// A count with its noun in singular or plural: `1 step`, `2 steps`.
pub fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// An empty table in the style of all of the program's tables.
pub fn table() -> Table {
    let mut table = Table::new();
    table.load_preset(presets::UTF8_FULL_CONDENSED).set_content_arrangement(ContentArrangement::Disabled);
    table
}

/// Aligns all columns to the right. Call this after the header and all rows were added, because they create the columns.
pub fn align(table: &mut Table) {
    for column in table.column_iter_mut() {
        column.set_cell_alignment(CellAlignment::Right);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plantar::Side;
    use plantar::faults::{FaultKind, Place};
    use plantar::protocol::StepFoot;

    #[test]
    fn only_steps_that_a_fit_would_use_are_compared_with_its_prediction() {
        let step = |measured_peak_dn: u16, model_error_bp: u16, saturated: u8| Step {
            step: 0,
            side: Side::Left,
            start_us: 0,
            duration_us: 700_000,
            sample_us: 10_000,
            bridged_frames: 0,
            saturated,
            clamped: 0,
            contact_rule: ContactRule::COUNTED,
            foot: StepFoot::default(),
            regions: [StepRegion {
                measured_peak_dn,
                model_peak_dn: measured_peak_dn,
                contact_ms: 500,
                model_error_bp,
                ..StepRegion::default()
            }; 8],
            boots_since: 0,
            start_unix_us: None,
            refit: 0,
        };
        let steps = [step(500, 1_000, 0), step(30, 2_000, 0b10), step(29, 9_000, 0), step(500, 9_000, 0b1)];
        assert_eq!(comparable_error_percent(&steps, 0), Some(15.0));
        assert_eq!(comparable_error_percent(&steps[2..], 0), None);
        // The number of a load bout is missing among those of the steps.
        let numbered = |numbers: &[u32]| numbers.iter().map(|&step| Step { step, ..steps[0] }).collect::<Vec<_>>();
        assert!(has_missing_number(&numbered(&[0, 1, 3])) && !has_missing_number(&numbered(&[4, 5, 6])));
    }

    #[test]
    fn areas_of_different_contact_rules_are_stated_not_to_be_comparable() {
        let one = contact_line(&[ContactRule::COVERED]);
        assert!(one.starts_with("Contact: ") && !one.contains("cannot be compared"), "{one}");
        let two = contact_line(&[ContactRule::COVERED, ContactRule::COUNTED]);
        for words in ["cannot be compared", "sqrt(p / 150 kPa)", "whole cells"] {
            assert!(two.contains(words), "{two}");
        }
    }

    #[test]
    fn faults_are_printed_with_place_kind_time_and_cells() {
        assert_eq!(faults_to_lines(&Faults::NONE, 240), [""; 0]);
        let list = [
            Fault { kind: FaultKind::Open, place: Place::Cell(17), found_ms: 1_900 },
            Fault { kind: FaultKind::Short, place: Place::Row(3), found_ms: 12_340 },
        ];
        let list = list.into_iter().collect();
        let (masked_cells, with_former_baseline) = ([2, 0, 0, 0, 0, 1, 0, 0], [0, 0, 0, 4, 0, 0, 0, 0]);
        let faults = Faults { found: 3, rezeroed: 5, masked_cells, with_former_baseline, list };
        let lines = [
            "sensor fault: cell 17 open, found 1.9 s after the first scan",
            "sensor fault: row 3 short, found 12.3 s after the first scan",
            "further sensor faults, not listed: 1",
            "3 of 240 cells masked: Heel 2, Hallux 1",
            "4 of 240 cells with their former baseline, because they read a load while the foot was lifted: Met 1-2 4",
            "baselines of drifting cells were corrected 5 times",
        ];
        assert_eq!(faults_to_lines(&faults, 240), lines);
    }
}

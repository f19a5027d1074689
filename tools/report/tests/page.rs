//! The content of the HTML report, independent of its appearance.

mod common;

use common::{FILE, PARTICIPANT, STUDY, TITLES, empty};
use fit::sensitivity::{Choice, MainResults, Sensitivity, Variant};
use fit::{Filter, Method, NotFitted, RegionFit, Study};
use plantar::pipeline::contact::ContactRule;

/// The texts between the tags of each table row, without white space at their ends and without empty texts.
fn rows(html: &str) -> Vec<Vec<String>> {
    let cells = |row: &str| {
        let texts = row.split('<').filter_map(|tag| tag.split_once('>')).map(|(_, text)| text.trim().to_owned());
        texts.filter(|text| !text.is_empty()).collect()
    };
    html.split("<tr").skip(1).map(cells).collect()
}

fn table(html: &str, id: &str) -> String {
    let (_, rest) = html.split_once(&format!("id=\"{id}\"")).expect("the table is present");
    rest.split_once("</table>").expect("it ends").0.to_owned()
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[test]
fn sections_and_regions_are_present_in_order() {
    for study in [&STUDY, &empty()] {
        let html = report::html(study);
        assert!(html.starts_with("<!DOCTYPE html>"));
        let mut rest = &html[..];
        let sections = [
            "summary",
            "quantities",
            "protocol",
            "foot",
            "curves",
            "errors",
            "parameters",
            "sensitivity",
            "literature",
            "table",
            "reading",
        ];
        for id in sections {
            rest =
                rest.split_once(&format!("<section id=\"{id}\"")).unwrap_or_else(|| panic!("{id} does not follow")).1;
        }
        let mut rest = html.split_once("<section id=\"curves\"").expect("the section").1;
        for title in TITLES {
            rest = rest.split_once(&format!("<h3>{title}</h3>")).unwrap_or_else(|| panic!("{title} does not follow")).1;
        }
        let drawings = html.matches("<svg class=\"drawing\"").count();
        assert_eq!(html.matches("role=\"img\" aria-label=\"").count(), drawings);
        // Eight charts of force, their sum, six quantities and five parameters.
        assert!(drawings >= 8 + 1 + 6 + 5);
    }
}

#[test]
fn the_table_of_errors_has_the_numbers_of_the_study() {
    let rows = rows(&table(&report::html(&STUDY), "nrmse"));
    let paper = [22.1, 6.1, 8.2, 18.1, 11.7, 24.5, 13.9, 20.9];
    let mut numbers = 0;
    for (region, fit) in STUDY.fits.iter().enumerate() {
        let row = &rows[2 + region];
        assert_eq!(row[0], TITLES[region]);
        let is = |i: usize, expected: f64| {
            let shown: f64 = row[i].replace('−', "-").parse().expect("a number");
            assert!((shown - expected).abs() <= 0.05 + 1e-9, "{}, column {i}: {shown}, not {expected}", TITLES[region]);
        };
        is(row.len() - 1, paper[region]);
        let Ok(fit) = fit else { continue };
        assert_eq!(row[1], fit.steps.len().to_string());
        let q = &fit.quality;
        let predicted = q.predicted.expect("the study has several steps");
        let shares = [q.fitted, q.fitted_smoothed, q.own, q.own_smoothed, predicted, q.floor, q.peak_bias];
        for (i, share) in shares.into_iter().enumerate() {
            is(2 + i, share * 100.0);
            numbers += 1;
        }
    }
    assert_eq!(numbers, 6 * 7);
}

#[test]
fn excluded_contacts_and_regions_are_listed_with_their_reasons() {
    let html = report::html(&STUDY);
    let reasons: Vec<_> = STUDY.fits.iter().filter_map(|fit| fit.as_ref().err()).collect();
    assert_eq!(reasons.len(), 2, "{reasons:?}");
    for reason in reasons {
        // The reason is at least in the summary and in four tables.
        assert!(html.matches(&escaped(&reason.to_string())).count() >= 5, "{reason}");
    }
    assert!(!STUDY.excluded_contacts.is_empty());
    for contact in &STUDY.excluded_contacts {
        assert!(html.contains(&format!("{:.2}</td>", contact.at_s)) && html.contains(&contact.reason.to_string()));
    }
    for fit in STUDY.fits.iter().flatten() {
        assert!(html.contains(&escaped(&fit.verdict)));
        fit.defects.iter().for_each(|defect| assert!(html.matches(&escaped(defect)).count() >= 2, "{defect}"));
        fit.warnings.iter().for_each(|warning| assert!(html.contains(&escaped(warning)), "{warning}"));
    }
}

#[test]
fn the_page_loads_nothing_and_escapes_text() {
    let html = report::html(&STUDY);
    for outside in ["http:", "https:", "<script", "src=", "@import", "url(", "<i>walk"] {
        assert!(!html.contains(outside), "{outside}");
    }
    assert_eq!(html.matches("href=").count(), 1, "only the empty icon");
    assert!(html.contains(&escaped(PARTICIPANT)) && html.contains(&escaped(FILE)));
}

#[test]
fn a_study_without_steps_or_fit_has_a_report() {
    let mut nothing = empty();
    assert!(report::html(&nothing).contains("not fitted yet"));
    nothing.fit(&|_| ());
    assert!(report::html(&nothing).contains("no whole step"));
    let unfitted = Study { fits: Vec::new(), ..STUDY.clone() };
    assert!(report::html(&unfitted).contains("not fitted yet"));
    let replaced = report::html(&Study { steps: Vec::new(), ..STUDY.clone() });
    assert!(replaced.contains("Heel: not fitted, the fit is of other steps"));
    assert!(replaced.contains("Sum of the regions: not fitted, no region was fitted to these steps"));
}

#[test]
fn fits_without_damping_or_intervals_are_shown() {
    let mut undamped = STUDY.clone();
    for fit in undamped.fits.iter_mut().flatten() {
        fit.law.damping_pa_s = 0.0;
        if let Some(uncertainty) = &mut fit.uncertainty {
            let damping = &mut uncertainty.intervals[2];
            (damping.value, damping.jacobian, damping.bootstrap) = (0.0, [0.0, 5e3], None);
        }
    }
    assert!(report::html(&undamped).contains("no damping"));
    let mut without_intervals = STUDY.clone();
    without_intervals.options.method = Method::Paper;
    without_intervals.fits.iter_mut().flatten().for_each(|fit| fit.uncertainty = None);
    assert!(report::html(&without_intervals).contains("searched"));
}

#[test]
fn the_table_of_quantities_begins_with_the_numbers_of_the_study() {
    let rows = rows(&table(&report::html(&STUDY), "quantities-table"));
    let shown: Vec<f64> = rows[1][1..].iter().filter_map(|text| text.parse().ok()).collect();
    assert!(rows[1][0].starts_with("Force at 70 % of the largest area"), "{:?}", rows[1]);
    let measures = STUDY.fits.iter().flatten().map(|fit| &fit.measures[0]);
    let expected: Vec<f64> = measures.filter(|m| m.is_determined()).map(|m| m.value).collect();
    assert_eq!(shown.len(), expected.len());
    for (shown, expected) in shown.iter().zip(expected) {
        assert!((shown / expected - 1.0).abs() < 0.006, "{shown} for {expected}");
    }
}

#[test]
fn undetermined_parameters_and_defects_are_marked() {
    let mut study = STUDY.clone();
    assert!(!report::html(&study).contains("Incomplete"));
    for fit in study.fits.iter_mut().flatten() {
        fit.defects = vec!["the insole shifted".into()];
        for interval in fit.uncertainty.iter_mut().flat_map(|uncertainty| &mut uncertainty.intervals) {
            interval.is_identifiable = true;
        }
    }
    let identified = report::html(&study);
    assert_eq!(identified.matches("Incomplete: ").count(), 6);
    let marks = |html: &str| html.matches('†').count();
    // One mark is in the table of the five parameters, at the interval from the Jacobian. There is no interval from resampled
    // steps, because the steps are too few. In the table of the eight parameters, A B is two values, and m is one.
    for (parameter, more) in [(0, 3), (4, 2)] {
        let mut undetermined = study.clone();
        if let Some(Ok(fit)) = undetermined.fits.get_mut(0) {
            fit.uncertainty.as_mut().expect("intervals").intervals[parameter].is_identifiable = false;
        }
        assert_eq!(marks(&report::html(&undetermined)), marks(&identified) + more);
    }
}

#[test]
fn the_sensitivity_is_the_change_of_the_results() {
    assert!(report::html(&STUDY).contains("was not repeated"));
    let mut study = STUDY.clone();
    let changed = |fit: &RegionFit| {
        let results = MainResults::of(fit);
        MainResults {
            force_at_area_n: results.force_at_area_n.map(|force_n| 1.25 * force_n),
            predicted_nrmse: results.predicted_nrmse.map(|error| error - 0.011),
            ..results
        }
    };
    let regions = std::array::from_fn(|region| study.fits[region].as_ref().ok().map(changed));
    let variant = Variant { choice: Choice::Filter(Filter::Live), regions };
    study.sensitivity = Some(Sensitivity { variants: vec![variant], skipped: vec!["Steps were too few.".into()] });
    let html = report::html(&study);
    let section = html.split_once("<section id=\"sensitivity\"").expect("the section").1;
    assert!(section.contains("Steps were too few."));
    let rows: Vec<_> = rows(section).into_iter().filter(|row| row[0] == "filter live").collect();
    assert_eq!(rows.len(), 4);
    assert_eq!(rows[0].iter().filter(|text| *text == "+25").count(), 6);
    assert_eq!(rows[1].iter().filter(|text| *text == "0").count(), 6);
    assert_eq!(rows[3].iter().filter(|text| *text == "−1.1").count(), 6);
}

/// The outcome of the comparison with the finding of the paper that contains these words.
fn outcome(study: &Study, words: &str) -> String {
    let html = report::html(study);
    let item = html.split("<li>").skip(1).find(|item| item.contains(words)).expect("the finding");
    item.split_once("<strong>").and_then(|(_, rest)| rest.split_once("</strong>")).expect("an outcome").0.into()
}

/// The report states that a finding of the paper agrees with the results only if the finding is true of the fitted parameters.
#[test]
fn findings_of_the_paper_are_compared_with_the_results() {
    let finding = |study: &Study, words: &str| match &outcome(study, words)[..] {
        "Agrees." => true,
        "Contradicts." => false,
        other => panic!("{words}: {other}"),
    };
    let mut study = STUDY.clone();
    for (region, fit) in study.fits.iter_mut().enumerate() {
        let Ok(fit) = fit else { continue };
        (fit.ellipsoid.a_m, fit.ellipsoid.b_m, fit.ellipsoid.c_m) = (0.03, 0.032, 0.01);
        (fit.ellipsoid.k, fit.fixed.aspect) = (1e7 * (1.0 + 0.1 * region as f64), 0.94);
        fit.law.n = if region == 3 { 1.5 } else { 0.8 };
    }
    let findings = ["C is significantly smaller", "fairly uniform", "highest at", "n is positive"];
    findings.iter().for_each(|words| assert!(finding(&study, words), "{words}"));
    if let Some(Ok(heel)) = study.fits.get_mut(0) {
        (heel.ellipsoid.c_m, heel.fixed.aspect, heel.ellipsoid.k, heel.law.n) = (0.031, 1.3, 3e7, 1.6);
    }
    findings[..3].iter().for_each(|words| assert!(!finding(&study, words), "{words}"));
    if let Some(Ok(heel)) = study.fits.get_mut(0) {
        heel.law.n = -0.1;
    }
    assert!(!finding(&study, "n is positive"));
    // Without a fit of the metatarsals, nothing is known about their n.
    assert!(report::html(&study).contains("highest at the metatarsals"));
    study.fits[3..5].fill(Err(NotFitted::NeverLoaded));
    let html = report::html(&study);
    assert!(html.contains("n is positive") && !html.contains("highest at the metatarsals"));
}

/// n and k of the effective area are not those of the tissue, the borders of the regions determine A/B, and area and force come
/// from the same pressures.
#[test]
fn values_that_are_not_those_of_the_tissue_are_not_compared_with_the_tissue() {
    let mut study = STUDY.clone();
    for (contact, is_effective) in [(ContactRule::COUNTED, false), (ContactRule::COVERED, true)] {
        study.contact = contact;
        for aspect in [0.94, 1.9] {
            study.fits.iter_mut().flatten().for_each(|fit| fit.fixed.aspect = aspect);
            let expected = "Not comparable: shape of the contact within the region's borders.";
            assert_eq!(outcome(&study, "A and B are close"), expected);
        }
        for n in [-0.5, 0.5] {
            study.fits.iter_mut().flatten().for_each(|fit| fit.law.n = n);
            for words in ["n is positive", "highest at", "fairly uniform"] {
                let outcome = outcome(&study, words);
                assert_eq!(outcome == "Not comparable: effective area.", is_effective, "{words}: {outcome}");
            }
        }
        // The note is in the report once.
        let html = report::html(&study);
        assert_eq!(html.matches("those of the effective area, not of the tissue").count(), usize::from(is_effective));
        let (_, literature) = html.split_once("<section id=\"literature\"").expect("the section");
        let (literature, _) = literature.split_once("</section>").expect("it ends");
        let rows: Vec<String> = rows(literature).into_iter().map(|row| row[0].clone()).collect();
        assert!(!rows.iter().any(|title| title.contains("Viscous") || title.contains("Energy")), "{rows:?}");
        assert!(literature.contains("area and force come from the same pressures"));
    }
}

//! The content of the page, independent of its appearance.

mod common;

use common::{FILE, PARTICIPANT, STUDY, TITLES, empty};
use fit::{Method, Study};

/// The texts between the tags of each table row, without white space.
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
        for id in ["summary", "protocol", "foot", "curves", "errors", "parameters", "table", "reading"] {
            rest = rest.split_once(&format!("<section id=\"{id}\"")).unwrap_or_else(|| panic!("{id} follows")).1;
        }
        let mut rest = html.split_once("<section id=\"curves\"").expect("the section").1;
        for title in TITLES {
            rest = rest.split_once(&format!("<h3>{title}</h3>")).unwrap_or_else(|| panic!("{title} follows")).1;
        }
        let drawings = html.matches("<svg class=\"drawing\"").count();
        assert_eq!(html.matches("role=\"img\" aria-label=\"").count(), drawings);
        assert!(drawings >= 8 + 1 + 5);
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
    let unfit: Vec<_> = STUDY.fits.iter().filter_map(|fit| fit.as_ref().err()).collect();
    assert_eq!(unfit.len(), 2, "{unfit:?}");
    for reason in unfit {
        // The reason is in the summary, in three tables, and in the label of the drawing.
        assert!(html.matches(&escaped(&reason.to_string())).count() >= 5, "{reason}");
    }
    assert!(!STUDY.excluded_contacts.is_empty());
    for contact in &STUDY.excluded_contacts {
        assert!(html.contains(&format!("{:.2}</td>", contact.at_s)) && html.contains(&contact.reason.to_string()));
    }
    for fit in STUDY.fits.iter().flatten() {
        assert!(html.contains(&escaped(&fit.verdict)));
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

//! The main results with other contact rules, filters and selections of steps.

use fit::sensitivity::{Choice, MainResults, Sensitivity, choices};
use fit::synthetic::walk;
use fit::{Filter, Method, Options, Step, Study};
use plantar::pipeline::contact::ContactRule;
use std::sync::atomic::{AtomicUsize, Ordering};

fn study(steps: usize) -> Study {
    let mut study = Study::new("someone".into(), ContactRule::COVERED, Options::usual([0.012; 8]));
    study.steps = walk(steps, 100.0, Filter::Direct, 0.01, 1);
    study.fit(&|_| ());
    study
}

/// The steps of the study as if another contact rule had measured them: all areas are multiplied by `factor`.
fn scaled(study: &Study, factor: f64) -> Vec<Step> {
    let mut steps = study.steps.clone();
    for curves in steps.iter_mut().flat_map(|step| &mut step.regions) {
        curves.area_mm2.iter_mut().for_each(|area| *area *= factor);
    }
    steps
}

#[test]
fn every_choice_is_varied_and_has_the_expected_effect() {
    let study = study(12);
    let calls = AtomicUsize::new(0);
    let steps_by = |rule: &ContactRule| Ok(scaled(&study, if rule.on_kpa < 10.0 { 1.1 } else { 1.0 }));
    let sensitivity = Sensitivity::of(&study, Some(&steps_by), &|| {
        calls.fetch_add(1, Ordering::Relaxed);
    });
    let count = |kind: &str| sensitivity.variants.iter().filter(|v| v.choice.kind() == kind).count();
    let counts = ["contact_threshold", "area_scale", "filter", "left_out_steps"].map(count);
    assert_eq!(counts, [2, 3, 2, 4]);
    assert_eq!(calls.into_inner(), 8 * choices(&study, true).len());
    assert!(sensitivity.skipped.is_empty());
    for variant in &sensitivity.variants {
        for (results, fit) in variant.regions.iter().zip(&study.fits) {
            let base = MainResults::of(fit.as_ref().expect("fitted"));
            if variant.choice == Choice::Filter(Filter::Live) {
                // These steps were computed for the direct filter, and have no forces for the live one.
                assert_eq!(*results, None);
                continue;
            }
            let results = results.expect("fitted");
            let ratio =
                results.area_at_half_force_mm2.expect("a value") / base.area_at_half_force_mm2.expect("a value");
            match variant.choice {
                // If all areas grow by a tenth, the area at a force does so, too.
                Choice::Threshold(rule) if rule.on_kpa == 5.0 => assert!((1.05..1.15).contains(&ratio), "{ratio}"),
                // For these rules the steps are those of the study, so the law is, too.
                Choice::Threshold(_) | Choice::AreaScale(_) => assert!((ratio - 1.0).abs() < 1e-9, "{ratio}"),
                Choice::LeftOut(_) => assert!((0.97..1.03).contains(&ratio), "{ratio}"),
                // The forces of computed steps follow from the direct filter, so another filter results in another area.
                Choice::Filter(_) => assert!(ratio.is_finite()),
            }
        }
    }
}

#[test]
fn choices_that_cannot_be_varied_are_reported() {
    let live = Sensitivity::of(&study(6), None, &|| ());
    assert!(live.variants.iter().all(|variant| variant.choice.kind() == "filter"));
    assert_eq!(live.variants.len(), 2);
    assert!(
        live.skipped[0].contains("live stream") && live.skipped[1].contains("at least 8 steps"),
        "{:?}",
        live.skipped
    );

    let refused = |_: &ContactRule| Err("no cells".into());
    let refused = Sensitivity::of(&study(6), Some(&refused), &|| ());
    assert!(
        refused.skipped.iter().any(|sentence| sentence.contains("not possible: no cells")),
        "{:?}",
        refused.skipped
    );

    let mut low_scale = study(6);
    low_scale.contact = ContactRule { full_kpa: 15.0, ..low_scale.contact };
    let steps_by = |_: &ContactRule| Ok(low_scale.steps.clone());
    let low_scale = Sensitivity::of(&low_scale, Some(&steps_by), &|| ());
    let expected = "The fit with contact from 20 kPa was not possible: contact cannot begin above";
    assert!(low_scale.skipped.len() == 2 && low_scale.skipped[1].starts_with(expected), "{:?}", low_scale.skipped);

    let mut paper = study(6);
    paper.options.method = Method::Paper;
    let paper = Sensitivity::of(&paper, None, &|| ());
    assert!(paper.variants.is_empty());
    assert!(paper.skipped[0].contains("too slow"), "{:?}", paper.skipped);
}

/// The release threshold of a choice is computed from its contact threshold and the ratio of the study's thresholds. In single
/// precision, 5.9 / 10 * 10 is not 5.9, so only the contact thresholds can be compared.
#[test]
fn the_contact_rule_of_the_study_is_not_an_alternative() {
    let mut study = study(1);
    study.contact = ContactRule { on_kpa: 10.0, off_kpa: 5.9, ..study.contact };
    assert_ne!(study.contact.off_kpa / 10.0 * 10.0, study.contact.off_kpa);
    let thresholds = choices(&study, true).into_iter().filter_map(|choice| match choice {
        Choice::Threshold(rule) => Some(rule.on_kpa),
        _ => None,
    });
    assert_eq!(thresholds.collect::<Vec<_>>(), [5.0, 20.0]);
}

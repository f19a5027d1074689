//! The report on a cohort: its numbers, and its picture.

use fit::agreement::repeatability;
use fit::cohort::Person;
use fit::trials::{Trial, Values};
use fit::variable::Variable;
use parameters::{Participant, Sex};
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use report::Cohort;
use resvg::tiny_skia::Pixmap;

/// A trial of which the variables have the values `base`, `base` + 1 and so on. The last region was not fitted, so it has only
/// loads.
fn trial(base: f64) -> Trial {
    let values = |region| -> Values {
        let value = |(i, variable)| (region < 7 || matches!(variable, Variable::Load(_))).then_some(base + i as f64);
        Variable::all().enumerate().map(value).collect()
    };
    let regions = std::array::from_fn(values);
    Trial { name: "walk".into(), side: Side::Left, regions }
}

fn person(name: &str, size_eur: u8, sex: Sex, age_years: f64, trials: Vec<Trial>) -> Person {
    let settings = Participant { sex: Some(sex), age_years: Some(age_years), ..Participant::default() };
    Person { name: name.into(), size_eur, settings, steps: 5, trials }
}

fn people() -> Vec<Person> {
    vec![
        person("<i>ann", 37, Sex::Female, 20.0, vec![trial(1.0), trial(3.0)]),
        person("bob", 38, Sex::Male, 30.0, vec![trial(11.0), trial(11.0)]),
        person("cid", 44, Sex::Other, 40.0, vec![trial(20.0)]),
    ]
}

#[test]
fn table_1_and_the_errors_have_means_and_deviations_by_size() {
    let people = people();
    let trials: Vec<_> = people.iter().map(|person| (person.name.as_str(), &person.trials[..])).collect();
    let (feet, _) = repeatability(&trials, 2);
    let incomplete = ["bob, walk, heel: measurements contradict each other".to_string()];
    let cohort = Cohort { people: &people, feet: &feet, incomplete: &incomplete, contact: ContactRule::COVERED };
    let html = report::cohort_html(&cohort);
    assert!(html.contains("<dt>Incomplete results</dt><dd>bob, walk, heel: measurements contradict each other.</dd>"));
    let cells = |words: &[&str]| words.iter().map(|word| format!("<td>{word}</td>")).collect::<String>();
    // The standard deviation of 20 and 30 is sqrt(50) = 7.07.
    assert!(html.contains(&format!("<th scope=\"row\">37–38</th>{}", cells(&["2", "1/1", "25.0 ± 7.1", "–", "–"]))));
    assert!(html.contains(&format!("<th scope=\"row\">43–44</th>{}", cells(&["1", "0/0/1", "40.0", "–", "–"]))));
    // The age of one of two people is unknown.
    let mut people = people.clone();
    people[1].settings.age_years = None;
    let partial = report::cohort_html(&Cohort { people: &people, ..cohort });
    assert!(partial.contains(&format!("<th scope=\"row\">37–38</th>{}", cells(&["2", "1/1", "20.0 (1)", "–", "–"]))));
    // The means of the two people are 2 and 11, each plus the index of the variable. The mean over the people is therefore 6.5
    // plus the index, and the standard deviation is 6.4.
    let i = Variable::nrmse().index() as f64;
    assert!(html.contains(&format!("<td>{:.1} ± 6.4</td><td>{:.1}</td>", 6.5 + i, 20.0 + i)));
    assert!(
        html.contains("left foot: 2 trials of 2 people") && html.contains("&lt;i&gt;ann") && !html.contains("<i>ann")
    );
    let none = Cohort { people: &people[2..], feet: &[], incomplete: &[], contact: ContactRule::COUNTED };
    assert!(report::cohort_html(&none).contains("at least two recordings each of the left foot"));
    // One chart of the errors, one for each of the 6 loads, 15 quantities and 8 parameters, and one of the repeatability.
    assert_eq!(html.matches("<figure").count(), 1 + 6 + 15 + 8 + 1);
}

/// The errors of the two people differ by the factor 40, and so must the lengths of their bars, which are rounded to 0.1.
#[test]
fn bars_begin_at_zero_even_if_errors_differ_by_a_large_factor() {
    let with_errors = |name, size_eur, percent: f64| {
        let values: Values = Variable::all().map(|_| Some(percent)).collect();
        let trial = Trial { regions: std::array::from_fn(|_| values.clone()), ..trial(percent) };
        person(name, size_eur, Sex::Female, 20.0, vec![trial])
    };
    let people = [with_errors("ann", 37, 2.5), with_errors("bea", 43, 100.0)];
    let cohort = Cohort { people: &people, feet: &[], incomplete: &[], contact: ContactRule::COUNTED };
    let html = report::cohort_html(&cohort);
    // The width is the third attribute after the class.
    let length = |bar: &str| bar.split('"').nth(5).and_then(|text| text.parse().ok()).expect("a width");
    let lengths: Vec<f64> = html.split("<rect class=\"fill own\"").skip(1).map(length).collect();
    assert_eq!(lengths.len(), 8 * 2, "a bar for each region and size");
    for bars in lengths.chunks_exact(2) {
        assert!(bars[1] > 10.0 && (bars[0] - bars[1] / 40.0).abs() < 0.1, "{bars:?}");
    }
}

/// Six pairs of successive sizes have six colours, also if some are larger or smaller than those of the paper.
#[test]
fn six_pairs_of_sizes_have_six_colours() {
    for (smallest_eur, first) in [(20, 0), (35, 0), (41, 0), (39, 2)] {
        let sizes = (smallest_eur..=52).step_by(2).take(6 - first);
        let people: Vec<_> =
            sizes.map(|size_eur| person("ann", size_eur, Sex::Female, 20.0, vec![trial(1.0)])).collect();
        let cohort = Cohort { people: &people, feet: &[], incomplete: &[], contact: ContactRule::COUNTED };
        let html = report::cohort_html(&cohort);
        let is_used = |colour: &usize| html.contains(&format!("<g class=\"s{colour}\">"));
        let used: Vec<_> = (0..6).filter(is_used).collect();
        let expected: Vec<_> = (first..6).collect();
        assert_eq!(used, expected, "from size {smallest_eur}");
    }
}

#[test]
#[ignore = "needs a font for the text: cargo xtask test"]
fn the_picture_is_large_and_not_blank() {
    let people = people();
    for people in [&people[..], &people[..1]] {
        let cohort = Cohort { people, feet: &[], incomplete: &[], contact: ContactRule::COUNTED };
        let png = report::cohort_png(&cohort).expect("a picture");
        let picture = Pixmap::decode_png(&png).expect("a valid PNG");
        assert!((2000..3000).contains(&picture.width()) && (3000..9000).contains(&picture.height()));
        let inked = picture.pixels().iter().filter(|pixel| pixel.red() < 128).count();
        assert!(inked > 10_000, "{inked} dark pixels");
    }
}

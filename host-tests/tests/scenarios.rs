//! The firmware's tasks on a host in virtual time, with the real client: one test for each file in `scenarios`; and the errors
//! of invalid scenarios.

use rstest::rstest;
use std::path::PathBuf;
use testkit::scenario::{InsoleOutcome, Scenario, ScenarioError};

#[rstest]
fn scenario_has_the_expected_outcome(#[files("scenarios/*.toml")] file: PathBuf) {
    let text = std::fs::read_to_string(&file).expect("the file can be read");
    let scenario = Scenario::parse(&text).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    let mut outcome = scenario.run();
    if let Err(differences) = outcome.compare(&scenario.expect) {
        let hosts = outcome.insoles.iter().map(|insole| (&insole.host.errors, &insole.host.hellos));
        let hosts: Vec<_> = hosts.collect();
        panic!("{}\n{differences}\nerrors and hellos of each insole: {hosts:#?}", scenario.title);
    }
}

/// The error of an invalid scenario.
fn error_of(text: &str) -> ScenarioError {
    Scenario::parse(text).expect_err("the scenario must be refused")
}

/// The beginning of a scenario: the first two lines of the file.
const HEADER: &str = "title = \"A test.\"\nduration_s = 5.0\n";

#[test]
fn an_unknown_event_is_named_with_its_line() {
    let error = error_of(&format!("{HEADER}\n[[at]]\ns = 1.0\nevent.wlk = {{ steps = 1 }}\n")).to_string();
    assert!(error.contains("line 6") && error.contains("wlk") && error.contains("walk"), "{error}");
}

#[test]
fn an_unknown_key_of_an_event_is_named_with_its_line() {
    let error = error_of(&format!("{HEADER}\n[[at]]\ns = 1.0\nevent.walk = {{ step = 1 }}\n")).to_string();
    assert!(error.contains("line 6") && error.contains("step"), "{error}");
}

#[test]
fn an_impossible_number_is_named_with_its_line() {
    for (text, line, remedy) in [
        (format!("{HEADER}insoles = 3\n"), "line 3", "use 1, or 2"),
        (format!("{HEADER}insoles = 0\n"), "line 3", "use 1, or 2"),
        (format!("{HEADER}rate_hz = 0.0\n"), "line 3", "use 20 to 500"),
        (format!("{HEADER}rate_hz = nan\n"), "line 3", "use 20 to 500"),
        (format!("{HEADER}\n[[at]]\ns = 1.0\nevent.set_settings = {{ rate_hz = 0 }}\n"), "line 6", "nonzero"),
    ] {
        let error = error_of(&text).to_string();
        assert!(error.contains(line) && error.contains(remedy), "{text}: {error}");
    }
}

#[test]
fn an_expectation_about_an_insole_that_no_host_observes_is_not_met() {
    let expectations = [
        ("frames_missed = 0", "missed frames"),
        ("frames_skipped = 0", "skipped frames"),
        ("rejected = [0, 0, 0]", "rejected contacts"),
        ("faults = []", "faults"),
        ("loses_live = false", "loses live frames"),
        ("parameters = false", "has parameters"),
    ];
    let text = expectations.map(|(expectation, _)| expectation).join("\n");
    let scenario = Scenario::parse(&format!("{HEADER}[expect]\n{text}\n")).expect("the scenario is valid");
    let differences = scenario.run().compare(&scenario.expect).expect_err("no host is connected");
    for (_, name) in expectations {
        assert!(differences.contains(&format!("{name}: expected Some(")), "{name} is not in: {differences}");
    }
}

#[test]
fn an_insole_that_does_not_answer_at_the_end_or_restarts_on_its_own_is_reported() {
    let events = "[[at]]\ns = 0.5\nevent.connect = { over = \"serial\" }\n";
    let scenario = Scenario::parse(&format!("{HEADER}{events}")).expect("the scenario is valid");
    let differences = |change: fn(&mut InsoleOutcome)| {
        let mut outcome = scenario.run();
        change(&mut outcome.insoles[0]);
        outcome.compare(&scenario.expect).err().unwrap_or_default()
    };
    assert_eq!(differences(|_| ()), "");
    assert!(differences(|insole| insole.status = None).contains("does not answer at the end"));
    assert!(differences(|insole| insole.resets.push("watchdog".into())).contains("resets"));
}

#[test]
fn impossible_events_are_named_with_their_line() {
    // Events, the line of the impossible one, and a word that the error must contain.
    for (events, line, word) in [
        ("[[at]]\ns = 2.0\nevent.walk = { steps = 1 }\n[[at]]\ns = 1.0\nevent = \"panic\"\n", 6, "sort"),
        ("[[at]]\ns = 1.0\nevent = \"restart\"\n", 3, "connect"),
        ("[[at]]\ns = 1.0\nevent = \"disconnect\"\n", 3, "connect"),
        ("[[at]]\ns = 9.0\nevent = \"panic\"\n", 3, "duration_s"),
        ("[[at]]\ns = 1.0\ninsole = 1\nevent = \"panic\"\n", 3, "insoles = 2"),
        ("[[at]]\ns = 1.0\nevent.power_cut = { off_s = 2.0 }\n[[at]]\ns = 2.0\nevent = \"panic\"\n", 6, "power"),
        ("[[at]]\ns = 1.0\nevent.walk = { steps = 3 }\n[[at]]\ns = 2.0\nevent.walk = { steps = 3 }\n", 6, "walk"),
        ("[[at]]\ns = 1.0\nevent.walk = { steps = 3 }\n[[at]]\ns = 4.2\nevent.walk = { steps = 3 }\n", 6, "walk"),
        ("[[at]]\ns = 1.0\nevent.sensor_fault = \"open-cell\"\n", 3, "open-cell:17"),
        (
            "[[at]]\ns = 1.0\nevent.cable_cut = { for_s = 2.0 }\n[[at]]\ns = 2.0\nevent.cable_cut = { for_s = 2.0 }\n",
            6,
            "repaired",
        ),
        ("[[at]]\ns = 1.0\nevent.set_serial = \"A 0042\"\n", 3, "without spaces"),
    ] {
        let error = error_of(&format!("{HEADER}{events}"));
        let text = error.to_string();
        assert!(matches!(error, ScenarioError::Order { line: found, .. } if found == line), "{events}: {text}");
        assert!(text.contains(word), "{events}: {text}");
    }
}

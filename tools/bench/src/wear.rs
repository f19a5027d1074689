//! Measures how an insole finds steps in shoes that press on it, and how its steps agree with another vendor's reports.

use anyhow::Result;
use bench::{Figures, raise};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use recording::synthetic::SyntheticWalk;
use std::path::Path;
use testkit::activity::{recognised, recording, sequences};
use testkit::moticon;
use testkit::wear::{LEVELS_KPA, Residual, compare, find, noisy_walk};

/// Measures all figures of walks in shoes; `moticon` is the source archive of the package moticon-opengo, which a
/// script for `python` reads.
pub fn measure(python: &Path, moticon: &Path, figures: &mut Figures) -> Result<()> {
    let (mut walked, mut found, mut extra, mut faults, mut force_error) = (0, 0, 0, 0, 0.0f64);
    for contact in [ContactRule::COUNTED, ContactRule::COVERED] {
        // The seeds differ from those of the test `host-tests/tests/wear.rs`, so these are other walks.
        for (seed, residual) in (100..).zip(Residual::ALL) {
            let walk = noisy_walk(&SyntheticWalk { steps: 60, variation: 0.1, seed, ..SyntheticWalk::default() });
            for level_kpa in LEVELS_KPA {
                let result = compare(&walk, contact, residual, level_kpa);
                walked += result.walked;
                found += result.found;
                extra += result.extra;
                faults += result.faults;
                raise(&mut force_error, result.force_error);
            }
        }
    }
    figures.add(
        "wear.residual_found",
        found as f64 / walked as f64,
        "at least 0.995: share of the steps that are found in shoes that press with 0.5 to 8 kPa, 50 walks of 60 steps",
    );
    figures.add(
        "wear.residual_extra",
        extra as f64,
        "0: number of steps in these walks that are found but were not walked",
    );
    figures.add("wear.false_faults", f64::from(faults), "0: number of sensor faults that are reported in these walks");
    figures.add(
        "wear.force_error",
        force_error,
        "at most 0.02: relative deviation of the peak force of the found steps, mean of a walk, largest of these walks",
    );
    measure_bouts(figures);
    let agreement = moticon::compare(python, moticon);
    let share = agreement.found as f64 / agreement.steps as f64;
    figures.add("moticon.found", share, "1: share of 42 steps in another vendor's reports that are found");
    for (key, value, meaning) in [
        ("moticon.contact_ms", agreement.contact_ms, "at most 10: difference of initial contact, median"),
        ("moticon.toe_off_ms", agreement.toe_off_ms, "at most 15: difference of toe off, median"),
        ("moticon.peak_force_n", agreement.peak_n, "at most 1: difference of the largest force, median"),
        ("moticon.stride_ms", agreement.stride_ms, "at most 15: difference of stride time, median"),
        ("moticon.step_ms", agreement.step_ms, "at most 15: difference of step time, median"),
        (
            "moticon.double_support_ms",
            agreement.double_support_ms,
            "at most 15: difference of the first phase of double support, median",
        ),
        (
            "moticon.both_phases_ms",
            agreement.both_phases_ms,
            "at most 35: difference of the double support of a stride, both phases together, median",
        ),
    ] {
        figures.add(key, (value * 1e3).round() / 1e3, meaning);
    }
    Ok(())
}

/// Measures which share of the load is in no record, and how many activities are recognised.
fn measure_bouts(figures: &mut Figures) {
    let (mut labelled, mut right, mut unassigned) = (0, 0, 0.0f64);
    let rate_hz = 100.0;
    for weight_n in [150.0, 650.0, 1_770.0] {
        // The seeds differ from those of the test `host-tests/tests/bouts.rs`.
        for (order, seed) in sequences().zip(50..) {
            let (recording, spans) = recording(&order, weight_n, rate_hz, 20.0, seed);
            let found = find(&recording, ContactRule::COVERED, StanceRule::ADAPTIVE);
            raise(&mut unassigned, found.unassigned(rate_hz));
            let (of_run, right_of_run) = recognised(&spans, &found, (1e6 / rate_hz) as u64);
            (labelled, right) = (labelled + of_run, right + right_of_run);
        }
    }
    figures.add(
        "wear.unassigned_load",
        unassigned,
        "at most 0.001: difference between the force-time integrals of all steps and load bouts and of the stream, as a share of \
         the latter, largest of 21 sequences of activities",
    );
    let share = right as f64 / labelled as f64;
    figures.add(
        "wear.kinds_recognised",
        share,
        "at least 0.95: share of the standing, shuffling and sitting in the 21 sequences that is recognised as such",
    );
}

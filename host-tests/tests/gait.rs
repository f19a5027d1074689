//! The measures of both feet equal those of an independent implementation, and the times of a computed walk.

use crate::common;
use client::gait::{COUNT, Estimate, FootStep, Gait, MEASURES};
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::protocol::Step;
use recording::synthetic::{self, SyntheticWalk};
use serde_json::{Value, json};

/// Irregular walks of both feet: strides that vary and drift, pauses, missing steps, and a part that is run.
fn irregular(seed: u64) -> [Vec<FootStep>; 2] {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut feet = [Vec::new(), Vec::new()];
    let (mut t_s, mut stride_s) = (1000.0, 1.1);
    for i in 0..120 {
        stride_s += 0.02 * (random.f64() - 0.5) + 0.1 * (1.1 - stride_s);
        let lag_s = stride_s * (0.46 + 0.08 * random.f64());
        // The part of a stride in which the foot is on the ground, in running and in walking.
        let stance_share = if (60..80).contains(&i) { 0.35 } else { 0.62 };
        for (foot, from_s) in [(0, 0.0), (1, lag_s)] {
            if random.f64() < 0.03 {
                continue;
            }
            let duration_s = stride_s * (stance_share + 0.04 * random.f64());
            let (peak_n, integral_n_s) = (700.0 + 90.0 * random.f64(), 280.0 + 40.0 * random.f64());
            let step = FootStep { number: i, start_s: t_s + from_s, duration_s, peak_n, integral_n_s };
            feet[foot].push(step);
        }
        t_s += if random.f64() < 0.04 { 8.0 } else { stride_s };
    }
    feet
}

/// Asserts that an estimate equals that of `gait.py`. The limits of the interval may differ by 1 % of its half width, because the
/// quantile is approximated.
fn compare(name: &str, found: Option<Estimate>, expected: &Value) {
    let Some(found) = found else {
        assert!(expected.is_null(), "{name}: {expected}");
        return;
    };
    let number = |i: usize| expected[i].as_f64();
    assert_eq!(Some(found.count as u64), expected[0].as_u64(), "{name}");
    let near = |found: Option<f64>, expected: Option<f64>, tolerance: f64| match (found, expected) {
        (Some(found), Some(expected)) => {
            assert!((found - expected).abs() <= tolerance, "{name}: {found} instead of {expected}")
        }
        (found, expected) => assert_eq!(found, expected, "{name}"),
    };
    near(Some(found.mean), number(1), 1e-9 * found.mean.abs().max(1.0));
    near(found.sd, number(2), 1e-6 * found.sd.unwrap_or(0.0).max(1e-3));
    let half_width = found.interval.map_or(0.0, |[low, high]| (high - low) / 2.0);
    near(found.interval.map(|it| it[0]), number(3), 0.01 * half_width + 1e-9);
    near(found.interval.map(|it| it[1]), number(4), 0.01 * half_width + 1e-9);
}

#[test]
#[ignore = "needs Python with SciPy: cargo xtask test"]
fn measures_of_irregular_walks_equal_those_of_numpy() {
    for seed in 0..5 {
        let feet = irregular(seed);
        let rows = |steps: &[FootStep]| {
            let row = |s: &FootStep| json!([s.number, s.start_s, s.duration_s, s.peak_n, s.integral_n_s]);
            steps.iter().map(row).collect::<Vec<_>>()
        };
        let input = json!({ "left": rows(&feet[0]), "right": rows(&feet[1]) });
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/gait.py");
        let expected: Value = serde_json::from_str(&common::run_python(&[script], &input.to_string())).expect("JSON");
        let gait = Gait::new(feet, true);
        assert!(gait.feet.iter().all(|foot| foot.strides.len() > 80 && foot.gaps > 3 && foot.unpaired > 0));
        for (i, measure) in MEASURES.iter().enumerate() {
            for (side, foot) in ["left", "right"].into_iter().zip(&gait.feet) {
                let name = format!("{side} {}", measure.key);
                compare(&name, foot.measures[i], &expected[&name]);
            }
            let name = format!("symmetry {}", measure.key);
            compare(&name, gait.symmetry_percent[i], &expected[&name]);
        }
        compare("cadence", gait.cadence_per_min, &expected["cadence"]);
    }
    println!("{} measures of five walks agree", 3 * COUNT + 1);
}

/// The insole detects heel strike when the force reaches one threshold, and toe off when it falls below another, so a stance is
/// shorter than the time with force. The times between the feet are not affected, because both have the same force over time.
#[test]
fn a_computed_walk_of_both_feet_has_its_true_times() {
    /// Time from a heel strike of the left foot to the next one of the right foot, s.
    const LAG_S: f64 = 0.5;
    let foot = |side, lag_s: f64| {
        let walk = SyntheticWalk { side, steps: 20, variation: 0.0, ..SyntheticWalk::default() };
        let recording = synthetic::walk(&walk).recording;
        let (_, steps) = common::replay(&recording, ContactRule::COUNTED, |_| false);
        assert_eq!(steps.len(), walk.steps);
        let foot_step = |step| FootStep::new(step, step.start_us + (lag_s * 1e6) as u64, &[]);
        (steps.iter().map(foot_step).collect::<Vec<_>>(), walk)
    };
    let ((left, walk), (right, _)) = (foot(Side::Left, 0.0), foot(Side::Right, LAG_S));
    // The thresholds adapt to the peaks of the first steps, so these may last a frame longer.
    let stance_s = left.iter().map(|step| step.duration_s).sum::<f64>() / left.len() as f64;
    let gait = Gait::new([left, right], true);
    let mean = |foot: usize, key: &str| {
        let i = MEASURES.iter().position(|measure| measure.key == key).expect("a key");
        gait.feet[foot].measures[i].expect("a value").mean
    };
    let stride_s = walk.stance_s + walk.swing_s;
    // With the peak of this walk, 800 N, the thresholds of heel strike and toe off become 40 and 80 N. The detected stance lacks
    // the frames below the first at its beginning and below the second at its end.
    assert!((walk.stance_s - 0.06..walk.stance_s).contains(&stance_s), "{stance_s}");
    for foot in 0..2 {
        let expected = [
            ("stride_time_s", stride_s),
            ("step_time_s", if foot == 0 { stride_s - LAG_S } else { LAG_S }),
            ("stance_time_s", stance_s),
            ("swing_time_s", stride_s - stance_s),
            // Both phases together: two stances cover the stride once, and the double support twice.
            ("double_support_s", 2.0 * stance_s - stride_s),
        ];
        for (key, expected) in expected {
            assert!(
                (mean(foot, key) - expected).abs() < 1e-3,
                "{key} of foot {foot}: {} instead of {expected}",
                mean(foot, key)
            );
        }
    }
    assert!((gait.cadence_per_min.expect("strides").mean - 120.0 / stride_s).abs() < 0.05);
}

/// An insole numbers steps and load bouts together.
#[test]
fn a_load_bout_between_two_steps_is_no_missing_step() {
    let step = |number: u32| Step { step: number, start_us: u64::from(number) * 800_000, ..testkit::step(number) };
    let gaps = |bouts: &[u32]| {
        let steps = [0, 1, 3, 5].map(|number| FootStep::new(&step(number), step(number).start_us, bouts));
        let [left, _] = Gait::new([steps.to_vec(), Vec::new()], false).feet;
        (left.strides.len(), left.gaps)
    };
    // Step 4 is missing.
    assert_eq!(gaps(&[2]), (2, 1));
    assert_eq!(gaps(&[]), (1, 2));
}

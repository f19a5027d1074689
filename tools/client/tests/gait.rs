//! The measures of both feet of a walk with known times.

use client::gait::{COUNT, FootStep, Gait, Length, MEASURES};

/// Stride time of the walk, s.
const STRIDE_S: f64 = 1.1;
/// Time from the left to the right heel strike, s.
const LAG_S: f64 = 0.5;
/// Stance time of the left and of the right foot, s.
const STANCE_S: [f64; 2] = [0.7, 0.65];

/// Steps of the left and of the right foot in a walk of equal strides that begins at `from_s`.
fn walk(from_s: f64, steps: u32, first_number: u32) -> [Vec<FootStep>; 2] {
    [(0.0, STANCE_S[0], 800.0, 330.0), (LAG_S, STANCE_S[1], 760.0, 300.0)].map(
        |(lag_s, duration_s, peak_n, integral_n_s)| {
            let step = |i: u32| FootStep {
                number: first_number + i,
                start_s: from_s + lag_s + f64::from(i) * STRIDE_S,
                duration_s,
                peak_n,
                integral_n_s,
            };
            (0..steps).map(step).collect()
        },
    )
}

/// Index of the measure with this key.
fn index(key: &str) -> usize {
    MEASURES.iter().position(|measure| measure.key == key).unwrap_or_else(|| panic!("no measure {key}"))
}

/// Asserts that the mean of a measure has this value for the left and the right foot.
fn assert_means(gait: &Gait, key: &str, expected: [f64; 2]) {
    for (foot, expected) in gait.feet.iter().zip(expected) {
        let found = foot.measures[index(key)].unwrap_or_else(|| panic!("no {key}")).mean;
        assert!((found - expected).abs() < 1e-9, "{key}: {found} for {expected}");
    }
}

#[test]
fn the_measures_of_a_walk_with_known_times_follow_their_definitions() {
    let gait = Gait::new(walk(1.8e9, 10, 0), true);
    assert!(gait.feet.iter().all(|foot| (foot.strides.len(), foot.gaps, foot.unpaired) == (9, 0, 0)));
    // The times are near 1.8e9 s, where a floating-point number has a resolution of 0.24 us.
    let near = |found: f64, expected: f64| (found - expected).abs() < 1e-5 * expected.abs().max(1.0);
    // The first double support of a foot begins with its heel strike, while the other foot is still on the ground; the second
    // one begins with the heel strike of the other foot.
    let left_first_s = LAG_S + STANCE_S[1] - STRIDE_S;
    let right_first_s = STANCE_S[0] - LAG_S;
    let double_s = left_first_s + right_first_s;
    for (key, expected) in [
        ("stride_time_s", [STRIDE_S; 2]),
        ("step_time_s", [STRIDE_S - LAG_S, LAG_S]),
        ("stance_time_s", STANCE_S),
        ("swing_time_s", STANCE_S.map(|stance_s| STRIDE_S - stance_s)),
        ("stance_percent", STANCE_S.map(|stance_s| 100.0 * stance_s / STRIDE_S)),
        ("swing_percent", STANCE_S.map(|stance_s| 100.0 - 100.0 * stance_s / STRIDE_S)),
        ("first_double_support_s", [left_first_s, right_first_s]),
        ("double_support_s", [double_s; 2]),
        ("double_support_percent", [100.0 * double_s / STRIDE_S; 2]),
        // A foot is alone on the ground while the other one swings.
        ("single_support_s", [STRIDE_S - STANCE_S[1], STRIDE_S - STANCE_S[0]]),
        (
            "single_support_percent",
            [1.0 - STANCE_S[1] / STRIDE_S, 1.0 - STANCE_S[0] / STRIDE_S].map(|share| 100.0 * share),
        ),
        ("flight_s", [0.0; 2]),
        ("peak_force_n", [800.0, 760.0]),
        ("force_integral_n_s", [330.0, 300.0]),
    ] {
        for (foot, expected) in gait.feet.iter().zip(expected) {
            let found = foot.measures[index(key)].unwrap_or_else(|| panic!("no {key}"));
            assert!(near(found.mean, expected), "{key}: {} for {expected}", found.mean);
            assert!(found.sd.is_some_and(|sd| sd < 1e-4), "{key}: {found:?}");
        }
    }
    assert!(near(gait.cadence_per_min.expect("strides").mean, 120.0 / STRIDE_S));
    let symmetry = |key| gait.symmetry_percent[index(key)].map(|symmetry| symmetry.mean);
    // 200 (800 - 760) / (800 + 760), and so on.
    for (key, expected) in [
        ("peak_force_n", 5.128_205),
        ("force_integral_n_s", 9.523_810),
        ("stance_time_s", 7.407_407),
        ("swing_time_s", -11.764_706),
        ("step_time_s", 18.181_818),
    ] {
        assert!(symmetry(key).is_some_and(|found| near(found, expected)), "{key}: {:?}", symmetry(key));
    }
    assert_eq!(symmetry("stride_time_s"), None);
    let speed = |length| gait.speed_m_s(length).expect("a walk without a pause");
    assert!(near(speed(Length::Stride(1.32)), 1.2));
    // From the first left to the tenth right heel strike.
    assert!(near(speed(Length::Walk(12.0)), 12.0 / (9.0 * STRIDE_S + LAG_S)));
}

#[test]
fn pauses_and_missing_steps_are_counted_and_not_used() {
    let before = walk(10.0, 6, 0);
    let after = walk(30.0, 6, 6);
    let [mut left, right] = [0, 1].map(|foot| [before[foot].clone(), after[foot].clone()].concat());
    // The eighth step of the left foot is lost.
    left.remove(7);
    let gait = Gait::new([left, right], true);
    let counts = gait.feet.each_ref().map(|foot| (foot.strides.len(), foot.gaps, foot.unpaired));
    // Left: 10 pairs of successive steps, of which one has the pause and one the missing step. Right: 11 such pairs, of which one
    // has the pause and one lacks the left step.
    assert_eq!(counts, [(8, 2, 0), (9, 1, 1)]);
    assert_means(&gait, "step_time_s", [STRIDE_S - LAG_S, LAG_S]);
    let doubles = gait.feet.each_ref().map(|foot| foot.measures[index("double_support_s")].map(|mean| mean.count));
    // The first left stride has no right step before it, and the first right stride in use after the missing step has no left
    // step directly before it.
    assert_eq!(doubles, [Some(7), Some(8)]);
    assert_eq!(gait.speed_m_s(Length::Walk(12.0)), None);
    assert!(gait.speed_m_s(Length::Stride(1.3)).is_some());
}

#[test]
fn without_the_other_foot_or_a_common_clock_there_are_only_the_measures_that_need_one_foot() {
    let [left, right] = walk(10.0, 8, 0);
    let one = Gait::new([left.clone(), Vec::new()], true);
    let apart = Gait::new([left, right], false);
    for gait in [&one, &apart] {
        assert!(!gait.has_both_feet);
        let needs_both = ["step_time_s", "first_double_support_s", "double_support_s", "double_support_percent"];
        let needs_both = [&needs_both[..], &["single_support_s", "single_support_percent", "flight_s"]].concat();
        let known = gait.feet[0].measures.each_ref().map(Option::is_some);
        let expected: [bool; COUNT] = core::array::from_fn(|i| !needs_both.contains(&MEASURES[i].key));
        assert_eq!(known, expected);
        assert_eq!(gait.symmetry_percent, [None; COUNT]);
        assert!(gait.cadence_per_min.is_some_and(|cadence| (cadence.mean - 120.0 / STRIDE_S).abs() < 1e-9));
        assert_eq!(gait.speed_m_s(Length::Walk(10.0)), None);
    }
    assert_eq!(one.feet[1].strides, []);
    assert_eq!(apart.feet[1].strides.len(), 7);
    assert_eq!(Gait::new([Vec::new(), Vec::new()], true).cadence_per_min, None);
}

#[test]
fn a_run_has_flight_instead_of_double_support() {
    let mut steps = walk(10.0, 10, 0);
    steps.iter_mut().flatten().for_each(|step| step.duration_s = 0.25);
    let gait = Gait::new(steps, true);
    assert_means(&gait, "double_support_s", [0.0; 2]);
    assert_means(&gait, "single_support_s", [0.25; 2]);
    // In each stride, both feet are in the air whenever neither of the two stances of 0.25 s takes place.
    assert_means(&gait, "flight_s", [STRIDE_S - 2.0 * 0.25; 2]);
}

/// The right foot only touches the ground while the left one carries the body.
#[test]
fn a_foot_within_the_stance_of_the_other_one_leads_to_no_flight_and_no_negative_support() {
    let [mut left, mut right] = walk(10.0, 10, 0);
    left.iter_mut().for_each(|step| step.duration_s = 0.95);
    right.iter_mut().for_each(|step| step.duration_s = 0.2);
    let gait = Gait::new([left, right], true);
    // Each stride of 1.1 s ends with 0.15 s in which neither foot is on the ground.
    assert_means(&gait, "flight_s", [0.15; 2]);
    assert_means(&gait, "double_support_s", [0.2; 2]);
    assert_means(&gait, "single_support_s", [0.75, 0.0]);
}

/// The left foot lands up to 4 ms before or after the right one.
#[test]
fn jumps_on_both_feet_are_no_strides() {
    let [left, _] = walk(10.0, 20, 0);
    let mut right = left.clone();
    right
        .iter_mut()
        .zip([0.004, -0.003, -0.004, 0.002].into_iter().cycle())
        .for_each(|(step, lag_s)| step.start_s += lag_s);
    let gait = Gait::new([left, right], true);
    assert!(gait.feet.iter().all(|foot| (foot.strides.len(), foot.gaps, foot.unpaired) == (0, 0, 19)));
    assert_eq!(gait.cadence_per_min, None);
}

/// Only the left insole measures in the first part of the walk, and only the right one in the last part.
#[test]
fn two_walks_of_one_foot_each_have_no_common_walking_time() {
    let [left, _] = walk(10.0, 8, 0);
    let [_, right] = walk(70.0, 8, 0);
    assert_eq!(Gait::new([left, right], true).walking_s, None);
    assert!(Gait::new(walk(10.0, 8, 0), true).walking_s.is_some());
}

/// The strides of a slow walker are not cut off at the limit for others, which would shorten their mean.
#[test]
fn a_slow_walk_has_the_mean_of_all_its_strides() {
    const MEAN_S: f64 = 2.6;
    // The stride times alternate between 2.4 and 2.8 s.
    let start_s = |i: u32| MEAN_S * f64::from(i) + if i % 2 == 1 { -0.2 } else { 0.0 };
    let step = |i: u32, lag_s: f64| FootStep {
        number: i,
        start_s: start_s(i) + lag_s,
        duration_s: 1.6,
        peak_n: 700.0,
        integral_n_s: 800.0,
    };
    let gait = Gait::new([0.0, 1.3].map(|lag_s| (0..21).map(|i| step(i, lag_s)).collect()), true);
    assert!(gait.feet.iter().all(|foot| (foot.strides.len(), foot.gaps) == (20, 0)));
    assert_means(&gait, "stride_time_s", [MEAN_S; 2]);
}

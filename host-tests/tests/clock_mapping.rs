//! The conversion of insoles' times to the host's time, tested with known clocks.

use client::ClockMapping;
use fastrand::Rng;

/// The true clock of an insole, and the delay of the link to the insole.
struct Clock {
    /// The insole's time at the host's time 0, us.
    start_us: f64,
    /// Rate of the insole's clock relative to the host's clock, minus 1.
    drift: f64,
    /// Interval of the link's connection events, us. A request waits for the next event, or for a later one if events are lost.
    interval_us: f64,
}

impl Clock {
    /// The insole's time at this time of the host, us.
    fn at(&self, host_us: f64) -> f64 {
        self.start_us + (1.0 + self.drift) * host_us
    }
}

/// The host's time at the beginning, us since 1970: 2025-01-01.
const EPOCH_US: u64 = 1_735_689_600_000_000;

/// The times differ by less than 5 ms from 5 s on, and by less than 2 ms after 40 s.
#[test]
fn two_insoles_share_one_time_axis_within_2_ms() {
    // Largest differences between the two insoles' times, from 5 s to 40 s and afterwards, when the drift is known.
    let (mut early_us, mut late_us) = (0.0f64, 0.0f64);
    for seed in 0..40 {
        let mut random = Rng::with_seed(seed);
        let clocks =
            [(30e-6, 2e6), (-40e-6, 500e6)].map(|(drift, start_us)| Clock { start_us, drift, interval_us: 15e3 });
        let mut mappings = [ClockMapping::new(), ClockMapping::new()];
        // Ten minutes with four requests a second.
        for request in 0..2400 {
            let host_us = f64::from(request) * 250e3 + 20e3 * random.f64();
            for (mapping, clock) in mappings.iter_mut().zip(&clocks) {
                let missed = if random.f64() < 0.1 { (10.0 * random.f64()).ceil() } else { 0.0 };
                let delay_us = 400.0 + clock.interval_us * (random.f64() + missed);
                mapping.answer(EPOCH_US + host_us as u64, clock.at(host_us + delay_us) as u64);
            }
            // Both insoles' times of the same moment are converted to the host's time.
            let [left_us, right_us] = [0, 1].map(|i| {
                let found_us = mappings[i].host_us(clocks[i].at(host_us) as u64).expect("the mapping has an answer");
                found_us as f64 - EPOCH_US as f64
            });
            let apart_us = (left_us - right_us).abs();
            match host_us {
                ..5e6 => {}
                ..40e6 => early_us = early_us.max(apart_us),
                _ => {
                    late_us = late_us.max(apart_us);
                    // The converted time is also near the true one: it is wrong only by the shortest delay of a request.
                    assert!((left_us - host_us).abs() < 2000.0, "{left_us} {host_us}");
                }
            }
        }
    }
    println!("largest difference: {early_us:.0} us from 5 s to 40 s, {late_us:.0} us after 40 s");
    assert!(early_us < 5000.0, "{early_us}");
    assert!(late_us < 2000.0, "{late_us}");
}

#[test]
fn times_are_converted_in_both_directions() {
    let mut mapping = ClockMapping::new();
    assert_eq!(mapping.host_us(5), None);
    assert_eq!(mapping.device_us(5), None);
    for second in 0..100u64 {
        let host_us = EPOCH_US + second * 1_000_000;
        // The insole's clock is 50 ppm fast, and the link has no delay.
        mapping.answer(host_us, 7_000_000 + second * 1_000_050);
    }
    for second in [0u64, 50, 130] {
        let (host_us, device_us) = (EPOCH_US + second * 1_000_000, 7_000_000 + second * 1_000_050);
        assert!(mapping.host_us(device_us).expect("the mapping has answers").abs_diff(host_us) <= 1);
        assert!(mapping.device_us(host_us).expect("the mapping has answers").abs_diff(device_us) <= 1);
    }
}

/// The steps of a walk without the host arrive when it connects, hours later. The clocks agree, and requests are delayed by up to
/// 30 ms, so the drift that the first seconds seem to show is an error of the delays.
#[test]
fn a_drift_estimated_over_seconds_is_not_extrapolated_over_hours() {
    for seed in 0..40 {
        let mut random = Rng::with_seed(seed);
        let clock = Clock { start_us: 20e9, drift: 0.0, interval_us: 30e3 };
        let mut mapping = ClockMapping::new();
        for request in 0..120 {
            let host_us = f64::from(request) * 250e3;
            let arrived_us = clock.at(host_us + clock.interval_us * random.f64());
            mapping.answer(EPOCH_US + host_us as u64, arrived_us as u64);
            let walk_us = mapping.host_us(2_000_000_000).expect("the mapping has answers");
            let late_us = walk_us as f64 - (EPOCH_US as f64 - 18e9);
            assert!(late_us.abs() < 40e3, "seed {seed}, request {request}: {late_us} us");
        }
    }
}

/// The clocks of two insoles drift apart by up to 100 ppm, 10 ms in 100 s.
#[test]
fn times_more_than_100_s_from_the_answers_are_not_comparable() {
    let mut mapping = ClockMapping::new();
    assert!(!mapping.is_comparable(1_000_000_000));
    for second in 1000..1030u64 {
        mapping.answer(EPOCH_US + second * 1_000_000, second * 1_000_000);
    }
    for (second, is_comparable) in [(0, false), (899, false), (901, true), (1015, true), (1124, true), (1130, false)] {
        assert_eq!(mapping.is_comparable(second * 1_000_000), is_comparable, "{second} s");
    }
}

/// The host's clock is set after five minutes.
#[test]
fn a_clock_that_is_set_is_followed_within_35_s() {
    for step_us in [-2e6, 2e6, -300e3, -80e3, -50e3] {
        let mut mapping = ClockMapping::new();
        for request in 0..1400u32 {
            let passed_us = f64::from(request) * 250e3;
            let host_us = EPOCH_US as f64 + passed_us + if request < 1200 { 0.0 } else { step_us };
            let device_us = 1_000_000_000 + passed_us as u64;
            mapping.answer(host_us as u64, device_us);
            let wrong_us = mapping.host_us(device_us).expect("the mapping has an answer") as f64 - host_us;
            assert!((1200..1340).contains(&request) || wrong_us.abs() < 1e3, "{step_us} {request}: {wrong_us} us");
        }
    }
}

/// A page in the background sends one request a minute, and each of them arrives 60 ms late.
#[test]
fn late_requests_a_minute_apart_do_not_count_as_a_clock_that_was_set() {
    let mut mapping = ClockMapping::new();
    for request in 0..1200u64 {
        mapping.answer(EPOCH_US + request * 250_000, 1_000_000_000 + request * 250_000);
    }
    for minute in 6..9u64 {
        let passed_us = minute * 60_000_000;
        mapping.answer(EPOCH_US + passed_us, 1_000_060_000 + passed_us);
        let found_us = mapping.host_us(1_000_000_000 + passed_us).expect("the mapping has answers");
        assert!(found_us.abs_diff(EPOCH_US + passed_us) < 1000, "minute {minute}: {found_us}");
    }
}

/// The clock of an insole without a crystal, 500 ppm fast or slow; and a correct clock of which the first answer is wrong by
/// 0.8 s, because the host's clock was changed between the request and its answer.
#[test]
fn after_a_slope_that_no_drift_explains_times_are_wrong_for_35_s_at_most() {
    for (drift, first_offset_us) in [(500e-6, 0), (-500e-6, 0), (0.0, -800_000)] {
        let mut mapping = ClockMapping::new();
        for request in 0..1200u32 {
            let host_us = f64::from(request) * 250e3;
            let arrived_us = 1e9 + (1.0 + drift) * host_us;
            let changed_us = if request == 0 { first_offset_us } else { 0 };
            mapping.answer(EPOCH_US + host_us as u64, (arrived_us as u64).wrapping_add_signed(changed_us));
            let found_us = mapping.host_us(arrived_us as u64).expect("the mapping has answers");
            let wrong_us = found_us as f64 - (EPOCH_US as f64 + host_us);
            assert!(request < 140 || wrong_us.abs() < 20e3, "{drift} {first_offset_us} {request}: {wrong_us} us");
        }
    }
}

#[test]
fn a_restart_of_the_insole_resets_the_mapping() {
    let mut mapping = ClockMapping::new();
    for second in 0..100u64 {
        mapping.answer(EPOCH_US + second * 1_000_000, 500_000_000 + second * 1_000_000);
    }
    let restart_us = EPOCH_US + 100_000_000;
    mapping.answer(restart_us, 30_000);
    assert_eq!(mapping.host_us(40_000), Some(restart_us + 10_000));
}

//! The detection of stances in sequences of total force, and the quantities of a step. Those of a region are compared with a
//! direct transcription of the paper's method in f64.

use plantar::Real;
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::curves::STANCE_SAMPLES;
use plantar::pipeline::measures::{Extent, FootMeasures};
use plantar::pipeline::model::ForceLaw;
use plantar::pipeline::region::{AreaMoments, ForceMoments, RegionFrame};
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance::{BRIDGED_FRAMES, Stance};
use plantar::pipeline::stance_rule::{Rejected, StanceLimits, StanceRule};
use plantar::pipeline::step::RegionStep;
use plantar::protocol::Step;
use proptest::prelude::*;
use recording::VirtualInsole;
use recording::synthetic::{self, SyntheticWalk};
use rstest::rstest;
use std::f64::consts::PI;
use testkit::{TISSUE, area_moments};

fn config() -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::default() }
}

/// Time between frames, us.
const PERIOD_US: u32 = 10_000;

/// The values of a region in a frame with this contact area and this force.
fn frame<R: Real>(area_mm2: f32, force_n: f64) -> RegionFrame<R> {
    let force = ForceMoments { force_n: R::of(force_n), ..ForceMoments::NONE };
    RegionFrame { area: area_moments(area_mm2).area(), force, ..RegionFrame::NONE }
}

/// Passes a frame in which only the heel is loaded to `stance`. Returns true if a step is complete.
fn push<R: Real>(stance: &mut Stance<R>, limits: &StanceLimits<R>, seq: u32, heel: &RegionFrame<R>) -> bool {
    let none = RegionFrame::NONE;
    stance.push(limits, seq, &[heel, &none, &none, &none, &none, &none, &none, &none], (R::ZERO, R::ZERO))
}

/// A part of a sequence of frames.
#[derive(Clone, Copy)]
enum Part {
    /// Number of frames, and their total force in N.
    Frames(u32, f64),
    /// Number of missing frames.
    Missing(u32),
}
use Part::{Frames, Missing};

/// A swing phase.
const OFF: Part = Frames(10, 0.0);

/// A detected step: number of its first frame, number of frames from heel strike to toe off, and number of bridged frames.
type Found = (u32, u32, u32);

/// The steps that are detected in a sequence, which begins with the frame number `first_seq`, by the rule with fixed thresholds.
fn steps_of(sequence: &[Part], first_seq: u32) -> (Vec<Found>, Stance<f64>) {
    steps_by(&StanceRule::ABSOLUTE, sequence, first_seq)
}

/// The steps that are detected in a sequence, which begins with the frame number `first_seq`, by this rule.
fn steps_by(rule: &StanceRule, sequence: &[Part], first_seq: u32) -> (Vec<Found>, Stance<f64>) {
    let limits = StanceLimits::new(rule, PERIOD_US);
    let mut stance = Stance::new();
    let mut steps = Vec::new();
    let mut seq = first_seq;
    for part in sequence {
        match *part {
            Missing(count) => seq = seq.wrapping_add(count),
            Frames(count, force_n) => {
                for _ in 0..count {
                    if push(&mut stance, &limits, seq, &frame(100.0, force_n)) {
                        steps.push((stance.start_seq().wrapping_sub(first_seq), stance.frames(), stance.bridged()));
                    }
                    seq = seq.wrapping_add(1);
                }
            }
        }
    }
    (steps, stance)
}

#[test]
fn steps_are_detected_in_sequences_of_force() {
    let none = Rejected::default();
    let short = Rejected { short: 1, ..none };
    let long = Rejected { long: 1, ..none };
    let broken = Rejected { broken: 1, ..none };
    // Name, sequence, expected steps, and expected rejections. The thresholds are 30 N for heel strike and 20 N for toe off.
    let sequences: &[(&str, &[Part], &[Found], Rejected)] = &[
        ("clean step", &[OFF, Frames(60, 500.0), OFF], &[(10, 60, 0)], none),
        ("two steps", &[OFF, Frames(60, 500.0), OFF, Frames(50, 400.0), OFF], &[(10, 60, 0), (80, 50, 0)], none),
        ("below heel strike", &[OFF, Frames(60, 29.9), OFF], &[], none),
        ("exactly heel strike", &[OFF, Frames(60, 30.0), OFF], &[(10, 60, 0)], none),
        ("fading to exactly toe off", &[OFF, Frames(20, 30.0), Frames(20, 20.0), OFF], &[(10, 40, 0)], none),
        ("fading to just below toe off", &[OFF, Frames(20, 30.0), Frames(20, 19.9), OFF], &[(10, 20, 0)], none),
        ("short peak", &[OFF, Frames(8, 500.0), OFF], &[], short),
        ("shortest step", &[OFF, Frames(9, 500.0), OFF], &[(10, 9, 0)], none),
        ("longest step", &[OFF, Frames(250, 500.0), OFF], &[(10, 250, 0)], none),
        ("standing", &[OFF, Frames(251, 500.0), OFF], &[], long),
        ("standing, then a step", &[OFF, Frames(600, 500.0), OFF, Frames(60, 500.0), OFF], &[(620, 60, 0)], long),
        ("lift of 30 ms", &[OFF, Frames(30, 500.0), Frames(3, 0.0), Frames(30, 500.0), OFF], &[(10, 63, 0)], none),
        (
            "lift of 40 ms",
            &[OFF, Frames(30, 500.0), Frames(4, 0.0), Frames(30, 500.0), OFF],
            &[(10, 30, 0), (44, 30, 0)],
            none,
        ),
        (
            "a gap that is bridged",
            &[OFF, Frames(30, 500.0), Missing(BRIDGED_FRAMES), Frames(30, 500.0), OFF],
            &[(10, 65, 5)],
            none,
        ),
        (
            "two gaps",
            &[OFF, Frames(30, 500.0), Missing(2), Frames(1, 500.0), Missing(3), Frames(30, 500.0), OFF],
            &[(10, 66, 5)],
            none,
        ),
        (
            "a gap that is too long",
            &[OFF, Frames(30, 500.0), Missing(BRIDGED_FRAMES + 1), Frames(30, 500.0), OFF, Frames(60, 500.0), OFF],
            &[(86, 60, 0)],
            broken,
        ),
        ("a gap across toe off", &[OFF, Frames(30, 500.0), Missing(4), OFF], &[(10, 30, 0)], none),
        (
            "a gap after toe off does not belong to the step",
            &[OFF, Frames(30, 500.0), Frames(1, 0.0), Missing(2), OFF],
            &[(10, 30, 0)],
            none,
        ),
        ("a gap in swing", &[OFF, Missing(100), OFF, Frames(60, 500.0), OFF], &[(120, 60, 0)], none),
        ("start while loaded", &[Frames(60, 500.0), OFF, Frames(60, 500.0), OFF], &[(70, 60, 0)], none),
        ("start at rest, barely loaded", &[Frames(30, 25.0), Frames(30, 500.0), OFF], &[], none),
        ("end of the recording", &[OFF, Frames(60, 500.0)], &[], none),
        ("end of the recording before toe off is confirmed", &[OFF, Frames(60, 500.0), Frames(3, 0.0)], &[], none),
        (
            "end of the recording after toe off is confirmed",
            &[OFF, Frames(60, 500.0), Frames(4, 0.0)],
            &[(10, 60, 0)],
            none,
        ),
    ];
    for (name, sequence, expected, rejected) in sequences {
        // With the second value, the frame number wraps during all but the shortest sequences.
        for first_seq in [0, u32::MAX - 30] {
            let (steps, stance) = steps_of(sequence, first_seq);
            assert_eq!(steps, *expected, "{name}, from {first_seq}");
            assert_eq!(stance.rejected(), *rejected, "{name}, from {first_seq}");
        }
    }
}

/// The heel strike is in one of the missing frames, so that its time is unknown.
#[test]
fn a_heel_strike_in_a_long_gap_starts_no_step() {
    let (steps, _) = steps_of(&[OFF, Missing(40), Frames(30, 500.0), OFF, Frames(60, 500.0), OFF], 0);
    assert_eq!(steps, [(90, 60, 0)]);
}

/// The first force after the missing frames is between the thresholds: 35 N for heel strike and 70 N for toe off.
#[test]
fn a_heel_strike_in_a_long_gap_starts_no_step_if_the_threshold_of_toe_off_is_the_higher_one() {
    let sequence = [OFF, Missing(40), Frames(2, 50.0), Frames(30, 500.0), OFF, Frames(60, 500.0), OFF];
    let (steps, stance) = steps_by(&StanceRule::ADAPTIVE, &sequence, 0);
    assert_eq!(steps, [(92, 60, 0)]);
    assert_eq!(stance.rejected(), Rejected { broken: 1, ..Rejected::default() });
}

/// The force falls below the threshold of heel strike again just after it has reached it, and fades after toe off between the
/// thresholds: 35 N for heel strike and 70 N for toe off.
#[test]
fn a_fading_force_is_no_heel_strike_although_the_stance_began_with_a_dip() {
    let sequence = [OFF, Frames(1, 40.0), Frames(1, 30.0), Frames(49, 700.0), Frames(11, 50.0), Frames(20, 0.0)];
    let (steps, stance) = steps_by(&StanceRule::ADAPTIVE, &sequence, 0);
    assert_eq!(steps, [(10, 51, 0)]);
    assert_eq!(stance.rejected(), Rejected::default());
}

#[test]
fn the_foot_is_on_the_ground_from_heel_strike_to_confirmed_toe_off() {
    let on_ground = |sequence: &[Part]| steps_of(sequence, 0).1.on_ground();
    assert!(!on_ground(&[OFF]));
    assert!(on_ground(&[OFF, Frames(1, 500.0)]));
    assert!(on_ground(&[OFF, Frames(60, 500.0), Frames(3, 0.0)]));
    assert!(!on_ground(&[OFF, Frames(60, 500.0), Frames(4, 0.0)]));
    assert!(on_ground(&[OFF, Frames(600, 500.0)]));
    assert!(on_ground(&[Frames(5, 500.0)]));
}

/// Returns true if a contact with 30 N counts as a step after these contacts: numbers of contacts, and their force, N. It does
/// if the usual peak is below 300 N, because the threshold of toe off, 10 % of that peak, is then below 30 N.
fn adapts_to(contacts: &[(usize, f64)]) -> bool {
    let limits = StanceLimits::new(&StanceRule::ADAPTIVE, PERIOD_US);
    let (mut stance, mut seq) = (Stance::<f64>::new(), 0);
    let mut contact = |force_n: f64| {
        let mut is_step = false;
        for force_n in [0.0; 10].into_iter().chain([force_n; 30]).chain([0.0; 10]) {
            is_step |= push(&mut stance, &limits, seq, &frame(100.0, force_n));
            seq += 1;
        }
        is_step
    };
    for &(times, force_n) in contacts {
        assert!((0..times).all(|_| contact(force_n)), "{force_n} N in {contacts:?}");
    }
    contact(30.0)
}

/// After steps with 700 N, contacts with 140 N are presses of a seated foot or, if there are many of them, the steps of a person
/// who has begun to unload this foot.
#[test]
fn only_many_weak_contacts_lower_the_thresholds() {
    assert!(!adapts_to(&[(10, 700.0), (8, 140.0)]));
    assert!(adapts_to(&[(10, 700.0), (40, 140.0)]));
}

/// A child with steps of 150 N hops on one foot, or stamps into the shoe.
#[test]
fn the_thresholds_soon_fit_ordinary_steps_after_larger_peaks() {
    assert!(adapts_to(&[(10, 150.0), (5, 450.0), (3, 150.0)]));
    assert!(adapts_to(&[(1, 400.0), (6, 150.0)]));
}

#[test]
fn missing_frames_are_interpolated_linearly() {
    let limits = StanceLimits::new(&StanceRule::ADAPTIVE, PERIOD_US);
    let mut stance = Stance::<f64>::new();
    push(&mut stance, &limits, 0, &frame(0.0, 0.0));
    for seq in (1..=10).chain([15]).chain(16..=40) {
        let loaded = if seq <= 10 { frame(100.0, 200.0) } else { frame(200.0, 450.0) };
        push(&mut stance, &limits, seq, &loaded);
    }
    let ended = (41..46).any(|seq| push(&mut stance, &limits, seq, &frame(0.0, 0.0)));
    assert!(ended);
    let (area_mm2, force_n) = (stance.curves().area_mm2(0), stance.curves().force_n(0));
    assert_eq!((area_mm2.len(), force_n.len(), stance.bridged()), (40, 40, 4));
    for (i, (got_mm2, got_n)) in area_mm2.iter().zip(force_n).enumerate() {
        let part = ((i as f64 - 9.0) / 5.0).clamp(0.0, 1.0);
        assert!((got_mm2 - (100.0 + 100.0 * part)).abs() < 1e-9, "sample {i}: {got_mm2}");
        assert!((got_n - (200.0 + 250.0 * part)).abs() < 1e-9, "sample {i}: {got_n}");
    }
}

#[test]
fn peak_and_saturation_belong_to_their_stance_and_region() {
    let limits = StanceLimits::new(&StanceRule::ADAPTIVE, PERIOD_US);
    let mut stance = Stance::<f64>::new();
    for step in 0..2 {
        let (start, mut at_peak) = (step * 100, None);
        for i in 0..70 {
            let loaded = (10..50).contains(&i);
            let toe = frame(10.0 + i as f32, if loaded { 300.0 - f64::from(i - 30).abs() } else { 0.0 });
            let saturated = RegionFrame { saturated: step == 0 && i == 20, ..toe };
            let none = RegionFrame::NONE;
            let regions = [&none, &none, &none, &none, &none, &saturated, &none, &none];
            let is_toe_off = stance.push(&limits, (start + i) as u32, &regions, (0.0, 0.0));
            assert_eq!(stance.at_peak() & !(1 << 5), 0, "the other regions have no force");
            at_peak = if stance.at_peak() != 0 { Some(i) } else { at_peak };
            if is_toe_off {
                assert_eq!(stance.saturated(), if step == 0 { 1 << 5 } else { 0 });
                assert_eq!(at_peak, Some(30), "this frame has the largest force of the stance");
                assert_eq!([5, 0].map(|region| stance.region_peak_n(region)), [300.0, 0.0]);
            }
        }
    }
    assert_eq!((stance.start_seq(), stance.frames()), (110, 40));
}

#[test]
fn a_long_stance_stores_every_second_fourth_or_eighth_frame() {
    let rule = StanceRule { max_stance_ms: u16::MAX, ..StanceRule::ADAPTIVE };
    let limits = StanceLimits::new(&rule, 2_500);
    for (frames, stride) in [(255, 1), (256, 1), (257, 2), (511, 2), (512, 2), (513, 4), (1024, 4), (1025, 8)] {
        let mut stance = Stance::<f64>::new();
        push(&mut stance, &limits, 0, &frame(0.0, 0.0));
        let force_n = |i: u32| 100.0 + f64::from(i);
        for i in 0..frames {
            assert!(!push(&mut stance, &limits, 1 + i, &frame(50.0, force_n(i))));
        }
        let ended = (0..20).position(|i| push(&mut stance, &limits, 1 + frames + i, &frame(0.0, 0.0)));
        assert_eq!(ended, Some(19), "toe off must be confirmed after 50 ms, 20 frames at 400 Hz");
        let (area_mm2, stored_n) = (stance.curves().area_mm2(0), stance.curves().force_n(0));
        assert_eq!(stance.frames(), frames);
        assert!(stored_n.len() <= STANCE_SAMPLES && area_mm2.len() == stored_n.len());
        // The frames between toe off and its confirmation may have doubled the stride once more.
        assert!(
            stance.curves().stride() == stride || stance.curves().stride() == 2 * stride,
            "{frames}: {}",
            stance.curves().stride()
        );
        let expected: Vec<_> = (0..frames).step_by(stance.curves().stride() as usize).map(force_n).collect();
        assert_eq!(stored_n, expected, "{frames} frames");
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn a_step_agrees_with_the_equations(
        count in 1usize..=STANCE_SAMPLES,
        (before, after) in (0usize..20, 0usize..20),
        peak_mm2 in 200.0..5000.0f64,
        skew in 0.3..2.0f64,
        peak_n in 50.0..900.0f64,
        ln_stiffness in 11.0..15.0f64,
        rate_hz in 50.0..400.0f64,
    ) {
        let law = ForceLaw { stiffness_pa: f64::from(ln_stiffness.exp() as f32), ..ForceLaw::<f64>::of(&TISSUE.force_laws[0]) };
        let bell = |i: usize, skew: f64| (PI * ((i as f64 + 0.5) / count as f64).powf(skew)).sin();
        let count_before = before.min(STANCE_SAMPLES - count);
        let count_after = after.min(STANCE_SAMPLES - count - count_before);
        let mut area_mm2 = vec![0.0; count_before];
        area_mm2.extend((0..count).map(|i| f64::from((peak_mm2 * bell(i, skew)) as f32)));
        area_mm2.resize(area_mm2.len() + count_after, 0.0);
        // The force can begin before the contact and end after it. Its peak can be at another time than that of the contact area.
        let force_n: Vec<_> = (0..area_mm2.len())
            .map(|i| f64::from((peak_n * (PI * (i as f64 + 0.5) / area_mm2.len() as f64).sin()) as f32))
            .collect();
        let sample_s = f64::from((1.0 / rate_hz) as f32);

        let truth = transcription(&law, &area_mm2, &force_n, sample_s);
        let double = RegionStep::new(&law, &area_mm2, &force_n, sample_s, &area_moments(100.0));
        compare(&double, &truth, 1e-8)?;
        prop_assert!(double.ellipse_at_peak.is_some());

        let single_of = |samples: &[f64]| samples.iter().map(|&v| v as f32).collect::<Vec<f32>>();
        let single_law = ForceLaw::<f32> { stiffness_pa: law.stiffness_pa as f32, ..TISSUE.force_laws[0] };
        let single = RegionStep::new(
            &single_law, &single_of(&area_mm2), &single_of(&force_n), sample_s as f32, &area_moments(100.0),
        );
        compare(&single, &truth, 2e-3)?;
    }
}

/// The expected values of a [`RegionStep`].
#[derive(Debug, Default)]
struct Truth {
    measured_peak_n: f64,
    model_peak_n: f64,
    measured_integral_n_s: f64,
    model_integral_n_s: f64,
    area_peak_mm2: f64,
    deformation_peak_m: f64,
    deformation_rate_peak_m_s: f64,
    contact_s: f64,
    time_to_peak_s: f64,
    model_error: f64,
    clamped: bool,
}

/// Eq. 14 and 20 of the paper, and Eq. 13 in the form of the identifiable force law, in which a tension counts as 0. The rate is
/// the difference of the normalised deformation g over 20 ms.
fn transcription(law: &ForceLaw<f64>, area_mm2: &[f64], force_n: &[f64], sample_s: f64) -> Truth {
    let contact: Vec<usize> = (0..area_mm2.len()).filter(|&i| area_mm2[i] > 0.0).collect();
    let (first, last) = (contact[0], contact[contact.len() - 1]);
    let (raw_mm2, measured_n) = (&area_mm2[first..=last], &force_n[first..=last]);
    let count = raw_mm2.len();
    let ratio: Vec<f64> = raw_mm2.iter().map(|a| a * 1e-6 / (PI * law.ab_m2)).collect();
    let g: Vec<f64> = ratio.iter().map(|a| 1.0 - (1.0 - a.clamp(0.0, 1.0)).sqrt()).collect();
    let whole_us = (sample_s * 1e6).round();
    let samples_in_10_ms = ((10_000.0 / whole_us).round() as usize).max(1);
    let rate_per_s = |i: usize| {
        let window: Vec<f64> = (0..count).filter(|j| j.abs_diff(i) <= samples_in_10_ms).map(|j| g[j]).collect();
        if count > 1 { (window[window.len() - 1] - window[0]) / ((window.len() - 1) as f64 * sample_s) } else { 0.0 }
    };
    let model_n = |i: usize| {
        let g = g[i];
        if g <= 0.0 {
            return 0.0;
        }
        let elastic = law.stiffness_pa * g.powf(law.n + 2.0) * (1.0 - g / 3.0);
        let shape = (6.0 - 4.0 * g + g * g) / (3.0 * (2.0 - g));
        let viscous = law.damping_pa_s * g.powf(law.m + 1.0) * rate_per_s(i) * shape;
        (PI * law.ab_m2 * (elastic + viscous)).max(0.0)
    };
    let model_n: Vec<f64> = (0..count).map(model_n).collect();
    let peak = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    let measured_peak_n = peak(measured_n);
    let peak_at = measured_n.iter().position(|&f| f == measured_peak_n).unwrap_or(0);
    let squares: f64 = model_n.iter().zip(measured_n).map(|(a, b)| (a - b).powi(2)).sum();
    Truth {
        measured_peak_n,
        model_peak_n: peak(&model_n),
        measured_integral_n_s: force_n.iter().sum::<f64>() * sample_s,
        model_integral_n_s: model_n.iter().sum::<f64>() * sample_s,
        area_peak_mm2: peak(raw_mm2),
        deformation_peak_m: law.c_m * peak(&g),
        deformation_rate_peak_m_s: law.c_m * (0..count).map(rate_per_s).fold(0.0, f64::max),
        contact_s: count as f64 * sample_s,
        time_to_peak_s: peak_at as f64 * sample_s,
        model_error: (squares / count as f64).sqrt() / measured_peak_n,
        clamped: ratio.iter().any(|&a| a >= 1.0),
    }
}

/// Compares a step with the expected values. The tolerance is relative; for forces and rates it is relative to their peaks.
fn compare<R: Real>(got: &RegionStep<R>, want: &Truth, tolerance: f64) -> Result<(), TestCaseError> {
    for (name, got, want) in [
        ("measured peak", got.measured_peak_n, want.measured_peak_n),
        ("model peak", got.model_peak_n, want.model_peak_n),
        ("measured integral", got.measured_integral_n_s, want.measured_integral_n_s),
        ("model integral", got.model_integral_n_s, want.model_integral_n_s),
        ("area peak", got.area_peak_mm2, want.area_peak_mm2),
        ("deformation peak", got.deformation_peak_m, want.deformation_peak_m),
        ("contact time", got.contact_s, want.contact_s),
        ("time to peak", got.time_to_peak_s, want.time_to_peak_s),
    ] {
        let got = got.to_f64();
        prop_assert!((got - want).abs() <= tolerance * want.abs().max(1e-9), "{name}: {got} is not {want}");
    }
    // The model error is a difference of forces relative to the measured peak, and so its tolerance is that of the forces.
    let margin = tolerance * want.model_error.max(want.model_peak_n / want.measured_peak_n);
    let (got_error, want_error) = (got.model_error.to_f64(), want.model_error);
    prop_assert!((got_error - want_error).abs() <= margin, "model error: {got_error} is not {want_error}");
    let (got_m_s, want_m_s) = (got.deformation_rate_peak_m_s.to_f64(), want.deformation_rate_peak_m_s);
    // The rate is a difference of the deformation between samples, and so its tolerance depends on that of the deformation.
    let most_samples_per_s = want.contact_s.recip() * STANCE_SAMPLES as f64;
    let margin_m_s = tolerance * (want_m_s + 1e-2 * want.deformation_peak_m * most_samples_per_s);
    prop_assert!((got_m_s - want_m_s).abs() <= margin_m_s, "rate peak: {got_m_s} is not {want_m_s}");
    prop_assert_eq!(got.clamped, want.clamped);
    Ok(())
}

#[test]
fn a_step_agrees_with_values_computed_by_hand() {
    // Four frames of contact.
    let law = ForceLaw { ab_m2: 1e-3, c_m: 0.01, stiffness_pa: 0.0, damping_pa_s: 0.0, n: 1.0, m: 1.0 };
    let area_mm2 = [0.0, 100.0, 200.0, 200.0, 100.0, 0.0];
    let force_n = [5.0, 10.0, 40.0, 20.0, 10.0, 5.0];
    let step = RegionStep::<f64>::new(&law, &area_mm2, &force_n, 0.02, &AreaMoments::NONE);
    let near = |got: f64, want: f64| (got - want).abs() < 1e-12;
    assert!(near(step.measured_peak_n, 40.0) && near(step.area_peak_mm2, 200.0), "{step:?}");
    assert!(near(step.contact_s, 0.08) && near(step.time_to_peak_s, 0.02), "{step:?}");
    assert!(near(step.measured_integral_n_s, 90.0 * 0.02), "{step:?}");
    // A model without stiffness has no force. Its error is the root mean square of the measured force, relative to the peak.
    assert!(near(step.model_peak_n, 0.0) && near(step.model_integral_n_s, 0.0), "{step:?}");
    assert!(near(step.model_error, (2200.0f64 / 4.0).sqrt() / 40.0), "{step:?}");
    assert_eq!(step.ellipse_at_peak, None);
}

#[test]
fn a_region_without_contact_has_only_a_force_integral() {
    let law = ForceLaw::<f64>::of(&TISSUE.force_laws[0]);
    let none = RegionStep::<f64>::default();
    let mut loaded = RegionStep::new(&law, &[0.0; 30], &[9.0; 30], 0.01, &area_moments(10.0));
    assert!((loaded.measured_integral_n_s - 2.7).abs() < 1e-12);
    loaded.measured_integral_n_s = 0.0;
    assert_eq!(loaded, none);
    assert_eq!(RegionStep::new(&law, &[], &[], 0.01, &area_moments(10.0)), none);
}

/// The path of the centre of pressure excludes both ends of stance, also if these are all samples of the step.
#[test]
fn the_path_of_a_step_of_two_samples_is_a_line_from_10_to_90_percent() {
    let limits = StanceLimits::<f64>::new(&StanceRule { min_stance_ms: 0, ..StanceRule::ABSOLUTE }, PERIOD_US);
    let (mut stance, loaded, none) = (Stance::new(), frame(100.0, 600.0), RegionFrame::NONE);
    let centre_mm = |seq: u32| if seq < 2 { (40.0, 50.0) } else { (60.0, 200.0) };
    let is_step = (0..10).any(|seq| {
        let heel = if (1..3).contains(&seq) { &loaded } else { &none };
        stance.push(&limits, seq, &[heel, &none, &none, &none, &none, &none, &none, &none], centre_mm(seq))
    });
    assert!(is_step && stance.curves().samples() == 2);
    let foot = FootMeasures::new(stance.curves(), 0.01, &Extent::default());
    let length_mm = 0.8 * 20f64.hypot(150.0);
    assert!((foot.gait_length_mm - length_mm).abs() < 1e-9, "{}", foot.gait_length_mm);
    assert!((foot.gait_width_mm - 0.8 * 20.0).abs() < 1e-9, "{}", foot.gait_width_mm);
    assert!((foot.gait_velocity_mm_s - length_mm / 0.008).abs() < 1e-6, "{}", foot.gait_velocity_mm_s);
}

/// The same contact area and force of one region are sampled at four frame rates.
#[test]
fn frame_rate_does_not_change_the_step() {
    let stance_s = 0.68;
    let area_mm2 = |t: f64| 1800.0 * (PI * t / stance_s).sin().powf(0.7);
    let force_n = |t: f64| 600.0 * (PI * t / stance_s).sin() * (1.0 + 0.3 * (3.0 * PI * t / stance_s).sin());
    let law = ForceLaw::<f32> { stiffness_pa: 1.5e6, ..TISSUE.force_laws[0] };
    let step_at = |rate_hz: u32| {
        let period_us = 1_000_000 / rate_hz;
        let limits = StanceLimits::<f32>::new(&StanceRule::ADAPTIVE, period_us);
        let mut stance = Stance::new();
        let mut ended = false;
        for seq in 0..rate_hz {
            let t = (f64::from(seq) - 0.1 * f64::from(rate_hz)) / f64::from(rate_hz);
            let loaded = t > 0.0 && t < stance_s;
            let heel = if loaded { frame(area_mm2(t) as f32, force_n(t)) } else { RegionFrame::NONE };
            if push(&mut stance, &limits, seq, &heel) {
                ended = true;
                break;
            }
        }
        assert!(ended, "{rate_hz} Hz");
        let (area_mm2, force_n) = (stance.curves().area_mm2(0), stance.curves().force_n(0));
        let sample_s = stance.curves().stride() as f32 * period_us as f32 * 1e-6;
        RegionStep::new(&law, area_mm2, force_n, sample_s, &area_moments(600.0))
    };
    let reference = step_at(400);
    // The true integral and peak of the measured force.
    let samples: Vec<f64> = (0..6800).map(|i| force_n((f64::from(i) + 0.5) * 1e-4)).collect();
    let integral_n_s = samples.iter().sum::<f64>() * 1e-4;
    let peak_n = samples.iter().copied().fold(0.0, f64::max);
    // The time from heel strike to toe off, by the thresholds that apply to the first step of an insole.
    let StanceRule { strike_n, release_n, .. } = StanceRule::ADAPTIVE;
    let strike = samples.iter().position(|&n| n >= strike_n.into()).expect("a heel strike");
    let release = samples.iter().rposition(|&n| n >= release_n.into()).expect("a toe off");
    let stance_s = (release - strike) as f32 * 1e-4;
    for rate_hz in [50, 100, 200, 400] {
        let step = step_at(rate_hz);
        let sample_s = 1.0 / rate_hz as f32;
        let near = |name: &str, got: f32, want: f64, tolerance: f64| {
            let error = (f64::from(got) / want - 1.0).abs();
            assert!(error <= tolerance, "{rate_hz} Hz, {name}: {got}, not {want}");
        };
        near("measured peak", step.measured_peak_n, peak_n, 0.01);
        near("measured integral", step.measured_integral_n_s, integral_n_s, 0.01);
        near("area peak", step.area_peak_mm2, 1800.0, 0.01);
        near("model peak", step.model_peak_n, reference.model_peak_n.into(), 0.03);
        near("model integral", step.model_integral_n_s, reference.model_integral_n_s.into(), 0.03);
        near("deformation peak", step.deformation_peak_m, reference.deformation_peak_m.into(), 0.02);
        // The stance begins and ends at the first sample beyond a force threshold.
        assert!((step.contact_s - stance_s).abs() < 2.0 * sample_s, "{rate_hz} Hz: {}, not {stance_s}", step.contact_s);
        assert!((step.time_to_peak_s - reference.time_to_peak_s).abs() <= 2.0 * sample_s + 0.01, "{rate_hz} Hz");
        assert!((step.model_error - reference.model_error).abs() < 0.02, "{rate_hz} Hz: {}", step.model_error);
    }
}

/// The ellipse of a region is that of its cells in contact. Both contact rules are tested.
#[test]
fn the_ellipse_of_a_step_is_that_of_the_frame_with_the_largest_force() {
    // At 500 Hz, only every second frame is a sample of the curves.
    for (contact, rate_hz) in
        [(ContactRule::COUNTED, 100.0), (ContactRule::COVERED, 100.0), (ContactRule::COVERED, 500.0)]
    {
        let recording = synthetic::walk(&SyntheticWalk { steps: 3, rate_hz, ..SyntheticWalk::default() }).recording;
        let virtual_insole = VirtualInsole::new(&recording, contact, StanceRule::ADAPTIVE);
        let mut insole = Box::new(Insole::<f64, DEVICE_CELLS>::new());
        insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("the insole is valid");
        let mut codes = vec![0; recording.cells()];
        let (mut at_peak, mut was_on_ground, mut steps) = ([(0.0, None); 8], false, 0);
        for frame in 0..virtual_insole.frames(&recording) {
            virtual_insole.codes_of(&recording, frame, &mut codes);
            let is_toe_off = insole.frame(frame as u32, &codes);
            if insole.on_ground() && !was_on_ground {
                at_peak = [(0.0, None); 8];
            }
            was_on_ground = insole.on_ground();
            for (region, (peak_n, ellipse)) in at_peak.iter_mut().enumerate() {
                let force_n = insole.loads()[region].frame.force.force_n;
                if force_n > *peak_n {
                    (*peak_n, *ellipse) = (force_n, insole.ellipse(region));
                }
            }
            if is_toe_off {
                let step = insole.whole_step().expect("a step has ended");
                assert_eq!(step.sample_us > virtual_insole.setup.period_us, rate_hz > 100.0);
                assert_eq!(step.regions.map(|region| region.ellipse_at_peak), at_peak.map(|(_, ellipse)| ellipse));
                assert_eq!(step.regions.map(|region| region.measured_peak_n), at_peak.map(|(peak_n, _)| peak_n));
                steps += 1;
            }
        }
        assert!(steps >= 2 && at_peak.iter().all(|(_, ellipse)| ellipse.is_some()), "{rate_hz} Hz: {steps} steps");
    }
}

#[test]
fn the_end_of_a_recording_confirms_toe_off_once_the_foot_is_off_the_ground() {
    let recording = synthetic::walk(&SyntheticWalk { steps: 1, ..SyntheticWalk::default() }).recording;
    let virtual_insole = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    // The step that is complete after this number of frames, and the one that the end of the recording then completes.
    let steps_after = |frames: usize| {
        let mut insole = Box::new(Insole::<f64, DEVICE_CELLS>::new());
        insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("the insole is valid");
        let mut codes = vec![0; recording.cells()];
        let mut step = None;
        for frame in 0..frames {
            virtual_insole.codes_of(&recording, frame, &mut codes);
            if insole.frame(frame as u32, &codes) {
                step = insole.whole_step().map(|step| Step::new(&step));
            }
        }
        let is_complete = insole.end_stance();
        (step, is_complete.then(|| Step::new(&insole.whole_step().expect("a step has ended"))))
    };
    let (step, at_end) = steps_after(recording.frames());
    let step = step.expect("a step");
    assert_eq!(at_end, None, "the step is complete already");
    let off = ((step.start_us + u64::from(step.duration_us)) / u64::from(virtual_insole.setup.period_us)) as usize;
    assert_eq!(steps_after(off), (None, None), "the foot is on the ground in the last frame");
    assert_eq!(steps_after(off + 1), (None, Some(step)));
}

/// Both contact rules have the same cells in contact, so an insole with covered shares reports the same counted areas as an
/// insole that counts whole cells. Where `alternates` is true, every second cell carries the load in one frame and the others in
/// the next, so cells come into contact and lose it in the same frame.
#[rstest]
#[case(false)]
#[case(true)]
fn the_counted_area_of_a_step_does_not_depend_on_the_contact_rule(#[case] alternates: bool) {
    let walk = SyntheticWalk { steps: 6, variation: 0.1, ..SyntheticWalk::default() };
    let mut recording = synthetic::walk(&walk).recording;
    let cells = recording.cells();
    for (frame, pressures_kpa) in recording.pressure_kpa.chunks_exact_mut(cells).enumerate() {
        pressures_kpa.iter_mut().skip(frame % 2).step_by(2).for_each(|kpa| *kpa *= if alternates { 0.0 } else { 1.0 });
    }
    let steps = |contact| {
        let virtual_insole = VirtualInsole::new(&recording, contact, StanceRule::ADAPTIVE);
        let mut insole = Box::new(Insole::<f64, DEVICE_CELLS>::new());
        insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("the insole is valid");
        let mut codes = vec![0; recording.cells()];
        let frames = 0..virtual_insole.frames(&recording);
        let steps = frames.filter_map(|frame| {
            virtual_insole.codes_of(&recording, frame, &mut codes);
            insole.frame(frame as u32, &codes).then(|| insole.whole_step().expect("a step has ended"))
        });
        steps.collect::<Vec<_>>()
    };
    let (counted, covered) = (steps(ContactRule::COUNTED), steps(ContactRule::COVERED));
    assert_eq!((counted.len(), covered.len()), (6, 6));
    for (counted, covered) in counted.iter().zip(&covered) {
        for (counted, covered) in counted.regions.iter().zip(&covered.regions) {
            assert_eq!(counted.counted_peak_mm2, counted.area_peak_mm2);
            assert_eq!(covered.counted_peak_mm2, counted.counted_peak_mm2);
            assert!(covered.area_peak_mm2 < covered.counted_peak_mm2 || counted.area_peak_mm2 == 0.0);
        }
    }
}

#[test]
fn a_foot_that_touches_the_ground_in_swing_makes_no_step() {
    let swing = Frames(18, 0.0);
    let stride = |scuff_frames, scuff_n| [Frames(64, 700.0), swing, Frames(scuff_frames, scuff_n), swing];
    let count = |frames, force_n| {
        let sequence: Vec<_> =
            [OFF].into_iter().chain((0..10).flat_map(|_| stride(frames, force_n))).chain([OFF]).collect();
        let (found, stance) = steps_by(&StanceRule::ADAPTIVE, &sequence, 0);
        (found.len(), stance.rejected().short)
    };
    // 12 to 25 % of the force of a step, for 0.15 to 0.2 s.
    for (frames, force_n) in [(20, 84.0), (20, 105.0), (20, 175.0), (15, 140.0)] {
        assert_eq!(count(frames, force_n), (10, 10), "{force_n} N in {frames} frames");
    }
    // A step of a person who unloads the foot is weak, but not brief; one of a person who hurries is brief, but not weak.
    assert_eq!(count(40, 105.0), (20, 0));
    assert_eq!(count(15, 400.0), (20, 0));
}

/// The recording of a prosthetic foot, which loads a few cells of the heel and of the forefoot only, with `force_n` in ten
/// stances of 1.1 s. It ends within an eleventh one.
fn prosthesis(force_n: f64) -> recording::Recording {
    let layout = synthetic::insole(144);
    let spots: Vec<_> = [plantar::Region::Heel, plantar::Region::Metatarsals12]
        .into_iter()
        .flat_map(|region| {
            let cells = layout.cells.iter().enumerate().filter(move |(_, cell)| cell.region == region);
            cells.take(8).map(|(index, _)| index).collect::<Vec<_>>()
        })
        .collect();
    let area_mm2: f64 = spots.iter().map(|&index| layout.cells[index].area_mm2).sum();
    let (mut t_s, mut pressure_kpa) = (Vec::new(), Vec::new());
    for frame in 0..1900 {
        // 1.1 s of stance, of which 0.9 s with a constant force, in 1.8 s.
        let in_stance = (frame % 180) as f64 - 50.0;
        let share = (in_stance / 10.0).min((110.0 - in_stance) / 10.0).clamp(0.0, 1.0);
        let mut kpa = vec![0.0; layout.cells.len()];
        spots.iter().for_each(|&index| kpa[index] = (share * force_n * 1e3 / area_mm2) as f32);
        t_s.push(frame as f64 / 100.0);
        pressure_kpa.extend(kpa);
    }
    let source = "computed prosthesis".into();
    recording::Recording { side: plantar::Side::Left, layout, rate_hz: 100.0, source, t_s, pressure_kpa }
}

#[test]
fn a_foot_that_stands_on_few_cells_is_not_taken_for_a_lifted_one() {
    let recording = prosthesis(700.0);
    let virtual_insole = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let mut insole = Box::new(Insole::<f64, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("the insole is valid");
    let mut codes = vec![0; recording.cells()];
    let mut durations_s = Vec::new();
    for frame in 0..virtual_insole.frames(&recording) {
        virtual_insole.codes_of(&recording, frame, &mut codes);
        if insole.frame(frame as u32, &codes) {
            durations_s.push(f64::from(insole.whole_step().expect("a step has ended").duration_us) * 1e-6);
        }
    }
    assert_eq!(durations_s.len(), 10, "{durations_s:?}");
    assert!(durations_s.iter().all(|duration_s| (1.05..=1.1).contains(duration_s)), "{durations_s:?}");
}

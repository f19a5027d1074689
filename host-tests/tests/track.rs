//! Tracking: the stiffness K and the damping G of a force law follow the steps. The reference is the weighted least-squares
//! solution over all samples by NumPy, or the known force law from which the steps were computed.

use crate::common;
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::measures::FootMeasures;
use plantar::pipeline::model::ForceLaw;
use plantar::pipeline::region::AreaMoments;
use plantar::pipeline::step::{REFIT_PER_MDC, RegionStep, STIFFNESS_MDC, StepRecord};
use plantar::pipeline::track::Tracker;
use std::f64::consts::PI;

/// Number of frames of a step.
const SAMPLES: usize = 70;
/// Time between frames, s.
const SAMPLE_S: f64 = 0.01;

/// The identified force law, with which tracking begins.
fn identified() -> ForceLaw<f64> {
    ForceLaw { ab_m2: 1e-3, c_m: 0.012, stiffness_pa: 4e5, damping_pa_s: 1.5e4, n: -0.4, m: 0.8 }
}

/// The contact area in each sample of step number `step`, mm2; successive steps differ.
fn area_mm2(step: usize) -> Vec<f64> {
    let size = 0.8 + 0.02 * (step % 7) as f64;
    (0..SAMPLES).map(|i| PI * 1e3 * size * (PI * ((i as f64 + 0.5) / SAMPLES as f64).powf(0.7)).sin()).collect()
}

/// The force in each sample by a force law, N. The rate of the normalised deformation g is the slope between the samples 10 ms
/// before and after.
fn force_n(law: &ForceLaw<f64>, area_mm2: &[f64]) -> Vec<f64> {
    let g: Vec<f64> = area_mm2.iter().map(|mm2| 1.0 - (1.0 - mm2 * 1e-6 / (PI * law.ab_m2)).sqrt()).collect();
    let rate = |i: usize| {
        let (before, after) = (i.saturating_sub(1), (i + 1).min(g.len() - 1));
        (g[after] - g[before]) / ((after - before) as f64 * SAMPLE_S)
    };
    (0..g.len()).map(|i| law.force_n(g[i], rate(i))).collect()
}

/// Pseudorandom numbers from -0.5 to 0.5 with mean 0, the same in every run.
fn noise(i: usize) -> f64 {
    ((i as f64 * 12.9898).sin() * 43_758.545_3).fract() * 0.5
}

/// The force law after these steps, each with its areas, mm2, and forces, N; and the change of K relative to the identified law
/// that the tracking reported after each step. `is_reliable` states whether the step with this index may be used.
fn tracked<R: plantar::Real>(
    steps: &[(Vec<f64>, Vec<f64>)],
    is_reliable: impl Fn(usize) -> bool,
) -> (ForceLaw<R>, Vec<f64>) {
    tracked_in(steps, is_reliable, 1 << 3)
}

/// As [`tracked`], with the identified regions as bits.
fn tracked_in<R: plantar::Real>(
    steps: &[(Vec<f64>, Vec<f64>)],
    is_reliable: impl Fn(usize) -> bool,
    regions: u8,
) -> (ForceLaw<R>, Vec<f64>) {
    let mut law = ForceLaw::<R>::of(&identified().single());
    let mut laws = [ForceLaw::NONE; 8];
    laws[3] = law;
    let mut tracker = Tracker::OFF;
    tracker.start(&laws, regions);
    let mut changes = Vec::new();
    for (i, (area_mm2, force_n)) in steps.iter().enumerate() {
        let convert = |values: &[f64]| values.iter().map(|&value| R::of(value)).collect::<Vec<R>>();
        let step = RegionStep::new(&law, &convert(area_mm2), &convert(force_n), R::of(SAMPLE_S), &AreaMoments::NONE);
        changes.push(tracker.adapt(3, &mut law, &step, is_reliable(i)).to_f64());
    }
    (law, changes)
}

/// The areas, mm2, and the forces, N, of `count` steps by a force law, with noise of at most `relative_noise` / 2 of the peak
/// force.
fn steps(count: usize, law: &ForceLaw<f64>, relative_noise: f64) -> Vec<(Vec<f64>, Vec<f64>)> {
    (0..count)
        .map(|step| {
            let area = area_mm2(step);
            let mut force = force_n(law, &area);
            let peak_n = force.iter().copied().fold(0.0, f64::max);
            for (i, force) in force.iter_mut().enumerate() {
                *force = (*force + relative_noise * peak_n * noise(step * SAMPLES + i)).max(0.0);
            }
            (area, force)
        })
        .collect()
}

#[test]
fn a_changed_law_is_found_in_single_and_double_precision() {
    let changed = ForceLaw { stiffness_pa: 0.8 * 4e5, damping_pa_s: 1.3 * 1.5e4, ..identified() };
    let walk = steps(30, &changed, 0.0);
    let (double, changes) = tracked::<f64>(&walk, |_| true);
    let (single, _) = tracked::<f32>(&walk, |_| true);
    let laws = [[double.stiffness_pa, double.damping_pa_s], [single.stiffness_pa.into(), single.damping_pa_s.into()]];
    for [stiffness_pa, damping_pa_s] in laws {
        assert!((stiffness_pa / changed.stiffness_pa - 1.0).abs() < 1e-3, "{stiffness_pa}");
        assert!((damping_pa_s / changed.damping_pa_s - 1.0).abs() < 5e-3, "{damping_pa_s}");
    }
    // The first nine steps are only collected. From the tenth step on the law follows, and the change is reported.
    assert_eq!(changes[..9], [0.0; 9]);
    assert!((changes[29] + 0.2).abs() < 1e-3, "{changes:?}");
}

#[test]
fn a_region_without_identified_parameters_is_not_tracked() {
    let changed = ForceLaw { stiffness_pa: 0.8 * 4e5, ..identified() };
    let (law, changes) = tracked_in::<f64>(&steps(30, &changed, 0.0), |_| true, !(1 << 3));
    assert_eq!((law.stiffness_pa, changes), (f64::from(identified().single().stiffness_pa), vec![0.0; 30]));
}

/// After 30 steps, K and G agree within 1 % with the solution over all samples of these steps, in which the weight of a step
/// decreases with its age as in the tracking.
#[test]
#[ignore = "needs Python with NumPy: cargo xtask test"]
fn noisy_steps_result_in_the_batch_solution_of_numpy() {
    let changed = ForceLaw { stiffness_pa: 1.25 * 4e5, damping_pa_s: 0.7 * 1.5e4, ..identified() };
    let walk = steps(30, &changed, 0.02);
    let (law, _) = tracked::<f32>(&walk, |_| true);
    // Columns: elastic and viscous force of the identified law, and the measured force, each multiplied by the square root of the
    // weight of the step. The weight decreases by the factor 29/30 with each further step, as in `pipeline::track`. The numbers
    // 1e-3, 1.5e4 and 1.8 are `ab_m2`, `damping_pa_s` and `m` + 1 of the identified law.
    let elastic_law = ForceLaw { damping_pa_s: 0.0, ..identified() };
    let mut rows = String::new();
    for (age, (area, force)) in (0..walk.len()).rev().zip(&walk) {
        let root_weight = (29.0 / 30.0f64).powi(age as i32).sqrt();
        let (elastic, g): (Vec<f64>, Vec<f64>) = (
            force_n(&elastic_law, area),
            area.iter().map(|mm2| 1.0 - (1.0 - mm2 * 1e-6 / (PI * 1e-3)).sqrt()).collect(),
        );
        for i in 0..area.len() {
            let (before, after) = (i.saturating_sub(1), (i + 1).min(g.len() - 1));
            let rate = (g[after] - g[before]) / ((after - before) as f64 * SAMPLE_S);
            let shape = (6.0 - 4.0 * g[i] + g[i] * g[i]) / (3.0 * (2.0 - g[i]));
            let viscous = PI * 1e-3 * 1.5e4 * g[i].powf(1.8) * rate * shape;
            let row = [elastic[i], viscous, force[i]].map(|force_n| force_n * root_weight);
            rows += &format!("{} {} {}\n", row[0], row[1], row[2]);
        }
    }
    let script =
        "import sys, numpy as np\nd = np.loadtxt(sys.stdin)\nprint(*np.linalg.lstsq(d[:, :2], d[:, 2], rcond=None)[0])";
    let text = common::run_python(&["-c", script], &rows);
    let factors: Vec<f64> = text.split_whitespace().map(|word| word.parse().expect("a number")).collect();
    assert!((f64::from(law.stiffness_pa) / 4e5 / factors[0] - 1.0).abs() < 0.01, "{law:?} {factors:?}");
    assert!((f64::from(law.damping_pa_s) / 1.5e4 / factors[1] - 1.0).abs() < 0.01, "{law:?} {factors:?}");
}

#[test]
fn unreliable_steps_change_nothing_and_changes_are_bounded() {
    let soft = ForceLaw { stiffness_pa: 0.1 * 4e5, damping_pa_s: 0.0, ..identified() };
    let walk = steps(40, &soft, 0.0);
    let (law, changes) = tracked::<f64>(&walk, |_| false);
    assert_eq!(law.single(), identified().single());
    assert_eq!(changes, [0.0; 40]);
    let (law, changes) = tracked::<f64>(&walk, |_| true);
    assert_eq!(law.stiffness_pa as f32, 0.5 * identified().stiffness_pa as f32);
    assert_eq!(law.damping_pa_s as f32, 0.25 * identified().damping_pa_s as f32);
    assert!((changes[39] + 0.5).abs() < 1e-6, "{changes:?}");
}

/// On stairs, the heel hardly touches the ground in some steps. In them, the measured force is 2.5 times that of the law.
#[test]
fn steps_that_hardly_load_the_region_hardly_change_the_law() {
    let stiffer = ForceLaw { stiffness_pa: 2.5 * 4e5, ..identified() };
    let mut walk = steps(60, &identified(), 0.0);
    let peak_n = walk[0].1.iter().copied().fold(0.0, f64::max);
    let mut least_share = f64::MAX;
    for (area, force) in walk.iter_mut().skip(1).step_by(2) {
        area.iter_mut().for_each(|mm2| *mm2 *= 0.12);
        *force = force_n(&stiffer, area);
        least_share = least_share.min(force.iter().copied().fold(0.0, f64::max) / peak_n);
    }
    assert!((0.05..0.3).contains(&least_share), "{least_share}");
    let (_, changes) = tracked::<f32>(&walk, |_| true);
    assert!(changes.iter().all(|change| change.abs() < 0.05), "{changes:?}");
}

#[test]
fn the_law_forgets_an_earlier_change() {
    let changed = ForceLaw { stiffness_pa: 0.7 * 4e5, ..identified() };
    let mut walk = steps(30, &changed, 0.0);
    walk.extend(steps(150, &identified(), 0.0));
    let (law, changes) = tracked::<f64>(&walk, |_| true);
    assert!((law.stiffness_pa / 4e5 - 1.0).abs() < 0.01, "{law:?}");
    assert!(changes[29] < -0.29 && changes[60] > -0.15, "{changes:?}");
}

#[test]
fn each_region_has_its_own_limit_of_the_change_in_both_directions() {
    // The change of K in region i has this sign. It is 1 % above the limit of the region if bit i of `beyond` is set, and 1 %
    // below it otherwise.
    let refit = |beyond: u8, sign: f64| {
        let mut regions = [RegionStep::default(); 8];
        for (i, (region, limit)) in regions.iter_mut().zip(STIFFNESS_MDC).enumerate() {
            region.stiffness_change = sign * REFIT_PER_MDC * limit * if beyond >> i & 1 == 1 { 1.01 } else { 0.99 };
        }
        let record = StepRecord {
            side: Side::Left,
            step: 0,
            start_us: 0,
            duration_us: 0,
            sample_us: 0,
            bridged_frames: 0,
            saturated: 0,
            contact_rule: ContactRule::COVERED,
            foot: FootMeasures::default(),
            regions,
        };
        record.refit()
    };
    for beyond in [0, 0b1000_0001, 0b0101_0010, u8::MAX] {
        assert_eq!([refit(beyond, 1.0), refit(beyond, -1.0)], [beyond; 2]);
    }
}

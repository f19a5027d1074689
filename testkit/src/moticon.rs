//! Walks that the insoles of the vendor Moticon recorded, compared with the steps in the vendor's reports.

use client::gait::{FootStep, Gait, MEASURES, Stride};
use plantar::Side;
use plantar::pipeline::region::{ForceMoments, RegionFrame};
use plantar::pipeline::stance::Stance;
use plantar::pipeline::stance_rule::{StanceLimits, StanceRule};
use recording::{Format, Options};
use serde::Deserialize;
use std::path::Path;
use std::process::Command;

/// One walk: the text of the raw export, and the steps of both feet in the report.
#[derive(Deserialize)]
struct Walk {
    export: String,
    steps: [Vec<VendorStep>; 2],
}

/// One foot in one walk.
struct Foot {
    t_s: Vec<f64>,
    force_n: Vec<f64>,
    steps: Vec<VendorStep>,
}

impl Foot {
    /// The vendor's step with its initial contact at about this time.
    fn step_at(&self, t_s: f64) -> Option<&VendorStep> {
        self.steps.iter().find(|step| (step.contact_s - t_s).abs() < SAME_STEP_S)
    }
}

/// A step in a report of the vendor. A time that ends with a later step is `None` if the report has no such step.
#[derive(Deserialize)]
struct VendorStep {
    /// Initial contact.
    contact_s: f64,
    toe_off_s: f64,
    /// Largest total force.
    peak_n: f64,
    /// Time to the next initial contact of the same foot.
    stride_s: Option<f64>,
    /// Time to the next initial contact of the other foot.
    to_other_s: Option<f64>,
    /// Time from initial contact to toe off of the other foot.
    double_support_s: Option<f64>,
}

/// Time between the frames of all walks, us.
const PERIOD_US: u32 = 10_000;
/// Largest difference between the heel strikes of the same step, s.
const SAME_STEP_S: f64 = 0.2;

/// How the steps of the stance detection compare with those of the vendor. The differences are medians of absolute values.
#[derive(Debug)]
pub struct Agreement {
    /// Number of the vendor's steps.
    pub steps: usize,
    /// Number of them that the stance detection found, too.
    pub found: usize,
    /// Difference of initial contact, ms.
    pub contact_ms: f64,
    /// Difference of toe off, ms.
    pub toe_off_ms: f64,
    /// Difference of the largest force, N.
    pub peak_n: f64,
    /// Number of the vendor's stride times.
    pub strides: usize,
    /// Number of compared stride times, step times, first phases of double support, and double supports.
    pub compared: [usize; 4],
    /// Difference of stride time, ms.
    pub stride_ms: f64,
    /// Difference of step time, ms.
    pub step_ms: f64,
    /// Difference of the first phase of double support, ms. The vendor reports each phase on its own.
    pub double_support_ms: f64,
    /// Difference of the double support of a stride, both phases together, ms.
    pub both_phases_ms: f64,
}

/// Detects the stances in the total forces of all walks, and compares them with the vendor's steps. `archive` is the source
/// archive of the package moticon-opengo, and `python` an interpreter.
///
/// # Panics
/// If the interpreter cannot read the archive.
pub fn compare(python: &Path, archive: &Path) -> Agreement {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/src/moticon.py");
    let output = Command::new(python).arg(script).arg(archive).output().expect("Python can be started");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let walks: Vec<Walk> = serde_json::from_slice(&output.stdout).expect("the script prints JSON");
    let feet: Vec<Foot> = walks.into_iter().flat_map(feet_of).collect();
    let mut steps: [Vec<f64>; 3] = Default::default();
    let mut times: [Vec<f64>; 4] = Default::default();
    for walk in feet.chunks_exact(2) {
        let found = [&walk[0], &walk[1]].map(stances);
        for (foot, found) in walk.iter().zip(&found) {
            compare_steps(foot, found, &mut steps);
        }
        let gait = Gait::new(found.map(|found| foot_steps(&found)), true);
        compare_strides([&walk[0], &walk[1]], &gait.feet[0].strides, &mut times);
        compare_strides([&walk[1], &walk[0]], &gait.feet[1].strides, &mut times);
    }
    let vendor = || feet.iter().flat_map(|foot| &foot.steps);
    let (compared, found) = (times.each_ref().map(Vec::len), steps[0].len());
    let [contact_ms, toe_off_ms, peak_n] = steps.map(median);
    let [stride_ms, step_ms, double_support_ms, both_phases_ms] = times.map(median);
    let strides = vendor().filter(|step| step.stride_s.is_some()).count();
    let steps = vendor().count();
    Agreement {
        steps,
        found,
        contact_ms,
        toe_off_ms,
        peak_n,
        strides,
        compared,
        stride_ms,
        step_ms,
        double_support_ms,
        both_phases_ms,
    }
}

/// The feet of a walk, from the importer.
fn feet_of(walk: Walk) -> impl Iterator<Item = Foot> {
    let export = Format::Moticon
        .parse(walk.export.as_bytes(), Path::new("walk.txt"), Options::default())
        .expect("the export is read");
    assert!(export.feet.iter().map(|foot| foot.side).eq([Side::Left, Side::Right]), "the export has both feet");
    export.feet.into_iter().zip(walk.steps).map(|(recording, steps)| Foot {
        force_n: (0..recording.frames()).map(|i| recording.force_n(i)).collect(),
        t_s: recording.t_s,
        steps,
    })
}

/// Adds the differences of initial contact (ms), toe off (ms) and largest force (N) of the steps of a foot. `found` is from
/// [`stances`].
fn compare_steps(foot: &Foot, found: &[[f64; 3]], differences: &mut [Vec<f64>; 3]) {
    for step in &foot.steps {
        let is_same = |stance: &&[f64; 3]| stance[0] < step.toe_off_s && step.contact_s < stance[1];
        if let Some([contact_s, toe_off_s, peak_n]) = found.iter().find(is_same) {
            differences[0].push((contact_s - step.contact_s).abs() * 1e3);
            differences[1].push((toe_off_s - step.toe_off_s).abs() * 1e3);
            differences[2].push((peak_n - step.peak_n).abs());
        }
    }
}

/// Adds the differences of stride time, step time and double support (ms) of the strides of a foot. The vendor reports the time
/// to the other foot's contact, and each phase of double support, with the step whose initial contact begins this time or
/// phase.
fn compare_strides([own, other]: [&Foot; 2], strides: &[Stride], differences: &mut [Vec<f64>; 4]) {
    for stride in strides {
        let own_step = own.step_at(stride.start_s);
        let other_step = stride.other_s.and_then(|t_s| other.step_at(t_s));
        let (Some(own_step), Some(other_step)) = (own_step, other_step) else { continue };
        let phases_s = own_step.double_support_s.zip(other_step.double_support_s);
        let both_s = phases_s.map(|(first_s, second_s)| first_s + second_s);
        let vendor_s = [own_step.stride_s, other_step.to_other_s, own_step.double_support_s, both_s];
        let keys = ["stride_time_s", "step_time_s", "first_double_support_s", "double_support_s"];
        for ((key, vendor_s), differences) in keys.into_iter().zip(vendor_s).zip(&mut *differences) {
            let found_s = MEASURES.iter().position(|measure| measure.key == key).and_then(|i| stride.values[i]);
            differences.extend(found_s.zip(vendor_s).map(|(found_s, vendor_s)| (found_s - vendor_s).abs() * 1e3));
        }
    }
}

/// The steps of a foot on the clock of the walk.
fn foot_steps(stances: &[[f64; 3]]) -> Vec<FootStep> {
    let step = |(number, &[start_s, end_s, peak_n]): (u32, &[f64; 3])| FootStep {
        number,
        start_s,
        duration_s: end_s - start_s,
        peak_n,
        integral_n_s: 0.0,
    };
    (0..).zip(stances).map(step).collect()
}

/// Heel strike (s), toe off (s) and largest total force (N) of the steps of a foot.
fn stances(foot: &Foot) -> Vec<[f64; 3]> {
    let limits = StanceLimits::<f64>::new(&StanceRule::ADAPTIVE, PERIOD_US);
    let mut stance = Stance::new();
    let mut found = Vec::new();
    for (&t_s, &force_n) in foot.t_s.iter().zip(&foot.force_n) {
        let seq = (t_s * 1e6 / f64::from(PERIOD_US)).round() as u32;
        // The stance detection depends on the total force only, so all of it is in the first region.
        let whole = RegionFrame { force: ForceMoments { force_n, ..ForceMoments::NONE }, ..RegionFrame::NONE };
        let none = RegionFrame::NONE;
        let regions = core::array::from_fn(|region| if region == 0 { &whole } else { &none });
        if stance.push(&limits, seq, &regions, (0.0, 0.0)) {
            let seconds = |frames: u32| f64::from(frames) * f64::from(PERIOD_US) / 1e6;
            let peak_n = (0..stance.curves().samples()).map(|i| stance.curves().total_n(i)).fold(0.0, f64::max);
            found.push([seconds(stance.start_seq()), seconds(stance.start_seq() + stance.frames()), peak_n]);
        }
    }
    found
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

//! Walks that another vendor's insoles recorded, and the steps in this vendor's reports.

use plantar::pipeline::region::{ForceMoments, RegionFrame};
use plantar::pipeline::stance::Stance;
use plantar::pipeline::stance_rule::{StanceLimits, StanceRule};
use serde::Deserialize;
use std::path::Path;
use std::process::Command;

/// One foot in one walk.
#[derive(Deserialize)]
struct Foot {
    t_s: Vec<f64>,
    force_n: Vec<f64>,
    /// Initial contact (s), toe off (s) and largest force (N).
    steps: Vec<[f64; 3]>,
}

/// Time between the frames of all walks, us.
const PERIOD_US: u32 = 10_000;

/// How the steps of the stance detection compare with those of the vendor.
#[derive(Debug)]
pub struct Agreement {
    /// Number of the vendor's steps.
    pub steps: usize,
    /// Number of them that the stance detection found, too.
    pub found: usize,
    /// Median of the absolute differences of initial contact, ms.
    pub contact_ms: f64,
    /// The same of toe off, ms.
    pub toe_off_ms: f64,
    /// The same of the largest force, N.
    pub peak_n: f64,
}

/// Detects the stances in the total forces of all walks. `archive` is the source archive of the package moticon-opengo, and `python`
/// an interpreter.
pub fn compare(python: &Path, archive: &Path) -> Agreement {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/src/moticon.py");
    let output = Command::new(python).arg(script).arg(archive).output().expect("Python can be started");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let feet: Vec<Foot> = serde_json::from_slice(&output.stdout).expect("the script prints JSON");
    let (mut steps, mut contact_ms, mut toe_off_ms, mut peak_n) = (0, Vec::new(), Vec::new(), Vec::new());
    for foot in &feet {
        let found = stances(foot);
        for [contact_s, toe_off_s, most_n] in &foot.steps {
            steps += 1;
            let is_same = |stance: &&[f64; 3]| stance[0] < *toe_off_s && *contact_s < stance[1];
            if let Some(stance) = found.iter().find(is_same) {
                contact_ms.push((stance[0] - contact_s).abs() * 1e3);
                toe_off_ms.push((stance[1] - toe_off_s).abs() * 1e3);
                peak_n.push((stance[2] - most_n).abs());
            }
        }
    }
    let found = peak_n.len();
    let [contact_ms, toe_off_ms, peak_n] = [contact_ms, toe_off_ms, peak_n].map(median);
    Agreement { steps, found, contact_ms, toe_off_ms, peak_n }
}

/// Heel strike (s), toe off (s) and largest total force (N) of the steps of a foot.
fn stances(foot: &Foot) -> Vec<[f64; 3]> {
    let limits = StanceLimits::<f64>::new(&StanceRule::ADAPTIVE, PERIOD_US);
    let mut stance = Stance::new();
    let mut found = Vec::new();
    for (&t_s, &force_n) in foot.t_s.iter().zip(&foot.force_n) {
        // Frames that were lost on the way are missing in the export.
        let seq = (t_s * 1e6 / f64::from(PERIOD_US)).round() as u32;
        let whole = RegionFrame { force: ForceMoments { force_n, ..ForceMoments::NONE }, ..RegionFrame::NONE };
        let none = RegionFrame::NONE;
        let regions = core::array::from_fn(|region| if region == 0 { &whole } else { &none });
        if stance.push(&limits, seq, regions, (0.0, 0.0)) {
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

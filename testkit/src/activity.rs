//! Activities of a wearer, computed as one recording of a foot, with what the wearer did at each time.

use crate::wear::Found;
use plantar::firmware::front_end::NOISE_CODES;
use plantar::pipeline::bout::BoutKind;
use recording::Recording;
use recording::synthetic::{self, SyntheticWalk};
use std::f64::consts::TAU;
use std::ops::Range;

/// What a wearer does. Forces are relative to the weight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// Ten steps.
    Walk,
    /// Ten steps with a stance of 0.22 s and a peak force of 2.3 times the weight.
    Run,
    /// Ten slow steps with a peak force of 1.3 times the weight.
    Stairs,
    /// Stands on both feet, sways, and shifts some weight slowly to the other foot and back.
    Stand,
    /// Stands on this foot.
    StandOnOne,
    /// Walks, but the foot does not leave the ground.
    Shuffle,
    /// Sits with the feet on the ground.
    Sit,
    /// The foot is in the air.
    Lift,
}

impl Activity {
    /// All activities.
    pub const ALL: [Self; 8] =
        [Self::Walk, Self::Run, Self::Stairs, Self::Stand, Self::StandOnOne, Self::Shuffle, Self::Sit, Self::Lift];

    /// The kind of the bouts of this activity; `None` if it consists of steps, or has no load.
    pub fn kind(self) -> Option<BoutKind> {
        match self {
            Self::Stand | Self::StandOnOne => Some(BoutKind::Standing),
            Self::Shuffle => Some(BoutKind::Shuffling),
            Self::Sit => Some(BoutKind::Sitting),
            Self::Walk | Self::Run | Self::Stairs | Self::Lift => None,
        }
    }

    /// The steps of this activity: stance time, s, swing time, s, and peak force relative to the weight.
    fn steps(self) -> Option<(f64, f64, f64)> {
        match self {
            Self::Walk => Some((0.65, 0.4, 1.1)),
            Self::Run => Some((0.22, 0.45, 2.3)),
            Self::Stairs => Some((0.85, 0.5, 1.3)),
            _ => None,
        }
    }

    /// Force at this time, s, relative to the weight; 0 for activities that consist of steps, and for a lifted foot.
    fn load(self, t_s: f64) -> f64 {
        let wave = |period_s: f64| (TAU * t_s / period_s).sin();
        match self {
            Self::Stand => 0.5 + 0.03 * wave(2.7) + 0.1 * wave(17.0),
            Self::StandOnOne => 0.95 + 0.03 * wave(1.9),
            Self::Shuffle => 0.60 - 0.33 * (TAU * t_s / 1.3).cos(),
            Self::Sit => 0.07 + 0.01 * wave(5.0),
            _ => 0.0,
        }
    }
}

/// Sequences of nine activities: each begins with a walk, and continues with all activities, or with some of them repeatedly,
/// in another order.
pub fn sequences() -> impl Iterator<Item = Vec<Activity>> {
    let count = Activity::ALL.len();
    (1..count).map(move |stride| {
        let others = (0..count).map(|i| Activity::ALL[i * stride % count]);
        [Activity::Walk].into_iter().chain(others).collect()
    })
}

/// An activity, and the frames of a recording in which the wearer performs it.
pub type Span = (Activity, Range<usize>);

/// Computes a recording of a foot of a wearer with this weight, N, who performs these activities. Each activity without steps
/// takes `seconds`. Returns the recording, and the frames of each activity.
pub fn recording(
    activities: &[Activity],
    weight_n: f64,
    rate_hz: f64,
    seconds: f64,
    seed: u64,
) -> (Recording, Vec<Span>) {
    let walk = |stance_s: f64, swing_s: f64, peak: f64, seed: u64| {
        let (steps, peak_n) = (10, weight_n * peak);
        synthetic::walk(&SyntheticWalk {
            steps,
            rate_hz,
            stance_s,
            swing_s,
            peak_n,
            variation: 0.1,
            seed,
            ..Default::default()
        })
        .recording
    };
    let mut all = walk(0.65, 0.4, 1.1, seed);
    let frame_kpa = synthetic::loaded_frame(&all.layout);
    let frame_n = all.layout.force_n(&frame_kpa);
    all.pressure_kpa.clear();
    let mut spans = Vec::new();
    // The force changes from one activity to the next within this number of frames.
    let ramp = (0.3 * rate_hz) as usize;
    let mut last_load = 0.0;
    for (activity, seed) in activities.iter().zip(seed..) {
        let start = all.pressure_kpa.len() / frame_kpa.len();
        let loads: Vec<f64> = match activity.steps() {
            None => (0..(seconds * rate_hz) as usize).map(|i| activity.load(i as f64 / rate_hz)).collect(),
            Some(_) => vec![0.0],
        };
        let first_load = loads[0];
        let rise = (0..ramp).map(|i| last_load + (first_load - last_load) * i as f64 / ramp as f64);
        for load in rise.chain(loads.iter().copied()) {
            all.pressure_kpa.extend(frame_kpa.iter().map(|kpa| (f64::from(*kpa) * load * weight_n / frame_n) as f32));
        }
        if let Some((stance_s, swing_s, peak)) = activity.steps() {
            all.pressure_kpa.extend(walk(stance_s, swing_s, peak, seed).pressure_kpa);
        }
        last_load = *loads.last().unwrap_or(&0.0);
        spans.push((*activity, start + ramp..all.pressure_kpa.len() / frame_kpa.len()));
    }
    // Lengths are in proportion to the cube root of the weight, so that a child has small feet. The unscaled layout is that of
    // a wearer of 650 N.
    let size = (weight_n / 650.0).cbrt();
    for cell in &mut all.layout.cells {
        (cell.x_mm, cell.y_mm, cell.area_mm2) = (cell.x_mm * size, cell.y_mm * size, cell.area_mm2 * size * size);
    }
    all.pressure_kpa.iter_mut().for_each(|kpa| *kpa /= (size * size) as f32);
    all.t_s = (0..all.pressure_kpa.len() / frame_kpa.len()).map(|i| i as f64 / rate_hz).collect();
    let offsets = vec![0.0; all.cells()];
    synthetic::add_sensor_errors(&mut all, &offsets, NOISE_CODES, seed);
    (all, spans)
}

/// The number of activities that have a kind, and the number of them that are in load bouts of this kind for most of their
/// time.
pub fn recognised(spans: &[Span], found: &Found, period_us: u64) -> (usize, usize) {
    let (mut labelled, mut correct) = (0, 0);
    for (activity, frames) in spans {
        let Some(kind) = activity.kind() else { continue };
        let covered = found.bouts.iter().filter(|bout| bout.kind == kind).map(|bout| {
            let start = (bout.start_us / period_us) as usize;
            let end = start + (u64::from(bout.duration_us) / period_us) as usize;
            end.min(frames.end).saturating_sub(start.max(frames.start))
        });
        labelled += 1;
        correct += usize::from(2 * covered.sum::<usize>() > frames.len());
    }
    (labelled, correct)
}

//! A computed standing trial.

use super::{insole, loaded_frame};
use crate::Recording;
use plantar::Side;
use std::f64::consts::PI;

/// The parameters of a computed standing trial: the foot is lifted, stands, and is lifted again.
#[derive(Clone, Debug, PartialEq)]
pub struct SyntheticStanding {
    /// The foot.
    pub side: Side,
    /// Number of cells of the [`insole`].
    pub cells: usize,
    /// Frames per second.
    pub rate_hz: f64,
    /// Times for which the foot is lifted, before and after standing, s.
    pub lifted_s: [f64; 2],
    /// Time for which the person stands, s.
    pub stand_s: f64,
    /// Duration of each of the two transitions between lifted and standing, s, above 0. It is not part of the other times.
    pub transition_s: f64,
    /// Force on this foot while standing, without the sway, N.
    pub standing_n: f64,
    /// Amplitude of the sway as a fraction of this force. The period of the sway is three seconds.
    pub sway: f64,
}

impl Default for SyntheticStanding {
    fn default() -> Self {
        Self {
            side: Side::Right,
            cells: 240,
            rate_hz: 100.0,
            lifted_s: [5.0; 2],
            stand_s: 10.0,
            transition_s: 1.0,
            standing_n: 350.0,
            sway: 0.03,
        }
    }
}

/// Computes a standing trial.
///
/// # Panics
/// Panics if the number of cells is 0.
pub fn standing(trial: &SyntheticStanding) -> Recording {
    const SWAY_PERIOD_S: f64 = 3.0;
    let layout = insole(trial.cells);
    let kpa_of_frame = loaded_frame(&layout);
    let frame_n = layout.force_n(&kpa_of_frame);
    // The force at a time, relative to the force while standing without the sway.
    let load = |t_s: f64| {
        let standing_since_s = t_s - trial.lifted_s[0] - trial.transition_s;
        // Time until standing begins, or since it ended.
        let away_s = (-standing_since_s).max(standing_since_s - trial.stand_s).max(0.0);
        let transition = 0.5 + 0.5 * (PI * (away_s / trial.transition_s).min(1.0)).cos();
        transition * (1.0 + trial.sway * (2.0 * PI * standing_since_s / SWAY_PERIOD_S).sin())
    };
    let duration_s = trial.lifted_s[0] + trial.lifted_s[1] + trial.stand_s + 2.0 * trial.transition_s;
    let t_s: Vec<f64> = (0..(duration_s * trial.rate_hz).round() as usize).map(|k| k as f64 / trial.rate_hz).collect();
    let frame = |&t_s: &f64| {
        let share = load(t_s) * trial.standing_n / frame_n;
        kpa_of_frame.iter().map(move |&kpa| (f64::from(kpa) * share) as f32)
    };
    Recording {
        side: trial.side,
        rate_hz: trial.rate_hz,
        source: "Synthetic standing trial: computed, not measured.".into(),
        pressure_kpa: t_s.iter().flat_map(frame).collect(),
        t_s,
        layout,
    }
}

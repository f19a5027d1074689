//! A computed walk. In each step, the load moves from the heel to the toes. Each region is loaded over an ellipse, which
//! grows and then shrinks. The pressure over the ellipse has the shape of a smooth dome. A cell reads the pressure that the
//! dome has at the centre of the cell, times the share of the cell that the ellipse covers. The force on the whole foot has
//! two peaks in each step, as in walking.

use super::ellipse::{EllipseCell, LoadEllipse};
use super::{Random, insole};
use crate::{Layout, Recording};
use plantar::{Region, Side};
use std::f64::consts::PI;

/// The parameters of a computed walk.
#[derive(Clone, Debug, PartialEq)]
pub struct SyntheticWalk {
    /// The foot.
    pub side: Side,
    /// Number of cells of the [`insole`].
    pub cells: usize,
    /// Number of steps.
    pub steps: usize,
    /// Frames per second.
    pub rate_hz: f64,
    /// Stance time, s.
    pub stance_s: f64,
    /// Swing time before the first step, between steps, and after the last step, s.
    pub swing_s: f64,
    /// Time without load before the first swing, s, at least 0.
    pub delay_s: f64,
    /// Peak force on the whole foot, N.
    pub peak_n: f64,
    /// Largest relative deviation of the peak force and of the stance time of a step, at least 0 and below 1.
    pub variation: f64,
    /// Seed of the variation; equal seeds result in equal walks.
    pub seed: u64,
    /// The walk has the stance times of a walk with this seed, such as that of the other foot; `None` for those of its own seed.
    pub timing_seed: Option<u64>,
}

impl Default for SyntheticWalk {
    fn default() -> Self {
        Self {
            side: Side::Right,
            cells: 240,
            steps: 10,
            rate_hz: 100.0,
            stance_s: 0.65,
            swing_s: 0.4,
            delay_s: 0.0,
            peak_n: 800.0,
            variation: 0.03,
            seed: 1,
            timing_seed: None,
        }
    }
}

/// A computed recording and its true values.
#[derive(Clone, Debug, PartialEq)]
pub struct Walk {
    /// The readings of the insole.
    pub recording: Recording,
    /// True contact area of each region, mm²: the part of its ellipse that lies on its cells. One array for each frame, in the
    /// order of [`Region::ALL`].
    pub contact_mm2: Vec<[f64; 8]>,
    /// True force on each region, N; one array for each frame, in the order of [`Region::ALL`].
    pub force_n: Vec<[f64; 8]>,
}

/// The part of stance in which a region is loaded, and the weight of the region in the total force. Start and end are fractions
/// of stance.
struct Phase {
    start: f64,
    end: f64,
    weight: f64,
}

/// The phases of the regions, in the order of [`Region::ALL`].
const PHASES: [Phase; 8] = [
    phase(0.00, 0.62, 1.00),
    phase(0.06, 0.70, 0.10),
    phase(0.08, 0.78, 0.14),
    phase(0.12, 0.97, 0.55),
    phase(0.10, 0.95, 0.60),
    phase(0.25, 1.00, 0.35),
    phase(0.32, 0.99, 0.08),
    phase(0.30, 0.98, 0.12),
];

const fn phase(start: f64, end: f64, weight: f64) -> Phase {
    Phase { start, end, weight }
}

/// The contact area is proportional to force to the power of this exponent. It is below 1, so that pressure increases with
/// force, too.
const AREA_EXPONENT: f64 = 0.6;
/// Fraction by which the pressure of the dome decreases from its centre to its edge.
const DOME_FALL: f64 = 0.6;

/// Computes a walk.
///
/// # Panics
/// Panics if the rate or a duration is not a positive number, the variation is not within 0..1, or the number of cells is 0.
pub fn walk(walk: &SyntheticWalk) -> Walk {
    assert!(
        [walk.rate_hz, walk.stance_s, walk.swing_s].iter().all(|value| value.is_finite() && *value > 0.0),
        "rate and durations are positive"
    );
    assert!((0.0..1.0).contains(&walk.variation), "the variation is a fraction");
    let layout = insole(walk.cells);
    let ellipses = Region::ALL.map(|region| LoadEllipse::of(&layout, region));
    let largest_shares = largest_shares();
    let (mut random, mut timing) = (Random(walk.seed), Random(walk.timing_seed.unwrap_or(walk.seed)));
    let mut frames = Frames { pressure_kpa: Vec::new(), contact_mm2: Vec::new(), force_n: Vec::new() };
    let mut start_s = walk.delay_s + walk.swing_s;
    for _ in 0..walk.steps {
        // Both seeds have two numbers for each step, so that a walk without a seed of its timing has one sequence of numbers.
        let [stance_s, _] = [walk.stance_s, walk.peak_n].map(|mean| mean * timing.around_one(walk.variation));
        let [_, peak_n] = [walk.stance_s, walk.peak_n].map(|mean| mean * random.around_one(walk.variation));
        loop {
            let elapsed_stance = (frames.contact_mm2.len() as f64 / walk.rate_hz - start_s) / stance_s;
            if elapsed_stance >= 1.0 {
                break;
            }
            frames.push(&layout, &ellipses, &largest_shares, elapsed_stance, peak_n);
        }
        start_s += stance_s + walk.swing_s;
    }
    while (frames.contact_mm2.len() as f64) < start_s * walk.rate_hz {
        frames.push(&layout, &ellipses, &largest_shares, -1.0, 0.0);
    }
    let count = frames.contact_mm2.len();
    Walk {
        recording: Recording {
            side: walk.side,
            layout,
            rate_hz: walk.rate_hz,
            source: format!("Synthetic walk of {} steps, seed {}: computed, not measured.", walk.steps, walk.seed),
            t_s: (0..count).map(|k| k as f64 / walk.rate_hz).collect(),
            pressure_kpa: frames.pressure_kpa,
        },
        contact_mm2: frames.contact_mm2,
        force_n: frames.force_n,
    }
}

/// The computed frames.
struct Frames {
    pressure_kpa: Vec<f32>,
    contact_mm2: Vec<[f64; 8]>,
    force_n: Vec<[f64; 8]>,
}

impl Frames {
    /// Adds the frame at `elapsed_stance`, the fraction of stance that has elapsed. Below 0 and above 1 no region is loaded.
    fn push(
        &mut self,
        layout: &Layout,
        ellipses: &[LoadEllipse; 8],
        largest_shares: &[f64; 8],
        elapsed_stance: f64,
        peak_n: f64,
    ) {
        let start = self.pressure_kpa.len();
        self.pressure_kpa.resize(start + layout.cells.len(), 0.0);
        let frame = &mut self.pressure_kpa[start..];
        let mut contact_mm2 = [0.0; 8];
        let mut force_n = [0.0; 8];
        let shares = shares(elapsed_stance);
        for (region, ellipse) in ellipses.iter().enumerate() {
            // The area of the ellipse relative to full size, which is the square of its relative radii.
            let size = (shares[region] / largest_shares[region]).powf(AREA_EXPONENT);
            let dome = |cell: &EllipseCell| 1.0 - DOME_FALL * (cell.centre_distance2 / size).min(1.0);
            // The covered area, and the area that would carry the same force at the pressure in the centre of the dome.
            let (mut covered_mm2, mut bearing_mm2) = (0.0, 0.0);
            for cell in &ellipse.cells {
                let area_mm2 = cell.covered(size) * layout.cells[cell.index].area_mm2;
                covered_mm2 += area_mm2;
                bearing_mm2 += area_mm2 * dome(cell);
            }
            // An ellipse that is smaller than the spacing of the grid points in a cell may contain none of them. It covers no
            // area.
            if covered_mm2 > 0.0 {
                contact_mm2[region] = covered_mm2;
                force_n[region] = shares[region] * peak_n;
                let kpa = force_n[region] / bearing_mm2 * 1e3;
                for cell in &ellipse.cells {
                    frame[cell.index] = (kpa * cell.covered(size) * dome(cell)) as f32;
                }
            }
        }
        self.contact_mm2.push(contact_mm2);
        self.force_n.push(force_n);
    }
}

/// The force on each region as a share of the peak force on the whole foot, at a fraction of stance.
fn shares(elapsed_stance: f64) -> [f64; 8] {
    let weights = PHASES.map(|phase| {
        let within = (elapsed_stance - phase.start) / (phase.end - phase.start);
        match within {
            0.0..=1.0 => phase.weight * (PI * within).sin().powi(2),
            _ => 0.0,
        }
    });
    let sum: f64 = weights.iter().sum();
    if sum == 0.0 {
        return weights;
    }
    // The total is sin(x) + 0.3 sin(3 x), scaled to a peak of 1. It has two peaks; between them it falls to 76 % of the peak.
    let sine = (PI * elapsed_stance).sin();
    let total = (1.9 * sine - 1.2 * sine.powi(3)) / 0.920_2;
    weights.map(|weight| total * weight / sum)
}

/// The largest share of each region during stance.
fn largest_shares() -> [f64; 8] {
    const SAMPLES: usize = 1000;
    let mut largest = [0.0_f64; 8];
    for sample in 0..=SAMPLES {
        for (largest, share) in largest.iter_mut().zip(shares(sample as f64 / SAMPLES as f64)) {
            *largest = largest.max(share);
        }
    }
    largest
}

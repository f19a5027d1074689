//! A computed walk whose contact areas and forces are known exactly, for tests and benchmarks; a standing trial, and the
//! offsets of real cells, likewise.
//!
//! Every region is loaded by an ellipse that grows and shrinks while the load passes over it, the heel
//! first, the toes last. A cell reads its covered share times a smooth dome of pressure. The whole foot
//! carries the two humps of walking.

use crate::insole::{EXPONENT, FULL_KPA};
use crate::{Cell, Layout, Recording, template};
use plantar::pipeline::calibrate::FULL_CODE;
use plantar::{Region, Side};
use std::f64::consts::PI;

/// What to walk.
#[derive(Clone, Debug, PartialEq)]
pub struct SyntheticWalk {
    /// The foot.
    pub side: Side,
    /// Cells of the [`insole`].
    pub cells: usize,
    /// Steps.
    pub steps: usize,
    /// Frames per second.
    pub rate_hz: f64,
    /// Time on the ground, s.
    pub stance_s: f64,
    /// Time without load before and after every step, s.
    pub swing_s: f64,
    /// The peak of the force on the whole foot, N.
    pub peak_n: f64,
    /// How far a step's force and stance may differ from the above, as a fraction.
    pub variation: f64,
    /// Chooses the variation; equal seeds walk equally.
    pub seed: u64,
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
            peak_n: 800.0,
            variation: 0.03,
            seed: 1,
        }
    }
}

/// A synthetic recording and its truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Walk {
    /// What the insole reads.
    pub recording: Recording,
    /// The true contact area of every region, mm²: the part of its ellipse that lies on its cells. One
    /// array per frame, in the order of [`Region::ALL`].
    pub contact_mm2: Vec<[f64; 8]>,
    /// The true force on every region, N; one array per frame, in the order of [`Region::ALL`].
    pub force_n: Vec<[f64; 8]>,
}

/// When a region is loaded, as fractions of stance, and its weight in the share of the total force.
struct Phase {
    start: f64,
    end: f64,
    weight: f64,
}

/// In the order of [`Region::ALL`].
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

/// Contact area grows with force to this power, so pressure grows too.
const AREA_EXPONENT: f64 = 0.6;
/// The dome's pressure falls by this fraction from the centre to the edge.
const DOME_FALL: f64 = 0.6;
/// A cell's covered share is counted on this many points squared.
const POINTS: usize = 8;

/// Walks.
///
/// # Panics
/// When the rate or a duration is not a positive number, the variation is not in 0..1, or there are no
/// cells.
pub fn walk(walk: &SyntheticWalk) -> Walk {
    assert!(
        [walk.rate_hz, walk.stance_s, walk.swing_s].iter().all(|value| value.is_finite() && *value > 0.0),
        "rate and durations are positive"
    );
    assert!((0.0..1.0).contains(&walk.variation), "variation is a fraction");
    let layout = insole(walk.cells);
    let pads = Region::ALL.map(|region| Pad::of(&layout, region));
    let most = largest_shares();
    let mut chance = Chance(walk.seed);
    let mut frame = Frame { pressure_kpa: Vec::new(), contact_mm2: Vec::new(), force_n: Vec::new() };
    let mut start_s = walk.swing_s;
    for _ in 0..walk.steps {
        let stance_s = walk.stance_s * chance.around_one(walk.variation);
        let peak_n = walk.peak_n * chance.around_one(walk.variation);
        loop {
            let elapsed = (frame.contact_mm2.len() as f64 / walk.rate_hz - start_s) / stance_s;
            if elapsed >= 1.0 {
                break;
            }
            frame.push(&layout, &pads, &most, elapsed, peak_n);
        }
        start_s += stance_s + walk.swing_s;
    }
    while (frame.contact_mm2.len() as f64) < start_s * walk.rate_hz {
        frame.push(&layout, &pads, &most, -1.0, 0.0);
    }
    let frames = frame.contact_mm2.len();
    Walk {
        recording: Recording {
            side: walk.side,
            layout,
            rate_hz: walk.rate_hz,
            source: format!("Synthetic walk of {} steps, seed {}: computed, not measured.", walk.steps, walk.seed),
            t_s: (0..frames).map(|k| k as f64 / walk.rate_hz).collect(),
            pressure_kpa: frame.pressure_kpa,
        },
        contact_mm2: frame.contact_mm2,
        force_n: frame.force_n,
    }
}

/// A standing trial: the foot is lifted, stands, and is lifted again.
#[derive(Clone, Debug, PartialEq)]
pub struct SyntheticStanding {
    /// The foot.
    pub side: Side,
    /// Cells of the [`insole`].
    pub cells: usize,
    /// Frames per second.
    pub rate_hz: f64,
    /// Time with the foot lifted, before and after, s.
    pub lifted_s: [f64; 2],
    /// Time of standing, s.
    pub stand_s: f64,
    /// Time to get up and to sit down again, each, s; not part of the others.
    pub transition_s: f64,
    /// The mean force on this foot while standing, N.
    pub standing_n: f64,
    /// The force sways by this fraction to either side, every three seconds.
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

/// Stands.
///
/// # Panics
/// When there are no cells.
pub fn standing(trial: &SyntheticStanding) -> Recording {
    const SWAY_PERIOD_S: f64 = 3.0;
    let layout = insole(trial.cells);
    let kpa_of_frame = loaded_frame(&layout);
    let frame_n = layout.force_n(&kpa_of_frame);
    let load = |t_s: f64| {
        let stands_s = t_s - trial.lifted_s[0] - trial.transition_s;
        // How far from standing, s: before or after it.
        let off_s = (-stands_s).max(stands_s - trial.stand_s).max(0.0);
        let up = 0.5 + 0.5 * (PI * (off_s / trial.transition_s).min(1.0)).cos();
        up * (1.0 + trial.sway * (2.0 * PI * stands_s / SWAY_PERIOD_S).sin())
    };
    let seconds = trial.lifted_s[0] + trial.lifted_s[1] + trial.stand_s + 2.0 * trial.transition_s;
    let t_s: Vec<f64> = (0..(seconds * trial.rate_hz).round() as usize).map(|k| k as f64 / trial.rate_hz).collect();
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

/// Lets cells read their offsets, kPa, and noise of up to so many codes of a sensor that ends at 1000 kPa.
///
/// As in a real sensor both are added to the code. For a power law that is not a sum of pressures: where 5 kPa rest, 100 kPa
/// read 112 kPa.
///
/// # Panics
/// When there are not as many offsets as cells.
pub fn read_with(recording: &mut Recording, offset_kpa: &[f32], noise_codes: f64, seed: u64) {
    assert_eq!(offset_kpa.len(), recording.cells(), "one offset a cell");
    let (full_kpa, full_code, exponent) = (f64::from(FULL_KPA), f64::from(FULL_CODE), f64::from(EXPONENT));
    let code = |kpa: f32| full_code * (f64::from(kpa) / full_kpa).powf(exponent);
    let offsets: Vec<f64> = offset_kpa.iter().map(|&kpa| code(kpa)).collect();
    let mut chance = Chance(seed);
    for frame in recording.pressure_kpa.chunks_exact_mut(offsets.len()) {
        for (kpa, offset) in frame.iter_mut().zip(&offsets) {
            let noise = noise_codes * (chance.around_one(1.0) - 1.0);
            *kpa = (full_kpa * ((code(*kpa) + offset + noise).max(0.0) / full_code).powf(1.0 / exponent)) as f32;
        }
    }
}

/// One frame in which every cell carries load, kPa.
pub fn loaded_frame(layout: &Layout) -> Vec<f32> {
    let pads = Region::ALL.map(|region| Pad::of(layout, region));
    layout
        .cells
        .iter()
        .map(|cell| (200.0 / (1.0 + pads[cell.region as usize].distance(cell.x_mm, cell.y_mm))) as f32)
        .collect()
}

/// A generic insole of EU size 42 with exactly this many square cells, regions by [`template`].
///
/// The cells lie on a regular grid at the widest pitch that gives enough of them inside the outline;
/// a surplus goes at the tip of the toes.
///
/// # Panics
/// When `cells` is 0.
pub fn insole(cells: usize) -> Layout {
    assert!(cells > 0, "an insole has cells");
    const PITCH_STEP_MM: f64 = 0.001;
    let widest_mm = 1.5 * (LENGTH_MM * WIDTH_MM / cells as f64).sqrt();
    let mut grid = (0..)
        .map(|k| widest_mm - f64::from(k) * PITCH_STEP_MM)
        .map(inside_outline)
        .find(|grid| grid.len() >= cells)
        .expect("a pitch near zero gives any number of cells");
    grid.truncate(cells);
    template::assign(&mut grid);
    Layout { name: format!("synthetic insole, EU 42, {cells} cells"), cells: grid }
}

const LENGTH_MM: f64 = 268.0;
const WIDTH_MM: f64 = 96.0;
/// The outline of the insole, mm: y and the medial and lateral edges there.
const OUTLINE_MM: [[f64; 3]; 14] = [
    [0.0, 24.0, 52.0],
    [10.0, 13.0, 63.0],
    [30.0, 7.0, 70.0],
    [60.0, 8.0, 72.0],
    [100.0, 15.0, 77.0],
    [130.0, 16.0, 83.0],
    [160.0, 10.0, 90.0],
    [190.0, 2.0, 95.0],
    [205.0, 0.0, 96.0],
    [225.0, 1.0, 92.0],
    [245.0, 6.0, 82.0],
    [258.0, 13.0, 69.0],
    [266.0, 24.0, 53.0],
    [LENGTH_MM, 30.0, 46.0],
];

/// The cells of a square grid whose centres lie in the outline, heel to toes.
fn inside_outline(pitch_mm: f64) -> Vec<Cell> {
    let centres =
        |until_mm: f64| (0..).map(move |k| (f64::from(k) + 0.5) * pitch_mm).take_while(move |&at_mm| at_mm < until_mm);
    centres(LENGTH_MM)
        .flat_map(|y_mm| {
            let [medial_mm, lateral_mm] = edges_mm(y_mm);
            centres(WIDTH_MM).filter(move |x_mm| (medial_mm..lateral_mm).contains(x_mm)).map(move |x_mm| Cell {
                x_mm,
                y_mm,
                area_mm2: pitch_mm * pitch_mm,
                // Replaced by the template.
                region: Region::Heel,
            })
        })
        .collect()
}

/// The outline's medial and lateral edge at `y_mm`, which lies within the insole.
fn edges_mm(y_mm: f64) -> [f64; 2] {
    let after = OUTLINE_MM.partition_point(|[y, ..]| *y <= y_mm).clamp(1, OUTLINE_MM.len() - 1);
    let ([y0, medial0, lateral0], [y1, medial1, lateral1]) = (OUTLINE_MM[after - 1], OUTLINE_MM[after]);
    let share = (y_mm - y0) / (y1 - y0);
    [medial0 + (medial1 - medial0) * share, lateral0 + (lateral1 - lateral0) * share]
}

/// One region's ellipse at full size, and how its cells lie in it.
struct Pad {
    centre_mm: [f64; 2],
    radii_mm: [f64; 2],
    cells: Vec<PadCell>,
}

struct PadCell {
    index: usize,
    /// [`Pad::distance`] of the centroid.
    centre: f64,
    /// [`Pad::distance`] of points spread over the cell, ascending.
    points: Vec<f64>,
}

impl Pad {
    fn of(layout: &Layout, region: Region) -> Self {
        let own = || layout.cells.iter().filter(|cell| cell.region == region);
        let area_mm2: f64 = own().map(|cell| cell.area_mm2).sum();
        let mean = |of: &dyn Fn(&Cell) -> f64| own().map(|cell| of(cell) * cell.area_mm2).sum::<f64>() / area_mm2;
        let centre_mm = [mean(&|c| c.x_mm), mean(&|c| c.y_mm)];
        // The variance over the cells' squares; a uniform box is 3.46 deviations wide, so 1.5 fit inside.
        let within_cell = mean(&|c| c.area_mm2 / 12.0);
        let radius = |variance: f64| 1.5 * (variance + within_cell).sqrt();
        let radii_mm =
            [radius(mean(&|c| (c.x_mm - centre_mm[0]).powi(2))), radius(mean(&|c| (c.y_mm - centre_mm[1]).powi(2)))];
        let mut pad = Self { centre_mm, radii_mm, cells: Vec::new() };
        for (index, cell) in layout.cells.iter().enumerate() {
            if cell.region == region {
                pad.cells.push(PadCell { index, centre: pad.distance(cell.x_mm, cell.y_mm), points: pad.points(cell) });
            }
        }
        pad
    }

    /// The squared distance from the centre in radii: 1 on the ellipse at full size.
    fn distance(&self, x_mm: f64, y_mm: f64) -> f64 {
        ((x_mm - self.centre_mm[0]) / self.radii_mm[0]).powi(2)
            + ((y_mm - self.centre_mm[1]) / self.radii_mm[1]).powi(2)
    }

    fn points(&self, cell: &Cell) -> Vec<f64> {
        let side_mm = cell.area_mm2.sqrt();
        let offset = |i: usize| ((i as f64 + 0.5) / POINTS as f64 - 0.5) * side_mm;
        let mut points: Vec<f64> = (0..POINTS * POINTS)
            .map(|i| self.distance(cell.x_mm + offset(i % POINTS), cell.y_mm + offset(i / POINTS)))
            .collect();
        points.sort_by(f64::total_cmp);
        points
    }
}

/// The frames so far.
struct Frame {
    pressure_kpa: Vec<f32>,
    contact_mm2: Vec<[f64; 8]>,
    force_n: Vec<[f64; 8]>,
}

impl Frame {
    /// Adds the frame at `elapsed`, a fraction of stance; outside 0..1 nothing is loaded.
    fn push(&mut self, layout: &Layout, pads: &[Pad; 8], most: &[f64; 8], elapsed: f64, peak_n: f64) {
        let start = self.pressure_kpa.len();
        self.pressure_kpa.resize(start + layout.cells.len(), 0.0);
        let frame = &mut self.pressure_kpa[start..];
        let mut contact_mm2 = [0.0; 8];
        let mut force_n = [0.0; 8];
        let shares = shares(elapsed);
        for (region, pad) in pads.iter().enumerate() {
            // The squared size of the ellipse is its area relative to full size.
            let size = (shares[region] / most[region]).powf(AREA_EXPONENT);
            let covered = |cell: &PadCell| {
                let points = cell.points.partition_point(|&point| point < size);
                points as f64 / cell.points.len() as f64
            };
            let dome = |cell: &PadCell| 1.0 - DOME_FALL * (cell.centre / size).min(1.0);
            // The covered area, and the area that would bear the same force without the dome.
            let (mut covered_mm2, mut bearing_mm2) = (0.0, 0.0);
            for cell in &pad.cells {
                let area_mm2 = covered(cell) * layout.cells[cell.index].area_mm2;
                covered_mm2 += area_mm2;
                bearing_mm2 += area_mm2 * dome(cell);
            }
            // An ellipse smaller than the spacing of the points does not exist yet.
            if covered_mm2 > 0.0 {
                contact_mm2[region] = covered_mm2;
                force_n[region] = shares[region] * peak_n;
                let kpa = force_n[region] / bearing_mm2 * 1e3;
                for cell in &pad.cells {
                    frame[cell.index] = (kpa * covered(cell) * dome(cell)) as f32;
                }
            }
        }
        self.contact_mm2.push(contact_mm2);
        self.force_n.push(force_n);
    }
}

/// Every region's force as a share of the peak on the whole foot.
fn shares(elapsed: f64) -> [f64; 8] {
    let weights = PHASES.map(|phase| {
        let within = (elapsed - phase.start) / (phase.end - phase.start);
        match within {
            0.0..=1.0 => phase.weight * (PI * within).sin().powi(2),
            _ => 0.0,
        }
    });
    let sum: f64 = weights.iter().sum();
    if sum == 0.0 {
        return weights;
    }
    // sin + 0.3 sin of three times the angle: two humps with the dip at 76 %, scaled to a peak of 1.
    let sine = (PI * elapsed).sin();
    let total = (1.9 * sine - 1.2 * sine.powi(3)) / 0.920_2;
    weights.map(|weight| total * weight / sum)
}

/// The largest share every region has during stance.
fn largest_shares() -> [f64; 8] {
    const SAMPLES: usize = 1000;
    let mut most = [0.0_f64; 8];
    for sample in 0..=SAMPLES {
        for (most, share) in most.iter_mut().zip(shares(sample as f64 / SAMPLES as f64)) {
            *most = most.max(share);
        }
    }
    most
}

/// A linear congruential generator (Knuth's MMIX constants): small, and the same everywhere.
struct Chance(u64);

impl Chance {
    /// Uniform between `1 - spread` and `1 + spread`.
    fn around_one(&mut self, spread: f64) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let unit = (self.0 >> 11) as f64 / (1u64 << 53) as f64;
        1.0 + spread * (2.0 * unit - 1.0)
    }
}

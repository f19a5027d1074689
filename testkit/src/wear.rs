//! Walks in shoes that press on the insole even when the foot is lifted: this residual pressure adds to that of the foot.

use plantar::faults::Faults;
use plantar::firmware::front_end::NOISE_CODES;
use plantar::insole::Insole;
use plantar::pipeline::bout::BoutRecord;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use recording::{Recording, VirtualInsole, synthetic};

/// The levels of the residual pressure, kPa.
pub const LEVELS_KPA: [f32; 5] = [0.5, 1.0, 2.0, 4.0, 8.0];

/// When and where the residual pressure acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Residual {
    /// On all cells, from the start.
    Everywhere,
    /// On a third of the cells, in patches with a side of 30 mm, from the start.
    Patches,
    /// On all cells, from the middle of the walk on.
    Appearing,
    /// On all cells, rising in proportion to time.
    Creeping,
    /// On all cells, until the middle of the walk.
    Released,
}

impl Residual {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::Everywhere, Self::Patches, Self::Appearing, Self::Creeping, Self::Released];

    /// Fraction of the residual pressure that acts on a cell at this place, mm, when this fraction of the walk is over.
    fn share(self, (x_mm, y_mm): (f64, f64), elapsed: f64) -> f32 {
        match self {
            Self::Everywhere => 1.0,
            Self::Patches => f32::from((x_mm / 30.0) as u32 % 3 == (y_mm / 30.0) as u32 % 3),
            Self::Appearing => f32::from(elapsed >= 0.5),
            Self::Creeping => elapsed as f32,
            Self::Released => f32::from(elapsed < 0.5),
        }
    }
}

/// Adds a residual pressure of `level_kpa` to a recording.
#[must_use]
pub fn with_residual(mut recording: Recording, residual: Residual, level_kpa: f32) -> Recording {
    let places: Vec<_> = recording.layout.cells.iter().map(|cell| (cell.x_mm, cell.y_mm)).collect();
    let frames = recording.frames() as f64;
    for (i, frame) in recording.pressure_kpa.chunks_exact_mut(places.len()).enumerate() {
        for (kpa, &place) in frame.iter_mut().zip(&places) {
            *kpa += level_kpa * residual.share(place, i as f64 / frames);
        }
    }
    recording
}

/// A step that an insole found.
#[derive(Clone, Copy, Debug)]
pub struct FoundStep {
    /// Index of its first frame in the recording.
    pub start: usize,
    /// Number of its frames.
    pub frames: usize,
    /// Largest total force, N.
    pub peak_n: f64,
}

/// What an insole found in a walk.
pub struct Found {
    /// The steps.
    pub steps: Vec<FoundStep>,
    /// The load bouts. One that is in progress at the end of the recording ends there.
    pub bouts: Vec<BoutRecord<f32>>,
    /// Force-time integral of all steps and bouts, N s.
    pub integral_n_s: f64,
    /// Total force in each frame, N.
    pub totals_n: Vec<f64>,
    /// The reported sensor faults.
    pub faults: Faults,
}

impl Found {
    /// Difference between the force-time integral of all frames and that of all steps and bouts, relative to the former: the
    /// share that is in no step or bout, or in more than one.
    pub fn unassigned(&self, rate_hz: f64) -> f64 {
        let frames_n_s = self.totals_n.iter().sum::<f64>() / rate_hz;
        (self.integral_n_s - frames_n_s).abs() / frames_n_s
    }
}

/// Passes a recording through an insole with these rules.
pub fn find(recording: &Recording, contact: ContactRule, stance: StanceRule) -> Found {
    let virtual_insole = VirtualInsole::new(recording, contact, stance);
    let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("a recording's insole is valid");
    let mut codes = vec![0; virtual_insole.cells.len()];
    let (mut steps, mut bouts, mut totals_n, mut integral_n_s) = (Vec::new(), Vec::new(), Vec::new(), 0.0);
    for i in 0..virtual_insole.frames(recording) {
        virtual_insole.codes_of(recording, i, &mut codes);
        let is_toe_off = insole.frame(i as u32, &codes);
        totals_n.push(insole.loads().iter().map(|load| f64::from(load.frame.force.force_n)).sum::<f64>());
        if is_toe_off && let Some(step) = insole.whole_step() {
            let period_us = u64::from(virtual_insole.setup.period_us);
            let start = (step.start_us / period_us) as usize;
            let frames = (u64::from(step.duration_us) / period_us) as usize;
            let peak_n = totals_n[start..start + frames].iter().copied().fold(0.0, f64::max);
            integral_n_s += step.regions.iter().map(|region| f64::from(region.measured_integral_n_s)).sum::<f64>();
            steps.push(FoundStep { start, frames, peak_n });
        }
        bouts.extend(insole.take_bout());
    }
    bouts.extend(std::iter::from_fn(|| insole.end_bout()));
    integral_n_s +=
        bouts.iter().flat_map(|bout| bout.regions).map(|region| f64::from(region.integral_n_s)).sum::<f64>();
    Found { steps, bouts, integral_n_s, totals_n, faults: insole.faults().clone() }
}

/// How an insole with a residual pressure compares with the same walk without it.
#[derive(Clone, Copy, Debug)]
pub struct WearResult {
    /// Number of steps that the insole finds without the residual pressure. They count as the steps that were walked.
    pub walked: usize,
    /// Number of them that it also finds with the residual pressure, with heel strike and toe off at most 40 ms earlier or
    /// later.
    pub found: usize,
    /// Number of other steps that it finds with the residual pressure.
    pub extra: usize,
    /// Number of reported sensor faults.
    pub faults: u32,
    /// Mean absolute deviation of the peak force of the found steps, relative to the peak without the residual pressure.
    pub force_error: f64,
}

/// Compares the steps that an insole finds in `walk` with a residual pressure added to it, and in `walk` itself.
pub fn compare(walk: &Recording, contact: ContactRule, residual: Residual, level_kpa: f32) -> WearResult {
    let truth = find(walk, contact, StanceRule::ADAPTIVE);
    let worn = find(&with_residual(walk.clone(), residual, level_kpa), contact, StanceRule::ADAPTIVE);
    let tolerance_frames = (0.04 * walk.rate_hz) as usize;
    let is_same = |a: &FoundStep, b: &FoundStep| {
        let ends = (a.start + a.frames, b.start + b.frames);
        a.start.abs_diff(b.start) <= tolerance_frames && ends.0.abs_diff(ends.1) <= tolerance_frames
    };
    let errors: Vec<f64> = truth
        .steps
        .iter()
        .filter_map(|step| {
            let found = worn.steps.iter().find(|found| is_same(step, found))?;
            Some((found.peak_n - step.peak_n).abs() / step.peak_n)
        })
        .collect();
    WearResult {
        walked: truth.steps.len(),
        found: errors.len(),
        extra: worn.steps.len() - errors.len(),
        faults: worn.faults.found,
        force_error: errors.iter().sum::<f64>() / errors.len().max(1) as f64,
    }
}

/// A computed walk with the noise of a sensor.
pub fn noisy_walk(walk: &synthetic::SyntheticWalk) -> Recording {
    let mut recording = synthetic::walk(walk).recording;
    let offsets = vec![0.0; recording.cells()];
    synthetic::add_sensor_errors(&mut recording, &offsets, NOISE_CODES, 7);
    recording
}

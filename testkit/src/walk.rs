//! The wearer of a simulated insole: walks and other activities that a test starts; also sensor faults, and incomplete frames, in
//! which some rows of the matrix do not answer.

use emulator::SensorFault;
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::{DEVICE_CELLS, Setup, SetupCell};
use plantar::pipeline::stance_rule::StanceRule;
use recording::synthetic::SyntheticWalk;
use recording::{VirtualInsole, synthetic};
use serde::Deserialize;
use std::rc::Rc;

/// Number of steps of the computed walk. A longer walk repeats it.
const LOOP_STEPS: usize = 8;

/// A computed walk as sensor codes.
pub struct Codes {
    virtual_insole: VirtualInsole,
    /// Number of cells.
    cells: usize,
    /// The codes of all cells, frame by frame.
    frames: Vec<u16>,
    /// The codes of the frame with the largest number of loaded cells.
    most_loaded: Vec<u16>,
    /// For each step, the number of frames from the start of the walk to the end of the swing phase after the step.
    step_ends: Vec<usize>,
}

impl Codes {
    /// A walk of a foot, sampled at this rate.
    ///
    /// # Panics
    /// If a swing phase of the computed walk is not unloaded.
    pub fn new(side: Side, rate_hz: f64) -> Self {
        let walk = SyntheticWalk { steps: LOOP_STEPS, side, rate_hz, ..SyntheticWalk::default() };
        let recording = synthetic::walk(&walk).recording;
        let virtual_insole = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
        let cells = virtual_insole.cells.len();
        let mut frames = vec![0; cells * recording.frames()];
        for (i, codes) in frames.chunks_exact_mut(cells).enumerate() {
            virtual_insole.codes_of(&recording, i, codes);
        }
        // The swing phase after a step ends when the next step begins.
        let is_loaded = |i: usize| frames[i * cells..(i + 1) * cells].iter().any(|&code| code > 0);
        let begins = (1..recording.frames()).filter(|&i| is_loaded(i) && !is_loaded(i - 1));
        let mut step_ends: Vec<_> = begins.skip(1).collect();
        step_ends.push(recording.frames());
        assert_eq!(step_ends.len(), LOOP_STEPS, "the swing phase after each step must be unloaded");
        let loaded = |codes: &&[u16]| codes.iter().filter(|code| **code > 0).count();
        let most_loaded = frames.chunks_exact(cells).max_by_key(loaded).unwrap_or_default().to_vec();
        Self { virtual_insole, cells, frames, most_loaded, step_ends }
    }

    /// Number of frames of the computed walk.
    fn frames(&self) -> usize {
        self.frames.len() / self.cells
    }

    /// Number of frames of a walk with this number of steps.
    fn walk_frames(&self, steps: u32) -> usize {
        let (loops, further_steps) = (steps as usize / LOOP_STEPS, steps as usize % LOOP_STEPS);
        loops * self.frames() + further_steps.checked_sub(1).map_or(0, |last| self.step_ends[last])
    }
}

/// An activity of a wearer other than walking.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Posture {
    /// The foot carries a constant load.
    Stand,
    /// The foot shifts its weight with a period of 1.2 s: the codes vary between 0.35 and 1.05 times those of the frame with the
    /// largest number of loaded cells. The smallest load is about a quarter of the largest one, because codes are not
    /// proportional to pressure.
    Shuffle,
    /// The foot carries little load.
    Sit,
}

impl Posture {
    /// The codes after this time, s, relative to those of the frame with the largest number of loaded cells.
    fn share(self, t_s: f64) -> f64 {
        match self {
            Self::Stand => 0.6,
            Self::Shuffle => 0.7 - 0.35 * (std::f64::consts::TAU * t_s / 1.2).cos(),
            Self::Sit => 0.12,
        }
    }
}

/// An activity of the wearer.
#[derive(Clone, Copy)]
struct Activity {
    /// `None`: the wearer walks.
    posture: Option<Posture>,
    /// Time of the first frame, us.
    from_us: u64,
    /// Number of frames.
    frames: usize,
}

/// The wearer of a simulated insole.
pub struct Wearer {
    codes: Rc<Codes>,
    /// The latest activity.
    activity: Option<Activity>,
    faults: Vec<SensorFault>,
    /// Number of remaining frames that are incomplete, and the first row for which the matrix does not answer in them.
    incomplete: Option<(u32, usize)>,
    /// True if the present frame is incomplete.
    is_frame_incomplete: bool,
}

impl Wearer {
    /// A wearer whose foot does not load the insole.
    pub fn new(codes: Rc<Codes>) -> Self {
        Self { codes, activity: None, faults: Vec::new(), incomplete: None, is_frame_incomplete: false }
    }

    /// The configuration of the insole.
    pub fn setup(&self) -> Setup {
        self.codes.virtual_insole.setup
    }

    /// The cells of the insole.
    pub fn cells(&self) -> impl Iterator<Item = SetupCell> + Clone + use<> {
        self.codes.virtual_insole.cells.clone().into_iter()
    }

    /// Begins a walk of this number of steps; returns the time of its end, us.
    pub fn walk(&mut self, now_us: u64, steps: u32) -> u64 {
        let frames = self.codes.walk_frames(steps);
        self.activity = Some(Activity { posture: None, from_us: now_us, frames });
        now_us + frames as u64 * u64::from(self.setup().period_us)
    }

    /// Begins to stand, shuffle or sit for this time.
    pub fn rest(&mut self, now_us: u64, posture: Posture, for_us: u64) {
        let frames = (for_us / u64::from(self.setup().period_us)) as usize;
        self.activity = Some(Activity { posture: Some(posture), from_us: now_us, frames });
    }

    /// Adds a sensor fault that begins now.
    pub fn add_fault(&mut self, fault: SensorFault, now_us: u64) {
        self.faults.push(SensorFault { from_s: now_us as f64 / 1e6, ..fault });
    }

    /// Prevents the matrix from answering for `from_row` and the rows after it, in the next `frames` frames.
    pub fn miss_frames(&mut self, frames: u32, from_row: usize) {
        self.incomplete = Some((frames, from_row));
    }

    /// Writes the present codes of all cells. Must be called once in each frame.
    pub fn codes_at(&mut self, now_us: u64, codes: &mut [u16; DEVICE_CELLS]) {
        let Codes { cells, frames, .. } = &*self.codes;
        let period_us = u64::from(self.codes.virtual_insole.setup.period_us);
        let activity = self.activity.map(|activity| (activity, ((now_us - activity.from_us) / period_us) as usize));
        match activity.filter(|(activity, frame)| *frame < activity.frames) {
            Some((Activity { posture: None, .. }, frame)) => {
                let at = frame % (frames.len() / cells) * cells;
                codes[..*cells].copy_from_slice(&frames[at..at + cells]);
            }
            Some((Activity { posture: Some(posture), .. }, frame)) => {
                let share = posture.share(frame as f64 * period_us as f64 * 1e-6);
                for (code, &most_loaded) in codes.iter_mut().zip(&self.codes.most_loaded) {
                    *code = (f64::from(most_loaded) * share) as u16;
                }
            }
            None => codes[..*cells].fill(0),
        }
        for fault in &self.faults {
            fault.apply(now_us as f64 / 1e6, &[0; DEVICE_CELLS][..*cells], &mut codes[..*cells]);
        }
        self.is_frame_incomplete = match &mut self.incomplete {
            Some((frames @ 1.., _)) => {
                *frames -= 1;
                true
            }
            _ => false,
        };
    }

    /// True if the matrix does not answer for this row of the present frame.
    pub fn is_row_missing(&self, row: usize) -> bool {
        self.is_frame_incomplete && self.incomplete.is_some_and(|(_, from_row)| row >= from_row)
    }
}

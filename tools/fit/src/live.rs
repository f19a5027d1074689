//! The steps of a live stream.
//!
//! An insole sends the area and the measured force of each region in every frame ([`Live`]) and a record of every step
//! ([`StepMessage`]). [`LiveSteps`] takes both in the order in which they arrive, and cuts the curves of each step out of the
//! frames. The curves differ from those of a recording in two respects: areas are rounded to 1 mm2 and forces to 0.1 N, and the
//! contact ellipse is that at the peak force instead of the mean over the stance.

use crate::steps::{ExcludedContact, ExclusionReason, FootEllipse, FrameLoads, exclude_partial, frame_curves, peak_n};
use crate::{MIN_FORCE_N, RegionCurves, Step};
use plantar::pipeline::contact::ContactRule;
use plantar::protocol::{Live, LiveRegion, Step as StepMessage, StepRegion};
use plantar::sequence::is_after;
use plantar::{Region, Side};
use std::collections::{BTreeSet, VecDeque};

/// Largest number of successive frames of a step that may be missing. They are interpolated linearly, as the insole does. The
/// insole itself bridges up to five frames ([`plantar::pipeline::stance::BRIDGED_FRAMES`]); a fit needs the curves more exactly
/// than a step record does.
pub const INTERPOLATED_FRAMES: u64 = 3;

/// Smallest number of steps from which the side of an insole is judged.
const MIRRORED_STEPS: usize = 5;
/// See [`LiveSteps::looks_mirrored`].
const MIRRORED_SHARE: f64 = 0.8;

/// Time for which frames are buffered, us. A record arrives within a second after its last frame, unless the link is congested.
const BUFFERED_US: u64 = 20_000_000;

/// Collects the steps of one insole from its messages.
#[derive(Clone, Debug, Default)]
pub struct LiveSteps {
    /// The latest frames, in increasing order of time.
    frames: VecDeque<Frame>,
    /// Time of the first frame that was received since the insole started, us; `None` before this frame.
    first_us: Option<u64>,
    /// Smallest time between two frames so far, us.
    period_us: Option<u64>,
    /// Records that arrived before the last frame of their stance.
    pending: Vec<StepMessage>,
    /// The records since the last hello, until the first frame after it shows whether the insole has restarted; `None` after this
    /// frame.
    since_hello: Option<Vec<StepMessage>>,
    /// Number and start time (us) of the last record of this boot; `None` before this record.
    last_record: Option<(u32, u64)>,
    /// Number, start time (us) and duration (us) of all records, by which a repeated record is recognised.
    received: BTreeSet<(u32, u64, u32)>,
    /// The different contact rules of the steps of this stream. Steps from before the stream may have other rules, which are not
    /// listed.
    contact_rules: Vec<ContactRule>,
    /// The foot of the last record.
    side: Option<Side>,
    /// See [`LiveSteps::masked_steps`].
    masked_steps: [usize; 8],
    /// Number of steps of this stream, and the number of these steps in which the peak force of toes 3-5 is larger than that of
    /// the hallux and than [`MIN_FORCE_N`].
    toes: [usize; 2],
    /// The steps with complete curves, including partially loaded ones.
    steps: Vec<Step>,
    excluded: Vec<ExcludedContact>,
}

/// The part of a live frame that a fit uses.
#[derive(Clone, Copy, Debug)]
struct Frame {
    t_us: u64,
    /// Area and force of each region, as the integers of the message: in mm2 and in 0.1 N.
    regions: [LiveRegion; 8],
}

impl LiveSteps {
    /// Creates a collector that has not received a message.
    pub fn new() -> Self {
        Self::default()
    }

    /// To be called for each [`Hello`](plantar::protocol::Hello), the first message of a session. If the insole has restarted
    /// before it, the records of the new boot arrive before the first live frame, and must not be combined with frames of the
    /// former boot that have the same times.
    pub fn session_started(&mut self) {
        if !self.frames.is_empty() {
            self.since_hello.get_or_insert_default();
        }
    }

    /// Adds a live frame. A frame with the time of the previous frame is ignored. A frame with an earlier time means that the
    /// insole restarted or that a stored stream is repeated: all pending records are evaluated, and the buffered frames are
    /// deleted.
    pub fn frame(&mut self, live: &Live) {
        let held = self.since_hello.take().unwrap_or_default();
        let last_us = self.frames.back().map(|last| last.t_us);
        if last_us == Some(live.t_us) && held.is_empty() {
            return;
        }
        if last_us.is_some_and(|last_us| live.t_us < last_us) || held.iter().any(|step| self.is_of_new_boot(step)) {
            self.restart();
        } else if let Some(elapsed_us) = last_us.map(|last_us| live.t_us - last_us).filter(|us| *us > 0) {
            self.period_us = Some(self.period_us.map_or(elapsed_us, |period_us| period_us.min(elapsed_us)));
        }
        self.first_us.get_or_insert(live.t_us);
        if self.frames.back().is_none_or(|last| last.t_us < live.t_us) {
            self.frames.push_back(Frame { t_us: live.t_us, regions: live.regions });
        }
        while self.frames.front().is_some_and(|frame| live.t_us - frame.t_us > BUFFERED_US) {
            self.frames.pop_front();
        }
        held.iter().for_each(|step| self.add(step));
        self.evaluate_pending(Some(live.t_us));
    }

    /// Adds the record of a step. A record that was already received is ignored.
    pub fn step(&mut self, step: &StepMessage) {
        if !self.received.insert((step.step, step.start_us, step.duration_us)) {
            return;
        }
        self.side = Some(step.side);
        for (count, region) in self.masked_steps.iter_mut().zip(&step.regions) {
            *count += usize::from(region.masked_cells > 0);
        }
        if step.boots_since > 0 {
            self.exclude(step, ExclusionReason::BeforeRestart);
        } else if let Some(held) = &mut self.since_hello {
            held.push(*step);
        } else {
            self.add(step);
        }
    }

    /// Adds the record of a step of this boot.
    fn add(&mut self, step: &StepMessage) {
        self.last_record = Some((step.step, step.start_us));
        if self.first_us.is_none_or(|first_us| step.start_us < first_us) {
            self.exclude(step, ExclusionReason::BeforeStream);
            return;
        }
        if !self.contact_rules.contains(&step.contact_rule) {
            self.contact_rules.push(step.contact_rule);
        }
        let peak_n = |region: Region| step.regions[region as usize].measured_force_peak_n();
        let toes_35_n = peak_n(Region::Toes35);
        self.toes[0] += 1;
        self.toes[1] += usize::from(toes_35_n > MIN_FORCE_N && toes_35_n > peak_n(Region::Hallux));
        self.pending.push(*step);
        self.evaluate_pending(self.frames.back().map(|last| last.t_us));
    }

    /// True if a record with a later number has an earlier time than the last record: only a restart sets the time back.
    fn is_of_new_boot(&self, step: &StepMessage) -> bool {
        self.last_record.is_some_and(|(number, start_us)| is_after(step.step, number) && step.start_us < start_us)
    }

    /// Evaluates all pending records, and forgets everything about the boot before this moment.
    fn restart(&mut self) {
        self.evaluate_pending(None);
        self.frames.clear();
        // The insole may have restarted with another frame rate.
        (self.first_us, self.period_us, self.last_record) = (None, None, None);
    }

    /// Evaluates the records of which the last frames are missing. To be called after the last message. Records that arrived
    /// after a hello, but were not followed by a frame, are excluded.
    pub fn finish(&mut self) {
        self.evaluate_pending(None);
        for step in self.since_hello.take().unwrap_or_default() {
            self.exclude(&step, ExclusionReason::BeforeStream);
        }
    }

    /// The steps that a fit may use, and the excluded contacts in the order of their times. Partially loaded steps are recognised
    /// by their peak force relative to the median peak force of all steps so far, so that a step can be excluded by later steps.
    /// `recording` is the index of the insole in the study.
    pub fn collected(&self, recording: usize) -> (Vec<Step>, Vec<ExcludedContact>) {
        let (mut steps, mut excluded) = (self.steps.clone(), self.excluded.clone());
        steps.iter_mut().for_each(|step| step.recording = recording);
        excluded.iter_mut().for_each(|contact| contact.recording = recording);
        exclude_partial(&mut steps, &mut excluded);
        (steps, excluded)
    }

    /// Number of steps that were evaluated so far, usable or not. The result of [`LiveSteps::collected`] changes only when this
    /// number changes.
    pub fn evaluated(&self) -> usize {
        self.steps.len() + self.excluded.len()
    }

    /// The contact rules by which the areas were measured, without repetitions. Steps of different rules cannot be fitted
    /// together.
    pub fn contact_rules(&self) -> &[ContactRule] {
        &self.contact_rules
    }

    /// The foot according to the last record; `None` without records.
    pub fn side(&self) -> Option<Side> {
        self.side
    }

    /// Frames per second; 0 before the second frame.
    pub fn rate_hz(&self) -> f64 {
        self.period_us.map_or(0.0, |period_us| 1e6 / period_us as f64)
    }

    /// True if the insole seems to lie under the other foot: in at least four fifths of at least five steps, the peak force of
    /// toes 3-5 is larger than that of the hallux and than [`MIN_FORCE_N`]. This is so in none of 120 steps of ten barefoot
    /// walkers (data set SpeedPP2DS).
    pub fn looks_mirrored(&self) -> bool {
        let [steps, mirrored] = self.toes;
        steps >= MIRRORED_STEPS && mirrored as f64 >= MIRRORED_SHARE * steps as f64
    }

    /// For each region, the number of steps with masked cells. The insole has replaced their readings by those of their
    /// neighbours. The insole on which [`crate::steps::isolate`] replays a recording masks cells in the same way.
    pub fn masked_steps(&self) -> [usize; 8] {
        self.masked_steps
    }

    fn exclude(&mut self, step: &StepMessage, reason: ExclusionReason) {
        self.excluded.push(ExcludedContact { recording: 0, at_s: step.start_us as f64 * 1e-6, reason });
    }

    /// Evaluates the pending records whose frames have all arrived. `now_us` is the time of the newest frame; without it, all
    /// pending records are evaluated.
    fn evaluate_pending(&mut self, now_us: Option<u64>) {
        let mut i = 0;
        while let Some(&step) = self.pending.get(i) {
            let end_us = step.start_us.saturating_add(step.duration_us.into());
            let period_us = self.period_us.unwrap_or(0).min(u64::from(step.sample_us));
            if now_us.is_some_and(|now_us| now_us.saturating_add(period_us) < end_us) {
                i += 1;
                continue;
            }
            self.pending.remove(i);
            match self.evaluate(&step) {
                Some(step) => self.steps.push(step),
                None => self.exclude(&step, ExclusionReason::Broken),
            }
        }
    }

    /// Cuts the curves of a step out of the frames. `None` if more than [`INTERPOLATED_FRAMES`] successive frames are missing, if
    /// the first or last ones are not buffered, if the step's times are not multiples of the time between frames, or if no frame
    /// is missing, but the frames have other peak forces than the record.
    fn evaluate(&self, step: &StepMessage) -> Option<Step> {
        let sample_us = u64::from(step.sample_us);
        let period_us = self.period_us?.min(sample_us);
        let is_multiple = |us: u64| us > 0 && us.is_multiple_of(period_us);
        if period_us == 0 || !is_multiple(sample_us) || !is_multiple(step.duration_us.into()) {
            return None;
        }
        let count = u64::from(step.duration_us) / period_us;
        let frames = (0..count).map(|i| self.loads_at(step.start_us.saturating_add(i * period_us), period_us));
        let frames = frames.collect::<Option<Vec<FrameLoads>>>()?;
        // In a long stance, the insole stores only every second frame, then every fourth, and so on.
        let (frame_s, stride) = (period_us as f64 * 1e-6, (sample_us / period_us) as usize);
        let end_us = step.start_us.saturating_add(step.duration_us.into());
        let received = self.frames.iter().filter(|frame| (step.start_us..end_us).contains(&frame.t_us)).count();
        if received == frames.len() && !have_peaks_of(&frames, stride, step) {
            return None;
        }
        let regions = std::array::from_fn(|region| {
            let curves = frame_curves(&frames, region, frame_s);
            let ellipse = ellipse_at_peak(&step.regions[region]);
            let at_peak = (0..frames.len()).max_by(|&a, &b| frames[a][region].1.total_cmp(&frames[b][region].1));
            let peak_area_mm2 = at_peak.map(|i| frames[i][region].0).filter(|&mm2| mm2 > 0.0);
            let stored = |curve: &[f64]| curve.iter().copied().step_by(stride).collect();
            RegionCurves {
                area_mm2: stored(&curves.frame_area_mm2),
                force_n: stored(&curves.frame_force_n),
                sample_s: frame_s * stride as f64,
                saturated: step.saturated >> region & 1 == 1,
                record: step.regions[region],
                ellipse,
                ellipse_ratio: ellipse.zip(peak_area_mm2).map(|(ellipse, mm2)| ellipse.area_mm2() / mm2),
                ..curves
            }
        });
        Some(Step {
            recording: 0,
            number: step.step,
            side: step.side,
            start_s: step.start_us as f64 * 1e-6,
            duration_s: f64::from(step.duration_us) * 1e-6,
            peak_n: peak_n(&frames),
            regions,
        })
    }

    /// The loads at the time `t_us`, which are interpolated if its frame is missing. `None` if more than
    /// [`INTERPOLATED_FRAMES`] successive frames are missing there, or no frame is buffered before or after this time.
    fn loads_at(&self, t_us: u64, period_us: u64) -> Option<FrameLoads> {
        let index = self.frames.partition_point(|frame| frame.t_us < t_us);
        let after = self.frames.get(index)?;
        let measured = |frame: &Frame, region: usize| {
            let region = &frame.regions[region];
            (region.area_mm2(), region.measured_force_n())
        };
        if after.t_us == t_us {
            return Some(std::array::from_fn(|region| {
                let (area_mm2, force_n) = measured(after, region);
                (area_mm2, force_n, None)
            }));
        }
        let before = self.frames.get(index.checked_sub(1)?)?;
        let elapsed_us = after.t_us - before.t_us;
        if elapsed_us > (INTERPOLATED_FRAMES + 1) * period_us {
            return None;
        }
        let part = (t_us - before.t_us) as f64 / elapsed_us as f64;
        Some(std::array::from_fn(|region| {
            let (from, to) = (measured(before, region), measured(after, region));
            (from.0 + (to.0 - from.0) * part, from.1 + (to.1 - from.1) * part, None)
        }))
    }
}

/// True if the frames of a stance have the peak forces of its record, within the resolution of the messages. Frames of another
/// boot of the insole can have the same times, if its restart was not recognised. The peak of a record is at least that of the
/// stored samples, which are every `stride`-th frame, from the first to the last one in contact, and at most that of all frames;
/// that of a region without contact is 0.
fn have_peaks_of(frames: &[FrameLoads], stride: usize, step: &StepMessage) -> bool {
    /// The record and the frames are rounded to 0.1 N each.
    const RESOLUTION_N: f64 = 0.2;
    let samples: Vec<&FrameLoads> = frames.iter().step_by(stride).collect();
    step.regions.iter().enumerate().all(|(region, record)| {
        let recorded_n = record.measured_force_peak_n();
        // An area of less than 0.5 mm2 is 0 in a frame, so the contact may be longer.
        let in_contact = |sample: &&FrameLoads| sample[region].0 > 0.0;
        let first = samples.iter().position(in_contact).unwrap_or(samples.len());
        let end = samples.iter().rposition(in_contact).map_or(first, |last| last + 1);
        let least_n = samples[first..end].iter().map(|sample| sample[region].1).fold(0.0, f64::max);
        let most_n = frames.iter().map(|frame| frame[region].1).fold(0.0, f64::max);
        recorded_n >= least_n - RESOLUTION_N && recorded_n <= most_n + RESOLUTION_N
    })
}

/// The contact ellipse at the peak force, from a record; `None` without contact.
fn ellipse_at_peak(region: &StepRegion) -> Option<FootEllipse> {
    let ellipse = FootEllipse {
        x_mm: region.ellipse_x_mm(),
        y_mm: region.ellipse_y_mm(),
        r_a_mm: region.ellipse_r_a_mm(),
        r_b_mm: region.ellipse_r_b_mm(),
        angle_deg: region.ellipse_angle_deg(),
    };
    (ellipse.r_a_mm > 0.0 && ellipse.r_b_mm > 0.0).then_some(ellipse)
}

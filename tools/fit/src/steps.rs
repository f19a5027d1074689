//! The steps of a fit: their curves, and the contacts that are excluded because they are not complete steps, with the reason.
//! [`isolate`] extracts them from a recording, [`crate::live`] from the messages of an insole.

#[cfg(feature = "recordings")]
pub use crate::isolate::{IsolateError, isolate};

use crate::quality::largest;
use plantar::Side;
use plantar::protocol::StepRegion;
use std::fmt;

/// A filter of the contact area before the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// The filter of the step record of an insole: the area as measured, and the deformation rate over 20 ms; see
    /// [`plantar::pipeline::step`].
    Direct,
    /// The filter of the live stream of an insole: the mean of the last three frames, and the difference to the previous frame.
    Live,
    /// The smoothing of the paper, for comparison: a three-point mean and a polynomial of 5th order over the contact phase, and
    /// the difference to the next sample (Eq. 16). No insole evaluates it.
    Smoothed,
}

impl Filter {
    /// Name in files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Direct => "direct",
            Self::Live => "live",
            Self::Smoothed => "smoothed",
        }
    }
}

/// The curves of one region in one step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RegionCurves {
    /// Contact area, mm2: the input of all filters but [`Filter::Live`].
    pub area_mm2: Vec<f64>,
    /// Measured force at the same times, N.
    pub force_n: Vec<f64>,
    /// Time between these samples, s. It is the frame period, or a multiple of the frame period in a long stance.
    pub sample_s: f64,
    /// Contact area of every frame, mm2: the input of the live filter.
    pub frame_area_mm2: Vec<f64>,
    /// Measured force of every frame, N.
    pub frame_force_n: Vec<f64>,
    /// Time between frames, s.
    pub frame_s: f64,
    /// True if a cell of the region was saturated.
    pub saturated: bool,
    /// True if the region has a single cell: its area then follows from its force by the contact rule.
    pub has_single_cell: bool,
    /// Mean contact ellipse over the stance, weighted by force; for a live stream, the contact ellipse at the peak force.
    /// `None` without contact.
    pub ellipse: Option<FootEllipse>,
    /// Area of the contact ellipse divided by the contact area, mean over the stance, weighted by force; for a live stream, the
    /// value at the peak force. `None` without contact.
    pub ellipse_ratio: Option<f64>,
    /// The record of the region in the resolution of messages. Only its measured values are used: those of the model are of the
    /// parameters that the insole has.
    pub record: StepRegion,
}

/// A contact ellipse in foot coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FootEllipse {
    /// Centre along the medial-lateral axis, mm.
    pub x_mm: f64,
    /// Centre along the heel-toe axis, mm.
    pub y_mm: f64,
    /// Radius along the axis X of the paper, which is the axis of the ellipse nearer to the medial-lateral axis, mm.
    pub r_a_mm: f64,
    /// Radius along the axis Y of the paper, which is the axis of the ellipse nearer to the heel-toe axis, mm.
    pub r_b_mm: f64,
    /// Angle from the medial-lateral axis to the axis X, -45 to 45 degrees.
    pub angle_deg: f64,
}

impl FootEllipse {
    /// The weighted mean of ellipses, which are given with their weights. `None` if the weights add up to 0. The mean of the
    /// radii is geometric, so that the mean aspect ratio does not favour an axis.
    pub fn of(weighted: impl IntoIterator<Item = (f64, Self)>) -> Option<Self> {
        let mut sum = Self::default();
        let mut weights = 0.0;
        for (weight, e) in weighted {
            sum.x_mm += weight * e.x_mm;
            sum.y_mm += weight * e.y_mm;
            sum.r_a_mm += weight * e.r_a_mm.ln();
            sum.r_b_mm += weight * e.r_b_mm.ln();
            sum.angle_deg += weight * e.angle_deg;
            weights += weight;
        }
        (weights > 0.0).then(|| Self {
            x_mm: sum.x_mm / weights,
            y_mm: sum.y_mm / weights,
            r_a_mm: (sum.r_a_mm / weights).exp(),
            r_b_mm: (sum.r_b_mm / weights).exp(),
            angle_deg: sum.angle_deg / weights,
        })
    }

    /// Area of the ellipse, mm2.
    pub fn area_mm2(&self) -> f64 {
        std::f64::consts::PI * self.r_a_mm * self.r_b_mm
    }

    /// The mean over steps, weighted by the peak force of the region in each step.
    pub fn of_steps<'c>(curves: impl IntoIterator<Item = &'c RegionCurves>) -> Option<Self> {
        Self::of(curves.into_iter().filter_map(|curve| Some((largest(&curve.force_n), curve.ellipse?))))
    }
}

impl RegionCurves {
    /// The input of a filter: area (mm2), force (N) and the time between samples (s).
    pub fn of(&self, filter: Filter) -> (&[f64], &[f64], f64) {
        match filter {
            Filter::Direct | Filter::Smoothed => (&self.area_mm2, &self.force_n, self.sample_s),
            Filter::Live => (&self.frame_area_mm2, &self.frame_force_n, self.frame_s),
        }
    }
}

/// See [`crate::RegionFit::ellipse_misfit`].
pub(crate) fn ellipse_misfit<'c>(curves: impl IntoIterator<Item = &'c RegionCurves>) -> Option<f64> {
    let (mut ratios, mut weights) = (0.0, 0.0);
    for curve in curves {
        if let Some(ratio) = curve.ellipse_ratio {
            let peak_n = largest(&curve.force_n);
            ratios += peak_n * ratio;
            weights += peak_n;
        }
    }
    (weights > 0.0).then(|| ratios / weights - 1.0)
}

/// One step.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Index of the recording.
    pub recording: usize,
    /// Number of the step's record. Steps, load bouts and alerts are numbered in one sequence: in a recording from 0, in a live
    /// stream by the insole that sent them.
    pub number: u32,
    /// The foot.
    pub side: Side,
    /// Time of heel strike, s, on the clock of the recording; for a live stream, on the clock of the insole.
    pub start_s: f64,
    /// Stance time, heel strike to toe off, s.
    pub duration_s: f64,
    /// Largest force on the whole foot, N.
    pub peak_n: f64,
    /// The curves of the regions, in the order of [`plantar::Region::ALL`].
    pub regions: [RegionCurves; 8],
}

/// A contact that was excluded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExcludedContact {
    /// Index of the recording.
    pub recording: usize,
    /// Time of the contact, s, on the clock of [`Step::start_s`].
    pub at_s: f64,
    /// The reason.
    pub reason: ExclusionReason,
}

/// The remedy for a recording in which the foot never leaves the ground.
pub const LIFT_THE_FOOT: &str = "record a walk, in which the foot leaves the ground between the steps; if it did, the cells read a \
                                 load without the foot, which the zero file of `plantar zero` subtracts";

/// The reason why a contact was excluded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ExclusionReason {
    /// The foot is on the ground in all frames, so the recording contains no step.
    NeverLifted,
    /// The foot is on the ground in the first frame, so the heel strike is missing.
    NoHeelStrike,
    /// The foot is on the ground in the last frame, so the toe off is missing.
    NoToeOff,
    /// Shorter than a step, or a scuff: see [`plantar::pipeline::stance_rule::Rejected::short`].
    Short,
    /// Longer than a step, because the person stands.
    Long,
    /// Frames are missing in the contact; for a live stream, also: the frames do not agree with the record of the step.
    Broken,
    /// The step was recorded before the insole restarted, so its frames are not among those since the restart.
    BeforeRestart,
    /// The step began before the live stream, so not all of its frames were received.
    BeforeStream,
    /// The foot was loaded only partially. The value is the peak force divided by the median peak force of the recording.
    Partial(f64),
}

impl ExclusionReason {
    /// True if the beginning or the end of the recording cuts the contact off.
    pub fn is_cut_off(&self) -> bool {
        matches!(self, Self::NeverLifted | Self::NoHeelStrike | Self::NoToeOff)
    }
}

impl fmt::Display for ExclusionReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NeverLifted => write!(f, "on the ground from the first to the last frame: {LIFT_THE_FOOT}"),
            Self::NoHeelStrike => f.write_str("on the ground from the first frame on: its heel strike is missing"),
            Self::NoToeOff => f.write_str("on the ground until the last frame: its toe off is missing"),
            Self::Short => f.write_str("shorter than a step"),
            Self::Long => f.write_str("longer than a step: standing"),
            Self::Broken => f.write_str("frames are missing in it, or do not agree with its record"),
            Self::BeforeRestart => {
                f.write_str("recorded before the insole restarted: its frames are not among those since the restart")
            }
            Self::BeforeStream => f.write_str("began before the live stream: its first frames were not received"),
            Self::Partial(share) => {
                write!(f, "partial: its peak force is {:.0} % of the recording's median", share * 100.0)
            }
        }
    }
}

/// The median; 0 if there are no values.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        n => (values[(n - 1) / 2] + values[n / 2]) / 2.0,
    }
}

/// The loads of the regions in one frame: the area, mm2, the force, N, and the contact ellipse of each region.
pub(crate) type FrameLoads = [(f64, f64, Option<FootEllipse>); 8];

/// The largest force on the whole foot in `frames`, N.
pub(crate) fn peak_n(frames: &[FrameLoads]) -> f64 {
    let total = |frame: &FrameLoads| frame.iter().map(|(_, force, _)| force).sum::<f64>();
    frames.iter().map(total).fold(0.0, f64::max)
}

/// The curves of a region from the frames of a stance. The fields that are the input of [`Filter::Direct`] and
/// [`Filter::Smoothed`] have their default values; the caller sets them. `frame_s` is the time between frames, s.
pub(crate) fn frame_curves(frames: &[FrameLoads], region: usize, frame_s: f64) -> RegionCurves {
    let weighted = frames.iter().filter_map(|frame| Some((frame[region].1, frame[region].2?)));
    let ellipse = FootEllipse::of(weighted);
    let (mut ratios, mut weights) = (0.0, 0.0);
    for (area_mm2, force_n, ellipse) in frames.iter().map(|frame| frame[region]) {
        if let Some(ellipse) = ellipse.filter(|_| area_mm2 > 0.0) {
            ratios += force_n * ellipse.area_mm2() / area_mm2;
            weights += force_n;
        }
    }
    RegionCurves {
        frame_area_mm2: frames.iter().map(|frame| frame[region].0).collect(),
        frame_force_n: frames.iter().map(|frame| frame[region].1).collect(),
        frame_s,
        ellipse,
        ellipse_ratio: (weights > 0.0).then_some(ratios / weights),
        ..RegionCurves::default()
    }
}

/// A step counts as partially loaded if its peak force is below this fraction of the median peak force of the recording.
const PARTIAL: f64 = 0.6;

/// Moves the partially loaded steps of one recording from `steps` to `excluded`, and sorts the excluded contacts by time.
pub(crate) fn exclude_partial(steps: &mut Vec<Step>, excluded: &mut Vec<ExcludedContact>) {
    let median_n = median(steps.iter().map(|step| step.peak_n));
    steps.retain(|step| {
        let share = step.peak_n / median_n;
        let is_whole = share >= PARTIAL;
        if !is_whole {
            excluded.push(ExcludedContact {
                recording: step.recording,
                at_s: step.start_s,
                reason: ExclusionReason::Partial(share),
            });
        }
        is_whole
    });
    excluded.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
}

//! Steps out of recordings, isolated by the insole's own code, and which contacts were left out and why.

use crate::quality::largest;
use plantar::Side;
use plantar::insole::Insole;
use plantar::pipeline::stance::Rejected;
use recording::{MAX_CELLS, Recording, VirtualInsole};
use std::fmt;

/// Through which of the device's filters area is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// The step record's: three-point mean and a quintic over the contact phase, rate by Eq. 16.
    Step,
    /// The live stream's: mean of three frames, rate by the backward difference.
    Live,
}

impl Filter {
    /// In a word, for files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Step => "step",
            Self::Live => "live",
        }
    }
}

/// One region's curves in one step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RegionCurves {
    /// What the step filter works on: contact area, mm2.
    pub area_mm2: Vec<f64>,
    /// Measured force at the same times, N.
    pub force_n: Vec<f64>,
    /// Time between these samples, s: the frame time, or a multiple in a long stance.
    pub sample_s: f64,
    /// What the live filter works on: area of every frame, mm2.
    pub frame_area_mm2: Vec<f64>,
    /// Measured force of every frame, N.
    pub frame_force_n: Vec<f64>,
    /// Time between frames, s.
    pub frame_s: f64,
    /// A cell of this region was at the end of its scale.
    pub saturated: bool,
    /// Contact ellipse, mean over the stance weighted by force; `None` without contact.
    pub ellipse: Option<MeanEllipse>,
}

/// A contact ellipse in foot coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeanEllipse {
    /// Centre, medial-lateral, mm.
    pub x_mm: f64,
    /// Centre, heel-toe, mm.
    pub y_mm: f64,
    /// Radius along the paper's X (nearer to the medial-lateral axis), mm.
    pub r_a_mm: f64,
    /// Radius along the paper's Y (nearer to the heel-toe axis), mm.
    pub r_b_mm: f64,
    /// Angle from the medial-lateral axis to the first radius, -45 to 45 degrees.
    pub angle_deg: f64,
}

impl MeanEllipse {
    /// The mean of ellipses with their weights; radii in logarithms, so that the mean aspect does not favour either.
    pub fn of(weighed: impl IntoIterator<Item = (f64, Self)>) -> Option<Self> {
        let mut sum = Self::default();
        let mut all = 0.0;
        for (weight, e) in weighed {
            sum.x_mm += weight * e.x_mm;
            sum.y_mm += weight * e.y_mm;
            sum.r_a_mm += weight * e.r_a_mm.ln();
            sum.r_b_mm += weight * e.r_b_mm.ln();
            sum.angle_deg += weight * e.angle_deg;
            all += weight;
        }
        (all > 0.0).then(|| Self {
            x_mm: sum.x_mm / all,
            y_mm: sum.y_mm / all,
            r_a_mm: (sum.r_a_mm / all).exp(),
            r_b_mm: (sum.r_b_mm / all).exp(),
            angle_deg: sum.angle_deg / all,
        })
    }

    /// The mean over steps, each weighed by its peak force.
    pub fn of_steps<'c>(curves: impl IntoIterator<Item = &'c RegionCurves>) -> Option<Self> {
        Self::of(curves.into_iter().filter_map(|curve| Some((largest(&curve.force_n), curve.ellipse?))))
    }
}

impl RegionCurves {
    /// Area (mm2), force (N) and the time between samples (s) that a filter works on.
    pub fn of(&self, filter: Filter) -> (&[f64], &[f64], f64) {
        match filter {
            Filter::Step => (&self.area_mm2, &self.force_n, self.sample_s),
            Filter::Live => (&self.frame_area_mm2, &self.frame_force_n, self.frame_s),
        }
    }
}

/// One step.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Which of the recordings.
    pub recording: usize,
    /// Counts the steps of that recording, as the insole does.
    pub number: u32,
    /// The foot.
    pub side: Side,
    /// Heel strike, s on the recording's clock.
    pub start_s: f64,
    /// Heel strike to toe off, s.
    pub duration_s: f64,
    /// Largest force on the whole foot, N.
    pub peak_n: f64,
    /// In the order of [`plantar::Region::ALL`].
    pub regions: [RegionCurves; 8],
}

/// A contact that is not used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// Which of the recordings.
    pub recording: usize,
    /// When it was seen, s on the recording's clock.
    pub at_s: f64,
    /// Why.
    pub why: Why,
}

/// Why a contact is not used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Why {
    /// On the ground from the first frame on: heel strike is missing.
    NoHeelStrike,
    /// On the ground until the last frame: toe off is missing.
    NoToeOff,
    /// Shorter than a step.
    Short,
    /// Longer than a step: standing.
    Long,
    /// Frames are missing in it.
    Broken,
    /// The foot was loaded only in part: peak force over the recording's median.
    Partial(f64),
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoHeelStrike => f.write_str("on the ground from the first frame on: its heel strike is missing"),
            Self::NoToeOff => f.write_str("on the ground until the last frame: its toe off is missing"),
            Self::Short => f.write_str("shorter than a step"),
            Self::Long => f.write_str("longer than a step: standing"),
            Self::Broken => f.write_str("frames are missing in it"),
            Self::Partial(share) => {
                write!(f, "partial: its peak force is {:.0} % of the recording's median", share * 100.0)
            }
        }
    }
}

/// A step with less than this share of the median peak force was loaded only in part.
const PARTIAL: f64 = 0.6;

/// The steps of a recording worn as `worn`, and the contacts that were left out. `progress` is told frames done.
pub fn isolate(
    recording: &Recording,
    worn: &VirtualInsole,
    index: usize,
    progress: &mut dyn FnMut(usize),
) -> Result<(Vec<Step>, Vec<LeftOut>), plantar::pipeline::setup::SetupError> {
    let mut insole = Box::new(Insole::<f64, MAX_CELLS>::new());
    insole.set_up(worn.setup, worn.cells.iter().copied())?;
    let mut codes = vec![0; worn.cells.len()];
    let (mut steps, mut left_out) = (Vec::new(), Vec::new());
    let mut contact = Contact::default();
    let (mut rejected, mut starts_loaded) = (insole.rejected(), false);
    let period_s = f64::from(worn.setup.period_us) * 1e-6;
    let first_s = recording.t_s.first().copied().unwrap_or(0.0);
    let longest = (u32::from(worn.setup.stance.max_stance_ms) * 1000 / worn.setup.period_us) as usize
        + (u32::from(worn.setup.stance.min_swing_ms) * 1000 / worn.setup.period_us) as usize;
    let count = worn.frames(recording);
    for i in 0..count {
        worn.codes_of(recording, i, &mut codes);
        let was_on_ground = insole.on_ground();
        let toe_off = insole.frame(i as u32, &codes);
        if insole.on_ground() && !was_on_ground {
            contact.clear();
            contact.start = i;
            starts_loaded = i == 0;
        }
        // A contact that is longer than a step is not looked at again.
        if insole.on_ground() && contact.frames.len() <= longest {
            contact.push(&insole);
        }
        let mut leave = |why, frame: usize| {
            left_out.push(LeftOut { recording: index, at_s: first_s + frame as f64 * period_s, why });
        };
        if let Some(why) = new_rejection(&rejected, &insole.rejected()) {
            leave(why, contact.start);
        }
        rejected = insole.rejected();
        if was_on_ground && !insole.on_ground() && !toe_off && starts_loaded {
            leave(Why::NoHeelStrike, 0);
            starts_loaded = false;
        }
        if toe_off && let Some(record) = insole.whole_step() {
            let frames = (record.duration_us / worn.setup.period_us) as usize;
            let regions = std::array::from_fn(|region| {
                let curves = contact.region(region, frames, period_s);
                let (area_mm2, force_n, sample_s) = insole.curves(region);
                RegionCurves {
                    area_mm2: area_mm2.to_vec(),
                    force_n: force_n.to_vec(),
                    sample_s,
                    saturated: record.saturated >> region & 1 == 1,
                    ..curves
                }
            });
            steps.push(Step {
                recording: index,
                number: record.step,
                side: record.side,
                start_s: first_s + record.start_us as f64 * 1e-6,
                duration_s: f64::from(record.duration_us) * 1e-6,
                peak_n: contact.peak_n(frames),
                regions,
            });
        }
        if i % 1024 == 0 {
            progress(i.min(recording.frames()));
        }
    }
    if insole.on_ground() {
        let why = if starts_loaded { Why::NoHeelStrike } else { Why::NoToeOff };
        left_out.push(LeftOut { recording: index, at_s: first_s + contact.start as f64 * period_s, why });
    }
    let median_n = median(steps.iter().map(|step| step.peak_n));
    steps.retain(|step| {
        let share = step.peak_n / median_n;
        let is_whole = share >= PARTIAL;
        if !is_whole {
            left_out.push(LeftOut { recording: index, at_s: step.start_s, why: Why::Partial(share) });
        }
        is_whole
    });
    left_out.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    Ok((steps, left_out))
}

fn new_rejection(before: &Rejected, now: &Rejected) -> Option<Why> {
    if now.short != before.short {
        Some(Why::Short)
    } else if now.long != before.long {
        Some(Why::Long)
    } else if now.broken != before.broken {
        Some(Why::Broken)
    } else {
        None
    }
}

/// The middle of some numbers; 0 of none.
pub(crate) fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        n => (values[(n - 1) / 2] + values[n / 2]) / 2.0,
    }
}

/// The frames of a running contact.
#[derive(Default)]
struct Contact {
    start: usize,
    /// Area, mm2, force, N, and ellipse of each region.
    frames: Vec<[(f64, f64, Option<MeanEllipse>); 8]>,
}

impl Contact {
    fn clear(&mut self) {
        self.frames.clear();
    }

    fn push(&mut self, insole: &Insole<f64, MAX_CELLS>) {
        self.frames.push(std::array::from_fn(|region| {
            let frame = &insole.loads()[region].frame;
            let ellipse = insole.ellipse(region).map(|e| MeanEllipse {
                x_mm: e.x_mm,
                y_mm: e.y_mm,
                r_a_mm: e.r_a_mm,
                r_b_mm: e.r_b_mm,
                angle_deg: f64::from(e.angle_deg()),
            });
            (frame.area.area_mm2(), frame.force.force_n, ellipse)
        }));
    }

    fn peak_n(&self, frames: usize) -> f64 {
        let total = |frame: &[(f64, f64, Option<MeanEllipse>); 8]| frame.iter().map(|(_, force, _)| force).sum::<f64>();
        self.frames.iter().take(frames).map(total).fold(0.0, f64::max)
    }

    fn region(&self, region: usize, frames: usize, frame_s: f64) -> RegionCurves {
        let frames = &self.frames[..frames.min(self.frames.len())];
        let weighed = frames.iter().filter_map(|frame| Some((frame[region].1, frame[region].2?)));
        let ellipse = MeanEllipse::of(weighed);
        RegionCurves {
            frame_area_mm2: frames.iter().map(|frame| frame[region].0).collect(),
            frame_force_n: frames.iter().map(|frame| frame[region].1).collect(),
            frame_s,
            ellipse,
            ..RegionCurves::default()
        }
    }
}

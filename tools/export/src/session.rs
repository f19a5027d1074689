//! The exported data: time, the quantities of each frame, steps and cells, of one foot or of both feet on one clock.

use crate::{Channel, Quantity};
use plantar::insole::Insole;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::Step;
use plantar::{Region, Side};
use recording::{Error, Layout, MAX_CELLS, Recording, Result, Scan, VirtualInsole};

/// The quantities of a region in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegionFrame {
    /// Normal force on all cells of the region, N.
    pub force_n: f64,
    /// Area by the contact rule, mm².
    pub area_mm2: f64,
}

/// The quantities of a foot in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Centre of pressure in foot coordinates, mm; `None` while the foot is off the ground.
    pub cop_mm: Option<(f64, f64)>,
    /// The regions, in the order of [`Region::ALL`].
    pub regions: [RegionFrame; Region::ALL.len()],
}

impl Frame {
    /// Normal force on the whole foot, N.
    pub fn total_force_n(&self) -> f64 {
        self.regions.iter().map(|region| region.force_n).sum()
    }
}

/// A step, with its times on the clock of the recordings.
#[derive(Clone, Copy, Debug)]
pub struct TimedStep {
    /// Time of the heel strike, s.
    pub heel_strike_s: f64,
    /// Time of toe off, s.
    pub toe_off_s: f64,
    /// The quantities of the step.
    pub step: Step,
}

/// The exported data of one foot.
#[derive(Clone, Debug)]
pub struct Foot {
    /// Left or right foot.
    pub side: Side,
    /// Provenance of the recording, in sentences.
    pub source: String,
    /// The cells.
    pub layout: Layout,
    /// The recorded pressures, kPa: all cells of the first frame, then those of the second frame, and so on.
    pub pressure_kpa: Vec<f32>,
    /// The frames.
    pub frames: Vec<Frame>,
    /// The steps that the frames contain, at least in part.
    pub steps: Vec<TimedStep>,
    /// The file of the recording, for messages.
    file: String,
    /// Frames per second.
    rate_hz: f64,
    /// Time of each frame, s.
    t_s: Vec<f64>,
}

impl Foot {
    /// Computes the frames and steps of a recording as its virtual insole would. `file` is the name of the recording in messages.
    ///
    /// # Errors
    /// Fails if the insole refuses the recording or the parameters.
    ///
    /// # Panics
    /// Panics if the recording has no frame.
    pub fn new(recording: Recording, virtual_insole: &VirtualInsole, tissue: &Tissue, file: &str) -> Result<Self> {
        let mut insole = Box::new(Insole::<f32, MAX_CELLS>::new());
        let accepted = insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied());
        accepted.map_err(|error| {
            content(file, format!("the recording cannot be evaluated ({error})"), "import the measurement again")
        })?;
        insole.set_tissue(tissue).map_err(|error| {
            let remedy = "identify the parameters again with `plantar fit`, or use typical ones";
            content("tissue parameters", format!("the insole refuses them ({error})"), remedy)
        })?;
        let last = recording.frames() - 1;
        let time_of_frame_s = |i: usize| recording.t_s[i.min(last)] + i.saturating_sub(last) as f64 / recording.rate_hz;
        let (mut frames, mut steps) = (Vec::<Frame>::with_capacity(recording.frames()), Vec::new());
        let mut scans = virtual_insole.scans(&recording);
        while let Some(Scan { index, t_s, codes }) = scans.next_scan()? {
            if insole.frame(index as u32, codes)
                && let Some(step) = insole.whole_step()
            {
                let step = Step::new(&step);
                let start = virtual_insole.frame_at(step.start_us);
                let end = start + virtual_insole.frame_at(step.duration_us.into());
                // The insole confirms a toe off some frames later.
                frames.iter_mut().skip(end).for_each(|frame| frame.cop_mm = None);
                steps.push(TimedStep { heel_strike_s: time_of_frame_s(start), toe_off_s: time_of_frame_s(end), step });
            }
            // As on the insole, steps and load bouts are numbered in one sequence. Taking a bout advances the number of the
            // next step.
            insole.take_bout();
            // The repetitions of the last frame, which have no time, are not frames of the recording.
            if t_s.is_some() {
                frames.push(frame(&insole));
            }
        }
        let Recording { side, layout, rate_hz, source, t_s, pressure_kpa } = recording;
        Ok(Self { side, source, layout, pressure_kpa, frames, steps, file: file.into(), rate_hz, t_s })
    }

    /// The recorded pressures of frame `i`, kPa, one for each cell.
    ///
    /// # Panics
    /// Panics if the foot has no frame `i`.
    pub fn cells_kpa(&self, i: usize) -> &[f32] {
        let cells = self.layout.cells.len();
        &self.pressure_kpa[i * cells..(i + 1) * cells]
    }

    /// The index of the frame that is nearest to `t_s`.
    fn nearest(&self, t_s: f64) -> usize {
        let after = self.t_s.partition_point(|of_frame_s| *of_frame_s < t_s).min(self.t_s.len() - 1);
        let is_before = after > 0 && t_s - self.t_s[after - 1] <= self.t_s[after] - t_s;
        after - usize::from(is_before)
    }

    /// Removes all frames except the `count` frames from `first` on, and the steps that lie entirely outside of these frames.
    fn crop(&mut self, first: usize, count: usize) {
        let (cells, end) = (self.layout.cells.len(), first + count);
        let within_s = self.t_s[first]..=self.t_s[end - 1];
        self.steps.retain(|step| step.toe_off_s >= *within_s.start() && step.heel_strike_s <= *within_s.end());
        self.frames.truncate(end);
        self.frames.drain(..first);
        self.t_s.truncate(end);
        self.t_s.drain(..first);
        self.pressure_kpa.truncate(end * cells);
        self.pressure_kpa.drain(..first * cells);
    }
}

/// The quantities of the insole's last frame.
fn frame(insole: &Insole<f32, MAX_CELLS>) -> Frame {
    let regions = insole
        .loads()
        .each_ref()
        .map(|load| RegionFrame { force_n: load.frame.force.force_n.into(), area_mm2: load.frame.area.area_mm2() });
    let frame = Frame { cop_mm: None, regions };
    let cop_mm = insole.foot_centre_mm().filter(|_| frame.total_force_n() > 0.0);
    Frame { cop_mm: cop_mm.map(|(x_mm, y_mm)| (x_mm.into(), y_mm.into())), ..frame }
}

/// The kind of an [`Event`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// The foot meets the ground.
    HeelStrike,
    /// The foot leaves the ground.
    ToeOff,
}

impl EventKind {
    /// The name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::HeelStrike => "heel_strike",
            Self::ToeOff => "toe_off",
        }
    }
}

/// A heel strike or toe off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// The foot.
    pub side: Side,
    /// The kind.
    pub kind: EventKind,
    /// Time, s.
    pub t_s: f64,
    /// Number of the step.
    pub step: u32,
}

/// One foot, or both feet on one clock.
#[derive(Clone, Debug)]
pub struct Session {
    /// Frames per second.
    pub rate_hz: f64,
    /// Time of each frame, s, on the clock of the recordings.
    pub t_s: Vec<f64>,
    /// The feet, left before right, each with one frame for each time.
    pub feet: Vec<Foot>,
}

impl Session {
    /// The frames that all feet have, between two times on the clock of the recordings, s. Frames of both feet belong together
    /// if they are nearest in time, so those of the right foot are late or early by at most half a frame period.
    ///
    /// # Errors
    /// Fails if both recordings are of the same foot, if there are two and one is on the clock of its insole, if they have no
    /// frame between these times in common, or if they have different rates or clocks that drift apart.
    ///
    /// # Panics
    /// Panics if `feet` is empty.
    pub fn new(mut feet: Vec<Foot>, from_s: Option<f64>, to_s: Option<f64>) -> Result<Self> {
        feet.sort_by_key(|foot| foot.side == Side::Right);
        if let [first, second] = &feet[..]
            && first.side == second.side
        {
            let problem = format!("it is of the {} foot, as is {}", first.side.name(), first.file);
            return Err(content(&second.file, problem, "name one recording for each foot"));
        }
        if let Some(foot) = feet.iter().find(|foot| feet.len() > 1 && foot.layout.is_of_insole()) {
            let problem =
                "it is on the clock of its insole, so its frames cannot be paired with those of the other foot";
            return Err(content(&foot.file, problem.into(), "export one foot at a time"));
        }
        let begins_s = feet.iter().map(|foot| foot.t_s[0]).chain(from_s).fold(f64::NEG_INFINITY, f64::max);
        let ends_s = feet.iter().map(|foot| foot.t_s[foot.t_s.len() - 1]).chain(to_s).fold(f64::INFINITY, f64::min);
        let nearest = feet[0].nearest(begins_s);
        // The frame that is nearest to the time of --from may be before it, and that of --to after it.
        let is_too_early = from_s.is_some_and(|from_s| feet[0].t_s[nearest] < from_s);
        let first_s = feet[0].t_s[(nearest + usize::from(is_too_early)).min(feet[0].t_s.len() - 1)];
        let firsts: Vec<usize> = feet.iter().map(|foot| foot.nearest(first_s)).collect();
        let nearest = feet[0].nearest(ends_s);
        let is_too_late = to_s.is_some_and(|to_s| feet[0].t_s[nearest] > to_s);
        let last_s = nearest.checked_sub(usize::from(is_too_late)).map(|last| feet[0].t_s[last]);
        let frames = |foot: &Foot, first: usize| last_s.map_or(0, |s| (foot.nearest(s) + 1).saturating_sub(first));
        let count = feet.iter().zip(&firsts).map(|(foot, first)| frames(foot, *first)).min().unwrap_or(0);
        if begins_s > ends_s || count == 0 {
            let files = feet.iter().map(|foot| foot.file.as_str()).collect::<Vec<_>>().join(" and ");
            let times = feet.iter().map(|foot| format!("{} to {} s", foot.t_s[0], foot.t_s[foot.t_s.len() - 1]));
            let times = times.collect::<Vec<_>>().join(" and ");
            let problem =
                format!("no frame in common between the recordings ({times}) and the range of --from and --to");
            return Err(content(&files, problem, "name times within the recording, and recordings on one clock"));
        }
        for (foot, first) in feet.iter_mut().zip(firsts) {
            foot.crop(first, count);
        }
        let (rate_hz, t_s) = (feet[0].rate_hz, feet[0].t_s.clone());
        for foot in &feet {
            let apart_s = t_s.iter().zip(&foot.t_s).map(|(t_s, other_s)| (t_s - other_s).abs()).fold(0.0, f64::max);
            // Frames that are nearest in time are at most half a frame period apart, but for rounding errors.
            if apart_s * rate_hz > 0.51 || !recording::is_same_rate(foot.rate_hz, rate_hz) {
                let rates = format!("{:.2} and {rate_hz:.2} Hz", foot.rate_hz);
                let problem = format!("the feet differ in frame times or rates ({rates})");
                return Err(content(&foot.file, problem, "import both feet with the same --rate, such as --rate 100"));
            }
        }
        Ok(Self { rate_hz, t_s, feet })
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.t_s.len()
    }

    /// The names of the recordings, for messages.
    pub fn files(&self) -> String {
        self.feet.iter().map(|foot| foot.file.as_str()).collect::<Vec<_>>().join(" and ")
    }

    /// The channels of all feet.
    pub fn channels(&self) -> Vec<Channel<'_>> {
        let of = |foot| Quantity::all().map(move |quantity| Channel { foot, quantity });
        self.feet.iter().flat_map(of).collect()
    }

    /// The events of all feet within their frames, in the order of time.
    pub fn events(&self) -> Vec<Event> {
        let of_step = |side, step: &TimedStep| {
            let event = |kind, t_s| Event { side, kind, t_s, step: step.step.step };
            [event(EventKind::HeelStrike, step.heel_strike_s), event(EventKind::ToeOff, step.toe_off_s)]
        };
        let ends_s = |t_s: &[f64]| (t_s[0], t_s[t_s.len() - 1]);
        let (first_s, last_s) = ends_s(&self.t_s);
        let of_foot = |foot: &Foot| {
            let (first_of_foot_s, last_of_foot_s) = ends_s(&foot.t_s);
            let events = foot.steps.iter().flat_map(|step| of_step(foot.side, step));
            let within = events.filter(|event| (first_of_foot_s..=last_of_foot_s).contains(&event.t_s));
            // The first and last frame of the right foot may be early or late by half a frame period.
            within.map(|event| Event { t_s: event.t_s.clamp(first_s, last_s), ..event }).collect::<Vec<_>>()
        };
        let mut events: Vec<_> = self.feet.iter().flat_map(of_foot).collect();
        events.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        events
    }
}

/// The quantities of a step as a whole, without `start_s`, which is not on the clock of the recordings (`heel_strike_s` is), and
/// `boots_since`, which is 0 in every recording.
pub(crate) fn of_whole_step() -> impl Iterator<Item = &'static plantar::protocol::Quantity<Step>> {
    Step::QUANTITIES.iter().filter(|quantity| !["start_s", "boots_since"].contains(&quantity.name))
}

/// A text with a question mark in place of each character that is not in ASCII, for formats without other characters.
pub(crate) fn ascii(text: &str) -> String {
    text.chars().map(|character| if character.is_ascii() { character } else { '?' }).collect()
}

/// An error in the content of a recording, in the parameters or in an option of the export. `place` names what the message is
/// about: the recordings, the parameters or the output.
pub(crate) fn content(place: &str, problem: String, remedy: &str) -> Error {
    Error::Content { place: place.into(), problem, remedy: remedy.into() }
}

//! The walk of one foot or of both feet in recordings, for the measures of gait.

use crate::records::range_note;
use crate::table::{Row, Value};
use anyhow::{Result, bail};
use client::gait::{COUNT, FootStep, Gait, MEASURES, Stride};
use fit::contacts::{OtherContact, OtherContacts};
use fit::steps::ExclusionReason;
use plantar::Side;
use plantar::insole::Insole;
use plantar::pipeline::stance_rule::{StanceLimits, StanceRule};
use plantar::protocol::Step;
use recording::{FrameSource, MAX_CELLS, Recording, Scan, VirtualInsole, is_same_rate, note_unless_same_walk};

/// The steps that an insole would find in a recording, and its other contacts.
#[derive(Debug)]
pub struct RecordedWalk {
    /// The foot.
    pub side: Side,
    /// The steps. Their starts and durations are those of their frames in the time column of the recording.
    pub steps: Vec<Step>,
    /// The numbers of the load bouts, which are numbered together with the steps.
    pub bouts: Vec<u32>,
    /// The contacts that are no steps.
    pub others: Vec<OtherContact>,
    /// The rule that determined stance.
    stance: StanceRule,
    /// Largest total force, N.
    largest_n: f64,
    /// Least total force between each step and the next contact, N.
    least_in_swing_n: Vec<f64>,
}

impl RecordedWalk {
    /// Finds the steps in a recording. `virtual_insole` is that of the recording, and `progress` is called with the number of
    /// frames that were evaluated.
    ///
    /// # Errors
    /// Fails if the recording cannot be read or evaluated, or if its time column begins before 0.
    pub fn find(virtual_insole: &VirtualInsole, source: FrameSource, progress: &mut dyn FnMut(usize)) -> Result<Self> {
        let mut insole = Box::new(Insole::<f32, MAX_CELLS>::new());
        insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied())?;
        let mut walk = Self {
            side: source.head().side,
            steps: Vec::new(),
            bouts: Vec::new(),
            others: Vec::new(),
            stance: virtual_insole.setup.stance,
            largest_n: 0.0,
            least_in_swing_n: Vec::new(),
        };
        // The times of the frames so far.
        let (mut times_s, mut others) = (Vec::<f64>::new(), OtherContacts::new(&virtual_insole.setup));
        let add_records = |walk: &mut Self, toe_off: bool, insole: &mut Insole<f32, MAX_CELLS>, times_s: &[f64]| {
            let time_us = |insole_us: u64| {
                let t_s = times_s.get(virtual_insole.frame_at(insole_us)).or(times_s.last());
                t_s.map_or(0, |t_s| (t_s * 1e6).round() as u64)
            };
            if let Some(step) = toe_off.then(|| insole.whole_step()).flatten().map(|step| Step::new(&step)) {
                let start_us = time_us(step.start_us);
                let duration_us = time_us(step.start_us + u64::from(step.duration_us)).saturating_sub(start_us) as u32;
                walk.steps.push(Step { start_us, duration_us, ..step });
                walk.least_in_swing_n.push(f64::INFINITY);
            }
            walk.bouts.extend(insole.take_bout().map(|bout| bout.number));
        };
        let mut scans = virtual_insole.scans(source);
        // The repetitions of the last frame, which have no time, are not evaluated: their load was not recorded.
        while let Some(Scan { index, t_s: Some(t_s), codes }) = scans.next_scan()? {
            if t_s < 0.0 {
                bail!("the time column begins at {t_s} s: shift it, so that it begins at 0 or later");
            }
            times_s.push(t_s);
            let toe_off = insole.frame(index as u32, codes);
            others.frame(t_s, toe_off, &insole);
            add_records(&mut walk, toe_off, &mut insole, &times_s);
            let total_n: f64 = insole.loads().iter().map(|load| f64::from(load.frame.force.force_n)).sum();
            walk.largest_n = walk.largest_n.max(total_n);
            if let Some(least_n) = walk.least_in_swing_n.last_mut().filter(|_| !insole.on_ground()) {
                *least_n = least_n.min(total_n);
            }
            if index.is_multiple_of(4096) {
                progress(index);
            }
        }
        let toe_off = insole.end_stance();
        add_records(&mut walk, toe_off, &mut insole, &times_s);
        walk.others = others.end(&insole);
        Ok(walk)
    }

    /// The steps. A number is missing where a contact in between may be a step that was not
    /// recognised: not a weak one, as of a foot that touches the ground in swing.
    pub fn numbered_steps(&self) -> Vec<Step> {
        let usual_n = usual_peak_n(&self.steps);
        let may_be_step = |contact: &&OtherContact| {
            !contact.reason.is_cut_off()
                && (contact.reason != ExclusionReason::Short || contact.peak_n >= MAY_BE_STEP * usual_n)
        };
        let missing_s: Vec<f64> = self.others.iter().filter(may_be_step).map(|contact| contact.start_s).collect();
        let missing = |step: &Step| missing_s.iter().filter(|start_s| **start_s < step.start_us as f64 / 1e6).count();
        self.steps.iter().map(|step| Step { step: step.step + missing(step) as u32, ..*step }).collect()
    }

    /// The steps on the clock of the time column, with numbers as in [`Self::numbered_steps`].
    pub fn foot_steps(&self) -> Vec<FootStep> {
        self.numbered_steps().iter().map(|step| FootStep::new(step, step.start_us, &self.bouts)).collect()
    }

    /// Notes for the user: on the contacts that are no steps, on a recording without a step, and on a foot that was not lifted
    /// between its steps. `names` are the names of options.
    pub fn notes(&self, names: &OptionNames) -> Vec<String> {
        let mut notes = notes(&self.others, &self.steps, self.largest_n, &self.stance, names);
        notes.extend(self.not_lifted_note());
        notes
    }

    fn not_lifted_note(&self) -> Option<String> {
        // After the last step, the recording may end before the foot is unloaded.
        let swings = self.steps.iter().zip(&self.least_in_swing_n).take(self.steps.len().saturating_sub(1));
        let is_loaded = |(step, least_n): &(&Step, &f64)| **least_n > LIFTED * step.foot.foot_force_peak_n();
        let (all, loaded) = (swings.clone().count(), swings.filter(is_loaded).count());
        (2 * loaded > all).then(|| {
            format!(
                "the foot was not lifted between {loaded} of {all} pairs of steps: the total force remained above {:.0} % of the \
                 peak, as on a bicycle or in shuffling, so the measures are not those of walking",
                100.0 * LIFTED
            )
        })
    }
}

/// A contact that is no step with at least this share of the usual peak may be a step that was not recognised.
const MAY_BE_STEP: f64 = 0.5;
/// A foot with more than this share of the peak force is not lifted.
const LIFTED: f64 = 0.05;

/// The names of options in messages.
#[derive(Clone, Copy, Debug)]
pub struct OptionNames {
    /// That of the threshold of heel strike.
    pub strike: &'static str,
    /// That of the threshold of toe off.
    pub release: &'static str,
    /// That of the shortest stance.
    pub min_stance: &'static str,
    /// That of the longest stance.
    pub max_stance: &'static str,
}

/// The median of the peak forces of steps, N; 0 without steps.
fn usual_peak_n(steps: &[Step]) -> f64 {
    let mut peaks_n: Vec<f64> = steps.iter().map(|step| step.foot.foot_force_peak_n()).collect();
    peaks_n.sort_by(f64::total_cmp);
    peaks_n.get(peaks_n.len() / 2).copied().unwrap_or(0.0)
}

/// Notes on the contacts of a recording that are no steps, on a recording without a step, and on values at the end of their
/// range. `steps` are its steps, `largest_n` is its largest total force, N, and `stance` the rule by which the steps were found.
pub fn notes(
    others: &[OtherContact],
    steps: &[Step],
    largest_n: f64,
    stance: &StanceRule,
    names: &OptionNames,
) -> Vec<String> {
    let cut_off = others.iter().filter(|contact| contact.reason.is_cut_off());
    let cut_off =
        cut_off.map(|contact| format!("left out: the contact at {:.2} s, {}", contact.start_s, contact.reason));
    let other = others_note(others, steps, stance, names);
    let no_step = steps.is_empty().then(|| no_step_note(largest_n, other.is_some(), names));
    cut_off.chain(no_step).chain(other).chain(range_note(steps)).collect()
}

/// A note on a recording without a step. `largest_n` is the largest total force, N. `has_others` is true if there is an
/// [`others_note`], which then has the reasons.
fn no_step_note(largest_n: f64, has_others: bool, names: &OptionNames) -> String {
    let remedy = match has_others {
        true => String::new(),
        false => format!(
            "; check that pressures are in kPa and areas in mm2, and that the thresholds ({}, {}) are below this force; \
             otherwise record a walk of several steps, each with the foot in the air before and after it",
            names.strike, names.release
        ),
    };
    format!("no step: the largest total force is {largest_n:.1} N{remedy}")
}

/// A note with the numbers of the contacts that are no steps, by reason, with the options that concern them; `None` if there are
/// none. Contacts that the recording cuts off are not among them. `steps` are the steps of the same recording, `stance` is the
/// rule by which they were found.
pub fn others_note(
    others: &[OtherContact],
    steps: &[Step],
    stance: &StanceRule,
    names: &OptionNames,
) -> Option<String> {
    let min_stance_s = f64::from(stance.min_stance_ms) / 1e3;
    // The scale does not depend on the frame period.
    let scale = StanceLimits::<f64>::new(stance, 10_000).scale(usual_peak_n(steps));
    let release_n = f64::from(stance.release_n) * scale;
    let is_weak = |contact: &OtherContact| contact.peak_n < release_n;
    let is_brief = |contact: &OtherContact| contact.duration_s < min_stance_s;
    let of = |reason: ExclusionReason, is_of: &dyn Fn(&OtherContact) -> bool| -> Vec<OtherContact> {
        others.iter().filter(|contact| contact.reason == reason && is_of(contact)).copied().collect()
    };
    let durations = |contacts: &[OtherContact]| {
        let least_s = contacts.iter().map(|contact| contact.duration_s).fold(f64::INFINITY, f64::min);
        let most_s = contacts.iter().map(|contact| contact.duration_s).fold(0.0, f64::max);
        let [least, most] = [least_s, most_s].map(|t_s| format!("{:.0}", 1e3 * t_s));
        if least == most { format!("{least} ms") } else { format!("{least} to {most} ms") }
    };
    let short = of(ExclusionReason::Short, &|contact| is_brief(contact) && !is_weak(contact));
    let weak = of(ExclusionReason::Short, &is_weak);
    let scuffs = of(ExclusionReason::Short, &|contact| !is_brief(contact) && !is_weak(contact));
    let long = of(ExclusionReason::Long, &|_| true);
    let broken = of(ExclusionReason::Broken, &|_| true);
    let (min_stance, max_stance, release) = (names.min_stance, names.max_stance, names.release);
    let reasons = [
        (&short, format!("shorter than a step ({}; {min_stance} {})", durations(&short), stance.min_stance_ms)),
        (&weak, format!("below the threshold of toe off ({release_n:.0} N; {release} {})", stance.release_n)),
        (&scuffs, "weak and brief, as of a foot that touches the ground in swing".into()),
        (&long, format!("longer than a step ({}; {max_stance} {})", durations(&long), stance.max_stance_ms)),
        (&broken, "with missing frames".into()),
    ];
    let reasons = reasons.iter().filter(|(contacts, _)| !contacts.is_empty());
    let reasons: Vec<_> = reasons.map(|(contacts, reason)| format!("{} {reason}", contacts.len())).collect();
    (!reasons.is_empty()).then(|| format!("contacts that are no steps: {}", reasons.join(", ")))
}

/// The measures of the walks of one foot or of both feet. Without `has_common_clock`, the times of the two feet are not compared.
pub fn gait(walks: &[RecordedWalk], has_common_clock: bool) -> Gait {
    let of = |side| walks.iter().filter(move |walk| walk.side == side).flat_map(RecordedWalk::foot_steps).collect();
    let gait = Gait::new([of(Side::Left), of(Side::Right)], has_common_clock);
    let is_one_legged = walks.len() == 2 && walks.iter().any(|walk| walk.steps.is_empty());
    if is_one_legged { gait.on_one_leg() } else { gait }
}

/// Checks that the recordings of two feet can be compared, and returns a note if they do not seem to be of the same walk. Only
/// the descriptions of the recordings are used, not their frames.
///
/// # Errors
/// Fails if the frame rates differ.
pub fn check_pair([first, second]: [&Recording; 2]) -> Result<Option<String>> {
    if !is_same_rate(first.rate_hz, second.rate_hz) {
        bail!(
            "the recordings have different rates ({:.2} and {:.2} Hz), so that times, peak forces and loading of the feet \
             cannot be compared: give recordings of one walk, imported with the same --rate, such as --rate 100",
            first.rate_hz,
            second.rate_hz
        );
    }
    // The texts of insoles have their serial numbers, which differ between the feet.
    let is_of_insole = first.layout.is_of_insole() || second.layout.is_of_insole();
    Ok((!is_of_insole).then(|| note_unless_same_walk(&first.source, &second.source)).flatten())
}

/// The rows of a table of the strides of both feet, those of the left foot first, each foot in the order of time: foot, heel
/// strike on the clock of the walk, heel strike of the other foot, whether the stride continues the one before it, and the
/// measures.
pub fn stride_rows(gait: &Gait) -> Vec<Row> {
    let feet = [Side::Left, Side::Right].into_iter().zip(&gait.feet);
    feet.flat_map(|(side, foot)| foot.strides.iter().map(move |stride| stride_row(side, stride))).collect()
}

/// A row with arbitrary values, for the names and types of the columns of a table of strides that may have no rows.
pub fn stride_columns() -> Row {
    stride_row(Side::Left, &Stride { start_s: 0.0, other_s: None, is_consecutive: false, values: [None; COUNT] })
}

fn stride_row(side: Side, stride: &Stride) -> Row {
    let mut row: Row = vec![
        ("side", side.name().into()),
        ("start_s", stride.start_s.into()),
        ("other_start_s", Value::Real(stride.other_s)),
        ("is_consecutive", stride.is_consecutive.into()),
    ];
    row.extend(MEASURES.iter().zip(stride.values).map(|(measure, value)| (measure.key, Value::Real(value))));
    row
}

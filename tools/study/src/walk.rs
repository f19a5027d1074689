//! The walk of one foot or of both feet in recordings, for the measures of gait.

use crate::records::{completed_step, range_note};
use crate::table::{Row, Value};
use anyhow::{Result, bail};
use client::gait::{COUNT, FootStep, Gait, MEASURES, Stride};
use fit::contacts::{ContactCollector, OtherContact, OtherContacts};
use fit::steps::{ExclusionReason, median};
use plantar::Side;
use plantar::insole::Insole;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::Step;
use recording::{FrameSource, MAX_CELLS, Recording, Scan, VirtualInsole, is_same_rate, note_unless_same_walk};

/// A contact that is no step with at least this share of the usual peak may be a step that was not recognised.
const MAY_BE_STEP: f64 = 0.5;
/// A foot with more than this share of the peak force is not unloaded.
const UNLOADED: f64 = 0.05;

/// The steps that an insole would find in a recording, and its other contacts.
#[derive(Debug)]
pub struct RecordedWalk {
    /// The foot.
    pub side: Side,
    /// The steps. Their starts and durations are those of their frames in the time column of the recording. They are numbered
    /// without the load bouts. A number is missing where a contact in between may be a step that was not recognised: not a weak
    /// one, as of a foot that touches the ground in swing.
    pub steps: Vec<Step>,
    others: OtherContacts,
    /// The rule that determined stance.
    stance: StanceRule,
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
        let (side, stance) = (source.head().side, virtual_insole.setup.stance);
        let (mut steps, mut bouts, mut least_in_swing_n) = (Vec::new(), Vec::new(), Vec::new());
        // The times of the frames so far.
        let (mut times_s, mut others) = (Vec::<f64>::new(), ContactCollector::new(&virtual_insole.setup));
        let mut add_records = |toe_off: bool, insole: &mut Insole<f32, MAX_CELLS>, times_s: &[f64]| {
            let time_us = |insole_us: u64| {
                let t_s = times_s.get(virtual_insole.frame_at(insole_us)).or(times_s.last());
                t_s.map_or(0, |t_s| (t_s * 1e6).round() as u64)
            };
            if let Some(step) = completed_step(toe_off, insole) {
                let start_us = time_us(step.start_us);
                let duration_us = time_us(step.start_us + u64::from(step.duration_us)).saturating_sub(start_us) as u32;
                steps.push(Step { start_us, duration_us, ..step });
            }
            bouts.extend(insole.take_bout().map(|bout| bout.number));
            steps.len()
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
            let count = add_records(toe_off, &mut insole, &times_s);
            least_in_swing_n.resize(count, f64::INFINITY);
            if let Some(least_n) = least_in_swing_n.last_mut().filter(|_| !insole.on_ground()) {
                *least_n = least_n.min(f64::from(insole.total_n()));
            }
            if index.is_multiple_of(4096) {
                progress(index);
            }
        }
        let toe_off = insole.end_stance();
        add_records(toe_off, &mut insole, &times_s);
        let others = others.end(&insole);
        renumber(&mut steps, &bouts, &others.contacts);
        Ok(Self { side, steps, others, stance, least_in_swing_n })
    }

    /// The steps on the clock of the time column.
    pub fn foot_steps(&self) -> Vec<FootStep> {
        self.steps.iter().map(|step| FootStep::new(step, step.start_us, &[])).collect()
    }

    /// Notes for the user: on the contacts that are no steps, on a recording without a step, on values at the end of their range,
    /// and on a foot that was not unloaded between its steps. `names` are the names of options.
    pub fn notes(&self, names: &OptionNames) -> Vec<String> {
        let mut notes = notes(&self.others, &self.steps, &self.stance, names);
        notes.extend(self.not_unloaded_note(names));
        notes
    }

    fn not_unloaded_note(&self, names: &OptionNames) -> Option<String> {
        // After the last step, the recording may end before the foot is unloaded.
        let swings = self.steps.iter().zip(&self.least_in_swing_n).take(self.steps.len().saturating_sub(1));
        let is_loaded = |(step, least_n): &(&Step, &f64)| **least_n > UNLOADED * step.foot.foot_force_peak_n();
        let (all, loaded) = (swings.clone().count(), swings.filter(is_loaded).count());
        (2 * loaded > all).then(|| {
            format!(
                "the total force remained above {:.0} % of the peak between {loaded} of {all} pairs of steps: on a bicycle or \
                 in shuffling, the measures are not those of walking; if the shoe presses on the lifted foot, subtract this \
                 load with {}",
                100.0 * UNLOADED,
                names.zero
            )
        })
    }
}

/// Numbers steps as the field [`RecordedWalk::steps`] describes. `bouts` are the numbers of the load bouts.
fn renumber(steps: &mut [Step], bouts: &[u32], others: &[OtherContact]) {
    let usual_n = median(steps.iter().map(|step| step.foot.foot_force_peak_n()));
    let may_be_step = |contact: &&OtherContact| {
        !contact.reason.is_cut_off()
            && (contact.reason != ExclusionReason::Short || contact.peak_n >= MAY_BE_STEP * usual_n)
    };
    let missing_s: Vec<f64> = others.iter().filter(may_be_step).map(|contact| contact.start_s).collect();
    for step in steps {
        let missing = missing_s.iter().filter(|start_s| **start_s < step.start_us as f64 / 1e6).count();
        let bouts = bouts.iter().filter(|number| **number < step.step).count();
        // The numbers of a recording begin at 0, and a step follows its bouts.
        step.step = step.step - bouts as u32 + missing as u32;
    }
}

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
    /// That of the zero file.
    pub zero: &'static str,
}

/// A note with the numbers of the contacts that are no steps, by reason, with the options that concern them; `None` if there are
/// none. Contacts that the recording cuts off are not among them. `stance` is the rule by which steps were found.
pub fn others_note(others: &[OtherContact], stance: &StanceRule, names: &OptionNames) -> Option<String> {
    let min_stance_s = f64::from(stance.min_stance_ms) / 1e3;
    let of = |reason: ExclusionReason, is_of: &dyn Fn(&OtherContact) -> bool| -> Vec<OtherContact> {
        others.iter().filter(|contact| contact.reason == reason && is_of(contact)).copied().collect()
    };
    let durations = |contacts: &[OtherContact]| {
        let least_s = contacts.iter().map(|contact| contact.duration_s).fold(f64::INFINITY, f64::min);
        let most_s = contacts.iter().map(|contact| contact.duration_s).fold(0.0, f64::max);
        let [least, most] = [least_s, most_s].map(|t_s| format!("{:.0}", 1e3 * t_s));
        if least == most { format!("{least} ms") } else { format!("{least} to {most} ms") }
    };
    // A contact with fewer frames than the limit in whole frames is also shorter than the limit.
    let is_brief = |contact: &OtherContact| contact.duration_s < min_stance_s;
    let weak = of(ExclusionReason::Short, &|contact| contact.is_weak);
    let short = of(ExclusionReason::Short, &|contact| !contact.is_weak && is_brief(contact));
    let scuffs = of(ExclusionReason::Short, &|contact| !contact.is_weak && !is_brief(contact));
    let long = of(ExclusionReason::Long, &|_| true);
    let (min_stance, max_stance, release) = (names.min_stance, names.max_stance, names.release);
    let reasons = [
        (&weak, format!("below the threshold of toe off ({release} {})", stance.release_n)),
        (&short, format!("shorter than a step ({}; {min_stance} {})", durations(&short), stance.min_stance_ms)),
        (&scuffs, "weak and brief, as of a foot that touches the ground in swing".into()),
        (&long, format!("longer than a step ({}; {max_stance} {})", durations(&long), stance.max_stance_ms)),
    ];
    let reasons = reasons.iter().filter(|(contacts, _)| !contacts.is_empty());
    let reasons: Vec<_> = reasons.map(|(contacts, reason)| format!("{} {reason}", contacts.len())).collect();
    (!reasons.is_empty()).then(|| format!("contacts that are no steps: {}", reasons.join(", ")))
}

/// Notes on the contacts of a recording that are no steps, on a recording without a step, and on values at the end of their
/// range. `steps` are the steps of the recording, and `stance` is the rule by which they were found.
pub fn notes(others: &OtherContacts, steps: &[Step], stance: &StanceRule, names: &OptionNames) -> Vec<String> {
    let OtherContacts { contacts, largest_n } = others;
    let cut_off = contacts.iter().filter(|contact| contact.reason.is_cut_off());
    let cut_off =
        cut_off.map(|contact| format!("left out: the contact at {:.2} s, {}", contact.start_s, contact.reason));
    let no_step = steps.is_empty().then(|| no_step_note(*largest_n, !contacts.is_empty(), names));
    cut_off.chain(no_step).chain(others_note(contacts, stance, names)).chain(range_note(steps)).collect()
}

/// A note on a recording without a step. `largest_n` is the largest total force, N. `has_reasons` is true if there are contacts,
/// for which other notes have the reasons.
fn no_step_note(largest_n: f64, has_reasons: bool, names: &OptionNames) -> String {
    let remedy = match has_reasons {
        true => String::new(),
        false => format!(
            "; check that pressures are in kPa and areas in mm2, and that the thresholds ({}, {}) are below this force; \
             otherwise record a walk of several steps, each with the foot in the air before and after it",
            names.strike, names.release
        ),
    };
    format!("no step: the largest total force is {largest_n:.1} N{remedy}")
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

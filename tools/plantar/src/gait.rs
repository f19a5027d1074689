//! `plantar gait`: the measures of both feet.

use crate::fit::live::{self, session};
use crate::fit::print_notes;
use crate::paths::{check_folders, check_written};
use crate::replay::{progress, write_text};
use crate::setup::{OPTION_NAMES, StanceArgs, ZeroArgs, time};
use crate::summary::{align, counted, table};
use crate::tables::{Format, check_json, write_rows};
use crate::zero::GRAVITY_M_S2;
use anyhow::{Result, bail};
use clap::Args;
use client::gait::{Estimate, FootGait, FootStep, Gait, Length, MEASURES};
use client::{ClockMapping, STREAM_INSOLES, are_feet_comparable};
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::session::RECORD_QUEUE;
use plantar::protocol::{Alert, Bout, Hello, LoadRecord, MAJOR, Step, ToHost};
use recording::{FrameSource, Recording, RecordingReader, Span};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use study::walk::{RecordedWalk, check_pair, stride_columns, stride_rows};

/// Computes the measures of both feet: stride, step, stance and swing time, double and single support, flight, cadence and
/// symmetry.
///
/// A file of `plantar serve --record` or of the page contains both feet. Recordings of one walk, and folders that
/// `plantar record` wrote at the same time, contain one foot each. Strides with a pause, and strides without exactly one step of
/// the other foot from 15 to 85 % of the stride, are counted and not used. docs/measures.md has the definitions.
#[derive(Args)]
pub struct GaitCommand {
    /// A file of `plantar serve --record` or of the page, or for each foot a recording or a folder of `plantar record`. The time
    /// columns of two recordings must be on one clock, and their rates must be equal within 1 %.
    #[arg(required = true, num_args = 1..=2, value_name = "FILE")]
    walk: Vec<PathBuf>,
    /// Mean length of a stride, 0.1 to 6 m. The walking speed is computed from it.
    #[arg(long, value_name = "M", value_parser = stride_length, allow_negative_numbers = true)]
    stride_length: Option<f64>,
    /// Distance from the first to the last heel strike, m. The walking speed is computed from it if the walk has no pause and no
    /// missing step, and the steps of both feet are on one clock.
    #[arg(long, value_name = "M", value_parser = length, allow_negative_numbers = true, conflicts_with = "stride_length")]
    distance: Option<f64>,
    /// Write the measures to this JSON file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the measures of each stride in use to this table, one row per stride. Its extension, .csv or .parquet, selects the
    /// format.
    #[arg(long, value_name = "FILE")]
    strides: Option<PathBuf>,
    #[command(flatten)]
    stance: StanceArgs,
    #[command(flatten)]
    zero: ZeroArgs,
    /// Use only the frames of recordings from this time on, s, in their time columns.
    #[arg(long, value_name = "S", value_parser = time, allow_negative_numbers = true)]
    from: Option<f64>,
    /// Use only the frames of recordings up to this time, s.
    #[arg(long, value_name = "S", value_parser = time, allow_negative_numbers = true)]
    to: Option<f64>,
}

/// Parses the length of a stride. The limits are those of the page.
fn stride_length(text: &str) -> Result<f64, String> {
    let stride_m = text.parse().ok().filter(|stride_m| (0.1..=6.0).contains(stride_m));
    stride_m.ok_or_else(|| "give the length of a stride in metres, 0.1 to 6".into())
}

fn length(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(length_m) if length_m > 0.0 && length_m < f64::INFINITY => Ok(length_m),
        _ => Err("give a length in metres, above 0".into()),
    }
}

/// The steps and other load records of one file or folder.
#[derive(Default)]
struct Walk {
    /// The steps, with the times of their heel strikes; `None` if the time on a common clock is unknown.
    steps: Vec<(Step, Option<Start>)>,
    /// The load bouts and alerts, which are numbered together with the steps: the foot and the number of each.
    others: Vec<(Side, u32)>,
    /// The description of the recording that was replayed; `None` if the steps are those of an insole.
    head: Option<Recording>,
}

/// The time of a heel strike on a common clock.
#[derive(Clone, Copy)]
struct Start {
    /// On the clock of the host, us since 1970, or on that of the time column of a recording, us.
    us: u64,
    /// True if the time is exact enough to compare the feet.
    is_exact: bool,
}

impl GaitCommand {
    pub fn run(&self) -> Result<()> {
        let written = [&self.json, &self.strides].map(Option::as_deref);
        check_written(&[&self.walk[..], self.zero.zero.as_slice()].concat(), &written)?;
        check_folders(&written)?;
        check_json(&written[..1], Some("--strides"))?;
        self.strides.as_deref().map(Format::of).transpose()?;
        let stance = self.stance.rule()?;
        let Walk { mut steps, mut others, .. } = Walk::default();
        let mut heads = Vec::new();
        for path in &self.walk {
            let added = self.read(path, stance).map_err(|error| with_path(error, path))?;
            let is_for_recordings =
                self.stance.is_given() || self.zero.zero.is_some() || self.from.is_some() || self.to.is_some();
            if added.head.is_none() && is_for_recordings {
                bail!(
                    "{}, --zero, --from and --to are for recordings of all cells, and the steps in {} were found by an insole: \
                     omit the options, or change the stance rule of the insole with `plantar insole set` before the walk",
                    StanceArgs::NAMES,
                    path.display()
                );
            }
            let is_in_both = |side: &Side| has_steps(&steps, *side) && has_steps(&added.steps, *side);
            if let Some(side) = [Side::Left, Side::Right].into_iter().find(is_in_both) {
                bail!("both files contain steps of the {} foot: give one file for each foot", side.name());
            }
            steps.extend(added.steps);
            others.extend(added.others);
            heads.extend(added.head);
        }
        if let [first, second] = &heads[..] {
            if first.side == second.side {
                bail!("both files are of the {} foot: give one file for each foot", first.side.name());
            }
            print_notes(check_pair([first, second])?.as_slice());
        }
        if steps.is_empty() {
            let files: Vec<_> = self.walk.iter().map(|path| path.display().to_string()).collect();
            let remedy = if heads.is_empty() { "record a walk of several steps" } else { "the notes have the reasons" };
            bail!("no steps in {}: {remedy}", files.join(" and "));
        }
        let has_common_clock = retain_comparable(&mut steps);
        let steps_of = |side| {
            let numbers: Vec<_> = others.iter().filter(|(of, _)| *of == side).map(|(_, number)| *number).collect();
            let steps = steps.iter().filter(|(step, _)| step.side == side);
            // The times of a foot are all on the common clock, or all on the clock of its insole.
            let start_us = |step: &Step, common: &Option<Start>| common.map_or(step.start_us, |start| start.us);
            steps.map(|(step, common)| FootStep::new(step, start_us(step, common), &numbers)).collect()
        };
        let gait = Gait::new([steps_of(Side::Left), steps_of(Side::Right)], has_common_clock);
        let has_both = [Side::Left, Side::Right].into_iter().all(|side| has_steps(&steps, side));
        let gait = if heads.len() == 2 && !has_both { gait.on_one_leg() } else { gait };
        let length = self.stride_length.map(Length::Stride).or(self.distance.map(Length::Walk));
        if has_both && !has_common_clock {
            eprintln!(
                "note: the feet are not compared, because too few steps of at least one foot have an exact time on a common \
                 clock. Steps that an insole stored without a host, and recordings of the cells of insoles, have no such \
                 time. Record both feet during the walk with `plantar serve --record`, `plantar record` or the page"
            );
        }
        print(&gait, length);
        if gait.feet.iter().all(|foot| foot.strides.is_empty() && foot.gaps == 0 && foot.unpaired == 0) {
            let of = |side| counted(steps.iter().filter(|(step, _)| step.side == side).count(), "step");
            println!(
                "No stride: a stride lasts from a heel strike of a foot to its next heel strike, so it needs two successive \
                 steps of a foot, and the walk has {} of the left and {} of the right foot. Record a longer walk.",
                of(Side::Left),
                of(Side::Right)
            );
        }
        if let Some(path) = &self.strides {
            write_rows(path, &stride_columns(), [stride_rows(&gait)])?;
        }
        match &self.json {
            Some(path) => write_text(path, &serde_json::to_string_pretty(&gait.to_json(length))?),
            None => Ok(()),
        }
    }

    /// Reads the steps of a stream file, of a folder of `plantar record`, or of a recording, which is replayed with this stance
    /// rule.
    fn read(&self, path: &Path, stance: StanceRule) -> Result<Walk> {
        // A folder without a table of steps is a recording of all cells in parts, which is replayed.
        if path.join("steps").is_dir() {
            let steps = session::timed_steps(path)?.into_iter().map(|(step, start_s, is_exact)| {
                (step, start_s.map(|start_s| Start { us: (start_s * 1e6).round() as u64, is_exact }))
            });
            return Ok(Walk { steps: steps.collect(), others: session::other_records(path)?, head: None });
        }
        if live::is_stream(path) { from_stream(path) } else { self.replayed(path, stance) }
    }

    /// The load records that an insole would find in a recording. The times of the steps are on the clock of its time column,
    /// which two recordings have in common unless they are of insoles.
    fn replayed(&self, path: &Path, stance: StanceRule) -> Result<Walk> {
        let name = path.display().to_string();
        let span = Span::new(self.from, self.to)?;
        let part = (span != Span::default()).then(|| Recording::read(path)?.part(span, &name)).transpose()?;
        let source = match &part {
            Some(part) => FrameSource::from(part),
            None => FrameSource::from(RecordingReader::open(path)?),
        };
        let Recording { side, layout, rate_hz, source: origin, .. } = source.head();
        let head = Recording {
            side: *side,
            layout: layout.clone(),
            rate_hz: *rate_hz,
            source: origin.clone(),
            t_s: Vec::new(),
            pressure_kpa: Vec::new(),
        };
        let mut insole = study::virtual_insole(&source, ContactRule::COUNTED, stance)?;
        self.zero.apply(&mut insole)?;
        let bar = progress(source.frames() as u64, "frames");
        let found = RecordedWalk::find(&insole, source, &mut |done| bar.set_position(done as u64))?;
        bar.finish_and_clear();
        print_notes(&found.notes(&OPTION_NAMES).iter().map(|note| format!("{name}: {note}")).collect::<Vec<_>>());
        let start = |step: &Step| (!head.layout.is_of_insole()).then_some(Start { us: step.start_us, is_exact: true });
        Ok(Walk {
            steps: found.steps.iter().map(|step| (*step, start(step))).collect(),
            // The numbers do not count the load bouts.
            others: Vec::new(),
            head: Some(head),
        })
    }
}

/// The error with the path, unless its message begins with it.
fn with_path(error: anyhow::Error, path: &Path) -> anyhow::Error {
    let path = path.display().to_string();
    if error.to_string().starts_with(&path) { error } else { error.context(path) }
}

fn has_steps(steps: &[(Step, Option<Start>)], side: Side) -> bool {
    steps.iter().any(|(step, _)| step.side == side)
}

/// Removes the steps of each foot that cannot be compared in time with the others, with a note on stderr. Returns true if the
/// feet can be compared; the remaining steps then have exact times on the common clock. Otherwise, those of each foot are the
/// ones with a time on the common clock; if none has one, those of the newest boot of the insole with steps, because its clock
/// begins with each boot.
fn retain_comparable(steps: &mut Vec<(Step, Option<Start>)>) -> bool {
    let is_exact = |start: &Option<Start>| start.is_some_and(|start| start.is_exact);
    let has_exact_times = |side| {
        let of_side = || steps.iter().filter(move |(step, _)| step.side == side);
        let exact = of_side().filter(|(_, start)| is_exact(start)).count();
        are_feet_comparable(exact, of_side().count())
    };
    let has_common_clock = [Side::Left, Side::Right].into_iter().all(has_exact_times);
    for side in [Side::Left, Side::Right] {
        let of_side = || steps.iter().filter(move |(step, _)| step.side == side);
        let has_times = of_side().any(|(_, start)| start.is_some());
        let newest_boot = of_side().map(|(step, _)| step.boots_since).min();
        let before = steps.len();
        steps.retain(|(step, start)| {
            let is_comparable = match (has_common_clock, has_times) {
                (true, _) => is_exact(start),
                (false, true) => start.is_some(),
                (false, false) => newest_boot == Some(step.boots_since),
            };
            step.side != side || is_comparable
        });
        let removed = before - steps.len();
        if removed > 0 {
            let which = match (has_common_clock, has_times) {
                (true, _) => "without an exact time on the common clock, as those stored while no host was connected,",
                (false, true) => "without a time on the common clock",
                (false, false) => "from earlier boots of the insole",
            };
            eprintln!(
                "note: {} foot: steps {which} cannot be compared in time with the others and are not used: {removed}",
                side.name()
            );
        }
    }
    has_common_clock
}

/// Number of time messages ([`ToHost::Time`]) of an insole after which the offset of its clock from that of the host is known
/// well enough to compute the times of the steps that arrived before.
const COMPARED_TIMES: u32 = 20;

/// The load records in a stream file. The times of the steps are on the clock of the host: they follow from the time messages
/// of the insoles or, without such messages and for earlier boots, from the wall clocks of the insoles, which the host set.
fn from_stream(path: &Path) -> Result<Walk> {
    let bytes = std::fs::read(path)?;
    let mut messages = live::StreamMessages::new(&bytes);
    let mut mappings = [const { ClockMapping::new() }; STREAM_INSOLES];
    // A host receives stored steps before the first time message of the insole. For each insole: the indices in `steps` of the
    // steps that still wait for a time, and the number of time messages since its hello. The steps receive their times once
    // `COMPARED_TIMES` such messages have arrived.
    let mut untimed: [(Vec<usize>, u32); STREAM_INSOLES] = [const { (Vec::new(), 0) }; STREAM_INSOLES];
    let Walk { mut steps, mut others, .. } = Walk::default();
    let mut known_others = HashSet::new();
    let start = |record: &LoadRecord, mapping: &ClockMapping| {
        let is_exact = mapping.is_start_comparable(record);
        mapping.start_us(record).map(|us| Start { us, is_exact })
    };
    let set_times = |steps: &mut [(Step, Option<Start>)], untimed: &mut Vec<usize>, mapping: &ClockMapping| {
        for index in untimed.drain(..) {
            let (step, time) = &mut steps[index];
            let wall_clock = || step.start_unix_us.map(|us| Start { us, is_exact: false });
            *time = start(&LoadRecord::from(*step), mapping).or_else(wall_clock);
        }
    };
    for message in &mut messages {
        let (entry, message) = message?;
        let (mapping, (untimed, times)) = (&mut mappings[entry.insole], &mut untimed[entry.insole]);
        match message {
            Some(ToHost::Hello(Hello { major, .. })) if major != MAJOR => {
                bail!(
                    "recorded with protocol version {major}, but this program reads version {MAJOR}: use the program of that \
                     version"
                )
            }
            Some(ToHost::Hello(_)) => {
                set_times(&mut steps, untimed, mapping);
                (*mapping, *times) = (ClockMapping::new(), 0);
            }
            Some(ToHost::Time { host_us, device_us }) => {
                mapping.answer(host_us, device_us);
                *times += 1;
                if *times == COMPARED_TIMES {
                    set_times(&mut steps, untimed, mapping);
                }
            }
            Some(ToHost::Step(step)) => {
                // An insole can send again the records in its queue, and as many others of which the acknowledgement was lost.
                // The other insole may have sent any number of steps since.
                let record = LoadRecord::from(step);
                let is_same = |known: &Step| LoadRecord::from(*known).is_same(&record);
                let same_foot = steps.iter().rev().filter(|(known, _)| known.side == step.side);
                let is_known = same_foot.take(2 * RECORD_QUEUE).any(|(known, _)| is_same(known));
                if !is_known {
                    let start = start(&record, mapping);
                    if start.is_none() {
                        untimed.push(steps.len());
                    }
                    steps.push((step, start));
                }
            }
            Some(ToHost::Bout(Bout { side, number, .. }) | ToHost::Alert(Alert { side, number, .. }))
                if known_others.insert((side, number)) =>
            {
                others.push((side, number));
            }
            _ => {}
        }
    }
    for ((untimed, _), mapping) in untimed.iter_mut().zip(&mappings) {
        set_times(&mut steps, untimed, mapping);
    }
    messages.note_unused(&path.display().to_string());
    Ok(Walk { steps, others, head: None })
}

/// Prints the measures as a table.
fn print(gait: &Gait, length: Option<Length>) {
    let mut table = table();
    table.set_header(["measure", "left", "right", "symmetry index %"]);
    let [left, right] = &gait.feet;
    for (i, measure) in MEASURES.iter().enumerate() {
        // Walking has no flight.
        if measure.key == "flight_s"
            && [left, right].iter().all(|foot| foot.measures[i].is_none_or(|flight| flight.mean == 0.0))
        {
            continue;
        }
        let text = |estimate: Option<Estimate>, digits| estimate.map_or("-".into(), |it| to_text(&it, digits));
        table.add_row([
            format!("{}, {}", measure.title, measure.unit),
            text(left.measures[i], measure.digits),
            text(right.measures[i], measure.digits),
            if measure.has_symmetry { text(gait.symmetry_percent[i], 1) } else { String::new() },
        ]);
    }
    align(&mut table);
    println!("Mean ± standard deviation, and 95 % confidence interval of the mean:\n{table}");
    println!(
        "The symmetry index is 0 for equal feet and positive if the left value is larger. It is the mean over the pairs of a \
         left stride and the right stride that begins within it, and differs from the index of the means of the feet, which \
         include strides without such a partner."
    );
    let mut of_feet = MEASURES.iter().zip(&gait.symmetry_percent);
    if of_feet.any(|(measure, index)| measure.key == "peak_force_n" && index.is_some()) {
        println!(
            "The symmetry of forces contains the difference of the force scales of the two insoles, unless both were calibrated by \
             known pressures (plantar calibrate). Standing on both feet does not calibrate it, and the interval does not include it."
        );
    }
    let estimates = [&left.measures, &right.measures, &gait.symmetry_percent];
    if estimates.iter().flat_map(|of| of.iter().flatten()).any(|estimate| estimate.interval.is_none()) {
        println!(
            "A mean without an interval has fewer than three effectively independent values (successive strides are \
             correlated), or equal ones."
        );
    }
    let mut symmetry = MEASURES.iter().zip(&gait.symmetry_percent);
    if [left, right].iter().any(|foot| foot.measures.iter().any(Option::is_none))
        || symmetry.any(|(measure, index)| measure.has_symmetry && index.is_none())
    {
        println!(
            "- No value: there is no such stride, or the feet are not compared, or the step of the other foot before the stride \
             is missing."
        );
    }
    if let Some(cadence) = gait.cadence_per_min {
        println!("Cadence, steps per minute: {}", to_text(&cadence, 1));
    }
    if let Some(force_n) = mean_force_n(gait) {
        println!(
            "Mean force of both feet over whole strides: {force_n:.0} N, the weight of {:.1} kg. In level walking, it is the \
             weight of the body.",
            force_n / GRAVITY_M_S2
        );
    }
    if let Some(length) = length {
        match (gait.speed_m_s(length), length) {
            (Some(speed_m_s), _) => println!("Walking speed: {speed_m_s:.2} m/s"),
            (None, Length::Stride(_)) => println!(
                "Walking speed: unknown, because there is no stride, or only one of the two recorded feet took steps"
            ),
            (None, Length::Walk(_)) => {
                println!(
                    "Walking speed: unknown, because there is a pause or a missing step, because one foot is missing, or because \
                     the feet have no common clock"
                )
            }
        }
    }
    let counts = |of: fn(&FootGait) -> usize| format!("{} left, {} right", of(left), of(right));
    println!("Strides in use: {}", counts(|foot| foot.strides.len()));
    println!(
        "Not used: with a pause or a missing step: {}; without exactly one step of the other foot from 15 to 85 % of the \
         stride: {}",
        counts(|foot| foot.gaps),
        counts(|foot| foot.unpaired)
    );
}

/// Mean total force over whole strides, N: the sum over both feet of the mean force-time integral, divided by the mean stride
/// time. `None` unless both feet have strides. It needs no common clock of the feet.
fn mean_force_n(gait: &Gait) -> Option<f64> {
    let mean = |foot: &FootGait, key| {
        let index = MEASURES.iter().position(|measure| measure.key == key)?;
        Some(foot.measures[index]?.mean)
    };
    let of_foot = |foot| Some(mean(foot, "force_integral_n_s")? / mean(foot, "stride_time_s")?);
    gait.feet.iter().map(of_foot).sum()
}

/// Formats an estimate with its standard deviation and its confidence interval, as far as they exist.
fn to_text(estimate: &Estimate, digits: usize) -> String {
    // A negative value that is rounded to 0 is printed without a sign.
    let rounded = |value: f64| {
        let text = format!("{value:.digits$}");
        if text.parse() == Ok(0.0) { text.replace('-', "") } else { text }
    };
    let sd = estimate.sd.map_or(String::new(), |sd| format!(" ± {}", rounded(sd)));
    let interval =
        estimate.interval.map_or(String::new(), |[low, high]| format!(" ({} to {})", rounded(low), rounded(high)));
    format!("{}{sd}{interval}", rounded(estimate.mean))
}

#[cfg(test)]
mod tests {
    use super::to_text;
    use client::gait::Estimate;

    #[test]
    fn a_value_that_is_rounded_to_0_has_no_sign() {
        let estimate = |mean, interval| Estimate { count: 9, mean, sd: Some(0.0002), interval };
        assert_eq!(to_text(&estimate(-0.0004, Some([-0.0012, 0.0])), 3), "0.000 ± 0.000 (-0.001 to 0.000)");
        assert_eq!(to_text(&estimate(-10.0, None), 0), "-10 ± 0");
    }
}

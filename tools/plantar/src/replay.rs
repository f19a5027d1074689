//! `plantar replay`: runs the insole's own code on this computer.

use crate::fit::write;
use crate::frames::FrameWriter;
use crate::paths::{check_folders, check_written};
use crate::picture::Picture;
use crate::records::{Records, write_json};
use crate::setup::{self, InsoleArgs, OPTION_NAMES};
use crate::summary;
use crate::tables::{self, Format};
use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use client::{alert_to_json, bout_to_json, daily_load_to_json, step_to_json};
use fit::contacts::{ContactCollector, OtherContact};
use fit::steps::LIFT_THE_FOOT;
use indicatif::{ProgressBar, ProgressStyle};
use plantar::Real;
use plantar::insole::Insole;
use plantar::pipeline::alert::AlertRules;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::{Alert, Bout, Step};
use recording::{FrameSource, MAX_CELLS, RecordingReader, Scan, VirtualInsole};
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Instant;
use study::records::{completed_step, range_note};
use study::walk::others_note;

/// Computes the steps and load bouts of a recording as the insole would, with the same code.
///
/// Recorded pressures are first converted to the codes of a virtual sensor, exactly as in `plantar emulate`. In f32, the steps
/// are therefore equal to those of the emulated insole, to the last digit, except the first contact after more than a minute
/// without load: an insole that is not worn scans two frames a second, and records this contact as a load bout. A replay in f64
/// shows the error of single precision.
#[derive(Args)]
pub struct Replay {
    /// The recording.
    recording: PathBuf,
    #[command(flatten)]
    insole: InsoleArgs,
    /// Floating-point arithmetic: single precision as on the insole (f32), or double precision (f64). The steps are rounded to
    /// the resolution of an insole's messages; the values of --frames are not rounded.
    #[arg(long, value_enum, default_value_t = Precision::F32)]
    precision: Precision,
    /// Write the steps to this JSON file, one object per step: side, number, start, duration, and every quantity of the foot and
    /// of each region. The names of the quantities end with their units. Starts are on the recording's clock, here and in the
    /// files of --bouts and --load.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the steps to this table, one row for each region of each step, with the columns of the steps of `plantar record`;
    /// starts are on the recording's clock. Its extension, .csv or .parquet, selects the format.
    #[arg(long, value_name = "FILE")]
    steps: Option<PathBuf>,
    /// Write the load bouts (all load outside steps) to this JSON file, one object per bout. The last bout ends with the
    /// recording.
    #[arg(long, value_name = "FILE")]
    bouts: Option<PathBuf>,
    /// Write the load of the recording, as if it were a day (of a longer one, that of its last day), and the alerts by the
    /// recommended rules to this JSON file.
    #[arg(long, value_name = "FILE")]
    load: Option<PathBuf>,
    /// Write the live values of every frame to this table. Its extension, .csv or .parquet, selects the format.
    #[arg(long, value_name = "FILE")]
    frames: Option<PathBuf>,
    /// Draw the first step to this SVG file.
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
}

/// Duration of a day of the cumulative load while the clock of the insole is not set, s.
const DAY_S: f64 = 86_400.0;

#[derive(Clone, Copy, ValueEnum)]
enum Precision {
    F32,
    F64,
}

impl Replay {
    pub fn run(&self) -> Result<()> {
        let json = [&self.json, &self.bouts, &self.load].map(Option::as_deref);
        let written = [&json[..], &[&self.steps, &self.frames, &self.picture].map(Option::as_deref)].concat();
        check_written(&self.insole.inputs(std::slice::from_ref(&self.recording)), &written)?;
        check_folders(&written)?;
        tables::check_json(&json[..1], Some("--steps"))?;
        tables::check_json(&json[1..], None)?;
        self.steps.as_deref().map(Format::of).transpose()?;
        let source = FrameSource::from(RecordingReader::open(&self.recording)?);
        let (frames, cells) = (source.frames(), source.head().cells());
        let parameters = self.insole.wearer.parameters()?;
        setup::note_unless_same_foot(parameters.identified.as_ref(), source.head().side);
        let tissue = parameters.tissue();
        let start = Instant::now();
        let insole = self.insole.insole(&source, self.insole.rule(&parameters)?, &self.recording)?;
        let records = match self.precision {
            Precision::F32 => self.replay::<f32>(source, &insole, &tissue)?,
            Precision::F64 => self.replay::<f64>(source, &insole, &tissue)?,
        };
        let seconds = start.elapsed().as_secs_f64();
        records.print(&parameters.deformation);
        setup::note_unless_applicable(&parameters, self.insole.wearer.size, &records.steps);
        eprintln!("{frames} frames of {cells} cells in {seconds:.2} s");
        Ok(())
    }

    /// Computes the steps, the load bouts and, with --load, the alerts in the arithmetic `R`, and writes the files.
    fn replay<R: Real>(&self, source: FrameSource, virtual_insole: &VirtualInsole, tissue: &Tissue) -> Result<Records> {
        let mut insole = Box::new(Insole::<R, MAX_CELLS>::new());
        let accepted = insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied());
        accepted.with_context(|| format!("{}: the recording cannot be evaluated", self.recording.display()))?;
        insole.set_tissue(tissue)?;
        if self.load.is_some() {
            insole.set_alert_rules(&AlertRules::RECOMMENDED);
        }
        let mut frames =
            self.frames.as_deref().map(|path| FrameWriter::create(path, virtual_insole.setup.contact)).transpose()?;
        let mut picture = self.picture.is_some().then(|| Picture::new(virtual_insole));
        let bar = progress(source.frames() as u64, "frames");
        let head = source.head().clone();
        let mut scans = virtual_insole.scans(source);
        let mut records = Records::default();
        // The times of the frames, for the starts of the records in the files.
        let mut times_s = Vec::new();
        let has_starts = [&self.json, &self.bouts, &self.load].into_iter().any(Option::is_some);
        // The times of the last frames, for the starts of the steps in the table.
        let (mut recent_s, longest_frames) = (VecDeque::new(), virtual_insole.longest_step_frames());
        // The time of the heel strike of a step, s, if the last frame so far has the index `last`.
        let heel_strike_s = |recent_s: &VecDeque<f64>, last: usize, step: &Step| {
            let frames_ago = last.saturating_sub(virtual_insole.frame_at(step.start_us));
            let index = (recent_s.len() - 1).checked_sub(frames_ago);
            index.map_or(step.start_s(), |index| recent_s[index])
        };
        let (mut last, mut has_swing, mut others) = (0, false, ContactCollector::new(&virtual_insole.setup));
        // The repetitions of the last frame, which have no time, are not evaluated: their load was not recorded.
        while let Some(Scan { index: i, t_s: Some(t_s), codes }) = scans.next_scan()? {
            let toe_off = insole.frame(i as u32, codes);
            has_swing |= !insole.on_ground();
            others.frame(t_s, toe_off, &insole);
            if has_starts {
                times_s.push(t_s);
            }
            last = i;
            recent_s.push_back(t_s);
            if recent_s.len() > longest_frames + 1 {
                recent_s.pop_front();
            }
            if let Some(frames) = &mut frames {
                frames.push(t_s, &insole)?;
            }
            let step = completed_step(toe_off, &mut insole);
            if let Some(picture) = &mut picture {
                picture.push(&insole, codes, step);
            }
            records.step_starts_s.extend(step.map(|step| heel_strike_s(&recent_s, last, &step)));
            records.steps.extend(step);
            records.bouts.extend(insole.take_bout().as_ref().map(Bout::new));
            records.alerts.extend(insole.take_alert().as_ref().map(Alert::new));
            if i % 4096 == 0 {
                bar.set_position(i as u64);
            }
        }
        let toe_off = insole.end_stance();
        let step = completed_step(toe_off, &mut insole);
        if let Some(picture) = picture.as_mut().filter(|_| step.is_some()) {
            picture.push(&insole, &[], step);
        }
        records.step_starts_s.extend(step.map(|step| heel_strike_s(&recent_s, last, &step)));
        records.steps.extend(step);
        records.bouts.extend(std::iter::from_fn(|| insole.end_bout()).map(|bout| Bout::new(&bout)));
        insole.end_load();
        records.alerts.extend(insole.take_alert().as_ref().map(Alert::new));
        bar.finish_and_clear();
        // The record with its start at the time of its frame, s, to the microsecond. `start_us` is on the insole's clock.
        let with_start = |mut record: Value, start_us: u64| {
            // An alert starts at the end of a second, which can be that of the last frame.
            if let Some(t_s) = times_s.get(virtual_insole.frame_at(start_us)).or(times_s.last()) {
                record["start_s"] = json!((t_s * 1e6).round() / 1e6);
            }
            record
        };
        if let Some(path) = &self.json {
            let steps = records.steps.iter().map(|step| with_start(step_to_json(step), step.start_us));
            write_json(path, steps)?;
        }
        if let Some(path) = &self.steps {
            tables::write_steps(path, &records.steps, &records.step_starts_s)?;
        }
        if let Some(path) = &self.bouts {
            let bouts = records.bouts.iter().map(|bout| with_start(bout_to_json(bout), bout.start_us));
            write_json(path, bouts)?;
        }
        if let Some(path) = &self.load {
            let alerts = records.alerts.iter().map(|alert| with_start(alert_to_json(alert), alert.start_us));
            let alerts: Vec<_> = alerts.collect();
            if times_s.last().zip(times_s.first()).is_some_and(|(last, first)| last - first > DAY_S) {
                eprintln!("note: the recording is longer than a day: {} has the load of its last day", path.display());
            }
            let load = json!({ "load": daily_load_to_json(&insole.daily_load()), "alerts": alerts });
            write_text(path, &serde_json::to_string_pretty(&load)?)?;
        }
        if let Some(frames) = frames {
            frames.finish()?;
        }
        let others = others.end(&insole).contacts;
        match has_swing {
            true => print_cut_off(&others, &self.recording),
            false => eprintln!("note: no swing was recognised: {LIFT_THE_FOOT}"),
        }
        if let Some(line) = others_note(&others, &virtual_insole.setup.stance, &OPTION_NAMES) {
            println!("{line}");
        }
        if let Some(note) = range_note(&records.steps) {
            eprintln!("note: {note}");
        }
        summary::print_faults(insole.faults(), head.cells());
        if let (Some(picture), Some(path)) = (picture, &self.picture) {
            picture.write(path, &head, virtual_insole)?;
        }
        Ok(records)
    }
}

/// Prints a line for each contact that the beginning or the end of the recording `path` cuts off: its time, s, and the reason.
fn print_cut_off(contacts: &[OtherContact], path: &Path) {
    for OtherContact { start_s, reason, .. } in contacts.iter().filter(|contact| contact.reason.is_cut_off()) {
        println!("left out: {} at {start_s:.2} s, {reason}", path.display());
    }
}

/// Writes the text and a final line break to a file.
pub fn write_text(path: &Path, text: &str) -> Result<()> {
    write(path, format!("{text}\n").as_bytes())
}

/// A progress bar that counts to `total`. It is hidden if stderr is not a terminal.
pub fn progress(total: u64, unit: &str) -> ProgressBar {
    // The template is valid for every unit, so the default is never used.
    let style = ProgressStyle::with_template(&format!("{{bar:40}} {{percent}} % of {{len}} {unit}, {{eta}} left"));
    ProgressBar::new(total).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

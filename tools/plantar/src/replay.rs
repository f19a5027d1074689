//! `plantar replay`: the insole's own code on this computer.

use crate::frames::FrameWriter;
use crate::setup::{self, Contact, Wearer, Zeroed};
use crate::{picture, summary};
use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use client::step_to_json;
use indicatif::{ProgressBar, ProgressStyle};
use plantar::Real;
use plantar::insole::Insole;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::Step;
use recording::{MAX_CELLS, Recording, VirtualInsole};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Computes the steps of a recording as the insole would, with the same code.
///
/// Recorded pressures first become the codes of a virtual sensor, exactly as in `plantar emulate`, so both give the same
/// steps to the last digit (in f32; f64 shows how little single precision matters).
#[derive(Args)]
pub struct Replay {
    /// The recording.
    recording: PathBuf,
    #[command(flatten)]
    wearer: Wearer,
    #[command(flatten)]
    contact: Contact,
    #[command(flatten)]
    zero: Zeroed,
    /// Arithmetic: f32 as on the device, or f64. Steps are written in the wire's units either way; --frames has all digits.
    #[arg(long, value_enum, default_value_t = Precision::F32)]
    precision: Precision,
    /// Write one object a step to this file: side, number, start, duration and, per region, every quantity with its unit.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write every frame's live values to this file: .csv or .parquet.
    #[arg(long, value_name = "FILE")]
    frames: Option<PathBuf>,
    /// Draw the first step to this file: .svg.
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Precision {
    F32,
    F64,
}

impl Replay {
    pub fn run(&self) -> Result<()> {
        let recording = Recording::read(&self.recording)?;
        let parameters = self.wearer.parameters()?;
        let tissue = parameters.tissue();
        let mut worn = setup::insole(&recording, self.contact.rule(parameters.identified.as_ref())?)?;
        self.zero.wear(&mut worn)?;
        let start = Instant::now();
        let steps = match self.precision {
            Precision::F32 => self.replay::<f32>(&recording, &worn, &tissue)?,
            Precision::F64 => self.replay::<f64>(&recording, &worn, &tissue)?,
        };
        let seconds = start.elapsed().as_secs_f64();
        if let Some(path) = &self.json {
            write_json(path, &steps)?;
        }
        summary::print(&steps);
        let frames = recording.frames();
        eprintln!("{frames} frames of {} cells in {seconds:.2} s", recording.cells());
        Ok(())
    }

    fn replay<R: Real>(&self, recording: &Recording, worn: &VirtualInsole, tissue: &Tissue) -> Result<Vec<Step>> {
        let mut insole = Box::new(Insole::<R, MAX_CELLS>::new());
        let accepted = insole.set_up(worn.setup, worn.cells.iter().copied());
        accepted.with_context(|| format!("{} cannot be worn", self.recording.display()))?;
        insole.set_tissue(tissue)?;
        let mut frames =
            self.frames.as_deref().map(|path| FrameWriter::create(path, worn.setup.contact)).transpose()?;
        let mut drawing = self.picture.is_some().then(picture::Drawing::default);
        let count = worn.frames(recording);
        let bar = progress(count as u64, "frames");
        let mut codes = vec![0; worn.cells.len()];
        let mut steps = Vec::new();
        for i in 0..count {
            worn.codes_of(recording, i, &mut codes);
            let toe_off = insole.frame(i as u32, &codes);
            if let Some(frames) = frames.as_mut().filter(|_| i < recording.frames()) {
                frames.push(recording.t_s[i], &insole)?;
            }
            if let Some(drawing) = &mut drawing {
                drawing.push(&insole);
            }
            if toe_off && let Some(step) = insole.whole_step() {
                steps.push(Step::new(&step));
            }
            if i % 4096 == 0 {
                bar.set_position(i as u64);
            }
        }
        bar.finish_and_clear();
        if let Some(frames) = frames {
            frames.finish()?;
        }
        summary::print_faults(insole.faults(), recording.cells());
        if let (Some(drawing), Some(path)) = (drawing, &self.picture) {
            drawing.draw(path, recording, worn, steps.first())?;
        }
        Ok(steps)
    }
}

/// One object a step, as a JSON array.
pub fn write_json(path: &Path, steps: &[Step]) -> Result<()> {
    let objects: Vec<_> = steps.iter().map(step_to_json).collect();
    let text = serde_json::to_string_pretty(&objects)? + "\n";
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

/// A bar for long work, hidden where stderr is no terminal.
pub fn progress(total: u64, unit: &str) -> ProgressBar {
    // The template is a constant that parses.
    let style = ProgressStyle::with_template(&format!("{{bar:40}} {{percent}} % of {{len}} {unit}, {{eta}} left"));
    ProgressBar::new(total).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

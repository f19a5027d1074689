//! The identification of the wearer of an emulated insole from the cells that the insole sends.

use crate::fit::Fit;
use crate::setup::InsoleArgs;
use anyhow::{Context, Result};
use client::{Carrier, CellReceiver, Client, StartedCells};
use parameters::Parameters;
use plantar::protocol::{CellFrame, CellStream, Resolution, Step, ToHost};
use recording::StreamedCells;
use std::path::{Path, PathBuf};

/// The name of the recording in the folder of an identification.
const RECORDING: &str = "cells.parquet";

/// Records cells until there are enough steps, then identifies the wearer.
pub struct Identification {
    folder: PathBuf,
    receiver: CellReceiver,
    cells: StreamedCells,
    /// Number of steps that are still needed.
    needed: usize,
    /// Time of the frame in which the insole sent its first status after it had received the parameters, us, on the clock of the
    /// steps, which counts frames; `None` before. With `--speed max`, this clock differs from the time since the start of the
    /// board.
    sent_us: Option<u64>,
}

impl Identification {
    /// The files that an identification writes to its folder: the recording, and the outputs of [`Fit::of_cells`].
    pub fn files(folder: &Path) -> [PathBuf; 4] {
        [RECORDING, "params.toml", "report.html", "fit.json"].map(|name| folder.join(name))
    }

    /// Starts the stream of cells. `steps` is the number of steps from which the wearer is identified.
    pub fn begin(client: &mut Client<impl Carrier>, folder: &Path, steps: usize) -> Result<Self> {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
        let stream = CellStream { resolution: Resolution::Converter, every: 1 };
        let StartedCells { setup, cells, receiver } = client.start_cells(stream)?;
        Ok(Self {
            folder: folder.into(),
            receiver,
            cells: StreamedCells::new(setup, cells, stream.every),
            needed: steps,
            sent_us: None,
        })
    }

    /// Adds a frame of cells. The recording ends at the first gap that is too long to be interpolated.
    pub fn frame(&mut self, frame: &CellFrame) {
        if self.receiver.frame(frame) && self.cells.is_continued_by(frame.scan) {
            self.cells.push(frame.scan, self.receiver.codes());
        }
    }

    /// Counts a step. Returns true if it began after the insole had received the parameters.
    pub fn count(&mut self, step: &Step) -> bool {
        self.needed = self.needed.saturating_sub(1);
        self.sent_us.is_some_and(|sent_us| step.start_us > sent_us)
    }

    /// True if there are enough steps, and the parameters were not identified yet.
    pub fn is_due(&self) -> bool {
        self.needed == 0 && self.sent_us.is_none()
    }

    /// True once the insole has received the parameters.
    pub fn has_sent_parameters(&self) -> bool {
        self.sent_us.is_some()
    }

    /// Identifies the parameters from the recorded cells, as `plantar fit` does with the shoe size and the rules of these
    /// options, and sends them to the insole. Returns the messages that arrived meanwhile, in their order.
    pub fn identify(&mut self, client: &mut Client<impl Carrier>, options: &InsoleArgs) -> Result<Vec<ToHost>> {
        let recording = self
            .cells
            .take("Recorded from the emulated insole")
            .context("no frame of all cells arrived from the insole: run the command again")?;
        let path = self.folder.join(RECORDING);
        println!(
            "\n{} frames of all cells arrived from the insole; {} were lost. The wearer's parameters are identified from {} \
             frames, interpolated ones included:",
            self.receiver.received,
            self.receiver.lost,
            recording.frames()
        );
        client.stream_cells(None)?;
        let mut arrived = Vec::new();
        std::thread::scope(|scope| {
            let fitted = scope.spawn(|| {
                recording.write(&path)?;
                let InsoleArgs { contact, stance, wearer, .. } = options;
                let fit = Fit::of_cells(path, &self.folder, contact.clone(), stance.clone(), wearer.size);
                fit.write(&fit.study()?)
            });
            // QEMU stops the board while nobody reads its link.
            while !fitted.is_finished() {
                arrived.extend(client.receive()?);
            }
            fitted.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })?;
        let parameters = Parameters::read(&self.folder.join("params.toml"))?;
        match &parameters.identified {
            Some(identified) => client.set_identified_tissue(&parameters.tissue(), identified.on_insole()?)?,
            None => client.set_tissue(&parameters.tissue())?,
        }
        println!("The insole has received these parameters over its link.\n");
        // The insole may have measured further steps meanwhile, without the parameters.
        let frames = client.status()?.frame_times();
        self.sent_us = Some(u64::from(frames) * u64::from(client.hello().period_us));
        Ok(arrived)
    }
}

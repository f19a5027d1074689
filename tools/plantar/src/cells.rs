//! Records the stream of all cells, for `plantar record --cells`.

use crate::carrier::AnyClient;
use anyhow::{Context, Result};
use client::{CellReceiver, StartedCells};
use plantar::protocol::{CellFrame, CellStream};
use recording::StreamedCells;
use std::path::PathBuf;

/// Writes the cells of one session: folders `000`, `001`, ... with the parts of one recording each.
pub struct CellRecorder {
    folder: PathBuf,
    /// Number of the recording in progress.
    pub recording: usize,
    /// Number of the next part of this recording.
    part: usize,
    receiver: CellReceiver,
    /// The frames that are not written yet.
    cells: StreamedCells,
    /// Provenance, for the metadata of the recordings.
    source: String,
    /// Number of frames in the parts that are written.
    written: usize,
}

impl CellRecorder {
    /// Reads the configuration of the insole and starts the stream. `recording` is the number of the first recording.
    pub fn begin(client: &mut AnyClient, stream: CellStream, folder: PathBuf, recording: usize) -> Result<Self> {
        let StartedCells { setup, cells, receiver } = client.start_cells(stream)?;
        let identity = client.identity()?;
        let hello = client.hello();
        let source = format!(
            "Recorded from the {} insole {} ({} {}) in {} bits a code",
            hello.side.name(),
            identity.serial.as_str(),
            hello.board,
            hello.firmware,
            stream.resolution.bits()
        );
        Ok(Self {
            folder,
            recording,
            part: 0,
            receiver,
            cells: StreamedCells::new(setup, cells, stream.every),
            source,
            written: 0,
        })
    }

    /// Adds a frame. A long gap ends the recording and begins the next one.
    pub fn frame(&mut self, frame: &CellFrame) -> Result<()> {
        if !self.receiver.frame(frame) {
            return Ok(());
        }
        if !self.cells.is_continued_by(frame.scan) {
            self.complete_part()?;
            self.cells.restart();
            self.recording += 1;
            self.part = 0;
        }
        self.cells.push(frame.scan, self.receiver.codes());
        Ok(())
    }

    /// Writes the frames so far as the next part.
    pub fn complete_part(&mut self) -> Result<()> {
        let Some(recording) = self.cells.take(&self.source) else { return Ok(()) };
        let folder = self.folder.join(format!("{:03}", self.recording));
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        // A part has its name once it is complete, so that a crash leaves no incomplete one.
        let path = folder.join(format!("part-{:05}.parquet", self.part));
        let incomplete = path.with_extension("incomplete");
        recording.write(&incomplete)?;
        std::fs::rename(&incomplete, &path).with_context(|| format!("cannot write {}", path.display()))?;
        self.part += 1;
        self.written += recording.frames();
        Ok(())
    }

    /// Prints what was recorded and what is missing.
    pub fn print(&self) {
        let CellReceiver { lost, dropped, .. } = self.receiver;
        println!(
            "cells in {}: {} frames in {} recordings; {lost} frames lost on the way, {dropped} dropped by the insole",
            self.folder.display(),
            self.written,
            self.recording + usize::from(self.part > 0)
        );
    }
}

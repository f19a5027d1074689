//! Streams of all cells: records one for `plantar record --cells`, and starts one that is slow enough for any connection.

use crate::carrier::AnyClient;
use anyhow::{Context, Result};
use client::{CellReceiver, Error, StartedCells};
use plantar::protocol::{CellFrame, CellStream, Refusal, Resolution};
use recording::StreamedCells;
use std::path::PathBuf;

/// Starts a stream of the whole codes of all cells with about `hz` frames per second, or with the rate that the connection
/// allows if it is lower. Also returns the stream.
///
/// # Errors
/// Those of [`client::Client::start_cells`].
pub fn start_slowly(client: &mut AnyClient, hz: f64) -> Result<(StartedCells, CellStream), Error> {
    let every = 1e6 / (hz * f64::from(client.hello().period_us));
    let mut stream = CellStream { resolution: Resolution::Oversampled, every: every.clamp(1.0, 255.0) as u8 };
    let started = match client.start_cells(stream) {
        Err(Error::Refused(Refusal::CellRate { every })) if every > 0 => {
            stream.every = every;
            client.start_cells(stream)?
        }
        started => started?,
    };
    Ok((started, stream))
}

/// Writes the stream of cells to folders `000`, `001`, ..., each with the parts of one recording. Another recording begins with
/// each session, and after a gap that is too long to be interpolated.
pub struct CellRecorder {
    stream: CellStream,
    folder: PathBuf,
    /// Number of the recording in progress.
    recording: usize,
    /// Number of the next part of this recording.
    part: usize,
    session: Session,
    /// Number of frames in all parts that were written, interpolated ones included.
    written: usize,
    /// Number of frames that were lost on the way in earlier sessions.
    lost: u64,
    /// Number of frames that the insole dropped in earlier sessions.
    dropped: u64,
}

/// The stream of one session.
struct Session {
    receiver: CellReceiver,
    /// The frames that are not written yet.
    cells: StreamedCells,
    /// Provenance, for the metadata of the recordings.
    source: String,
}

impl Session {
    /// Reads the configuration of the insole and starts the stream.
    fn start(client: &mut AnyClient, stream: CellStream) -> Result<Self, Error> {
        let StartedCells { setup, cells, receiver } = client.start_cells(stream)?;
        let identity = client.identity()?;
        let hello = client.hello();
        let source = format!(
            "Recorded from the {} insole {} ({} {}) with {} bits per code",
            hello.side.name(),
            identity.serial.as_str(),
            hello.board,
            hello.firmware,
            stream.resolution.bits()
        );
        Ok(Self { receiver, cells: StreamedCells::new(setup, cells, stream.every), source })
    }
}

impl CellRecorder {
    /// Starts the stream of the first session.
    pub fn begin(client: &mut AnyClient, stream: CellStream, folder: PathBuf) -> Result<Self, Error> {
        let session = Session::start(client, stream)?;
        Ok(Self { stream, folder, recording: 0, part: 0, session, written: 0, lost: 0, dropped: 0 })
    }

    /// Starts the stream of another session. After an error, this function can be called again.
    pub fn restart(&mut self, client: &mut AnyClient) -> Result<()> {
        self.complete_part()?;
        let session = Session::start(client, self.stream)?;
        let CellReceiver { lost, dropped, .. } = std::mem::replace(&mut self.session, session).receiver;
        self.lost += u64::from(lost);
        self.dropped += u64::from(dropped);
        self.end_recording();
        Ok(())
    }

    /// Makes the next part the first one of another recording, unless the current recording has no parts yet.
    fn end_recording(&mut self) {
        self.recording = self.recordings();
        self.part = 0;
    }

    /// Number of recordings of which at least one part was written.
    fn recordings(&self) -> usize {
        self.recording + usize::from(self.part > 0)
    }

    /// Adds a frame. After a gap that is too long to be interpolated, the frame begins another recording.
    pub fn frame(&mut self, frame: &CellFrame) -> Result<()> {
        if !self.session.receiver.frame(frame) {
            return Ok(());
        }
        if !self.session.cells.is_continued_by(frame.scan) {
            self.complete_part()?;
            self.session.cells.restart();
            self.end_recording();
        }
        self.session.cells.push(frame.scan, self.session.receiver.codes());
        Ok(())
    }

    /// Writes the frames that are not written yet as the next part.
    pub fn complete_part(&mut self) -> Result<()> {
        let Session { cells, source, .. } = &mut self.session;
        let Some(recording) = cells.take(source) else { return Ok(()) };
        let folder = self.folder.join(format!("{:03}", self.recording));
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        recording.write(folder.join(format!("part-{:05}.parquet", self.part)))?;
        self.part += 1;
        self.written += recording.frames();
        Ok(())
    }

    /// Prints what was recorded and what is missing.
    pub fn print(&self) {
        let CellReceiver { lost, dropped, .. } = self.session.receiver;
        println!(
            "cells in {}: {} frames in {} recordings; {} frames lost on the way, {} dropped by the insole",
            self.folder.display(),
            self.written,
            self.recordings(),
            self.lost + u64::from(lost),
            self.dropped + u64::from(dropped)
        );
    }
}

//! The codes that an insole would measure with the pressures of a recording, frame by frame.

use crate::reader::Block;
use crate::{Recording, RecordingReader, Result, VirtualInsole};
use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::{self, JoinHandle};

/// A recording in memory, or a stored one.
pub enum FrameSource<'a> {
    /// A recording in memory.
    Memory(&'a Recording),
    /// A stored recording.
    File(Box<RecordingReader>),
}

impl FrameSource<'_> {
    /// The description of the recording. Whether it contains the frames depends on the source.
    pub fn head(&self) -> &Recording {
        match self {
            Self::Memory(recording) => recording,
            Self::File(reader) => &reader.head,
        }
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        match self {
            Self::Memory(recording) => recording.frames(),
            Self::File(reader) => reader.frames(),
        }
    }

    /// The largest pressure, kPa.
    ///
    /// # Errors
    /// See [`RecordingReader::largest_kpa`].
    pub fn largest_kpa(&self) -> Result<f32> {
        match self {
            Self::Memory(recording) => Ok(recording.largest_kpa()),
            Self::File(reader) => reader.largest_kpa(),
        }
    }
}

impl<'a> From<&'a Recording> for FrameSource<'a> {
    fn from(recording: &'a Recording) -> Self {
        Self::Memory(recording)
    }
}

impl From<RecordingReader> for FrameSource<'_> {
    fn from(reader: RecordingReader) -> Self {
        Self::File(Box::new(reader))
    }
}

/// The scans of a virtual insole: the frames of a recording, and repetitions of its last frame, which confirm a toe off at the
/// end.
pub struct Scans<'a> {
    insole: &'a VirtualInsole,
    frames: Frames<'a>,
    /// Number of scans that were returned, repetitions included.
    returned: usize,
    /// Number of repetitions that remain to be returned.
    repetitions: usize,
    codes: Vec<u16>,
}

/// One scan.
pub struct Scan<'a> {
    /// The number of the scan, from 0.
    pub index: usize,
    /// The time of the frame, s; `None` for a repetition of the last frame.
    pub t_s: Option<f64>,
    /// The codes in the order of the insole.
    pub codes: &'a [u16],
}

/// The source of the frames.
enum Frames<'a> {
    Memory(&'a Recording),
    /// Blocks of a file that another thread decodes, the current block, and the index of the next frame in this block.
    File {
        blocks: Receiver<Result<Block<u16>>>,
        /// The thread that decodes; `None` after the last block.
        decoder: Option<JoinHandle<()>>,
        block: Block<u16>,
        next: usize,
    },
}

impl VirtualInsole {
    /// The scans of a recording. A file is decoded by other threads, a few blocks of frames ahead.
    pub fn scans<'a>(&'a self, source: impl Into<FrameSource<'a>>) -> Scans<'a> {
        let reader = match source.into() {
            FrameSource::Memory(recording) => return Scans::new(self, Frames::Memory(recording)),
            FrameSource::File(reader) => reader,
        };
        let (sender, blocks) = sync_channel(1);
        let insole = self.clone();
        let decoder = Some(thread::spawn(move || {
            let order = insole.order();
            for block in reader.blocks(&order, &|cell, pressure_kpa| insole.codes_of_cell(cell, pressure_kpa)) {
                let is_last = block.is_err();
                // The receiver is gone if the consumer needs no more scans.
                if sender.send(block).is_err() || is_last {
                    break;
                }
            }
        }));
        let block = Block { t_s: Vec::new(), values: Vec::new() };
        Scans::new(self, Frames::File { blocks, decoder, block, next: 0 })
    }
}

impl<'a> Scans<'a> {
    fn new(insole: &'a VirtualInsole, frames: Frames<'a>) -> Self {
        let codes = vec![0; insole.cells.len()];
        Self { insole, frames, returned: 0, repetitions: insole.repetitions(), codes }
    }

    /// The next scan, or `None` after the last one.
    ///
    /// # Errors
    /// Fails if a file is damaged or its frames violate a rule of recordings.
    pub fn next_scan(&mut self) -> Result<Option<Scan<'_>>> {
        let index = self.returned;
        let t_s = match &mut self.frames {
            Frames::Memory(recording) => {
                let t_s = recording.t_s.get(index).copied();
                if t_s.is_some() {
                    self.insole.codes(recording.frame(index), &mut self.codes);
                }
                t_s
            }
            Frames::File { blocks, decoder, block, next } => {
                while *next >= block.t_s.len() {
                    let Ok(received) = blocks.recv() else {
                        // A panic of the decoder is not the end of the recording.
                        if let Some(Err(panic)) = decoder.take().map(JoinHandle::join) {
                            resume_unwind(panic);
                        }
                        break;
                    };
                    // No repetitions of the last frame follow after an error.
                    (*block, *next) = (received.inspect_err(|_| self.repetitions = 0)?, 0);
                }
                let t_s = block.t_s.get(*next).copied();
                if t_s.is_some() {
                    let cells = self.codes.len();
                    self.codes.copy_from_slice(&block.values[*next * cells..(*next + 1) * cells]);
                    *next += 1;
                }
                t_s
            }
        };
        if t_s.is_none() {
            if self.repetitions == 0 {
                return Ok(None);
            }
            self.repetitions -= 1;
        }
        self.returned += 1;
        Ok(Some(Scan { index, t_s, codes: &self.codes }))
    }
}

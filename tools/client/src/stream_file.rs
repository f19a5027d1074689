//! The file of a recorded stream. For each message it contains the time in ms (u32, wraps after 49.7 days), the index of the
//! insole (u8), the length of the message (u16), all little endian, and the message.

use crate::{create_or_open_empty, sync_data};
use plantar::protocol::{LoadRecord, MAX_MESSAGE, ToHost, encode};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;
use thiserror::Error;

/// Largest number of insoles in a file: one for each foot.
pub const STREAM_INSOLES: usize = 2;
/// Length of an entry without its message, bytes.
const HEAD: usize = 7;

/// A stream file to which messages are appended as they arrive.
pub struct StreamFile {
    path: PathBuf,
    out: BufWriter<File>,
    start: Instant,
}

impl StreamFile {
    /// Begins a file, which must be new or empty. The times in the file count from this call.
    ///
    /// # Errors
    /// Those of [`create_or_open_empty`].
    pub fn create(path: &Path) -> io::Result<Self> {
        let out = BufWriter::new(create_or_open_empty(path)?);
        Ok(Self { path: path.into(), out, start: Instant::now() })
    }

    /// Writes a message with the time since the start. All messages except live frames are flushed to the file, with the live
    /// frames before them. Steps, load bouts and alerts, which the insole deletes once they are acknowledged, are also
    /// synchronised: they survive a loss of power of this computer.
    ///
    /// # Errors
    /// If the message cannot be written. The text of the error names the file.
    pub fn write(&mut self, insole: u8, message: &ToHost) -> io::Result<()> {
        let t_ms = self.start.elapsed().as_millis() as u32;
        let written = append(&mut self.out, t_ms, insole, message).and_then(|()| match message {
            ToHost::Live(_) => Ok(()),
            message if LoadRecord::of(message).is_some() => self.sync(),
            _ => self.out.flush(),
        });
        written.map_err(|error| self.named(error))
    }

    /// Completes the file: without this call, an error of writing the last live frames would remain unknown.
    ///
    /// # Errors
    /// If a message cannot be written. The text of the error names the file.
    pub fn finish(mut self) -> io::Result<()> {
        self.sync().map_err(|error| self.named(error))
    }

    fn sync(&mut self) -> io::Result<()> {
        self.out.flush()?;
        sync_data(self.out.get_ref())
    }

    fn named(&self, error: io::Error) -> io::Error {
        io::Error::new(error.kind(), format!("cannot write {}: {error}", self.path.display()))
    }
}

/// Writes one message of the insole with index `insole`; `t_ms` is the time since the beginning of the file, ms.
///
/// # Errors
/// If the message cannot be written.
pub fn append(out: &mut impl Write, t_ms: u32, insole: u8, message: &ToHost) -> io::Result<()> {
    let mut buffer = [0; MAX_MESSAGE];
    let message = encode(message, &mut buffer).map_err(io::Error::other)?;
    out.write_all(&t_ms.to_le_bytes())?;
    // The length is at most MAX_MESSAGE.
    out.write_all(&[&[insole][..], &(message.len() as u16).to_le_bytes()].concat())?;
    out.write_all(message)
}

/// An entry of a stream file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry<'f> {
    /// Time since the beginning of the file, ms; wraps.
    pub t_ms: u32,
    /// Index of the insole, less than [`STREAM_INSOLES`].
    pub insole: usize,
    /// The encoded message.
    pub message: &'f [u8],
}

/// The file is damaged at this byte, or is not a stream file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("damaged at byte {0}")]
pub struct DamagedAt(pub usize);

/// The entries of a stream file, up to the first damaged one.
#[derive(Clone, Debug)]
pub struct Entries<'f> {
    file: &'f [u8],
    /// Offset of the next entry, bytes.
    at: usize,
    is_damaged: bool,
}

impl<'f> Entries<'f> {
    /// The entries in the content of a file.
    pub fn new(file: &'f [u8]) -> Self {
        Self { file, at: 0, is_damaged: false }
    }

    /// The bytes that no entry has used so far. After the last entry these are the beginning of an incomplete one, if the file is
    /// truncated.
    pub fn rest(&self) -> &'f [u8] {
        &self.file[self.at..]
    }
}

impl<'f> Iterator for Entries<'f> {
    type Item = Result<Entry<'f>, DamagedAt>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_damaged {
            return None;
        }
        let ([t0, t1, t2, t3, insole, low, high], rest) = self.rest().split_first_chunk::<HEAD>()?;
        let (insole, length) = (usize::from(*insole), usize::from(u16::from_le_bytes([*low, *high])));
        if insole >= STREAM_INSOLES || !(1..=MAX_MESSAGE).contains(&length) {
            self.is_damaged = true;
            return Some(Err(DamagedAt(self.at)));
        }
        let message = rest.get(..length)?;
        self.at += HEAD + length;
        Some(Ok(Entry { t_ms: u32::from_le_bytes([*t0, *t1, *t2, *t3]), insole, message }))
    }
}

//! The file of a recorded stream. For each message it contains the time in ms (u32), the index of the insole (u8), the length of
//! the message (u16), all little endian, and the message.

use crate::create_new;
use plantar::protocol::{MAX_MESSAGE, ToHost, encode};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

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
    /// If the file cannot be opened for writing, or is not empty.
    pub fn create(path: &Path) -> io::Result<Self> {
        let out = BufWriter::new(create_new(path)?);
        Ok(Self { path: path.into(), out, start: Instant::now() })
    }

    /// Writes a message with the time since the start. All messages except live frames are flushed to the file, with the live
    /// frames before them.
    ///
    /// # Errors
    /// If the message cannot be written. The text of the error names the file.
    pub fn write(&mut self, insole: u8, message: &ToHost) -> io::Result<()> {
        let t_ms = self.start.elapsed().as_millis() as u32;
        let written = append(&mut self.out, t_ms, insole, message).and_then(|()| match message {
            ToHost::Live(_) => Ok(()),
            _ => self.out.flush(),
        });
        written.map_err(|error| io::Error::new(error.kind(), format!("cannot write {}: {error}", self.path.display())))
    }
}

/// Writes one message of the insole with index `insole`, at the time `t_ms`, ms.
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

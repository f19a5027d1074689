//! A recorded stream: per message the time in ms (u32), the insole (u8), the length (u16), little endian, and the message.

use plantar::protocol::{MAX_MESSAGE, ToHost, encode};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A stream file that grows as messages come.
pub struct StreamFile {
    path: PathBuf,
    out: BufWriter<File>,
    start: Instant,
    broken: bool,
}

impl StreamFile {
    /// Starts a file, which must be new or empty; time counts from now.
    pub fn create(path: &Path) -> io::Result<Self> {
        let out = BufWriter::new(create_new(path)?);
        Ok(Self { path: path.into(), out, start: Instant::now(), broken: false })
    }

    /// Writes a message with the time since the start; true when it is written, steps through to the file. The first
    /// failure is reported and ends the recording.
    pub(crate) fn write(&mut self, insole: u8, message: &ToHost) -> bool {
        if self.broken {
            return false;
        }
        let t_ms = self.start.elapsed().as_millis() as u32;
        let written = append(&mut self.out, t_ms, insole, message).and_then(|()| match message {
            ToHost::Live(_) => Ok(()),
            _ => self.out.flush(),
        });
        if let Err(error) = &written {
            let path = self.path.display();
            eprintln!("the recording {path} has ended: {error}; steps stay on the insole until a page takes them");
            self.broken = true;
        }
        written.is_ok()
    }
}

/// A file to write, new or empty: what is in one may be nowhere else.
pub fn create_new(path: &Path) -> io::Result<File> {
    let file = File::options().write(true).create(true).truncate(false).open(path)?;
    match file.metadata()?.len() {
        0 => Ok(file),
        _ => Err(io::Error::new(io::ErrorKind::AlreadyExists, "it is not empty: name a new file")),
    }
}

/// Writes one message.
pub fn append(out: &mut impl Write, t_ms: u32, insole: u8, message: &ToHost) -> io::Result<()> {
    let mut buffer = [0; MAX_MESSAGE];
    let message = encode(message, &mut buffer).map_err(io::Error::other)?;
    out.write_all(&t_ms.to_le_bytes())?;
    // At most MAX_MESSAGE, 320.
    out.write_all(&[&[insole][..], &(message.len() as u16).to_le_bytes()].concat())?;
    out.write_all(message)
}

//! The log of the emulated board: `defmt` frames that QEMU writes to its standard output.

use defmt_decoder::{DecodeError, Table};
use std::fmt;
use thiserror::Error;

/// One message of the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogEntry {
    /// Time since the reset, as the firmware prints it.
    pub time: String,
    /// "error", "warn", "info", "debug" or "trace"; empty for a message without a level.
    pub level: &'static str,
    /// The message. It begins with the name of a part of the firmware, as in "storage: ...".
    pub text: String,
}

impl fmt::Display for LogEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:<5} {}", self.time, self.level, self.text)
    }
}

/// Why a log cannot be decoded.
#[derive(Debug, Error)]
pub enum LogError {
    /// The firmware file lacks the texts of its messages.
    #[error(
        "the firmware file has no log messages: it was built without defmt, or stripped; build it with `cargo xtask build`"
    )]
    NoTable,
    /// The firmware file cannot be read as ELF, or its texts are of an unknown version of defmt.
    #[error("the log messages of the firmware file cannot be read: {0}; build the file with `cargo xtask build`")]
    Table(String),
}

/// Decodes a log with the texts in the file of the firmware that wrote it. Frames that cannot be decoded, for example those of
/// another firmware, are skipped.
///
/// # Errors
/// See [`LogError`].
pub fn decode(firmware: &[u8], log: &[u8]) -> Result<Vec<LogEntry>, LogError> {
    let table = Table::parse(firmware).map_err(|e| LogError::Table(e.to_string()))?.ok_or(LogError::NoTable)?;
    let mut decoder = table.new_stream_decoder();
    decoder.received(log);
    let mut entries = Vec::new();
    loop {
        match decoder.decode() {
            Ok(frame) => entries.push(LogEntry {
                time: frame.display_timestamp().map(|time| time.to_string()).unwrap_or_default(),
                level: frame.level().map_or("", |level| level.as_str()),
                text: frame.display_message().to_string(),
            }),
            Err(DecodeError::Malformed) if table.encoding().can_recover() => {}
            Err(_) => return Ok(entries),
        }
    }
}

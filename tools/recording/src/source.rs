//! The bytes of a Parquet file, in memory or on disk. Threads can read columns of one file at the same time, because each reader
//! has a position of its own; clones of a `std::fs::File` share one position.

use bytes::Bytes;
use parquet::errors::{ParquetError, Result};
use parquet::file::reader::{ChunkReader, Length};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// The bytes of a file.
pub enum Source {
    Memory(Bytes),
    Disk { file: Arc<Mutex<File>>, bytes: u64 },
}

impl Source {
    /// Opens a file.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        let bytes = file.metadata()?.len();
        Ok(Self::Disk { file: Arc::new(Mutex::new(file)), bytes })
    }

    /// True if the bytes from `start` on are `expected`.
    pub fn has(&self, start: u64, expected: &[u8]) -> bool {
        self.get_bytes(start, expected.len()).is_ok_and(|bytes| bytes == expected)
    }
}

impl Length for Source {
    fn len(&self) -> u64 {
        match self {
            Self::Memory(bytes) => bytes.len() as u64,
            Self::Disk { bytes, .. } => *bytes,
        }
    }
}

impl ChunkReader for Source {
    type T = Box<dyn Read>;

    fn get_read(&self, start: u64) -> Result<Self::T> {
        match self {
            Self::Memory(bytes) => Ok(Box::new(bytes.get_read(start)?)),
            Self::Disk { file, .. } => Ok(Box::new(BufReader::new(Position { file: file.clone(), at: start }))),
        }
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes> {
        match self {
            Self::Memory(bytes) => bytes.get_bytes(start, length),
            Self::Disk { bytes, .. } => {
                // A damaged file may claim any length.
                if start.checked_add(length as u64).is_none_or(|end| end > *bytes) {
                    return Err(ParquetError::EOF(format!("{length} bytes at {start} of a file of {bytes} bytes")));
                }
                let mut buffer = vec![0; length];
                self.get_read(start)?.read_exact(&mut buffer)?;
                Ok(buffer.into())
            }
        }
    }
}

/// A reader with a position of its own.
struct Position {
    file: Arc<Mutex<File>>,
    at: u64,
}

impl Read for Position {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // Every reader sets the position before it reads, so a reader that panicked leaves nothing invalid.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(self.at))?;
        let read = file.read(buffer)?;
        self.at += read as u64;
        Ok(read)
    }
}

//! The bytes of a Parquet file, in memory or on disk. Several threads can read columns of one file at the same time, because
//! each reader has its own position. Clones of a `std::fs::File` would share one position.

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
            Self::Memory(bytes) => Ok(Box::new(EndGuard { reader: bytes.get_read(start)?, empty_reads: 0 })),
            Self::Disk { file, .. } => {
                let reader = BufReader::new(PositionedReader { file: file.clone(), position: start });
                Ok(Box::new(EndGuard { reader, empty_reads: 0 }))
            }
        }
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes> {
        match self {
            Self::Memory(bytes) => bytes.get_bytes(start, length),
            Self::Disk { file, bytes } => {
                // A damaged file may claim any length.
                if start.checked_add(length as u64).is_none_or(|end| end > *bytes) {
                    return Err(ParquetError::EOF(format!("{length} bytes at {start} of a file of {bytes} bytes")));
                }
                let mut buffer = vec![0; length];
                PositionedReader { file: file.clone(), position: start }.read_exact(&mut buffer)?;
                Ok(buffer.into())
            }
        }
    }
}

/// Largest number of reads at the end of a file without an error.
const MAX_EMPTY_READS: u32 = 1_000;

/// A reader that fails after more than [`MAX_EMPTY_READS`] reads at its end. A damaged file may claim a list of any length,
/// and the Parquet library does not stop at the end of the file when it skips the elements of a list.
struct EndGuard<R> {
    reader: R,
    empty_reads: u32,
}

impl<R: Read> Read for EndGuard<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.reader.read(buffer)?;
        if read == 0 && !buffer.is_empty() {
            self.empty_reads += 1;
            if self.empty_reads > MAX_EMPTY_READS {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
        }
        Ok(read)
    }
}

/// A reader of a shared file with its own position.
struct PositionedReader {
    file: Arc<Mutex<File>>,
    position: u64,
}

impl Read for PositionedReader {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // Every reader sets the position before it reads, so a reader that panicked leaves nothing invalid.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(self.position))?;
        let read = file.read(buffer)?;
        self.position += read as u64;
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without this error, a damaged file that claims a list of two billion elements would cause two billion empty reads.
    #[test]
    fn repeated_reads_at_the_end_of_a_file_fail() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), [7; 10]).expect("the file is written");
        for source in [Source::Memory(vec![7; 10].into()), Source::open(file.path()).expect("the file is readable")] {
            let mut reader = source.get_read(3).expect("a reader");
            let mut bytes = Vec::new();
            reader.read_to_end(&mut bytes).expect("the end is no error");
            assert_eq!(bytes, [7; 7]);
            let error = (0..=MAX_EMPTY_READS).find_map(|_| reader.read(&mut [0; 8]).err()).expect("it fails");
            assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
        }
    }
}

//! The serial link of the emulated board.

use crate::port::Stream;
use std::io::{self, Read, Write};
use std::thread::sleep;
use std::time::Duration;

/// Time before a read, in which further bytes arrive. QEMU sends each byte of the board by itself. A reader that waits for the
/// next byte is woken for each of them, and waking it takes more processor time than the board needs to send the byte.
const GATHERING: Duration = Duration::from_millis(1);

/// The board's serial link, a byte stream in both directions.
#[derive(Debug)]
pub struct Link(pub(crate) Stream);

impl Link {
    /// A further handle of the same link.
    ///
    /// # Errors
    /// If a file descriptor cannot be duplicated.
    pub fn try_clone(&self) -> io::Result<Self> {
        self.0.try_clone().map(Self)
    }

    /// Sets the time after which a read through this handle without a byte returns an error; `None` waits without end.
    ///
    /// # Errors
    /// If the time is zero, where the stream is a socket.
    pub fn set_read_timeout(&mut self, timeout: Option<Duration>) -> io::Result<()> {
        self.0.set_read_timeout(timeout)
    }
}

impl Read for Link {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        sleep(GATHERING);
        self.0.read(bytes)
    }
}

impl Write for Link {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

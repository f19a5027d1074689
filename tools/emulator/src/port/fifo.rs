//! Two FIFOs for each serial port. QEMU sends each byte of a port by itself, for which a FIFO needs less processor time than a
//! socket. A FIFO also has room for 64 KiB of such bytes (Linux). A Unix socket has room for some hundred of them, and the board
//! stops while there is no room.

use crate::Error;
use nix::errno::Errno;
use nix::fcntl::OFlag;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::stat::Mode;
use nix::unistd::mkfifo;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::process::Child;
use std::time::Duration;

/// The FIFOs of a serial port.
pub struct Port {
    /// The FIFO from which QEMU reads.
    to_board: PathBuf,
    /// The FIFO to which QEMU writes.
    from_board: PathBuf,
    /// The option of QEMU that connects a serial port to these FIFOs.
    pub argument: String,
}

impl Port {
    /// The FIFO from which QEMU reads, and the one to which it writes.
    pub fn paths(directory: &Path, name: &str) -> [PathBuf; 2] {
        // The suffixes are QEMU's.
        ["in", "out"].map(|suffix| directory.join(format!("{name}.{suffix}")))
    }

    /// Creates the FIFOs, with this name in the directory in which QEMU runs.
    ///
    /// # Errors
    /// If the operating system refuses a FIFO.
    pub fn create(directory: &Path, name: &str) -> Result<Self, Error> {
        let [to_board, from_board] = Self::paths(directory, name);
        for path in [&to_board, &from_board] {
            mkfifo(path, Mode::S_IRUSR | Mode::S_IWUSR).map_err(io::Error::from)?;
        }
        Ok(Self { to_board, from_board, argument: format!("pipe:{name}") })
    }

    /// Waits until QEMU has connected its serial port.
    ///
    /// # Errors
    /// [`Error::Exited`] with QEMU's message if QEMU exits earlier, and [`Error::Timeout`] after
    /// [`START_TIMEOUT`](super::START_TIMEOUT).
    pub fn connect(&self, qemu: &mut Child) -> Result<Stream, Error> {
        let mut writing = OpenOptions::new();
        writing.write(true);
        super::wait(qemu, || {
            // Opening waits for the reader without end, unless it is non-blocking.
            match writing.clone().custom_flags(OFlag::O_NONBLOCK.bits()).open(&self.to_board) {
                Ok(_) => Ok(Some(())),
                Err(e) if e.raw_os_error() == Some(Errno::ENXIO as i32) => Ok(None),
                Err(e) => Err(e),
            }
        })?;
        // QEMU has opened the first FIFO and opens the second one next, so neither of these waits long.
        let to_board = writing.open(&self.to_board)?;
        Ok(Stream { to_board, from_board: File::open(&self.from_board)?, read_timeout: None })
    }
}

/// A byte stream in both directions.
#[derive(Debug)]
pub struct Stream {
    to_board: File,
    from_board: File,
    read_timeout: Option<Duration>,
}

impl Stream {
    /// A further handle of the same stream.
    ///
    /// # Errors
    /// If a file descriptor cannot be duplicated.
    pub fn try_clone(&self) -> io::Result<Self> {
        let (to_board, from_board) = (self.to_board.try_clone()?, self.from_board.try_clone()?);
        Ok(Self { to_board, from_board, read_timeout: self.read_timeout })
    }

    /// Sets the time after which a read through this handle without a byte returns an error; `None` waits without end.
    ///
    /// # Errors
    /// None here; a socket can reject the time.
    pub fn set_read_timeout(&mut self, timeout: Option<Duration>) -> io::Result<()> {
        self.read_timeout = timeout;
        Ok(())
    }
}

impl Read for Stream {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if let Some(timeout) = self.read_timeout {
            let timeout = PollTimeout::try_from(timeout).unwrap_or(PollTimeout::MAX);
            if poll(&mut [PollFd::new(self.from_board.as_fd(), PollFlags::POLLIN)], timeout)? == 0 {
                return Err(io::ErrorKind::WouldBlock.into());
            }
        }
        self.from_board.read(bytes)
    }
}

impl Write for Stream {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.to_board.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

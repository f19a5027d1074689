//! The sockets to which QEMU connects its serial ports. QEMU sends each byte of a port by itself, for which a Unix socket needs
//! less processor time than a TCP connection. A Unix socket has room for some hundred of such bytes, and the board stops while there
//! is no room. TCP is used on systems on which the standard library has no Unix sockets.

use crate::Error;
use std::io::{self, Read};
use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

#[cfg(not(unix))]
use std::net::TcpListener as Listener;
#[cfg(not(unix))]
pub use std::net::TcpStream as Stream;
#[cfg(unix)]
use std::os::unix::net::UnixListener as Listener;
#[cfg(unix)]
pub use std::os::unix::net::UnixStream as Stream;

/// Time within which QEMU must connect its serial ports.
pub const START: Duration = Duration::from_secs(20);

/// A socket to which QEMU connects a serial port.
pub struct Port {
    listener: Listener,
    /// The option of QEMU that connects a serial port to this socket.
    pub argument: String,
}

impl Port {
    /// Creates the socket, with this name in the directory in which QEMU runs.
    ///
    /// # Errors
    /// [`Error::Socket`] if the operating system refuses the socket, for example because its path is too long.
    #[cfg(unix)]
    pub fn listen(directory: &Path, name: &str) -> Result<Self, Error> {
        let path = directory.join(name);
        let listener = Listener::bind(&path).map_err(|reason| Error::Socket { path, reason })?;
        Ok(Self::new(listener, format!("unix:{name}"))?)
    }

    /// Creates the socket at a free TCP port, which needs no name.
    #[cfg(not(unix))]
    pub fn listen(_directory: &Path, _name: &str) -> Result<Self, Error> {
        let listener = Listener::bind((std::net::Ipv4Addr::LOCALHOST, 0))?;
        let argument = format!("tcp:{},nodelay=on", listener.local_addr()?);
        Ok(Self::new(listener, argument)?)
    }

    fn new(listener: Listener, argument: String) -> io::Result<Self> {
        listener.set_nonblocking(true)?;
        Ok(Self { listener, argument })
    }

    /// Waits until QEMU has connected its serial port.
    ///
    /// # Errors
    /// [`Error::Exited`] with QEMU's message if QEMU exits before, and [`Error::Timeout`] after [`START`].
    pub fn accept(&self, qemu: &mut Child) -> Result<Stream, Error> {
        let deadline = Instant::now() + START;
        loop {
            match self.listener.accept() {
                Ok((stream, _)) => {
                    stream.set_nonblocking(false)?;
                    #[cfg(not(unix))]
                    stream.set_nodelay(true)?;
                    return Ok(stream);
                }
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => {}
                Err(e) => return Err(e.into()),
            }
            if qemu.try_wait()?.is_some() {
                let mut message = String::new();
                if let Some(mut stderr) = qemu.stderr.take() {
                    stderr.read_to_string(&mut message)?;
                }
                return Err(Error::Exited(message.trim().into()));
            }
            if Instant::now() > deadline {
                return Err(Error::Timeout);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

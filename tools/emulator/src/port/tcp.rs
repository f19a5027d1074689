//! TCP connections, for systems without FIFOs.

use crate::Error;
use std::io;
use std::net::{Ipv4Addr, TcpListener};
use std::path::Path;
use std::process::Child;

pub use std::net::TcpStream as Stream;

/// A TCP port to which QEMU connects a serial port.
pub struct Port {
    listener: TcpListener,
    /// The option of QEMU that connects a serial port to this TCP port.
    pub argument: String,
}

impl Port {
    /// Listens at a free TCP port, which needs no name.
    ///
    /// # Errors
    /// If the operating system refuses the socket.
    pub fn create(_directory: &Path, _name: &str) -> Result<Self, Error> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        listener.set_nonblocking(true)?;
        let argument = format!("tcp:{},nodelay=on", listener.local_addr()?);
        Ok(Self { listener, argument })
    }

    /// Waits until QEMU has connected its serial port.
    ///
    /// # Errors
    /// [`Error::Exited`] with QEMU's message if QEMU exits earlier, and [`Error::Timeout`] after
    /// [`START_TIMEOUT`](super::START_TIMEOUT).
    pub fn connect(&self, qemu: &mut Child) -> Result<Stream, Error> {
        let stream = super::wait(qemu, || match self.listener.accept() {
            Ok((stream, _)) => Ok(Some(stream)),
            Err(e) if e.kind() == io::ErrorKind::WouldBlock => Ok(None),
            Err(e) => Err(e),
        })?;
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        Ok(stream)
    }
}

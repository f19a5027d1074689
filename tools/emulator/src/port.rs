//! The connections of QEMU's serial ports to this process.

#[cfg(unix)]
mod fifo;
#[cfg(not(unix))]
mod tcp;

#[cfg(unix)]
pub use fifo::{Port, Stream};
#[cfg(not(unix))]
pub use tcp::{Port, Stream};

use crate::Error;
use std::io::{self, Read};
use std::process::Child;
use std::time::{Duration, Instant};

/// Time within which QEMU must connect its serial ports.
pub const START_TIMEOUT: Duration = Duration::from_secs(20);

/// Repeats `connect` until it returns a connection; it returns `None` while QEMU has not connected yet.
///
/// # Errors
/// The errors of `connect`, [`Error::Exited`] with QEMU's message if QEMU exits earlier, and [`Error::Timeout`] after
/// [`START_TIMEOUT`].
fn wait<T>(qemu: &mut Child, mut connect: impl FnMut() -> io::Result<Option<T>>) -> Result<T, Error> {
    let deadline = Instant::now() + START_TIMEOUT;
    loop {
        if let Some(connection) = connect()? {
            return Ok(connection);
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

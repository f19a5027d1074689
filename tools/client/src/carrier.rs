//! Carriers: whole messages over a byte stream or a packet link.

use plantar::protocol::{self, Decoder, MAX_FRAME, MAX_MESSAGE, ToDevice, ToHost};
use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

/// A suitable timeout for reading from a carrier: short enough for a program to react to its user between two reads.
pub const READ_TIMEOUT: Duration = Duration::from_millis(50);

/// Carries whole messages in both directions.
pub trait Carrier {
    /// Sends a message.
    ///
    /// # Errors
    /// Errors of the link, which end the session.
    fn send(&mut self, message: ToDevice) -> io::Result<()>;

    /// The next message; `None` if no message arrived within the carrier's timeout, which is at most one second.
    ///
    /// # Errors
    /// Errors of the link, which end the session.
    fn receive(&mut self) -> io::Result<Option<ToHost>>;

    /// Number of frames that arrived damaged, or whose content is not a message of this protocol version.
    fn damaged(&self) -> u32;

    /// A monotonic clock, us: this computer's, or the virtual one of a simulated carrier.
    fn now_us() -> u64
    where
        Self: Sized,
    {
        static START: LazyLock<Instant> = LazyLock::new(Instant::now);
        START.elapsed().as_micros() as u64
    }

    /// The wall clock, us since 1970, UTC.
    fn unix_us() -> u64
    where
        Self: Sized,
    {
        crate::unix_us()
    }
}

// The functions of the clocks have no `self`, so they cannot be forwarded: a boxed carrier has the clocks of this computer.
impl<C: Carrier + ?Sized> Carrier for Box<C> {
    fn send(&mut self, message: ToDevice) -> io::Result<()> {
        (**self).send(message)
    }

    fn receive(&mut self) -> io::Result<Option<ToHost>> {
        (**self).receive()
    }

    fn damaged(&self) -> u32 {
        (**self).damaged()
    }
}

/// True for an error of reading after which reading can be tried again: no byte arrived in time, or a signal interrupted it.
pub(crate) fn is_pause(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), TimedOut | WouldBlock | Interrupted)
}

/// Messages in frames over a byte stream: a serial port or a network connection. A read must return within a second, with
/// [`io::ErrorKind::TimedOut`] or [`io::ErrorKind::WouldBlock`] if no byte arrived.
pub struct Framed<B> {
    bytes: B,
    decoder: Decoder,
    /// Decoded messages that [`Carrier::receive`] has not returned yet.
    waiting: VecDeque<ToHost>,
    /// Number of undamaged frames whose content is not a message of this protocol version.
    unknown: u32,
    buffer: Vec<u8>,
}

impl<B: Read + Write> Framed<B> {
    /// A carrier over this byte stream.
    pub fn new(bytes: B) -> Self {
        Self { bytes, decoder: Decoder::new(), waiting: VecDeque::new(), unknown: 0, buffer: vec![0; 4096] }
    }
}

impl<B: Read + Write> Carrier for Framed<B> {
    fn send(&mut self, message: ToDevice) -> io::Result<()> {
        let (mut bytes, mut framed) = ([0; MAX_MESSAGE], [0; MAX_FRAME]);
        let message = protocol::encode(&message, &mut bytes).map_err(io::Error::other)?;
        let len = protocol::frame(message, &mut framed);
        self.bytes.write_all(&framed[..len])
    }

    fn receive(&mut self) -> io::Result<Option<ToHost>> {
        if self.waiting.is_empty() {
            let count = match self.bytes.read(&mut self.buffer) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(count) => count,
                Err(e) if is_pause(&e) => 0,
                Err(e) => return Err(e),
            };
            for &byte in &self.buffer[..count] {
                let Some(bytes) = self.decoder.push(byte) else { continue };
                match protocol::decode(bytes) {
                    Some(message) => self.waiting.push_back(message),
                    None => self.unknown = self.unknown.wrapping_add(1),
                }
            }
        }
        Ok(self.waiting.pop_front())
    }

    fn damaged(&self) -> u32 {
        self.decoder.bad_frames.wrapping_add(self.unknown)
    }
}

//! Whole messages over whatever carries them.

use plantar::protocol::{self, Decoder, MAX_FRAME, MAX_MESSAGE, ToDevice, ToHost};
use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::sync::LazyLock;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// Carries whole messages both ways.
pub trait Carrier {
    /// Sends a message.
    fn send(&mut self, message: ToDevice) -> io::Result<()>;

    /// The next message; `None` when none came within a second or so. An error ends the session.
    fn receive(&mut self) -> io::Result<Option<ToHost>>;

    /// Number of messages that arrived damaged, or held no message of this version.
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
        unix_us()
    }
}

/// This computer's clock, us since 1970, UTC.
pub fn unix_us() -> u64 {
    // A clock before 1970 is as wrong as 1970.
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_micros() as u64)
}

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

/// Messages in frames over bytes: a serial port, a network connection. Their reads must return within a second or so, with
/// [`io::ErrorKind::TimedOut`] or [`io::ErrorKind::WouldBlock`] when nothing came.
pub struct Framed<B> {
    bytes: B,
    decoder: Decoder,
    waiting: VecDeque<ToHost>,
    /// Whole frames that held no message of this version.
    unknown: u32,
    buffer: Vec<u8>,
}

impl<B: Read + Write> Framed<B> {
    /// Nothing heard yet.
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
                Err(e) if matches!(e.kind(), io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock) => 0,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => 0,
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

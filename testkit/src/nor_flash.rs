//! A NOR flash chip in memory whose supply fails when a test wants it to.

use embedded_storage_async::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use plantar::storage::flash_map::SECTOR;
use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

/// Where in an operation power fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Torn {
    /// Before anything happened.
    Before,
    /// Some bytes are as they should be, the rest as before; of one byte, only some bits.
    Within,
    /// When all was done, but nobody heard.
    After,
}

/// The chip: what a write does to bits that are 0 already, and what a cut leaves, is as on a real one.
#[derive(Clone)]
pub struct NorFlashChip {
    /// Its contents.
    pub bytes: Vec<u8>,
    /// Writes and erasures of a sector so far.
    pub operations: u64,
    /// How often each sector was erased.
    pub erasures: Vec<u32>,
    /// Bytes written so far.
    pub written: u64,
    /// Power fails in this operation, from 0, and is off from then on.
    pub cut: Option<(u64, Torn)>,
    random: fastrand::Rng,
}

/// Power is off.
#[derive(Debug, PartialEq, Eq)]
pub struct PowerOff;

impl NorFlashError for PowerOff {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl NorFlashChip {
    /// An erased chip.
    pub fn new(bytes: usize) -> Self {
        Self::of(vec![0xff; bytes])
    }

    /// A chip with these contents.
    pub fn of(bytes: Vec<u8>) -> Self {
        Self {
            operations: 0,
            erasures: vec![0; bytes.len() / SECTOR as usize],
            bytes,
            written: 0,
            cut: None,
            random: fastrand::Rng::with_seed(1),
        }
    }

    /// The chip after power comes back.
    pub fn restarted(&self) -> Self {
        Self { cut: None, ..self.clone() }
    }

    /// True from the cut on.
    pub fn is_off(&self) -> bool {
        self.cut.is_some_and(|(at, _)| self.operations > at)
    }

    /// Counts an operation on `target`, of which each byte should become what `change` makes of it.
    fn operate(&mut self, offset: u32, len: usize, change: impl Fn(usize, u8) -> u8) -> Result<(), PowerOff> {
        let number = self.operations;
        let target = &mut self.bytes[offset as usize..][..len];
        let torn = match self.cut {
            Some((at, _)) if number > at => return Err(PowerOff),
            Some((at, torn)) if number == at => Some(torn),
            _ => None,
        };
        self.operations += 1;
        let whole = match torn {
            None | Some(Torn::After) => len,
            Some(Torn::Before) => 0,
            Some(Torn::Within) => self.random.usize(0..len),
        };
        for (i, byte) in target[..whole].iter_mut().enumerate() {
            *byte = change(i, *byte);
        }
        if torn == Some(Torn::Within) {
            let (before, after) = (target[whole], change(whole, target[whole]));
            let bits = self.random.u8(..);
            target[whole] = before & !bits | after & bits;
        }
        torn.map_or(Ok(()), |_| Err(PowerOff))
    }
}

impl ErrorType for NorFlashChip {
    type Error = PowerOff;
}

impl ReadNorFlash for NorFlashChip {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), PowerOff> {
        if self.is_off() {
            return Err(PowerOff);
        }
        bytes.copy_from_slice(&self.bytes[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl NorFlash for NorFlashChip {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = SECTOR as usize;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), PowerOff> {
        for sector in (from..to).step_by(SECTOR as usize) {
            self.erasures[(sector / SECTOR) as usize] += 1;
            self.operate(sector, SECTOR as usize, |_, _| 0xff)?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), PowerOff> {
        self.written += bytes.len() as u64;
        self.operate(offset, bytes.len(), |i, before| before & bytes[i])
    }
}

impl MultiwriteNorFlash for NorFlashChip {}

/// Runs what never waits: nothing about this chip takes time.
pub fn now<T>(work: impl Future<Output = T>) -> T {
    match pin!(work).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(done) => done,
        Poll::Pending => panic!("there is nothing to wait for"),
    }
}

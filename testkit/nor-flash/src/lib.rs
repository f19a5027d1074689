//! A simulated NOR flash chip. Its power fails in an operation that a test chooses, and its reads and writes can fail in other
//! ways.

use embedded_storage_async::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use plantar::storage::flash_map::SECTOR;
use std::cell::Cell;
use std::future::Future;
use std::ops::Range;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

/// The moment of an operation at which power fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Torn {
    /// Before the operation changes anything.
    Before,
    /// Within the operation: the first bytes have their new values, the next byte has some bits of its new value, and the
    /// remaining bytes are unchanged.
    Within,
    /// After the operation is complete, but before its success is reported.
    After,
}

/// The chip. As on a real one, a write only clears bits, and an operation during which power fails remains incomplete.
#[derive(Clone)]
pub struct NorFlashChip {
    /// The content of the chip.
    pub bytes: Vec<u8>,
    /// Number of write operations and of erase operations of a sector so far, without those that were refused or forgotten.
    pub operations: u64,
    /// For each sector, the number of its erase operations so far, those that failed included.
    pub erasures: Vec<u32>,
    /// Number of bytes written so far, those of failed operations included.
    pub bytes_written: u64,
    /// Number of read operations so far, without those that failed.
    pub read_operations: u64,
    /// Number of bytes read so far.
    pub bytes_read: u64,
    /// The number of the write or erase operation in which power fails, from 0, and the moment of the power cut. Power stays off
    /// afterwards.
    pub cut: Option<(u64, Torn)>,
    /// Write operations below this address succeed but change nothing.
    pub forgets_writes_below: Option<u32>,
    /// Write and erase operations fail and change nothing, as with a low supply.
    pub refuses_changes: bool,
    /// Number of read operations from now on that fail.
    pub failing_reads: u64,
    /// The next read operation that includes this address fails.
    pub failing_read_at: Option<u32>,
    /// Read operations that include an address of this range fail.
    pub unreadable: Range<u32>,
    /// Number of read operations from now on that return something else than the content, as from a chip whose supply rises
    /// slowly.
    pub wrong_reads: u64,
    /// The bytes of a wrong read; `None` for random bytes.
    pub wrong_byte: Option<u8>,
    random: fastrand::Rng,
}

/// The error of an operation. It has one of three causes: power is off, the operation is a change and the supply is low, or the
/// operation is a read that a test makes fail.
#[derive(Debug, PartialEq, Eq)]
pub struct OperationFailed;

impl NorFlashError for OperationFailed {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl NorFlashChip {
    /// An erased chip of this number of bytes.
    pub fn new(bytes: usize) -> Self {
        Self::of(vec![0xff; bytes])
    }

    /// A chip with this content.
    pub fn of(bytes: Vec<u8>) -> Self {
        Self {
            operations: 0,
            erasures: vec![0; bytes.len() / SECTOR as usize],
            bytes,
            bytes_written: 0,
            read_operations: 0,
            bytes_read: 0,
            cut: None,
            forgets_writes_below: None,
            refuses_changes: false,
            failing_reads: 0,
            failing_read_at: None,
            unreadable: 0..0,
            wrong_reads: 0,
            wrong_byte: None,
            random: fastrand::Rng::with_seed(1),
        }
    }

    /// The chip after power has returned.
    pub fn restarted(&self) -> Self {
        Self { cut: None, ..self.clone() }
    }

    /// True once power has failed.
    pub fn is_off(&self) -> bool {
        self.cut.is_some_and(|(at, _)| self.operations > at)
    }

    /// Counts an operation that replaces each byte of a range with the result of `change`, and executes it up to a power cut.
    fn operate(&mut self, offset: u32, len: usize, change: impl Fn(usize, u8) -> u8) -> Result<(), OperationFailed> {
        if self.refuses_changes {
            return Err(OperationFailed);
        }
        let number = self.operations;
        let target = &mut self.bytes[offset as usize..][..len];
        let torn = match self.cut {
            Some((at, _)) if number > at => return Err(OperationFailed),
            Some((at, torn)) if number == at => Some(torn),
            _ => None,
        };
        self.operations += 1;
        let complete = match torn {
            None | Some(Torn::After) => len,
            Some(Torn::Before) => 0,
            Some(Torn::Within) => self.random.usize(0..len),
        };
        for (i, byte) in target[..complete].iter_mut().enumerate() {
            *byte = change(i, *byte);
        }
        if torn == Some(Torn::Within) {
            let (before, after) = (target[complete], change(complete, target[complete]));
            let bits = self.random.u8(..);
            target[complete] = before & !bits | after & bits;
        }
        torn.map_or(Ok(()), |_| Err(OperationFailed))
    }
}

impl ErrorType for NorFlashChip {
    type Error = OperationFailed;
}

impl ReadNorFlash for NorFlashChip {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), OperationFailed> {
        if self.is_off() {
            return Err(OperationFailed);
        }
        if offset < self.unreadable.end && self.unreadable.start < offset + bytes.len() as u32 {
            return Err(OperationFailed);
        }
        if self.failing_reads > 0 {
            self.failing_reads -= 1;
            return Err(OperationFailed);
        }
        if self.failing_read_at.take_if(|at| (offset..offset + bytes.len() as u32).contains(&*at)).is_some() {
            return Err(OperationFailed);
        }
        self.read_operations += 1;
        self.bytes_read += bytes.len() as u64;
        bytes.copy_from_slice(&self.bytes[offset as usize..][..bytes.len()]);
        if self.wrong_reads > 0 {
            self.wrong_reads -= 1;
            match self.wrong_byte {
                Some(byte) => bytes.fill(byte),
                None => self.random.fill(bytes),
            }
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl NorFlash for NorFlashChip {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = SECTOR as usize;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), OperationFailed> {
        for sector in (from..to).step_by(SECTOR as usize) {
            self.erasures[(sector / SECTOR) as usize] += 1;
            self.operate(sector, SECTOR as usize, |_, _| 0xff)?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), OperationFailed> {
        self.bytes_written += bytes.len() as u64;
        if self.forgets_writes_below.is_some_and(|end| offset < end) {
            return if self.is_off() { Err(OperationFailed) } else { Ok(()) };
        }
        self.operate(offset, bytes.len(), |i, before| before & bytes[i])
    }
}

impl MultiwriteNorFlash for NorFlashChip {}

/// Polls a future once and returns its output. The future never waits, because the operations of this chip take no time.
///
/// # Panics
/// If the future waits.
pub fn block_on<T>(work: impl Future<Output = T>) -> T {
    match pin!(work).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(output) => output,
        Poll::Pending => panic!("the future waits"),
    }
}

/// The supply of a chip: sufficient for a number of operations, then too low for a number of operations, then sufficient again.
pub struct Supply {
    operations: Cell<u64>,
    sufficient: u64,
    low: u64,
}

impl Supply {
    /// A supply that is sufficient for `sufficient` operations, then too low for `low` operations, and sufficient again.
    pub fn new(sufficient: u64, low: u64) -> Self {
        Self { operations: Cell::new(0), sufficient, low }
    }

    /// True if the supply is sufficient for the next operation. To be called once for each operation.
    pub fn is_sufficient(&self) -> bool {
        let operation = self.operations.replace(self.operations.get() + 1);
        operation < self.sufficient || operation >= self.sufficient + self.low
    }

    /// Number of operations so far, with a sufficient or a low supply.
    pub fn operations(&self) -> u64 {
        self.operations.get()
    }
}

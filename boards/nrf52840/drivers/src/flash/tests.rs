//! The flash chip on a simulated bus.

extern crate std;

use super::*;
use embassy_futures::block_on;
use std::vec;
use std::vec::Vec;

const BYTES: u32 = 2 << 20;

/// A chip with its bus. The chip is busy for some reads of its status at the start, and after each write or erase operation. An
/// operation that a real chip cannot execute fails the test.
struct Simulated {
    page: Page,
    bytes: Vec<u8>,
    identity: [u8; 3],
    is_active: bool,
    /// Number of reads of the status after a write or erase operation until the chip is ready; all but the last report a busy
    /// chip.
    busy_polls: u32,
    /// Number of these reads that remain until the chip is ready. [`Bus::activate`] makes up to [`BUS_LIMIT_MS`] of them itself.
    busy: u32,
    /// Number of transfers that fail, of the next reads.
    failing_reads: u32,
}

impl Simulated {
    fn new(identity: [u8; 3], busy_polls: u32) -> Self {
        let page = [const { AtomicU32::new(0) }; PAGE_WORDS];
        let bytes = vec![0xff; BYTES as usize];
        Self { page, bytes, identity, is_active: false, busy_polls, busy: busy_polls, failing_reads: 0 }
    }

    fn check(&self, address: u32, words: usize) {
        assert!(self.is_active && self.busy == 0, "the bus must be on, and the chip must not be busy");
        assert!(address.is_multiple_of(4) && (1..=PAGE_WORDS).contains(&words));
    }
}

impl Bus for Simulated {
    fn page(&self) -> &Page {
        &self.page
    }

    async fn activate(&mut self) -> Result<(), NoAnswer> {
        self.is_active = true;
        // The bus waits for at most `BUS_LIMIT_MS`. In this simulation, each read of the status takes a millisecond, as in the
        // driver.
        self.busy = self.busy.saturating_sub(BUS_LIMIT_MS);
        if self.busy == 0 { Ok(()) } else { Err(NoAnswer) }
    }

    fn deactivate(&mut self) {
        self.is_active = false;
    }

    async fn read(&mut self, address: u32, words: usize) -> Result<(), NoAnswer> {
        self.check(address, words);
        if self.failing_reads > 0 {
            self.failing_reads -= 1;
            return Err(NoAnswer);
        }
        for (word, at) in self.page.iter().zip((address as usize..).step_by(4)).take(words) {
            let bytes = self.bytes.get(at..at + 4).expect("the word is in the chip");
            word.store(u32::from_le_bytes(bytes.try_into().expect("four bytes")), Ordering::Relaxed);
        }
        Ok(())
    }

    async fn write(&mut self, address: u32, words: usize) -> Result<(), NoAnswer> {
        self.check(address, words);
        assert!(address % PAGE + 4 * words as u32 <= PAGE, "all words must be in one page");
        for (word, at) in self.page.iter().zip((address as usize..).step_by(4)).take(words) {
            for (byte, new) in self.bytes[at..at + 4].iter_mut().zip(word.load(Ordering::Relaxed).to_le_bytes()) {
                *byte &= new;
            }
        }
        self.busy = self.busy_polls;
        Ok(())
    }

    async fn erase(&mut self, address: u32) -> Result<(), NoAnswer> {
        self.check(address, 1);
        self.bytes[address as usize..][..SECTOR as usize].fill(0xff);
        self.busy = self.busy_polls;
        Ok(())
    }

    async fn command(&mut self, opcode: u8) -> Result<[u8; 3], NoAnswer> {
        assert!(self.is_active);
        match opcode {
            READ_STATUS => {
                self.busy = self.busy.saturating_sub(1);
                Ok([u8::from(self.busy > 0), 0, 0])
            }
            READ_IDENTITY => Ok(self.identity),
            RELEASE => Ok([0xff; 3]),
            _ => Err(NoAnswer),
        }
    }

    async fn pause_ms(&mut self, _ms: u32) {}
}

/// The identity of the chip on the module, a P25Q16H: manufacturer, type, and binary logarithm of the number of bytes.
const P25Q16H: [u8; 3] = [0x85, 0x60, 0x15];

fn open(bus: Simulated) -> Option<Chip<Simulated, BYTES>> {
    block_on(Chip::open(bus))
}

#[test]
fn bytes_at_any_address_are_written_and_read_and_their_neighbours_are_unchanged() {
    let mut chip = open(Simulated::new(P25Q16H, 3)).expect("the chip answers");
    let mut expected = vec![0xff; 3 * SECTOR as usize];
    // A linear congruential generator. Its highest byte repeats only after 2^32 numbers.
    let mut state = 1_u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    // All alignments, lengths around those of words and pages, and a place across the border of a page and of a sector.
    for base in [0, 200, 250, 4090, 5000] {
        for first in 0..5 {
            for len in [1, 2, 3, 4, 5, 7, 255, 256, 257, 600] {
                block_on(chip.erase(0, expected.len() as u32)).expect("the chip answers");
                expected.fill(0xff);
                let at = base + first;
                // The second write clears further bits of the same bytes.
                for _ in 0..2 {
                    let bytes: Vec<u8> = (0..len).map(|_| next()).collect();
                    block_on(chip.write(at, &bytes)).expect("the chip answers");
                    for (old, new) in expected[at as usize..].iter_mut().zip(&bytes) {
                        *old &= new;
                    }
                    let mut read = vec![0; bytes.len()];
                    block_on(chip.read(at, &mut read)).expect("the chip answers");
                    assert_eq!(read, expected[at as usize..][..bytes.len()], "{len} bytes at {at}");
                    assert_eq!(chip.0.bytes[..expected.len()], expected, "{len} bytes at {at}");
                }
            }
        }
    }
    assert!(!chip.0.is_active, "the bus must be off between operations");
    block_on(chip.write(0, &vec![0; expected.len()])).expect("the chip answers");
    expected.fill(0);
    block_on(chip.erase(SECTOR, 2 * SECTOR)).expect("the chip answers");
    expected[SECTOR as usize..2 * SECTOR as usize].fill(0xff);
    assert_eq!(chip.0.bytes[..expected.len()], expected);
}

#[test]
fn addresses_outside_of_the_chip_and_partial_sectors_are_refused() {
    let mut chip = open(Simulated::new(P25Q16H, 0)).expect("the chip answers");
    assert_eq!(block_on(chip.read(BYTES - 1, &mut [0; 1])), Ok(()));
    assert_eq!(block_on(chip.read(BYTES - 1, &mut [0; 2])), Err(Error::OutOfBounds));
    assert_eq!(block_on(chip.read(u32::MAX, &mut [0; 2])), Err(Error::OutOfBounds));
    assert_eq!(block_on(chip.write(BYTES, &[0])), Err(Error::OutOfBounds));
    assert_eq!(block_on(chip.erase(0, BYTES + SECTOR)), Err(Error::OutOfBounds));
    assert_eq!(block_on(chip.erase(SECTOR, 0)), Err(Error::OutOfBounds));
    assert_eq!(block_on(chip.erase(0, 100)), Err(Error::NotAligned));
}

#[test]
fn a_missing_a_small_and_a_stuck_chip_are_not_opened() {
    for identity in [[0; 3], [0xff; 3], [0x85, 0x60, 0x14], [0x00, 0x60, 0x15]] {
        assert!(open(Simulated::new(identity, 0)).is_none(), "{identity:?}");
    }
    assert!(open(Simulated::new([0xef, 0x40, 0x16], 0)).is_some(), "a larger chip must be opened");
    assert!(open(Simulated::new(P25Q16H, ERASE_LIMIT_MS + 1)).is_none(), "a chip that stays busy must not be opened");
}

#[test]
fn a_chip_that_still_erases_after_a_reset_or_a_cancelled_operation_is_waited_for() {
    let chip = open(Simulated::new(P25Q16H, ERASE_LIMIT_MS));
    let mut chip = chip.expect("a chip that was erasing a sector when the controller was reset must be opened");
    // The chip continues an operation that was cancelled.
    chip.0.busy = ERASE_LIMIT_MS;
    assert_eq!(block_on(chip.read(0, &mut [0])), Ok(()));
}

#[test]
fn a_chip_that_stays_busy_fails_a_write_within_a_limited_time() {
    let mut chip = open(Simulated::new(P25Q16H, 0)).expect("the chip answers");
    // The driver reads the status `WRITE_LIMIT_MS` times, once a millisecond. The last of these reads must report a busy chip.
    chip.0.busy_polls = WRITE_LIMIT_MS + 1;
    assert_eq!(block_on(chip.write(0, &[0])), Err(Error::NoAnswer));
    assert!(!chip.0.is_active, "the bus must be off after an error, too");
}

#[test]
fn a_read_that_fails_once_is_repeated() {
    let mut chip = open(Simulated::new(P25Q16H, 0)).expect("the chip answers");
    block_on(chip.write(10, &[1, 2, 3])).expect("the chip answers");
    chip.0.failing_reads = 1;
    let mut bytes = [0; 3];
    assert_eq!(block_on(chip.read(10, &mut bytes)), Ok(()));
    assert_eq!(bytes, [1, 2, 3]);
    chip.0.failing_reads = 2;
    assert_eq!(block_on(chip.read(10, &mut bytes)), Err(Error::NoAnswer));
    assert!(!chip.0.is_active, "the bus must be off after an error, too");
}

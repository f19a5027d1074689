//! Receives an image with a wrong signature, again and again. The debugger's script `skips.py` makes the emulated core skip
//! instructions while [`check`] runs, as a disturbance of the supply would, and reads afterwards whether the image was marked for
//! the bootloader.
#![no_std]
#![no_main]

use core::convert::Infallible;
use core::hint::black_box;
use core::ops::Range;
use core::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{Peripherals, SCB};
use cortex_m_rt::{entry, exception};
use embassy_boot::{FirmwareUpdater, FirmwareUpdaterConfig};
use embassy_futures::block_on;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use plantar::protocol::update::{CHUNK, Header, Offer, Request};
use plantar::storage::flash_map::{HEADER, OTHER, SECTOR, STATE};
use plantar::storage::partition::{Partition, STATE_WORD, state_partition};
use plantar::storage::update::{KEY, Update};

const RUNNING: Header = Header::new("emulated", "1.0.0");
/// The image is as long as a sector. No key made this signature, but every part of it is in its valid range.
const OFFER: Offer = Offer { header: RUNNING, chunks: (SECTOR as usize / CHUNK) as u16, signature: [[1; 32]; 2] };

/// The check that is attacked: true for that of `embassy-boot` alone, false for that of the firmware, which verifies the
/// signature twice. The script sets it.
static VERIFIES_ONCE: AtomicBool = AtomicBool::new(false);

type Sector = [AtomicU8; SECTOR as usize];
/// The sector that will contain the image. It must be erased first.
static IMAGE: Sector = [const { AtomicU8::new(0) }; SECTOR as usize];
/// The state of the bootloader, which the script reads. It must be erased first.
static MARK: Sector = [const { AtomicU8::new(0) }; SECTOR as usize];

/// A flash chip with these two sectors. All others are empty.
struct Chip;

impl Chip {
    /// The stored bytes at these addresses; `None` in an empty sector.
    fn bytes(range: Range<u32>) -> impl Iterator<Item = Option<&'static AtomicU8>> {
        let byte_in = |start: u32, sector: &'static Sector, at: u32| sector.get(at.checked_sub(start)? as usize);
        range.map(move |at| byte_in(OTHER.start, &IMAGE, at).or_else(|| byte_in(STATE.start, &MARK, at)))
    }
}

impl ErrorType for Chip {
    type Error = Infallible;
}

impl ReadNorFlash for Chip {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Infallible> {
        for (byte, stored) in bytes.iter_mut().zip(Self::bytes(offset..u32::MAX)) {
            *byte = stored.map_or(0xff, |stored| stored.load(Ordering::Relaxed));
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        OTHER.end as usize
    }
}

impl NorFlash for Chip {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = SECTOR as usize;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Infallible> {
        Self::bytes(from..to).flatten().for_each(|stored| stored.store(0xff, Ordering::Relaxed));
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Infallible> {
        for (byte, stored) in bytes.iter().zip(Self::bytes(offset..u32::MAX)) {
            if let Some(stored) = stored {
                stored.fetch_and(*byte, Ordering::Relaxed);
            }
        }
        Ok(())
    }
}

#[entry]
fn main() -> ! {
    start_timeout();
    for sector in [STATE, OTHER] {
        let _ = block_on(Chip.erase(sector.start, sector.start + SECTOR));
    }
    let mut update = Update::new();
    // The image consists of empty flash and its header.
    let mut image = [[0xff; CHUNK]; SECTOR as usize / CHUNK];
    image.as_flattened_mut()[HEADER as usize..][..Header::BYTES].copy_from_slice(&RUNNING.bytes());
    let mut request = |request| {
        let _ = block_on(update.handle(&mut Chip, &RUNNING, &KEY, &request));
    };
    request(Request::Begin(OFFER));
    for (number, bytes) in image.iter().enumerate() {
        let mut chunk = [[0; 32]; CHUNK / 32];
        chunk.as_flattened_mut().copy_from_slice(bytes);
        request(Request::Chunk { number: number as u16, chunk });
    }
    check(&mut update);
    end()
}

/// Verifies the signature, and marks the image for the bootloader if it is valid.
#[inline(never)]
fn check(update: &mut Update) {
    // Without the black box, the compiler would conclude that the flag is never true, because only the debugger sets it.
    if black_box(&VERIFIES_ONCE).load(Ordering::Relaxed) {
        let (chip, mut word) = (Mutex::new(Chip), [0; STATE_WORD]);
        let config =
            FirmwareUpdaterConfig { dfu: Partition::<_, CHUNK>::new(&chip, OTHER), state: state_partition(&chip) };
        let signature = OFFER.signature.as_flattened().as_array().unwrap_or(&[0; 64]);
        let _ = block_on(FirmwareUpdater::new(config, &mut word).verify_and_mark_updated(&KEY, signature, SECTOR));
    } else {
        let _ = block_on(update.handle(&mut Chip, &RUNNING, &KEY, &Request::Finish));
    }
}

/// The end of an attempt, and the beginning of the next one.
#[inline(never)]
fn end() -> ! {
    SCB::sys_reset()
}

/// Starts the timeout that ends an attempt in which the core does not return from the check: more than ten times the duration of
/// the check.
fn start_timeout() {
    if let Some(mut peripherals) = Peripherals::take() {
        peripherals.SYST.set_clock_source(SystClkSource::Core);
        peripherals.SYST.set_reload(0x00ff_ffff);
        peripherals.SYST.clear_current();
        peripherals.SYST.enable_counter();
        peripherals.SYST.enable_interrupt();
    }
}

#[exception]
fn SysTick() {
    end()
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    end()
}

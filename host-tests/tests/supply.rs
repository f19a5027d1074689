//! A flash chip whose supply becomes too low at any moment, and returns.

use embassy_boot::{AlignedBuffer, BootLoader};
use embassy_futures::block_on;
use embassy_sync::mutex::Mutex;
use emulation::{ACTIVE_IMAGE, FLASH_BYTES};
use firmware_image::{Image, SigningKey};
use plantar::protocol::Reset;
use plantar::protocol::update::{CHUNK, Header, Progress, Request};
use plantar::storage::boot::{BUFFER, Blocking, config};
use plantar::storage::flash_map::{HEADER, LOG, SECTOR};
use plantar::storage::partition::Partition;
use plantar::storage::supplied::Supplied;
use plantar::storage::update::Update;
use plantar::storage::{StorageError, Store};
use std::cell::Cell;
use testkit::nor_flash::NorFlashChip;
use testkit::step;

/// The supply of a chip: sufficient for a number of operations, then too low for a number of operations.
struct Supply {
    operations: Cell<u64>,
    sufficient: u64,
    low: u64,
}

impl Supply {
    fn new(sufficient: u64, low: u64) -> Self {
        Self { operations: Cell::new(0), sufficient, low }
    }

    fn is_sufficient(&self) -> bool {
        let operation = self.operations.replace(self.operations.get() + 1);
        operation < self.sufficient || operation >= self.sufficient + self.low
    }
}

/// A chip that was used before.
fn used_chip() -> NorFlashChip {
    let mut chip = NorFlashChip::new(LOG.end as usize);
    let _ = block_on(Store::open(Some(&mut chip), Reset::Power));
    chip
}

/// Number of steps that are stored.
const STEPS: u32 = 40;

/// Stores steps one after the other, and acknowledges every fifth one before the last. Returns the numbers of the steps that were
/// stored and must remain, and the number of refused operations of the store.
fn store_steps(chip: &mut NorFlashChip, supply: &Supply) -> (Vec<u32>, u32) {
    let mut store = block_on(Store::open(Some(Supplied::new(chip, || supply.is_sufficient())), Reset::Power));
    let (mut stored, mut refused) = (Vec::new(), 0);
    for number in 0..STEPS {
        match block_on(store.push_record(step(number))) {
            Ok(_) => stored.push(number),
            Err(error) => {
                assert_eq!(error, StorageError::Chip);
                refused += 1;
            }
        }
        if number % 5 == 4 && number + 1 < STEPS {
            // An acknowledgement that is refused half-way may have removed records.
            refused += u32::from(block_on(store.acknowledge(number)).is_err());
            stored.retain(|stored| *stored > number);
        }
    }
    (stored, refused)
}

#[test]
fn steps_that_were_stored_remain_when_the_supply_was_low_for_some_time() {
    let all = Supply::new(u64::MAX, 0);
    let (complete, refused) = store_steps(&mut used_chip(), &all);
    assert_eq!((complete, refused), ((35..STEPS).collect(), 0));
    let mut refusals = 0;
    for sufficient in 0..all.operations.get() {
        let mut chip = used_chip();
        let (stored, refused) = store_steps(&mut chip, &Supply::new(sufficient, 3));
        refusals += refused;
        let mut store = block_on(Store::open(Some(&mut chip), Reset::Power));
        let mut found = Vec::new();
        block_on(store.records(None, |record| {
            found.push(record.number());
            true
        }))
        .expect("the log can be read");
        for number in &stored {
            assert!(found.contains(number), "step {number} is lost, low supply from operation {sufficient} on");
        }
        assert!(found.is_sorted() && found.iter().all(|number| *number < STEPS), "{found:?}");
        assert_eq!(store.contents().erased, 0, "low supply from operation {sufficient} on");
    }
    assert!(refusals >= all.operations.get() as u32 / 2, "{refusals}");
}

#[test]
fn a_chip_with_a_low_supply_is_not_changed() {
    let mut chip = used_chip();
    let before = chip.bytes.clone();
    let (stored, refused) = store_steps(&mut chip, &Supply::new(0, u64::MAX));
    assert_eq!((stored, refused), (Vec::new(), STEPS + STEPS / 5 - 1));
    assert!(chip.bytes == before && chip.erasures.iter().sum::<u32>() == 0);
}

/// A signed image with random content.
fn image(version: &str) -> Image {
    let mut random = fastrand::Rng::with_seed(version.len() as u64);
    let mut bytes: Vec<u8> = std::iter::repeat_with(|| random.u8(..)).take(9 * SECTOR as usize).collect();
    let header = Header::new("board", version).bytes();
    bytes[HEADER as usize..][..header.len()].copy_from_slice(&header);
    Image::sign(bytes, &SigningKey::from_bytes(&[7; 32])).expect("the image has a header")
}

/// The bootloader resets the board if a swap fails, and continues it at the next start. An image runs only after a complete swap.
#[test]
fn a_swap_waits_for_the_supply_at_any_moment() {
    let (old, new) = (image("1.2.9"), image("1.2.10"));
    let mut accepted = NorFlashChip::new(FLASH_BYTES);
    accepted.bytes[ACTIVE_IMAGE.start as usize..][..old.bytes().len()].copy_from_slice(old.bytes());
    let key = SigningKey::from_bytes(&[7; 32]).verifying_key().to_bytes();
    let mut update = Update::new();
    let mut ask = |request| block_on(update.handle(&mut accepted, old.header(), &key, &request));
    ask(Request::Begin(new.offer())).expect("the offer is accepted");
    for number in 0..new.offer().chunks {
        ask(Request::Chunk { number, chunk: new.chunk(number) }).expect("the chunk is accepted");
    }
    assert_eq!(ask(Request::Finish), Ok(Progress::Accepted));

    let boot = |chip: &mut NorFlashChip, supply: &Supply| {
        let chip = Mutex::new(Supplied::new(chip, || supply.is_sufficient()));
        let active = Blocking(Partition::<_, CHUNK>::new(&chip, ACTIVE_IMAGE));
        BootLoader::new(config(&chip, active)).prepare_boot(AlignedBuffer([0; BUFFER]).as_mut()).map(drop)
    };
    let all = Supply::new(u64::MAX, 0);
    boot(&mut accepted.clone(), &all).expect("the swap is complete");
    let operations = all.operations.get();
    assert!(operations > 100, "{operations}");
    for sufficient in (0..operations).step_by(7) {
        let mut chip = accepted.clone();
        let supply = Supply::new(sufficient, 3);
        let mut starts = 0;
        while boot(&mut chip, &supply).is_err() {
            starts += 1;
        }
        let active = &chip.bytes[ACTIVE_IMAGE.start as usize..ACTIVE_IMAGE.end as usize];
        assert!(active.starts_with(new.bytes()), "low supply from operation {sufficient} on");
        assert_eq!(starts, 3, "each refused operation ends a start");
    }
}

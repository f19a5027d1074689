//! The store on a flash chip with a supply that becomes too low at any moment, and is sufficient again later.

use core::cell::{Cell, RefCell};
use embassy_futures::block_on;
use embedded_storage_async::nor_flash::NorFlash;
use plantar::protocol::{LoadRecord, Reset, Step};
use plantar::storage::flash_map::{SECTOR, SMALL_LOG};
use plantar::storage::supplied::Supplied;
use plantar::storage::{StorageError, Store};
use std::rc::Rc;
use testkit::host::{Host, LinkKind};
use testkit::nor_flash::{NorFlashChip, Supply};
use testkit::step;
use testkit::virtual_time::now_us;
use testkit::world::{InsoleEvent, World};

/// A chip that was used before.
fn used_chip() -> NorFlashChip {
    let mut chip = NorFlashChip::new(SMALL_LOG.end as usize);
    let _ = block_on(Store::open(Some(&mut chip), Reset::Power));
    chip
}

/// Number of steps that are stored.
const STEPS: u32 = 40;

/// Stores steps one after the other. After every fifth step except the last one, acknowledges all steps so far. Returns the
/// numbers of the steps that were stored and must remain, and the number of operations of the store that were refused.
fn store_steps(chip: &mut NorFlashChip, supply: &Supply) -> (Vec<u32>, u32) {
    let mut store =
        block_on(Store::open(Some(Supplied::new(chip, SMALL_LOG.end, || supply.is_sufficient())), Reset::Power));
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
            // An acknowledgement may have removed records before one of its operations was refused.
            refused += u32::from(block_on(store.acknowledge(number)).is_err());
            stored.retain(|stored| *stored > number);
        }
    }
    (stored, refused)
}

/// A boot that is not counted would have the same number as the next one, so the records of both could not be distinguished.
#[test]
fn a_boot_that_begins_with_a_low_supply_is_counted_once_the_supply_is_sufficient() {
    let mut chip = used_chip();
    let is_sufficient = Cell::new(false);
    let mut store =
        block_on(Store::open(Some(Supplied::new(&mut chip, SMALL_LOG.end, || is_sufficient.get())), Reset::Power));
    let boot = store.contents().start;
    assert_eq!(block_on(store.push_record(step(0))), Err(StorageError::Chip));
    is_sufficient.set(true);
    assert!(block_on(store.is_sound()));
    block_on(store.push_record(step(0))).expect("the supply is sufficient");
    let mut store = block_on(Store::open(Some(&mut chip), Reset::Power));
    assert_eq!(store.contents().start, boot + 1);
    let mut is_of_previous_boot = None;
    block_on(store.records(None, |record| {
        is_of_previous_boot = Some(matches!(record, LoadRecord::Step(Step { boots_since: 1, .. })));
        true
    }))
    .expect("the log can be read");
    assert_eq!(is_of_previous_boot, Some(true));
}

/// The log has foreign contents, which the start cannot erase.
#[test]
fn the_data_of_the_wearer_can_be_erased_after_a_start_with_a_low_supply() {
    let mut chip = used_chip();
    chip.bytes[SMALL_LOG.start as usize..SMALL_LOG.end as usize].fill(0x55);
    let is_sufficient = Cell::new(false);
    let mut store =
        block_on(Store::open(Some(Supplied::new(&mut chip, SMALL_LOG.end, || is_sufficient.get())), Reset::Power));
    is_sufficient.set(true);
    assert_eq!(block_on(store.push_record(step(0))), Err(StorageError::Contents));
    assert_eq!(block_on(store.erase_wearer(|| {})), Ok(()));
    assert_eq!(block_on(store.push_record(step(0))), Ok(0));
}

#[test]
fn steps_that_were_stored_remain_when_the_supply_was_low_for_some_time() {
    let steady = Supply::new(u64::MAX, 0);
    let (complete, refused) = store_steps(&mut used_chip(), &steady);
    assert_eq!((complete, refused), ((35..STEPS).collect(), 0));
    let mut refusals = 0;
    for sufficient in 0..steady.operations() {
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
    assert!(refusals >= steady.operations() as u32 / 2, "{refusals}");
}

/// Without a host, some records wait in RAM and in the log. The next ones cannot be stored: those for which there is no room in
/// RAM are dropped. If they replaced stored ones there, their acknowledgement would delete records that were never sent.
#[test]
fn stored_steps_arrive_if_later_ones_could_not_be_stored() {
    const SECOND_US: u64 = 1_000_000;
    for stored in 4..=8 {
        let world = Rc::new(RefCell::new(World::new(1, 100.0)));
        let start_us = now_us();
        for (s, event) in [
            (1, InsoleEvent::Walk { steps: stored }),
            (20, InsoleEvent::LowSupply { for_us: 20 * SECOND_US }),
            (21, InsoleEvent::Walk { steps: 4 }),
        ] {
            world.borrow_mut().schedule(start_us + s * SECOND_US, 0, event);
        }
        world.borrow_mut().run_for(45 * SECOND_US);
        let mut host = Host::new(&world, 0);
        host.connect(LinkKind::Serial, false);
        let end_us = now_us() + 10 * SECOND_US;
        while now_us() < end_us {
            host.poll();
        }
        let numbers: Vec<_> = host.records.iter().map(LoadRecord::number).collect();
        assert!((0..stored).all(|number| numbers.contains(&number)), "{stored} stored steps, received {numbers:?}");
        let status = host.status().expect("the insole answers");
        assert!(status.not_stored >= 4, "the supply was too low for the steps of the second walk: {status:?}");
    }
}

/// Reading the log erases sectors of which all records were deleted. If the log could not be read until the supply is
/// sufficient again, the next record would be sent before those that are only in the log, and its acknowledgement would delete
/// them.
#[test]
fn the_log_can_be_read_when_the_supply_became_low_while_records_were_deleted() {
    const ACKNOWLEDGED: u32 = 30;
    let delete = |low_from: u64| {
        let mut chip = used_chip();
        let mut store = block_on(Store::open(Some(&mut chip), Reset::Power));
        for number in 0..STEPS {
            block_on(store.push_record(step(number))).expect("the supply is sufficient");
        }
        let supply = Supply::new(low_from, u64::MAX - low_from);
        let mut store = block_on(Store::open(
            Some(Supplied::new(&mut chip, SMALL_LOG.end, || supply.is_sufficient())),
            Reset::Power,
        ));
        let is_deleted = block_on(store.acknowledge(ACKNOWLEDGED)).is_ok();
        let numbers = |store: &mut Store<_>| {
            let mut numbers = Vec::new();
            let take = |record: LoadRecord| {
                numbers.push(record.number());
                true
            };
            block_on(store.records(Some(ACKNOWLEDGED), take)).map(|_| numbers)
        };
        // The first reading postpones the erasure of sectors while the supply is low. The second one must not treat
        // these sectors as erased.
        for _ in 0..2 {
            let found = numbers(&mut store);
            assert_eq!(found, Ok((ACKNOWLEDGED + 1..STEPS).collect()), "low supply from operation {low_from} on");
        }
        let mut store = block_on(Store::open(Some(&mut chip), Reset::Power));
        for number in STEPS..2 * STEPS {
            block_on(store.push_record(step(number))).expect("the supply is sufficient");
        }
        let mut found = Vec::new();
        block_on(store.records(Some(ACKNOWLEDGED), |record| {
            found.push(record.number());
            true
        }))
        .expect("the log can be read");
        assert_eq!(found, (ACKNOWLEDGED + 1..2 * STEPS).collect::<Vec<_>>(), "low supply from operation {low_from} on");
        (is_deleted, supply.operations())
    };
    let (is_deleted, operations) = delete(u64::MAX);
    assert!(is_deleted && operations > u64::from(ACKNOWLEDGED), "{operations}");
    for low_from in 0..operations {
        let (is_deleted, _) = delete(low_from);
        assert!(!is_deleted, "low supply from operation {low_from} on");
    }
}

#[test]
fn a_chip_with_a_low_supply_is_not_changed() {
    let mut chip = used_chip();
    let before = chip.bytes.clone();
    let (stored, refused) = store_steps(&mut chip, &Supply::new(0, u64::MAX));
    assert_eq!((stored, refused), (Vec::new(), STEPS + STEPS / 5 - 1));
    assert!(chip.bytes == before && chip.erasures.iter().sum::<u32>() == 0);
}

/// A driver may accept more addresses than the chip has, and the chip may map an address beyond its end to another one.
#[test]
fn nothing_beyond_the_used_part_is_changed() {
    let mut chip = used_chip();
    let before = chip.bytes.clone();
    let mut used = Supplied::new(&mut chip, 2 * SECTOR, || true);
    assert!(block_on(used.erase(SECTOR, 3 * SECTOR)).is_err());
    assert!(block_on(used.write(2 * SECTOR - 1, &[0; 2])).is_err());
    assert!(chip.bytes == before && chip.erasures.iter().all(|erasures| *erasures == 0));
}

/// `Supplied` passes on a range that ends before it begins, because refusing it is the task of the chip. The simulated chip
/// accepts it and erases nothing.
#[test]
fn a_reversed_range_is_passed_to_the_chip() {
    let mut chip = used_chip();
    let before = chip.bytes.clone();
    let erased = block_on(Supplied::new(&mut chip, SMALL_LOG.end, || true).erase(2 * SECTOR, SECTOR));
    assert!(erased.is_ok() && chip.bytes == before);
}

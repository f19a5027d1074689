//! The data that an insole stores, on a simulated flash chip.

use embedded_storage_async::nor_flash::NorFlash;
use plantar::Side;
use plantar::pipeline::calibrate::CellCalibration;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::tissue::{AreaFilter, Identified, Tissue};
use plantar::protocol::{Alert, BLOCK_CELLS, Bout, LoadRecord, Reset, Serial, Step, StepFoot, StepRegion, encode};
use plantar::storage::flash_map::{self, RECORDS, SECTOR, SMALL_LOG};
use plantar::storage::{Bonds, BootCounters, IdentifiedRecord, IdentityRecord, Record, StorageError, Store};
use sequential_storage::cache::Cache;
use sequential_storage::map::{MapConfig, MapStorage};
use sequential_storage::queue::{QueueConfig, QueueStorage};
use serde::{Deserialize, Serialize};
use testkit::nor_flash::{NorFlashChip, Torn, block_on};
use testkit::store_script::Script;
use testkit::{TISSUE, alert, bout, step};

type ChipStore<'c> = Store<&'c mut NorFlashChip>;

fn chip() -> NorFlashChip {
    NorFlashChip::new(SMALL_LOG.end as usize)
}

/// Opens the store as after a loss of power.
fn open(chip: &mut NorFlashChip) -> ChipStore<'_> {
    block_on(Store::open(Some(chip), Reset::Power))
}

/// Opens the store while the supply is too low for any change. The supply is sufficient from then on.
fn open_with_low_supply(chip: &mut NorFlashChip) -> ChipStore<'_> {
    chip.refuses_changes = true;
    let mut store = open(chip);
    store.flash().expect("there is a chip").refuses_changes = false;
    store
}

/// All stored steps.
fn steps(store: &mut ChipStore) -> Vec<Step> {
    let mut steps = Vec::new();
    let more = block_on(store.records(None, |record| {
        steps.extend(record.step());
        true
    }));
    assert_eq!(more, Ok(false));
    steps
}

/// The numbers of all stored steps.
fn numbers(store: &mut ChipStore) -> Vec<u32> {
    steps(store).iter().map(|step| step.step).collect()
}

/// Removes all steps up to and including this number.
fn acknowledge(store: &mut ChipStore, number: u32) -> Result<(), StorageError> {
    while block_on(store.acknowledge(number))? {}
    Ok(())
}

/// The scripts, random sequences of actions on the store, are short. One begins with a new chip, the other one with a chip that
/// was used until its sectors were reused. `cargo xtask soak` runs longer scripts.
#[test]
fn a_loss_of_power_at_any_moment_leaves_the_old_or_the_new_value() {
    for (seed, used) in [(1, 0), (2, 12_000)] {
        let script = Script::new(seed, used, 60);
        for operation in 0..script.operations {
            for torn in [Torn::Before, Torn::Within, Torn::After] {
                script.cut(operation, torn).expect("the store must have the old or the new value");
            }
        }
    }
}

/// Version 1 of [`IdentifiedRecord`].
#[derive(PartialEq, Serialize, Deserialize)]
struct IdentifiedRecordV1 {
    tissue_id: u32,
    identified: Option<(ContactRule, AreaFilter, Option<Side>, u32)>,
}

impl Record for IdentifiedRecordV1 {
    const KIND: u8 = IdentifiedRecord::KIND;
    const VERSION: u8 = 1;
}

/// Power fails in each operation that replaces the parameters. They are valid only with the contact rule of their identification,
/// so neither the parameters nor the rule may be replaced alone.
#[test]
fn a_loss_of_power_leaves_parameters_with_the_rule_of_their_identification() {
    let identified = |full_kpa, steps, regions| {
        let contact = ContactRule { full_kpa, ..ContactRule::COUNTED };
        Some(Identified { contact, filter: AreaFilter::Direct, side: None, steps, regions })
    };
    let mut force_laws = TISSUE.force_laws;
    force_laws[0].n = 1.3;
    let (first, second) = ((*TISSUE, identified(0.0, 20, 0)), (Tissue::new(force_laws), identified(150.0, 30, 0xAF)));
    let mut used = chip();
    // Stored as by older firmware, which had only part 0 of `IdentifiedRecord`; present firmware uses its two parts in turn. The
    // older record lacks the identified regions.
    let mut store = open(&mut used);
    let Identified { contact, filter, side, steps, .. } = first.1.expect("it is known");
    let record = IdentifiedRecordV1 { tissue_id: first.0.id, identified: Some((contact, filter, side, steps)) };
    let mut bytes = [0; 64];
    let stored = encode(&record, &mut bytes).expect("there is room");
    assert_eq!(stored[5..], [1, 0, 0, 32, 65, 0, 0, 240, 64, 0, 0, 0, 0, 0, 0, 20], "the bytes after the identifier");
    block_on(store.put(0, &record)).expect("the chip works");
    block_on(store.put(0, &first.0)).expect("the chip works");
    assert_eq!(block_on(store.tissue()), Ok(first));
    let mut old = first;
    for new in [second, first, second, (second.0, first.1), (second.0, None), first] {
        for torn in [Torn::Before, Torn::Within, Torn::After] {
            for operation in 0.. {
                let mut chip = used.restarted();
                let mut store = open(&mut chip);
                let flash = store.flash().expect("there is a chip");
                flash.cut = Some((flash.operations + operation, torn));
                let is_stored = block_on(store.put_tissue(&new.0, new.1)).is_ok();
                let found = block_on(open(&mut chip.restarted()).tissue()).expect("the chip works");
                assert!(found == new || !is_stored && found == old, "{torn:?} operation {operation}: {found:?}");
                if is_stored {
                    break;
                }
            }
        }
        block_on(open(&mut used).put_tissue(&new.0, new.1)).expect("the chip works");
        old = new;
    }
}

/// Power fails in each operation of the first start of a new chip.
#[test]
fn an_interrupted_first_start_is_not_counted_as_a_loss_at_the_next_start() {
    for torn in [Torn::Before, Torn::Within, Torn::After] {
        for operation in 0.. {
            let mut chip = chip();
            chip.cut = Some((operation, torn));
            open(&mut chip);
            let was_cut = chip.is_off();
            let mut chip = chip.restarted();
            let store = open(&mut chip);
            let contents = store.contents();
            assert_eq!((contents.erased, contents.next_record), (0, 0), "{torn:?} operation {operation}");
            assert!((1..=2).contains(&contents.start));
            if !was_cut {
                break;
            }
        }
    }
}

/// `cargo xtask soak` runs this script, which erases sectors, so it also tests power cuts in erase operations.
#[test]
fn a_long_script_erases_sectors() {
    assert!(Script::new(2, 12_000, 400).erasures > 0);
}

/// A region of [`step`] as this firmware reads it from a capture of older firmware: the quantities that were added later are 0.
fn old_region(region: StepRegion, masked_cells: u8) -> StepRegion {
    StepRegion {
        measured_peak_dn: region.measured_peak_dn,
        model_peak_dn: region.model_peak_dn,
        // The captures contain the same numbers as `step`, but older firmware stored the integrals in 0.01 N s. Reading converts
        // them to the present unit, 0.1 N s.
        measured_integral_dns: (region.measured_integral_dns + 5) / 10,
        model_integral_dns: (region.model_integral_dns + 5) / 10,
        area_peak_mm2: region.area_peak_mm2,
        deformation_peak_um: region.deformation_peak_um,
        deformation_rate_peak_dmm_s: region.deformation_rate_peak_dmm_s,
        contact_ms: region.contact_ms,
        time_to_peak_ms: region.time_to_peak_ms,
        ellipse_x_dmm: region.ellipse_x_dmm,
        ellipse_y_dmm: region.ellipse_y_dmm,
        ellipse_r_a_cmm: region.ellipse_r_a_cmm,
        ellipse_r_b_cmm: region.ellipse_r_b_cmm,
        ellipse_angle_ddeg: region.ellipse_angle_ddeg,
        model_error_bp: region.model_error_bp,
        masked_cells,
        ..StepRegion::default()
    }
}

/// In recovery mode, the owner's phone must be able to connect with its bond, and nothing but the bonds may be used of the chip.
#[test]
fn a_store_for_recovery_returns_the_bonds_only() {
    let mut chip = chip();
    let bonds = Bonds([1, 2, 3].into_iter().collect());
    let mut store = open(&mut chip);
    assert_eq!(block_on(store.put(0, &bonds)), Ok(()));
    assert_eq!(block_on(store.put(0, &BootCounters::default())), Ok(()));
    let mut store = Store::new(Some(&mut chip));
    store.use_bonds();
    assert_eq!(block_on(store.get(0)), Ok(Some(bonds)));
    assert_eq!(block_on(store.get::<BootCounters>(0)), Err(StorageError::Chip));
    assert_eq!(block_on(store.put(0, &Bonds([4].into_iter().collect()))), Err(StorageError::Chip));
}

/// `flash-2.bin` was written by firmware with version 2 of the format of steps, which lacks the results of tracking and the
/// measures of the foot and of the regions. It contains the first sector of the records and the first two of the log.
#[test]
fn steps_stored_by_firmware_without_tracking_are_read() {
    let capture = include_bytes!("../data/flash-2.bin");
    let mut chip = chip();
    let (records, log) = capture.split_at(SECTOR as usize);
    chip.bytes[..records.len()].copy_from_slice(records);
    chip.bytes[SMALL_LOG.start as usize..][..log.len()].copy_from_slice(log);
    let mut store = open(&mut chip);
    let expected = (4..12).map(|number| {
        let regions = step(number).regions.map(|region| old_region(region, region.masked_cells));
        Step { regions, boots_since: 1, refit: 0, foot: StepFoot::default(), ..step(number) }
    });
    assert_eq!(steps(&mut store), expected.collect::<Vec<_>>());
}

/// `flash-1.bin` was written by the first firmware with storage. It contains the first sector of the records and the first two
/// of the log.
#[test]
fn data_stored_by_older_firmware_is_read() {
    let capture = include_bytes!("../data/flash-1.bin");
    let mut chip = chip();
    let (records, log) = capture.split_at(SECTOR as usize);
    chip.bytes[..records.len()].copy_from_slice(records);
    chip.bytes[SMALL_LOG.start as usize..][..log.len()].copy_from_slice(log);

    let mut store = open(&mut chip);
    let contents = store.contents();
    assert_eq!((contents.start, contents.next_record, contents.newer_kinds, contents.newer_records), (2, 20, 0, 0));
    assert_eq!(block_on(store.get::<Tissue>(0)), Ok(Some(*TISSUE)));
    let serial = Serial::new("P-0001").expect("the serial number is valid");
    assert_eq!(block_on(store.get::<IdentityRecord>(0)), Ok(Some(IdentityRecord { side: Side::Right, serial })));
    assert_eq!(block_on(store.get::<Bonds>(0)), Ok(Some(Bonds([1, 2, 3, 4, 5].into_iter().collect()))));
    let calibration = block_on(store.calibration(7, 40)).expect("the chip works").expect("the calibration is valid");
    for block in 0..3u16 {
        let cells = block_on(store.calibration_block(&calibration, block as u8))
            .expect("the chip works")
            .expect("the block is stored");
        for (i, cell) in (block * BLOCK_CELLS as u16..40).zip(cells) {
            assert_eq!(cell, CellCalibration { offset: 100 + i, gain: 1.0 + f32::from(i) / 64.0 });
        }
    }
    let expected = (5..20).map(|number| {
        let regions = step(number).regions.map(|region| old_region(region, 0));
        Step { regions, boots_since: 1, start_unix_us: None, refit: 0, foot: StepFoot::default(), ..step(number) }
    });
    assert_eq!(steps(&mut store), expected.collect::<Vec<_>>());
    // Numbering continues, and old and new steps are acknowledged together.
    assert_eq!(block_on(store.push_record(step(20))), Ok(0));
    assert_eq!(block_on(store.acknowledge(18)), Ok(false));
    assert_eq!(numbers(&mut store), [19, 20]);
}

#[test]
fn step_numbers_continue_after_all_steps_were_acknowledged() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    for number in [u32::MAX - 1, u32::MAX, 0, 1] {
        assert_eq!(block_on(store.push_record(step(number))), Ok(0));
    }
    assert_eq!(block_on(store.acknowledge(u32::MAX)), Ok(false));
    assert_eq!(numbers(&mut store), [0, 1]);
    assert_eq!(block_on(store.acknowledge(1)), Ok(false));
    assert!(numbers(&mut store).is_empty());
    for _ in 0..3 {
        let mut store = open(&mut chip);
        assert_eq!(store.contents().next_record, 2);
        assert!(numbers(&mut store).is_empty());
        // A host repeats its acknowledgement if it does not know whether the first one arrived.
        assert_eq!(block_on(store.acknowledge(1)), Ok(false));
    }
}

/// The chip failed to store step 3. The host received that step from RAM, and acknowledges it.
#[test]
fn step_numbers_continue_after_a_step_that_could_not_be_stored() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    for number in 0..3 {
        assert_eq!(block_on(store.push_record(step(number))), Ok(0));
    }
    assert_eq!(block_on(store.acknowledge(3)), Ok(false));
    assert!(numbers(&mut store).is_empty());
    let store = open(&mut chip);
    assert_eq!((store.contents().next_record, store.contents().erased), (4, 0));
}

#[test]
fn a_full_log_contains_at_least_the_last_2000_steps_and_counts_dropped_ones() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    let (mut dropped, mut fewest) = (0, u32::MAX);
    for number in 0..12_000 {
        let newly_dropped = block_on(store.push_record(step(number))).expect("the chip works");
        dropped += newly_dropped;
        if newly_dropped > 0 {
            let stored = numbers(&mut store);
            assert_eq!(
                stored,
                (dropped..=number).collect::<Vec<_>>(),
                "the newest steps must be stored, without a gap"
            );
            fewest = fewest.min(stored.len() as u32);
        }
    }
    assert!(fewest >= 2000, "{fewest}");
    let stored = numbers(&mut open(&mut chip));
    assert_eq!(stored, (dropped..12_000).collect::<Vec<_>>());
}

/// Opens the store on a copy of this chip, as after a loss of power. Asserts that this start reads little and erases nothing.
/// Returns the copy.
fn start_quickly(chip: &NorFlashChip) -> NorFlashChip {
    let mut chip = chip.restarted();
    (chip.read_operations, chip.bytes_read) = (0, 0);
    let erasures = chip.erasures.clone();
    open(&mut chip);
    // A start surveys the contents of the chip twice. Each survey searches the sectors of the log twice, with at most two
    // one-byte reads for each sector, and reads the records.
    let most_reads = 8 * (chip.bytes.len() / SECTOR as usize) as u64 + 10_000;
    let (reads, bytes) = (chip.read_operations, chip.bytes_read);
    assert!(reads < most_reads && bytes < 400_000, "{reads} reads, {bytes} bytes");
    assert_eq!(chip.erasures, erasures);
    chip
}

/// A start reads the records and a few sectors of a log of up to 1,550 steps, wherever the log begins and ends.
#[test]
fn each_start_finds_the_newest_record_without_reading_the_log() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    let mut oldest = 0;
    for number in 0..5000 {
        let dropped = block_on(store.push_record(step(number))).expect("the chip works");
        oldest += dropped;
        if number >= 1500 && number % 50 == 0 {
            oldest = oldest.max(number - 1500 + number % 8 + 1);
            block_on(store.acknowledge(oldest - 1)).expect("the chip works");
        }
        if number % 3 == 0 {
            let mut started = start_quickly(store.flash().expect("there is a chip"));
            let mut again = open(&mut started);
            assert_eq!((again.contents().next_record, again.contents().contradictions), (number + 1, 0));
            if number % 97 == 0 {
                assert_eq!(numbers(&mut again), (oldest..=number).collect::<Vec<_>>());
            }
        }
    }
}

/// Newer firmware ran on trial, and its entries fill the newest sectors.
#[test]
fn numbers_continue_after_many_entries_of_newer_firmware() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    for number in 0..20 {
        assert_eq!(block_on(store.push_record(step(number))), Ok(0));
    }
    block_on(async {
        let mut log = QueueStorage::new(&mut chip, QueueConfig::new(SMALL_LOG), Cache::new_uncached());
        for _ in 0..40 {
            log.push(&[9; 400], false).await.expect("there is room");
        }
    });
    let mut store = open(&mut chip);
    // Newer firmware that is installed again reads both its own entries and the later ones, so no number may be used twice: each
    // entry that this firmware cannot read counts as one number.
    assert_eq!((store.contents().next_record, store.contents().newer_records), (60, 40));
    assert_eq!(numbers(&mut store), (0..20).collect::<Vec<_>>());
    // The number of the next record is preserved, although the log has no entry left that this firmware can read.
    assert_eq!(block_on(store.acknowledge(19)), Ok(false));
    let mut store = open(&mut chip);
    assert_eq!(store.contents().next_record, 60);
    assert_eq!(block_on(store.push_record(step(60))), Ok(0));
    assert_eq!(numbers(&mut store), [60]);
}

/// Deleted entries follow an entry of newer firmware that remains stored, and a damaged sector of the records must be repaired.
#[test]
fn a_repair_preserves_the_order_of_the_log() {
    let mut chip = chip();
    open(&mut chip);
    block_on(async {
        let mut log = QueueStorage::new(&mut chip, QueueConfig::new(SMALL_LOG), Cache::new_uncached());
        log.push(&[9; 50], false).await.expect("there is room");
    });
    let mut store = open(&mut chip);
    for number in 0..60 {
        assert_eq!(block_on(store.push_record(step(number))), Ok(0));
    }
    assert_eq!(block_on(store.acknowledge(57)), Ok(false));
    for value in 0..40 {
        assert_eq!(block_on(store.put(0, &Bonds([value; 150].into_iter().collect()))), Ok(()));
    }
    // The second to last of the log's sectors in use has only deleted entries.
    assert_eq!(numbers(&mut store), [58, 59]);
    // A full sector has a mark in its first byte and one in its last byte. If only the last byte has a mark, the erasure of the
    // sector was interrupted.
    let next_sector = &mut chip.bytes[2 * SECTOR as usize..3 * SECTOR as usize];
    assert!(next_sector.iter().all(|byte| *byte == 0xff), "the records must fit into two sectors");
    next_sector[SECTOR as usize - 1] = 0;
    let mut store = open(&mut chip);
    assert_eq!((store.contents().next_record, store.contents().erased), (60, 0));
    assert_eq!(block_on(store.push_record(step(60))), Ok(0));
    assert_eq!(numbers(&mut store), [58, 59, 60]);
    assert_eq!(numbers(&mut open(&mut chip)), [58, 59, 60]);
}

/// With 27,000 steps of the longest form on each chip, a pair of insoles stores a day of 50,000 steps without a phone.
#[test]
fn a_chip_of_16_mib_holds_27000_steps_and_starts_without_reading_them() {
    /// Number of the first step. The numbers wrap during the test.
    const FIRST: u32 = u32::MAX - 30_000;
    const STEPS: u32 = 60_000;
    let longest = |number| Step {
        start_us: u64::MAX,
        duration_us: u32::MAX,
        sample_us: u32::MAX,
        start_unix_us: Some(u64::MAX),
        ..step(number)
    };
    let mut chip = NorFlashChip::new(16 << 20);
    let mut store = open(&mut chip);
    let mut dropped = 0;
    for i in 0..STEPS {
        dropped += block_on(store.push_record(longest(FIRST.wrapping_add(i)))).expect("the chip works");
    }
    let mut chip = start_quickly(&chip);
    let mut store = open(&mut chip);
    assert_eq!(store.contents().next_record, FIRST.wrapping_add(STEPS));
    let mut expected: Vec<_> = (dropped..STEPS).map(|i| FIRST.wrapping_add(i)).collect();
    assert!(expected.len() >= 27_000, "{}", expected.len());
    assert_eq!(numbers(&mut store), expected);
    // A phone receives and acknowledges the stored steps in parts.
    while !expected.is_empty() {
        let part: Vec<_> = expected.drain(..expected.len().min(61)).collect();
        let mut received = Vec::new();
        let is_wanted = |record: LoadRecord| {
            let is_wanted = received.len() < part.len();
            received.extend(is_wanted.then(|| record.number()));
            is_wanted
        };
        assert_eq!(block_on(store.records(None, is_wanted)), Ok(!expected.is_empty()));
        assert_eq!(received, part);
        assert_eq!(block_on(store.acknowledge(part[part.len() - 1])), Ok(false));
    }
    let mut chip = start_quickly(&chip);
    assert_eq!(open(&mut chip).contents().next_record, FIRST.wrapping_add(STEPS));
}

#[test]
fn records_of_newer_firmware_are_reported_and_not_changed() {
    let mut chip = chip();
    let newer_tissue: &[u8] = b"parameters in a newer form";
    let newer_entry: &[u8] = &[9; 50];
    open(&mut chip);
    block_on(async {
        let mut records = MapStorage::new(&mut chip, MapConfig::new(RECORDS), Cache::new_uncached());
        let (mut buffer, key) = ([0; 100], [Tissue::KIND, 0, Tissue::VERSION + 1]);
        records.store_item(&mut buffer, &key, &newer_tissue).await.expect("there is room");
        records.store_item(&mut buffer, &[31, 0, 1], &newer_tissue).await.expect("there is room");
        let mut log = QueueStorage::new(&mut chip, QueueConfig::new(SMALL_LOG), Cache::new_uncached());
        log.push(newer_entry, false).await.expect("there is room");
    });
    let mut store = open(&mut chip);
    assert_eq!(store.contents().newer_kinds, 1 << Tissue::KIND | 1 << 31);
    assert_eq!(store.contents().newer_records, 1);
    assert_eq!(block_on(store.get::<Tissue>(0)), Ok(None));
    // This firmware stores its own records in the same sectors, until the sectors have been reused several times.
    for i in 0..5000 {
        let tissue = Tissue::new(
            [plantar::pipeline::model::ForceLaw { c_m: 0.01 + i as f32 * 1e-6, ..TISSUE.force_laws[0] }; 8],
        );
        assert_eq!(block_on(store.put(0, &tissue)), Ok(()));
        assert_eq!(block_on(store.get(0)), Ok(Some(tissue)));
    }
    for number in 0..50 {
        assert_eq!(block_on(store.push_record(step(number))), Ok(0));
    }
    assert_eq!(block_on(store.acknowledge(49)), Ok(false));
    assert!(numbers(&mut store).is_empty());
    assert!(chip.erasures[0] > 1, "sectors of records must be reused");
    block_on(async {
        let mut records = MapStorage::new(&mut chip, MapConfig::new(RECORDS), Cache::new_uncached());
        let mut buffer = [0; 400];
        for key in [[Tissue::KIND, 0, Tissue::VERSION + 1], [31, 0, 1]] {
            let stored = records.fetch_item::<&[u8]>(&mut buffer, &key).await.expect("the chip works");
            assert_eq!(stored, Some(newer_tissue));
        }
        let mut log = QueueStorage::new(&mut chip, QueueConfig::new(SMALL_LOG), Cache::new_uncached());
        let oldest = log.peek(&mut buffer).await.expect("the chip works");
        assert_eq!(oldest.as_deref(), Some(newer_entry));
    });
}

/// Newer firmware ran on trial and was swapped back. The boot counters are then stored only in its newer format, which this
/// firmware cannot read. The other records must remain.
#[test]
fn nothing_is_erased_if_only_newer_firmware_counted_boots() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    assert_eq!(block_on(store.put(0, &*TISSUE)), Ok(()));
    block_on(async {
        let mut records = MapStorage::new(&mut chip, MapConfig::new(RECORDS), Cache::new_uncached());
        let mut buffer = [0; 400];
        records
            .store_item(&mut buffer, &[BootCounters::KIND, 0, BootCounters::VERSION + 1], &&[1][..])
            .await
            .expect("there is room");
        records
            .remove_item(&mut buffer, &[BootCounters::KIND, 0, BootCounters::VERSION])
            .await
            .expect("the chip works");
    });
    let mut store = open(&mut chip);
    assert_eq!(block_on(store.get(0)), Ok(Some(*TISSUE)));
    assert_eq!((store.contents().newer_kinds, store.contents().erased), (1 << BootCounters::KIND, 0));
}

#[test]
fn an_incomplete_calibration_or_one_of_another_layout_is_not_used() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    let block = [CellCalibration { offset: 5, gain: 2.0 }; BLOCK_CELLS];
    let mut id = plantar::protocol::CalibrationId::new();
    id.add(&block);
    id.add(&block);
    assert_eq!(block_on(store.put_calibration_block(0, &block)), Ok(()));
    assert_eq!(
        block_on(store.put_calibration(7, 32, id.id())),
        Ok(false),
        "a calibration without its second block must be refused"
    );
    assert_eq!(block_on(store.put_calibration_block(1, &block)), Ok(()));
    assert_eq!(
        block_on(store.put_calibration(7, 32, id.id() ^ 1)),
        Ok(false),
        "a calibration with another checksum must be refused"
    );
    assert_eq!(block_on(store.calibration(7, 32)), Ok(None));
    assert_eq!(block_on(store.put_calibration(7, 32, id.id())), Ok(true));
    assert!(matches!(block_on(store.calibration(7, 32)), Ok(Some(_))));
    assert_eq!(block_on(store.calibration(8, 32)), Ok(None), "a calibration of another layout must not be used");
    assert_eq!(
        block_on(store.calibration(7, 31)),
        Ok(None),
        "a calibration of another number of cells must not be used"
    );
}

/// No content of the chip makes it unusable, or makes the firmware panic.
#[test]
fn a_chip_with_any_content_becomes_usable() {
    let mut random = fastrand::Rng::with_seed(5);
    for round in 0..60 {
        let mut chip = chip();
        match round % 3 {
            0 => random.fill(&mut chip.bytes),
            1 => chip.bytes.fill(random.u8(..)),
            // The content of a used chip, with flipped bits.
            _ => {
                let mut store = open(&mut chip);
                for number in 0..500 {
                    block_on(store.push_record(step(number))).expect("the chip works");
                }
                let mut index = random.usize(..RECORDS.end as usize);
                for _ in 0..200 {
                    chip.bytes[index] ^= 1 << random.u8(0..8);
                    // In the log only bits of written bytes are flipped: the log does not verify an entry after writing it, and a
                    // flipped bit in an erased area would damage a later entry.
                    let range = if random.bool() {
                        0..RECORDS.end as usize
                    } else {
                        SMALL_LOG.start as usize..chip.bytes.len()
                    };
                    index = random.usize(range);
                    while index >= SMALL_LOG.start as usize && chip.bytes[index] == 0xff {
                        index = random.usize(SMALL_LOG.start as usize..chip.bytes.len());
                    }
                }
            }
        }
        let mut store = open(&mut chip);
        assert_eq!(block_on(store.put(0, &*TISSUE)), Ok(()), "round {round}");
        let next = store.contents().next_record;
        for number in next..next + 20 {
            block_on(store.push_record(step(number))).expect("the chip works");
        }
        let mut store = open(&mut chip);
        assert_eq!(block_on(store.get(0)), Ok(Some(*TISSUE)), "round {round}");
        assert!(numbers(&mut store).ends_with(&(next..next + 20).collect::<Vec<_>>()), "round {round}");
    }
}

/// Up to 2,000 of the first reads after power-on return only zeros, only ones or noise. The stored steps and records remain.
#[test]
fn a_chip_whose_first_reads_are_wrong_is_not_erased() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    assert_eq!(block_on(store.put(0, &*TISSUE)), Ok(()));
    for number in 0..1500 {
        assert_eq!(block_on(store.push_record(step(number))), Ok(0));
    }
    let chip = chip.restarted();
    for wrong_byte in [Some(0), Some(0xff), None] {
        for wrong_reads in (0..40).chain([100, 500, 2000]) {
            let mut chip = chip.clone();
            (chip.wrong_reads, chip.wrong_byte) = (wrong_reads, wrong_byte);
            chip.erasures.fill(0);
            let mut store = open(&mut chip);
            let place = format!("{wrong_reads} reads of {wrong_byte:?}: {:?}", store.contents());
            assert_eq!((store.contents().erased, numbers(&mut store).len()), (0, 1500), "{place}");
            assert_eq!(block_on(store.get(0)), Ok(Some(*TISSUE)), "{place}");
            assert!(chip.erasures.iter().all(|erasures| *erasures == 0), "{place}");
        }
    }
}

/// A chip that returns noise at all times is neither erased nor written, and this is reported.
#[test]
fn a_chip_without_two_equal_surveys_is_not_used() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    for number in 0..100 {
        assert_eq!(block_on(store.push_record(step(number))), Ok(0));
    }
    let before = chip.restarted();
    let mut chip = before.clone();
    (chip.wrong_reads, chip.operations) = (u64::MAX, 0);
    let mut store = open(&mut chip);
    assert_eq!(block_on(store.push_record(step(100))), Err(StorageError::Chip));
    let contents = store.contents();
    assert!(contents.contradictions > 0 && contents.erased == 0, "{contents:?}");
    assert!(chip.operations == 0 && chip.bytes == before.bytes, "{contents:?}");
}

/// The first sectors of the records and the whole log have random content, in which nothing shows that the chip was in use
/// before. Both areas are counted as erased nevertheless. Only data within the first 512 bytes of an area, which an interrupted
/// first start may have written, would not be counted.
#[test]
fn an_area_with_foreign_data_is_counted_when_it_is_erased() {
    for chip_bytes in [SMALL_LOG.end as usize, 16 << 20] {
        let mut chip = NorFlashChip::new(chip_bytes);
        let mut random = fastrand::Rng::with_seed(9);
        random.fill(&mut chip.bytes[..4 * SECTOR as usize]);
        random.fill(&mut chip.bytes[flash_map::log(chip_bytes).start as usize..]);
        let mut store = open(&mut chip);
        assert_eq!(store.contents().erased, 2);
        assert_eq!(block_on(store.push_record(step(0))), Ok(0));
        assert_eq!(open(&mut chip).contents().next_record, 1);
    }
}

/// True if a chip contains these bytes anywhere.
fn contains(chip: &NorFlashChip, bytes: &[u8]) -> bool {
    chip.bytes.windows(bytes.len()).any(|window| window == bytes)
}

#[test]
fn erasing_the_data_of_the_wearer_leaves_no_byte_of_them_and_preserves_the_rest() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    let serial = Serial::new("P-0001").expect("the serial number is valid");
    let identity = IdentityRecord { side: Side::Right, serial };
    let keys: Vec<u8> = (0..150_u32).map(|i| (i * 37 % 251) as u8).collect();
    let block = [CellCalibration { offset: 300, gain: 1.5 }; BLOCK_CELLS];
    let mut id = plantar::protocol::CalibrationId::new();
    id.add(&block);
    assert_eq!(block_on(store.put(0, &identity)), Ok(()));
    assert_eq!(block_on(store.put_calibration_block(0, &block)), Ok(()));
    assert_eq!(block_on(store.put_calibration(7, 16, id.id())), Ok(true));
    assert_eq!(block_on(store.put(0, &*TISSUE)), Ok(()));
    assert_eq!(block_on(store.put(0, &Bonds(keys.iter().copied().collect()))), Ok(()));
    for number in 0..100 {
        assert_eq!(block_on(store.push_record(step(number))), Ok(0));
    }
    let tissue = plantar::protocol::encode(&*TISSUE, &mut [0; 500]).expect("it fits").to_vec();
    let regions = plantar::protocol::encode(&step(50).regions, &mut [0; 500]).expect("it fits").to_vec();
    let mut chip = chip.restarted();
    assert!([&keys, &tissue, &regions].iter().all(|bytes| contains(&chip, bytes)));
    let heartbeats = std::cell::Cell::new(0);
    assert_eq!(block_on(open(&mut chip).erase_wearer(|| heartbeats.set(heartbeats.get() + 1))), Ok(()));
    assert!([&keys, &tissue, &regions].iter().all(|bytes| !contains(&chip, bytes)));
    assert!(heartbeats.get() > 256, "there must be a heartbeat for each sector of the log");

    let mut store = open(&mut chip);
    assert_eq!((store.contents().next_record, store.contents().erased, store.contents().newer_kinds), (100, 0, 0));
    assert_eq!(block_on(store.get::<IdentityRecord>(0)), Ok(Some(identity)));
    assert!(matches!(block_on(store.calibration(7, 16)), Ok(Some(_))));
    assert_eq!(block_on(store.get::<Tissue>(0)), Ok(None));
    assert_eq!(block_on(store.get::<Bonds>(0)), Ok(None));
    assert!(numbers(&mut store).is_empty());
    assert_eq!(block_on(store.push_record(step(100))), Ok(0));
    assert_eq!(numbers(&mut store), [100]);
}

/// The erasure leaves the record with the next number (`NumberingRecord`), which the next start removes, so that a log that is
/// damaged later is counted.
#[test]
fn a_log_that_is_damaged_after_an_erasure_is_counted() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    assert_eq!(block_on(store.push_record(step(0))), Ok(0));
    assert_eq!(block_on(store.erase_wearer(|| {})), Ok(()));
    open(&mut chip);
    fastrand::Rng::with_seed(9).fill(&mut chip.bytes[SMALL_LOG.start as usize..]);
    assert_eq!(open(&mut chip).contents().erased, 1);
}

/// Power fails in each operation of the erasure, with a log that has wrapped, so that its newest steps are at lower addresses
/// than its oldest. No number is used twice, and no area counts as damaged.
#[test]
fn numbers_continue_after_an_interrupted_erasure() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    for number in 0..3000 {
        block_on(store.push_record(step(number))).expect("the chip works");
    }
    let used = chip.restarted();
    let mut whole = used.clone();
    let mut store = open(&mut whole);
    let before = store.flash().expect("there is a chip").operations;
    assert_eq!(block_on(store.erase_wearer(|| {})), Ok(()));
    for operation in before..whole.operations {
        let mut chip = used.clone();
        chip.cut = Some((operation, Torn::Within));
        assert!(block_on(open(&mut chip).erase_wearer(|| {})).is_err());
        let mut chip = chip.restarted();
        let mut store = open(&mut chip);
        assert_eq!((store.contents().next_record, store.contents().erased), (3000, 0), "operation {operation}");
        // The oldest steps were erased, and the newest ones are left, without a gap.
        let left = numbers(&mut store);
        assert!(left.iter().copied().eq(3000 - left.len() as u32..3000), "operation {operation}: {left:?}");
        assert_eq!(acknowledge(&mut store, 2999), Ok(()), "operation {operation}");
        assert_eq!(open(&mut chip).contents().erased, 0, "operation {operation}");
        let mut store = open(&mut chip);
        assert_eq!(block_on(store.push_record(step(3000))), Ok(0), "operation {operation}");
        let mut store = open(&mut chip);
        assert_eq!((store.contents().next_record, numbers(&mut store)), (3001, vec![3000]), "operation {operation}");
    }
}

/// A long deletion is done in parts, so that the insole can store new steps, and the storage task can count a heartbeat, between
/// two parts.
#[test]
fn a_long_deletion_is_done_in_parts() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    for number in 0..1500 {
        block_on(store.push_record(step(number))).expect("the chip works");
    }
    let (mut next, mut parts) = (1500, 0);
    let mut remaining = numbers(&mut store).len();
    loop {
        let flash = store.flash().expect("there is a chip");
        let operations = flash.operations;
        let some_remain = block_on(store.acknowledge(1400)).expect("the chip works");
        let operations = store.flash().expect("there is a chip").operations - operations;
        assert!(operations < 100, "{operations} operations");
        let left = numbers(&mut store);
        assert!(left.len() < remaining && left.iter().copied().eq(next - left.len() as u32..next), "{left:?}");
        assert_eq!(some_remain, left[0] <= 1400);
        parts += 1;
        if !some_remain {
            break;
        }
        assert_eq!(block_on(store.push_record(step(next))), Ok(0));
        next += 1;
        remaining = left.len() + 1;
    }
    assert!(parts > 10, "{parts} parts");
    let stored: Vec<_> = (1401..next).collect();
    assert_eq!(numbers(&mut store), stored);
    assert_eq!(numbers(&mut open(&mut chip)), stored);
}

/// Power fails in each operation of an acknowledgement that deletes the entries of several sectors, and the supply is too low for
/// any change at the next start. In the second round, an earlier erasure of the wearer's data has also stored the number of the
/// next record, and the supply was too low to remove it.
#[test]
fn an_interrupted_deletion_is_repaired_once_the_supply_is_sufficient() {
    for has_erased in [false, true] {
        let mut chip = chip();
        let mut store = open(&mut chip);
        for number in 0..30 {
            assert_eq!(block_on(store.push_record(step(number))), Ok(0));
        }
        if has_erased {
            assert_eq!(block_on(store.erase_wearer(|| {})), Ok(()));
        }
        for number in 30..70 {
            assert_eq!(block_on(store.push_record(step(number))), Ok(0));
        }
        let used = chip.restarted();
        let restart = if has_erased { open_with_low_supply } else { open };
        let mut whole = used.clone();
        let mut store = restart(&mut whole);
        let before = store.flash().expect("there is a chip").operations;
        assert_eq!(acknowledge(&mut store, 68), Ok(()));
        for operation in before..whole.operations {
            let mut chip = used.clone();
            chip.cut = Some((operation, Torn::Within));
            assert!(acknowledge(&mut restart(&mut chip), 68).is_err());
            let mut chip = chip.restarted();
            let mut store = open_with_low_supply(&mut chip);
            let place = format!("operation {operation}: {:?}", store.contents());
            assert_eq!(store.contents().next_record, 70, "{place}");
            assert_eq!(block_on(store.push_record(step(70))), Ok(0), "{place}");
            assert_eq!(acknowledge(&mut store, 69), Ok(()), "{place}");
            assert_eq!(numbers(&mut store), [70], "{place}");
            let mut store = open(&mut chip);
            assert_eq!((store.contents().next_record, numbers(&mut store)), (71, vec![70]), "{place}");
        }
    }
}

/// The erasure of a sector of the records was interrupted, and the supply is too low to repair it at the next start.
#[test]
fn the_count_of_boots_continues_once_the_records_are_repaired() {
    let mut chip = chip();
    for _ in 0..5 {
        open(&mut chip);
    }
    let mut store = open(&mut chip);
    assert_eq!(block_on(store.push_record(step(0))), Ok(0));
    let sector = &mut chip.bytes[SECTOR as usize..2 * SECTOR as usize];
    assert!(sector.iter().all(|byte| *byte == 0xff), "the records must fit into one sector");
    sector[SECTOR as usize - 1] = 0;
    let mut store = open_with_low_supply(&mut chip);
    assert_eq!(block_on(store.push_record(step(1))), Ok(0));
    let stored = steps(&mut store);
    assert_eq!(stored.iter().map(|step| step.boots_since).collect::<Vec<_>>(), [1, 0]);
    assert_eq!(store.contents().start, 7);
}

#[test]
fn a_defective_chip_is_reported() {
    let mut chip = chip();
    chip.cut = Some((0, Torn::Before));
    let _ = block_on(chip.erase(0, SECTOR));
    let mut store = open(&mut chip);
    assert_eq!(block_on(store.get::<Tissue>(0)), Err(StorageError::Chip));
    assert_eq!(block_on(store.put(0, &*TISSUE)), Err(StorageError::Chip));
    assert_eq!(block_on(store.push_record(step(0))), Err(StorageError::Chip));
    assert_eq!(block_on(store.acknowledge(0)), Err(StorageError::Chip));
    assert_eq!(block_on(store.records(None, |_| true)), Err(StorageError::Chip));
}

#[test]
fn serial_numbers_are_short_and_printable() {
    for good in ["", "P-0001", "ABCDEFGHIJKLMNOP"] {
        let serial = Serial::new(good).expect("the serial number is valid");
        assert!(serial.is_valid());
        assert_eq!(serial.as_str(), good);
    }
    for bad in ["ABCDEFGHIJKLMNOPQ", "a b", "ä", "\n"] {
        assert_eq!(Serial::new(bad), None, "{bad:?}");
    }
}

/// Records of all kinds are numbered in one sequence, are returned with the number of boots since they were recorded, and are
/// removed by one acknowledgement.
#[test]
fn load_bouts_and_alerts_are_stored_between_steps() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    let records = [LoadRecord::from(bout(0)), step(1).into(), bout(2).into(), bout(3).into(), alert(4).into()];
    for record in records {
        assert_eq!(block_on(store.push_record(record)), Ok(0));
    }
    let mut store = open(&mut chip);
    assert_eq!(store.contents().next_record, 5);
    let mut stored = Vec::new();
    let more = block_on(store.records(Some(0), |record| {
        stored.push(record);
        true
    }));
    let expected = [
        LoadRecord::from(Step { boots_since: 1, ..step(1) }),
        Bout { boots_since: 1, ..bout(2) }.into(),
        Bout { boots_since: 1, ..bout(3) }.into(),
        Alert { boots_since: 1, ..alert(4) }.into(),
    ];
    assert_eq!((more, stored), (Ok(false), expected.to_vec()));
    assert_eq!(block_on(store.acknowledge(2)), Ok(false));
    let mut store = open(&mut chip);
    let mut numbers = Vec::new();
    assert_eq!(
        block_on(store.records(None, |record| {
            numbers.push(record.number());
            true
        })),
        Ok(false)
    );
    assert_eq!((numbers, store.contents().next_record), (vec![3, 4], 5));
}

/// As in the firmware, a few steps are read and acknowledged at a time, while others are recorded.
#[test]
fn steps_are_read_and_acknowledged_while_others_are_recorded() {
    let mut chip = chip();
    let mut store = open(&mut chip);
    let mut random = fastrand::Rng::with_seed(4);
    let (mut oldest, mut next, mut read) = (0, 0, 0);
    for _ in 0..60_000 {
        match random.u8(0..3) {
            0 if next - oldest < 1500 => {
                assert_eq!(block_on(store.push_record(step(next))), Ok(0));
                next += 1;
            }
            1 => {
                let after = (read > oldest).then(|| read - 1);
                let first = read.max(oldest);
                let mut got = Vec::new();
                let more = block_on(store.records(after, |record| {
                    let has_room = got.len() < 6;
                    if has_room {
                        got.push(record.number());
                    }
                    has_room
                }));
                let expected: Vec<u32> = (first..next).take(6).collect();
                assert_eq!((more, &got), (Ok(next - first > 6), &expected), "{oldest} {next}");
                read = first + expected.len() as u32;
            }
            _ if read > oldest => {
                oldest += random.u32(1..=read - oldest);
                assert_eq!(block_on(store.acknowledge(oldest - 1)), Ok(false));
            }
            _ => {}
        }
        // In a new session, the host reads all unacknowledged steps again.
        if random.u16(..) < 100 {
            read = oldest;
        }
    }
    println!("{next} steps");
}

/// Prints the figures of `docs/storage.md` for 10,000 steps a day, each of which is acknowledged as soon as it is stored, or
/// none of which is acknowledged.
#[test]
fn a_day_of_steps_wears_the_chip_little() {
    const STEPS: u32 = 10_000;
    const DAYS: u32 = 3;
    /// Number of erase operations for which a sector is specified.
    const ERASURES: f64 = 100_000.0;
    for is_acknowledged in [true, false] {
        let mut chip = chip();
        let mut store = open(&mut chip);
        for number in 0..STEPS * DAYS {
            block_on(store.push_record(step(number))).expect("the chip works");
            if is_acknowledged {
                block_on(store.acknowledge(number)).expect("the chip works");
            }
        }
        let log = (SMALL_LOG.start / SECTOR) as usize..(SMALL_LOG.end / SECTOR) as usize;
        let most = chip.erasures[log].iter().max().expect("there are sectors");
        let per_day = f64::from(*most) / f64::from(DAYS);
        let years = ERASURES / per_day / 365.25;
        let bytes = chip.bytes_written as f64 / f64::from(STEPS * DAYS);
        println!(
            "acknowledged: {is_acknowledged}: {per_day:.1} erase operations of the most used sector per day, \
             {years:.0} years, {bytes:.0} bytes per step"
        );
        assert!(years > 20.0);
    }
}

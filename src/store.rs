//! What an insole keeps in its NOR flash chip: records that are replaced, and a log of steps that no host has acknowledged.
//!
//! Both are `sequential-storage`'s, which spreads the wear, gives every item a CRC-32 and finds its way after a loss of power
//! in any write: an item is there whole or not at all. Every record and step carries the version of its format.
//! `docs/storage.md` has the map, the wear and the rules.

use crate::calibrate::CellCalibration;
use crate::contact::ContactRule;
use crate::insole::Tissue;
use crate::map::SECTOR;
use crate::region::Side;
use crate::wire::{Reset, Serial, Step, StepRegion, checksum, decode, encode};
use core::ops::Range;
use embedded_storage_async::nor_flash::MultiwriteNorFlash;
use heapless::Vec;
use sequential_storage::Error;
use sequential_storage::cache::page_states::CalculatedPageStates;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};
use sequential_storage::queue::{QueueConfig, QueueStorage};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Where records lie.
pub const RECORDS: Range<u32> = 0..16 * SECTOR;
/// Where steps lie: room for 3,000, 12 to a sector.
pub const LOG: Range<u32> = RECORDS.end..RECORDS.end + 256 * SECTOR;

/// Cells in a [`Cells`] record.
pub const PART_CELLS: usize = 16;

/// Longest bonds, bytes.
pub const MAX_BONDS_BYTES: usize = 192;

/// Room for the longest item: a step with what the log and the chip's words add.
const BUFFER: usize = 352;

/// So often a record is written until it can be read back.
const TRIES: usize = 3;

/// Why something could not be kept or read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failed {
    /// The chip did not do what it was told, or is not there.
    Chip,
    /// No room is left, or what is kept does not make sense.
    Contents,
}

impl<E> From<Error<E>> for Failed {
    fn from(error: Error<E>) -> Self {
        match error {
            Error::Storage { .. } => Self::Chip,
            _ => Self::Contents,
        }
    }
}

/// A kind of record.
pub trait Record: Serialize + DeserializeOwned + PartialEq {
    /// Number of the kind, never given twice.
    const KIND: u8;
    /// Version of the format, from 1.
    const VERSION: u8;

    /// Reads what an older version wrote.
    fn migrate(version: u8, bytes: &[u8]) -> Option<Self> {
        let _ = (version, bytes);
        None
    }
}

/// Who the insole is; in force from the next start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Name {
    /// The foot.
    pub side: Side,
    /// The serial number.
    pub serial: Serial,
}

/// Which calibration is in force from the next start; its cells are in [`Cells`] records.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Calibration {
    /// The layout it was measured on.
    pub layout_id: u32,
    /// Number of cells.
    pub cells: u16,
    /// Checksum of the cells' calibrations, as [`CalibrationId`] makes it.
    pub id: u32,
    /// Which of two places it lies in: the next one is written into the other.
    pub place: u8,
}

/// Calibrations of [`PART_CELLS`] cells; those beyond the last cell are not looked at.
pub type Part = [CellCalibration; PART_CELLS];

/// A part of a calibration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cells(pub Part);

/// The phones that are known, as the package `bluetooth` reads them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Bonds(pub Vec<u8, MAX_BONDS_BYTES>);

/// How often the insole started, for each [`Reset`] in their order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Starts(pub [u32; 6]);

impl Starts {
    /// Counts a start.
    pub fn count(&mut self, reset: Reset) {
        if let Some(count) = self.0.get_mut(reset as usize) {
            *count = count.wrapping_add(1);
        }
    }

    /// All starts; the number of the running one.
    pub fn total(&self) -> u32 {
        self.0.iter().fold(0, |sum, count| sum.wrapping_add(*count))
    }
}

/// Numbers and versions of all kinds.
macro_rules! records {
    ($($record:ty: $kind:literal, $version:literal;)*) => {
        $(impl Record for $record {
            const KIND: u8 = $kind;
            const VERSION: u8 = $version;
        })*

        /// The version of every kind, to tell what a newer firmware wrote.
        const VERSIONS: &[(u8, u8)] = &[$(($kind, $version)),*];
    };
}

records! {
    Name: 1, 1;
    Tissue: 2, 1;
    Calibration: 3, 1;
    Cells: 4, 1;
    Bonds: 5, 1;
    Starts: 6, 1;
}

/// Where a record lies: its kind, its part and its version. Versions lie side by side, so none replaces a newer one.
type Key = [u8; 3];

/// What the log holds.
#[derive(Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "they live one at a time, in place")]
enum Entry {
    Step {
        /// The start that it was made in.
        start: u32,
        step: Step,
    },
    /// All steps before this number are acknowledged.
    Acknowledged { next: u32 },
}

/// What tells the parts of one place from those of the other: a bit beyond the number of parts.
const OTHER_PLACE: u8 = 0x80;

/// Makes the id of a calibration, cell by cell.
#[derive(Default)]
pub struct CalibrationId(u32);

impl CalibrationId {
    /// No cells yet.
    pub const fn new() -> Self {
        Self(0)
    }

    /// Adds cells.
    pub fn add(&mut self, cells: &[CellCalibration]) {
        for cell in cells {
            let mut bytes = [0; 10];
            let (before, after) = bytes.split_at_mut(4);
            before.copy_from_slice(&self.0.to_le_bytes());
            after[..2].copy_from_slice(&cell.offset.to_le_bytes());
            after[2..].copy_from_slice(&cell.gain.to_le_bytes());
            self.0 = checksum(&bytes);
        }
    }

    /// The id; never 0, which stands for none.
    pub fn id(&self) -> u32 {
        self.0.max(1)
    }
}

/// Version of [`Entry`], its first byte.
const ENTRY_VERSION: u8 = 2;

/// Bytes of a [`StepRegion`] in version 1, from before cells were masked; they came last since.
const REGION_1: usize = 30;

/// Version 1 of [`Entry`], from before steps knew the wall clock.
#[derive(Deserialize)]
#[allow(clippy::large_enum_variant, reason = "it lives for a moment")]
enum Entry1 {
    Step {
        start: u32,
        step: u32,
        side: Side,
        start_us: u64,
        duration_us: u32,
        sample_us: u32,
        bridged_frames: u16,
        saturated: u8,
        clamped: u8,
        contact_rule: ContactRule,
        regions: [[u8; REGION_1]; 8],
    },
    Acknowledged {
        next: u32,
    },
}

fn region_of_1(bytes: [u8; REGION_1]) -> StepRegion {
    let mut with_none_masked = [0; REGION_1 + 1];
    with_none_masked[..REGION_1].copy_from_slice(&bytes);
    // Numbers of fixed length: any bytes are a region.
    decode(&with_none_masked).unwrap_or_default()
}

impl From<Entry1> for Entry {
    fn from(entry: Entry1) -> Self {
        match entry {
            Entry1::Step {
                start,
                step,
                side,
                start_us,
                duration_us,
                sample_us,
                bridged_frames,
                saturated,
                clamped,
                contact_rule,
                regions,
            } => Self::Step {
                start,
                step: Step {
                    step,
                    side,
                    start_us,
                    duration_us,
                    sample_us,
                    bridged_frames,
                    saturated,
                    clamped,
                    contact_rule,
                    regions: regions.map(region_of_1),
                    starts_ago: 0,
                    start_unix_us: None,
                },
            },
            Entry1::Acknowledged { next } => Self::Acknowledged { next },
        }
    }
}

impl Entry {
    fn read(bytes: &[u8]) -> Option<Self> {
        match bytes.split_first()? {
            (&ENTRY_VERSION, entry) => decode(entry),
            (1, entry) => decode::<Entry1>(entry).map(Self::from),
            _ => None,
        }
    }

    fn write<'b>(&self, buffer: &'b mut [u8; BUFFER]) -> &'b [u8] {
        buffer[0] = ENTRY_VERSION;
        // BUFFER has room for the longest, so the empty slice is never taken.
        let len = encode(self, &mut buffer[1..]).map_or(0, |entry| 1 + entry.len());
        &buffer[..len]
    }

    /// The number that follows.
    fn next(&self) -> u32 {
        match self {
            Self::Step { step, .. } => step.step.wrapping_add(1),
            Self::Acknowledged { next } => *next,
        }
    }
}

/// True where step `a` comes after step `b`; numbers wrap.
fn is_after(a: u32, b: u32) -> bool {
    a != b && a.wrapping_sub(b) < u32::MAX / 2
}

type LogCache = Cache<CalculatedPageStates, Uncached, Uncached>;

fn empty_cache() -> LogCache {
    Cache::new(CalculatedPageStates::new(((LOG.end - LOG.start) / SECTOR) as usize), Uncached, Uncached)
}

/// What is known of the chip's contents.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Contents {
    /// Number of the running start, from 1.
    pub start: u32,
    /// Number of the next step, as far as the log tells.
    pub next_step: u32,
    /// Bit k: records of kind k are of a newer version than this firmware knows. They are left alone.
    pub newer_kinds: u32,
    /// Entries of the log of a newer version. They are left alone until the log is full.
    pub newer_steps: u32,
    /// Areas that were damaged beyond repair and had to be erased.
    pub erased: u32,
}

/// The chip and what lies in it.
pub struct Store<F> {
    flash: Option<F>,
    log_cache: LogCache,
    buffer: [u8; BUFFER],
    contents: Contents,
}

impl<F: MultiwriteNorFlash> Store<F> {
    /// Looks through the chip and counts this start. Without a chip, or where it fails, nothing is known, and nothing will be kept.
    pub async fn open(flash: Option<F>, reset: Reset) -> Self {
        let mut store = Self { flash, log_cache: empty_cache(), buffer: [0; BUFFER], contents: Contents::default() };
        // A new chip is blank. One that was used for something else, or is damaged beyond repair, would keep nothing.
        let records = store.survey_records().await;
        let log = store.survey_log().await;
        let starts = store.get::<Starts>(0).await;
        let has_starts = matches!(starts, Ok(Some(_)));
        // A new chip whose first start was cut short has no more than the log's first mark.
        let is_ours = has_starts || store.contents.next_step != 0;
        // Where anything can be read, the rest may be a newer firmware's.
        let is_empty = |count| matches!(count, Ok(0) | Err(Failed::Contents));
        if is_empty(records) && matches!(starts, Ok(None) | Err(Failed::Contents)) {
            store.clear(RECORDS, is_ours).await;
        }
        if is_empty(log) {
            store.clear(LOG, is_ours).await;
            // From here on the log is never without an entry, so that numbers go on after a start.
            let _ = store.push(&Entry::Acknowledged { next: 0 }).await;
        }
        let mut starts = store.get::<Starts>(0).await.ok().flatten().unwrap_or_default();
        starts.count(reset);
        store.contents.start = starts.total();
        // A chip that fails here fails again where it matters, and is reported.
        let _ = store.put(0, &starts).await;
        store
    }

    /// What was found, and happened since.
    pub fn contents(&self) -> Contents {
        self.contents
    }

    /// The chip, for areas that are not the store's.
    pub fn flash(&mut self) -> Option<&mut F> {
        self.flash.as_mut()
    }

    /// Erases what is not blank. A chip that fails here fails again where it matters, and is reported.
    async fn clear(&mut self, range: Range<u32>, is_ours: bool) {
        let Some(flash) = &mut self.flash else { return };
        let mut bytes = [0; 128];
        for at in range.clone().step_by(bytes.len()) {
            if flash.read(at, &mut bytes).await.is_ok() && bytes.iter().any(|byte| *byte != 0xff) {
                self.contents.erased += u32::from(is_ours);
                self.log_cache = empty_cache();
                let _ = flash.erase(range.start, range.end).await;
                return;
            }
        }
    }

    /// The number of items, each version of a record for itself.
    async fn survey_records(&mut self) -> Result<u32, Failed> {
        let mut records = records(&mut self.flash)?;
        let mut items = records.fetch_all_items(&mut self.buffer).await?;
        let mut count = 0;
        while let Some(([kind, _, version], _)) = items.next::<&[u8]>(&mut self.buffer).await? {
            count += 1;
            let known = VERSIONS.iter().find(|(known, _)| *known == kind).map_or(0, |(_, version)| *version);
            if version > known {
                self.contents.newer_kinds |= 1 << (kind % 32);
            }
        }
        Ok(count)
    }

    /// The number of entries.
    async fn survey_log(&mut self) -> Result<u32, Failed> {
        let Self { flash, log_cache, buffer, contents } = self;
        with_log(flash, log_cache, async |log| {
            let mut entries = log.iter().await?;
            let mut count = 0;
            while let Some(entry) = entries.next(buffer).await? {
                count += 1;
                match Entry::read(&entry) {
                    Some(entry) => contents.next_step = entry.next(),
                    None => contents.newer_steps += 1,
                }
            }
            Ok(count)
        })
        .await
    }

    /// The record of a kind, or part of one; `None` where there is none that this firmware can read.
    pub async fn get<R: Record>(&mut self, part: u8) -> Result<Option<R>, Failed> {
        let mut records = records(&mut self.flash)?;
        for version in (1..=R::VERSION).rev() {
            let found = records.fetch_item::<&[u8]>(&mut self.buffer, &[R::KIND, part, version]).await?;
            if let Some(bytes) = found {
                return Ok(if version == R::VERSION { decode(bytes) } else { R::migrate(version, bytes) });
            }
        }
        Ok(None)
    }

    /// Keeps a record instead of the one before. A power failure leaves one of the two.
    pub async fn put<R: Record>(&mut self, part: u8, record: &R) -> Result<(), Failed> {
        // What is there already is not worth the wear.
        if self.get::<R>(part).await?.as_ref() == Some(record) {
            return Ok(());
        }
        let mut bytes = [0; BUFFER - size_of::<Key>()];
        let bytes: &[u8] = encode(record, &mut bytes).map_err(|_| Failed::Contents)?;
        for _ in 0..TRIES {
            let mut records = records(&mut self.flash)?;
            records.store_item(&mut self.buffer, &[R::KIND, part, R::VERSION], &bytes).await?;
            // A place with a bit that is stuck reads as nothing; the next one is another place.
            if self.get::<R>(part).await?.as_ref() == Some(record) {
                return self.forget_older::<R>(part).await;
            }
        }
        Err(Failed::Chip)
    }

    async fn forget_older<R: Record>(&mut self, part: u8) -> Result<(), Failed> {
        let mut records = records(&mut self.flash)?;
        for older in 1..R::VERSION {
            records.remove_item(&mut self.buffer, &[R::KIND, part, older]).await?;
        }
        Ok(())
    }

    /// Keeps a part of the next calibration, which is not in force before [`Store::put_calibration`].
    pub async fn put_part(&mut self, part: u8, cells: &Part) -> Result<(), Failed> {
        let place = self.free_place().await?;
        self.put(place | part, &Cells(*cells)).await
    }

    /// Puts the calibration in force whose parts were kept: its cells' checksum must be `id`. False where it is another.
    pub async fn put_calibration(&mut self, layout_id: u32, cells: u16, id: u32) -> Result<bool, Failed> {
        let calibration = Calibration { layout_id, cells, id, place: self.free_place().await? };
        let found = self.calibration_id(&calibration).await?;
        if found == Some(id) {
            self.put(0, &calibration).await?;
        }
        Ok(found == Some(id))
    }

    /// The calibration in force, if it is whole and one of this layout.
    pub async fn calibration(&mut self, layout_id: u32, cells: u16) -> Result<Option<Calibration>, Failed> {
        let Some(calibration) = self.get::<Calibration>(0).await? else { return Ok(None) };
        let fits = calibration.layout_id == layout_id && calibration.cells == cells;
        Ok((fits && self.calibration_id(&calibration).await? == Some(calibration.id)).then_some(calibration))
    }

    /// A part of a calibration.
    pub async fn part(&mut self, calibration: &Calibration, part: u8) -> Result<Option<Part>, Failed> {
        Ok(self.get::<Cells>(calibration.place | part).await?.map(|Cells(cells)| cells))
    }

    /// The place that the calibration in force does not use.
    async fn free_place(&mut self) -> Result<u8, Failed> {
        let in_force = self.get::<Calibration>(0).await?;
        Ok(in_force.map_or(0, |calibration| calibration.place ^ OTHER_PLACE))
    }

    async fn calibration_id(&mut self, calibration: &Calibration) -> Result<Option<u32>, Failed> {
        let mut id = CalibrationId::new();
        let mut left = usize::from(calibration.cells);
        for part in 0..left.div_ceil(PART_CELLS) as u8 {
            let Some(cells) = self.part(calibration, part).await? else { return Ok(None) };
            id.add(&cells[..left.min(PART_CELLS)]);
            left -= left.min(PART_CELLS);
        }
        Ok(Some(id.id()))
    }

    /// Adds a step to the log. Where there is no room the oldest make some: how many is returned.
    pub async fn push_step(&mut self, step: &Step) -> Result<u32, Failed> {
        let entry = Entry::Step { start: self.contents.start, step: *step };
        let dropped = self.push(&entry).await?;
        self.contents.next_step = entry.next();
        Ok(dropped)
    }

    async fn push(&mut self, entry: &Entry) -> Result<u32, Failed> {
        let mut bytes = [0; BUFFER];
        let bytes = entry.write(&mut bytes);
        let Self { flash, log_cache, buffer, .. } = self;
        with_log(flash, log_cache, async |log| {
            match log.push(bytes, false).await {
                Err(Error::FullStorage) => {}
                pushed => return pushed.map(|()| 0),
            }
            let before = oldest(log, buffer).await?;
            log.push(bytes, true).await?;
            let after = oldest(log, buffer).await?;
            Ok(before.zip(after).map_or(0, |(before, after)| after.wrapping_sub(before)))
        })
        .await
    }

    /// Forgets all steps up to and with this number.
    pub async fn acknowledge(&mut self, step: u32) -> Result<(), Failed> {
        let next = step.wrapping_add(1);
        // The log stays without an entry otherwise; a step that could not be kept is beyond its last.
        if !is_after(self.contents.next_step, next) {
            self.push(&Entry::Acknowledged { next }).await?;
            self.contents.next_step = next;
        }
        let Self { flash, log_cache, buffer, contents } = self;
        with_log(flash, log_cache, async |log| {
            let mut entries = log.iter().await?;
            while let Some(entry) = entries.next(buffer).await? {
                match Entry::read(&entry) {
                    Some(Entry::Step { step: kept, .. }) if is_after(kept.step, step) => break,
                    Some(Entry::Acknowledged { next }) if next == contents.next_step => break,
                    Some(_) => drop(entry.pop().await?),
                    None => {}
                }
            }
            Ok(())
        })
        .await
    }

    /// Gives the steps after number `after`, or all, oldest first, each with the number of starts since it was made, until
    /// `take` has enough and returns false; tells whether there are more.
    pub async fn steps(&mut self, after: Option<u32>, mut take: impl FnMut(Step) -> bool) -> Result<bool, Failed> {
        let Self { flash, log_cache, buffer, contents } = self;
        with_log(flash, log_cache, async |log| {
            let mut entries = log.iter().await?;
            while let Some(entry) = entries.next(buffer).await? {
                let Some(Entry::Step { start, step }) = Entry::read(&entry) else { continue };
                let is_new = after.is_none_or(|after| is_after(step.step, after));
                if is_new && !take(Step { starts_ago: contents.start.wrapping_sub(start), ..step }) {
                    return Ok(true);
                }
            }
            Ok(false)
        })
        .await
    }
}

type Records<'f, F> = MapStorage<Key, &'f mut F, Cache<Uncached, Uncached, Uncached, Key>>;

fn records<F: MultiwriteNorFlash>(flash: &mut Option<F>) -> Result<Records<'_, F>, Failed> {
    Ok(MapStorage::new(flash.as_mut().ok_or(Failed::Chip)?, MapConfig::new(RECORDS), Cache::new_uncached()))
}

/// Lets `work` use the log and keeps what is known of its pages.
async fn with_log<F: MultiwriteNorFlash, T>(
    flash: &mut Option<F>,
    cache: &mut LogCache,
    work: impl AsyncFnOnce(&mut QueueStorage<&mut F, LogCache>) -> Result<T, Error<F::Error>>,
) -> Result<T, Failed> {
    let flash = flash.as_mut().ok_or(Failed::Chip)?;
    let mut log = QueueStorage::new(flash, QueueConfig::new(LOG), core::mem::replace(cache, empty_cache()));
    let done = work(&mut log).await;
    if done.is_ok() {
        *cache = log.destroy().1;
    }
    Ok(done?)
}

/// Number of the oldest step in the log.
async fn oldest<F: MultiwriteNorFlash>(
    log: &mut QueueStorage<&mut F, LogCache>,
    buffer: &mut [u8],
) -> Result<Option<u32>, Error<F::Error>> {
    let mut entries = log.iter().await?;
    while let Some(entry) = entries.next(buffer).await? {
        if let Some(Entry::Step { step, .. }) = Entry::read(&entry) {
            return Ok(Some(step.step));
        }
    }
    Ok(None)
}

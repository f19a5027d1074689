//! The store: records and the step log in the flash chip.

use super::flash_map::{self, RECORDS};
use super::guard::{Guard, Guarded};
use super::log::Entry;
use super::records::{Bonds, BootCounters, CalibrationRecord, CellsRecord, Key, Record};
use super::{MAX_ITEM_BYTES, StorageError, migration};
use crate::protocol::{BLOCK_CELLS, CalibrationBlock, CalibrationId, Contents, LoadRecord, Reset, decode, encode};
use crate::sequence::is_after;
use embedded_storage_async::nor_flash::MultiwriteNorFlash;
use sectors::{Sectors, oldest};
use sequential_storage::Error;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};

mod erase;
mod sectors;
mod survey;
mod tissue;

/// Largest number of attempts to write a record. An attempt fails if the record cannot be read back.
const WRITE_ATTEMPTS: usize = 3;

/// Largest number of acknowledged records that are removed in one operation. They fill at most eight sectors, which are erased in
/// 0.4 s, and at worst in 3.2 s.
const REMOVED_AT_ONCE: u32 = 64;

/// The second of the two slots for a calibration; the first is 0. The part number of a block's record ([`Store::get`]) is the
/// slot combined with the block number, which is below this bit.
const OTHER_SLOT: u8 = 0x80;

/// What the store does with its chip.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Use {
    /// The store reads and writes everything.
    All,
    /// The store reads the bonds only.
    Bonds,
    /// The store reads and writes nothing.
    None,
}

/// The flash chip and its contents.
pub struct Store<F> {
    flash: Option<F>,
    guard: Guard,
    used_for: Use,
    log: Sectors,
    buffer: [u8; MAX_ITEM_BYTES],
    contents: Contents,
    /// The number in the last mark that [`Store::acknowledge`] has appended to the log in this boot.
    marked: Option<u32>,
    /// The reason of this boot, until it is counted.
    boot_due: Option<Reset>,
    /// The log has foreign contents that could not be erased completely, so nothing is stored in it before the next start, or
    /// before the wearer's data are erased.
    is_log_foreign: bool,
}

impl<F: MultiwriteNorFlash> Store<F> {
    /// A store that stores and returns nothing until [`Store::begin`]. The chip is accessible by [`Store::flash`].
    pub fn new(flash: Option<F>) -> Self {
        let log = flash_map::log(flash.as_ref().map_or(0, F::capacity));
        Self {
            flash,
            guard: Guard::default(),
            used_for: Use::None,
            log: Sectors::new(log),
            buffer: [0; MAX_ITEM_BYTES],
            contents: Contents::default(),
            marked: None,
            boot_due: None,
            is_log_foreign: false,
        }
    }

    /// Lets the store return the bonds without [`Store::begin`], for the recovery mode.
    pub fn use_bonds(&mut self) {
        self.used_for = Use::Bonds;
    }

    /// Stops using a chip that does not answer.
    pub fn give_up(&mut self) {
        (self.flash, self.used_for) = (None, Use::None);
    }

    /// True if the store reads and writes everything on a chip. It does not in recovery mode.
    pub fn is_in_full_use(&self) -> bool {
        self.used_for == Use::All && self.flash.is_some()
    }

    /// True if the log may contain load records although it cannot be read yet. The log of a chip that cannot be read at all, or
    /// with foreign contents, has none that could be sent later.
    pub fn may_have_records(&self) -> bool {
        self.is_in_full_use() && self.contents.start > 0 && !self.is_log_foreign
    }

    /// Fails while the store does not read and write everything, as in recovery mode.
    fn require_full_use(&self) -> Result<(), StorageError> {
        if self.used_for == Use::All { Ok(()) } else { Err(StorageError::Chip) }
    }

    /// The contents of the chip: determined by [`Store::begin`] and updated since.
    pub fn contents(&self) -> Contents {
        self.contents
    }

    /// The chip, for access to areas outside the store.
    pub fn flash(&mut self) -> Option<&mut F> {
        self.flash.as_mut()
    }

    /// True if the chip returns the count of boots that this boot has stored, and the log can be read.
    pub async fn is_sound(&mut self) -> bool {
        // If this fails, the chip returns another count.
        let _ = self.count_boot().await;
        let boots: Result<Option<BootCounters>, _> = self.get(0).await;
        boots.is_ok_and(|boots| boots.is_some_and(|boots| boots.total() == self.contents.start))
            && self.records(None, |_| false).await.is_ok()
    }

    /// Counts this boot, unless this was done before. An attempt at the start may have failed because of a low supply.
    async fn count_boot(&mut self) -> Result<(), StorageError> {
        if let Some(reset) = self.boot_due {
            let mut boots: BootCounters = self.get(0).await?.unwrap_or_default();
            boots.count(reset);
            self.contents.start = boots.total();
            self.put(0, &boots).await?;
            self.boot_due = None;
        }
        Ok(())
    }

    /// Reads part `part` of the record `R`; `None` if there is none that this firmware can read. Only the cells of a
    /// calibration and [`IdentifiedRecord`](super::IdentifiedRecord) have several parts; otherwise `part` is 0.
    ///
    /// # Errors
    /// See [`StorageError`].
    pub async fn get<R: Record>(&mut self, part: u8) -> Result<Option<R>, StorageError> {
        for version in (1..=R::VERSION).rev() {
            if let Some(bytes) = self.fetch([R::KIND, part, version]).await? {
                return Ok(if version == R::VERSION { decode(bytes) } else { migration::record(bytes) });
            }
        }
        Ok(None)
    }

    /// Replaces part `part` of the record `R`, as in [`Store::get`]. A loss of power leaves either the old or the new part.
    ///
    /// # Errors
    /// See [`StorageError`].
    pub async fn put<R: Record>(&mut self, part: u8, record: &R) -> Result<(), StorageError> {
        let mut bytes = [0; MAX_ITEM_BYTES - size_of::<Key>()];
        let bytes: &[u8] = encode(record, &mut bytes).map_err(|_| StorageError::Contents)?;
        self.store([R::KIND, part, R::VERSION], bytes).await
    }

    /// The encoded record with this key. This function and [`Store::store`] are not generic, so that they exist once in the
    /// firmware.
    async fn fetch(&mut self, key: Key) -> Result<Option<&[u8]>, StorageError> {
        if !(self.used_for == Use::All || self.used_for == Use::Bonds && key[0] == Bonds::KIND) {
            return Err(StorageError::Chip);
        }
        Ok(records(&mut self.flash, &mut self.guard)?.fetch_item::<&[u8]>(&mut self.buffer, &key).await?)
    }

    /// Replaces the encoded record with this key, and removes its older versions.
    async fn store(&mut self, key: Key, bytes: &[u8]) -> Result<(), StorageError> {
        self.require_full_use()?;
        // An unchanged record is not written, which saves wear.
        if self.fetch(key).await? == Some(bytes) {
            return Ok(());
        }
        for _ in 0..WRITE_ATTEMPTS {
            records(&mut self.flash, &mut self.guard)?.store_item(&mut self.buffer, &key, &bytes).await?;
            // A location with a stuck bit reads as no item; the next attempt uses another location.
            if self.fetch(key).await? == Some(bytes) {
                let [kind, part, version] = key;
                for older in 1..version {
                    self.remove([kind, part, older]).await?;
                }
                return Ok(());
            }
        }
        Err(StorageError::Chip)
    }

    /// Removes the record with this key, if there is one.
    async fn remove(&mut self, key: Key) -> Result<(), StorageError> {
        Ok(records(&mut self.flash, &mut self.guard)?.remove_item(&mut self.buffer, &key).await?)
    }

    /// Stores a block of the next calibration, which is not in force before [`Store::put_calibration`].
    ///
    /// # Errors
    /// See [`StorageError`].
    pub async fn put_calibration_block(&mut self, block: u8, cells: &CalibrationBlock) -> Result<(), StorageError> {
        let slot = self.free_slot().await?;
        self.put(slot | block, &CellsRecord(*cells)).await
    }

    /// Makes the stored blocks the calibration that is in force from the next start on. Returns false, and changes nothing, if
    /// the checksum of their cells is not `id`.
    ///
    /// # Errors
    /// See [`StorageError`].
    pub async fn put_calibration(&mut self, layout_id: u32, cells: u16, id: u32) -> Result<bool, StorageError> {
        let calibration = CalibrationRecord { layout_id, cells, id, slot: self.free_slot().await? };
        let is_complete = self.calibration_id(&calibration).await? == Some(id);
        if is_complete {
            self.put(0, &calibration).await?;
        }
        Ok(is_complete)
    }

    /// Reads the calibration in force; `None` if it is incomplete or belongs to another layout.
    ///
    /// # Errors
    /// See [`StorageError`].
    pub async fn calibration(&mut self, layout_id: u32, cells: u16) -> Result<Option<CalibrationRecord>, StorageError> {
        let Some(calibration) = self.get::<CalibrationRecord>(0).await? else { return Ok(None) };
        let fits = calibration.layout_id == layout_id && calibration.cells == cells;
        Ok((fits && self.calibration_id(&calibration).await? == Some(calibration.id)).then_some(calibration))
    }

    /// A block of a calibration; `None` if it is not stored.
    ///
    /// # Errors
    /// See [`StorageError`].
    pub async fn calibration_block(
        &mut self,
        calibration: &CalibrationRecord,
        block: u8,
    ) -> Result<Option<CalibrationBlock>, StorageError> {
        Ok(self.get::<CellsRecord>(calibration.slot | block).await?.map(|CellsRecord(cells)| cells))
    }

    /// The slot that the calibration in force does not use.
    async fn free_slot(&mut self) -> Result<u8, StorageError> {
        let in_force = self.get::<CalibrationRecord>(0).await?;
        Ok(in_force.map_or(0, |calibration| calibration.slot ^ OTHER_SLOT))
    }

    /// The checksum of the stored cells of a calibration; `None` if a block is missing.
    async fn calibration_id(&mut self, calibration: &CalibrationRecord) -> Result<Option<u32>, StorageError> {
        let mut id = CalibrationId::new();
        let mut remaining = usize::from(calibration.cells);
        for block in 0..remaining.div_ceil(BLOCK_CELLS) as u8 {
            let Some(cells) = self.calibration_block(calibration, block).await? else { return Ok(None) };
            id.add(&cells[..remaining.min(BLOCK_CELLS)]);
            remaining -= remaining.min(BLOCK_CELLS);
        }
        Ok(Some(id.id()))
    }

    /// Appends a load record to the log. A full log drops its oldest load records; returns the number of dropped ones.
    ///
    /// # Errors
    /// See [`StorageError`].
    pub async fn push_record(&mut self, record: impl Into<LoadRecord>) -> Result<u32, StorageError> {
        // The record refers to this boot.
        self.count_boot().await?;
        let mut bytes = [0; MAX_ITEM_BYTES];
        // The entry goes out of scope in this block, so that it takes no RAM while its bytes are written.
        let (len, next_record) = {
            let entry = Entry::of(self.contents.start, record.into());
            (entry.encode(&mut bytes).len(), entry.next_record())
        };
        let dropped = self.push(&bytes[..len]).await?;
        self.contents.next_record = next_record;
        Ok(dropped)
    }

    /// Appends an encoded entry to the log. A full log drops its oldest entries; returns the number of dropped load records.
    async fn push(&mut self, bytes: &[u8]) -> Result<u32, StorageError> {
        self.require_full_use()?;
        if self.is_log_foreign {
            return Err(StorageError::Contents);
        }
        let Self { flash, guard, log, buffer, .. } = self;
        log.with_queue(flash, guard, async |log| {
            match log.push(bytes, false).await {
                Err(Error::FullStorage) => {}
                pushed => return pushed.map(|()| 0),
            }
            let oldest_before = oldest(log, buffer).await?;
            log.push(bytes, true).await?;
            let oldest_after = oldest(log, buffer).await?;
            Ok(oldest_before.zip(oldest_after).map_or(0, |(before, after)| after.wrapping_sub(before)))
        })
        .await
    }

    /// Appends a mark to the log: all load records before number `next` are acknowledged.
    async fn push_mark(&mut self, next: u32) -> Result<(), StorageError> {
        self.push(Entry::Acknowledged { next }.encode(&mut [0; MAX_ITEM_BYTES])).await.map(drop)
    }

    /// Removes the load records up to and including this number, the oldest first, but at most 64 of them. True if some of
    /// them remain, and this function must be called again.
    ///
    /// # Errors
    /// See [`StorageError`].
    pub async fn acknowledge(&mut self, number: u32) -> Result<bool, StorageError> {
        self.require_full_use()?;
        let next = number.wrapping_add(1);
        // If all stored records are acknowledged, the log would become empty and lose the number of the next record; a mark
        // preserves it. An acknowledged record that could not be stored is later than all stored ones.
        let is_last = !is_after(self.contents.next_record, next);
        if is_last {
            self.contents.next_record = next;
        }
        // Entries of newer firmware have numbers that this firmware does not read. The mark remains while the records are removed
        // in parts.
        let mark = self.contents.next_record;
        if (is_last || self.contents.newer_records > 0) && self.marked != Some(mark) {
            self.push_mark(mark).await?;
            self.marked = Some(mark);
        }
        let Self { flash, guard, log, buffer, contents, .. } = self;
        log.with_queue(flash, guard, async |log| {
            let mut entries = log.iter().await?;
            let mut removed = 0;
            while let Some(entry) = entries.next(buffer).await? {
                match Entry::decode(&entry) {
                    Some(Entry::Acknowledged { next }) if next == contents.next_record => return Ok(false),
                    Some(stored) => {
                        if stored.record().is_some_and(|(_, record)| is_after(record.number(), number)) {
                            return Ok(false);
                        }
                        if removed == REMOVED_AT_ONCE {
                            return Ok(true);
                        }
                        let _ = entry.pop().await?;
                        removed += 1;
                    }
                    None => {}
                }
            }
            Ok(false)
        })
        .await
    }

    /// Passes the stored load records after number `after`, or all of them for `None`, to `take`, the oldest first, until
    /// `take` returns false. Each has the number of boots since it was recorded. True if `take` has returned false, so that
    /// this record and those after it remain to be taken.
    ///
    /// # Errors
    /// See [`StorageError`].
    pub async fn records(
        &mut self,
        after: Option<u32>,
        mut take: impl FnMut(LoadRecord) -> bool,
    ) -> Result<bool, StorageError> {
        self.require_full_use()?;
        if self.count_boot().await.is_err() && self.contents.start == 0 {
            // The number of boots since a record is unknown.
            return Err(StorageError::Chip);
        }
        let Self { flash, guard, log, buffer, contents, .. } = self;
        guard.postpones_erasure = true;
        let has_more = log
            .with_queue(flash, guard, async |log| {
                let mut entries = log.iter().await?;
                while let Some(entry) = entries.next(buffer).await? {
                    let Some((boot, record)) = Entry::decode(&entry).and_then(Entry::record) else { continue };
                    let is_new = after.is_none_or(|after| is_after(record.number(), after));
                    if is_new && !take(record.with_boots_since(contents.start.wrapping_sub(boot))) {
                        return Ok(true);
                    }
                }
                Ok(false)
            })
            .await;
        guard.postpones_erasure = false;
        if core::mem::take(&mut guard.has_postponed) {
            // The cached state of a sector that was not erased is wrong.
            log.forget();
        }
        has_more
    }
}

type Records<'f, F> = MapStorage<Key, Guarded<'f, F>, Cache<Uncached, Uncached, Uncached, Key>>;

/// Access to the records.
fn records<'f, F: MultiwriteNorFlash>(
    flash: &'f mut Option<F>,
    guard: &'f mut Guard,
) -> Result<Records<'f, F>, StorageError> {
    let flash = Guarded { flash: flash.as_mut().ok_or(StorageError::Chip)?, guard };
    Ok(MapStorage::new(flash, MapConfig::new(RECORDS), Cache::new_uncached()))
}

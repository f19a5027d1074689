//! Determines what the chip contains, and erases areas that cannot be used.

use super::erase::FILLER;
use super::sectors::Sectors;
use super::{Store, Use, records};
use crate::checksum::CRC;
use crate::protocol::{Contents, Reset};
use crate::sequence::is_after;
use crate::storage::StorageError;
use crate::storage::flash_map::{RECORDS, SECTOR};
use crate::storage::log::Entry;
use crate::storage::records::{BootCounters, NumberingRecord, Record, VERSIONS};
use core::ops::Range;
use embedded_storage_async::nor_flash::MultiwriteNorFlash;

/// Number of contradicting surveys at a start after which the chip is not used.
const CONTRADICTIONS_TO_GIVE_UP: u32 = 4;

/// The result of a survey.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Survey {
    /// Number of records, of all versions.
    records: Result<u32, StorageError>,
    /// Number of entries in the newest sectors of the log or, if the whole log was read, in all its sectors; see `survey_log`.
    log: Result<u32, StorageError>,
    boots: Result<Option<BootCounters>, StorageError>,
    contents: Contents,
    /// A part is damaged, and reading it would change the chip.
    needs_repair: bool,
}

impl Survey {
    // A new chip is blank. An area with foreign data, or damaged beyond repair, could not store anything unless it is erased. It
    // is not erased if anything in it can be read, because a newer firmware may have written the rest.

    /// True if the store must change the chip before it can use it: repair or erase a part, or begin to use a blank area.
    fn needs_change(&self) -> bool {
        self.needs_repair || self.has_no_records() || self.has_no_log()
    }

    fn has_no_records(&self) -> bool {
        is_empty_or_damaged(self.records) && matches!(self.boots, Ok(None) | Err(StorageError::Contents))
    }

    fn has_no_log(&self) -> bool {
        is_empty_or_damaged(self.log)
    }
}

/// Numbers of entries in the log.
#[derive(Clone, Copy, Default)]
struct Count {
    /// Number of entries in a format that this firmware knows.
    known: u32,
    /// Number of entries in a newer format.
    newer: u32,
}

/// A summary of the bytes of an area.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Area {
    checksum: u32,
    is_blank: bool,
    /// The area is not blank after its first [`MAX_ITEM_BYTES`](crate::storage::MAX_ITEM_BYTES) bytes, to which an interrupted
    /// first boot may have written an entry.
    has_data_after_first_entry: bool,
}

fn is_empty_or_damaged(count: Result<u32, StorageError>) -> bool {
    matches!(count, Ok(0) | Err(StorageError::Contents))
}

impl<F: MultiwriteNorFlash> Store<F> {
    /// A store of which [`Store::begin`] has determined the contents.
    pub async fn open(flash: Option<F>, reset: Reset) -> Self {
        let mut store = Self::new(flash);
        store.begin(reset).await;
        store
    }

    /// Determines the contents of the chip, erases areas that cannot be used, and counts this boot. Without a chip, or if it
    /// fails, the contents are unknown and nothing is stored.
    pub async fn begin(&mut self, reset: Reset) {
        self.used_for = Use::All;
        self.guard.is_read_only = true;
        // The first reads after power-on may be wrong, so two surveys in a row must agree. Before an area is written, repaired or
        // erased because it is empty or damaged, all of its bytes must agree, too; each reading takes half a second for a log of
        // 1 MiB, and some 7 s for that of a chip of 16 MiB.
        let mut survey = self.survey().await;
        let agreed = loop {
            let areas = self.areas(&survey).await;
            let repeated = self.survey().await;
            if repeated == survey && areas == self.areas(&survey).await {
                self.guard.is_read_only = false;
                let Some(areas) = areas else { break survey };
                // This survey repairs the areas, where possible.
                let repaired = if survey.needs_repair { self.survey().await } else { survey };
                if repaired.log == Err(StorageError::Chip) {
                    // With a low supply, the repair is refused.
                    self.contents.next_record = survey.contents.next_record;
                }
                self.clear(&repaired, areas).await;
                break repaired;
            }
            survey = repeated;
            self.contents.contradictions += 1;
            if self.contents.contradictions == CONTRADICTIONS_TO_GIVE_UP {
                self.used_for = Use::None;
                return;
            }
        };
        if agreed.log.is_ok_and(|entries| entries > 0)
            && let Ok(Some(NumberingRecord(next))) = self.get(0).await
        {
            if is_after(next, self.contents.next_record) {
                self.mark_next_record(next).await;
            } else {
                // The log has the number, so the record is not needed any more. Without it, a log that is damaged from now on
                // counts as damaged, and not as the log of an interrupted erasure. If the chip refuses to remove the record, the
                // next start repeats this.
                let _ = self.remove([NumberingRecord::KIND, 0, NumberingRecord::VERSION]).await;
            }
        }
        self.boot_due = Some(reset);
        // If this fails, it is repeated before a record is stored, and a failure is then reported.
        let _ = self.count_boot().await;
    }

    /// Erases the areas that have contents but cannot be used. A chip that fails here fails again at the next write, which is
    /// reported.
    async fn clear(&mut self, survey: &Survey, [records, log]: [Area; 2]) {
        // This firmware has used the chip before if it contains a count of boots, or if its log shows that records were numbered.
        let is_in_use = matches!(survey.boots, Ok(Some(_))) || self.contents.next_record != 0;
        if survey.has_no_records() {
            let is_lost = is_in_use || records.has_data_after_first_entry;
            let _ = self.clear_area(RECORDS, records, is_lost).await;
        }
        if survey.has_no_log() {
            let numbering: Option<NumberingRecord> = self.get(0).await.ok().flatten();
            // If this record exists, an erasure of the wearer's data was interrupted, or no start since then has found the number
            // of the record in the log. The log was to be erased, so none of its contents count as lost.
            let is_lost = numbering.is_none() && (is_in_use || log.has_data_after_first_entry);
            self.is_log_foreign = self.clear_area(self.log.range(), log, is_lost).await.is_err();
            // From here on the log always has an entry, so that numbering continues after a restart.
            self.mark_next_record(numbering.map_or(0, |NumberingRecord(next)| next)).await;
        }
    }

    /// Erases an area unless it is blank. With `is_lost`, data may be lost, and the erasure is counted in [`Contents::erased`].
    async fn clear_area(&mut self, range: Range<u32>, area: Area, is_lost: bool) -> Result<(), StorageError> {
        if area.is_blank {
            return Ok(());
        }
        self.contents.erased += u32::from(is_lost);
        self.erase_used(range, &|| {}).await
    }

    /// Sets the number of the next load record, and adds a mark with it to the log. A chip that fails here fails again at the
    /// next write, which is reported.
    async fn mark_next_record(&mut self, next: u32) {
        self.contents.next_record = next;
        let _ = self.push_mark(next).await;
    }

    /// The summaries of both areas (records and log), for which all their bytes are read; `None` if no area must be changed.
    async fn areas(&mut self, survey: &Survey) -> Option<[Area; 2]> {
        if !survey.needs_change() {
            return None;
        }
        Some([self.read_area(RECORDS).await, self.read_area(self.log.range()).await])
    }

    /// Erases the sectors of a range that are not blank. Blank sectors are only read, because reading takes less time than
    /// erasing. Calls `progressed` after each sector.
    ///
    /// # Errors
    /// If the chip fails.
    pub(super) async fn erase_used(&mut self, range: Range<u32>, progressed: &dyn Fn()) -> Result<(), StorageError> {
        self.log.forget();
        for sector in range.step_by(SECTOR as usize) {
            if !self.read_area(sector..sector + SECTOR).await.is_blank {
                let flash = self.flash.as_mut().ok_or(StorageError::Chip)?;
                flash.erase(sector, sector + SECTOR).await.map_err(|_| StorageError::Chip)?;
            }
            progressed();
        }
        Ok(())
    }

    /// Reads all bytes of an area. Bytes that cannot be read do not count as blank.
    async fn read_area(&mut self, range: Range<u32>) -> Area {
        let Self { flash, buffer, .. } = self;
        let mut area = Area { checksum: 0, is_blank: true, has_data_after_first_entry: false };
        let mut digest = CRC.digest();
        for address in range.clone().step_by(buffer.len()) {
            if let Some(flash) = flash {
                let is_read = flash.read(address, buffer).await.is_ok();
                digest.update(buffer);
                let is_blank = is_read && buffer.iter().all(|byte| *byte == 0xff);
                area.is_blank &= is_blank;
                area.has_data_after_first_entry |= !is_blank && address > range.start;
            }
        }
        area.checksum = digest.finalize();
        area
    }

    /// Determines the contents of the chip.
    async fn survey(&mut self) -> Survey {
        self.contents = Contents { contradictions: self.contents.contradictions, ..Contents::default() };
        self.log.forget();
        self.guard.has_refused = false;
        let (records, log) = (self.survey_records().await, self.survey_log().await);
        let boots = self.get(0).await;
        let contents = Contents { contradictions: 0, ..self.contents };
        Survey { records, log, boots, contents, needs_repair: self.guard.has_refused }
    }

    /// Counts the stored items, and notes kinds with a newer version. Each version of a record is an item.
    async fn survey_records(&mut self) -> Result<u32, StorageError> {
        let mut records = records(&mut self.flash, &mut self.guard)?;
        let mut items = records.fetch_all_items(&mut self.buffer).await?;
        let mut count = 0;
        while let Some(([kind, _, version], _)) = items.next::<&[u8]>(&mut self.buffer).await? {
            count += 1;
            let known = VERSIONS.iter().find(|(known, _)| *known == kind).map_or(0, |(_, version)| *version);
            // An interrupted erasure leaves fillers.
            if version > known && kind != FILLER[0] {
                self.contents.newer_kinds |= 1 << (kind % 32);
            }
        }
        Ok(count)
    }

    /// Counts the entries in the newest sectors of the log, and determines the number of the next load record. The oldest entry
    /// of the log is read, too: if its format is newer, at least one newer entry is counted. Reads the whole log for a repair, if
    /// the marks do not show the newest sectors, or if these have no entry in a format that this firmware knows.
    async fn survey_log(&mut self) -> Result<u32, StorageError> {
        // While `sequential-storage` reads the log, it erases sectors of which all entries were deleted. A read-only survey
        // postpones these erasures. A survey that repairs reads the whole log: if it read only a part, `sequential-storage` could
        // erase such a sector although the log begins before it.
        self.guard.postpones_erasure = self.guard.is_read_only;
        let first_number = self.contents.next_record;
        let newest = if self.guard.is_read_only { self.log.newest(&mut self.flash).await } else { None };
        let mut count = match newest {
            Some(newest) => self.count_entries(newest, u32::MAX).await,
            None => Ok(Count::default()),
        };
        if let Ok(newest) = count {
            let next_record = self.contents.next_record;
            if newest.known == 0 {
                self.contents.next_record = first_number;
            }
            // The number follows from entries in a known format. If the newest sectors have none, all entries are read; otherwise
            // only the oldest one is read, to notice that its format is newer.
            count = self.count_entries(self.log.range(), if newest.known == 0 { u32::MAX } else { 1 }).await;
            if let Ok(oldest) = &mut count
                && newest.known > 0
            {
                self.contents.next_record = next_record;
                *oldest = Count { known: newest.known, newer: newest.newer.max(oldest.newer) };
            }
        }
        self.guard.postpones_erasure = false;
        if core::mem::take(&mut self.guard.has_postponed) {
            self.log.forget();
            // If reading has failed nevertheless, the sector to be erased was a damaged one, not one of deleted entries.
            self.guard.has_refused |= count.is_err();
        }
        self.contents.newer_records = count.map_or(0, |count| count.newer);
        count.map(|count| count.known + count.newer)
    }

    /// Counts the first `at_most` entries in these sectors of the log, and sets the number of the next load record to that after
    /// the last of these entries.
    async fn count_entries(&mut self, sectors: Range<u32>, at_most: u32) -> Result<Count, StorageError> {
        let Self { flash, guard, buffer, contents, .. } = self;
        Sectors::new(sectors)
            .with_queue(flash, guard, async |log| {
                let mut entries = log.iter().await?;
                let mut count = Count::default();
                while count.known + count.newer < at_most
                    && let Some(entry) = entries.next(buffer).await?
                {
                    match Entry::decode(&entry) {
                        Some(entry) => {
                            count.known += 1;
                            contents.next_record = entry.next_record();
                        }
                        // An entry in a newer format is taken for a load record, which has a number.
                        None => {
                            count.newer += 1;
                            contents.next_record = contents.next_record.wrapping_add(1);
                        }
                    }
                }
                Ok(count)
            })
            .await
    }
}

//! Determines what the chip contains, and erases areas that cannot be used.

use super::erase::FILLER;
use super::{Store, Use, empty_cache, records, with_log};
use crate::checksum::CRC;
use crate::protocol::{Contents, Reset};
use crate::storage::flash_map::{LOG, RECORDS};
use crate::storage::log::Entry;
use crate::storage::records::{BootCounters, VERSIONS};
use crate::storage::{BUFFER, StorageError};
use core::ops::Range;
use embedded_storage_async::nor_flash::MultiwriteNorFlash;

/// Number of contradicting surveys at a start after which the chip is not used.
const CONTRADICTIONS_TO_GIVE_UP: u32 = 4;

/// The result of a survey.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Survey {
    /// Number of records, of all versions.
    records: Result<u32, StorageError>,
    /// Number of entries of the log.
    log: Result<u32, StorageError>,
    boots: Result<Option<BootCounters>, StorageError>,
    contents: Contents,
    /// A part is damaged, and reading it would change the chip.
    needs_repair: bool,
}

impl Survey {
    // A new chip is blank. An area with foreign data, or damaged beyond repair, could not store anything unless it is erased. It
    // is not erased if anything in it can be read, because a newer firmware may have written the rest.

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

/// A summary of the bytes of an area.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Area {
    checksum: u32,
    is_blank: bool,
    /// Not blank after the first entry, which an interrupted first boot may have written.
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
        // erased because it is empty or damaged, all of its bytes must agree, too; reading them takes half a second on a real
        // chip.
        let mut survey = self.survey().await;
        let agreed = loop {
            let areas = self.areas(&survey).await;
            let again = self.survey().await;
            if again == survey && areas == self.areas(&survey).await {
                self.guard.is_read_only = false;
                let Some(areas) = areas else { break survey };
                // This survey repairs the areas, where possible.
                let repaired = if survey.needs_repair { self.survey().await } else { survey };
                self.clear(&repaired, areas).await;
                break repaired;
            }
            survey = again;
            self.contents.contradictions += 1;
            if self.contents.contradictions == CONTRADICTIONS_TO_GIVE_UP {
                self.used_for = Use::None;
                return;
            }
        };
        let mut boots = agreed.boots.ok().flatten().unwrap_or_default();
        boots.count(reset);
        self.contents.start = boots.total();
        self.boots_due = Some(boots);
        // If this fails, it is repeated before a record is stored, and a failure is then reported.
        let _ = self.count_boot().await;
    }

    /// Erases the areas that have contents but cannot be used. A chip that fails here fails again at the next write, which is
    /// reported.
    async fn clear(&mut self, survey: &Survey, [records, log]: [Area; 2]) {
        // This firmware has used the chip before if boots are counted in the chip, or its log has the number of a
        // record.
        let is_in_use = matches!(survey.boots, Ok(Some(_))) || self.contents.next_record != 0;
        if survey.has_no_records() {
            self.clear_area(RECORDS, records, is_in_use).await;
        }
        if survey.has_no_log() {
            self.clear_area(LOG, log, is_in_use).await;
            // From here on the log always has an entry, so that numbering continues after a restart.
            let _ = self.push(Entry::Acknowledged { next: 0 }.encode(&mut [0; BUFFER])).await;
        }
    }

    /// Erases an area unless it is blank. It is counted in [`Contents::erased`] if anything may be lost.
    async fn clear_area(&mut self, range: Range<u32>, area: Area, is_in_use: bool) {
        if let Some(flash) = self.flash.as_mut().filter(|_| !area.is_blank) {
            self.contents.erased += u32::from(is_in_use || area.has_data_after_first_entry);
            self.log_cache = empty_cache();
            let _ = flash.erase(range.start, range.end).await;
        }
    }

    /// Reads all bytes of both areas if one of them must be changed.
    async fn areas(&mut self, survey: &Survey) -> Option<[Area; 2]> {
        if !survey.needs_change() {
            return None;
        }
        Some([self.read_area(RECORDS).await, self.read_area(LOG).await])
    }

    /// Reads all bytes of an area.
    async fn read_area(&mut self, range: Range<u32>) -> Area {
        let Self { flash, buffer, .. } = self;
        let mut area = Area { checksum: 0, is_blank: true, has_data_after_first_entry: false };
        let mut digest = CRC.digest();
        for at in range.clone().step_by(buffer.len()) {
            if let Some(flash) = flash
                && flash.read(at, buffer).await.is_ok()
            {
                digest.update(buffer);
                let is_blank = buffer.iter().all(|byte| *byte == 0xff);
                area.is_blank &= is_blank;
                area.has_data_after_first_entry |= !is_blank && at > range.start;
            }
        }
        area.checksum = digest.finalize();
        area
    }

    /// Determines the contents of the chip.
    async fn survey(&mut self) -> Survey {
        self.contents = Contents { contradictions: self.contents.contradictions, ..Contents::default() };
        self.log_cache = empty_cache();
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

    /// Counts the log entries, and determines the number of the next load record.
    async fn survey_log(&mut self) -> Result<u32, StorageError> {
        let Self { flash, guard, log_cache, buffer, contents, .. } = self;
        with_log(flash, guard, log_cache, async |log| {
            let mut entries = log.iter().await?;
            let mut count = 0;
            while let Some(entry) = entries.next(buffer).await? {
                count += 1;
                match Entry::decode(&entry) {
                    Some(entry) => contents.next_record = entry.next_record(),
                    None => contents.newer_records += 1,
                }
            }
            Ok(count)
        })
        .await
    }
}

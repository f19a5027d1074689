//! Erases what the chip contains about the wearer.

use super::{Store, records};
use crate::pipeline::alert::{AlertRules, DailyLoad};
use crate::pipeline::tissue::Tissue;
use crate::storage::StorageError;
use crate::storage::flash_map::{RECORDS, SECTOR, SMALL_LOG};
use crate::storage::records::{Bonds, IdentifiedRecord, Key, NumberingRecord, Record};
use embedded_storage_async::nor_flash::MultiwriteNorFlash;

/// The kinds of records about the wearer.
const OF_WEARER: [u8; 5] = [Tissue::KIND, IdentifiedRecord::KIND, Bonds::KIND, AlertRules::KIND, DailyLoad::KIND];

/// Key of a filler, a record without meaning. Writing it repeatedly makes `sequential-storage` reuse all sectors of the
/// records.
pub(super) const FILLER: Key = [0xff, 0, 1];
/// Length of a filler, bytes.
const FILLER_BYTES: usize = 400;
/// Number of fillers that occupy more than all sectors.
const FILLERS: u32 = (RECORDS.end - RECORDS.start + 2 * SECTOR) / FILLER_BYTES as u32;

impl<F: MultiwriteNorFlash> Store<F> {
    /// Erases all records about the wearer, in all versions of their formats, and the log, so that no earlier value remains in
    /// the chip either. Calls `progressed` after each removed record, each filler and each sector of the log. If power is lost
    /// meanwhile, a part may remain. The numbers of load records (steps, load bouts and alerts) continue: a record with the next
    /// number is stored first, and remains until a start finds this number in the log. While this record exists, a log that
    /// cannot be read does not count as damaged.
    ///
    /// # Errors
    /// See [`StorageError`].
    pub async fn erase_wearer(&mut self, progressed: impl Fn()) -> Result<(), StorageError> {
        self.require_full_use()?;
        self.put(0, &NumberingRecord(self.contents.next_record)).await?;
        while let Some(key) = self.key_of_wearer().await? {
            self.remove(key).await?;
            progressed();
        }
        // A removed record can be read until its sector is reused.
        let mut filler = [0; FILLER_BYTES];
        for _ in 0..FILLERS {
            records(&mut self.flash, &mut self.guard)?.store_item(&mut self.buffer, &FILLER, &&filler[..]).await?;
            filler[0] ^= 1;
            progressed();
        }
        self.remove(FILLER).await?;
        if self.log.range() != SMALL_LOG {
            // The released version 0.2.0 has its log in this range, in a chip of any size.
            self.erase_used(SMALL_LOG, &progressed).await?;
        }
        // The oldest sectors are erased first, so that the rest is a valid log if power fails.
        let log = self.log.range();
        let newest = self.log.newest(&mut self.flash).await;
        let oldest_at = newest.map_or(log.end, |newest| newest.end);
        self.erase_used(oldest_at..log.end, &progressed).await?;
        self.erase_used(log.start..oldest_at, &progressed).await?;
        // A foreign log that the start could not erase is erased now.
        self.is_log_foreign = false;
        self.push_mark(self.contents.next_record).await
    }

    /// The key of a stored record about the wearer.
    async fn key_of_wearer(&mut self) -> Result<Option<Key>, StorageError> {
        let mut records = records(&mut self.flash, &mut self.guard)?;
        let mut items = records.fetch_all_items(&mut self.buffer).await?;
        while let Some((key, _)) = items.next::<&[u8]>(&mut self.buffer).await? {
            if OF_WEARER.contains(&key[0]) {
                return Ok(Some(key));
            }
        }
        Ok(None)
    }
}

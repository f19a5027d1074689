//! Access to the log by its sectors.

use crate::storage::StorageError;
use crate::storage::flash_map::SECTOR;
use crate::storage::guard::{Guard, Guarded};
use crate::storage::log::Entry;
use core::ops::Range;
use embedded_storage_async::nor_flash::{MultiwriteNorFlash, NorFlashErrorKind};
use sequential_storage::Error;
use sequential_storage::cache::page_states::CalculatedPageStates;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::queue::{QueueConfig, QueueStorage};

type StateCache = Cache<CalculatedPageStates, Uncached, Uncached>;

/// The log, or a part of it, as a queue.
pub(super) type Queue<'f, F> = QueueStorage<Guarded<'f, F>, StateCache>;

/// Smallest number of zero bits with which `sequential-storage` accepts a byte as a mark.
const MARK_BITS: u32 = 4;

/// Sectors of the log, and the cache of their states.
pub(super) struct Sectors {
    range: Range<u32>,
    states: StateCache,
}

impl Sectors {
    pub(super) fn new(range: Range<u32>) -> Self {
        let sectors = range.len() / SECTOR as usize;
        Self { range, states: Cache::new(CalculatedPageStates::new(sectors), Uncached, Uncached) }
    }

    /// The addresses of the sectors in the chip.
    pub(super) fn range(&self) -> Range<u32> {
        self.range.clone()
    }

    /// Discards the cached states, after a change of the chip that they do not include.
    pub(super) fn forget(&mut self) {
        *self = Self::new(self.range());
    }

    /// Gives `work` access to the queue in these sectors, and preserves the states unless `work` fails.
    pub(super) async fn with_queue<F: MultiwriteNorFlash, T>(
        &mut self,
        flash: &mut Option<F>,
        guard: &mut Guard,
        work: impl AsyncFnOnce(&mut Queue<'_, F>) -> Result<T, Error<NorFlashErrorKind>>,
    ) -> Result<T, StorageError> {
        let flash = Guarded { flash: flash.as_mut().ok_or(StorageError::Chip)?, guard };
        let config = QueueConfig::try_new(self.range()).map_err(|_| StorageError::Chip)?;
        let Self { states, .. } = core::mem::replace(self, Self::new(self.range()));
        let mut queue = QueueStorage::new(flash, config, states);
        let result = work(&mut queue).await;
        if result.is_ok() {
            self.states = queue.destroy().1;
        }
        Ok(result?)
    }

    /// The addresses of the sector that is being filled and of the one before it, which contain the newest entry. `None` if the
    /// marks of the sectors do not show the sector that is being filled, or cannot be read. The sector before it is omitted if it
    /// is at the other end of the log, or is marked as full but not as begun, as after an interrupted erasure.
    pub(super) async fn newest<F: MultiwriteNorFlash>(&self, flash: &mut Option<F>) -> Option<Range<u32>> {
        const { assert!(F::READ_SIZE == 1, "a mark has the size of a read operation") };
        let flash = flash.as_mut()?;
        let (mut is_previous_full, mut is_previous_whole) = (false, false);
        for sector in self.range().step_by(SECTOR as usize) {
            // `sequential-storage` programs the first byte of a sector before its first entry, and the last byte once the sector
            // is full.
            let mut marks = [[0xff]; 2];
            flash.read(sector, &mut marks[0]).await.ok()?;
            flash.read(sector + SECTOR - 1, &mut marks[1]).await.ok()?;
            let [is_begun, is_full] = marks.map(|[mark]: [u8; 1]| mark.count_zeros() >= MARK_BITS);
            if !is_full && (is_begun || is_previous_full) {
                let begin = if is_previous_whole { sector - SECTOR } else { sector };
                return Some(begin..sector + SECTOR);
            }
            (is_previous_full, is_previous_whole) = (is_full, is_full && is_begun);
        }
        None
    }
}

/// The sequence number of the oldest load record (a step, a load bout or an alert) in the log; `None` if there is none.
pub(super) async fn oldest<F: MultiwriteNorFlash>(
    log: &mut Queue<'_, F>,
    buffer: &mut [u8],
) -> Result<Option<u32>, Error<NorFlashErrorKind>> {
    let mut entries = log.iter().await?;
    while let Some(entry) = entries.next(buffer).await? {
        if let Some((_, record)) = Entry::decode(&entry).and_then(Entry::record) {
            return Ok(Some(record.number()));
        }
    }
    Ok(None)
}

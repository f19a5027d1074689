//! Stores load records and acknowledgements, and loads records from the log into the session.

use super::Persist;
use crate::protocol::LoadRecord;
use crate::storage::Store;
use embassy_time::Instant;
use embedded_storage_async::nor_flash::MultiwriteNorFlash;

impl Persist<'_> {
    /// Stores the queued records.
    pub(super) async fn store_records(&mut self, store: &mut Store<impl MultiwriteNorFlash>) {
        while let Ok(record) = self.shared.records.try_receive() {
            let must_hold = self.store_record(store, &record).await;
            if must_hold {
                self.shared.session.borrow_mut().push_record(record);
            }
        }
        self.shared.frames_before.set(None);
    }

    /// Stores a record. Returns true if the session must also hold it in RAM, because no record between those in RAM and this one
    /// is in the log only, or because it could not be stored; false if it will be loaded from the log later, or is lost.
    async fn store_record(&mut self, store: &mut Store<impl MultiwriteNorFlash>, record: &LoadRecord) -> bool {
        if matches!(record, LoadRecord::Alert(_)) {
            // The load of the day contains the state of the alerts. It is stored at once, so that this alert is not raised again
            // after a loss of power.
            self.daily_load_at = Instant::now();
        }
        match store.push_record(record).await {
            Ok(dropped) => {
                let mut session = self.shared.session.borrow_mut();
                session.count_dropped(dropped);
                self.has_more_in_log |= !session.has_room();
                !self.has_more_in_log
            }
            Err(_) => {
                self.shared.count_not_stored();
                let may_be_in_log = self.was_log_read || store.may_have_records();
                let mut session = self.shared.session.borrow_mut();
                // Only records after the newest one in RAM are loaded from the log. With this record in RAM, earlier records that
                // are only in the log would not be sent, and the acknowledgement of this record would delete them; a full RAM
                // would drop its oldest record. Therefore this record is dropped. A log that cannot be read yet may also contain
                // earlier records.
                let is_lost = may_be_in_log && (self.has_more_in_log || !session.has_room());
                session.count_dropped(is_lost.into());
                !is_lost
            }
        }
    }

    /// Stores the newest acknowledgement of a host. Each call deletes a part of the acknowledged records, so that between two
    /// parts this task stores new records and reports its heartbeat.
    pub(super) async fn store_acknowledgement(&mut self, store: &mut Store<impl MultiwriteNorFlash>) {
        let acknowledged = self.shared.session.borrow_mut().take_acknowledged();
        if acknowledged.is_some() {
            (self.acknowledged, self.is_deleting) = (acknowledged, true);
        }
        if let Some(number) = self.acknowledged.filter(|_| self.is_deleting) {
            match store.acknowledge(number).await {
                Ok(some_remain) => self.is_deleting = some_remain,
                Err(_) => {
                    self.is_deleting = false;
                    self.shared.count_not_stored();
                }
            }
            if self.is_deleting {
                self.shared.to_persist.signal(());
            }
        }
    }

    /// Loads records from the log, as many as the session can hold in RAM: those after the newest one in RAM or, if there is
    /// none, after the last one that a host has acknowledged.
    pub(super) async fn refill_from_log(&mut self, store: &mut Store<impl MultiwriteNorFlash>) {
        let newest = {
            let session = self.shared.session.borrow();
            session.newest_record().or(session.acknowledged()).or(self.acknowledged)
        };
        let push = |record| {
            let mut session = self.shared.session.borrow_mut();
            let has_room = session.has_room();
            if has_room {
                session.push_record(record);
            }
            has_room
        };
        let has_more = store.records(newest, push).await;
        self.was_log_read |= has_more.is_ok();
        // A failed read is repeated with the next event.
        self.has_more_in_log = has_more.unwrap_or(true);
    }
}

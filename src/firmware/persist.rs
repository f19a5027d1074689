//! Persists steps, load bouts, alerts, acknowledgements, parameters and bonds, and executes the commands of a host.

#[cfg(feature = "management")]
mod manage;
mod records;

use super::shared::Shared;
use super::supervise::Part;
use super::trial::{self, Trial, Verdict};
use crate::log;
use crate::protocol::session::{Command, CommandResult};
use crate::protocol::update::{Header, Progress, Refusal as UpdateRefusal, Request};
use crate::protocol::{Identity, Refusal};
use crate::storage::previous;
use crate::storage::update::{self, Update};
use crate::storage::{Bonds, IdentityRecord, RadioRecord, SettingsRecord, StorageError, Store};
use core::future::poll_fn;
use core::pin::{Pin, pin};
use core::task::{Context, Poll};
use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer};
use embedded_storage_async::nor_flash::MultiwriteNorFlash;
use mcumgr::Sha256;

/// Time from the execution of a request that is answered and then restarts the insole, such as an accepted update, to the
/// restart. The answer is sent in this time.
const RESTART_DELAY: Duration = Duration::from_millis(500);

/// Time between two attempts to store the load of the day: a loss of power loses at most this part of it.
const DAILY_LOAD_PERIOD: Duration = Duration::from_secs(300);

/// Longest time between two heartbeats of this task.
const IDLE: Duration = Duration::from_secs(10);

/// Time after the start at which the image counts as proven, so that the bootloader does not swap the previous image back any
/// more.
const PROVEN: Duration = Duration::from_secs(3600);

/// The state of [`persist()`].
#[cfg_attr(not(feature = "management"), allow(dead_code, reason = "management tools use some fields"))]
struct Persist<'a> {
    shared: &'a Shared,
    /// The log may contain load records after the newest one in RAM.
    has_more_in_log: bool,
    /// The log was read at least once since the start.
    was_log_read: bool,
    /// Number of the last record that a host has acknowledged since the start. The log still contains this record if it could
    /// not be deleted.
    acknowledged: Option<u32>,
    /// Some of the acknowledged records are still to be deleted.
    is_deleting: bool,
    update: Update,
    /// Time of the restart after a request or an accepted update; [`Instant::MAX`] if none is due.
    restart_at: Instant,
    /// Time at which the load of the day is stored next.
    daily_load_at: Instant,
    /// The trial of the running image; `None` if no trial is in progress.
    trial: Option<Trial>,
    /// A record on the chip states that the radio has answered on this board, or storing this record has failed in this run.
    is_radio_known: bool,
    /// The bootloader may swap the previous image back.
    has_previous: bool,
    /// The last attempt to store the bonds failed.
    bonds_failed: bool,
    image: &'a Header,
    content: &'a [u8],
    /// Digest of the running image, computed when a management tool first asks for it.
    sha256: Option<Sha256>,
}

/// Persists steps, load bouts, alerts, acknowledgements, settings, parameters and bonds. Never returns. An item that the chip
/// fails to store is counted; parameters, alert rules and bonds are nevertheless in force until the next start. Receives
/// firmware updates, and confirms the running image after its trial; `image` is its header, `content` the image itself.
/// `restart` resets the controller.
pub async fn persist(
    store: &mut Store<impl MultiwriteNorFlash>,
    shared: &Shared,
    image: &Header,
    content: &[u8],
    restart: fn() -> !,
) -> ! {
    // Without a chip no image can have been swapped.
    let is_on_trial = match store.flash() {
        Some(flash) => trial::is_on_trial(flash).await,
        None => false,
    };
    // Part 0 is the whole record ([`Store::get`]).
    let radio: Option<RadioRecord> = store.get(0).await.ok().flatten();
    let is_radio_known = radio.is_some_and(|radio| radio.has_answered);
    let mut state = Persist {
        shared,
        has_more_in_log: true,
        was_log_read: false,
        acknowledged: None,
        is_deleting: false,
        update: Update::new(),
        restart_at: Instant::MAX,
        daily_load_at: Instant::now() + DAILY_LOAD_PERIOD,
        trial: is_on_trial.then(|| Trial::new(&shared.scan.heartbeats, is_radio_known)),
        is_radio_known,
        // In recovery mode, the running image has not proved itself, however long it runs.
        has_previous: store.is_in_full_use(),
        bonds_failed: false,
        image,
        content,
        sha256: None,
    };
    if is_on_trial {
        log::info!("update: this image is on trial");
    }
    loop {
        shared.scan.heartbeats.progressed(Part::Storage);
        state.store_records(store).await;
        state.store_acknowledgement(store).await;
        if state.has_more_in_log && shared.session.borrow().has_room() {
            state.refill_from_log(store).await;
        }
        state.store_bonds(store).await;
        state.note_radio(store).await;
        state.execute_command(store, restart).await;
        // Not `if IS_MANAGED`: the code of an asynchronous function remains in the firmware, even if it is never called.
        #[cfg(feature = "management")]
        state.execute_request(store).await;
        if Instant::now() >= state.daily_load_at {
            state.store_daily_load(store).await;
        }
        shared.contents.set(store.contents());
        shared.signal_changed();
        if state.has_previous && state.trial.is_none() && Instant::now() >= Instant::MIN + PROVEN {
            state.forget_previous(store).await;
        }
        let next_check = state.trial.as_ref().map_or(Instant::MAX, Trial::next_check);
        let wake_at = state.restart_at.min(next_check).min(state.daily_load_at).min(Instant::now() + IDLE);
        select(shared.to_persist.wait(), Timer::at(wake_at)).await;
        if Instant::now() >= state.restart_at {
            state.store_all(store).await;
            restart();
        }
        if state.check_trial(store).await == Verdict::Failed {
            log::error!("update: the image has failed its trial, restarting to swap it back");
            state.store_all(store).await;
            restart();
        }
    }
}

impl Persist<'_> {
    /// Stores what a restart would lose. The records are stored after the load of the day, because one may be queued while that
    /// is being stored. If it is an alert, the load of the day has changed with it, and is stored again.
    async fn store_all(&mut self, store: &mut Store<impl MultiwriteNorFlash>) {
        self.store_daily_load(store).await;
        self.store_records(store).await;
        if Instant::now() >= self.daily_load_at {
            self.store_daily_load(store).await;
        }
    }

    /// Stores the bonds if they have changed. A failure is counted once, and the bonds are stored as soon as the chip accepts
    /// them.
    async fn store_bonds(&mut self, store: &mut Store<impl MultiwriteNorFlash>) {
        if !self.shared.bonds_changed.take() {
            return;
        }
        // Bonds that could not be read at the start must not be overwritten by those of this run.
        let has_failed = self.shared.are_bonds_unread.get() || store.put(0, &Bonds(self.shared.bonds())).await.is_err();
        if has_failed {
            self.shared.bonds_changed.set(true);
            if !self.bonds_failed {
                self.shared.count_not_stored();
            }
        }
        self.bonds_failed = has_failed;
    }

    /// Stores the load of the day, if the day is known.
    async fn store_daily_load(&mut self, store: &mut Store<impl MultiwriteNorFlash>) {
        self.daily_load_at = Instant::now() + DAILY_LOAD_PERIOD;
        let daily = *self.shared.session.borrow().daily_load();
        if daily.day > 0 && store.put(0, &daily).await.is_err() {
            self.shared.count_not_stored();
        }
    }

    /// Executes the pending command of a host, if there is one, and completes it.
    async fn execute_command(&mut self, store: &mut Store<impl MultiwriteNorFlash>, restart: fn() -> !) {
        let Some(command) = self.shared.session.borrow().command() else { return };
        let Some(result) = self.execute(store, &command).await.transpose() else { return };
        if result == Ok(CommandResult::Update(Progress::Accepted)) {
            log::info!("update: the image is accepted, restarting");
            self.restart_at = Instant::now() + RESTART_DELAY;
        }
        if result == Err(Refusal::NotStored) {
            self.shared.count_not_stored();
        }
        self.shared.session.borrow_mut().complete(result);
        if command == Command::EraseWearer && result.is_ok() {
            // Between the erasure and the restart the answer is sent, and nothing must be stored.
            self.shared.signal_changed();
            Timer::after(RESTART_DELAY).await;
            restart();
        }
    }

    /// Executes a command. Returns `None` if a restart follows instead of an answer. The command is borrowed, because a copy
    /// would take static memory of this task.
    async fn execute(
        &mut self,
        store: &mut Store<impl MultiwriteNorFlash>,
        command: &Command,
    ) -> Result<Option<CommandResult>, Refusal> {
        let identity = self.shared.session.borrow().identity();
        let hello = &self.shared.hello;
        Ok(Some(match command {
            Command::Tissue(tissue, identified) => {
                store.put_tissue(tissue, *identified).await?;
                log::info!("settings: parameters {:x} are stored", tissue.id);
                CommandResult::Stored
            }
            Command::SetIdentity(side, serial) => {
                store.put(0, &IdentityRecord { side: *side, serial: *serial }).await?;
                log::info!("settings: side and serial number are stored");
                CommandResult::Identity(Identity { side: *side, serial: *serial, ..identity })
            }
            Command::CalibrationBlock(block, cells) => {
                store.put_calibration_block(*block, cells).await?;
                CommandResult::Stored
            }
            &Command::Calibration { layout_id, cells, id } => {
                // A calibration is stored with the layout identifier of the board, so that it remains valid if the settings
                // change. The host sends the identifier of the hello, which includes the settings.
                let board_layout_id = self.shared.session.borrow().setup().map(|setup| setup.layout_id);
                let board_layout_id = board_layout_id.ok_or(Refusal::NoLayout)?;
                let is_of_layout = layout_id == hello.layout_id && cells == hello.cells;
                if !is_of_layout || !store.put_calibration(board_layout_id, cells, id).await? {
                    return Err(Refusal::Calibration);
                }
                log::info!("settings: calibration {:x} is stored", id);
                CommandResult::Identity(Identity { calibration_id: id, ..identity })
            }
            Command::Settings(settings) => {
                store.put(0, &SettingsRecord(*settings)).await?;
                log::info!("settings: stored, in force from the next start on");
                CommandResult::Stored
            }
            Command::AlertRules(rules) => {
                store.put(0, rules).await?;
                /// Time after which the load of the day has the number of its day by the new rules.
                const RENUMBERED_AFTER: Duration = Duration::from_secs(2);
                self.daily_load_at = self.daily_load_at.min(Instant::now() + RENUMBERED_AFTER);
                log::info!("settings: the rules of alerts are stored");
                CommandResult::Stored
            }
            Command::EraseWearer => {
                log::info!("erase: the data of the wearer");
                store.erase_wearer(|| self.shared.scan.heartbeats.progressed(Part::Storage)).await?;
                CommandResult::Identity(identity)
            }
            Command::Restart => {
                log::info!("restart: requested by the host");
                self.restart_at = Instant::MIN;
                return Ok(None);
            }
            Command::Update(request) => {
                if let Some(trial) = self.trial.as_mut().filter(|_| *request == Request::Confirm) {
                    trial.confirm_by_host();
                    self.end_trial(store).await;
                }
                let progress = match store.flash() {
                    Some(flash) => {
                        let mut handled = pin!(self.update.handle(flash, self.image, &update::KEY, request));
                        poll_fn(|context| poll_in_own_frame(handled.as_mut(), context)).await
                    }
                    None => Err(UpdateRefusal::Chip),
                };
                CommandResult::Update(progress.map_err(Refusal::Update)?)
            }
        }))
    }

    /// Stores that the radio has answered on this board.
    async fn note_radio(&mut self, store: &mut Store<impl MultiwriteNorFlash>) {
        if !self.is_radio_known && self.shared.scan.heartbeats.count(Part::Radio) > 0 {
            // After a failure the attempt is repeated at the next start.
            self.is_radio_known = true;
            let _ = store.put(0, &RadioRecord { has_answered: true }).await;
        }
    }

    /// Prevents the bootloader from swapping the previous image back.
    async fn forget_previous(&mut self, store: &mut Store<impl MultiwriteNorFlash>) {
        if let Some(flash) = store.flash() {
            // After a failure the attempt is repeated with the next event.
            self.has_previous = previous::forget(flash).await.is_err();
        }
    }

    /// Checks the running image if a check is due, and ends its trial once it has passed.
    async fn check_trial(&mut self, store: &mut Store<impl MultiwriteNorFlash>) -> Verdict {
        let Some(trial) = self.trial.as_mut().filter(|trial| Instant::now() >= trial.next_check()) else {
            return Verdict::Pending;
        };
        let is_sound = store.is_sound().await;
        trial.check(&self.shared.scan.heartbeats, is_sound);
        self.end_trial(store).await
    }

    /// Confirms the running image if it has passed its trial. Without a trial, the image has passed.
    async fn end_trial(&mut self, store: &mut Store<impl MultiwriteNorFlash>) -> Verdict {
        let verdict = self.trial.as_ref().map_or(Verdict::Passed, Trial::verdict);
        if verdict == Verdict::Passed
            && let Some(trial) = &mut self.trial
            && let Some(flash) = store.flash()
        {
            // An image that is not confirmed is swapped back at the next start.
            if update::confirm(flash, self.image).await.is_ok() {
                self.trial = None;
                log::info!("update: the image is confirmed");
            } else {
                trial.retry_later();
                log::error!("update: the image could not be confirmed, the next attempt follows in a minute");
            }
        }
        verdict
    }
}

/// Polls a future in a stack frame of its own, so that the stack that the verification of a signature needs is not reserved
/// permanently.
#[inline(never)]
fn poll_in_own_frame<F: Future>(work: Pin<&mut F>, context: &mut Context<'_>) -> Poll<F::Output> {
    work.poll(context)
}

impl From<StorageError> for Refusal {
    fn from(_: StorageError) -> Self {
        Self::NotStored
    }
}

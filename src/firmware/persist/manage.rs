//! Executes the requests of management tools that need the storage.

use super::{Persist, RESTART_DELAY, poll_in_own_frame};
use crate::firmware::shared::Exchange;
use crate::firmware::trial::Verdict;
use crate::log;
use crate::protocol::update::{Header, Refusal};
use crate::storage::Store;
use crate::storage::update::KEY;
use crate::storage::upload::{Received, sha256_of_running};
use core::future::poll_fn;
use core::pin::pin;
use embassy_time::Instant;
use embedded_storage_async::nor_flash::MultiwriteNorFlash;
use mcumgr::{Answer, Failure, ImageState, Request};

impl Persist<'_> {
    /// Executes the pending request of a tool, if there is one, and answers it.
    pub(super) async fn execute_request(&mut self, store: &mut Store<impl MultiwriteNorFlash>) {
        let Some((head, request)) = self.shared.take_request() else { return };
        let answer = match self.manage(store, &request).await {
            Ok(Some(answer)) => answer,
            // The tool waits while the checks of the trial are incomplete.
            Ok(None) => return self.shared.proceed(Exchange::Requested(head, request)),
            Err(failure) => Answer::Failed(failure),
        };
        self.shared.proceed(Exchange::Answered(head, answer));
    }

    /// Executes a request. Returns `None` for a confirmation of the running image while the checks of its trial are incomplete.
    async fn manage(
        &mut self,
        store: &mut Store<impl MultiwriteNorFlash>,
        request: &Request,
    ) -> Result<Option<Answer>, Failure> {
        if matches!(request, Request::Reset) {
            log::info!("restart: requested by a tool");
            self.restart_at = Instant::now() + RESTART_DELAY;
            return Ok(Some(Answer::Done));
        }
        let flash = store.flash().ok_or(Refusal::Chip)?;
        if let Request::Upload(part) = request {
            return Ok(Some(Answer::Offset(self.update.upload(flash, self.image, part).await?)));
        }
        if matches!(request, Request::Erase) {
            return Ok(self.update.discard(flash).await.map(|()| Some(Answer::Done))?);
        }
        let running = match self.sha256 {
            Some(sha256) => sha256,
            // The digest of the whole image takes some time, so it is computed only once.
            None => *self.sha256.insert(sha256_of_running(flash, self.image, self.content).await),
        };
        if let Request::SetImage { sha256, is_confirmed } = request {
            let is_received = self.update.received().is_some_and(|received| Some(received.sha256) == *sha256);
            let is_running = sha256.is_none_or(|sha256| sha256 == running);
            match (*is_confirmed, is_running) {
                (false, false) if is_received => {
                    let mut marked = pin!(self.update.mark(flash, &KEY));
                    poll_fn(|context| poll_in_own_frame(marked.as_mut(), context)).await?;
                    log::info!("update: the image is accepted, and runs from the next start on");
                }
                // The running image cannot be tested, and only the running image can be confirmed.
                (false, true) => return Err(Failure::ALREADY_RUNS),
                (true, false) if is_received => return Err(Failure::NOT_CONFIRMED),
                (_, false) => return Err(Failure::NO_IMAGE),
                (true, true) => {
                    if let Some(trial) = &mut self.trial {
                        trial.confirm_by_host();
                    }
                    let verdict = self.end_trial(store).await;
                    match &self.trial {
                        // If the image has passed, the chip has refused the confirmation.
                        Some(trial) if verdict == Verdict::Passed || trial.is_overdue() => {
                            return Err(Failure::NOT_CONFIRMED);
                        }
                        Some(_) => return Ok(None),
                        None => {}
                    }
                }
            }
        }
        let is_confirmed = self.trial.is_none();
        let running = ImageState { version: version(self.image), sha256: running, is_pending: false, is_confirmed };
        let received = self.update.received().map(|Received { header, sha256, is_pending }| ImageState {
            version: version(&header),
            sha256,
            is_pending,
            is_confirmed: false,
        });
        Ok(Some(Answer::Images([Some(running), received])))
    }
}

/// The version of an image, which has at most 16 bytes.
fn version(header: &Header) -> heapless::String<16> {
    header.version().try_into().unwrap_or_default()
}

//! Sends a firmware image to an insole: each request is sent after the previous one was answered.

use crate::session::elapsed;
use crate::{Carrier, Client, Error};
use plantar::protocol::update::{Progress, Request};
use plantar::protocol::{Refusal, ToDevice, ToHost};
use std::time::Duration;

/// An insole answers any request but [`Request::Finish`] within this time.
const ANSWER: Duration = Duration::from_secs(2);
/// An insole verifies a whole image within this time.
const VERIFICATION: Duration = Duration::from_secs(30);
/// Time before a request that a busy insole refused is repeated.
const BUSY: Duration = Duration::from_millis(500);
/// Largest number of attempts to send a request.
const ATTEMPTS: usize = 5;

impl<C: Carrier> Client<C> {
    /// Sends a request of an update, at most five times, until it is answered. [`Client::receive`] returns other messages that
    /// arrive meanwhile. [`Request::Finish`] is only repeated if it was refused because the insole is busy: if no answer
    /// arrived, the insole may have installed the image and restarted.
    ///
    /// # Errors
    /// [`Error::LostAnswer`] if the last attempt was not answered; [`Error::Refused`]; errors of the carrier.
    pub fn update(&mut self, request: Request) -> Result<Progress, Error> {
        let is_answer = |progress: Progress| match (request, progress) {
            (Request::Begin(_), Progress::Next(_))
            | (Request::Finish, Progress::Accepted)
            | (Request::Confirm, Progress::Confirmed) => true,
            // The answer to this chunk requests a later one. Any other answer is that to a repetition of an earlier chunk.
            (Request::Chunk { number, .. }, Progress::Next(next)) => next > number,
            _ => false,
        };
        let patience = if request == Request::Finish { VERIFICATION } else { ANSWER };
        let mut attempts = 0;
        loop {
            attempts += 1;
            let answer = match request {
                Request::Begin(_) => self.discard_late_answers(),
                _ => Ok(()),
            }
            .and_then(|()| {
                self.request_within(patience, ToDevice::Update(request), |message| match *message {
                    ToHost::Update(progress) if is_answer(progress) => Some(progress),
                    _ => None,
                })
            });
            match answer {
                // The insole is still executing another request.
                Err(Error::Refused(Refusal::Busy)) if attempts < ATTEMPTS => self.receive_for(BUSY)?,
                // The request or its answer was lost on the way.
                Err(Error::LostAnswer(..)) if attempts < ATTEMPTS && request != Request::Finish => {}
                answer => return answer,
            }
        }
    }

    /// Receives messages for some time, for [`Client::receive`].
    fn receive_for(&mut self, duration: Duration) -> Result<(), Error> {
        let start_us = C::now_us();
        let mut received = Vec::new();
        let result = loop {
            if elapsed::<C>(start_us) >= duration {
                break Ok(());
            }
            match self.next() {
                Ok(message) => received.extend(message),
                Err(error) => break Err(error),
            }
        };
        self.waiting.extend(received);
        result
    }

    /// Discards the answers to earlier requests, perhaps of another image or another host: a late answer to a chunk looks like
    /// that to [`Request::Begin`], but may state the progress of another transfer. Answers that an insole has queued arrive
    /// before a status; that to a chunk which it is still storing arrives later, and is not recognised.
    fn discard_late_answers(&mut self) -> Result<(), Error> {
        let mut attempts = 1;
        while let Err(error) = self.status() {
            // A request for the status is refused only if another host has the session, so any other refusal is late.
            let is_late = matches!(error, Error::Refused(refusal) if refusal != Refusal::OtherHost);
            if !is_late || attempts == ATTEMPTS {
                return Err(error);
            }
            attempts += 1;
        }
        self.waiting.retain(|message| !matches!(message, ToHost::Update(_)));
        Ok(())
    }
}

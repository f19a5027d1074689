//! Sends an image to an insole, one answered request after the other.

use crate::{Carrier, Client, Error};
use plantar::protocol::update::{Progress, Request};
use plantar::protocol::{Refusal, ToDevice, ToHost};
use std::time::Duration;

/// An insole answers a piece within this time, and looks through a whole image within the other.
const ANSWER: Duration = Duration::from_secs(2);
const CHECK: Duration = Duration::from_secs(30);
/// A request is sent this often before the insole counts as gone.
const TRIES: usize = 5;

impl<C: Carrier> Client<C> {
    /// Asks for a step of an update until it is answered; what arrives meanwhile is received as usual.
    pub fn update(&mut self, request: Request) -> Result<Progress, Error> {
        let is_answer = |progress: Progress| match (request, progress) {
            (Request::Begin(_), Progress::Next(_)) | (Request::Finish, Progress::Accepted) => true,
            // Lower ones answer what was sent twice.
            (Request::Chunk { number, .. }, Progress::Next(next)) => next > number,
            _ => false,
        };
        let patience = if request == Request::Finish { CHECK } else { ANSWER };
        let mut tries = 0;
        loop {
            tries += 1;
            let answer = self.ask_within(patience, ToDevice::Update(request), |message| match *message {
                ToHost::Update(progress) if is_answer(progress) => Some(progress),
                _ => None,
            });
            match answer {
                // Lost on the way, or the answer was.
                Err(Error::NoAnswer(..) | Error::Refused(Refusal::Busy)) if tries < TRIES => {}
                answer => return answer,
            }
        }
    }
}

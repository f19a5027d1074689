//! Requests of management tools ([`mcumgr`]), over any carrier. They need no session.

use super::shared::{Carrier, Exchange, Shared};
use crate::log;
use crate::protocol::current_time::{from_current_time, to_current_time};
use crate::protocol::update::Refusal;
use mcumgr::{Answer, Clock, DAY_MIN, Failure, Request};

/// True if the firmware serves management tools. On a board without enough flash for them, the feature `management` is off, and
/// their code is not part of the firmware.
pub(super) const IS_MANAGED: bool = cfg!(feature = "management");

impl Shared {
    /// Receives a message of a management tool over a carrier.
    pub fn receive_management(&self, carrier: Carrier, message: &[u8]) {
        if !IS_MANAGED {
            return;
        }
        let Some((head, request)) = mcumgr::decode(message) else { return self.count_bad_frame() };
        if carrier == Carrier::Serial {
            // The program that has opened the port is a tool now, and would take the frames of the session for noise.
            self.end_session(carrier);
        }
        self.tool.set(Some(carrier));
        let answer = match request {
            Err(failure) => Answer::Failed(failure),
            Ok(Request::Echo(text)) => Answer::Echo(text),
            Ok(Request::Parameters) => Answer::Parameters,
            Ok(Request::GetTime) => match self.unix_us() {
                Some(unix_us) => Answer::Time(clock(unix_us)),
                None => Answer::Failed(Failure::NO_TIME),
            },
            Ok(Request::SetTime(clock)) => match unix_us(&clock) {
                Some(unix_us) if self.set_clock(unix_us) => Answer::Done,
                _ => Answer::Failed(Failure::TIME),
            },
            Ok(request) => {
                self.exchange.replace(Exchange::Requested(head, request));
                return self.to_persist.signal(());
            }
        };
        self.exchange.replace(Exchange::Answered(head, answer));
        self.changed(carrier).signal(());
    }

    /// Takes the request that waits for the storage.
    #[cfg(feature = "management")]
    pub(super) fn take_request(&self) -> Option<(mcumgr::Head, Request)> {
        let mut exchange = self.exchange.borrow_mut();
        match core::mem::replace(&mut *exchange, Exchange::Idle) {
            Exchange::Requested(head, request) => {
                *exchange = Exchange::Executing;
                Some((head, request))
            }
            other => {
                *exchange = other;
                None
            }
        }
    }

    /// Replaces the state [`Exchange::Executing`] by `next`, unless another request has arrived in the meantime.
    #[cfg(feature = "management")]
    pub(super) fn proceed(&self, next: Exchange) {
        let mut exchange = self.exchange.borrow_mut();
        if matches!(*exchange, Exchange::Executing) {
            *exchange = next;
        }
    }

    /// Encodes the answer to a tool into `buffer`; `None` if there is none for this carrier.
    pub(super) fn next_management<'b>(&self, carrier: Carrier, buffer: &'b mut [u8]) -> Option<&'b [u8]> {
        let mut exchange = self.exchange.borrow_mut();
        let Exchange::Answered(head, answer) = &*exchange else { return None };
        if !IS_MANAGED || self.tool.get() != Some(carrier) {
            return None;
        }
        if let Answer::Failed(failure) = answer {
            log::warn!("management: group {}, command {} has failed: {}", head.group, head.command, failure.common());
        }
        let encoded = answer.encode(head, buffer);
        *exchange = Exchange::Idle;
        encoded
    }
}

/// A time, us since 1970, as date and time of day in coordinated universal time.
fn clock(unix_us: u64) -> Clock {
    let [low, high, month, day, hour, minute, second, ..] = to_current_time(Some(unix_us));
    Clock { year: u16::from_le_bytes([low, high]), numbers: [month, day, hour, minute, second], zone_min: 0 }
}

/// The time of a clock, us since 1970; `None` if its numbers are not a valid time.
fn unix_us(clock: &Clock) -> Option<u64> {
    if clock.zone_min.abs() >= DAY_MIN {
        return None;
    }
    let ([low, high], [month, day, hour, minute, second]) = (clock.year.to_le_bytes(), clock.numbers);
    let unix_us = from_current_time(&[low, high, month, day, hour, minute, second, 0, 0, 0])?;
    unix_us.checked_add_signed(-i64::from(clock.zone_min) * 60_000_000)
}

impl From<Refusal> for Failure {
    fn from(refusal: Refusal) -> Self {
        // The codes in Zephyr that are nearest in meaning: `common` is one of `mcumgr_err_t`, `code` of `img_mgmt_err_code_t`.
        let (common, code) = match refusal {
            Refusal::Board => (3, 25),     // EINVAL, INVALID_FLASH_ADDRESS
            Refusal::Older => (6, 27),     // EBADSTATE, CURRENT_VERSION_IS_NEWER
            Refusal::Length => (3, 30),    // EINVAL, INVALID_IMAGE_TOO_LARGE
            Refusal::OnTrial => (6, 28),   // EBADSTATE, IMAGE_ALREADY_PENDING
            Refusal::NotBegun => (6, 3),   // EBADSTATE, NO_IMAGE
            Refusal::Incomplete => (3, 4), // EINVAL, NO_TLVS
            Refusal::Header => (3, 22),    // EINVAL, INVALID_IMAGE_HEADER
            Refusal::Signature => (3, 5),  // EINVAL, INVALID_TLV
            Refusal::Chip => (1, 12),      // EUNKNOWN, FLASH_WRITE_FAILED
        };
        Self::of_image(common, code)
    }
}

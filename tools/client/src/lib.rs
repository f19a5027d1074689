//! The host's side of a session with an insole, over any carrier of messages.

mod axis;
mod carrier;
mod json;
mod order;
mod update;

pub use axis::Axis;
pub use carrier::{Carrier, Framed, unix_us};
pub use json::step_to_json;

use order::{Arrival, StepOrder};
use plantar::Side;
use plantar::faults::Faults;
use plantar::pipeline::calibrate::CellCalibration;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::session::STEP_QUEUE;
use plantar::protocol::{BLOCK_CELLS, CalibrationId};
use plantar::protocol::{Hello, Identity, MAJOR, MINOR, Refusal, Serial, Status, Step, ToDevice, ToHost};
use serde::Serialize;
use std::collections::VecDeque;
use std::io;
use std::time::Duration;
use thiserror::Error;

/// A connected insole answers within this time.
const ANSWER: Duration = Duration::from_secs(2);
/// Between questions for the insole's time.
const ASK_TIME: Duration = Duration::from_millis(250);
/// Between repetitions of the connection request.
const GREETING: Duration = Duration::from_millis(500);

/// Why there is no session, or no longer one.
#[derive(Debug, Error)]
pub enum Error {
    /// Nothing that could be understood came back.
    #[error(
        "no insole answered within {0:?} ({1} damaged frames): check the port, the wiring (docs/hardware.md) and the bit rate"
    )]
    NoAnswer(Duration, u32),
    /// The insole speaks another major version.
    #[error(
        "the insole (firmware {firmware}) speaks protocol {major}.{minor}, this program {MAJOR}.{MINOR}: update the older of the two"
    )]
    OtherVersion {
        /// Its firmware.
        firmware: String,
        /// Its major.
        major: u8,
        /// Its minor.
        minor: u8,
    },
    /// The insole did not do what it was told.
    #[error("the insole refused: {0}")]
    Refused(Refusal),
    /// The carrier broke.
    #[error("the link to the insole broke")]
    Carrier(#[from] io::Error),
}

/// What became of the live frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LinkCounters {
    /// Frames that the insole gave to the carrier, by its own count.
    pub frames_sent: u32,
    /// Frames that arrived whole.
    pub frames_received: u32,
    /// Frames missing between the ones that arrived.
    pub frames_lost: u32,
    /// Frames of any kind with a wrong CRC or no known message.
    pub crc_errors: u32,
}

/// A session.
pub struct Client<C> {
    /// `None` between one and the next.
    carrier: Option<C>,
    /// By the carriers before this one.
    damaged_before: u32,
    /// Came while something else was awaited.
    waiting: VecDeque<ToHost>,
    hello: Hello,
    frames_sent: u32,
    frames_received: u32,
    frames_lost: u32,
    next_live: Option<u32>,
    axis: Axis,
    /// When the insole's time was last requested, by [`Carrier::now_us`].
    time_asked_us: Option<u64>,
    /// As many as an insole can send again: those in its RAM, and those of which the acknowledgement was lost.
    delivered: VecDeque<Delivered>,
    order: StepOrder,
    is_streaming: bool,
}

struct Delivered {
    step: Step,
    is_acknowledged: bool,
}

impl<C: Carrier> Client<C> {
    /// Says hello, and again twice a second until the insole answers or `patience` is over.
    pub fn connect(mut carrier: C, patience: Duration) -> Result<Self, Error> {
        let hello = greet(&mut carrier, patience)?;
        Ok(Self {
            carrier: Some(carrier),
            damaged_before: 0,
            waiting: VecDeque::new(),
            hello,
            frames_sent: 0,
            frames_received: 0,
            frames_lost: 0,
            next_live: None,
            axis: Axis::new(),
            time_asked_us: None,
            delivered: VecDeque::new(),
            order: StepOrder::default(),
            is_streaming: false,
        })
    }

    /// Opens the session anew, as after a silence, and returns what the insole says of itself now. The live stream is off.
    pub fn reconnect(&mut self, patience: Duration) -> Result<&Hello, Error> {
        self.hello = greet(carrier(&mut self.carrier)?, patience)?;
        self.waiting.clear();
        self.axis = Axis::new();
        self.next_live = None;
        self.is_streaming = false;
        self.order.begin();
        Ok(&self.hello)
    }

    /// As [`Client::reconnect`], over another carrier after one broke.
    pub fn reconnect_over<E: From<Error>>(
        &mut self,
        open: impl FnOnce() -> Result<C, E>,
        patience: Duration,
    ) -> Result<&Hello, E> {
        self.damaged_before = self.damaged();
        // Let go of first: a serial port has one user, and the end of a Bluetooth link would take the next along.
        self.carrier = None;
        self.carrier = Some(open()?);
        Ok(self.reconnect(patience)?)
    }

    /// Who answered.
    pub fn hello(&self) -> &Hello {
        &self.hello
    }

    /// Sets the insole's clock and learns its time, turns the live stream on and waits until it is; what arrives meanwhile is received as usual.
    pub fn stream(&mut self) -> Result<(), Error> {
        self.send(ToDevice::SetClock { unix_us: C::unix_us() })?;
        let question = ToDevice::GetTime { host_us: C::unix_us() };
        let (asked_us, device_us) = self.ask(question, |message| match *message {
            ToHost::Time { host_us, device_us } => Some((host_us, device_us)),
            _ => None,
        })?;
        self.axis.answer(asked_us, device_us);
        self.send(ToDevice::Stream { live: true })?;
        self.status().map(drop)
    }

    /// The insole's counters, after all that was due before them.
    pub fn status(&mut self) -> Result<Status, Error> {
        self.ask(ToDevice::GetStatus, |message| match message {
            ToHost::Status(status) => Some(*status),
            _ => None,
        })
    }

    /// Gives the insole its wearer's parameters and waits until they are kept, and in force for the frames that follow. Steps that ended before, and one whose evaluation is under way, still come with the parameters before.
    pub fn set_tissue(&mut self, tissue: &Tissue) -> Result<(), Error> {
        self.ask_tissue(ToDevice::SetTissue(*tissue), |in_force| in_force.id == tissue.id).map(drop)
    }

    /// The parameters that the insole uses; [`Tissue::NONE`] without any.
    pub fn tissue(&mut self) -> Result<Tissue, Error> {
        self.ask_tissue(ToDevice::GetTissue, |_| true)
    }

    fn ask_tissue(&mut self, request: ToDevice, is_answer: impl Fn(&Tissue) -> bool) -> Result<Tissue, Error> {
        let tissue = self.ask(request, |message| match message {
            ToHost::Tissue(tissue) if is_answer(tissue) => Some(*tissue),
            _ => None,
        })?;
        self.hello.tissue_id = tissue.id;
        Ok(tissue)
    }

    /// What is kept of the insole itself.
    pub fn identity(&mut self) -> Result<Identity, Error> {
        self.ask_identity(ToDevice::GetIdentity)
    }

    /// Names the insole, from its next start on.
    pub fn set_identity(&mut self, side: Side, serial: Serial) -> Result<Identity, Error> {
        self.ask_identity(ToDevice::SetIdentity { side, serial })
    }

    fn ask_identity(&mut self, request: ToDevice) -> Result<Identity, Error> {
        self.ask(request, |message| match message {
            ToHost::Identity(identity) => Some(*identity),
            _ => None,
        })
    }

    /// Gives the insole its cells' calibrations, one each in the order of its layout, for its next start.
    pub fn calibrate(&mut self, cells: &[CellCalibration]) -> Result<Identity, Error> {
        let mut id = CalibrationId::new();
        id.add(cells);
        for (number, chunk) in (0..).zip(cells.chunks(BLOCK_CELLS)) {
            let mut part = [CellCalibration::IDEAL; BLOCK_CELLS];
            part[..chunk.len()].copy_from_slice(chunk);
            self.ask(ToDevice::SetCalibrationBlock { block: number, cells: part }, |message| {
                matches!(message, ToHost::CalibrationBlock { block } if *block == number).then_some(())
            })?;
        }
        let (layout_id, cells) = (self.hello.layout_id, cells.len() as u16);
        self.ask_identity(ToDevice::SetCalibration { layout_id, cells, id: id.id() })
    }

    /// Restarts the insole and opens the session anew. A carrier that goes with the insole is an error: then it is to be opened
    /// again, with [`Client::reconnect_over`].
    pub fn restart(&mut self, patience: Duration) -> Result<&Hello, Error> {
        let before_us = self.status()?.uptime_us;
        self.send(ToDevice::Restart)?;
        let asked_us = C::now_us();
        while elapsed::<C>(asked_us) < patience {
            self.reconnect(patience)?;
            // The one before may have answered once more.
            let grown_us = before_us.saturating_add(elapsed::<C>(asked_us).as_micros() as u64 / 2);
            if self.status().is_ok_and(|status| status.uptime_us < grown_us) {
                return Ok(&self.hello);
            }
        }
        Err(Error::NoAnswer(patience, self.damaged()))
    }

    /// Sends a request and waits for its answer; what arrives meanwhile is received as usual.
    fn ask<T>(&mut self, request: ToDevice, answer: impl Fn(&ToHost) -> Option<T>) -> Result<T, Error> {
        self.ask_within(ANSWER, request, answer)
    }

    fn ask_within<T>(
        &mut self,
        patience: Duration,
        request: ToDevice,
        answer: impl Fn(&ToHost) -> Option<T>,
    ) -> Result<T, Error> {
        self.send(request)?;
        let asked_us = C::now_us();
        let mut meanwhile = Vec::new();
        let answered = loop {
            if elapsed::<C>(asked_us) >= patience {
                break Err(Error::NoAnswer(patience, self.damaged()));
            }
            match self.next() {
                Err(error) => break Err(error),
                Ok(Some(ToHost::Refused(refusal))) => break Err(Error::Refused(refusal)),
                // The answer to a hello that was said twice.
                Ok(Some(ToHost::Hello(_)) | None) => {}
                Ok(Some(message)) => match answer(&message) {
                    Some(answer) => break Ok(answer),
                    None => meanwhile.push(message),
                },
            }
        };
        for message in meanwhile.into_iter().rev() {
            self.waiting.push_front(message);
        }
        answered
    }

    fn damaged(&self) -> u32 {
        self.damaged_before.wrapping_add(self.carrier.as_ref().map_or(0, Carrier::damaged))
    }

    /// Sends a message.
    pub fn send(&mut self, message: ToDevice) -> Result<(), Error> {
        if let ToDevice::Stream { live } = message {
            self.is_streaming = live;
        }
        if let ToDevice::Acknowledge { step } = message {
            // Also where it gets lost on the way: what is stored stays so.
            for delivered in &mut self.delivered {
                // Wrapping order.
                delivered.is_acknowledged |= step.wrapping_sub(delivered.step.step) < u32::MAX / 2;
            }
        }
        Ok(carrier(&mut self.carrier)?.send(message)?)
    }

    /// The insole's clock against this computer's, us since 1970, UTC; as long as [`Client::receive`] is called it gets better.
    pub fn axis(&self) -> &Axis {
        &self.axis
    }

    /// What the insole has found of its sensor's faults; what arrives meanwhile is received as usual.
    pub fn faults(&mut self) -> Result<Faults, Error> {
        self.ask(ToDevice::GetFaults, |message| match message {
            ToHost::Faults(faults) => Some(faults.clone()),
            _ => None,
        })
    }

    fn ask_time(&mut self) -> Result<(), Error> {
        let is_due = self.time_asked_us.is_none_or(|asked_us| elapsed::<C>(asked_us) >= ASK_TIME);
        if is_due {
            self.time_asked_us = Some(C::now_us());
            self.send(ToDevice::GetTime { host_us: C::unix_us() })?;
        }
        Ok(())
    }

    /// The next message; `None` when none came within the carrier's time-out. Asks for the insole's time now and then, and
    /// keeps the answers for [`Client::axis`]. A step comes once, however often it is
    /// replayed; send [`ToDevice::Acknowledge`] once it is stored. One that is replayed after that is acknowledged here.
    pub fn receive(&mut self) -> Result<Option<ToHost>, Error> {
        self.ask_time()?;
        if self.order.requested_us().is_some_and(|us| elapsed::<C>(us) >= ANSWER) {
            // The request or its answer was lost, too.
            self.request_replay()?;
        }
        let Some(message) = self.next()? else { return Ok(None) };
        match &message {
            ToHost::Time { host_us, device_us } => {
                self.axis.answer(*host_us, *device_us);
                return Ok(None);
            }
            ToHost::Live(live) => {
                self.frames_received = self.frames_received.wrapping_add(1);
                if let Some(expected) = self.next_live {
                    let gap = live.sequence.wrapping_sub(expected);
                    // A step back is another stream.
                    let lost = if gap < u32::MAX / 2 { gap } else { 0 };
                    self.frames_lost = self.frames_lost.saturating_add(lost);
                }
                self.next_live = Some(live.sequence.wrapping_add(1));
            }
            ToHost::Step(step) => {
                if let Some(delivered) = self.delivered.iter().find(|delivered| is_same_step(&delivered.step, step)) {
                    // An insole that did not hear of it would wait for ever.
                    if delivered.is_acknowledged {
                        self.send(ToDevice::Acknowledge { step: step.step })?;
                    }
                    return Ok(None);
                }
                match self.order.arrive(step.step) {
                    Arrival::InOrder => {}
                    Arrival::Awaited => return Ok(None),
                    Arrival::Gap => {
                        self.request_replay()?;
                        return Ok(None);
                    }
                }
                if self.delivered.len() == 2 * STEP_QUEUE {
                    self.delivered.pop_front();
                }
                self.delivered.push_back(Delivered { step: *step, is_acknowledged: false });
            }
            ToHost::Status(status) => {
                self.frames_sent = status.live_sent;
                // A status comes after all that was due: this also finds what was lost before the first frame or after the last.
                self.frames_lost = self.frames_lost.max(status.live_due.saturating_sub(self.frames_received));
            }
            ToHost::Hello(_) => {
                // The stream of another session begins.
                self.next_live = None;
                if self.order.begin() {
                    return Ok(None);
                }
            }
            ToHost::Tissue(_)
            | ToHost::Refused(_)
            | ToHost::Faults(_)
            | ToHost::Identity(_)
            | ToHost::CalibrationBlock { .. }
            | ToHost::Update(_) => {}
        }
        Ok(Some(message))
    }

    /// Opens the session again, so that the insole sends its steps from the oldest unacknowledged one on.
    fn request_replay(&mut self) -> Result<(), Error> {
        let is_streaming = self.is_streaming;
        self.order.request(C::now_us());
        self.send(ToDevice::Connect { major: MAJOR, minor: MINOR })?;
        if is_streaming {
            self.send(ToDevice::Stream { live: true })?;
        }
        Ok(())
    }

    fn next(&mut self) -> Result<Option<ToHost>, Error> {
        Ok(match self.waiting.pop_front() {
            Some(message) => Some(message),
            None => carrier(&mut self.carrier)?.receive()?,
        })
    }

    /// What became of the live frames; ask for a status first to know how many were sent.
    pub fn counters(&self) -> LinkCounters {
        LinkCounters {
            frames_sent: self.frames_sent,
            frames_received: self.frames_received,
            frames_lost: self.frames_lost,
            crc_errors: self.damaged(),
        }
    }
}

/// True for a step and the same when it is replayed, with the insole started anew since or not.
///
/// By content: an insole whose chip was changed counts from 0 again.
pub fn is_same_step(one: &Step, other: &Step) -> bool {
    *one == Step { boots_since: one.boots_since, ..*other }
}

/// The carrier, where there is one.
fn carrier<C>(carrier: &mut Option<C>) -> io::Result<&mut C> {
    carrier.as_mut().ok_or_else(|| io::ErrorKind::NotConnected.into())
}

/// Time since `since_us` by the carrier's clock.
fn elapsed<C: Carrier>(since_us: u64) -> Duration {
    Duration::from_micros(C::now_us().saturating_sub(since_us))
}

/// Says hello, and again twice a second until the insole answers.
fn greet<C: Carrier>(carrier: &mut C, patience: Duration) -> Result<Hello, Error> {
    let start_us = C::now_us();
    while elapsed::<C>(start_us) < patience {
        carrier.send(ToDevice::Connect { major: MAJOR, minor: MINOR })?;
        let asked_us = C::now_us();
        while elapsed::<C>(asked_us) < GREETING && elapsed::<C>(start_us) < patience {
            // What came before the hello belongs to an earlier session.
            let Some(ToHost::Hello(hello)) = carrier.receive()? else { continue };
            if hello.major != MAJOR {
                let firmware = hello.firmware.as_str().into();
                return Err(Error::OtherVersion { firmware, major: hello.major, minor: hello.minor });
            }
            return Ok(hello);
        }
    }
    Err(Error::NoAnswer(patience, carrier.damaged()))
}

//! One insole's side of a session, over any carrier: what to answer, what to send next, what to keep.
//!
//! Live frames are for now: a full queue drops the oldest. Steps are for good: each stays until it is acknowledged and is
//! sent again in the next session; here are the oldest of them, [`crate::store`] has all. The wearer's parameters and the
//! clock outlive the session that brought them.

use crate::Side;
use crate::calibrate::CellCalibration;
use crate::fault::Faults;
use crate::insole::{DEVICE_CELLS, Tissue};
use crate::store::{PART_CELLS, Part};
use crate::update;
use crate::wire::{Hello, Identity, Live, MAJOR, MAX_LIVE, Refusal, Serial, Status, Step, ToDevice, ToHost, encode};
use heapless::{Deque, Vec};

/// Live frames that wait for the carrier.
pub const LIVE_QUEUE: usize = 8;
/// Steps at hand that wait for their acknowledgement.
pub const STEP_QUEUE: usize = 6;
/// Answers that wait for the carrier: more than one read of it asks for. Requests beyond are not answered.
const ANSWER_QUEUE: usize = 16;

/// Parts of a calibration.
const PARTS: usize = DEVICE_CELLS / PART_CELLS;

/// What a host asked for.
#[derive(Debug)]
enum Answer {
    Status,
    Tissue,
    Refused(Refusal),
    Time { host_us: u64, device_us: u64 },
    Faults,
    Identity,
    CalibrationPart(u8),
    Update(update::Progress),
}

impl Answer {
    /// Says which parameters hold: frames that still wait are of the ones before.
    fn is_announcement(&self) -> bool {
        matches!(self, Self::Tissue | Self::Refused(Refusal::NotKept))
    }
}

/// What the insole was told to keep. The answer goes out when it is kept: [`Link::done`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Job {
    /// The wearer's parameters, in force once they are kept.
    Tissue(Tissue),
    /// The side and the serial number.
    Name(Side, Serial),
    /// Part of a calibration and its number.
    CalibrationPart(u8, Part),
    /// The calibration with these parts.
    Calibration {
        /// As in [`ToDevice::SetCalibration`].
        layout_id: u32,
        /// Number of cells.
        cells: u16,
        /// Its checksum.
        id: u32,
    },
    /// To start anew.
    Restart,
    /// A step of a firmware update.
    Update(update::Request),
}

/// What became of a [`Job`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Done {
    /// It is kept.
    Kept,
    /// It is kept, and changed what the insole says of itself.
    Identity(Identity),
    /// So far is the update.
    Update(update::Progress),
}

/// The state of the session and what waits to be sent.
#[derive(Debug)]
pub struct Link {
    /// A host of this major version is connected.
    open: bool,
    hello_due: bool,
    answers: Deque<Answer, ANSWER_QUEUE>,
    /// Live frames that were sent since the first of `answers` began to wait.
    waited: u8,
    streaming: bool,
    live: Deque<Vec<u8, MAX_LIVE>, LIVE_QUEUE>,
    live_due: u32,
    live_sent: u32,
    steps: Deque<Step, STEP_QUEUE>,
    /// How many of `steps`, from the front, were sent in this session.
    steps_sent: usize,
    steps_dropped: u32,
    /// The last step that was acknowledged and is not yet forgotten where steps are kept.
    acknowledged: Option<u32>,
    job: Option<Job>,
    tissue: Tissue,
    identity: Identity,
    faults: Faults,
    /// What the wall clock, us since 1970, is ahead of the device's time.
    clock_ahead_us: Option<u64>,
    clock_sets: u32,
}

impl Link {
    /// No session, nothing to send.
    pub const fn new() -> Self {
        Self {
            open: false,
            hello_due: false,
            answers: Deque::new(),
            waited: 0,
            streaming: false,
            live: Deque::new(),
            live_due: 0,
            live_sent: 0,
            steps: Deque::new(),
            steps_sent: 0,
            steps_dropped: 0,
            acknowledged: None,
            job: None,
            tissue: Tissue::NONE,
            identity: Identity { side: Side::Left, serial: Serial::NONE, calibration_id: 0 },
            faults: Faults::NONE,
            clock_ahead_us: None,
            clock_sets: 0,
        }
    }

    /// Takes a message of the host that arrived at `now_us` of the device's time.
    pub fn receive(&mut self, message: ToDevice, now_us: u64) {
        match message {
            ToDevice::Connect { major, .. } => {
                self.close();
                self.open = major == MAJOR;
                self.hello_due = true;
            }
            _ if !self.open => {}
            ToDevice::Stream { live } => {
                self.streaming = live;
                self.live.clear();
            }
            ToDevice::Acknowledge { step } => {
                // Wrapping order; only what was sent can have arrived.
                while self.steps_sent > 0
                    && let Some(arrived) = self.steps.pop_front_if(|s| step.wrapping_sub(s.step) < u32::MAX / 2)
                {
                    self.acknowledged = Some(arrived.step);
                    self.steps_sent -= 1;
                }
            }
            ToDevice::GetStatus => self.answer(Answer::Status),
            ToDevice::SetTissue(tissue) => match tissue.check() {
                Ok(()) => self.begin(Job::Tissue(tissue)),
                Err(refusal) => self.answer(Answer::Refused(refusal)),
            },
            ToDevice::GetTissue => self.answer(Answer::Tissue),
            ToDevice::GetTime { host_us } => self.answer(Answer::Time { host_us, device_us: now_us }),
            ToDevice::SetClock { unix_us } => self.set_clock(unix_us, now_us),
            ToDevice::GetFaults => self.answer(Answer::Faults),
            ToDevice::GetIdentity => self.answer(Answer::Identity),
            ToDevice::SetIdentity { side, serial } if serial.is_valid() => self.begin(Job::Name(side, serial)),
            ToDevice::SetIdentity { .. } => self.answer(Answer::Refused(Refusal::Serial)),
            ToDevice::SetCalibrationPart { part, cells }
                if usize::from(part) < PARTS && cells.iter().all(CellCalibration::is_valid) =>
            {
                self.begin(Job::CalibrationPart(part, cells));
            }
            ToDevice::SetCalibrationPart { .. } => self.answer(Answer::Refused(Refusal::Calibration)),
            ToDevice::SetCalibration { layout_id, cells, id } => {
                self.begin(Job::Calibration { layout_id, cells, id });
            }
            ToDevice::Restart => self.begin(Job::Restart),
            ToDevice::Update(request) => self.begin(Job::Update(request)),
        }
    }

    fn begin(&mut self, job: Job) {
        match self.job {
            None => self.job = Some(job),
            Some(_) => self.answer(Answer::Refused(Refusal::Busy)),
        }
    }

    /// What is to be kept, until [`Link::done`].
    pub fn job(&self) -> Option<Job> {
        self.job
    }

    /// Tells what became of [`Link::job`].
    pub fn done(&mut self, done: Result<Done, Refusal>) {
        let Some(job) = self.job.take() else { return };
        if let (Job::Tissue(tissue), Ok(_) | Err(Refusal::NotKept)) = (job, done) {
            self.tissue = tissue;
        }
        let answer = match (done, job) {
            (Err(refusal), _) => Answer::Refused(refusal),
            (Ok(Done::Update(progress)), _) => Answer::Update(progress),
            (Ok(Done::Identity(identity)), _) => {
                self.identity = identity;
                Answer::Identity
            }
            (Ok(Done::Kept), Job::CalibrationPart(part, _)) => Answer::CalibrationPart(part),
            (Ok(Done::Kept), _) => Answer::Tissue,
        };
        self.answer(answer);
    }

    /// What was kept before this start.
    pub fn restore(&mut self, tissue: Option<Tissue>, identity: Identity) {
        self.tissue = tissue.filter(|tissue| tissue.check().is_ok()).unwrap_or(Tissue::NONE);
        self.identity = identity;
    }

    /// What is kept of the insole itself.
    pub fn identity(&self) -> Identity {
        self.identity
    }

    /// The last step that was acknowledged since this was asked last.
    pub fn take_acknowledged(&mut self) -> Option<u32> {
        self.acknowledged.take()
    }

    /// Whether there is room for a step, and the last one that is at hand.
    pub fn room(&self) -> (bool, Option<u32>) {
        (!self.steps.is_full(), self.steps.back().map(|step| step.step))
    }

    /// Counts steps that are lost.
    pub fn count_dropped(&mut self, steps: u32) {
        self.steps_dropped = self.steps_dropped.wrapping_add(steps);
    }

    /// Takes a frame that arrived whole and holds no known message.
    pub fn receive_unknown(&mut self) {
        if self.open {
            self.answer(Answer::Refused(Refusal::NotUnderstood));
        }
    }

    fn answer(&mut self, answer: Answer) {
        if self.answers.is_empty() {
            self.waited = 0;
        }
        let _ = self.answers.push_back(answer);
    }

    /// The wearer's parameters: the last that were accepted.
    pub fn tissue(&self) -> &Tissue {
        &self.tissue
    }

    /// Takes what the insole has found, where it is new.
    pub fn set_faults(&mut self, faults: &Faults) {
        if (faults.found, faults.rezeroed) != (self.faults.found, self.faults.rezeroed) {
            self.faults = faults.clone();
        }
    }

    /// The parameters for the next frame; `None` while those in force are to be announced first: frames before the answer are of
    /// the ones before.
    pub fn tissue_due(&self) -> Option<&Tissue> {
        (!self.answers.iter().any(Answer::is_announcement)).then_some(&self.tissue)
    }

    /// Sets the wall clock.
    pub fn set_clock(&mut self, unix_us: u64, now_us: u64) {
        self.clock_ahead_us = Some(unix_us.wrapping_sub(now_us));
        self.clock_sets = self.clock_sets.wrapping_add(1);
    }

    /// How often the wall clock was set; wraps.
    pub fn clock_sets(&self) -> u32 {
        self.clock_sets
    }

    /// The wall clock, us since 1970; `None` until it is set.
    pub fn unix_us(&self, now_us: u64) -> Option<u64> {
        self.clock_ahead_us.map(|ahead_us| ahead_us.wrapping_add(now_us))
    }

    /// The carrier lost its host: live frames end, steps, parameters and the clock stay.
    pub fn close(&mut self) {
        *self = Self {
            steps: core::mem::take(&mut self.steps),
            steps_dropped: self.steps_dropped,
            acknowledged: self.acknowledged,
            job: self.job,
            tissue: self.tissue,
            identity: self.identity,
            faults: core::mem::take(&mut self.faults),
            clock_ahead_us: self.clock_ahead_us,
            clock_sets: self.clock_sets,
            ..Self::new()
        };
    }

    /// The number that the next live frame carries; `None` where nobody listens.
    pub fn next_live(&self) -> Option<u32> {
        (self.open && self.streaming).then_some(self.live_due)
    }

    /// Queues the frame with the number [`Link::next_live`] gave, encoded; the oldest makes room.
    // Its own copy for the data path saves 3 % of a frame.
    #[inline(always)]
    pub fn push_live(&mut self, live: Live) {
        self.live_due = self.live_due.wrapping_add(1);
        if self.live.is_full() {
            self.live.pop_front();
        }
        let mut message = Vec::new();
        // A live frame has at most MAX_LIVE bytes by its field types.
        let _ = message.resize_default(MAX_LIVE);
        if let Ok(used) = encode(&ToHost::Live(live), &mut message).map(|used| used.len()) {
            message.truncate(used);
            let _ = self.live.push_back(message);
        }
    }

    /// Keeps a step until it is acknowledged; where there is no room the oldest is dropped and counted.
    pub fn push_step(&mut self, step: Step) {
        if self.steps.is_full() {
            self.steps.pop_front();
            self.steps_sent = self.steps_sent.saturating_sub(1);
            self.count_dropped(1);
        }
        let _ = self.steps.push_back(step);
    }

    /// The next message to send, encoded into `buffer`; `None` when there is nothing. Hello first, then steps, then live
    /// frames; answers come in the order of the requests when all before them is sent. Where a slow carrier always has a
    /// live frame to send, no more of them go before an answer than wait at a time.
    pub fn next<'b>(
        &mut self,
        hello: &Hello,
        status: impl FnOnce() -> Status,
        buffer: &'b mut [u8],
    ) -> Option<&'b [u8]> {
        let message = if core::mem::take(&mut self.hello_due) {
            ToHost::Hello(Hello { tissue_id: self.tissue.id, ..hello.clone() })
        } else if let Some(step) = self.steps.iter().nth(self.steps_sent).filter(|_| self.open) {
            self.steps_sent += 1;
            ToHost::Step(*step)
        } else if let Some(live) = self.live.pop_front_if(|_| self.answers.is_empty() || self.waited < LIVE_QUEUE as u8)
        {
            self.waited = self.waited.saturating_add(1);
            self.live_sent = self.live_sent.wrapping_add(1);
            let out = buffer.get_mut(..live.len())?;
            out.copy_from_slice(&live);
            return Some(out);
        } else {
            let answer = self.answers.pop_front()?;
            if answer.is_announcement() {
                self.live.clear();
            }
            match answer {
                Answer::Status => ToHost::Status(Status {
                    // Those that wait still may arrive.
                    live_due: self.live_due.wrapping_sub(self.live.len() as u32),
                    live_sent: self.live_sent,
                    steps_dropped: self.steps_dropped,
                    faults: self.faults.found,
                    rezeroed: self.faults.rezeroed,
                    ..status()
                }),
                Answer::Tissue => ToHost::Tissue(self.tissue),
                Answer::Refused(refusal) => ToHost::Refused(refusal),
                Answer::Faults => ToHost::Faults(self.faults.clone()),
                Answer::Time { host_us, device_us } => ToHost::Time { host_us, device_us },
                Answer::Identity => ToHost::Identity(self.identity),
                Answer::CalibrationPart(part) => ToHost::CalibrationPart { part },
                Answer::Update(progress) => ToHost::Update(progress),
            }
        };
        // Every message fits MAX_MESSAGE, the least that callers bring.
        encode(&message, buffer).ok().map(|used| &*used)
    }
}

impl Default for Link {
    fn default() -> Self {
        Self::new()
    }
}

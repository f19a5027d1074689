//! The insole's side of a session with a host, over any carrier: it decides which message is sent and which command is executed.
//!
//! A live frame is soon out of date, so a full queue drops the oldest. A load record (a step, a load bout or an alert) must not
//! be lost: it remains until it is acknowledged, and is sent again in the next session. The session holds the oldest
//! unacknowledged records; the log ([`crate::storage`]) contains all of them. The wearer's parameters and the clock remain after
//! the session that set them.

mod configuration;
mod records;

use super::cell_stream::CellSender;
use super::codec::append;
use super::command::{Answer, Configured};
pub use super::command::{Command, CommandResult};
use super::ellipses::EllipseSender;
use super::{Hello, Live, LoadRecord, MAJOR, MAX_LIVE, Refusal, SETUP_CELLS, Status, ToDevice, ToHost, encode};
use crate::faults::Faults;
use crate::pipeline::alert::{DailyLoad, MAX_SNOOZE_S};
use crate::pipeline::baseline::ZeroResult;
use crate::sequence;
pub use configuration::{CLOCK_US, ToInsole};
use heapless::{Deque, Vec};

/// Number of live frames that can wait for the carrier.
pub const LIVE_QUEUE: usize = 8;
/// Number of load records that are held in RAM until they are acknowledged.
pub const RECORD_QUEUE: usize = 6;
/// Answers that can wait for the carrier: at least as many as the requests that one read of the carrier can complete. Further
/// requests are not answered.
pub const ANSWER_QUEUE: usize = 16;

/// The state of the session, and the queues of messages to send.
#[derive(Debug)]
pub struct Session {
    /// A host of this major version is connected.
    is_open: bool,
    is_hello_due: bool,
    answers: Deque<Answer, ANSWER_QUEUE>,
    /// Number of live frames that were sent since `answers` was last empty.
    live_before_answer: u8,
    is_streaming: bool,
    live: Deque<Vec<u8, MAX_LIVE>, LIVE_QUEUE>,
    /// Number of live frames that were due in this session, which is also the sequence number of the next one.
    live_due: u32,
    /// Number of live frames that were passed to the carrier in this session.
    live_sent: u32,
    records: Deque<LoadRecord, RECORD_QUEUE>,
    /// Number of `records`, from the front, that were sent in this session.
    records_sent: usize,
    records_dropped: u32,
    /// Number of the last acknowledged record, until [`Session::take_acknowledged`].
    acknowledged: Option<u32>,
    command: Option<Command>,
    /// The host that requested the pending command is still connected, as far as the carrier shows.
    is_command_of_session: bool,
    configured: Configured,
    /// The parameters are new, and no frame was evaluated with them yet.
    is_tissue_due: bool,
    cells: CellSender,
    /// The stream of ellipses. Its messages wait until the carrier has sent everything else.
    pub ellipses: EllipseSender,
    faults: Faults,
    daily: DailyLoad,
    to_insole: ToInsole,
    /// The host of this session has requested that the baselines are measured.
    is_zero_awaited: bool,
    /// The result of the last such measurement that was not refused; `None` before it.
    zeroed: Option<ZeroResult>,
    /// The wall clock, us since 1970, minus the device's time, us; `None` until the clock is set.
    unix_offset_us: Option<u64>,
    clock_sets: u32,
}

impl Session {
    /// No session, nothing to send.
    pub const fn new() -> Self {
        Self {
            is_open: false,
            is_hello_due: false,
            answers: Deque::new(),
            live_before_answer: 0,
            is_streaming: false,
            live: Deque::new(),
            live_due: 0,
            live_sent: 0,
            records: Deque::new(),
            records_sent: 0,
            records_dropped: 0,
            acknowledged: None,
            command: None,
            is_command_of_session: false,
            configured: Configured::NONE,
            is_tissue_due: false,
            cells: CellSender::new(),
            ellipses: EllipseSender::new(),
            faults: Faults::NONE,
            daily: DailyLoad::NONE,
            to_insole: ToInsole::NONE,
            is_zero_awaited: false,
            zeroed: None,
            unix_offset_us: None,
            clock_sets: 0,
        }
    }

    /// Receives a message of the host, which arrived at `now_us` of the device's time.
    #[inline]
    pub fn receive(&mut self, message: ToDevice, now_us: u64) {
        match message {
            ToDevice::Connect { major, .. } => {
                // A host may connect again within its session, and still expects the answer to its request.
                self.reset();
                self.is_open = major == MAJOR;
                self.is_hello_due = true;
            }
            _ if !self.is_open => {}
            ToDevice::Stream { live } => {
                self.is_streaming = live;
                if !live {
                    self.live.clear();
                }
            }
            ToDevice::Acknowledge { number } => {
                // Only a record that was sent can have arrived.
                while self.records_sent > 0
                    && let Some(arrived) = self.records.pop_front_if(|sent| !sequence::is_after(sent.number(), number))
                {
                    self.acknowledged = Some(arrived.number());
                    self.records_sent -= 1;
                }
            }
            ToDevice::GetStatus => self.answer(Answer::Status),
            ToDevice::GetTissue => self.answer(Answer::Tissue),
            ToDevice::GetTime { host_us } => self.answer(Answer::Time { host_us, device_us: now_us }),
            ToDevice::SetClock { unix_us } => {
                if !self.set_clock(unix_us, now_us) {
                    self.answer(Answer::Refused(Refusal::Clock));
                }
            }
            ToDevice::GetFaults => self.answer(Answer::Faults),
            ToDevice::GetIdentity => self.answer(Answer::Identity),
            ToDevice::StreamCells(stream) => {
                self.cells.start(stream);
                self.answer(Answer::CellStream(stream));
            }
            // Without a layout, the insole evaluates no frames.
            ToDevice::GetSetup | ToDevice::GetSetupCells { .. } | ToDevice::Zero | ToDevice::SnoozeAlerts { .. }
                if self.configured.layout.is_none() =>
            {
                self.answer(Answer::Refused(Refusal::NoLayout));
            }
            ToDevice::Zero => (self.to_insole.zero, self.is_zero_awaited) = (true, true),
            ToDevice::StreamEllipses { every } => {
                let period_us = self.setup().map(|setup| setup.period_us);
                if let Err(refusal) = self.ellipses.start(every, period_us) {
                    self.answer(Answer::Refused(refusal));
                }
            }
            ToDevice::GetSetup => self.answer(Answer::Setup),
            ToDevice::GetSetupCells { first } => self.answer(Answer::SetupCells(first)),
            ToDevice::GetSettings => self.answer(Answer::Settings),
            ToDevice::GetIdentified => self.answer(Answer::Identified),
            ToDevice::GetAlertRules => self.answer(Answer::AlertRules),
            ToDevice::GetDailyLoad => self.answer(Answer::DailyLoad),
            ToDevice::SnoozeAlerts { snoozed_s } => {
                self.to_insole.snooze_s = Some(snoozed_s.min(MAX_SNOOZE_S));
                self.to_insole.is_load_awaited = true;
            }
            request => match Command::of(&request, self.setup().map(|setup| setup.contact)) {
                Some(Ok(command)) => self.begin(command),
                Some(Err(refusal)) => self.answer(Answer::Refused(refusal)),
                None => {}
            },
        }
    }

    /// Makes a command the pending one; refuses it if another command is pending.
    fn begin(&mut self, command: Command) {
        match self.command {
            None => (self.command, self.is_command_of_session) = (Some(command), true),
            Some(_) => self.answer(Answer::Refused(Refusal::Busy)),
        }
    }

    /// The pending command, until [`Session::complete`].
    pub fn command(&self) -> Option<Command> {
        self.command
    }

    /// Completes the pending command with its result, and queues the answer, unless the carrier of the host that requested it was
    /// lost: another host would take the result for the answer to a request of its own. New parameters and rules of alerts are
    /// announced to any host.
    pub fn complete(&mut self, result: Result<CommandResult, Refusal>) {
        let Some(command) = self.command.take() else { return };
        // Parameters and rules that could not be stored are in force until the insole restarts.
        if let Ok(_) | Err(Refusal::NotStored) = result {
            match command {
                Command::Tissue(tissue, identified) => {
                    (self.configured.tissue, self.configured.identified) = (tissue, identified);
                    self.is_tissue_due = true;
                }
                Command::AlertRules(rules) => self.set_alert_rules(rules),
                _ => {}
            }
        }
        let answer = match (result, command) {
            (Ok(_) | Err(Refusal::NotStored), Command::Tissue(..)) => {
                Answer::NewTissue { is_stored: result.is_ok() || !self.is_command_of_session }
            }
            (Err(Refusal::NotStored), Command::AlertRules(_)) if !self.is_command_of_session => Answer::AlertRules,
            (Err(refusal), _) => Answer::Refused(refusal),
            (Ok(CommandResult::Update(progress)), _) => Answer::Update(progress),
            (Ok(CommandResult::Identity(identity)), _) => {
                self.configured.identity = identity;
                Answer::Identity
            }
            (Ok(CommandResult::Stored), Command::CalibrationBlock(block, _)) => Answer::CalibrationBlock(block),
            (Ok(CommandResult::Stored), Command::Settings(settings)) => {
                self.configured.settings = settings;
                Answer::Settings
            }
            (Ok(CommandResult::Stored), Command::AlertRules(_)) => Answer::AlertRules,
            (Ok(CommandResult::Stored), _) => Answer::Tissue,
        };
        if self.is_command_of_session || matches!(answer, Answer::NewTissue { .. } | Answer::AlertRules) {
            self.answer(answer);
        }
    }

    /// Answers a request with a refusal.
    pub fn refuse(&mut self, refusal: Refusal) {
        self.answer(Answer::Refused(refusal));
    }

    /// Receives a frame that arrived intact and contains no known message.
    pub fn receive_unknown(&mut self) {
        self.refuse(Refusal::NotUnderstood);
    }

    fn answer(&mut self, answer: Answer) {
        // Without a session no host receives an answer, and new parameters must not wait for their announcement.
        if !self.is_open {
            return;
        }
        if self.answers.is_empty() {
            self.live_before_answer = 0;
        }
        let _ = self.answers.push_back(answer);
    }

    /// True while a host is connected.
    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// Ends the session, as after the loss of the carrier: all streams end; records, parameters and the clock remain.
    pub fn close(&mut self) {
        self.reset();
        self.is_command_of_session = false;
    }

    /// Resets what belongs to a session, except that its host may still expect the answer to the pending command.
    fn reset(&mut self) {
        // Field by field, because a whole new session would be composed on the stack.
        (self.is_open, self.is_hello_due, self.is_streaming) = (false, false, false);
        self.answers.clear();
        self.live.clear();
        (self.live_before_answer, self.live_due, self.live_sent) = (0, 0, 0);
        self.records_sent = 0;
        self.cells.start(None);
        self.ellipses = EllipseSender::new();
        (self.to_insole.zero, self.is_zero_awaited, self.to_insole.is_load_awaited) = (false, false, false);
    }

    /// The sequence number of the next live frame; `None` if no host receives the stream.
    pub fn next_live(&self) -> Option<u32> {
        (self.is_open && self.is_streaming).then_some(self.live_due)
    }

    /// Encodes and queues the live frame with the number that [`Session::next_live`] returned; a full queue drops its oldest
    /// frame.
    // Inlined into the data path, which saves 3 % of a frame's instructions.
    #[inline(always)]
    pub fn push_live(&mut self, live: Live) {
        self.live_due = self.live_due.wrapping_add(1);
        if self.live.is_full() {
            self.live.pop_front();
        }
        // The message is encoded in its place in the queue, which now has room for it.
        let _ = self.live.push_back(Vec::new());
        if let Some(message) = self.live.back_mut() {
            // `ToHost::Live`, without the code that encodes the other messages. This cannot fail: a live frame has at most
            // MAX_LIVE bytes by its field types.
            let _ = append(&(ToHost::LIVE, live), message);
        }
    }

    /// True while a host receives all cells.
    pub fn streams_cells(&self) -> bool {
        self.cells.is_running()
    }

    /// Packs and queues the codes of a scan for a host that receives all cells.
    pub fn push_cells(&mut self, scan: u32, codes: &[u16]) {
        self.cells.push(scan, codes);
    }

    /// Holds a record until it is acknowledged; a full queue drops and counts its oldest record.
    pub fn push_record(&mut self, record: impl Into<LoadRecord>) {
        if self.records.is_full() {
            self.records.pop_front();
            self.records_sent = self.records_sent.saturating_sub(1);
            self.count_dropped(1);
        }
        let _ = self.records.push_back(record.into());
    }

    /// The next message to send, encoded into `buffer` of at least [`MAX_MESSAGE`](super::MAX_MESSAGE) bytes; `None` if there
    /// is none. The hello comes first, then records, live frames, answers in the order of their requests, frames of cells, and
    /// ellipses. On a carrier that is too slow for the live stream, at most [`LIVE_QUEUE`] live frames precede an answer.
    pub fn next<'b>(
        &mut self,
        hello: &Hello,
        status: impl FnOnce() -> Status,
        buffer: &'b mut [u8],
    ) -> Option<&'b [u8]> {
        let message = if core::mem::take(&mut self.is_hello_due) {
            ToHost::Hello(Hello { tissue_id: self.configured.tissue.id, ..hello.clone() })
        } else if let Some(record) = self.records.iter().nth(self.records_sent).filter(|_| self.is_open) {
            self.records_sent += 1;
            ToHost::from(*record)
        } else if let Some(live) =
            self.live.pop_front_if(|_| self.answers.is_empty() || self.live_before_answer < LIVE_QUEUE as u8)
        {
            self.live_before_answer = self.live_before_answer.saturating_add(1);
            self.live_sent = self.live_sent.wrapping_add(1);
            let out = buffer.get_mut(..live.len())?;
            out.copy_from_slice(&live);
            return Some(out);
        } else if self.answers.is_empty() {
            // Frames of cells and ellipses wait for all other messages.
            match self.cells.pop(&mut *buffer).map(|out| out.len()) {
                Some(len) => return buffer.get(..len),
                None => ToHost::Ellipses(self.ellipses.pop()?),
            }
        } else {
            let answer = self.answers.pop_front()?;
            if answer.is_announcement() {
                // Queued live frames used the previous parameters.
                self.live.clear();
            }
            match answer {
                Answer::Status => ToHost::Status(Status {
                    // Queued frames may still arrive.
                    live_due: self.live_due.wrapping_sub(self.live.len() as u32),
                    live_sent: self.live_sent,
                    records_dropped: self.records_dropped,
                    faults: self.faults.found,
                    rezeroed: self.faults.rezeroed,
                    is_clock_set: self.unix_offset_us.is_some(),
                    ..status()
                }),
                Answer::Tissue | Answer::NewTissue { is_stored: true } => ToHost::Tissue(self.configured.tissue),
                Answer::NewTissue { is_stored: false } => ToHost::Refused(Refusal::NotStored),
                Answer::Refused(refusal) => ToHost::Refused(refusal),
                Answer::Faults => ToHost::Faults(self.faults.clone()),
                Answer::Time { host_us, device_us } => ToHost::Time { host_us, device_us },
                Answer::Identity => ToHost::Identity(self.configured.identity),
                Answer::CalibrationBlock(block) => ToHost::CalibrationBlock { block },
                Answer::Update(progress) => ToHost::Update(progress),
                Answer::CellStream(stream) => ToHost::CellStream(stream),
                Answer::Setup => ToHost::Setup(self.configured.layout?.0),
                Answer::SetupCells(first) => {
                    let from_first = self.configured.layout?.1.get(usize::from(first)..).unwrap_or_default();
                    let cells = from_first.iter().copied().take(SETUP_CELLS).collect();
                    ToHost::SetupCells { first, cells }
                }
                Answer::Settings => ToHost::Settings(self.configured.settings),
                Answer::Identified => ToHost::Identified(self.configured.identified),
                Answer::AlertRules => ToHost::AlertRules(self.configured.alert_rules),
                Answer::DailyLoad => ToHost::DailyLoad(self.daily),
                Answer::Zero => ToHost::Zero(self.zeroed?),
            }
        };
        // Every message fits into MAX_MESSAGE bytes.
        encode(&message, buffer).ok().map(|used| &*used)
    }
}

impl Default for Session {
    fn default() -> Self {
        Self::new()
    }
}

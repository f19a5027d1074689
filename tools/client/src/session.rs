//! The host's side of a session: sends and receives messages, delivers each step, load bout and alert once, and counts live
//! frames.

use crate::counters::LinkCounters;
use crate::delivered::Delivered;
use crate::order::{Arrival, RecordOrder};
use crate::{Carrier, ClockMapping, Error};
use plantar::protocol::session::CLOCK_US;
use plantar::protocol::{CellStream, Hello, LiveCounter, LoadRecord, MAJOR, MINOR, Refusal, Status, ToDevice, ToHost};
use plantar::sequence::is_after;
use std::collections::VecDeque;
use std::io;
use std::time::Duration;

/// Time within which an insole must answer a request that has no longer timeout of its own.
pub(crate) const ANSWER: Duration = Duration::from_secs(2);
/// Time between two connect requests while the insole does not answer.
const CONNECT_INTERVAL: Duration = Duration::from_millis(500);
/// Time after which the last acknowledgement is sent again. It may have been lost on the way: an insole that has sent as many
/// records as it sends without an acknowledgement then sends no further ones, so that no later acknowledgement would follow.
const REPEAT_ACKNOWLEDGEMENT: Duration = Duration::from_secs(2);
/// If the caller has not read the carrier for this time, messages may have been lost: the operating system stores only some
/// thousand bytes of a serial port. A lost record is noticed by the next one, but the lost records may be all that the insole
/// sends before an acknowledgement.
const PAUSE: Duration = Duration::from_secs(2);
/// Time between two requests for the insole's time.
const TIME_INTERVAL: Duration = Duration::from_millis(250);
/// If the wall clock gains or loses more than this relative to the monotonic clock between two such requests, us, it was set.
const CLOCK_STEP_US: u64 = 500_000;

/// The host's side of a session with an insole.
pub struct Client<C> {
    /// `None` between closing one carrier and opening the next one.
    carrier: Option<C>,
    /// Number of damaged frames that arrived over earlier carriers.
    damaged_before: u32,
    /// Messages that arrived while a request waited for its answer, and that [`Client::receive`] will return.
    pub(crate) waiting: VecDeque<ToHost>,
    pub(crate) hello: Hello,
    /// Number of live frames that the insole sent, by the last status that [`Client::receive`] returned.
    frames_sent: u32,
    live: LiveCounter,
    clock_mapping: ClockMapping,
    /// When the insole's time was last requested, by [`Carrier::now_us`].
    time_requested_us: Option<u64>,
    /// The wall clock at the time 0 of [`Carrier::now_us`], us since 1970, as computed at the last request for the insole's time.
    wall_clock_us: u64,
    /// When the client last detected that the wall clock was set, us since 1970 by the new clock; 0 if never. Answers to requests
    /// from before that time are not used.
    wall_clock_since_us: u64,
    delivered: Delivered,
    order: RecordOrder,
    /// The last number that was acknowledged in this session, and when, by [`Carrier::now_us`].
    acknowledged: Option<(u32, u64)>,
    /// When the carrier was last read, by [`Carrier::now_us`].
    read_us: u64,
    /// The wall clock after the carrier was not read for [`PAUSE`] in this session, us since 1970. The records are requested
    /// again once the insole has answered a later request for its time. Until then another host may have the session, which a
    /// connect request would end.
    paused_until_us: Option<u64>,
    is_streaming: bool,
    /// The stream of ellipses: the ellipses of one frame out of this number, or 0 for none.
    pub(crate) ellipses_every: u8,
    /// The stream of cells.
    pub(crate) cells: Option<CellStream>,
    /// When a retransmission requested the stream of cells again, by [`Carrier::now_us`]; `None` once the insole has answered.
    pub(crate) cells_requested_us: Option<u64>,
}

impl<C: Carrier> Client<C> {
    /// Opens a session: sends a connect request twice a second until the insole answers with its hello.
    ///
    /// # Errors
    /// [`Error::NoAnswer`] if the insole does not answer within `patience`; [`Error::Closed`]; [`Error::OtherVersion`]; errors of
    /// the carrier.
    pub fn connect(mut carrier: C, patience: Duration) -> Result<Self, Error> {
        let hello = open_session(&mut carrier, patience)?;
        Ok(Self {
            carrier: Some(carrier),
            damaged_before: 0,
            waiting: VecDeque::new(),
            hello,
            frames_sent: 0,
            live: LiveCounter::NEW,
            clock_mapping: ClockMapping::new(),
            time_requested_us: None,
            wall_clock_us: wall_clock_us::<C>(),
            wall_clock_since_us: 0,
            delivered: Delivered::new(),
            order: RecordOrder::default(),
            acknowledged: None,
            read_us: C::now_us(),
            paused_until_us: None,
            is_streaming: false,
            ellipses_every: 0,
            cells: None,
            cells_requested_us: None,
        })
    }

    /// Opens the session again over the same carrier, as after a silence, and returns the insole's new hello. All streams are
    /// off.
    ///
    /// # Errors
    /// As [`Client::connect`].
    pub fn reconnect(&mut self, patience: Duration) -> Result<&Hello, Error> {
        let hello = open_session(carrier(&mut self.carrier)?, patience)?;
        self.begin(hello);
        Ok(&self.hello)
    }

    /// As [`Client::reconnect`], over another carrier after one failed.
    ///
    /// # Errors
    /// As [`Client::connect`], and those of `open`.
    pub fn reconnect_over(
        &mut self,
        open: impl FnOnce() -> Result<C, Error>,
        patience: Duration,
    ) -> Result<&Hello, Error> {
        // The old carrier is closed first: a serial port has one user, and closing a Bluetooth link later would close the new one
        // too.
        self.close();
        self.carrier = Some(open()?);
        self.reconnect(patience)
    }

    /// Closes the carrier. Until another one follows, messages cannot be sent or received.
    pub(crate) fn close(&mut self) {
        self.damaged_before = self.damaged();
        self.carrier = None;
        self.waiting.clear();
        self.acknowledged = None;
    }

    /// Continues over another carrier after [`Client::close`]. `hello` is the answer to a connect request that was sent over this
    /// carrier, if one was sent.
    pub(crate) fn continue_over(&mut self, carrier: C, hello: Option<Hello>) {
        self.carrier = Some(carrier);
        if let Some(hello) = hello {
            self.begin(hello);
        }
    }

    /// Begins a session, which the insole has answered with this hello.
    fn begin(&mut self, hello: Hello) {
        self.hello = hello;
        self.waiting.clear();
        self.clock_mapping = ClockMapping::new();
        self.live.new_session();
        (self.is_streaming, self.ellipses_every, self.cells, self.cells_requested_us) = (false, 0, None, None);
        (self.acknowledged, self.read_us, self.paused_until_us) = (None, C::now_us(), None);
        self.order.begin();
    }

    /// The insole's hello.
    pub fn hello(&self) -> &Hello {
        &self.hello
    }

    /// Sets the insole's clock, requests its time, and turns the live stream on. Returns the status of the insole after the
    /// request for the stream. [`Client::receive`] returns other messages that arrive meanwhile.
    ///
    /// # Errors
    /// [`Error::LostAnswer`]; [`Error::Refused`]; errors of the carrier.
    pub fn stream(&mut self) -> Result<Status, Error> {
        self.set_clock()?;
        self.device_us()?;
        self.send(ToDevice::Stream { live: true })?;
        self.status()
    }

    /// Sends a request and waits for the message for which `answer` returns a value. [`Client::receive`] returns other messages
    /// that arrive meanwhile.
    pub(crate) fn request<T>(&mut self, request: ToDevice, answer: impl Fn(&ToHost) -> Option<T>) -> Result<T, Error> {
        self.request_within(ANSWER, request, answer)
    }

    pub(crate) fn request_within<T>(
        &mut self,
        patience: Duration,
        request: ToDevice,
        answer: impl Fn(&ToHost) -> Option<T>,
    ) -> Result<T, Error> {
        self.send(request)?;
        let sent_us = C::now_us();
        let mut meanwhile = Vec::new();
        let result = loop {
            if elapsed::<C>(sent_us) >= patience {
                break Err(Error::LostAnswer(patience, self.damaged()));
            }
            match self.next() {
                Err(error) => break Err(error),
                Ok(Some(ToHost::Refused(refusal))) => break Err(Error::Refused(refusal)),
                // The connect request may have been sent twice, so a second hello may arrive. A retransmission that was requested
                // begins with its hello.
                Ok(Some(ToHost::Hello(_))) if self.order.requested_us().is_none() => {}
                Ok(None) => {}
                Ok(Some(message)) => match answer(&message) {
                    Some(answer) => break Ok(answer),
                    None => meanwhile.push(message),
                },
            }
        };
        for message in meanwhile.into_iter().rev() {
            self.waiting.push_front(message);
        }
        result
    }

    /// To be called instead of sending an acknowledgement of this record and all earlier ones, if the session may now be with
    /// another insole, to which the number means another record. If the insole repeats these records, they are acknowledged.
    pub fn mark_stored(&mut self, number: u32) {
        self.delivered.acknowledge(number);
    }

    /// Number of damaged frames on all carriers.
    pub(crate) fn damaged(&self) -> u32 {
        self.damaged_before.wrapping_add(self.carrier.as_ref().map_or(0, Carrier::damaged))
    }

    /// Sends a message.
    ///
    /// # Errors
    /// Errors of the carrier.
    pub fn send(&mut self, message: ToDevice) -> Result<(), Error> {
        match message {
            // This holds even if the message is lost on the way: the host has stored the record.
            ToDevice::Acknowledge { number } => {
                self.delivered.acknowledge(number);
                let last = self.acknowledged.map(|(last, _)| last).filter(|&last| is_after(last, number));
                self.acknowledged = Some((last.unwrap_or(number), C::now_us()));
            }
            ToDevice::Stream { live } => self.is_streaming = live,
            ToDevice::StreamEllipses { every } => self.ellipses_every = every,
            ToDevice::StreamCells(stream) => self.cells = stream,
            _ => {}
        }
        Ok(carrier(&mut self.carrier)?.send(message)?)
    }

    /// Forgets which of the unacknowledged records [`Client::receive`] has returned, so that it returns each of them once more if
    /// the insole repeats it. To be called when a session has started, by a program that acknowledges a record only in a session
    /// in which it has arrived.
    pub fn forget_unacknowledged(&mut self) {
        self.delivered.forget_unacknowledged();
    }

    /// Converts between the insole's clock and this computer's, us since 1970, UTC. Every call of [`Client::receive`] can refine
    /// it.
    pub fn clock_mapping(&self) -> &ClockMapping {
        &self.clock_mapping
    }

    /// Requests the insole's time, us since its first scan, which [`Client::clock_mapping`] uses, too.
    ///
    /// # Errors
    /// [`Error::LostAnswer`]; [`Error::Refused`]; errors of the carrier.
    pub fn device_us(&mut self) -> Result<u64, Error> {
        let request = ToDevice::GetTime { host_us: C::unix_us() };
        let (host_us, device_us) = self.request(request, |message| match *message {
            ToHost::Time { host_us, device_us } => Some((host_us, device_us)),
            _ => None,
        })?;
        self.relate_clocks(host_us, device_us);
        Ok(device_us)
    }

    fn request_time_if_due(&mut self) -> Result<(), Error> {
        if self.time_requested_us.is_none_or(|requested_us| elapsed::<C>(requested_us) >= TIME_INTERVAL) {
            self.time_requested_us = Some(C::now_us());
            self.follow_wall_clock()?;
            self.send(ToDevice::GetTime { host_us: C::unix_us() })?;
        }
        Ok(())
    }

    /// If the wall clock was set, relates the insole's clock to it from the start again, and sets the insole's wall clock if the
    /// live stream is on.
    fn follow_wall_clock(&mut self) -> Result<(), Error> {
        let before_us = std::mem::replace(&mut self.wall_clock_us, wall_clock_us::<C>());
        if self.wall_clock_us.abs_diff(before_us) <= CLOCK_STEP_US {
            return Ok(());
        }
        self.clock_mapping = ClockMapping::new();
        self.wall_clock_since_us = C::unix_us();
        if self.is_streaming { self.set_clock() } else { Ok(()) }
    }

    /// Uses the answer to a request for the insole's time, unless the wall clock was set since the request.
    fn relate_clocks(&mut self, host_us: u64, device_us: u64) {
        if (self.wall_clock_since_us..=C::unix_us()).contains(&host_us) {
            self.clock_mapping.answer(host_us, device_us);
        }
    }

    fn set_clock(&mut self) -> Result<(), Error> {
        // The clock of this host may never have been set. An insole refuses times outside of this range.
        if CLOCK_US.contains(&C::unix_us()) {
            self.send(ToDevice::SetClock { unix_us: C::unix_us() })?;
        }
        Ok(())
    }

    /// The next message for the caller. `None` if none arrived within the carrier's timeout, or if this function handled the
    /// message itself: the insole's time, a repeated record, a record after a gap, or the hello of a requested retransmission.
    /// Requests the insole's time four times a second, for [`Client::clock_mapping`].
    ///
    /// Each record (step, load bout or alert) is returned once, however often the insole repeats it. Send
    /// [`ToDevice::Acknowledge`] once the record is stored; if the insole repeats the record afterwards, this function
    /// acknowledges it again. If a record before the one that arrives is missing, this function requests all unacknowledged
    /// records again, because an acknowledgement also covers all earlier records. It also requests them if the carrier was not
    /// read for two seconds, and repeats the last acknowledgement every two seconds.
    ///
    /// # Errors
    /// Errors of the carrier.
    pub fn receive(&mut self) -> Result<Option<ToHost>, Error> {
        self.request_time_if_due()?;
        if self.order.requested_us().is_some_and(|requested_us| elapsed::<C>(requested_us) >= ANSWER) {
            // The request for the retransmission, or its answer, was lost on the way.
            self.request_retransmission()?;
        }
        if let Some((number, sent_us)) = self.acknowledged
            && elapsed::<C>(sent_us) >= REPEAT_ACKNOWLEDGEMENT
        {
            self.send(ToDevice::Acknowledge { number })?;
        }
        if self.cells_requested_us.is_some_and(|requested_us| elapsed::<C>(requested_us) >= ANSWER) {
            self.request_cells_again()?;
        }
        let Some(message) = self.next()? else { return Ok(None) };
        if let Some(record) = LoadRecord::of(&message) {
            return Ok(self.deliver(&record)?.then_some(message));
        }
        match &message {
            ToHost::Time { host_us, device_us } => {
                self.relate_clocks(*host_us, *device_us);
                if self.paused_until_us.take_if(|paused_us| *host_us >= *paused_us).is_some() {
                    self.request_retransmission()?;
                }
                return Ok(None);
            }
            ToHost::Live(live) => self.live.frame(live.sequence),
            ToHost::Status(status) => {
                self.frames_sent = status.live_sent;
                // A status follows all frames that its `live_due` counts.
                self.live.due(status.live_due);
                // No frame was due in this session: the request for the stream may have been lost on the way.
                if self.is_streaming && status.live_due == 0 {
                    self.send(ToDevice::Stream { live: true })?;
                }
            }
            ToHost::CellStream(_) => self.cells_requested_us = None,
            ToHost::Hello(_) => {
                self.live.new_session();
                self.acknowledged = None;
                if self.order.begin() {
                    return Ok(None);
                }
            }
            ToHost::Refused(Refusal::OtherHost) => {
                self.order.interrupt();
                self.paused_until_us = None;
            }
            // Answers are matched with their requests by `Client::request`.
            _ => {}
        }
        Ok(Some(message))
    }

    /// True if a record that arrives is to be delivered to the caller.
    fn deliver(&mut self, record: &LoadRecord) -> Result<bool, Error> {
        let delivered = self.delivered.is_acknowledged(record);
        if delivered.is_some() {
            self.order.repeat(record.number());
        }
        match delivered {
            // The insole did not receive the acknowledgement, and would repeat the record without end.
            Some(true) => self.send(ToDevice::Acknowledge { number: record.number() })?,
            Some(false) => {}
            None => match self.order.arrive(record.number(), self.damaged()) {
                Arrival::InOrder => {
                    self.delivered.push(*record);
                    return Ok(true);
                }
                Arrival::Awaited => {}
                Arrival::Gap => self.request_retransmission()?,
            },
        }
        Ok(false)
    }

    /// Requests to open the session again, so that the insole sends its records from the oldest unacknowledged one on. This ends
    /// all streams, so they are requested again.
    fn request_retransmission(&mut self) -> Result<(), Error> {
        self.order.request(C::now_us(), self.damaged());
        self.send(ToDevice::Connect { major: MAJOR, minor: MINOR })?;
        if self.is_streaming {
            self.send(ToDevice::Stream { live: true })?;
        }
        if self.ellipses_every > 0 {
            self.send(ToDevice::StreamEllipses { every: self.ellipses_every })?;
        }
        self.request_cells_again()
    }

    /// Requests the stream of cells again if it was on, until the insole answers.
    fn request_cells_again(&mut self) -> Result<(), Error> {
        let Some(stream) = self.cells else {
            self.cells_requested_us = None;
            return Ok(());
        };
        self.cells_requested_us = Some(C::now_us());
        self.send(ToDevice::StreamCells(Some(stream)))
    }

    pub(crate) fn next(&mut self) -> Result<Option<ToHost>, Error> {
        if let Some(message) = self.waiting.pop_front() {
            return Ok(Some(message));
        }
        if elapsed::<C>(self.read_us) >= PAUSE {
            self.paused_until_us = Some(C::unix_us());
        }
        let message = carrier(&mut self.carrier)?.receive()?;
        self.read_us = C::now_us();
        Ok(message)
    }

    /// The counters of this link. The number of sent frames, and losses before the first or after the last received frame, are
    /// those of the last status that [`Client::receive`] returned: send [`ToDevice::GetStatus`] first. The result of
    /// [`Client::status`] does not update them.
    pub fn counters(&self) -> LinkCounters {
        LinkCounters {
            frames_sent: self.frames_sent,
            frames_received: self.live.received,
            frames_lost: self.live.lost,
            crc_errors: self.damaged(),
        }
    }
}

/// Time since `since_us` by the carrier's clock.
pub(crate) fn elapsed<C: Carrier>(since_us: u64) -> Duration {
    Duration::from_micros(C::now_us().saturating_sub(since_us))
}

/// The carrier, or an error if none is open.
fn carrier<C>(carrier: &mut Option<C>) -> io::Result<&mut C> {
    carrier.as_mut().ok_or_else(|| io::ErrorKind::NotConnected.into())
}

/// Sends connect requests until the insole answers with its hello.
pub(crate) fn open_session<C: Carrier>(carrier: &mut C, patience: Duration) -> Result<Hello, Error> {
    request_hello(carrier, patience).map_err(|error| match error {
        Error::Carrier(error) if is_closed(&error) => Error::Closed(error),
        error => error,
    })
}

/// True if the other end of the link has closed it.
fn is_closed(error: &io::Error) -> bool {
    use io::ErrorKind::{BrokenPipe, ConnectionAborted, ConnectionReset, UnexpectedEof};
    matches!(error.kind(), UnexpectedEof | ConnectionReset | ConnectionAborted | BrokenPipe)
}

fn request_hello<C: Carrier>(carrier: &mut C, patience: Duration) -> Result<Hello, Error> {
    let start_us = C::now_us();
    while elapsed::<C>(start_us) < patience {
        carrier.send(ToDevice::Connect { major: MAJOR, minor: MINOR })?;
        let sent_us = C::now_us();
        while elapsed::<C>(sent_us) < CONNECT_INTERVAL && elapsed::<C>(start_us) < patience {
            // Messages before the hello belong to an earlier session and are ignored.
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

/// The wall clock at the time 0 of [`Carrier::now_us`], us since 1970.
fn wall_clock_us<C: Carrier>() -> u64 {
    C::unix_us().wrapping_sub(C::now_us())
}

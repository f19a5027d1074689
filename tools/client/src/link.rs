//! A session that is opened again after its link was lost: how long to wait, when to try again, when to give up.

use crate::session::open_session;
use crate::{Carrier, Client, Error, READ_TIMEOUT};
use plantar::protocol::{Hello, Refusal, Status, ToDevice, ToHost};
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

/// How long to wait for an insole, and when to try again and to give up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReconnectPolicy {
    /// Time within which an insole must answer a connect request over a newly opened carrier.
    pub answer: Duration,
    /// Time within which a silent insole must answer a connect request over the carrier in use; otherwise the carrier is opened
    /// again.
    pub probe: Duration,
    /// Longest time without a message for the caller (see [`Client::receive`]), not counting cells and ellipses, while the live
    /// stream is on. The answers to the requests for the time do not count either. After a longer silence the insole may have
    /// restarted, so a connect request is sent.
    pub silence: Duration,
    /// Time between two attempts.
    pub retry: Duration,
    /// Time without success after which the link is given up; `None` to try without end.
    pub give_up: Option<Duration>,
}

impl ReconnectPolicy {
    /// For a live stream, which continues as soon as the insole returns: the insole may be switched off for hours.
    pub const STREAM: Self = Self {
        answer: Duration::from_secs(5),
        probe: Duration::from_secs(5),
        silence: Duration::from_secs(2),
        retry: Duration::from_secs(1),
        give_up: None,
    };

    /// For an insole that restarts, on request or to install an update. The bootloader of a real board is expected to need some
    /// 12 s (`wb55`) or less than 30 s (`nrf52840`) to install an image (`docs/bring-up.md`).
    pub const RESTART: Self = Self {
        probe: Duration::from_secs(1),
        retry: Duration::from_millis(500),
        give_up: Some(Duration::from_secs(60)),
        ..Self::STREAM
    };
}

/// Opens a carrier to an insole. After the loss of a link, it is called on another thread.
pub type Open<C> = Arc<dyn Fn() -> Result<C, Error> + Send + Sync>;

/// Receives the result of an attempt to open a lost link again: the new carrier and, if a connect request was sent over it, the
/// answer.
type Attempt<C> = Receiver<Result<(C, Option<Hello>), Error>>;

/// A session that is opened again after its link was lost.
pub struct Link<C> {
    client: Client<C>,
    open: Open<C>,
    policy: ReconnectPolicy,
    state: State,
    /// The present attempt to open the lost link again.
    attempt: Option<Attempt<C>>,
    /// A message could not be sent, or a request had no answer; the next event reports it.
    failure: Option<Error>,
    /// The status at the start of this session.
    status: Option<Status>,
    /// See [`Link::meanwhile`].
    meanwhile: Meanwhile,
}

enum State {
    /// The insole answered a connect request; the live stream was not requested yet.
    Open(SessionStart),
    Streaming {
        last_message: Instant,
        /// Another host has the session, and the insole refuses the messages of this host. A connect request would end the
        /// session of that host, so this host sends one only after the insole has stopped answering, which means that the other
        /// session has ended.
        is_superseded: bool,
        /// Since when the link is lost, if the carrier was opened again during the session of another host, and no message has
        /// arrived over it yet.
        lost_since: Option<Instant>,
    },
    Lost {
        since: Instant,
        /// Another host had the session when the carrier failed. The new carrier is opened without a connect request, which would
        /// end the session of that host.
        is_superseded: bool,
    },
}

/// Why a session started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SessionStart {
    /// It is the first one.
    Connected,
    /// The insole was silent, and answered a connect request over the same carrier. It may have restarted.
    AfterSilence,
    /// The carrier was opened again. The insole may have restarted, or be another one.
    Reconnected,
    /// Another host had taken the session, and has ended it or was silent for too long.
    AfterOtherHost,
}

/// What the insole has done from the start of the previous session to that of this one, by its status at both times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meanwhile {
    /// It has restarted.
    Restarted,
    /// It has neither restarted nor processed a frame: its matrix does not answer.
    NoFrames,
    /// It has processed frames, and has not restarted. Also the value in the first session.
    Frames,
}

/// The result of [`Link::next_event`].
#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "events exist one at a time")]
pub enum Event {
    /// A session started, and its live stream is on; [`Client::hello`] returns the hello of this session.
    Started(SessionStart),
    /// A message arrived.
    Message(ToHost),
    /// No message for the caller arrived (see [`Client::receive`]); the insole refused a further message, because another host
    /// has the session; the link is still lost; or it was just opened again. In the last case, the next event is
    /// [`Event::Started`], or [`Event::Lost`] if the live stream cannot be requested, unless another host has the session.
    Timeout,
    /// The session ended for this reason. The next calls open it again. If it ended with [`Refusal::OtherHost`], they first wait
    /// until the session of the other host has ended, also if the carrier fails meanwhile. For this, the caller only needs to
    /// continue to call [`Link::next_event`], which requests the time; the insole refuses these requests during that session.
    Lost(Error),
}

impl<C: Carrier + Send + 'static> Link<C> {
    /// Opens a carrier and a session over it. The live stream starts with [`Link::start`] or the first [`Link::next_event`].
    ///
    /// # Errors
    /// Those of `open` and of [`Client::connect`].
    pub fn connect(open: Open<C>, policy: ReconnectPolicy) -> Result<Self, Error> {
        let client = Client::connect(open()?, policy.answer)?;
        Ok(Self {
            client,
            open,
            policy,
            state: State::Open(SessionStart::Connected),
            attempt: None,
            failure: None,
            status: None,
            meanwhile: Meanwhile::Frames,
        })
    }

    /// The session.
    pub fn client(&mut self) -> &mut Client<C> {
        &mut self.client
    }

    /// Requests the live stream of the present session. If the caller does not call this after [`Link::connect`], the first
    /// [`Link::next_event`] does.
    ///
    /// # Errors
    /// Those of [`Client::stream`].
    pub fn start(&mut self) -> Result<(), Error> {
        let status = self.client.stream()?;
        self.meanwhile = match self.status.replace(status) {
            Some(before) if status.is_after_restart(&before) => Meanwhile::Restarted,
            Some(before) if status.frames == before.frames => Meanwhile::NoFrames,
            Some(_) | None => Meanwhile::Frames,
        };
        self.state = State::Streaming { last_message: Instant::now(), is_superseded: false, lost_since: None };
        Ok(())
    }

    /// The next message or change of the session. After the link was lost, another thread makes attempts to open it again. An
    /// attempt can take 40 s; a call waits for it for at most [`READ_TIMEOUT`], so that the caller can react to its user.
    ///
    /// # Errors
    /// The error of the last attempt, once the policy gives up, or if it was no failure of the link: another attempt would fail
    /// as well.
    pub fn next_event(&mut self) -> Result<Event, Error> {
        if let Some(error) = self.failure.take() {
            let (is_superseded, lost_since) = match self.state {
                State::Streaming { is_superseded, lost_since, .. } => (is_superseded, lost_since),
                State::Open(_) | State::Lost { .. } => (false, None),
            };
            return self.lose(error, is_superseded, lost_since);
        }
        match self.state {
            State::Open(reason) => Ok(match self.start() {
                Ok(()) => Event::Started(reason),
                Err(error @ Error::Refused(Refusal::OtherHost)) => {
                    // The other host keeps its session: a new connect request would end it.
                    self.state =
                        State::Streaming { last_message: Instant::now(), is_superseded: true, lost_since: None };
                    Event::Lost(error)
                }
                Err(error) => self.lose(error, false, None)?,
            }),
            State::Streaming { last_message, is_superseded, lost_since } => Ok(match self.client.receive() {
                Ok(Some(message)) => {
                    let is_refused = matches!(message, ToHost::Refused(Refusal::OtherHost));
                    // Messages from before the refusal, which arrived during a request, do not end the session of the other host.
                    let is_still_superseded = is_refused || is_superseded;
                    // Frames of another stream do not show that the live stream is on: its request may have been lost.
                    let is_other_stream = matches!(message, ToHost::Cells(_) | ToHost::Ellipses(_));
                    let last_message = if is_other_stream { last_message } else { Instant::now() };
                    self.state =
                        State::Streaming { last_message, is_superseded: is_still_superseded, lost_since: None };
                    match message {
                        ToHost::Refused(_) if is_refused && is_superseded => Event::Timeout,
                        ToHost::Refused(refusal) if is_refused => Event::Lost(Error::Refused(refusal)),
                        message => Event::Message(message),
                    }
                }
                Ok(None) if last_message.elapsed() <= self.policy.silence => Event::Timeout,
                Ok(None) => match self.client.reconnect(self.policy.probe) {
                    Ok(_) if is_superseded => {
                        self.state = State::Open(SessionStart::AfterOtherHost);
                        Event::Timeout
                    }
                    Ok(_) => {
                        self.state = State::Open(SessionStart::AfterSilence);
                        Event::Timeout
                    }
                    // The session of another host has ended: the insole does not refuse messages any more.
                    Err(error) => self.lose(error, false, lost_since)?,
                },
                Err(error) => self.lose(error, is_superseded, lost_since)?,
            }),
            State::Lost { since, is_superseded } => {
                let attempt = self.attempt.take().unwrap_or_else(|| self.begin_attempt(is_superseded));
                match attempt.recv_timeout(READ_TIMEOUT) {
                    Err(RecvTimeoutError::Timeout) => self.attempt = Some(attempt),
                    Ok(Ok((carrier, hello))) => {
                        self.state = match hello {
                            Some(_) => State::Open(SessionStart::Reconnected),
                            None => {
                                let last_message = Instant::now();
                                State::Streaming { last_message, is_superseded, lost_since: Some(since) }
                            }
                        };
                        self.client.continue_over(carrier, hello);
                    }
                    Ok(Err(error)) if !error.is_link_failure() || self.gives_up(since) => return Err(error),
                    // The next call begins another attempt. A disconnected channel means that the thread has panicked.
                    Ok(Err(_)) | Err(RecvTimeoutError::Disconnected) => {}
                }
                Ok(Event::Timeout)
            }
        }
    }

    /// Waits and makes one attempt to open the link again, on another thread.
    fn begin_attempt(&self, is_superseded: bool) -> Attempt<C> {
        let (open, policy) = (self.open.clone(), self.policy);
        let (sender, attempt) = mpsc::channel();
        thread::spawn(move || {
            sleep(policy.retry);
            let result = open().and_then(|mut carrier| {
                let hello = if is_superseded { None } else { Some(open_session(&mut carrier, policy.answer)?) };
                Ok((carrier, hello))
            });
            // This fails if the link was dropped meanwhile. The carrier is then dropped, too, which closes it.
            let _ = sender.send(result);
        });
        attempt
    }

    /// What the insole has done from the start of the previous session to that of this one.
    pub fn meanwhile(&self) -> Meanwhile {
        self.meanwhile
    }

    /// Sends a message. A failure ends the session, and the next event reports it.
    pub fn send(&mut self, message: ToDevice) {
        if let Err(error) = self.client.send(message) {
            self.fail(error);
        }
    }

    /// Lets the next event report that the link is lost, unless an earlier event has reported it.
    fn fail(&mut self, error: Error) {
        if let State::Open(_) | State::Streaming { .. } = self.state {
            self.failure = Some(error);
        }
    }

    /// To be called with the error of a request that has failed. If the link has failed and an event has not reported this yet,
    /// ends the session: the next event reports `error`, and a later one the start of another session, in which the request can
    /// be repeated. If another host has the session, a later event reports this.
    ///
    /// # Errors
    /// Returns any other error.
    pub fn recover(&mut self, error: Error) -> Result<(), Error> {
        match error {
            // The insole refuses the next message as well, and events report that another host has the session.
            Error::Refused(Refusal::OtherHost) => {}
            error if error.is_link_failure() => self.fail(error),
            error => return Err(error),
        }
        Ok(())
    }

    /// Ends the session. Returns the event that reports this, or the error if the link has already been lost since `lost_since`
    /// and the policy gives up.
    fn lose(&mut self, error: Error, is_superseded: bool, lost_since: Option<Instant>) -> Result<Event, Error> {
        let since = lost_since.unwrap_or_else(Instant::now);
        self.state = State::Lost { since, is_superseded };
        // A serial port has one user, and closing a Bluetooth link later would close the new one, too.
        self.client.close();
        if lost_since.is_some() && self.gives_up(since) { Err(error) } else { Ok(Event::Lost(error)) }
    }

    fn gives_up(&self, since: Instant) -> bool {
        self.policy.give_up.is_some_and(|limit| since.elapsed() >= limit)
    }

    /// Restarts the insole and opens the session again, over a newly opened carrier if this fails over the one in use.
    ///
    /// # Errors
    /// Those of [`Client::status`] and [`Client::reconnect_over`]; [`Error::NotRestarted`] if the insole answers, but did not
    /// restart.
    pub fn restart(&mut self) -> Result<&Hello, Error> {
        let before = self.client.status()?;
        if self.client.restart_after(&before, self.policy.answer).is_err() {
            self.client.reconnect_over(&*self.open, self.policy.answer)?;
            // The request to restart may have been lost or refused, and then the insole answers as before.
            if !self.client.status()?.is_after_restart(&before) {
                return Err(Error::NotRestarted);
            }
        }
        Ok(self.client.hello())
    }

    /// Waits for an insole that restarts by itself: sends connect requests, over a newly opened carrier if the one in use fails,
    /// until `check` returns a value. `check` receives the insole's hello, and whether at least one attempt of this call has
    /// failed.
    ///
    /// # Errors
    /// Once the policy gives up: the error of the last attempt, or [`Error::NotRestarted`] if the insole answered it.
    pub fn wait_for_restart<T>(&mut self, mut check: impl FnMut(&Hello, bool) -> Option<T>) -> Result<T, Error> {
        let start = Instant::now();
        let mut was_silent = false;
        loop {
            let mut answer = self.client.reconnect(self.policy.probe).map(drop);
            if answer.is_err() {
                was_silent = true;
                answer = self.client.reconnect_over(&*self.open, self.policy.answer).map(drop);
            }
            if answer.is_ok()
                && let Some(value) = check(self.client.hello(), was_silent)
            {
                return Ok(value);
            }
            if self.gives_up(start) {
                return Err(answer.err().unwrap_or(Error::NotRestarted));
            }
            sleep(self.policy.retry);
        }
    }
}

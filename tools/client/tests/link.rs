//! Reconnecting: when a link counts as lost, how it is opened again, and when the host gives up.

use client::{Carrier, Client, Error, Event, Link, Meanwhile, ReconnectPolicy, SessionStart};
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::protocol::session::{RECORD_QUEUE, Session};
use plantar::protocol::update::Request;
use plantar::protocol::{
    Alert, CellStream, Contents, Hello, Live, MAJOR, MAX_MESSAGE, MINOR, Refusal, Reset, Resolution, Status, ToDevice,
    ToHost, decode,
};
use std::cell::{Cell, RefCell};
use std::io;
use std::rc::Rc;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

const POLICY: ReconnectPolicy = ReconnectPolicy {
    answer: Duration::from_millis(20),
    probe: Duration::from_millis(20),
    silence: Duration::from_millis(40),
    retry: Duration::from_millis(5),
    give_up: Some(Duration::from_millis(100)),
};

const CELLS: CellStream = CellStream { resolution: Resolution::Converter, every: 1 };

/// An insole in memory, with the firmware's own session. It also serves as the carrier of the client.
#[derive(Clone)]
struct Insole {
    state: Arc<Mutex<State>>,
    /// While a test holds this lock, the carrier cannot be opened, and each attempt waits.
    opening: Arc<Mutex<()>>,
}

struct State {
    session: Session,
    firmware: &'static str,
    /// Major version of the insole's protocol.
    major: u8,
    is_unplugged: bool,
    is_silent: bool,
    /// Number of attempts to open the carrier.
    opened: u32,
    /// Number of connect requests.
    connects: u32,
    /// True while requests for the live stream are lost on the way.
    loses_stream: bool,
    /// Number of processed frames in the status.
    frames: u32,
    /// Number of the boot in the status.
    boot: u32,
    /// True while each carrier can be opened, and fails when it is read.
    is_broken: bool,
}

impl Insole {
    fn new() -> Self {
        let (session, firmware) = (Session::new(), "1.0.0");
        let state = State {
            session,
            firmware,
            major: MAJOR,
            is_unplugged: false,
            is_silent: false,
            opened: 0,
            connects: 0,
            loses_stream: false,
            frames: 0,
            boot: 1,
            is_broken: false,
        };
        Self { state: Arc::new(Mutex::new(state)), opening: Arc::default() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no test panics here")
    }

    fn connect(&self) -> Result<Link<Self>, Error> {
        let insole = self.clone();
        let open = move || {
            let _opening = insole.opening.lock().expect("no test panics here");
            let mut state = insole.state();
            state.opened += 1;
            if state.is_unplugged { Err(Error::Open("unplugged".into())) } else { Ok(insole.clone()) }
        };
        Link::connect(Arc::new(open), POLICY)
    }
}

impl Carrier for Insole {
    fn send(&mut self, message: ToDevice) -> io::Result<()> {
        let mut state = self.state();
        if state.is_unplugged {
            return Err(io::ErrorKind::BrokenPipe.into());
        }
        let is_lost = state.loses_stream && matches!(message, ToDevice::Stream { .. });
        if !state.is_silent && !is_lost {
            state.connects += u32::from(matches!(message, ToDevice::Connect { .. }));
            state.session.receive(message, 1);
        }
        Ok(())
    }

    fn receive(&mut self) -> io::Result<Option<ToHost>> {
        let mut state = self.state();
        if state.is_unplugged || state.is_broken {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let hello = Hello { major: state.major, ..hello(state.firmware) };
        let mut buffer = [0; MAX_MESSAGE];
        let (frames, contents) = (state.frames, Contents { start: state.boot, ..Contents::default() });
        let status = || Status { frames, contents, ..Status::default() };
        let message = match state.is_silent {
            true => None,
            false => state.session.next(&hello, status, &mut buffer).and_then(decode),
        };
        drop(state);
        if message.is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(message)
    }

    fn damaged(&self) -> u32 {
        0
    }
}

fn hello(firmware: &str) -> Hello {
    Hello {
        major: MAJOR,
        minor: MINOR,
        firmware: firmware.try_into().expect("the text is short"),
        board: "test".try_into().expect("the text is short"),
        side: Side::Left,
        layout_id: 1,
        cells: 240,
        period_us: 10_000,
        tissue_id: 0,
        contact_rule: ContactRule::COUNTED,
        reset: Reset::Power,
        fault: None,
    }
}

/// The next event other than a timeout, while `insole` sends live frames.
fn next(insole: &Insole, link: &mut Link<Insole>) -> Result<Event, Error> {
    loop {
        let sequence = insole.state().session.next_live();
        if let Some(sequence) = sequence {
            insole.state().session.push_live(Live { sequence, ..Live::default() });
        }
        match link.next_event()? {
            Event::Timeout => {}
            event => return Ok(event),
        }
    }
}

fn expect_live(insole: &Insole, link: &mut Link<Insole>) {
    let event = next(insole, link).expect("the link has not been given up");
    assert!(matches!(event, Event::Message(ToHost::Live(_))), "{event:?}");
}

#[test]
fn a_lost_carrier_is_reported_once_and_opened_again() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    assert!(matches!(next(&insole, &mut link), Ok(Event::Started(SessionStart::Connected))));
    expect_live(&insole, &mut link);
    insole.state().is_unplugged = true;
    assert!(matches!(link.next_event(), Ok(Event::Lost(error)) if error.is_link_failure()));
    assert!(matches!(link.next_event(), Ok(Event::Timeout)));
    // A message that cannot be sent while the link is lost is not reported as a second loss.
    link.send(ToDevice::Acknowledge { number: 0 });
    assert!(matches!(link.next_event(), Ok(Event::Timeout)));
    insole.state().is_unplugged = false;
    assert!(matches!(next(&insole, &mut link), Ok(Event::Started(SessionStart::Reconnected))));
    expect_live(&insole, &mut link);
}

/// A scan for a Bluetooth insole that is out of range takes seconds.
#[test]
fn the_caller_can_react_to_its_user_while_an_attempt_to_open_the_carrier_takes_long() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    link.start().expect("the insole streams");
    let opening = insole.opening.lock().expect("no test panics here");
    insole.state().is_broken = true;
    assert!(matches!(link.next_event(), Ok(Event::Lost(_))));
    assert!((0..3).all(|_| matches!(link.next_event(), Ok(Event::Timeout))));
    insole.state().is_broken = false;
    drop(opening);
    assert!(matches!(next(&insole, &mut link), Ok(Event::Started(SessionStart::Reconnected))));
    // These calls made one attempt, which waited.
    assert_eq!(insole.state().opened, 2);
}

#[test]
fn a_message_that_cannot_be_sent_ends_the_session() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    link.start().expect("the insole streams");
    insole.state().is_unplugged = true;
    link.send(ToDevice::GetStatus);
    assert!(matches!(link.next_event(), Ok(Event::Lost(Error::Carrier(_)))));
}

/// Callers send their requests at the start of each session, so they repeat a request that was not answered.
#[test]
fn a_request_without_an_answer_ends_the_session_and_a_refused_one_does_not() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    link.start().expect("the insole streams");
    link.recover(Error::LostAnswer(POLICY.answer, 0)).expect("the error concerns the link");
    assert!(matches!(link.next_event(), Ok(Event::Lost(Error::LostAnswer(..)))));
    assert!(matches!(next(&insole, &mut link), Ok(Event::Started(SessionStart::Reconnected))));
    assert!(matches!(link.recover(Error::Refused(Refusal::Busy)), Err(Error::Refused(Refusal::Busy))));
    link.recover(Error::Refused(Refusal::OtherHost)).expect("the error concerns the link");
    expect_live(&insole, &mut link);
}

#[test]
fn a_silent_insole_is_first_connected_over_the_same_carrier() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    link.start().expect("the insole streams");
    // The insole restarts, so its stream is off.
    insole.state().session = Session::new();
    assert!(matches!(next(&insole, &mut link), Ok(Event::Started(SessionStart::AfterSilence))));
    assert_eq!(insole.state().opened, 1);
    expect_live(&insole, &mut link);
    insole.state().is_silent = true;
    assert!(matches!(next(&insole, &mut link), Ok(Event::Lost(Error::NoAnswer(..)))));
    insole.state().is_silent = false;
    assert!(matches!(next(&insole, &mut link), Ok(Event::Started(SessionStart::Reconnected))));
}

/// The insole answers and sends no live frame. If its status counts frames, only the stream was off, or the matrix has failed
/// since the start of the previous session.
#[test]
fn a_silence_without_a_measured_frame_is_distinguished_from_a_lost_stream_and_from_a_restart() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    link.start().expect("the insole streams");
    for (boot, frames, meanwhile) in [
        (1, 0, Meanwhile::NoFrames),
        (1, 0, Meanwhile::NoFrames),
        (1, 100, Meanwhile::Frames),
        (1, 100, Meanwhile::NoFrames),
        (2, 100, Meanwhile::Restarted),
    ] {
        insole.state().boot = boot;
        insole.state().frames = frames;
        while !matches!(link.next_event(), Ok(Event::Started(SessionStart::AfterSilence))) {}
        assert_eq!(link.meanwhile(), meanwhile, "boot {boot}, {frames} frames");
    }
}

/// A session of which the request for the live stream was lost.
fn without_stream() -> (Insole, Link<Insole>) {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    insole.state().loses_stream = true;
    link.start().expect("the insole answers the other requests");
    insole.state().loses_stream = false;
    (insole, link)
}

/// `plantar serve` requests the status every second, so the insole is never silent.
#[test]
fn a_lost_request_for_the_live_stream_is_repeated_after_a_status() {
    let (insole, mut link) = without_stream();
    let has_frame = (0..100).any(|_| {
        link.send(ToDevice::GetStatus);
        matches!(next(&insole, &mut link), Ok(Event::Message(ToHost::Live(_))))
    });
    assert!(has_frame && insole.state().connects == 1);
}

#[test]
fn a_lost_request_for_the_live_stream_is_noticed_while_cells_arrive() {
    let (insole, mut link) = without_stream();
    link.send(ToDevice::StreamCells(Some(CELLS)));
    let is_noticed = (0..1000).any(|scan| {
        insole.state().session.push_cells(scan, &[1000; 240]);
        std::thread::sleep(Duration::from_millis(1));
        matches!(link.next_event(), Ok(Event::Started(SessionStart::AfterSilence)))
    });
    assert!(is_noticed);
    expect_live(&insole, &mut link);
}

/// While the other host's session lasts, the insole refuses each message. After it has ended, the insole sends nothing until a
/// host connects.
#[test]
fn a_session_that_another_host_has_taken_is_reported_once_and_not_taken_back() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    link.start().expect("the insole streams");
    let mut reports = 0;
    for _ in 0..40 {
        insole.state().session.refuse(Refusal::OtherHost);
        match link.next_event() {
            Ok(Event::Lost(Error::Refused(Refusal::OtherHost))) => reports += 1,
            event => assert!(matches!(event, Ok(Event::Timeout)), "{event:?}"),
        }
    }
    assert_eq!((reports, insole.state().connects), (1, 1));
    insole.state().session = Session::new();
    assert!(matches!(next(&insole, &mut link), Ok(Event::Started(SessionStart::AfterOtherHost))));
    expect_live(&insole, &mut link);
    let state = insole.state();
    assert_eq!((state.connects, state.opened), (2, 1));
}

/// The other host connects between the connect request of this host and its request of the live stream.
#[test]
fn a_session_that_another_host_takes_before_the_stream_is_on_is_not_taken_back() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    let mut reports = 0;
    for _ in 0..40 {
        insole.state().session.refuse(Refusal::OtherHost);
        match link.next_event() {
            Ok(Event::Lost(Error::Refused(Refusal::OtherHost))) => reports += 1,
            event => assert!(matches!(event, Ok(Event::Timeout | Event::Message(_))), "{event:?}"),
        }
    }
    assert_eq!((reports, insole.state().connects), (1, 1));
}

#[test]
fn a_session_of_another_host_is_not_taken_back_after_the_carrier_failed() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    link.start().expect("the insole streams");
    insole.state().session.refuse(Refusal::OtherHost);
    assert!(matches!(link.next_event(), Ok(Event::Lost(Error::Refused(Refusal::OtherHost)))));
    insole.state().is_unplugged = true;
    assert!(matches!(link.next_event(), Ok(Event::Lost(error)) if error.is_link_failure()));
    insole.state().is_unplugged = false;
    for _ in 0..40 {
        insole.state().session.refuse(Refusal::OtherHost);
        assert!(matches!(link.next_event(), Ok(Event::Timeout)));
    }
    let mut state = insole.state();
    assert_eq!((state.connects, state.opened), (1, 2));
    state.session = Session::new();
    drop(state);
    assert!(matches!(next(&insole, &mut link), Ok(Event::Started(SessionStart::AfterOtherHost))));
    expect_live(&insole, &mut link);
}

#[test]
fn a_carrier_that_fails_after_each_opening_in_the_session_of_another_host_is_given_up() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    link.start().expect("the insole streams");
    insole.state().session.refuse(Refusal::OtherHost);
    assert!(matches!(link.next_event(), Ok(Event::Lost(Error::Refused(Refusal::OtherHost)))));
    insole.state().is_broken = true;
    let error = (0..1000).find_map(|_| link.next_event().err());
    assert!(matches!(error, Some(Error::Carrier(_))), "{error:?}");
    let state = insole.state();
    assert!(state.connects == 1 && state.opened > 2, "{} {}", state.connects, state.opened);
}

#[test]
fn a_link_to_an_insole_that_does_not_return_is_given_up() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    link.start().expect("the insole streams");
    insole.state().is_unplugged = true;
    assert!(matches!(link.next_event(), Ok(Event::Lost(_))));
    assert!(matches!(next(&insole, &mut link), Err(Error::Open(_))));
    let restart = link.wait_for_restart(|_, _| Some(()));
    assert!(matches!(restart, Err(Error::Open(_))), "{restart:?}");
}

/// Its firmware was updated meanwhile, or it is another insole.
#[test]
fn an_insole_that_returns_with_another_protocol_is_reported() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    link.start().expect("the insole streams");
    insole.state().is_unplugged = true;
    assert!(matches!(link.next_event(), Ok(Event::Lost(_))));
    insole.state().is_unplugged = false;
    insole.state().major = MAJOR + 1;
    let event = next(&insole, &mut link);
    assert!(matches!(event, Err(Error::OtherVersion { .. })), "{event:?}");
}

#[test]
fn a_restart_is_waited_for_until_the_check_accepts_the_hello() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    let mut checks = 0;
    let version = link.wait_for_restart(|hello, was_silent| {
        checks += 1;
        if checks == 2 {
            insole.state().firmware = "2.0.0";
            insole.state().is_silent = true;
        }
        was_silent.then(|| hello.firmware.clone())
    });
    assert!(matches!(version, Err(Error::NoAnswer(..))), "the insole stays silent");
    insole.state().is_silent = false;
    let version = link.wait_for_restart(|hello, _| (checks > 1).then(|| hello.firmware.clone()));
    assert_eq!(version.expect("the insole answers again"), "2.0.0");
}

#[test]
fn an_insole_that_answers_without_a_restart_is_not_reported_as_silent() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    let restart = link.wait_for_restart(|_, was_silent| {
        assert!(!was_silent);
        None::<()>
    });
    assert!(matches!(restart, Err(Error::NotRestarted)), "{restart:?}");
}

/// The request was lost on the way, or the insole has refused it.
#[test]
fn an_insole_that_does_not_restart_on_request_is_an_error() {
    let insole = Insole::new();
    let mut link = insole.connect().expect("an insole");
    let restart = link.restart();
    assert!(matches!(restart, Err(Error::NotRestarted)), "{restart:?}");
}

thread_local! {
    /// The virtual clock, us.
    static NOW_US: Cell<u64> = const { Cell::new(0) };
}

/// The next message of a session. A read without a message takes 50 ms of the virtual clock.
fn read(session: &mut Session, status: Status) -> Option<ToHost> {
    let message = session.next(&hello("1.0.0"), || status, &mut [0; MAX_MESSAGE]).and_then(decode);
    if message.is_none() {
        NOW_US.set(NOW_US.get() + 50_000);
    }
    message
}

/// An insole that still answers a connect request after a request to restart. It restarts when it then receives a request for its
/// status, which it does not answer.
struct Restarting {
    session: Session,
    boots: u32,
    is_restart_due: bool,
}

impl Carrier for Restarting {
    fn send(&mut self, message: ToDevice) -> io::Result<()> {
        match message {
            ToDevice::Restart => self.is_restart_due = true,
            ToDevice::GetStatus if self.is_restart_due => {
                *self = Self { session: Session::new(), boots: self.boots + 1, is_restart_due: false };
            }
            message => self.session.receive(message, 1),
        }
        Ok(())
    }

    fn receive(&mut self) -> io::Result<Option<ToHost>> {
        let contents = Contents { start: self.boots, ..Contents::default() };
        Ok(read(&mut self.session, Status { contents, ..Status::default() }))
    }

    fn damaged(&self) -> u32 {
        0
    }

    fn now_us() -> u64 {
        NOW_US.get()
    }
}

thread_local! {
    /// The wall clock at the time 0 of the virtual clock, us since 1970.
    static WALL_US: Cell<u64> = const { Cell::new(1_790_000_000_000_000) };
}

/// An insole with the virtual clock as its clock.
struct Clocked(Rc<RefCell<Session>>);

impl Carrier for Clocked {
    fn send(&mut self, message: ToDevice) -> io::Result<()> {
        self.0.borrow_mut().receive(message, NOW_US.get());
        Ok(())
    }

    fn receive(&mut self) -> io::Result<Option<ToHost>> {
        Ok(read(&mut self.0.borrow_mut(), Status::default()))
    }

    fn damaged(&self) -> u32 {
        0
    }

    fn now_us() -> u64 {
        NOW_US.get()
    }

    fn unix_us() -> u64 {
        WALL_US.get() + NOW_US.get()
    }
}

#[test]
fn the_times_of_an_insole_follow_a_wall_clock_that_is_set() {
    let session = Rc::new(RefCell::new(Session::new()));
    let mut client = Client::connect(Clocked(session.clone()), Duration::from_secs(5)).expect("an insole");
    client.stream().expect("an answer");
    for step_s in [0, -3600, 2] {
        WALL_US.set(WALL_US.get().wrapping_add_signed(step_s * 1_000_000));
        for _ in 0..40 {
            client.receive().expect("the carrier has no errors");
        }
        let (now_us, unix_us) = (NOW_US.get(), Clocked::unix_us());
        let host_us = client.clock_mapping().host_us(now_us).expect("the insole has answered");
        assert!(host_us.abs_diff(unix_us) < 1_000, "{step_s} s: {host_us} {unix_us}");
        assert_eq!(session.borrow().unix_us(now_us), Some(unix_us), "{step_s} s");
    }
}

/// An insole with the virtual clock, to which one message is lost on the way.
struct Lossy {
    session: Rc<RefCell<Session>>,
    /// True for a message of the kind that is lost.
    is_of_kind: fn(&ToDevice) -> bool,
    /// Number of messages of this kind before the lost one; `None` after it.
    before: Option<u32>,
}

impl Carrier for Lossy {
    fn send(&mut self, message: ToDevice) -> io::Result<()> {
        if (self.is_of_kind)(&message)
            && let Some(before) = self.before
        {
            self.before = before.checked_sub(1);
            if before == 0 {
                return Ok(());
            }
        }
        self.session.borrow_mut().receive(message, NOW_US.get());
        Ok(())
    }

    fn receive(&mut self) -> io::Result<Option<ToHost>> {
        Ok(read(&mut self.session.borrow_mut(), Status::default()))
    }

    fn damaged(&self) -> u32 {
        0
    }

    fn now_us() -> u64 {
        NOW_US.get()
    }
}

fn alert(number: u32) -> Alert {
    Alert {
        number,
        side: Side::Left,
        start_us: 0,
        sustained: 1,
        dose: 0,
        window_s: 900,
        today: 1,
        boots_since: 0,
        start_unix_us: None,
    }
}

/// The client opens the session again after the loss of a record, which ends all streams.
#[test]
fn a_lost_request_to_continue_the_cells_is_repeated() {
    let session = Rc::new(RefCell::new(Session::new()));
    // The stream is requested once before the loss of the record.
    let is_of_kind = |message: &ToDevice| matches!(message, ToDevice::StreamCells(_));
    let carrier = Lossy { session: session.clone(), is_of_kind, before: Some(1) };
    let mut client = Client::connect(carrier, Duration::from_secs(5)).expect("an insole");
    client.stream_cells(Some(CELLS)).expect("an answer");
    let mut receive = || (0..100).for_each(|_| drop(client.receive().expect("the carrier has no errors")));
    let push = |number| session.borrow_mut().push_record(alert(number));
    push(0);
    receive();
    push(1);
    session.borrow_mut().next(&hello("1.0.0"), Status::default, &mut [0; MAX_MESSAGE]).expect("the lost record");
    push(2);
    receive();
    assert!(session.borrow().streams_cells());
}

/// The numbers of the alerts that a client receives in 100 reads.
fn received<C: Carrier>(client: &mut Client<C>) -> Vec<u32> {
    let messages = (0..100).filter_map(|_| client.receive().expect("the carrier has no errors"));
    messages.filter_map(|message| if let ToHost::Alert(alert) = message { Some(alert.number) } else { None }).collect()
}

/// The host acknowledges all records at once that the insole sends without an acknowledgement, so that no record arrives after
/// this acknowledgement.
#[test]
fn a_lost_acknowledgement_of_all_records_is_repeated() {
    let session = Rc::new(RefCell::new(Session::new()));
    let is_of_kind = |message: &ToDevice| matches!(message, ToDevice::Acknowledge { .. });
    let carrier = Lossy { session: session.clone(), is_of_kind, before: Some(0) };
    let mut client = Client::connect(carrier, Duration::from_secs(5)).expect("an insole");
    let count = RECORD_QUEUE as u32;
    (0..count).for_each(|number| session.borrow_mut().push_record(alert(number)));
    assert_eq!(received(&mut client), Vec::from_iter(0..count));
    client.send(ToDevice::Acknowledge { number: count - 1 }).expect("the carrier has no errors");
    assert_eq!(session.borrow_mut().take_acknowledged(), None);
    assert_eq!(received(&mut client), [0; 0]);
    assert_eq!(session.borrow_mut().take_acknowledged(), Some(count - 1));
}

/// While the caller does not read for three seconds, all records are lost that the insole sends without an acknowledgement. The
/// frames of the stream that arrive afterwards show no gap in the records.
#[test]
fn records_that_were_lost_while_the_caller_did_not_read_are_requested_again() {
    let session = Rc::new(RefCell::new(Session::new()));
    let mut client = Client::connect(Clocked(session.clone()), Duration::from_secs(5)).expect("an insole");
    client.stream().expect("an answer");
    assert_eq!(received(&mut client), [0; 0]);
    let count = RECORD_QUEUE as u32;
    (0..count).for_each(|number| session.borrow_mut().push_record(alert(number)));
    let mut buffer = [0; MAX_MESSAGE];
    while session.borrow_mut().next(&hello("1.0.0"), Status::default, &mut buffer).is_some() {}
    NOW_US.set(NOW_US.get() + 3_000_000);
    // A request that reads before the caller receives does not hide the pause.
    client.status().expect("an answer");
    assert_eq!(received(&mut client), Vec::from_iter(0..count));
    // The stream continues.
    assert!(session.borrow().next_live().is_some());
}

/// An insole with the virtual clock, of which another host has taken the session.
#[derive(Clone, Default)]
struct Taken(Rc<RefCell<TakenState>>);

#[derive(Default)]
struct TakenState {
    /// Number of connect requests.
    connects: u32,
    /// The answer that is due.
    answer: Option<ToHost>,
}

impl Carrier for Taken {
    fn send(&mut self, message: ToDevice) -> io::Result<()> {
        let state = &mut *self.0.borrow_mut();
        let is_connect = matches!(message, ToDevice::Connect { .. });
        state.connects += u32::from(is_connect);
        state.answer =
            Some(if is_connect { ToHost::Hello(hello("1.0.0")) } else { ToHost::Refused(Refusal::OtherHost) });
        Ok(())
    }

    fn receive(&mut self) -> io::Result<Option<ToHost>> {
        NOW_US.set(NOW_US.get() + 50_000);
        Ok(self.0.borrow_mut().answer.take())
    }

    fn damaged(&self) -> u32 {
        0
    }

    fn now_us() -> u64 {
        NOW_US.get()
    }
}

/// A connect request would end the session of the other host.
#[test]
fn records_are_not_requested_again_in_the_session_of_another_host() {
    let insole = Taken::default();
    let mut client = Client::connect(insole.clone(), Duration::from_secs(5)).expect("an insole");
    NOW_US.set(NOW_US.get() + 3_000_000);
    assert_eq!(received(&mut client), [0; 0]);
    assert_eq!(insole.0.borrow().connects, 1);
}

/// A client usually waits two seconds for a status. After a request to restart it waits less, because an insole that restarts
/// does not answer.
#[test]
fn a_status_that_is_lost_in_a_restart_is_soon_requested_again() {
    let insole = Restarting { session: Session::new(), boots: 1, is_restart_due: false };
    let mut client = Client::connect(insole, Duration::from_secs(5)).expect("an insole");
    let start_us = NOW_US.get();
    client.restart(Duration::from_secs(5)).expect("the insole restarts");
    assert_eq!(client.status().expect("an answer").contents.start, 2);
    let elapsed_us = NOW_US.get() - start_us;
    assert!(elapsed_us < 1_000_000, "{elapsed_us} us");
}

/// The insole may have installed the image and restarted, and would then not know the request. Its answer is awaited for 30 s.
#[test]
fn a_request_to_finish_an_update_that_is_not_answered_is_not_repeated() {
    let insole = Restarting { session: Session::new(), boots: 1, is_restart_due: false };
    let mut client = Client::connect(insole, Duration::from_secs(5)).expect("an insole");
    let start_us = NOW_US.get();
    let answer = client.update(Request::Finish);
    assert!(matches!(answer, Err(Error::LostAnswer(..))), "{answer:?}");
    let elapsed_us = NOW_US.get() - start_us;
    assert!(elapsed_us < 31_000_000, "{elapsed_us} us");
}

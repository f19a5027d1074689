//! The host's side of a session: tests of the client with a simulated insole.

use client::{Client, Error, Framed, LinkCounters, unix_us};
use plantar::Region;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::session::{Command, CommandResult, Session};
use plantar::protocol::update::{Header, Offer, Progress, Request};
use plantar::protocol::{
    CellStream, Decoder, Hello, MAJOR, MAX_FRAME, MAX_MESSAGE, MINOR, Refusal, Resolution, Status, Step, ToDevice,
    ToHost, frame,
};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::rc::Rc;
use std::time::Duration;
use testkit::{SETUP, TISSUE, faults, framed, live, messages, status, step};

/// An insole and the cable to it.
struct Insole {
    session: Session,
    hello: Hello,
    from_host: Decoder,
    to_host: VecDeque<u8>,
    /// True while the cable is unplugged.
    is_unplugged: bool,
    /// Number of frames to the host that are dropped, from the next one on.
    drop_next: usize,
    /// Number of frames to the host that are damaged, from the next one on.
    damage_next: usize,
    /// Number of connect requests.
    connects: u32,
}

impl Insole {
    fn receive(&mut self, bytes: &[u8]) {
        for message in messages::<ToDevice>(&mut self.from_host, bytes) {
            self.connects += u32::from(matches!(message, ToDevice::Connect { .. }));
            self.session.receive(message, 0);
        }
    }

    /// Sends all messages that are due.
    fn send(&mut self) {
        // The pending command is completed at once, a request of an update as if no chunk of the image were stored.
        let result = match self.session.command() {
            Some(Command::Update(_)) => CommandResult::Update(Progress::Next(0)),
            _ => CommandResult::Stored,
        };
        self.session.complete(Ok(result));
        let mut buffer = [0; MAX_MESSAGE];
        while let Some(message) = self.session.next(&self.hello, status, &mut buffer) {
            let mut out = [0; MAX_FRAME];
            let len = frame(message, &mut out);
            if self.drop_next > 0 {
                self.drop_next -= 1;
                continue;
            }
            if self.damage_next > 0 {
                self.damage_next -= 1;
                // The damaged byte is not zero, because a zero would end the frame.
                out[len / 2] = if out[len / 2] == 1 { 2 } else { 1 };
            }
            self.to_host.extend(&out[..len]);
        }
    }
}

/// The host's end of the cable to an insole.
#[derive(Clone)]
struct Cable(Rc<RefCell<Insole>>);

impl Cable {
    fn new(hello: Hello) -> Self {
        let (from_host, to_host) = (Decoder::new(), VecDeque::new());
        let insole = Insole {
            session: Session::new(),
            hello,
            from_host,
            to_host,
            is_unplugged: false,
            drop_next: 0,
            damage_next: 0,
            connects: 0,
        };
        Self(Rc::new(RefCell::new(insole)))
    }

    fn insole(&self) -> std::cell::RefMut<'_, Insole> {
        self.0.borrow_mut()
    }

    /// Lets the insole send this number of live frames.
    fn live_frames(&self, count: usize) {
        for _ in 0..count {
            let mut insole = self.insole();
            let number = insole.session.next_live().expect("the stream starts");
            insole.session.push_live(live(number));
            insole.send();
        }
    }
}

impl Read for Cable {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let mut insole = self.insole();
        if insole.is_unplugged {
            return Ok(0);
        }
        insole.send();
        if insole.to_host.is_empty() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        // The client receives chunks whose length does not match the frames.
        let len = out.len().min(37).min(insole.to_host.len());
        for (slot, byte) in out.iter_mut().zip(insole.to_host.drain(..len)) {
            *slot = byte;
        }
        Ok(len)
    }
}

impl Write for Cable {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.insole().receive(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Longest wait for an answer.
const TIMEOUT: Duration = Duration::from_secs(5);

/// The hello of an insole without parameters.
fn hello() -> Hello {
    Hello { tissue_id: 0, ..testkit::hello() }
}

/// A client with a session, and its cable.
fn connected() -> (Cable, Client<Framed<Cable>>) {
    let cable = Cable::new(hello());
    let client = Client::connect(Framed::new(cable.clone()), TIMEOUT).expect("the insole answers");
    (cable, client)
}

/// Receives until many successive reads return no message. A read of a part of a frame or of a repeated step returns none either.
fn receive_all(client: &mut Client<Framed<Cable>>) -> Vec<ToHost> {
    let mut got = Vec::new();
    let mut silent = 0;
    while silent < 500 {
        let message = client.receive().expect("the cable works");
        silent = if message.is_some() { 0 } else { silent + 1 };
        got.extend(message);
    }
    got
}

fn step_numbers(messages: &[ToHost]) -> Vec<u32> {
    messages.iter().filter_map(|m| if let ToHost::Step(step) = m { Some(step.step) } else { None }).collect()
}

fn push_steps(cable: &Cable, numbers: impl IntoIterator<Item = u32>) {
    numbers.into_iter().for_each(|number| cable.insole().session.push_record(step(number)));
}

#[test]
fn a_session_begins_with_the_hello() {
    let (_, client) = connected();
    assert_eq!(*client.hello(), hello());
    assert_eq!(client.counters(), LinkCounters::default());
}

#[test]
fn bytes_that_were_in_transit_before_the_session_are_ignored() {
    let cable = Cable::new(hello());
    let before =
        [b"boot loader\r\n".as_slice(), &[0], &framed(&ToHost::Live(live(3))), &framed(&ToHost::Step(step(8)))];
    cable.insole().to_host.extend(before.concat());
    let mut client = Client::connect(Framed::new(cable.clone()), TIMEOUT).expect("the insole answers");
    assert_eq!(client.counters().crc_errors, 1);
    push_steps(&cable, [9]);
    assert_eq!(receive_all(&mut client), [ToHost::Step(step(9))]);
}

#[test]
fn the_client_requests_the_insoles_time_while_it_receives() {
    let before_us = unix_us();
    let (_, mut client) = connected();
    assert_eq!(client.clock_mapping().host_us(0), None);
    assert_eq!(receive_all(&mut client), []);
    // This insole answers each request with the time 0.
    let requested_us = client.clock_mapping().host_us(0).expect("the insole answers");
    assert!((before_us..=unix_us()).contains(&requested_us));
}

#[test]
fn a_repeated_step_is_delivered_once() {
    let (cable, mut client) = connected();
    push_steps(&cable, 0..3);
    assert_eq!(step_numbers(&receive_all(&mut client)), [0, 1, 2]);
    client.send(ToDevice::Acknowledge { number: 0 }).expect("the link works");
    push_steps(&cable, [3]);
    client.reconnect(TIMEOUT).expect("the insole answers");
    assert_eq!(step_numbers(&receive_all(&mut client)), [3], "steps 1 and 2 were delivered before");
    client.send(ToDevice::Acknowledge { number: 3 }).expect("the link works");
    push_steps(&cable, [4]);
    client.reconnect(TIMEOUT).expect("the insole answers");
    assert_eq!(step_numbers(&receive_all(&mut client)), [4]);
}

/// Without the repetition, an insole with a queue full of unacknowledged steps would send no further step.
#[test]
fn a_lost_acknowledgement_is_repeated() {
    let (cable, mut client) = connected();
    push_steps(&cable, [0, 1]);
    assert_eq!(step_numbers(&receive_all(&mut client)), [0, 1]);
    client.send(ToDevice::Acknowledge { number: 0 }).expect("the link works");
    assert_eq!(cable.insole().session.take_acknowledged(), Some(0));
    // The insole starts again, as if the acknowledgement of step 0 had been lost. The host has not acknowledged step 1.
    cable.insole().session = Session::new();
    push_steps(&cable, [0, 1]);
    client.reconnect(TIMEOUT).expect("the insole answers");
    assert_eq!(step_numbers(&receive_all(&mut client)), [0; 0]);
    assert_eq!(cable.insole().session.take_acknowledged(), Some(0));
}

#[test]
fn a_step_that_a_restarted_insole_repeats_is_recognised() {
    let (cable, mut client) = connected();
    push_steps(&cable, [0]);
    assert_eq!(step_numbers(&receive_all(&mut client)), [0]);
    cable.insole().session = Session::new();
    cable.insole().session.push_record(Step { boots_since: 1, ..step(0) });
    push_steps(&cable, [1]);
    client.reconnect(TIMEOUT).expect("the insole answers");
    assert_eq!(step_numbers(&receive_all(&mut client)), [1]);
}

#[test]
fn a_carrier_is_dropped_before_the_next_one_is_opened() {
    let (cable, mut client) = connected();
    let references = Rc::strong_count(&cable.0);
    let opened = client.reconnect_over(
        || {
            assert_eq!(Rc::strong_count(&cable.0), references - 1);
            Err(io::Error::from(io::ErrorKind::NotFound).into())
        },
        TIMEOUT,
    );
    assert!(matches!(opened, Err(Error::Carrier(_))));
    assert!(matches!(client.receive(), Err(Error::Carrier(_))), "a client without a carrier must return an error");
    client.reconnect_over(|| Ok(Framed::new(cable.clone())), TIMEOUT).expect("the insole answers");
    push_steps(&cable, [0]);
    assert_eq!(step_numbers(&receive_all(&mut client)), [0]);
}

#[test]
fn a_step_that_was_lost_in_transit_arrives_in_the_next_session() {
    let (cable, mut client) = connected();
    push_steps(&cable, [0]);
    cable.insole().drop_next = 1;
    assert!(step_numbers(&receive_all(&mut client)).is_empty());
    client.reconnect(TIMEOUT).expect("the insole answers");
    assert_eq!(step_numbers(&receive_all(&mut client)), [0]);
}

/// After a gap, the client requests all unacknowledged records again. The insole first sends a hello, until which the client
/// ignores records. If the request for the status discarded this hello, the client would wait for it in vain, and the steps would
/// arrive only after another request.
#[test]
fn records_that_are_sent_again_while_a_request_waits_are_delivered_at_once() {
    let (cable, mut client) = connected();
    push_steps(&cable, [0]);
    assert_eq!(step_numbers(&receive_all(&mut client)), [0]);
    cable.insole().drop_next = 1;
    push_steps(&cable, 1..=2);
    let connects = cable.insole().connects;
    while cable.insole().connects == connects {
        assert_eq!(client.receive().expect("the cable works"), None);
    }
    client.status().expect("an answer");
    assert_eq!(step_numbers(&receive_all(&mut client)), [1, 2]);
}

/// To receive a damaged step again, the host sends another connect request, which ends all streams of the insole.
#[test]
fn the_requested_streams_continue_after_a_damaged_step() {
    let (cable, mut client) = connected();
    cable.insole().session.set_layout(SETUP, &[], None);
    let stream = CellStream { resolution: Resolution::Converter, every: 1 };
    client.stream().expect("the stream starts");
    client.stream_ellipses(4).expect("25 Hz are accepted");
    client.stream_ellipses(3).expect_err("33 Hz are refused");
    client.stream_cells(Some(stream)).expect("the stream starts");
    push_steps(&cable, [0]);
    assert_eq!(step_numbers(&receive_all(&mut client)), [0]);
    // Damages a step. Returns which streams the insole has when the client has received the step.
    let mut next = 1;
    let mut streams_after_damage = |client: &mut Client<Framed<Cable>>| {
        cable.insole().damage_next = 1;
        push_steps(&cable, next..next + 2);
        assert_eq!(step_numbers(&receive_all(client)), [next, next + 1]);
        client.send(ToDevice::Acknowledge { number: next + 1 }).expect("the link works");
        next += 2;
        let insole = cable.insole();
        (insole.session.next_live().is_some(), insole.session.ellipses.every(), insole.session.streams_cells())
    };
    assert_eq!(streams_after_damage(&mut client), (true, 4, true));
    client.stream_ellipses(8).expect("12.5 Hz are accepted");
    client.stream_cells(None).expect("the stream ends");
    assert_eq!(streams_after_damage(&mut client), (true, 8, false));
    client.reconnect(TIMEOUT).expect("the insole answers");
    assert_eq!(streams_after_damage(&mut client), (false, 0, false));
}

#[test]
fn step_numbers_wrap() {
    let (cable, mut client) = connected();
    push_steps(&cable, [u32::MAX - 1, u32::MAX, 0, 1]);
    assert_eq!(step_numbers(&receive_all(&mut client)), [u32::MAX - 1, u32::MAX, 0, 1]);
    client.reconnect(TIMEOUT).expect("the insole answers");
    assert!(step_numbers(&receive_all(&mut client)).is_empty());
}

/// An insole without stored steps counts from 0 again. These steps are new ones, not repeated ones.
#[test]
fn steps_of_an_insole_that_restarted_are_delivered() {
    let (cable, mut client) = connected();
    push_steps(&cable, 0..5);
    assert_eq!(step_numbers(&receive_all(&mut client)), [0, 1, 2, 3, 4]);
    client.send(ToDevice::Acknowledge { number: 4 }).expect("the link works");
    cable.insole().session = Session::new();
    client.reconnect(TIMEOUT).expect("the insole answers");
    // The steps of another walk have other times.
    let after = |number: u32| plantar::protocol::Step { start_us: 1_000_000 * u64::from(number), ..step(number) };
    (0..3).for_each(|number| cable.insole().session.push_record(after(number)));
    assert_eq!(step_numbers(&receive_all(&mut client)), [0, 1, 2]);
}

#[test]
fn lost_and_damaged_frames_are_counted() {
    let (cable, mut client) = connected();
    client.stream().expect("the stream starts");
    cable.live_frames(10);
    cable.insole().drop_next = 3;
    cable.live_frames(10);
    cable.insole().damage_next = 2;
    cable.live_frames(10);
    client.send(ToDevice::GetStatus).expect("the link works");
    let got = receive_all(&mut client);
    let numbers: Vec<_> =
        got.iter().filter_map(|m| if let ToHost::Live(live) = m { Some(live.sequence) } else { None }).collect();
    let expected: Vec<u32> = (0..10).chain(13..20).chain(22..30).collect();
    assert_eq!(numbers, expected);
    let counters = LinkCounters { frames_sent: 30, frames_received: 25, frames_lost: 5, crc_errors: 2 };
    assert_eq!(client.counters(), counters);
}

#[test]
fn frames_without_a_message_are_counted_as_damaged() {
    let (cable, mut client) = connected();
    let mut out = [0; MAX_FRAME];
    let len = frame(&[200, 1, 2, 3], &mut out);
    cable.insole().to_host.extend(&out[..len]);
    assert_eq!(receive_all(&mut client), []);
    assert_eq!(client.counters().crc_errors, 1);
}

#[test]
fn a_new_session_does_not_count_the_old_stream_as_lost() {
    let (cable, mut client) = connected();
    for _ in 0..2 {
        client.stream().expect("the stream starts");
        cable.live_frames(5);
        receive_all(&mut client);
        client.reconnect(TIMEOUT).expect("the insole answers");
    }
    let counters = client.counters();
    assert_eq!((counters.frames_received, counters.frames_lost), (10, 0));
}

/// An insole that sends implausible frame numbers cannot make the host's counter overflow.
#[test]
fn the_counter_of_lost_frames_saturates() {
    let (cable, mut client) = connected();
    for sequence in [0, 1 << 30, 1 << 31, 3 << 30, 0, 1 << 30, 1 << 31] {
        cable.insole().to_host.extend(framed(&ToHost::Live(live(sequence))));
    }
    receive_all(&mut client);
    assert_eq!((client.counters().frames_received, client.counters().frames_lost), (7, u32::MAX));
}

/// A program has ended, and a buffer of the link still contains the hello and the live frames of its session.
#[test]
fn messages_of_a_previous_session_are_not_counted_as_lost() {
    let cable = Cable::new(hello());
    let previous =
        [framed(&ToHost::Hello(hello())), framed(&ToHost::Live(live(100))), framed(&ToHost::Live(live(101)))];
    cable.insole().to_host.extend(previous.concat());
    let mut client = Client::connect(Framed::new(cable.clone()), TIMEOUT).expect("the insole answers");
    client.stream().expect("the stream starts");
    cable.live_frames(3);
    receive_all(&mut client);
    assert_eq!(client.counters().frames_lost, 0);
}

#[test]
fn messages_that_arrive_while_the_stream_is_turned_on_are_delivered_in_order() {
    let (cable, mut client) = connected();
    push_steps(&cable, 0..3);
    client.stream().expect("the stream starts");
    cable.live_frames(1);
    let expected = [0, 1, 2].map(|number| ToHost::Step(step(number))).into_iter().chain([ToHost::Live(live(0))]);
    assert_eq!(receive_all(&mut client), expected.collect::<Vec<_>>());
}

#[test]
fn a_status_arrives_on_request() {
    let (_, mut client) = connected();
    client.send(ToDevice::GetStatus).expect("the link works");
    let expected = Status {
        live_due: 0,
        live_sent: 0,
        records_dropped: 0,
        faults: 0,
        rezeroed: 0,
        is_clock_set: false,
        ..status()
    };
    assert_eq!(receive_all(&mut client), [ToHost::Status(expected)]);
}

#[test]
fn another_version_is_refused_with_both_versions_in_the_message() {
    let other = Hello { major: MAJOR + 6, minor: 42, ..hello() };
    let error =
        Client::connect(Framed::new(Cable::new(other.clone())), TIMEOUT).err().expect("the version must be refused");
    let (theirs, ours) = (format!("{}.42", MAJOR + 6), format!("{MAJOR}.{MINOR}"));
    let message = error.to_string();
    assert!(message.contains(&theirs) && message.contains(&ours), "{message}");
    assert!(message.contains(other.firmware.as_str()), "{message}");
    assert!(matches!(error, Error::OtherVersion { major, minor: 42, .. } if major == MAJOR + 6), "{message}");
}

/// An insole with an older protocol cannot be updated over the link.
#[test]
fn the_remedy_for_another_version_depends_on_which_one_is_older() {
    for (major, remedy) in
        [(MAJOR - 1, "flash newer firmware over the debug port"), (MAJOR + 1, "newer version of this program")]
    {
        let other = Framed::new(Cable::new(Hello { major, ..hello() }));
        let message = Client::connect(other, TIMEOUT).err().expect("the version must be refused").to_string();
        assert!(message.contains(remedy), "{message}");
    }
}

/// The insole answers a chunk of another image only after its host has given up.
#[test]
fn a_late_answer_to_a_chunk_is_not_taken_for_the_answer_to_an_offer() {
    let (cable, mut client) = connected();
    cable.insole().to_host.extend(framed(&ToHost::Update(Progress::Next(7))));
    let offer = Offer { header: Header::new("test", "1.0.0"), chunks: 10, signature: Default::default() };
    assert_eq!(client.update(Request::Begin(offer)).expect("an answer"), Progress::Next(0));
}

/// Refusals of the requests of an earlier host arrive only after that host has given up.
#[test]
fn late_refusals_are_not_taken_for_the_answer_to_an_offer() {
    let (cable, mut client) = connected();
    for _ in 0..2 {
        cable.insole().to_host.extend(framed(&ToHost::Refused(Refusal::NotStored)));
    }
    let offer = Offer { header: Header::new("test", "1.0.0"), chunks: 10, signature: Default::default() };
    assert_eq!(client.update(Request::Begin(offer)).expect("an answer"), Progress::Next(0));
}

#[test]
fn a_newer_minor_version_is_accepted() {
    let newer = Hello { minor: MINOR + 1, ..hello() };
    let client = Client::connect(Framed::new(Cable::new(newer.clone())), TIMEOUT).expect("the insole answers");
    assert_eq!(*client.hello(), newer);
}

#[test]
fn a_missing_answer_is_an_error_with_the_time_waited() {
    let cable = Cable::new(hello());
    cable.insole().drop_next = usize::MAX;
    let timeout = Duration::from_millis(20);
    let error = Client::connect(Framed::new(cable), timeout).err().expect("there must be no answer");
    assert!(matches!(error, Error::NoAnswer(time, 0) if time == timeout), "{error}");
    assert!(error.to_string().contains("within 0.02 s"), "{error}");
}

#[test]
fn damaged_frames_are_no_answer_and_are_counted() {
    let cable = Cable::new(hello());
    cable.insole().damage_next = usize::MAX;
    let error = Client::connect(Framed::new(cable), Duration::from_millis(20)).err().expect("there must be no answer");
    assert!(matches!(error, Error::NoAnswer(_, damaged) if damaged > 0), "{error}");
}

#[test]
fn an_unplugged_cable_is_an_error() {
    let (cable, mut client) = connected();
    cable.insole().is_unplugged = true;
    assert!(matches!(client.receive(), Err(Error::Carrier(_))));
}

#[test]
fn parameters_are_set_and_read_back_unchanged() {
    let (cable, mut client) = connected();
    assert_eq!(client.tissue().expect("the insole answers"), Tissue::NONE);
    client.set_tissue(&TISSUE).expect("the parameters are accepted");
    assert_eq!(*cable.insole().session.tissue(), *TISSUE);
    assert_eq!(client.tissue().expect("the insole answers"), *TISSUE);
    assert_eq!(client.hello().tissue_id, TISSUE.id);
    assert_eq!(client.reconnect(TIMEOUT).expect("the insole answers").tissue_id, TISSUE.id);
    assert_eq!(receive_all(&mut client), [], "the client must consume the answers");
}

#[test]
fn messages_that_arrive_while_parameters_are_set_are_delivered_in_order() {
    let (cable, mut client) = connected();
    client.stream().expect("the stream starts");
    push_steps(&cable, 0..2);
    cable.live_frames(3);
    client.set_tissue(&TISSUE).expect("the parameters are accepted");
    push_steps(&cable, 2..3);
    client.tissue().expect("the insole answers");
    let got = receive_all(&mut client);
    assert_eq!(step_numbers(&got), [0, 1, 2]);
    assert_eq!(got.len(), 6, "there must be three steps and three live frames: {got:?}");
    assert_eq!(client.counters().frames_lost, 0);
}

#[test]
fn refused_parameters_are_an_error_with_the_reason() {
    let (cable, mut client) = connected();
    client.set_tissue(&TISSUE).expect("the parameters are accepted");
    let mut force_laws = TISSUE.force_laws;
    force_laws[Region::Toe2 as usize].stiffness_pa = -1.0;
    for (bad, reason) in [
        (Tissue::new(force_laws), Refusal::Tissue(Region::Toe2)),
        (Tissue { force_laws, ..*TISSUE }, Refusal::TissueId),
        (Tissue::NONE, Refusal::TissueId),
    ] {
        let error = client.set_tissue(&bad).expect_err("the parameters must be refused");
        assert!(matches!(error, Error::Refused(refusal) if refusal == reason), "{error}");
        assert!(error.to_string().contains(&reason.to_string()), "{error}");
    }
    assert_eq!(*cable.insole().session.tissue(), *TISSUE);
    assert_eq!(client.tissue().expect("the insole answers"), *TISSUE);
}

#[test]
fn faults_arrive_on_request() {
    let (cable, mut client) = connected();
    assert_eq!(cable.insole().session.set_faults(&faults()), faults().found);
    assert_eq!(client.faults().expect("the insole answers"), faults());
}

#[test]
fn a_lost_answer_to_new_parameters_is_an_error_and_no_step_is_lost() {
    let (cable, mut client) = connected();
    push_steps(&cable, [7]);
    cable.insole().send();
    cable.insole().drop_next = 1;
    let error = client.set_tissue(&TISSUE).expect_err("there must be no answer");
    assert!(matches!(error, Error::LostAnswer(..)), "{error}");
    let message = error.to_string();
    assert!(
        message.contains("did not answer a request within 2 s") && message.contains("check the cable"),
        "{message}"
    );
    assert_eq!(step_numbers(&receive_all(&mut client)), [7]);
}

//! The insole's side of a session, tested message by message.

use plantar::firmware::serve::READ_BYTES;
use plantar::pipeline::alert::{AlertRules, DailyLoad};
use plantar::pipeline::baseline::ZeroResult;
use plantar::pipeline::calibrate::CellCalibration;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::cumulative::LoadLimits;
use plantar::pipeline::setup::Setup;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::tissue::{AreaFilter, Identified, Tissue};
use plantar::protocol::BLOCK_CELLS;
use plantar::protocol::session::{ANSWER_QUEUE, Command, CommandResult, RECORD_QUEUE, Session};
use plantar::protocol::update::{Progress, Request};
use plantar::protocol::{
    CellCoder, CellStream, Ellipses, Hello, Identity, MAJOR, MAX_MESSAGE, MINOR, Refusal, Resolution, SETUP_CELLS,
    Serial, Settings, Status, ToDevice, ToHost, decode, encode,
};
use plantar::{Region, Side};
use testkit::{SETUP, TISSUE, alert, bout, cell, daily_load, framed, hello, live, status, step};

/// A message to the host, in a short form.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Sent {
    Hello,
    Live(u32),
    Step(u32),
    Bout(u32),
    Status(Status),
    Tissue(u32),
    Refused(Refusal),
    Time { host_us: u64, device_us: u64 },
    Identity(Identity),
    CalibrationBlock(u8),
    Update(Progress),
    Faults(u32),
    CellStream(Option<CellStream>),
    Cells { scan: u32, dropped: u32 },
    Setup,
    SetupCells(usize),
    Settings(Option<Settings>),
    Identified(Option<Identified>),
    Alert(u32),
    AlertRules(AlertRules),
    DailyLoad(DailyLoad),
    Ellipses(u32),
    Zero(ZeroResult),
}

/// The next message that the insole sends. Its content must be that of the fixtures.
fn next(session: &mut Session) -> Option<Sent> {
    let mut buffer = [0; MAX_MESSAGE];
    let bytes = session.next(&hello(), status, &mut buffer)?;
    Some(match decode(bytes).expect("the bytes are one complete message") {
        ToHost::Hello(got) => {
            assert_eq!(got, Hello { tissue_id: session.tissue().id, ..hello() });
            Sent::Hello
        }
        ToHost::Live(got) => {
            assert_eq!(got, live(got.sequence));
            Sent::Live(got.sequence)
        }
        ToHost::Step(got) => {
            assert_eq!(got, step(got.step));
            Sent::Step(got.step)
        }
        ToHost::Bout(got) => {
            assert_eq!(got, bout(got.number));
            Sent::Bout(got.number)
        }
        ToHost::Status(got) => Sent::Status(got),
        ToHost::Tissue(got) => {
            assert_eq!(got, *session.tissue());
            Sent::Tissue(got.id)
        }
        ToHost::Refused(got) => Sent::Refused(got),
        ToHost::Time { host_us, device_us } => Sent::Time { host_us, device_us },
        ToHost::Identity(got) => {
            assert_eq!(got, session.identity());
            Sent::Identity(got)
        }
        ToHost::CalibrationBlock { block } => Sent::CalibrationBlock(block),
        ToHost::Update(progress) => Sent::Update(progress),
        ToHost::Faults(got) => Sent::Faults(got.found),
        ToHost::CellStream(got) => Sent::CellStream(got),
        ToHost::Cells(got) => Sent::Cells { scan: got.scan, dropped: got.dropped },
        ToHost::Setup(got) => {
            assert_eq!(got, SETUP);
            Sent::Setup
        }
        ToHost::SetupCells { cells, .. } => Sent::SetupCells(cells.len()),
        ToHost::Settings(got) => Sent::Settings(got),
        ToHost::Identified(got) => Sent::Identified(got),
        ToHost::Alert(got) => {
            assert_eq!(got, alert(got.number));
            Sent::Alert(got.number)
        }
        ToHost::AlertRules(got) => Sent::AlertRules(got),
        ToHost::DailyLoad(got) => Sent::DailyLoad(got),
        ToHost::Ellipses(got) => Sent::Ellipses(got.sequence),
        ToHost::Zero(got) => Sent::Zero(got),
    })
}

/// All messages that the insole sends now.
fn all(session: &mut Session) -> Vec<Sent> {
    std::iter::from_fn(|| next(session)).collect()
}

/// The numbers of the steps among all messages that the insole sends now.
fn steps(session: &mut Session) -> Vec<u32> {
    all(session)
        .into_iter()
        .filter_map(|sent| if let Sent::Step(number) = sent { Some(number) } else { None })
        .collect()
}

fn connect(session: &mut Session) {
    session.receive(ToDevice::Connect { major: MAJOR, minor: MINOR }, 0);
}

fn acknowledge(session: &mut Session, step: u32) {
    session.receive(ToDevice::Acknowledge { number: step }, 0);
}

/// Queues a live frame if the host requested live frames, as the insole does.
fn push_live(session: &mut Session) {
    if let Some(number) = session.next_live() {
        session.push_live(live(number));
    }
}

/// A session in which the host has requested live frames.
fn streaming() -> Session {
    let mut session = Session::new();
    connect(&mut session);
    session.receive(ToDevice::Stream { live: true }, 0);
    assert_eq!(all(&mut session), [Sent::Hello]);
    session
}

/// A closed session with these queued steps.
fn with_steps(numbers: impl IntoIterator<Item = u32>) -> Session {
    let mut session = Session::new();
    numbers.into_iter().for_each(|number| session.push_record(step(number)));
    session
}

#[test]
fn nothing_is_sent_before_a_host_connects() {
    let mut session = with_steps(0..3);
    session.receive(ToDevice::Stream { live: true }, 0);
    session.receive(ToDevice::GetStatus, 0);
    acknowledge(&mut session, 2);
    assert_eq!(session.next_live(), None);
    assert_eq!(all(&mut session), []);
    connect(&mut session);
    assert_eq!(
        all(&mut session),
        [Sent::Hello, Sent::Step(0), Sent::Step(1), Sent::Step(2)],
        "the acknowledgement must be ignored"
    );
}

#[test]
fn a_host_of_another_major_version_gets_a_hello_and_nothing_else() {
    for major in [0, MAJOR - 1, MAJOR + 1, u8::MAX] {
        let mut session = with_steps(0..3);
        for message in [
            ToDevice::Connect { major, minor: MINOR },
            ToDevice::Stream { live: true },
            ToDevice::GetStatus,
            ToDevice::Acknowledge { number: 2 },
        ] {
            session.receive(message, 0);
        }
        assert_eq!(session.next_live(), None);
        assert_eq!(all(&mut session), [Sent::Hello], "major {major}");
        connect(&mut session);
        assert_eq!(steps(&mut session), [0, 1, 2], "major {major}");
    }
}

#[test]
fn another_minor_version_is_accepted() {
    let mut session = with_steps(0..1);
    session.receive(ToDevice::Connect { major: MAJOR, minor: MINOR + 1 }, 0);
    assert_eq!(all(&mut session), [Sent::Hello, Sent::Step(0)]);
}

#[test]
fn a_host_of_another_major_version_ends_the_session() {
    let mut session = streaming();
    push_live(&mut session);
    session.receive(ToDevice::Connect { major: MAJOR + 1, minor: 0 }, 0);
    assert_eq!(session.next_live(), None);
    assert_eq!(all(&mut session), [Sent::Hello]);
}

#[test]
fn steps_are_sent_once_in_each_session_until_they_are_acknowledged() {
    let mut session = with_steps(0..3);
    connect(&mut session);
    assert_eq!(steps(&mut session), [0, 1, 2]);
    assert!(steps(&mut session).is_empty(), "a step must not be repeated in the same session");
    acknowledge(&mut session, 1);
    session.push_record(step(3));
    assert_eq!(steps(&mut session), [3]);

    connect(&mut session);
    assert_eq!(steps(&mut session), [2, 3], "unacknowledged steps must be repeated in the next session");
    acknowledge(&mut session, 3);
    connect(&mut session);
    assert!(steps(&mut session).is_empty());
}

#[test]
fn steps_that_were_not_sent_cannot_be_acknowledged() {
    let mut session = with_steps(0..3);
    connect(&mut session);
    assert_eq!([next(&mut session), next(&mut session)], [Some(Sent::Hello), Some(Sent::Step(0))]);
    // Only step 0 was sent, and is acknowledged.
    acknowledge(&mut session, 2);
    assert_eq!(steps(&mut session), [1, 2]);
    // Steps that were sent in an earlier session, but not yet in this one, cannot be acknowledged either.
    connect(&mut session);
    acknowledge(&mut session, 2);
    assert_eq!(steps(&mut session), [1, 2]);
    acknowledge(&mut session, 2);
    connect(&mut session);
    assert!(steps(&mut session).is_empty());
}

#[test]
fn an_outdated_acknowledgement_has_no_effect() {
    let mut session = with_steps(10..13);
    connect(&mut session);
    assert_eq!(steps(&mut session), [10, 11, 12]);
    for old in [0, 9, u32::MAX] {
        acknowledge(&mut session, old);
    }
    connect(&mut session);
    assert_eq!(steps(&mut session), [10, 11, 12]);
}

#[test]
fn load_bouts_are_sent_and_acknowledged_in_one_order_with_steps() {
    let mut session = with_steps([0]);
    session.push_record(bout(1));
    session.push_record(step(2));
    connect(&mut session);
    assert_eq!(all(&mut session), [Sent::Hello, Sent::Step(0), Sent::Bout(1), Sent::Step(2)]);
    acknowledge(&mut session, 0);
    connect(&mut session);
    assert_eq!(all(&mut session), [Sent::Hello, Sent::Bout(1), Sent::Step(2)]);
    acknowledge(&mut session, 1);
    assert_eq!((session.take_acknowledged(), session.newest_record()), (Some(1), Some(2)));
    connect(&mut session);
    assert_eq!(all(&mut session), [Sent::Hello, Sent::Step(2)]);
}

#[test]
fn step_numbers_wrap() {
    let mut session = with_steps([u32::MAX - 1, u32::MAX, 0, 1]);
    connect(&mut session);
    assert_eq!(steps(&mut session), [u32::MAX - 1, u32::MAX, 0, 1]);
    acknowledge(&mut session, 0);
    connect(&mut session);
    assert_eq!(steps(&mut session), [1]);
}

#[test]
fn a_full_queue_drops_the_oldest_step_and_counts_it() {
    let count = RECORD_QUEUE as u32;
    let mut session = with_steps(0..count + 5);
    connect(&mut session);
    session.receive(ToDevice::GetStatus, 0);
    let sent = all(&mut session);
    let expected: Vec<_> = (5..count + 5).map(Sent::Step).collect();
    assert_eq!(sent[1..=RECORD_QUEUE], expected);
    assert!(matches!(sent.last(), Some(Sent::Status(s)) if s.records_dropped == 5), "{sent:?}");
}

#[test]
fn a_full_queue_of_sent_steps_accepts_new_ones() {
    let count = RECORD_QUEUE as u32;
    let mut session = with_steps(0..count);
    connect(&mut session);
    assert_eq!(steps(&mut session).len(), RECORD_QUEUE);
    session.push_record(step(count));
    session.push_record(step(count + 1));
    assert_eq!(steps(&mut session), [count, count + 1], "no step must be repeated or missing");
    acknowledge(&mut session, count);
    connect(&mut session);
    assert_eq!(steps(&mut session), [count + 1]);
}

#[test]
fn live_frames_are_numbered_from_the_start_of_a_session() {
    let mut session = streaming();
    for number in 0..3 {
        push_live(&mut session);
        assert_eq!(all(&mut session), [Sent::Live(number)]);
    }
    connect(&mut session);
    assert_eq!(session.next_live(), None, "a new session must not have live frames without a request");
    session.receive(ToDevice::Stream { live: true }, 0);
    push_live(&mut session);
    assert_eq!(all(&mut session), [Sent::Hello, Sent::Live(0)]);
}

#[test]
fn live_frames_that_are_dropped_because_the_carrier_is_slow_leave_a_gap() {
    let mut session = streaming();
    (0..100).for_each(|_| push_live(&mut session));
    session.receive(ToDevice::GetStatus, 0);
    let sent = all(&mut session);
    let (last, live) = sent.split_last().expect("the insole sends a status");
    let newest: Vec<_> = (100 - live.len() as u32..100).map(Sent::Live).collect();
    assert_eq!(live, newest, "the newest frames must be sent, in order");
    assert!((1..100).contains(&live.len()));
    assert!(matches!(last, Sent::Status(s) if s.live_due == 100 && s.live_sent as usize == live.len()), "{last:?}");
    push_live(&mut session);
    assert_eq!(all(&mut session), [Sent::Live(100)]);
}

#[test]
fn a_stream_that_is_turned_off_stops_at_once() {
    let mut session = streaming();
    push_live(&mut session);
    session.receive(ToDevice::Stream { live: false }, 0);
    assert_eq!(session.next_live(), None);
    assert_eq!(all(&mut session), []);
    session.receive(ToDevice::Stream { live: true }, 0);
    push_live(&mut session);
    assert_eq!(all(&mut session), [Sent::Live(1)], "the frame that was discarded must leave a gap");
}

/// A host repeats the request if it has received no frame.
#[test]
fn a_repeated_request_for_the_stream_discards_no_frame() {
    let mut session = streaming();
    push_live(&mut session);
    session.receive(ToDevice::Stream { live: true }, 0);
    push_live(&mut session);
    assert_eq!(all(&mut session), [Sent::Live(0), Sent::Live(1)]);
}

#[test]
fn steps_are_sent_before_live_frames_and_live_frames_before_the_status() {
    let mut session = streaming();
    push_live(&mut session);
    session.receive(ToDevice::GetStatus, 0);
    session.push_record(step(0));
    push_live(&mut session);
    let sent = all(&mut session);
    assert_eq!(sent[..3], [Sent::Step(0), Sent::Live(0), Sent::Live(1)]);
    let expected = Status {
        live_due: 2,
        live_sent: 2,
        records_dropped: 0,
        faults: 0,
        rezeroed: 0,
        is_clock_set: false,
        ..status()
    };
    assert_eq!(sent[3..], [Sent::Status(expected)]);
    assert_eq!(all(&mut session), [], "there must be one status for each request");
}

#[test]
fn steps_remain_queued_when_the_session_is_closed() {
    let mut session = streaming();
    session.push_record(step(0));
    assert_eq!(steps(&mut session), [0]);
    session.push_record(step(1));
    push_live(&mut session);
    session.receive(ToDevice::GetStatus, 0);
    session.close();
    assert_eq!(session.next_live(), None);
    assert_eq!(all(&mut session), []);
    session.push_record(step(2));
    assert_eq!(all(&mut session), [], "steps must wait until a host connects");
    connect(&mut session);
    assert_eq!(all(&mut session), [Sent::Hello, Sent::Step(0), Sent::Step(1), Sent::Step(2)]);
}

#[test]
fn dropped_steps_are_counted_across_sessions() {
    let mut session = with_steps(0..RECORD_QUEUE as u32 + 2);
    session.close();
    connect(&mut session);
    session.receive(ToDevice::GetStatus, 0);
    assert!(matches!(all(&mut session).last(), Some(Sent::Status(s)) if s.records_dropped == 2));
}

/// Other valid parameters.
fn other_tissue() -> Tissue {
    let mut force_laws = TISSUE.force_laws;
    force_laws[0].stiffness_pa *= 2.0;
    Tissue::new(force_laws)
}

/// Invalid parameters, each with the reason of the refusal.
fn bad_tissues() -> [(Tissue, Refusal); 4] {
    let mut force_laws = TISSUE.force_laws;
    force_laws[Region::Toe2 as usize].c_m = 1.0;
    [
        (Tissue::new(force_laws), Refusal::Tissue(Region::Toe2)),
        (Tissue { force_laws, ..*TISSUE }, Refusal::TissueId),
        (Tissue { force_laws: other_tissue().force_laws, ..*TISSUE }, Refusal::TissueId),
        (Tissue::NONE, Refusal::TissueId),
    ]
}

#[test]
fn accepted_parameters_are_confirmed_and_reported_from_then_on() {
    let mut session = streaming();
    session.receive(ToDevice::GetTissue, 0);
    assert_eq!(all(&mut session), [Sent::Tissue(0)], "there must be no parameters yet");
    for tissue in [*TISSUE, other_tissue(), *TISSUE, *TISSUE] {
        session.receive(ToDevice::SetTissue(tissue), 0);
        assert_eq!(session.command(), Some(Command::Tissue(tissue, None)));
        assert_eq!(all(&mut session), [], "there must be no answer before the parameters are stored");
        session.complete(Ok(CommandResult::Stored));
        assert_eq!(*session.tissue(), tissue);
        assert_eq!(
            session.take_tissue_due(),
            None,
            "new parameters must not apply before the answer, because earlier live frames use the previous ones"
        );
        assert_eq!(all(&mut session), [Sent::Tissue(tissue.id)]);
        assert_eq!(session.take_tissue_due(), Some(&tissue), "the parameters must apply, also if they are the same");
        assert_eq!(session.take_tissue_due(), None, "parameters must apply once");
    }
    assert!(session.next_live().is_some(), "the stream must continue");
    session.close();
    session.receive(ToDevice::GetTissue, 0);
    assert_eq!(all(&mut session), []);
    connect(&mut session);
    session.receive(ToDevice::GetTissue, 0);
    assert_eq!(
        all(&mut session),
        [Sent::Hello, Sent::Tissue(TISSUE.id)],
        "the parameters must remain; `next` checks their identifier in the hello"
    );
}

#[test]
fn refused_parameters_are_answered_with_the_reason_and_change_nothing() {
    let mut session = streaming();
    for before in [Tissue::NONE, *TISSUE] {
        for (bad, reason) in bad_tissues() {
            session.receive(ToDevice::SetTissue(bad), 0);
            assert_eq!(*session.tissue(), before);
            assert_eq!(all(&mut session), [Sent::Refused(reason)]);
        }
        session.receive_unknown();
        assert_eq!(all(&mut session), [Sent::Refused(Refusal::NotUnderstood)]);
        session.receive(ToDevice::SetTissue(*TISSUE), 0);
        session.complete(Ok(CommandResult::Stored));
        all(&mut session);
    }
}

#[test]
fn answers_are_sent_in_the_order_of_the_requests_after_queued_messages() {
    let mut session = streaming();
    let (bad, reason) = bad_tissues()[0];
    push_live(&mut session);
    session.push_record(step(0));
    for request in [
        ToDevice::SetTissue(bad),
        ToDevice::SetTissue(*TISSUE),
        ToDevice::GetStatus,
        ToDevice::SetTissue(bad),
        ToDevice::GetTissue,
    ] {
        session.receive(request, 0);
        session.complete(Ok(CommandResult::Stored));
    }
    session.receive_unknown();
    let sent = all(&mut session);
    assert_eq!(sent[..4], [Sent::Step(0), Sent::Live(0), Sent::Refused(reason), Sent::Tissue(TISSUE.id)]);
    assert!(matches!(sent[4], Sent::Status(_)));
    assert_eq!(sent[5..], [Sent::Refused(reason), Sent::Tissue(TISSUE.id), Sent::Refused(Refusal::NotUnderstood)]);
}

/// The carrier sends one message while the insole queues two live frames, so that the queue of live frames is never empty.
#[test]
fn a_carrier_that_is_too_slow_for_live_frames_delivers_answers() {
    let mut session = streaming();
    let sent_of = |session: &mut Session, requests: &[ToDevice]| {
        requests.iter().for_each(|request| session.receive(*request, 0));
        session.complete(Ok(CommandResult::Stored));
        let mut sent = Vec::new();
        for _ in 0..40 {
            push_live(session);
            push_live(session);
            sent.extend(next(session));
        }
        sent
    };
    sent_of(&mut session, &[]);
    let sent = sent_of(&mut session, &[ToDevice::GetStatus, ToDevice::GetTime { host_us: 1 }]);
    let index = sent.iter().position(|sent| matches!(sent, Sent::Status(_))).expect("the insole answers");
    assert!(index <= 8, "the answer is sent after {index} frames");
    assert!(matches!(sent[index + 1], Sent::Time { .. }));
    // `live_due` of the status includes every live frame that was sent before the status, and none of those after it.
    let [Sent::Live(before), Sent::Status(status), _, Sent::Live(after)] = sent[index - 1..=index + 2] else {
        panic!("{sent:?}")
    };
    assert!(before < status.live_due && status.live_due <= after, "{before}, {status:?}, {after}");

    // Every live frame after the answer was queued after it, because earlier frames were computed with the previous parameters.
    let first = session.next_live().expect("the host streams");
    let sent = sent_of(&mut session, &[ToDevice::SetTissue(*TISSUE)]);
    let index = sent.iter().position(|sent| *sent == Sent::Tissue(TISSUE.id)).expect("the insole answers");
    assert!(index <= 8, "the answer is sent after {index} frames");
    let Sent::Live(after) = sent[index + 1] else { panic!("{sent:?}") };
    assert!(after >= first + 2 * (index as u32 + 1), "{first} {index} {after}");
}

/// Only new parameters make the queued live frames out of date.
#[test]
fn live_frames_remain_queued_when_another_value_could_not_be_stored() {
    let mut session = streaming();
    session.receive(ToDevice::SetSettings(None), 0);
    session.complete(Err(Refusal::NotStored));
    session.receive(ToDevice::GetTissue, 0);
    let mut sent = Vec::new();
    for _ in 0..12 {
        push_live(&mut session);
        sent.extend(next(&mut session));
    }
    let live: Vec<_> = sent.iter().filter(|sent| matches!(sent, Sent::Live(_))).copied().collect();
    assert_eq!(live, (0..10).map(Sent::Live).collect::<Vec<_>>());
    assert!(sent.contains(&Sent::Refused(Refusal::NotStored)) && sent.contains(&Sent::Tissue(0)));
}

#[test]
fn parameters_that_are_stored_after_the_host_has_gone_are_put_in_force() {
    let mut session = Session::new();
    connect(&mut session);
    session.receive(ToDevice::SetTissue(*TISSUE), 0);
    session.close();
    session.complete(Ok(CommandResult::Stored));
    assert_eq!(session.take_tissue_due().map(|tissue| tissue.id), Some(TISSUE.id));
}

/// Rules of alerts that could not be stored are in force until the next start, and the host must know that they are not stored.
#[test]
fn a_host_is_informed_that_its_rules_of_alerts_could_not_be_stored() {
    let mut session = streaming();
    session.receive(ToDevice::SetAlertRules(AlertRules::RECOMMENDED), 0);
    session.complete(Err(Refusal::NotStored));
    assert_eq!(all(&mut session), [Sent::Refused(Refusal::NotStored)]);
    session.receive(ToDevice::GetAlertRules, 0);
    assert_eq!(all(&mut session), [Sent::AlertRules(AlertRules::RECOMMENDED)]);
}

/// A host that connects after the carrier was lost would take the result for the answer to a request of its own. New parameters
/// and rules of alerts are announced to this host, too, but not that they could not be stored.
#[test]
fn the_result_of_a_command_is_not_sent_to_the_host_of_the_next_session() {
    let rules = ToDevice::SetAlertRules(AlertRules::RECOMMENDED);
    for (command, result, expected) in [
        (ToDevice::SetSettings(None), Err(Refusal::NotStored), None),
        (ToDevice::SetSettings(None), Ok(CommandResult::Stored), None),
        (ToDevice::SetTissue(*TISSUE), Err(Refusal::NotStored), Some(Sent::Tissue(TISSUE.id))),
        (ToDevice::SetTissue(*TISSUE), Ok(CommandResult::Stored), Some(Sent::Tissue(TISSUE.id))),
        (rules, Err(Refusal::NotStored), Some(Sent::AlertRules(AlertRules::RECOMMENDED))),
        (rules, Ok(CommandResult::Stored), Some(Sent::AlertRules(AlertRules::RECOMMENDED))),
    ] {
        let mut session = streaming();
        session.receive(command, 0);
        session.close();
        connect(&mut session);
        assert_eq!(all(&mut session), [Sent::Hello]);
        session.complete(result);
        assert_eq!(all(&mut session), Vec::from_iter(expected));
        session.receive(ToDevice::SetSettings(None), 0);
        session.complete(Ok(CommandResult::Stored));
        assert_eq!(all(&mut session), [Sent::Settings(None)], "the session's own command is answered");
        // The host connects again within its session, as hosts do after they have missed records.
        session.receive(ToDevice::SetSettings(None), 0);
        connect(&mut session);
        session.complete(Ok(CommandResult::Stored));
        assert_eq!(all(&mut session), [Sent::Hello, Sent::Settings(None)]);
    }
}

#[test]
fn parameters_are_not_accepted_outside_of_a_session() {
    for connect in [None, Some(ToDevice::Connect { major: MAJOR + 1, minor: MINOR })] {
        let mut session = Session::new();
        connect.into_iter().for_each(|connect| session.receive(connect, 0));
        session.receive(ToDevice::SetTissue(*TISSUE), 0);
        session.receive(ToDevice::SetTissue(bad_tissues()[0].0), 0);
        session.receive(ToDevice::GetTissue, 0);
        session.receive_unknown();
        assert_eq!(*session.tissue(), Tissue::NONE);
        assert!(all(&mut session).iter().all(|sent| *sent == Sent::Hello));
    }
}

#[test]
fn only_some_of_too_many_requests_are_answered() {
    let mut session = streaming();
    (0..1000).for_each(|_| session.receive(ToDevice::GetTissue, 0));
    assert_eq!(all(&mut session), [Sent::Tissue(0); ANSWER_QUEUE]);
    session.receive(ToDevice::GetStatus, 0);
    assert!(matches!(all(&mut session)[..], [Sent::Status(_)]));
}

/// A read can complete a request that began in an earlier read, and then contain the shortest frames that are answered: those of
/// an empty message.
#[test]
fn all_requests_of_one_read_are_answered() {
    let shortest = framed(&()).len();
    let requests = 1 + (READ_BYTES - 1) / shortest;
    let mut session = streaming();
    (0..requests).for_each(|_| session.receive_unknown());
    assert_eq!(all(&mut session), vec![Sent::Refused(Refusal::NotUnderstood); requests]);
}

#[test]
fn a_command_is_answered_when_it_is_complete_and_others_are_refused_meanwhile() {
    let mut session = streaming();
    let serial = Serial::new("P-0001").expect("the serial number is valid");
    let request = ToDevice::SetIdentity { side: Side::Right, serial };
    session.receive(request, 0);
    assert_eq!(session.command(), Some(Command::SetIdentity(Side::Right, serial)));
    // Another command is refused, and changes nothing.
    session.receive(ToDevice::SetTissue(*TISSUE), 0);
    assert_eq!(all(&mut session), [Sent::Refused(Refusal::Busy)]);
    assert_eq!(*session.tissue(), Tissue::NONE);
    let identity = Identity { side: Side::Right, serial, calibration_id: 5 };
    session.complete(Ok(CommandResult::Identity(identity)));
    assert_eq!((session.command(), all(&mut session)), (None, vec![Sent::Identity(identity)]));

    let cells = [CellCalibration { offset: 3, gain: 1.0 }; BLOCK_CELLS];
    session.receive(ToDevice::SetCalibrationBlock { block: 2, cells }, 0);
    assert_eq!(session.command(), Some(Command::CalibrationBlock(2, cells)));
    session.complete(Ok(CommandResult::Stored));
    session.receive(ToDevice::SetTissue(*TISSUE), 0);
    session.complete(Err(Refusal::NotStored));
    session.receive(ToDevice::SetCalibration { layout_id: 1, cells: 2, id: 3 }, 0);
    session.complete(Err(Refusal::Calibration));
    let sent = [Sent::CalibrationBlock(2), Sent::Refused(Refusal::NotStored), Sent::Refused(Refusal::Calibration)];
    assert_eq!(all(&mut session), sent);
    assert_eq!(*session.tissue(), *TISSUE, "parameters that could not be stored must be in force until the next start");
    assert_eq!(session.identity(), identity);
    session.receive(ToDevice::Update(Request::Finish), 0);
    assert_eq!(session.command(), Some(Command::Update(Request::Finish)));
    session.complete(Ok(CommandResult::Update(Progress::Accepted)));
    assert_eq!(all(&mut session), [Sent::Update(Progress::Accepted)]);
    // A result without a pending command has no effect.
    session.complete(Ok(CommandResult::Identity(Identity { calibration_id: 6, ..identity })));
    assert_eq!((all(&mut session), session.identity()), (vec![], identity));
}

#[test]
fn invalid_calibrations_and_serial_numbers_are_refused() {
    let mut session = streaming();
    let bad = [f32::NAN, 0.0, -1.0, 1e9].map(|gain| CellCalibration { offset: 3, gain });
    for calibration in bad.into_iter().chain([CellCalibration { offset: u16::MAX, gain: 1.0 }]) {
        let mut cells = [CellCalibration::IDEAL; BLOCK_CELLS];
        cells[7] = calibration;
        session.receive(ToDevice::SetCalibrationBlock { block: 0, cells }, 0);
        assert_eq!(all(&mut session), [Sent::Refused(Refusal::Calibration)], "{calibration:?}");
    }
    // There are 16 blocks. In the store, a number of 128 or more would name a block in the other slot of the calibration.
    for block in [16, 127, 128, 255] {
        let cells = [CellCalibration::IDEAL; BLOCK_CELLS];
        session.receive(ToDevice::SetCalibrationBlock { block, cells }, 0);
        assert_eq!(all(&mut session), [Sent::Refused(Refusal::Calibration)], "{block}");
    }
    let mut bytes = [0; MAX_MESSAGE];
    let request =
        ToDevice::SetIdentity { side: Side::Left, serial: Serial::new("AB").expect("the serial number is valid") };
    let bytes = encode(&request, &mut bytes).expect("the message fits");
    // A control character in the serial number, and a character after its end.
    for (at, byte) in [(2, 7), (10, b'x')] {
        let mut damaged = bytes.to_vec();
        damaged[at] = byte;
        session.receive(decode(&damaged).expect("the bytes are a message"), 0);
        assert_eq!(all(&mut session), [Sent::Refused(Refusal::Serial)]);
    }
    assert_eq!(session.command(), None);
}

#[test]
fn an_acknowledgement_is_passed_to_the_storage_once() {
    let numbers = 10..15;
    let mut session = with_steps(numbers.clone());
    assert_eq!((session.has_room(), session.newest_record()), (RECORD_QUEUE > numbers.len(), Some(14)));
    connect(&mut session);
    acknowledge(&mut session, 12);
    assert_eq!(session.take_acknowledged(), None, "steps that were not sent must not be acknowledged");
    assert_eq!(steps(&mut session), [10, 11, 12, 13, 14]);
    acknowledge(&mut session, 11);
    acknowledge(&mut session, 12);
    assert_eq!(session.take_acknowledged(), Some(12));
    assert_eq!(session.take_acknowledged(), None);
    session.close();
    acknowledge(&mut session, 14);
    assert_eq!(session.take_acknowledged(), None);
}

/// The frames of cells wait for everything else but ellipses. Where the carrier is too slow, scans are dropped whole and counted,
/// and the sequence numbers of the frames that are sent have no gap, so that a host can unpack them.
#[test]
fn frames_of_cells_wait_for_other_messages_and_are_dropped_whole() {
    let mut session = streaming();
    let stream = CellStream { resolution: Resolution::Converter, every: 1 };
    session.receive(ToDevice::StreamCells(Some(stream)), 0);
    assert_eq!(all(&mut session), [Sent::CellStream(Some(stream))]);
    (0..5).for_each(|scan| session.push_cells(scan, &[100 * scan as u16; 240]));
    push_live(&mut session);
    session.push_record(step(0));
    let cells = |scan, dropped| Sent::Cells { scan, dropped };
    assert_eq!(all(&mut session), [Sent::Step(0), Sent::Live(0), cells(0, 0), cells(1, 0), cells(2, 0)]);
    session.push_cells(5, &[500; 240]);
    let mut buffer = [0; MAX_MESSAGE];
    let frame = session.next(&hello(), status, &mut buffer).and_then(decode);
    let Some(ToHost::Cells(frame)) = frame else { panic!("{frame:?}") };
    assert_eq!((frame.sequence, frame.scan, frame.dropped), (3, 5, 2));

    session.receive(ToDevice::StreamCells(None), 0);
    session.push_cells(6, &[600; 240]);
    assert_eq!(all(&mut session), [Sent::CellStream(None)]);
}

/// Queues the ellipses of a frame if they are due, as the insole does.
fn push_ellipses(session: &mut Session, frame: u32) {
    if let Some(sequence) = session.ellipses.due() {
        session.ellipses.push(Ellipses { sequence, t_us: frame.into(), regions: Default::default() });
    }
}

#[test]
fn ellipses_have_a_rate_of_at_most_25_hz() {
    let mut session = streaming();
    session.receive(ToDevice::StreamEllipses { every: 40 }, 0);
    assert_eq!(all(&mut session), [Sent::Refused(Refusal::NoLayout)]);
    for (period_us, least) in [(10_000, 4), (2_500, 16), (3_333, 13), (50_000, 1)] {
        session.set_layout(Setup { period_us, ..SETUP }, &[], None);
        for every in 1..least {
            session.receive(ToDevice::StreamEllipses { every }, 0);
            assert_eq!(all(&mut session), [Sent::Refused(Refusal::EllipseRate { every: least })]);
            assert_eq!(session.ellipses.due(), None, "there must be no stream");
        }
        session.receive(ToDevice::StreamEllipses { every: least }, 0);
        let due = (0..3 * least).filter(|&frame| {
            push_ellipses(&mut session, frame.into());
            all(&mut session).len() == 1
        });
        assert_eq!(due.collect::<Vec<_>>(), [0, least, 2 * least]);
        session.receive(ToDevice::StreamEllipses { every: 0 }, 0);
        assert_eq!((session.ellipses.due(), all(&mut session)), (None, vec![]));
    }
}

#[test]
fn ellipses_wait_for_all_other_messages_and_only_the_newest_is_sent() {
    let mut session = streaming();
    session.set_layout(SETUP, &[], None);
    session.receive(ToDevice::StreamEllipses { every: 10 }, 0);
    let stream = CellStream { resolution: Resolution::Converter, every: 1 };
    session.receive(ToDevice::StreamCells(Some(stream)), 0);
    (0..30).for_each(|frame| push_ellipses(&mut session, frame));
    session.push_cells(0, &[100; 240]);
    push_live(&mut session);
    session.push_record(step(0));
    let cells = Sent::Cells { scan: 0, dropped: 0 };
    let expected = [Sent::Step(0), Sent::Live(0), Sent::CellStream(Some(stream)), cells, Sent::Ellipses(2)];
    assert_eq!(all(&mut session), expected);
    // Another host receives none unless it asks for them.
    connect(&mut session);
    assert_eq!(session.ellipses.due(), None);
}

#[test]
fn one_of_every_n_scans_is_sent() {
    let mut session = streaming();
    session.receive(ToDevice::StreamCells(Some(CellStream { resolution: Resolution::Oversampled, every: 3 })), 0);
    (0..9).for_each(|scan| session.push_cells(scan, &[0; 240]));
    let sent: Vec<_> = all(&mut session).into_iter().skip(1).collect();
    assert_eq!(sent, [0, 3, 6].map(|scan| Sent::Cells { scan, dropped: 0 }));
}

#[test]
fn the_set_up_is_read_in_parts_and_refused_without_a_layout() {
    let mut session = streaming();
    session.receive(ToDevice::GetSetup, 0);
    session.receive(ToDevice::GetSetupCells { first: 0 }, 0);
    assert_eq!(all(&mut session), [Sent::Refused(Refusal::NoLayout); 2]);
    let cells: &'static [_] = vec![cell(Region::Heel, 10.0, 20.0, 25.0); SETUP_CELLS + 4].leak();
    session.set_layout(SETUP, cells, None);
    session.receive(ToDevice::GetSetup, 0);
    for first in [0, SETUP_CELLS as u16, 1000] {
        session.receive(ToDevice::GetSetupCells { first }, 0);
    }
    let expected = [Sent::Setup, Sent::SetupCells(SETUP_CELLS), Sent::SetupCells(4), Sent::SetupCells(0)];
    assert_eq!(all(&mut session), expected);
}

#[test]
fn settings_are_checked_stored_and_read() {
    let mut session = streaming();
    let settings = Settings { contact: ContactRule::COVERED, scale: 0.9, ..Settings::of(&SETUP) };
    let bad = [
        Settings { period_us: 2_000, ..settings },
        Settings { period_us: 50_000, ..settings },
        Settings { scale: 0.5, ..settings },
        Settings { scale: f32::NAN, ..settings },
        Settings { contact: ContactRule { off_kpa: 11.0, ..settings.contact }, ..settings },
    ];
    for settings in bad {
        session.receive(ToDevice::SetSettings(Some(settings)), 0);
        assert_eq!((session.command(), all(&mut session)), (None, vec![Sent::Refused(Refusal::Settings)]));
    }
    for stored in [Some(settings), None] {
        session.receive(ToDevice::SetSettings(stored), 0);
        assert_eq!(session.command(), Some(Command::Settings(stored)));
        session.complete(Ok(CommandResult::Stored));
        session.receive(ToDevice::GetSettings, 0);
        assert_eq!(all(&mut session), [Sent::Settings(stored); 2]);
    }
    session.receive(ToDevice::SetSettings(Some(settings)), 0);
    session.complete(Err(Refusal::NotStored));
    session.receive(ToDevice::GetSettings, 0);
    assert_eq!(all(&mut session), [Sent::Refused(Refusal::NotStored), Sent::Settings(None)]);
}

/// In the board's set-up, settings replace the rules and the period, and nothing else; their scale applies to the cells.
#[test]
fn settings_replace_values_of_the_board() {
    let settings =
        Settings { contact: ContactRule::COVERED, stance: StanceRule::ABSOLUTE, period_us: 12_500, scale: 1.0 };
    let Settings { contact, stance, period_us, .. } = settings;
    let setup = settings.apply_to(SETUP);
    assert_eq!(setup, Setup { contact, stance, period_us, ..SETUP });
    assert!(contact != SETUP.contact && stance != SETUP.stance && period_us != SETUP.period_us);
}

#[test]
fn identified_parameters_are_accepted_only_if_their_contact_rule_is_in_force() {
    let mut session = streaming();
    let identified = Identified {
        contact: SETUP.contact,
        filter: AreaFilter::Direct,
        side: Some(Side::Left),
        steps: 31,
        regions: 0b1101,
    };
    let request =
        |contact| ToDevice::SetIdentifiedTissue { tissue: *TISSUE, identified: Identified { contact, ..identified } };
    // Without a layout no rule is in force.
    session.receive(request(SETUP.contact), 0);
    assert_eq!(all(&mut session), [Sent::Refused(Refusal::NoLayout)]);
    session.set_layout(SETUP, &[], None);
    session.receive(request(ContactRule::COVERED), 0);
    assert_eq!(all(&mut session), [Sent::Refused(Refusal::ContactRule)]);
    assert_eq!(*session.tissue(), Tissue::NONE);

    session.receive(request(SETUP.contact), 0);
    session.complete(Ok(CommandResult::Stored));
    session.receive(ToDevice::GetIdentified, 0);
    assert_eq!(all(&mut session), [Sent::Tissue(TISSUE.id), Sent::Identified(Some(identified))]);
    assert_eq!(session.tracked_regions(), 0b1101);
    // Parameters without this information delete it.
    session.receive(ToDevice::SetTissue(*TISSUE), 0);
    session.complete(Ok(CommandResult::Stored));
    session.receive(ToDevice::GetIdentified, 0);
    assert_eq!(all(&mut session), [Sent::Tissue(TISSUE.id), Sent::Identified(None)]);
    assert_eq!(session.tracked_regions(), 0);
    // Tracking compares the forces of step records, which are computed with the direct filter, so parameters that were
    // identified with the filter of the live stream are not tracked.
    let identified = Identified { filter: AreaFilter::Live, ..identified };
    session.receive(ToDevice::SetIdentifiedTissue { tissue: *TISSUE, identified }, 0);
    session.complete(Ok(CommandResult::Stored));
    assert_eq!(session.tracked_regions(), 0);
}

#[test]
fn a_queued_frame_of_cells_has_the_bytes_of_its_message() {
    let mut session = streaming();
    let stream = CellStream { resolution: Resolution::Converter, every: 1 };
    session.receive(ToDevice::StreamCells(Some(stream)), 0);
    assert_eq!(all(&mut session), [Sent::CellStream(Some(stream))]);
    let mut coder = CellCoder::new(stream.resolution);
    for scan in [0, 300, 70_000] {
        let codes: Vec<u16> = (0..240).map(|cell| 7 * cell * (scan % 99) as u16).collect();
        session.push_cells(scan, &codes);
        let (mut sent, mut expected) = ([0; MAX_MESSAGE], [0; MAX_MESSAGE]);
        let expected = encode(&ToHost::Cells(coder.pack(scan, 0, &codes)), &mut expected).expect("the message fits");
        assert_eq!(session.next(&hello(), status, &mut sent), Some(&*expected));
    }
}

#[test]
fn rules_of_alerts_are_checked_stored_and_passed_to_the_insole() {
    let mut session = Session::new();
    connect(&mut session);
    all(&mut session);
    for wrong in [
        AlertRules { limits: LoadLimits { window_s: 901, ..LoadLimits::DEFAULT }, ..AlertRules::RECOMMENDED },
        AlertRules { limits: LoadLimits { relieved_percent: 95, ..LoadLimits::DEFAULT }, ..AlertRules::RECOMMENDED },
        AlertRules { limits: LoadLimits { sustained_kpa: f32::NAN, ..LoadLimits::DEFAULT }, ..AlertRules::RECOMMENDED },
        AlertRules { pause_s: 59, ..AlertRules::RECOMMENDED },
        AlertRules { day_start_min: 1440, ..AlertRules::RECOMMENDED },
        AlertRules { dose_kpa_s: -1.0, ..AlertRules::RECOMMENDED },
    ] {
        session.receive(ToDevice::SetAlertRules(wrong), 0);
        assert_eq!(session.command(), None);
        assert_eq!(all(&mut session), [Sent::Refused(Refusal::AlertRules)]);
    }
    session.receive(ToDevice::GetAlertRules, 0);
    assert_eq!(all(&mut session), [Sent::AlertRules(AlertRules::OFF)], "the previous rules must remain in force");

    session.receive(ToDevice::SetAlertRules(AlertRules::RECOMMENDED), 0);
    assert_eq!(session.command(), Some(Command::AlertRules(AlertRules::RECOMMENDED)));
    session.complete(Ok(CommandResult::Stored));
    assert_eq!(all(&mut session), [Sent::AlertRules(AlertRules::RECOMMENDED)]);
    assert_eq!(session.take_to_insole().rules, Some(AlertRules::RECOMMENDED));
    assert_eq!(session.take_to_insole().rules, None);
}

/// A snooze is answered with the load of the day once the insole has executed it.
#[test]
fn a_snooze_waits_for_the_insole() {
    let mut session = Session::new();
    session.set_layout(SETUP, &[], None);
    connect(&mut session);
    all(&mut session);
    session.receive(ToDevice::SnoozeAlerts { snoozed_s: 1_100 }, 0);
    assert_eq!(all(&mut session), []);
    let to_insole = session.take_to_insole();
    assert_eq!((to_insole.snooze_s, to_insole.is_load_awaited), (Some(1_100), true));
    session.set_daily_load(daily_load(), true);
    assert_eq!(all(&mut session), [Sent::DailyLoad(daily_load())]);
    // A host that connects meanwhile does not wait for this answer, but the snooze takes effect.
    session.receive(ToDevice::SnoozeAlerts { snoozed_s: 60 }, 0);
    connect(&mut session);
    let to_insole = session.take_to_insole();
    assert_eq!((to_insole.snooze_s, to_insole.is_load_awaited), (Some(60), false));
    all(&mut session);
    session.receive(ToDevice::GetDailyLoad, 0);
    assert_eq!(all(&mut session), [Sent::DailyLoad(daily_load())]);
}

#[test]
fn alerts_are_sent_until_they_are_acknowledged() {
    let mut session = Session::new();
    session.push_record(step(4));
    session.push_record(alert(5));
    connect(&mut session);
    assert_eq!(all(&mut session), [Sent::Hello, Sent::Step(4), Sent::Alert(5)]);
    session.receive(ToDevice::Acknowledge { number: 4 }, 0);
    connect(&mut session);
    assert_eq!(all(&mut session), [Sent::Hello, Sent::Alert(5)]);
    session.receive(ToDevice::Acknowledge { number: 5 }, 0);
    connect(&mut session);
    assert_eq!(all(&mut session), [Sent::Hello]);
}

#[test]
fn a_request_to_measure_the_baselines_is_passed_to_the_insole_and_answered() {
    let mut session = Session::new();
    connect(&mut session);
    all(&mut session);
    session.receive(ToDevice::Zero, 0);
    assert_eq!(all(&mut session), [Sent::Refused(Refusal::NoLayout)]);
    session.set_layout(SETUP, &[], None);
    session.receive(ToDevice::Zero, 0);
    assert!(session.take_to_insole().zero && !session.take_to_insole().zero);
    assert_eq!(all(&mut session), []);
    let result = ZeroResult { changed: 3, with_former_baseline: [1; 8], residual_dn: [40; 8] };
    session.answer_zero(Ok(result));
    assert_eq!(all(&mut session), [Sent::Zero(result)]);

    // The next host must not take the outcome as the answer to its own request.
    session.receive(ToDevice::Zero, 0);
    connect(&mut session);
    session.answer_zero(Err(Refusal::NotLifted));
    assert_eq!(all(&mut session), [Sent::Hello]);
    assert!(!session.take_to_insole().zero);
}

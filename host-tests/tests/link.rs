//! An insole's side of a session, message by message.

use plantar::pipeline::calibrate::CellCalibration;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::BLOCK_CELLS;
use plantar::protocol::session::{Command, CommandResult, STEP_QUEUE, Session};
use plantar::protocol::update::{Progress, Request};
use plantar::protocol::{
    Hello, Identity, MAJOR, MAX_MESSAGE, MINOR, Refusal, Serial, Status, ToDevice, ToHost, decode, encode,
};
use plantar::{Region, Side};
use testkit::{TISSUE, hello, live, status, step};

/// What the host gets, in short.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Sent {
    Hello,
    Live(u32),
    Step(u32),
    Status(Status),
    Tissue(u32),
    Refused(Refusal),
    Time { host_us: u64, device_us: u64 },
    Identity(Identity),
    CalibrationBlock(u8),
    Update(Progress),
    Faults(u32),
}

fn next(link: &mut Session) -> Option<Sent> {
    let mut buffer = [0; MAX_MESSAGE];
    let bytes = link.next(&hello(), status, &mut buffer)?;
    Some(match decode(bytes).expect("one whole message") {
        ToHost::Hello(got) => {
            assert_eq!(got, Hello { tissue_id: link.tissue().id, ..hello() });
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
        ToHost::Status(got) => Sent::Status(got),
        ToHost::Tissue(got) => {
            assert_eq!(got, *link.tissue());
            Sent::Tissue(got.id)
        }
        ToHost::Refused(got) => Sent::Refused(got),
        ToHost::Time { host_us, device_us } => Sent::Time { host_us, device_us },
        ToHost::Identity(got) => {
            assert_eq!(got, link.identity());
            Sent::Identity(got)
        }
        ToHost::CalibrationBlock { block } => Sent::CalibrationBlock(block),
        ToHost::Update(progress) => Sent::Update(progress),
        ToHost::Faults(got) => Sent::Faults(got.found),
    })
}

fn all(link: &mut Session) -> Vec<Sent> {
    std::iter::from_fn(|| next(link)).collect()
}

fn steps(link: &mut Session) -> Vec<u32> {
    all(link).into_iter().filter_map(|sent| if let Sent::Step(number) = sent { Some(number) } else { None }).collect()
}

fn connect(link: &mut Session) {
    link.receive(ToDevice::Connect { major: MAJOR, minor: MINOR }, 0);
}

fn acknowledge(link: &mut Session, step: u32) {
    link.receive(ToDevice::Acknowledge { step }, 0);
}

/// A frame as the insole makes it: only where somebody listens.
fn frame(link: &mut Session) {
    if let Some(number) = link.next_live() {
        link.push_live(live(number));
    }
}

fn streaming() -> Session {
    let mut link = Session::new();
    connect(&mut link);
    link.receive(ToDevice::Stream { live: true }, 0);
    assert_eq!(all(&mut link), [Sent::Hello]);
    link
}

fn with_steps(numbers: impl IntoIterator<Item = u32>) -> Session {
    let mut link = Session::new();
    numbers.into_iter().for_each(|number| link.push_step(step(number)));
    link
}

#[test]
fn nothing_is_sent_before_a_host_connects() {
    let mut link = with_steps(0..3);
    link.receive(ToDevice::Stream { live: true }, 0);
    link.receive(ToDevice::GetStatus, 0);
    acknowledge(&mut link, 2);
    assert_eq!(link.next_live(), None);
    assert_eq!(all(&mut link), []);
    connect(&mut link);
    assert_eq!(all(&mut link), [Sent::Hello, Sent::Step(0), Sent::Step(1), Sent::Step(2)], "nor was anything taken");
}

#[test]
fn a_host_of_another_major_gets_a_hello_and_nothing_else() {
    for major in [0, MAJOR - 1, MAJOR + 1, u8::MAX] {
        let mut link = with_steps(0..3);
        for message in [
            ToDevice::Connect { major, minor: MINOR },
            ToDevice::Stream { live: true },
            ToDevice::GetStatus,
            ToDevice::Acknowledge { step: 2 },
        ] {
            link.receive(message, 0);
        }
        assert_eq!(link.next_live(), None);
        assert_eq!(all(&mut link), [Sent::Hello], "major {major}");
        connect(&mut link);
        assert_eq!(steps(&mut link), [0, 1, 2], "major {major}");
    }
}

#[test]
fn another_minor_is_welcome() {
    let mut link = with_steps(0..1);
    link.receive(ToDevice::Connect { major: MAJOR, minor: MINOR + 1 }, 0);
    assert_eq!(all(&mut link), [Sent::Hello, Sent::Step(0)]);
}

#[test]
fn a_connect_by_another_major_ends_the_session() {
    let mut link = streaming();
    frame(&mut link);
    link.receive(ToDevice::Connect { major: MAJOR + 1, minor: 0 }, 0);
    assert_eq!(link.next_live(), None);
    assert_eq!(all(&mut link), [Sent::Hello]);
}

#[test]
fn steps_come_once_a_session_until_they_are_acknowledged() {
    let mut link = with_steps(0..3);
    connect(&mut link);
    assert_eq!(steps(&mut link), [0, 1, 2]);
    assert!(steps(&mut link).is_empty(), "not again in the same session");
    acknowledge(&mut link, 1);
    link.push_step(step(3));
    assert_eq!(steps(&mut link), [3]);

    connect(&mut link);
    assert_eq!(steps(&mut link), [2, 3], "again in the next one");
    acknowledge(&mut link, 3);
    connect(&mut link);
    assert!(steps(&mut link).is_empty());
}

#[test]
fn only_what_was_sent_is_acknowledged() {
    let mut link = with_steps(0..3);
    connect(&mut link);
    assert_eq!([next(&mut link), next(&mut link)], [Some(Sent::Hello), Some(Sent::Step(0))]);
    acknowledge(&mut link, 2);
    assert_eq!(steps(&mut link), [1, 2]);
    // Sent in an earlier session, not yet in this one.
    connect(&mut link);
    acknowledge(&mut link, 2);
    assert_eq!(steps(&mut link), [1, 2]);
    acknowledge(&mut link, 2);
    connect(&mut link);
    assert!(steps(&mut link).is_empty());
}

#[test]
fn an_old_acknowledgement_takes_nothing() {
    let mut link = with_steps(10..13);
    connect(&mut link);
    assert_eq!(steps(&mut link), [10, 11, 12]);
    for old in [0, 9, u32::MAX] {
        acknowledge(&mut link, old);
    }
    connect(&mut link);
    assert_eq!(steps(&mut link), [10, 11, 12]);
}

#[test]
fn step_numbers_wrap() {
    let mut link = with_steps([u32::MAX - 1, u32::MAX, 0, 1]);
    connect(&mut link);
    assert_eq!(steps(&mut link), [u32::MAX - 1, u32::MAX, 0, 1]);
    acknowledge(&mut link, 0);
    connect(&mut link);
    assert_eq!(steps(&mut link), [1]);
}

#[test]
fn the_oldest_step_makes_room_and_is_counted() {
    let count = STEP_QUEUE as u32;
    let mut link = with_steps(0..count + 5);
    connect(&mut link);
    link.receive(ToDevice::GetStatus, 0);
    let sent = all(&mut link);
    let expected: Vec<_> = (5..count + 5).map(Sent::Step).collect();
    assert_eq!(sent[1..=STEP_QUEUE], expected);
    assert!(matches!(sent.last(), Some(Sent::Status(s)) if s.steps_dropped == 5), "{sent:?}");
}

#[test]
fn a_full_queue_of_sent_steps_takes_new_ones() {
    let count = STEP_QUEUE as u32;
    let mut link = with_steps(0..count);
    connect(&mut link);
    assert_eq!(steps(&mut link).len(), STEP_QUEUE);
    link.push_step(step(count));
    link.push_step(step(count + 1));
    assert_eq!(steps(&mut link), [count, count + 1], "none twice, none left out");
    acknowledge(&mut link, count);
    connect(&mut link);
    assert_eq!(steps(&mut link), [count + 1]);
}

#[test]
fn live_frames_are_numbered_from_the_start_of_a_session() {
    let mut link = streaming();
    for number in 0..3 {
        frame(&mut link);
        assert_eq!(all(&mut link), [Sent::Live(number)]);
    }
    connect(&mut link);
    assert_eq!(link.next_live(), None, "a new session does not stream by itself");
    link.receive(ToDevice::Stream { live: true }, 0);
    frame(&mut link);
    assert_eq!(all(&mut link), [Sent::Hello, Sent::Live(0)]);
}

#[test]
fn frames_that_a_slow_carrier_drops_leave_a_gap() {
    let mut link = streaming();
    (0..100).for_each(|_| frame(&mut link));
    link.receive(ToDevice::GetStatus, 0);
    let sent = all(&mut link);
    let (last, live) = sent.split_last().expect("a status at least");
    let newest: Vec<_> = (100 - live.len() as u32..100).map(Sent::Live).collect();
    assert_eq!(live, newest, "the newest, in order");
    assert!((1..100).contains(&live.len()));
    assert!(matches!(last, Sent::Status(s) if s.live_due == 100 && s.live_sent as usize == live.len()), "{last:?}");
    frame(&mut link);
    assert_eq!(all(&mut link), [Sent::Live(100)]);
}

#[test]
fn a_stream_that_is_turned_off_stops_at_once() {
    let mut link = streaming();
    frame(&mut link);
    link.receive(ToDevice::Stream { live: false }, 0);
    assert_eq!(link.next_live(), None);
    assert_eq!(all(&mut link), []);
    link.receive(ToDevice::Stream { live: true }, 0);
    frame(&mut link);
    assert_eq!(all(&mut link), [Sent::Live(1)], "the frame that was thrown away leaves a gap");
}

#[test]
fn hello_comes_first_steps_before_live_frames_and_status_last() {
    let mut link = streaming();
    frame(&mut link);
    link.receive(ToDevice::GetStatus, 0);
    link.push_step(step(0));
    frame(&mut link);
    let sent = all(&mut link);
    assert_eq!(sent[..3], [Sent::Step(0), Sent::Live(0), Sent::Live(1)]);
    let expected = Status { live_due: 2, live_sent: 2, steps_dropped: 0, faults: 0, rezeroed: 0, ..status() };
    assert_eq!(sent[3..], [Sent::Status(expected)]);
    assert_eq!(all(&mut link), [], "one status a request");
}

#[test]
fn close_ends_the_session_and_keeps_the_steps() {
    let mut link = streaming();
    link.push_step(step(0));
    assert_eq!(steps(&mut link), [0]);
    link.push_step(step(1));
    frame(&mut link);
    link.receive(ToDevice::GetStatus, 0);
    link.close();
    assert_eq!(link.next_live(), None);
    assert_eq!(all(&mut link), []);
    link.push_step(step(2));
    assert_eq!(all(&mut link), [], "steps wait for a host");
    connect(&mut link);
    assert_eq!(all(&mut link), [Sent::Hello, Sent::Step(0), Sent::Step(1), Sent::Step(2)]);
}

#[test]
fn dropped_steps_are_counted_across_sessions() {
    let mut link = with_steps(0..STEP_QUEUE as u32 + 2);
    link.close();
    connect(&mut link);
    link.receive(ToDevice::GetStatus, 0);
    assert!(matches!(all(&mut link).last(), Some(Sent::Status(s)) if s.steps_dropped == 2));
}

/// Another sound set.
fn other_tissue() -> Tissue {
    let mut force_laws = TISSUE.force_laws;
    force_laws[0].stiffness_pa *= 2.0;
    Tissue::new(force_laws)
}

/// Sets that are refused, with the reason.
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
fn accepted_parameters_are_answered_and_named_from_then_on() {
    let mut link = streaming();
    link.receive(ToDevice::GetTissue, 0);
    assert_eq!(all(&mut link), [Sent::Tissue(0)], "none yet");
    for tissue in [*TISSUE, other_tissue(), *TISSUE, *TISSUE] {
        link.receive(ToDevice::SetTissue(tissue), 0);
        assert_eq!(link.command(), Some(Command::Tissue(tissue)));
        assert_eq!(all(&mut link), [], "not before they are kept");
        link.complete(Ok(CommandResult::Stored));
        assert_eq!(*link.tissue(), tissue);
        assert_eq!(link.tissue_due(), None, "frames before the answer are of the ones before");
        assert_eq!(all(&mut link), [Sent::Tissue(tissue.id)]);
    }
    assert!(link.next_live().is_some(), "the stream goes on");
    link.close();
    link.receive(ToDevice::GetTissue, 0);
    assert_eq!(all(&mut link), []);
    connect(&mut link);
    link.receive(ToDevice::GetTissue, 0);
    assert_eq!(all(&mut link), [Sent::Hello, Sent::Tissue(TISSUE.id)], "and the hello names them, see `next`");
}

#[test]
fn refused_parameters_are_answered_with_the_reason_and_the_old_stay() {
    let mut link = streaming();
    for before in [Tissue::NONE, *TISSUE] {
        for (bad, reason) in bad_tissues() {
            link.receive(ToDevice::SetTissue(bad), 0);
            assert_eq!(*link.tissue(), before);
            assert_eq!(all(&mut link), [Sent::Refused(reason)]);
        }
        link.receive_unknown();
        assert_eq!(all(&mut link), [Sent::Refused(Refusal::NotUnderstood)]);
        link.receive(ToDevice::SetTissue(*TISSUE), 0);
        link.complete(Ok(CommandResult::Stored));
        all(&mut link);
    }
}

#[test]
fn answers_come_in_the_order_of_the_requests_and_after_what_was_before() {
    let mut link = streaming();
    let (bad, reason) = bad_tissues()[0];
    frame(&mut link);
    link.push_step(step(0));
    for request in [
        ToDevice::SetTissue(bad),
        ToDevice::SetTissue(*TISSUE),
        ToDevice::GetStatus,
        ToDevice::SetTissue(bad),
        ToDevice::GetTissue,
    ] {
        link.receive(request, 0);
        link.complete(Ok(CommandResult::Stored));
    }
    link.receive_unknown();
    let sent = all(&mut link);
    assert_eq!(sent[..4], [Sent::Step(0), Sent::Live(0), Sent::Refused(reason), Sent::Tissue(TISSUE.id)]);
    assert!(matches!(sent[4], Sent::Status(_)));
    assert_eq!(sent[5..], [Sent::Refused(reason), Sent::Tissue(TISSUE.id), Sent::Refused(Refusal::NotUnderstood)]);
}

/// A carrier that takes one message where two frames come: the queue of live frames is never empty.
#[test]
fn a_carrier_that_is_too_slow_for_live_frames_brings_answers() {
    let mut link = streaming();
    let sent_of = |link: &mut Session, requests: &[ToDevice]| {
        requests.iter().for_each(|request| link.receive(*request, 0));
        link.complete(Ok(CommandResult::Stored));
        let mut sent = Vec::new();
        for _ in 0..40 {
            frame(link);
            frame(link);
            sent.extend(next(link));
        }
        sent
    };
    sent_of(&mut link, &[]);
    let sent = sent_of(&mut link, &[ToDevice::GetStatus, ToDevice::GetTime { host_us: 1 }]);
    let at = sent.iter().position(|sent| matches!(sent, Sent::Status(_))).expect("an answer");
    assert!(at <= 8, "after {at} frames");
    assert!(matches!(sent[at + 1], Sent::Time { .. }));
    // What the status counts as due is what was sent before it, and what is sent after it is not.
    let (Sent::Live(before), Sent::Status(status), Sent::Live(after)) = (sent[at - 1], sent[at], sent[at + 2]) else {
        panic!("{sent:?}")
    };
    assert!(before < status.live_due && status.live_due <= after, "{before}, {status:?}, {after}");

    // No frame after the answer is older than it: those are of the parameters before.
    let first = link.next_live().expect("it streams");
    let sent = sent_of(&mut link, &[ToDevice::SetTissue(*TISSUE)]);
    let at = sent.iter().position(|sent| *sent == Sent::Tissue(TISSUE.id)).expect("an answer");
    assert!(at <= 8, "after {at} frames");
    let Sent::Live(after) = sent[at + 1] else { panic!("{sent:?}") };
    assert!(after >= first + 2 * at as u32, "{first} {at} {after}");
}

#[test]
fn parameters_are_not_taken_outside_of_a_session() {
    for connect in [None, Some(ToDevice::Connect { major: MAJOR + 1, minor: MINOR })] {
        let mut link = Session::new();
        connect.into_iter().for_each(|connect| link.receive(connect, 0));
        link.receive(ToDevice::SetTissue(*TISSUE), 0);
        link.receive(ToDevice::SetTissue(bad_tissues()[0].0), 0);
        link.receive(ToDevice::GetTissue, 0);
        link.receive_unknown();
        assert_eq!(*link.tissue(), Tissue::NONE);
        assert!(all(&mut link).iter().all(|sent| *sent == Sent::Hello));
    }
}

#[test]
fn a_flood_of_requests_is_answered_in_part() {
    let mut link = streaming();
    (0..1000).for_each(|_| link.receive(ToDevice::GetTissue, 0));
    let sent = all(&mut link);
    assert!((11..1000).contains(&sent.len()), "{} answers", sent.len());
    link.receive(ToDevice::GetStatus, 0);
    assert!(matches!(all(&mut link)[..], [Sent::Status(_)]));
}

#[test]
fn what_is_kept_is_answered_when_it_is_and_one_job_waits_at_a_time() {
    let mut link = streaming();
    let serial = Serial::new("P-0001").expect("printable");
    let name = ToDevice::SetIdentity { side: Side::Right, serial };
    link.receive(name, 0);
    assert_eq!(link.command(), Some(Command::SetIdentity(Side::Right, serial)));
    // Another has to wait, and changes nothing.
    link.receive(ToDevice::SetTissue(*TISSUE), 0);
    assert_eq!(all(&mut link), [Sent::Refused(Refusal::Busy)]);
    assert_eq!(*link.tissue(), Tissue::NONE);
    let identity = Identity { side: Side::Right, serial, calibration_id: 5 };
    link.complete(Ok(CommandResult::Identity(identity)));
    assert_eq!((link.command(), all(&mut link)), (None, vec![Sent::Identity(identity)]));

    let cells = [CellCalibration { offset: 3, gain: 1.0 }; BLOCK_CELLS];
    link.receive(ToDevice::SetCalibrationBlock { block: 2, cells }, 0);
    assert_eq!(link.command(), Some(Command::CalibrationBlock(2, cells)));
    link.complete(Ok(CommandResult::Stored));
    link.receive(ToDevice::SetTissue(*TISSUE), 0);
    link.complete(Err(Refusal::NotStored));
    link.receive(ToDevice::SetCalibration { layout_id: 1, cells: 2, id: 3 }, 0);
    link.complete(Err(Refusal::Calibration));
    let sent = [Sent::CalibrationBlock(2), Sent::Refused(Refusal::NotStored), Sent::Refused(Refusal::Calibration)];
    assert_eq!(all(&mut link), sent);
    assert_eq!(*link.tissue(), *TISSUE, "they hold until the next start");
    assert_eq!(link.identity(), identity);
    link.receive(ToDevice::Update(Request::Finish), 0);
    assert_eq!(link.command(), Some(Command::Update(Request::Finish)));
    link.complete(Ok(CommandResult::Update(Progress::Accepted)));
    assert_eq!(all(&mut link), [Sent::Update(Progress::Accepted)]);
    // Nothing was asked.
    link.complete(Ok(CommandResult::Identity(Identity { calibration_id: 6, ..identity })));
    assert_eq!((all(&mut link), link.identity()), (vec![], identity));
}

#[test]
fn what_makes_no_sense_is_not_kept() {
    let mut link = streaming();
    let bad = [f32::NAN, 0.0, -1.0, 1e9].map(|gain| CellCalibration { offset: 3, gain });
    for calibration in bad.into_iter().chain([CellCalibration { offset: u16::MAX, gain: 1.0 }]) {
        let mut cells = [CellCalibration::IDEAL; BLOCK_CELLS];
        cells[7] = calibration;
        link.receive(ToDevice::SetCalibrationBlock { block: 0, cells }, 0);
        assert_eq!(all(&mut link), [Sent::Refused(Refusal::Calibration)], "{calibration:?}");
    }
    // Beyond the last part is the other calibration's place.
    for block in [16, 127, 128, 255] {
        let cells = [CellCalibration::IDEAL; BLOCK_CELLS];
        link.receive(ToDevice::SetCalibrationBlock { block, cells }, 0);
        assert_eq!(all(&mut link), [Sent::Refused(Refusal::Calibration)], "{block}");
    }
    let mut bytes = [0; MAX_MESSAGE];
    let name = ToDevice::SetIdentity { side: Side::Left, serial: Serial::new("AB").expect("printable") };
    let bytes = encode(&name, &mut bytes).expect("it fits");
    // A character that is none, and one after the end.
    for (at, byte) in [(2, 7), (10, b'x')] {
        let mut damaged = bytes.to_vec();
        damaged[at] = byte;
        link.receive(decode(&damaged).expect("a message"), 0);
        assert_eq!(all(&mut link), [Sent::Refused(Refusal::Serial)]);
    }
    assert_eq!(link.command(), None);
}

#[test]
fn acknowledged_steps_are_told_once_where_they_are_kept() {
    let mut link = with_steps(10..15);
    assert_eq!((link.has_room(), link.newest_step()), (STEP_QUEUE > 5, Some(14)));
    connect(&mut link);
    acknowledge(&mut link, 12);
    assert_eq!(link.take_acknowledged(), None, "nothing was sent yet");
    assert_eq!(steps(&mut link), [10, 11, 12, 13, 14]);
    acknowledge(&mut link, 11);
    acknowledge(&mut link, 12);
    assert_eq!(link.take_acknowledged(), Some(12));
    assert_eq!(link.take_acknowledged(), None);
    link.close();
    acknowledge(&mut link, 14);
    assert_eq!(link.take_acknowledged(), None);
}

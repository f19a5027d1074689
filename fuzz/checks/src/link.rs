//! An insole's side of a session with a host that sends any messages: messages fit their limits, counters are consistent, and
//! every lost step is counted.

use crate::Pieces;
use plantar::Side;
use plantar::faults::Faults;
use plantar::pipeline::contact::ContactRule;
use plantar::protocol::session::{CommandResult, LIVE_QUEUE, RECORD_QUEUE, Session};
use plantar::protocol::{
    Hello, Live, MAJOR, MAX_MESSAGE, MINOR, Refusal, Reset, Status, Step, StepFoot, StepRegion, ToDevice, ToHost,
    decode,
};
use plantar::sequence::is_after;

/// The state that the session should have.
#[derive(Default)]
struct Expected {
    /// Number of steps that were queued.
    pushed: u32,
    /// Number of steps that a full queue dropped.
    dropped: u32,
    /// Number of acknowledged steps.
    acknowledged: u32,
    /// The numbers of the steps in the queue.
    unacknowledged: Vec<u32>,
    /// Number of steps of `unacknowledged` that were sent in this session, from the first one on.
    sent: usize,
    /// Number of live frames that were due in this session.
    live_due: u32,
    /// Number of live frames that were sent in this session.
    live_sent: u32,
    /// All live frames before this number were sent or dropped.
    live_passed: u32,
}

impl Expected {
    fn end_session(&mut self) {
        (self.sent, self.live_due, self.live_sent, self.live_passed) = (0, 0, 0, 0);
    }
}

/// Checks one input.
pub fn check(data: &[u8]) {
    let mut session = Session::new();
    let mut expected = Expected::default();
    // A piece is a message from the host, or a single letter for one of these events.
    for piece in Pieces(data) {
        match piece {
            // A live frame is due.
            [b'L'] => {
                if let Some(sequence) = session.next_live() {
                    assert_eq!(sequence, expected.live_due);
                    session.push_live(Live { sequence, t_us: u64::MAX, ..Live::default() });
                    expected.live_due += 1;
                }
            }
            // A step is complete.
            [b'S'] => {
                session.push_record(step(expected.pushed));
                expected.unacknowledged.push(expected.pushed);
                expected.pushed += 1;
                if expected.unacknowledged.len() > RECORD_QUEUE {
                    expected.unacknowledged.remove(0);
                    expected.sent = expected.sent.saturating_sub(1);
                    expected.dropped += 1;
                }
            }
            // The carrier sends the next message.
            [b'N'] => {
                check_next(&mut session, &mut expected);
            }
            // The pending command succeeds or fails.
            [b'K'] => session.complete(Ok(CommandResult::Stored)),
            [b'F'] => session.complete(Err(Refusal::NotStored)),
            // The carrier is disconnected.
            [b'C'] => {
                session.close();
                expected.end_session();
            }
            message => match decode::<ToDevice>(message) {
                Some(message) => receive(&mut session, message, &mut expected),
                None => session.receive_unknown(),
            },
        }
    }
    // A host that connects at the end receives every step that it has not acknowledged, in order.
    receive(&mut session, ToDevice::Connect { major: MAJOR, minor: MINOR }, &mut expected);
    while check_next(&mut session, &mut expected) {}
    assert_eq!(expected.sent, expected.unacknowledged.len());
    assert_eq!(expected.unacknowledged.len() as u32 + expected.dropped + expected.acknowledged, expected.pushed);
}

/// Passes a message from the host to the session.
fn receive(session: &mut Session, message: ToDevice, expected: &mut Expected) {
    // `sent` is 0 while the session is closed, so that no acknowledgement is expected to be accepted then.
    match message {
        ToDevice::Connect { .. } => expected.end_session(),
        ToDevice::Acknowledge { number } => {
            let accepted =
                expected.unacknowledged[..expected.sent].iter().take_while(|&&waiting| !is_after(waiting, number));
            let accepted = accepted.count();
            expected.unacknowledged.drain(..accepted);
            expected.sent -= accepted;
            expected.acknowledged += accepted as u32;
        }
        _ => {}
    }
    session.receive(message, u64::MAX);
}

/// Checks the next message to the host; returns false if there is none.
fn check_next(session: &mut Session, expected: &mut Expected) -> bool {
    let mut buffer = [0; MAX_MESSAGE];
    let Some(message) = session.next(&hello(), Status::default, &mut buffer) else { return false };
    match decode(message).expect("the message has this version") {
        ToHost::Step(step) => {
            assert_eq!(step.step, expected.unacknowledged[expected.sent]);
            expected.sent += 1;
        }
        ToHost::Live(live) => {
            expected.live_sent += 1;
            assert!((expected.live_passed..expected.live_due).contains(&live.sequence));
            expected.live_passed = live.sequence + 1;
        }
        ToHost::Status(status) => {
            // All live frames before `status.live_due` were sent or dropped. Queued frames do not belong to them.
            assert!((expected.live_passed..=expected.live_due).contains(&status.live_due));
            assert!(expected.live_due - status.live_due <= LIVE_QUEUE as u32);
            expected.live_passed = status.live_due;
            assert_eq!(status.live_sent, expected.live_sent);
            assert_eq!(status.records_dropped, expected.dropped);
        }
        ToHost::Tissue(tissue) => assert!(tissue.id == 0 || tissue.check().is_ok()),
        ToHost::Hello(hello) => assert_eq!(hello.tissue_id, session.tissue().id),
        ToHost::Time { device_us, .. } => assert_eq!(device_us, u64::MAX),
        ToHost::Faults(faults) => assert_eq!(faults, Faults::NONE),
        ToHost::Identity(identity) => assert_eq!(identity, session.identity()),
        ToHost::Refused(refusal) => assert!(!refusal.to_string().is_empty()),
        _ => {}
    }
    true
}

/// A hello with a long version and a long crash report.
fn hello() -> Hello {
    let longest = "0123456789abcdef".try_into().expect("the text fits");
    Hello {
        major: MAJOR,
        minor: MINOR,
        firmware: longest,
        board: "fuzz".try_into().expect("the text fits"),
        side: Side::Left,
        layout_id: u32::MAX,
        cells: u16::MAX,
        period_us: u32::MAX,
        tissue_id: 0,
        contact_rule: ContactRule::COVERED,
        reset: Reset::Unknown,
        fault: Some("x".repeat(96).as_str().try_into().expect("the text fits")),
    }
}

/// A step with this number and with the longest encoding of most of its other fields.
fn step(number: u32) -> Step {
    Step {
        step: number,
        side: Side::Right,
        start_us: u64::MAX,
        duration_us: u32::MAX,
        sample_us: u32::MAX,
        bridged_frames: u16::MAX,
        saturated: u8::MAX,
        clamped: u8::MAX,
        contact_rule: ContactRule::COVERED,
        regions: [StepRegion { measured_peak_dn: u16::MAX, ..StepRegion::default() }; 8],
        boots_since: u32::MAX,
        start_unix_us: Some(u64::MAX),
        refit: u8::MAX,
        foot: StepFoot::default(),
    }
}

//! An insole's side of a session under any host: messages fit, counters hold, no step is lost uncounted.
#![no_main]

use libfuzzer_sys::fuzz_target;
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::faults::Faults;
use plantar::protocol::session::{CommandResult, LIVE_QUEUE, STEP_QUEUE, Session};
use plantar::protocol::{Hello, Live, MAJOR, MAX_MESSAGE, MINOR, Refusal, Reset, Status, Step, StepRegion, ToDevice, ToHost, decode};
use plantar_fuzz::Pieces;

/// What the link must have done by its own words.
#[derive(Default)]
struct Expected {
    pushed: u32,
    dropped: u32,
    acknowledged: u32,
    kept: Vec<u32>,
    /// How many of `kept` were sent in this session.
    sent: usize,
    live_due: u32,
    live_sent: u32,
    /// Live frames before this number were sent, or told to be due.
    live_told: u32,
}

impl Expected {
    fn end_session(&mut self) {
        (self.sent, self.live_due, self.live_sent, self.live_told) = (0, 0, 0, 0);
    }
}

fuzz_target!(|data: &[u8]| {
    let mut link = Session::new();
    let mut expected = Expected::default();
    // A message of the host, or one of these in its place.
    for piece in Pieces(data) {
        match piece {
            [b'L'] => {
                if let Some(sequence) = link.next_live() {
                    assert_eq!(sequence, expected.live_due);
                    link.push_live(Live { sequence, t_us: u64::MAX, ..Live::default() });
                    expected.live_due += 1;
                }
            }
            [b'S'] => {
                link.push_step(step(expected.pushed));
                expected.kept.push(expected.pushed);
                expected.pushed += 1;
                if expected.kept.len() > STEP_QUEUE {
                    expected.kept.remove(0);
                    expected.sent = expected.sent.saturating_sub(1);
                    expected.dropped += 1;
                }
            }
            [b'N'] => {
                next(&mut link, &mut expected);
            }
            // What was told is kept, or is not.
            [b'K'] => link.complete(Ok(CommandResult::Stored)),
            [b'F'] => link.complete(Err(Refusal::NotStored)),
            [b'C'] => {
                link.close();
                expected.end_session();
            }
            message => match decode::<ToDevice>(message) {
                Some(message) => receive(&mut link, message, &mut expected),
                None => link.receive_unknown(),
            },
        }
    }
    // A host that comes at last gets every step that it has not stored, in order.
    receive(&mut link, ToDevice::Connect { major: MAJOR, minor: MINOR }, &mut expected);
    while next(&mut link, &mut expected) {}
    assert_eq!(expected.sent, expected.kept.len());
    assert_eq!(expected.kept.len() as u32 + expected.dropped + expected.acknowledged, expected.pushed);
});

fn receive(link: &mut Session, message: ToDevice, expected: &mut Expected) {
    // A closed session streams nothing and takes no acknowledgement: `sent` is 0 then.
    match message {
        ToDevice::Connect { .. } => expected.end_session(),
        ToDevice::Acknowledge { step } => {
            let stored =
                expected.kept[..expected.sent].iter().take_while(|&&kept| step.wrapping_sub(kept) < u32::MAX / 2);
            let stored = stored.count();
            expected.kept.drain(..stored);
            expected.sent -= stored;
            expected.acknowledged += stored as u32;
        }
        _ => {}
    }
    link.receive(message, u64::MAX);
}

fn next(link: &mut Session, expected: &mut Expected) -> bool {
    let mut buffer = [0; MAX_MESSAGE];
    let Some(message) = link.next(&hello(), Status::default, &mut buffer) else { return false };
    match decode(message).expect("a message of this version") {
        ToHost::Step(step) => {
            assert_eq!(step.step, expected.kept[expected.sent]);
            expected.sent += 1;
        }
        ToHost::Live(live) => {
            expected.live_sent += 1;
            assert!((expected.live_told..expected.live_due).contains(&live.sequence));
            expected.live_told = live.sequence + 1;
        }
        ToHost::Status(status) => {
            // All before are sent or dropped, those that wait come after.
            assert!((expected.live_told..=expected.live_due).contains(&status.live_due));
            assert!(expected.live_due - status.live_due <= LIVE_QUEUE as u32);
            expected.live_told = status.live_due;
            assert_eq!(status.live_sent, expected.live_sent);
            assert_eq!(status.steps_dropped, expected.dropped);
        }
        ToHost::Tissue(tissue) => assert!(tissue.id == 0 || tissue.check().is_ok()),
        ToHost::Hello(hello) => assert_eq!(hello.tissue_id, link.tissue().id),
        ToHost::Time { device_us, .. } => assert_eq!(device_us, u64::MAX),
        ToHost::Faults(faults) => assert_eq!(faults, Faults::NONE),
        ToHost::Identity(identity) => assert_eq!(identity, link.identity()),
        ToHost::CalibrationBlock { .. } | ToHost::Update(_) => {}
        ToHost::Refused(refusal) => assert!(!refusal.to_string().is_empty()),
    }
    true
}

fn hello() -> Hello {
    let longest = "0123456789abcdef".try_into().expect("it fits");
    Hello {
        major: MAJOR,
        minor: MINOR,
        firmware: longest,
        board: "fuzz".try_into().expect("it fits"),
        side: Side::Left,
        layout_id: u32::MAX,
        cells: u16::MAX,
        period_us: u32::MAX,
        tissue_id: 0,
        contact_rule: ContactRule::COVERED,
        reset: Reset::Unknown,
        last_panic: Some("x".repeat(96).as_str().try_into().expect("it fits")),
    }
}

fn step(step: u32) -> Step {
    Step {
        step,
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
    }
}

//! The order of the messages of a session.

use crate::acknowledgement::{hello, record};
use plantar::protocol::session::{LIVE_QUEUE, Session};
use plantar::protocol::{Live, LoadRecord, MAJOR, MAX_MESSAGE, MINOR, Status, ToDevice, ToHost, decode};
use std::collections::VecDeque;

/// Number of answers that can wait for the carrier.
const ANSWERS: usize = 16;

/// What happens to a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A live frame is due.
    Live,
    /// The host requests the time.
    Ask,
    /// The insole completes a record.
    Record,
    /// The carrier takes a message.
    Send,
}

/// A sent message, as the event that caused it, and its number.
type Sent = (Event, u64);

fn next(session: &mut Session) -> Option<Sent> {
    let mut buffer = [0; MAX_MESSAGE];
    let message = decode::<ToHost>(session.next(&hello(), Status::default, &mut buffer)?).expect("a message");
    Some(match &message {
        ToHost::Live(live) => (Event::Live, live.sequence.into()),
        ToHost::Time { host_us, .. } => (Event::Ask, *host_us),
        _ => (Event::Record, LoadRecord::of(&message).expect("a record").number().into()),
    })
}

/// These events, with at most six records, happen to a session with a full queue of live frames and with room for one more
/// answer. The session sends records first, then live frames, then answers. While answers wait, it sends at most eight live
/// frames. A full queue of live frames drops the oldest one. A request is not answered if there is no room for the answer.
pub fn message_order(events: &[Event]) {
    let mut session = Session::new();
    session.receive(ToDevice::Connect { major: MAJOR, minor: MINOR }, 0);
    assert!(session.next(&hello(), Status::default, &mut [0; MAX_MESSAGE]).is_some());
    session.receive(ToDevice::Stream { live: true }, 0);
    let [mut live, mut answers, mut records] = [const { VecDeque::new() }; 3];
    // The numbers of the next live frame, of the next request of the time, and of the next record.
    let mut numbers = [0, 0, 0];
    let mut live_before_answer = 0;
    let prepared = [[Event::Live; LIVE_QUEUE].as_slice(), &[Event::Ask; ANSWERS - 1]].concat();
    for event in prepared.iter().chain(events) {
        match event {
            Event::Live => {
                assert_eq!(session.next_live().map(u64::from), Some(numbers[0]));
                session.push_live(Live { sequence: numbers[0] as u32, ..Live::default() });
                live.push_back((Event::Live, numbers[0]));
                if live.len() > LIVE_QUEUE {
                    live.pop_front();
                }
                numbers[0] += 1;
            }
            Event::Ask => {
                session.receive(ToDevice::GetTime { host_us: numbers[1] }, 0);
                if answers.is_empty() {
                    live_before_answer = 0;
                }
                if answers.len() < ANSWERS {
                    answers.push_back((Event::Ask, numbers[1]));
                }
                numbers[1] += 1;
            }
            Event::Record => {
                session.push_record(record(numbers[2] as u32));
                records.push_back((Event::Record, numbers[2]));
                numbers[2] += 1;
            }
            Event::Send => {
                let is_live_due = answers.is_empty() || live_before_answer < LIVE_QUEUE;
                let mut expected = records.pop_front();
                if expected.is_none() && is_live_due {
                    expected = live.pop_front();
                    live_before_answer += usize::from(expected.is_some());
                }
                assert_eq!(next(&mut session), expected.or_else(|| answers.pop_front()));
            }
        }
    }
    while let Some(record) = records.pop_front() {
        assert_eq!(next(&mut session), Some(record));
    }
    // After the end of the session, nothing is sent.
    session.close();
    assert_eq!((session.next_live(), next(&mut session)), (None, None));
}

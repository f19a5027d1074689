//! Acknowledgements: no acknowledged record is sent again, and every other record remains until it is acknowledged, or is
//! dropped and counted.

use heapless::String;
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::protocol::session::{RECORD_QUEUE, Session};
use plantar::protocol::{Alert, Hello, LoadRecord, MAJOR, MAX_MESSAGE, MINOR, Reset, Status, ToDevice, ToHost, decode};

/// What happens to a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// The insole completes a record.
    Record,
    /// The carrier takes the next message, which the host receives.
    Send,
    /// The host acknowledges the record that it has received last.
    Acknowledge,
    /// The host acknowledges a record that the insole has not completed yet.
    AcknowledgeFuture,
    /// The host acknowledges the number before that of the first record.
    AcknowledgePast,
    /// A host connects.
    Connect,
    /// A host of another major version connects.
    ConnectOther,
    /// The link is lost.
    Disconnect,
}

/// All events.
pub const EVENTS: [Event; 8] = [
    Event::Record,
    Event::Send,
    Event::Acknowledge,
    Event::AcknowledgeFuture,
    Event::AcknowledgePast,
    Event::Connect,
    Event::ConnectOther,
    Event::Disconnect,
];

/// A record, here an alert, with this number.
pub fn record(number: u32) -> LoadRecord {
    LoadRecord::Alert(Alert {
        number,
        side: Side::Left,
        start_us: 5,
        sustained: 1,
        dose: 0,
        window_s: 60,
        today: 1,
        boots_since: 0,
        start_unix_us: None,
    })
}

/// The hello of an insole without parameters.
pub fn hello() -> Hello {
    Hello {
        major: MAJOR,
        minor: MINOR,
        firmware: String::new(),
        board: String::new(),
        side: Side::Left,
        layout_id: 1,
        cells: 1,
        period_us: 10_000,
        tissue_id: 0,
        contact_rule: ContactRule::COUNTED,
        reset: Reset::Power,
        fault: None,
    }
}

/// A session, and a model of the records that it must hold. The model identifies a record by its distance from the first one,
/// so that it is independent of the wrap of the record numbers.
struct Observed {
    session: Session,
    hello: Hello,
    /// Number of the first record.
    first: u32,
    /// Number of completed records.
    completed: i64,
    /// The records that no host has acknowledged, and that the full queue has not dropped.
    waiting: Vec<i64>,
    /// Number of `waiting` records, from the oldest, that were sent in this session.
    sent: usize,
    /// Number of records that the full queue has dropped.
    dropped: u32,
    is_open: bool,
    is_hello_due: bool,
    /// The record that the host has received last; -1 before the first one.
    received: i64,
    /// The newest record that a host has acknowledged.
    acknowledged: Option<i64>,
}

impl Observed {
    fn number(&self, record: i64) -> u32 {
        self.first.wrapping_add(record as u32)
    }

    fn connect(&mut self, major: u8) {
        self.session.receive(ToDevice::Connect { major, minor: MINOR }, 0);
        (self.is_open, self.is_hello_due, self.sent) = (major == MAJOR, true, 0);
    }

    fn acknowledge(&mut self, record: i64) {
        self.session.receive(ToDevice::Acknowledge { number: self.number(record) }, 0);
        if self.is_open {
            let arrived = self.waiting[..self.sent].iter().filter(|&&sent| sent <= record).count();
            self.acknowledged = self.waiting.drain(..arrived).next_back().or(self.acknowledged);
            self.sent -= arrived;
        }
    }

    fn send(&mut self) {
        let mut buffer = [0; MAX_MESSAGE];
        let sent = self.session.next(&self.hello, Status::default, &mut buffer).and_then(decode::<ToHost>);
        let is_hello = std::mem::take(&mut self.is_hello_due);
        let due = self.waiting.get(self.sent).copied().filter(|_| self.is_open && !is_hello);
        assert_eq!(matches!(sent, Some(ToHost::Hello(_))), is_hello);
        assert_eq!(sent.as_ref().and_then(LoadRecord::of), due.map(|due| record(self.number(due))));
        if let Some(due) = due {
            (self.sent, self.received) = (self.sent + 1, due);
        }
        assert!(is_hello || due.is_some() || sent.is_none());
    }

    fn apply(&mut self, event: Event) {
        match event {
            Event::Record => {
                self.session.push_record(record(self.number(self.completed)));
                if self.waiting.len() == RECORD_QUEUE {
                    self.waiting.remove(0);
                    self.sent = self.sent.saturating_sub(1);
                    self.dropped += 1;
                }
                self.waiting.push(self.completed);
                self.completed += 1;
            }
            Event::Send => self.send(),
            Event::Acknowledge => self.acknowledge(self.received),
            Event::AcknowledgeFuture => self.acknowledge(self.completed + 3),
            Event::AcknowledgePast => self.acknowledge(-1),
            Event::Connect => self.connect(MAJOR),
            Event::ConnectOther => self.connect(MAJOR + 1),
            Event::Disconnect => {
                self.session.close();
                (self.is_open, self.is_hello_due, self.sent) = (false, false, 0);
            }
        }
        assert_eq!(self.session.newest_record(), self.waiting.last().map(|&last| self.number(last)));
        assert_eq!(self.session.has_room(), self.waiting.len() < RECORD_QUEUE);
    }
}

/// After these events, in a session with records that are numbered from `first`, the next host receives exactly the records
/// that no host has acknowledged and that the full queue has not dropped, each once and in order. The dropped records are
/// counted, and [`Session::take_acknowledged`] returns the newest acknowledged record.
pub fn session(first: u32, events: &[Event]) {
    let mut observed = Observed {
        session: Session::new(),
        hello: hello(),
        first,
        completed: 0,
        waiting: Vec::new(),
        sent: 0,
        dropped: 0,
        is_open: false,
        is_hello_due: false,
        received: -1,
        acknowledged: None,
    };
    // First, the host receives the hello and `RECORD_QUEUE - 2` records. Two more records fill the queue, so that even short
    // sequences of events reach a full queue.
    observed.apply(Event::Connect);
    observed.apply(Event::Send);
    for _ in 0..RECORD_QUEUE - 2 {
        observed.apply(Event::Record);
        observed.apply(Event::Send);
    }
    for &event in events {
        observed.apply(event);
    }
    let acknowledged = observed.acknowledged.map(|record| observed.number(record));
    assert_eq!(observed.session.take_acknowledged(), acknowledged);
    observed.connect(MAJOR);
    for _ in 0..=observed.waiting.len() + 1 {
        observed.send();
    }
    assert_eq!(observed.sent, observed.waiting.len());
    observed.session.receive(ToDevice::GetStatus, 0);
    let mut buffer = [0; MAX_MESSAGE];
    let status = observed.session.next(&observed.hello, Status::default, &mut buffer).and_then(decode::<ToHost>);
    let Some(ToHost::Status(status)) = status else { panic!("no status: {status:?}") };
    assert_eq!(status.records_dropped, observed.dropped);
}

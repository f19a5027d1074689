//! Connects insoles with pages. Each page has a session of its own with each insole, in which the hub acts as the insole.

use crate::lsl::Outlets;
use crate::report;
use client::{ClockMapping, StreamFile, unix_us};
use plantar::pipeline::alert::{AlertRules, DailyLoad};
use plantar::pipeline::setup::{Setup, SetupCell};
use plantar::pipeline::tissue::{Identified, Tissue};
use plantar::protocol::session::{Command, CommandResult, Session};
use plantar::protocol::{
    Ellipses, Hello, Live, LoadRecord, MAX_MESSAGE, Refusal, Status, ToDevice, ToHost, decode, encode,
};
use plantar::sequence;
use std::collections::VecDeque;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Time after which a request of a page counts as lost. An insole answers within a second.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(3);

/// Number of the latest records of an insole that are held for the pages: those of half an hour of walking.
const HELD_RECORDS: usize = 2_000;

/// The state of all insoles, and the sessions of all pages.
pub(crate) struct Hub {
    insoles: Vec<Mutex<Insole>>,
    /// True if a page may replace the wearer's parameters and the rules of alerts.
    accepts_parameters: bool,
    /// `None` without a recording, or after it failed.
    recorder: Mutex<Option<StreamFile>>,
    /// Number of the page that was added last.
    last_page: Mutex<u64>,
    /// Wakes the tasks of the pages.
    changed: watch::Sender<()>,
    has_ended: AtomicBool,
}

#[derive(Default)]
struct Insole {
    /// The hello of the present session; `None` while the link is lost.
    hello: Option<Hello>,
    /// The configuration that pages can read, and its identifier in the hello.
    layout: Option<(u32, Layout)>,
    /// The stream of ellipses that was requested from the insole: the ellipses of one frame out of this number, or 0 for none.
    ellipses_every: u8,
    /// The wearer's parameters, if they are known.
    tissue: Option<Tissue>,
    /// How they were identified; the outer `None` if the insole has not answered since they are in force.
    identified: Option<Option<Identified>>,
    /// Requests of pages that were not sent to the insole yet, oldest first.
    to_send: VecDeque<ToDevice>,
    /// The number of the page that has requested a change and waits for the insole's answer, and the time of its request.
    waiting: Option<(u64, Instant)>,
    /// The rules of alerts, if they are known.
    alert_rules: Option<AlertRules>,
    daily_load: DailyLoad,
    status: Option<Status>,
    /// Converts between the insole's clock and this computer's.
    clock_mapping: ClockMapping,
    /// Number of sessions with the insole so far. Numbers of records can be compared only within one session.
    session: u64,
    /// The latest records, at most [`HELD_RECORDS`], oldest first. The position of a record, which never changes, is its index
    /// plus `removed`.
    records: VecDeque<Held>,
    /// Number of records that were removed from `records`.
    removed: usize,
    /// The position after the last record that a page has acknowledged.
    acknowledged: usize,
    /// Number of the record to acknowledge to the insole next.
    to_acknowledge: Option<u32>,
    pages: Vec<PageSession>,
    /// The streams of the Lab Streaming Layer, if the messages are published.
    outlets: Option<Outlets>,
}

/// Configuration and cells of an insole. The cells are never freed, because the firmware's [`Session`] requires static ones.
/// This takes little memory, because a server reads few layouts.
pub(crate) type Layout = (Setup, &'static [SetupCell]);

/// A record that is held for the pages.
struct Held {
    record: LoadRecord,
    /// The session with the insole in which the record arrived last.
    session: u64,
    is_recorded: bool,
}

/// The session of a page with an insole.
struct PageSession {
    /// The number of the page.
    id: u64,
    link: Session,
    /// The position of the record that `link` receives next, once it has room.
    next: usize,
}

impl Hub {
    /// A hub with one insole for each item of `outlets`.
    pub fn new(outlets: Vec<Option<Outlets>>, accepts_parameters: bool, recorder: Option<StreamFile>) -> Self {
        let insole = |outlets| Mutex::new(Insole { outlets, ..Insole::default() });
        Self {
            accepts_parameters,
            insoles: outlets.into_iter().map(insole).collect(),
            recorder: Mutex::new(recorder),
            last_page: Mutex::new(0),
            changed: watch::Sender::new(()),
            has_ended: AtomicBool::new(false),
        }
    }

    /// Called when the program ends: lost links are not reported afterwards, nothing is published, and the recording is complete.
    ///
    /// # Errors
    /// If the last messages cannot be written to the recording.
    pub fn end(&self) -> io::Result<()> {
        self.has_ended.store(true, Ordering::Relaxed);
        // Without its end here, the last messages would remain in the buffer of the file, because other threads still run.
        let recorder = self.recorder.lock().unwrap_or_else(PoisonError::into_inner).take();
        let finished = recorder.map_or(Ok(()), StreamFile::finish);
        (0..self.insoles.len()).for_each(|index| self.insole(index).outlets = None);
        finished
    }

    pub fn has_ended(&self) -> bool {
        self.has_ended.load(Ordering::Relaxed)
    }

    fn insole(&self, index: usize) -> MutexGuard<'_, Insole> {
        // The state is consistent wherever a panic is possible.
        self.insoles[index].lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes a message to the recording, if there is one. True if the message was written. A failure is printed and ends the
    /// recording.
    fn record(&self, index: usize, message: &ToHost) -> bool {
        let mut recorder = self.recorder.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(file) = recorder.as_mut() else { return false };
        let written = file.write(index as u8, message);
        if let Err(error) = &written {
            report(format_args!(
                "the recording has ended: {error}; steps, load bouts and alerts remain on the insole until a page stores them: \
                 restart `plantar serve` with another file to record them"
            ));
            *recorder = None;
        }
        written.is_ok()
    }

    /// Starts a new session with the insole, which sent this hello.
    pub fn hello(
        &self,
        index: usize,
        hello: &Hello,
        status: Option<Status>,
        tissue: Option<Tissue>,
        alert_rules: Option<AlertRules>,
        layout: Option<Layout>,
    ) {
        self.record(index, &ToHost::Hello(hello.clone()));
        let mut insole = self.insole(index);
        let insole = &mut *insole;
        if insole.outlets.take_if(|outlets| !outlets.describes(hello)).is_some() {
            report(format_args!(
                "the firmware or settings of the {} insole have changed, so that the description of its LSL streams is wrong: \
                 they have ended; restart `plantar serve` to publish them again",
                hello.side.name()
            ));
        }
        if let Some(status) = status {
            // The session with this status begins below, so all records so far are of earlier sessions.
            insole.set_status(status, insole.session + 1);
        }
        insole.hello = Some(hello.clone());
        (insole.tissue, insole.identified, insole.alert_rules) = (tissue, None, alert_rules);
        insole.layout = layout.map(|layout| (hello.layout_id, layout));
        insole.ellipses_every = 0;
        insole.session += 1;
        insole.clock_mapping = ClockMapping::new();
        insole.to_acknowledge = None;
        insole.forget_requests();
        for PageSession { link, .. } in &mut insole.pages {
            // Connects on behalf of the page, which thereby receives the insole's new hello.
            let (is_streaming, every) = (link.next_live().is_some(), link.ellipses.every());
            set_layout(link, layout);
            open_session(link, CONNECT, insole.tissue, None, insole.alert_rules);
            link.receive(ToDevice::Stream { live: is_streaming }, NO_CLOCK_US);
            link.receive(ToDevice::StreamEllipses { every }, NO_CLOCK_US);
        }
        self.changed.send_replace(());
    }

    /// The layout with this identifier, if the insole had it in its last session, so that it need not be read again.
    pub fn layout(&self, index: usize, id: u32) -> Option<Layout> {
        self.insole(index).layout.filter(|(known, _)| *known == id).map(|(_, layout)| layout)
    }

    /// Ends the session with an insole: pages receive nothing until the next session starts.
    pub fn lost(&self, index: usize) {
        let mut insole = self.insole(index);
        insole.hello = None;
        insole.forget_requests();
    }

    /// Takes the request of a page that must be sent to the insole; none while the link is lost.
    pub fn to_send(&self, index: usize) -> Option<ToDevice> {
        let mut insole = self.insole(index);
        insole.hello.as_ref()?;
        insole.to_send.pop_front()
    }

    /// Passes to all pages how the parameters on the insole were identified. If the parameters are not known, requests them: the
    /// pages then ask again.
    pub fn identified(&self, index: usize, identified: Option<Identified>) {
        let mut insole = self.insole(index);
        let insole = &mut *insole;
        let Some(tissue) = insole.tissue else { return insole.send_once(ToDevice::GetTissue) };
        insole.identified = Some(identified);
        for PageSession { link, .. } in &mut insole.pages {
            link.restore_tissue(tissue, identified);
            link.receive(ToDevice::GetIdentified, NO_CLOCK_US);
        }
        self.changed.send_replace(());
    }

    /// Passes the insole's answer to new parameters, or its refusal of a request, to the page that sent the request.
    pub fn tissue_answer(&self, index: usize, answer: Result<Tissue, Refusal>) {
        let mut insole = self.insole(index);
        let insole = &mut *insole;
        // Only one page waits for an answer at a time. The insole may also announce parameters that another host has set.
        let waiting = match answer {
            Ok(tissue) => {
                insole.take_waiting(|command| matches!(command, Command::Tissue(sent, _) if sent.id == tissue.id))
            }
            // These refuse a snooze or a rate of ellipses. No page waits for the answer to such a request.
            Err(Refusal::NoLayout | Refusal::EllipseRate { .. }) => None,
            Err(_) => insole.take_waiting(|_| true),
        };
        // Parameters and rules that could not be stored are in force until the insole restarts.
        let (mut tissue, mut rules) = (answer.ok(), None);
        match waiting {
            Some((_, Command::Tissue(sent, _))) if answer == Err(Refusal::NotStored) => tissue = Some(sent),
            Some((_, Command::AlertRules(sent))) if answer == Err(Refusal::NotStored) => rules = Some(sent),
            _ => {}
        }
        if tissue.is_some() {
            (insole.tissue, insole.identified) = (tissue, None);
        }
        insole.alert_rules = rules.or(insole.alert_rules);
        for PageSession { id, link, .. } in &mut insole.pages {
            if waiting.is_some_and(|(waiting, _)| waiting == *id) {
                link.complete(answer.map(|_| CommandResult::Stored));
                continue;
            }
            if let Some(tissue) = tissue {
                link.restore_tissue(tissue, None);
                link.receive(ToDevice::GetTissue, NO_CLOCK_US);
            }
            if let Some(rules) = rules {
                link.set_alert_rules(rules);
            }
        }
        self.changed.send_replace(());
    }

    /// Passes the rules of alerts to the pages, one of which may have set them.
    pub fn alert_rules(&self, index: usize, rules: AlertRules) {
        let mut insole = self.insole(index);
        let insole = &mut *insole;
        insole.alert_rules = Some(rules);
        let waiting = insole.take_waiting(|command| matches!(command, Command::AlertRules(sent) if *sent == rules));
        for PageSession { id, link, .. } in &mut insole.pages {
            if waiting.is_some_and(|(waiting, _)| waiting == *id) {
                link.complete(Ok(CommandResult::Stored));
            } else {
                link.set_alert_rules(rules);
                link.receive(ToDevice::GetAlertRules, NO_CLOCK_US);
            }
        }
        self.changed.send_replace(());
    }

    /// Stores the load of the day, and passes it to the pages.
    pub fn daily_load(&self, index: usize, daily: DailyLoad) {
        let mut insole = self.insole(index);
        insole.daily_load = daily;
        for PageSession { link, .. } in &mut insole.pages {
            link.set_daily_load(daily, true);
        }
        drop(insole);
        self.changed.send_replace(());
    }

    /// Publishes a message over the Lab Streaming Layer, if this was requested. A record that the insole repeats is not published
    /// again.
    pub fn publish(&self, index: usize, message: &ToHost, mapping: &ClockMapping) {
        let mut insole = self.insole(index);
        let is_repeated = LoadRecord::of(message).is_some_and(|record| insole.is_known(&record));
        if let Some(outlets) = insole.outlets.as_mut().filter(|_| !is_repeated) {
            outlets.send(message, mapping);
        }
    }

    /// Records a live frame, and passes it to the pages that requested the live stream.
    pub fn live(&self, index: usize, live: Live) {
        self.record(index, &ToHost::Live(live));
        for PageSession { link, .. } in &mut self.insole(index).pages {
            // The frame has the insole's sequence number, so that a page detects gaps on both links.
            if link.next_live().is_some() {
                link.push_live(live);
            }
        }
        self.changed.send_replace(());
    }

    /// The request for another rate of the stream of ellipses, if the highest rate that a page requested has changed.
    pub fn ellipses_to_request(&self, index: usize) -> Option<ToDevice> {
        let mut insole = self.insole(index);
        let rates = insole.pages.iter().map(|page| page.link.ellipses.every());
        let every = rates.filter(|&every| every > 0).min().unwrap_or(0);
        let is_changed = std::mem::replace(&mut insole.ellipses_every, every) != every;
        is_changed.then_some(ToDevice::StreamEllipses { every })
    }

    /// Passes ellipses to the pages that requested them.
    pub fn ellipses(&self, index: usize, ellipses: Ellipses) {
        let mut insole = self.insole(index);
        for page in insole.pages.iter_mut().filter(|page| page.link.ellipses.every() > 0) {
            page.link.ellipses.push(ellipses);
        }
        drop(insole);
        self.changed.send_replace(());
    }

    /// Records a new record and passes it to the pages. A record that is already stored is acknowledged to the insole again. Must
    /// not be called for the same insole by two threads at a time.
    pub fn load_record(&self, index: usize, record: LoadRecord) {
        let mut guard = self.insole(index);
        let insole = &mut *guard;
        let session = insole.session;
        if let Some(found) = insole.records.iter().rposition(|held| held.record.is_same(&record)) {
            let held = &mut insole.records[found];
            // The insole's own number of boots since the record replaces that of the hub.
            (held.record, held.session) = (record, session);
            // If the record is stored, the insole has not received its acknowledgement.
            if held.is_recorded || insole.removed + found < insole.acknowledged {
                insole.acknowledge(record.number());
            }
            insole.update_pages();
            return;
        }
        // Pages wait for the lock of the insole, so it is not held while the record is written, which may take long. Meanwhile no
        // other thread adds records or begins a session: only the bridge of this insole does, and it called this function.
        drop(guard);
        let is_recorded = self.record(index, &record.into());
        let mut guard = self.insole(index);
        let insole = &mut *guard;
        if insole.records.len() == HELD_RECORDS {
            insole.records.pop_front();
            insole.removed += 1;
        }
        insole.records.push_back(Held { record, session, is_recorded });
        insole.refill_pages();
        if is_recorded {
            insole.acknowledge(record.number());
        }
        drop(guard);
        self.changed.send_replace(());
    }

    /// Records the insole's counters, and stores them for the pages.
    pub fn status(&self, index: usize, status: Status) {
        self.record(index, &ToHost::Status(status));
        let mut insole = self.insole(index);
        let session = insole.session;
        insole.set_status(status, session);
    }

    /// Records the relation of the insole's clock to this computer's.
    pub fn record_time(&self, index: usize) {
        let host_us = unix_us();
        let device_us = self.insole(index).clock_mapping.device_us(host_us);
        if let Some(device_us) = device_us {
            self.record(index, &ToHost::Time { host_us, device_us });
        }
    }

    /// Stores the current estimate of the insole's clock.
    pub fn clock_mapping(&self, index: usize, mapping: &ClockMapping) {
        self.insole(index).clock_mapping.clone_from(mapping);
    }

    /// Takes the number of the record that must be acknowledged to the insole.
    pub fn acknowledgement(&self, index: usize) -> Option<u32> {
        self.insole(index).to_acknowledge.take()
    }

    /// Adds a page.
    pub fn join(self: &Arc<Self>) -> Page {
        let mut last_page = self.last_page.lock().unwrap_or_else(PoisonError::into_inner);
        *last_page += 1;
        for insole in &self.insoles {
            let mut insole = insole.lock().unwrap_or_else(PoisonError::into_inner);
            let mut link = Session::new();
            set_layout(&mut link, insole.layout.map(|(_, layout)| layout));
            let next = insole.acknowledged.max(insole.removed);
            insole.pages.push(PageSession { id: *last_page, link, next });
            insole.refill_pages();
        }
        Page { hub: self.clone(), id: *last_page, turn: 0, changed: self.changed.subscribe() }
    }
}

/// The time that a page's session receives with messages for which it does not use the insole's time.
const NO_CLOCK_US: u64 = 0;

const CONNECT: ToDevice = ToDevice::Connect { major: plantar::protocol::MAJOR, minor: plantar::protocol::MINOR };

/// Lets a page read the set-up and the cells of the insole.
fn set_layout(link: &mut Session, layout: Option<Layout>) {
    if let Some((setup, cells)) = layout {
        link.set_layout(setup, cells, None);
    }
}

/// Opens the session of a page, with the parameters and the rules of alerts of the insole.
fn open_session(
    link: &mut Session,
    connect: ToDevice,
    tissue: Option<Tissue>,
    identified: Option<Identified>,
    alert_rules: Option<AlertRules>,
) {
    link.receive(connect, NO_CLOCK_US);
    if let Some(rules) = alert_rules {
        link.set_alert_rules(rules);
    }
    link.restore_tissue(tissue.unwrap_or(Tissue::NONE), identified);
}

/// A page that is connected to the hub until this value is dropped.
pub(crate) struct Page {
    hub: Arc<Hub>,
    id: u64,
    /// The index of the insole that sends the next message, if it has one. On a slow connection, the insoles thus take turns.
    turn: usize,
    changed: watch::Receiver<()>,
}

impl Page {
    /// Waits until there may be a message to send.
    pub async fn changed(&mut self) {
        // The channel cannot be closed: this page owns the hub, which owns the sender.
        let _ = self.changed.changed().await;
    }

    /// Processes bytes from the page: the index of an insole, and a message.
    pub fn receive(&self, bytes: &[u8]) {
        let Some((&index, message)) = bytes.split_first() else { return };
        let index = usize::from(index);
        if index >= self.hub.insoles.len() {
            return;
        }
        let mut insole = self.hub.insole(index);
        let insole = &mut *insole;
        let request = decode(message);
        if let Some(request) = request.filter(|request| insole.awaits_answer_to(self.id, request)) {
            // The page repeats its request, because no answer has arrived. It still waits for one answer.
            insole.waiting = Some((self.id, Instant::now()));
            return insole.send_once(request);
        }
        if insole.waiting.is_some_and(|(_, requested_at)| requested_at.elapsed() > ANSWER_TIMEOUT) {
            insole.forget_requests();
        }
        let Some(PageSession { link, next, .. }) = insole.pages.iter_mut().find(|page| page.id == self.id) else {
            return;
        };
        match request {
            Some(ToDevice::SetIdentifiedTissue { identified, .. })
                if self.hub.accepts_parameters
                    && insole.hello.as_ref().is_none_or(|hello| hello.contact_rule != identified.contact) =>
            {
                link.refuse(Refusal::ContactRule);
            }
            Some(ToDevice::SetTissue(_) | ToDevice::SetIdentifiedTissue { .. } | ToDevice::SetAlertRules(_))
                if self.hub.accepts_parameters && insole.waiting.is_some() =>
            {
                link.refuse(Refusal::Busy);
            }
            Some(
                request @ (ToDevice::SetTissue(_) | ToDevice::SetIdentifiedTissue { .. } | ToDevice::SetAlertRules(_)),
            ) if self.hub.accepts_parameters => {
                // The session of the page checks the values. It may have no layout and thus no contact rule, so the rule is
                // checked above.
                let checked = match request {
                    ToDevice::SetIdentifiedTissue { tissue, .. } => ToDevice::SetTissue(tissue),
                    request => request,
                };
                link.receive(checked, NO_CLOCK_US);
                // The session has already refused invalid parameters and rules.
                if link.command().is_some() {
                    insole.to_send.push_back(request);
                    insole.waiting = Some((self.id, Instant::now()));
                }
            }
            // The insole answers with the load of the day, which all pages receive.
            Some(request @ ToDevice::SnoozeAlerts { .. }) => {
                insole.to_send.retain(|waiting| !matches!(waiting, ToDevice::SnoozeAlerts { .. }));
                insole.to_send.push_back(request);
            }
            // All pages receive the answer, too.
            Some(ToDevice::GetAlertRules) if insole.alert_rules.is_none() => insole.send_once(ToDevice::GetAlertRules),
            Some(ToDevice::GetIdentified) if insole.identified.is_none() => insole.send_once(ToDevice::GetIdentified),
            // A page may not send these requests. Changes of parameters and of rules of alerts get here only if the hub does not
            // accept them. The hub does not request the cells from the insole, so it cannot confirm a stream of cells.
            Some(
                ToDevice::SetTissue(_)
                | ToDevice::SetIdentifiedTissue { .. }
                | ToDevice::GetTissue
                | ToDevice::GetSettings
                | ToDevice::GetFaults
                | ToDevice::SetSettings(_)
                | ToDevice::SetAlertRules(_)
                | ToDevice::Zero
                | ToDevice::GetIdentity
                | ToDevice::SetIdentity { .. }
                | ToDevice::Update(_)
                | ToDevice::SetCalibrationBlock { .. }
                | ToDevice::SetCalibration { .. }
                | ToDevice::EraseWearer
                | ToDevice::Restart
                | ToDevice::StreamCells(_),
            )
            | None => link.receive_unknown(),
            // Ignored, because the bridge sets the clock.
            Some(ToDevice::SetClock { .. }) => {}
            Some(request @ ToDevice::GetTime { .. }) => {
                if let Some(device_us) = insole.clock_mapping.device_us(unix_us()) {
                    link.receive(request, device_us);
                }
            }
            Some(connect @ ToDevice::Connect { .. }) => {
                open_session(link, connect, insole.tissue, insole.identified.flatten(), insole.alert_rules);
                link.set_daily_load(insole.daily_load, false);
            }
            Some(acknowledgement @ ToDevice::Acknowledge { number }) => {
                if link.has_sent(number) {
                    // True for all records but the acknowledged one, at which the search for its position ends.
                    let is_other = |record: &&mut LoadRecord| record.number() != number;
                    let position = *next - link.records_mut().skip_while(is_other).count();
                    link.receive(acknowledgement, NO_CLOCK_US);
                    insole.acknowledged_by_page(position);
                }
            }
            Some(message) => link.receive(message, NO_CLOCK_US),
        }
    }

    /// The next message for the page, as the index of an insole followed by the message; `None` if there is nothing to send.
    pub fn next(&mut self) -> Option<Vec<u8>> {
        let count = self.hub.insoles.len();
        let (index, message) = (self.turn..self.turn + count)
            .map(|turn| turn % count)
            .find_map(|index| Some((index, self.next_of(index)?)))?;
        self.turn = (index + 1) % count;
        Some(message)
    }

    /// The next message of this insole for the page, after the index of the insole.
    fn next_of(&self, index: usize) -> Option<Vec<u8>> {
        let mut insole = self.hub.insole(index);
        let insole = &mut *insole;
        let PageSession { link, .. } = insole.pages.iter_mut().find(|page| page.id == self.id)?;
        let mut buffer = [0; MAX_MESSAGE];
        let insole_status = insole.status.unwrap_or_default();
        let message = link.next(insole.hello.as_ref()?, || insole_status, &mut buffer)?;
        let Some(ToHost::Status(own)) = decode(message) else { return Some([&[index as u8], message].concat()) };
        // The session counts the live frames of the page, and the records that it lost; all else is the insole's.
        let records_dropped = insole_status.records_dropped.wrapping_add(own.records_dropped);
        let status = Status { live_due: own.live_due, live_sent: own.live_sent, records_dropped, ..insole_status };
        let message = encode(&ToHost::Status(status), &mut buffer).ok()?;
        Some([&[index as u8], &*message].concat())
    }
}

impl Insole {
    /// Stores the counters that the insole sent in this session. If the insole has restarted, the records of former sessions
    /// become records of an earlier boot, because a page must not convert their times by the clock of the present boot.
    fn set_status(&mut self, status: Status, session: u64) {
        let Some(before) = self.status.replace(status).filter(|before| status.is_after_restart(before)) else { return };
        // An insole without working storage does not count its boots.
        let boots = status.contents.start.saturating_sub(before.contents.start).max(1);
        for Held { record, .. } in self.records.iter_mut().filter(|held| held.session != session) {
            *record = record.with_boots_since(record.start().0.saturating_add(boots));
        }
        self.update_pages();
    }

    /// Replaces the records in the sessions of pages by the held ones, the number of boots of which may be another one now.
    fn update_pages(&mut self) {
        for record in self.pages.iter_mut().flat_map(|page| page.link.records_mut()) {
            if let Some(held) = self.records.iter().find(|held| held.record.is_same(record)) {
                *record = held.record;
            }
        }
    }

    /// Passes held records to the sessions of pages that have room for them. Counts those that a page has lost, because they were
    /// removed before.
    fn refill_pages(&mut self) {
        for PageSession { link, next, .. } in &mut self.pages {
            let lost = self.removed.saturating_sub(*next);
            link.count_dropped(lost as u32);
            *next += lost;
            while link.has_room()
                && let Some(held) = self.records.get(*next - self.removed)
            {
                link.push_record(held.record);
                *next += 1;
            }
        }
    }

    /// True for a record that has arrived before.
    fn is_known(&self, record: &LoadRecord) -> bool {
        self.records.iter().any(|held| held.record.is_same(record))
    }

    /// True if this page has sent these parameters or rules before and waits for the answer.
    fn awaits_answer_to(&self, page: u64, request: &ToDevice) -> bool {
        let is_waiting = self.waiting.is_some_and(|(waiting, _)| waiting == page);
        match (self.waiting_command().filter(|_| is_waiting), request) {
            (
                Some(Command::Tissue(sent, _)),
                ToDevice::SetTissue(tissue) | ToDevice::SetIdentifiedTissue { tissue, .. },
            ) => sent == *tissue,
            (Some(Command::AlertRules(sent)), ToDevice::SetAlertRules(rules)) => sent == *rules,
            _ => false,
        }
    }

    /// The command of the page that waits for an answer; `None` if no page waits, or if it has closed its connection.
    fn waiting_command(&self) -> Option<Command> {
        let (waiting, _) = self.waiting?;
        self.pages.iter().find(|page| page.id == waiting).and_then(|page| page.link.command())
    }

    /// Sends a request to the insole, unless the same request already waits to be sent.
    fn send_once(&mut self, request: ToDevice) {
        if !self.to_send.contains(&request) {
            self.to_send.push_back(request);
        }
    }

    /// Discards the requests that were not answered: a request or its answer may be damaged, and both are lost with the link.
    fn forget_requests(&mut self) {
        self.to_send.clear();
        self.waiting = None;
        // The pages can repeat their requests.
        self.pages.iter_mut().for_each(|page| page.link.complete(Err(Refusal::Busy)));
    }

    /// Returns the page that waits for an answer and its command, and ends its wait, if `is_answered` is true for the command.
    fn take_waiting(&mut self, is_answered: impl Fn(&Command) -> bool) -> Option<(u64, Command)> {
        let (waiting, _) = self.waiting?;
        let command = self.waiting_command();
        // A page that has closed its connection has no command, and no longer waits.
        if command.as_ref().is_none_or(is_answered) {
            self.waiting = None;
        }
        command.filter(|_| self.waiting.is_none()).map(|command| (waiting, command))
    }

    /// Acknowledges the record with this number to the insole, unless a later one waits to be acknowledged, which covers it.
    fn acknowledge(&mut self, number: u32) {
        if self.to_acknowledge.is_none_or(|waiting| sequence::is_after(number, waiting)) {
            self.to_acknowledge = Some(number);
        }
    }

    /// Acknowledges the record at this position to the insole, because a page has acknowledged it, and with it all earlier ones.
    fn acknowledged_by_page(&mut self, position: usize) {
        self.acknowledged = self.acknowledged.max(position + 1);
        let held = position.checked_sub(self.removed).and_then(|index| self.records.get(index));
        // In a later session the insole may use this number for another record.
        if let Some(held) = held.filter(|held| held.session == self.session) {
            self.acknowledge(held.record.number());
        }
        self.refill_pages();
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        for insole in &self.hub.insoles {
            insole.lock().unwrap_or_else(PoisonError::into_inner).pages.retain(|page| page.id != self.id);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plantar::protocol::session::RECORD_QUEUE;
    use plantar::protocol::{CellStream, Resolution, Step};

    /// Passes a message of a page to the hub.
    fn send(page: &Page, index: usize, message: ToDevice) {
        let mut buffer = [0; MAX_MESSAGE];
        let message = encode(&message, &mut buffer).expect("it fits");
        page.receive(&[&[index as u8], &*message].concat());
    }

    /// The records that a page receives.
    fn records_of(mut page: Page) -> Vec<LoadRecord> {
        send(&page, 0, CONNECT);
        let messages = std::iter::from_fn(|| page.next()).filter_map(|message| decode::<ToHost>(&message[1..]));
        messages.filter_map(|message| LoadRecord::of(&message)).collect()
    }

    /// The insole could not store the count of its boots, and its status does not reveal the restart.
    #[test]
    fn a_record_that_the_insole_repeats_has_the_insoles_own_count_of_boots() {
        let hub = Arc::new(Hub::new(vec![None], false, None));
        let joined_before = hub.join();
        for boots_since in [0, 1] {
            hub.hello(0, &testkit::hello(), None, None, None, None);
            hub.load_record(0, Step { boots_since, ..testkit::step(0) }.into());
        }
        for page in [joined_before, hub.join()] {
            assert_eq!(records_of(page), [LoadRecord::from(Step { boots_since: 1, ..testkit::step(0) })]);
        }
    }

    #[test]
    fn the_first_status_of_an_insole_is_no_restart() {
        let hub = Arc::new(Hub::new(vec![None], false, None));
        hub.hello(0, &testkit::hello(), None, None, None, None);
        hub.load_record(0, testkit::step(0).into());
        let mut status = Status::default();
        status.contents.start = 37;
        hub.status(0, status);
        assert_eq!(records_of(hub.join()), [LoadRecord::from(testkit::step(0))]);
    }

    /// A restart is known only from a status that arrives after new records.
    #[test]
    fn records_of_the_session_in_which_a_restart_becomes_known_are_of_the_present_boot() {
        let hub = Arc::new(Hub::new(vec![None], false, None));
        let mut status = Status::default();
        for start in [36, 37] {
            hub.hello(0, &testkit::hello(), None, None, None, None);
            hub.load_record(0, testkit::step(start).into());
            status.contents.start = start;
            hub.status(0, status);
        }
        let expected = [Step { boots_since: 1, ..testkit::step(36) }, testkit::step(37)];
        assert_eq!(records_of(hub.join()), expected.map(LoadRecord::from));
    }

    /// Acknowledges all records that a page receives, and returns their numbers, each with the number of boots since the record.
    fn store(page: &mut Page) -> Vec<(u32, u32)> {
        let mut stored = Vec::new();
        while let Some(message) = page.next() {
            let Some(record) = decode(&message[1..]).and_then(|message| LoadRecord::of(&message)) else { continue };
            send(page, 0, ToDevice::Acknowledge { number: record.number() });
            stored.push((record.number(), record.start().0));
        }
        stored
    }

    #[test]
    fn a_page_that_stalls_receives_the_records_that_another_page_has_stored() {
        let hub = Arc::new(Hub::new(vec![None], false, None));
        let (mut stalled, mut other) = (hub.join(), hub.join());
        let mut status = Status::default();
        hub.hello(0, &testkit::hello(), Some(status), None, None, None);
        for number in 0..20 {
            hub.load_record(0, testkit::step(number).into());
            assert_eq!(store(&mut other), [(number, 0)]);
            assert_eq!(hub.acknowledgement(0), Some(number));
        }
        // The insole has restarted.
        status.contents.start += 1;
        hub.hello(0, &testkit::hello(), Some(status), None, None, None);
        hub.load_record(0, testkit::step(20).into());
        let expected: Vec<_> = (0..20).map(|number| (number, 1)).chain([(20, 0)]).collect();
        assert_eq!(store(&mut stalled), expected);
        assert_eq!(records_of(hub.join()).len(), 0, "all records are stored");
    }

    #[test]
    fn a_page_that_opens_late_receives_all_records_that_no_page_has_stored() {
        let hub = Arc::new(Hub::new(vec![None], false, None));
        hub.hello(0, &testkit::hello(), None, None, None, None);
        (0..20).for_each(|number| hub.load_record(0, testkit::step(number).into()));
        let mut closed = hub.join();
        send(&closed, 0, CONNECT);
        while closed.next().is_some() {}
        send(&closed, 0, ToDevice::Acknowledge { number: 2 });
        drop(closed);
        let mut page = hub.join();
        send(&page, 0, CONNECT);
        assert_eq!(store(&mut page), (3..20).map(|number| (number, 0)).collect::<Vec<_>>());
    }

    #[test]
    fn records_that_a_page_loses_are_counted_in_its_status() {
        let hub = Arc::new(Hub::new(vec![None], false, None));
        let mut page = hub.join();
        hub.hello(0, &testkit::hello(), None, None, None, None);
        // The session of the page has the first six.
        let (sent, lost) = (RECORD_QUEUE as u32, 4);
        let count = sent + lost + HELD_RECORDS as u32;
        (0..count).for_each(|number| hub.load_record(0, testkit::step(number).into()));
        let expected = (0..sent).chain(sent + lost..count).map(|number| (number, 0));
        assert!(store(&mut page).into_iter().eq(expected));
        send(&page, 0, ToDevice::GetStatus);
        let Some(ToHost::Status(status)) = page.next().and_then(|message| decode(&message[1..])) else {
            panic!("no status")
        };
        assert_eq!(status.records_dropped, lost);
    }

    /// A page that could store several records only together acknowledges the last of them.
    #[test]
    fn an_acknowledgement_of_a_page_covers_all_earlier_records() {
        let hub = Arc::new(Hub::new(vec![None], false, None));
        let mut page = hub.join();
        hub.hello(0, &testkit::hello(), None, None, None, None);
        (0..4).for_each(|number| hub.load_record(0, testkit::step(number).into()));
        // No page has received these records yet.
        send(&page, 0, ToDevice::Acknowledge { number: 2 });
        assert_eq!(hub.acknowledgement(0), None);
        while page.next().is_some() {}
        send(&page, 0, ToDevice::Acknowledge { number: 2 });
        assert_eq!(hub.acknowledgement(0), Some(2));
        assert_eq!(records_of(hub.join()), [LoadRecord::from(testkit::step(3))]);
        // The insole did not receive the acknowledgement.
        hub.load_record(0, testkit::step(1).into());
        assert_eq!(hub.acknowledgement(0), Some(1));
    }

    /// The request or its answer was lost on the way, and the page repeats the request.
    #[test]
    fn a_repeated_request_is_sent_again_and_answered_once() {
        let hub = Arc::new(Hub::new(vec![None], true, None));
        let mut page = hub.join();
        hub.hello(0, &testkit::hello(), None, None, None, None);
        while page.next().is_some() {}
        let request = ToDevice::SetTissue(*testkit::TISSUE);
        for _ in 0..2 {
            send(&page, 0, request);
            assert_eq!((hub.to_send(0), page.next()), (Some(request), None));
        }
        // The insole has not received the second request yet.
        send(&page, 0, request);
        send(&page, 0, request);
        assert_eq!((hub.to_send(0), hub.to_send(0)), (Some(request), None));
        // Another page must wait.
        let mut other = hub.join();
        send(&other, 0, CONNECT);
        while other.next().is_some() {}
        send(&other, 0, request);
        let refusal = other.next().and_then(|message| decode(&message[1..]));
        assert_eq!((hub.to_send(0), refusal), (None, Some(ToHost::Refused(Refusal::Busy))));
        hub.tissue_answer(0, Ok(*testkit::TISSUE));
        let answers: Vec<ToHost> = std::iter::from_fn(|| page.next()).filter_map(|bytes| decode(&bytes[1..])).collect();
        assert_eq!(answers, [ToHost::Tissue(*testkit::TISSUE)]);
    }

    /// The answer to the request for the rules at the beginning of the session was lost.
    #[test]
    fn unknown_rules_of_alerts_are_requested_from_the_insole() {
        let hub = Arc::new(Hub::new(vec![None], false, None));
        let mut page = hub.join();
        hub.hello(0, &testkit::hello(), None, None, None, None);
        while page.next().is_some() {}
        send(&page, 0, ToDevice::GetAlertRules);
        assert_eq!((page.next(), hub.to_send(0)), (None, Some(ToDevice::GetAlertRules)));
        hub.alert_rules(0, AlertRules::RECOMMENDED);
        let answer = page.next().and_then(|message| decode(&message[1..]));
        assert_eq!(answer, Some(ToHost::AlertRules(AlertRules::RECOMMENDED)));
        // From now on, the hub answers itself.
        send(&page, 0, ToDevice::GetAlertRules);
        assert_eq!(hub.to_send(0), None);
    }

    #[test]
    fn a_recording_relates_the_clock_of_an_insole_to_that_of_this_computer() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("walk.plantar");
        let hub = Hub::new(vec![None], false, Some(StreamFile::create(&path).expect("a file")));
        let mut mapping = ClockMapping::new();
        hub.record_time(0);
        let ahead_us = 1_000_000_000_000;
        let now_us = unix_us();
        mapping.answer(now_us, now_us - ahead_us);
        hub.clock_mapping(0, &mapping);
        hub.record_time(0);
        let file = std::fs::read(&path).expect("the file");
        // Time, insole and length precede the message.
        let Some(ToHost::Time { host_us, device_us }) = decode(&file[7..]) else { panic!("one time: {file:?}") };
        assert!(host_us >= now_us && host_us - device_us == ahead_us, "{host_us} {device_us}");
    }

    /// The insole continues to send only if the records before are acknowledged.
    #[test]
    #[cfg(unix)]
    fn records_in_a_recording_that_cannot_be_synchronised_are_acknowledged() {
        let hub = Hub::new(vec![None], false, Some(StreamFile::create("/dev/null".as_ref()).expect("a device")));
        hub.load_record(0, testkit::step(7).into());
        assert_eq!(hub.acknowledgement(0), Some(7));
        assert!(hub.end().is_ok());
    }

    /// Live frames are written together, the last ones at the end.
    #[test]
    #[cfg(target_os = "linux")]
    fn live_frames_that_cannot_be_written_at_the_end_are_reported() {
        let hub = Hub::new(vec![None], false, Some(StreamFile::create("/dev/full".as_ref()).expect("a device")));
        hub.live(0, Live::default());
        let error = hub.end().expect_err("the disk is full").to_string();
        assert!(error.contains("cannot write /dev/full") && error.contains("No space left"), "{error}");
    }

    /// The recording is a pipe that is full until a page has received its messages.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_page_does_not_wait_until_a_record_is_written() {
        use std::io::{Read, Write};
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("walk.plantar");
        assert!(std::process::Command::new("mkfifo").arg(&path).status().expect("it runs").success());
        // Opened for reading and writing, because a pipe without a reader cannot be opened.
        let mut pipe = std::fs::File::options().read(true).write(true).open(&path).expect("a pipe");
        let hub = Arc::new(Hub::new(vec![None], false, Some(StreamFile::create(&path).expect("a pipe"))));
        let mut page = hub.join();
        hub.hello(0, &testkit::hello(), None, None, None, None);
        // A pipe has 16 pages. The hello is in the first one.
        let others = [0; 15 * 4096];
        pipe.write_all(&others).expect("written");
        let (recorded, records) = std::sync::mpsc::channel();
        let bridge = hub.clone();
        std::thread::spawn(move || {
            bridge.load_record(0, testkit::step(0).into());
            recorded.send(())
        });
        assert!(records.recv_timeout(Duration::from_secs(1)).is_err(), "the pipe is not full");
        let (received, messages) = std::sync::mpsc::channel();
        std::thread::spawn(move || received.send(page.next()));
        let message =
            messages.recv_timeout(Duration::from_secs(20)).expect("the page does not wait").expect("a message");
        assert!(matches!(decode(&message[1..]), Some(ToHost::Hello(_))));
        pipe.read_exact(&mut vec![0; others.len()]).expect("messages");
        records.recv_timeout(Duration::from_secs(20)).expect("the record is written");
    }

    #[test]
    fn a_stream_of_cells_is_refused() {
        let hub = Arc::new(Hub::new(vec![None], false, None));
        let mut page = hub.join();
        hub.hello(0, &testkit::hello(), None, None, None, None);
        let stream = CellStream { resolution: Resolution::Converter, every: 1 };
        send(&page, 0, ToDevice::StreamCells(Some(stream)));
        let messages: Vec<ToHost> =
            std::iter::from_fn(|| page.next()).filter_map(|bytes| decode(&bytes[1..])).collect();
        assert!(messages.contains(&ToHost::Refused(Refusal::NotUnderstood)), "{messages:?}");
        assert!(!messages.iter().any(|message| matches!(message, ToHost::CellStream(_))), "{messages:?}");
    }

    #[test]
    fn insoles_take_turns_on_a_slow_connection() {
        let hub = Arc::new(Hub::new(vec![None, None], false, None));
        let mut page = hub.join();
        for index in [0, 1] {
            hub.hello(index, &testkit::hello(), None, None, None, None);
            send(&page, index, ToDevice::Stream { live: true });
        }
        while page.next().is_some() {}
        for sequence in 0..2 {
            let live = Live { sequence, ..Live::default() };
            [0, 1].into_iter().for_each(|index| hub.live(index, live));
        }
        let order: Vec<_> = std::iter::from_fn(|| page.next()).map(|message| message[0]).collect();
        assert_eq!(order, [0, 1, 0, 1]);
    }
}

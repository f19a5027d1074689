//! Between insoles and pages: every page has its own link to every insole.

use crate::stream_file::StreamFile;
use client::{Axis, is_same_step, unix_us};
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::session::{STEP_QUEUE, Session};
use plantar::protocol::{Hello, Live, MAX_MESSAGE, Status, Step, ToDevice, ToHost, decode};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::watch;

/// All insoles and the pages that watch them.
pub(crate) struct Hub {
    insoles: Vec<Mutex<Insole>>,
    recorder: Option<Mutex<StreamFile>>,
    next_page: Mutex<u64>,
    /// Wakes the pages.
    changed: watch::Sender<()>,
    has_ended: AtomicBool,
}

#[derive(Default)]
struct Insole {
    hello: Option<Hello>,
    /// The wearer's parameters, where the insole has told them.
    tissue: Option<Tissue>,
    status: Status,
    /// The insole's clock against this computer's.
    axis: Axis,
    /// Counts hellos: numbers of steps are comparable within a session only.
    session: u64,
    /// Steps that no page has taken; no more than the insole has at hand.
    kept: VecDeque<Kept>,
    /// Steps that were taken: an insole that did not hear of it sends them again.
    taken: VecDeque<Step>,
    /// What the insole is to be told.
    acknowledge: Option<u32>,
    pages: Vec<(u64, Session)>,
}

struct Kept {
    step: Step,
    session: u64,
    is_recorded: bool,
}

/// Pushes into a queue of [`STEP_QUEUE`].
fn push<T>(queue: &mut VecDeque<T>, item: T) {
    if queue.len() == STEP_QUEUE {
        queue.pop_front();
    }
    queue.push_back(item);
}

impl Hub {
    pub fn new(insoles: usize, recorder: Option<StreamFile>) -> Self {
        Self {
            insoles: (0..insoles).map(|_| Mutex::default()).collect(),
            recorder: recorder.map(Mutex::new),
            next_page: Mutex::new(0),
            changed: watch::Sender::new(()),
            has_ended: AtomicBool::new(false),
        }
    }

    /// The program ends: what breaks from now on is no news.
    pub fn end(&self) {
        self.has_ended.store(true, Ordering::Relaxed);
    }

    pub fn has_ended(&self) -> bool {
        self.has_ended.load(Ordering::Relaxed)
    }

    fn insole(&self, index: usize) -> MutexGuard<'_, Insole> {
        // State is whole between statements that can panic.
        self.insoles[index].lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// True once the message is in a file.
    fn record(&self, index: usize, message: &ToHost) -> bool {
        let Some(recorder) = &self.recorder else { return false };
        recorder.lock().unwrap_or_else(PoisonError::into_inner).write(index as u8, message)
    }

    /// An insole opened a session.
    pub fn hello(&self, index: usize, hello: &Hello, tissue: Option<Tissue>) {
        self.record(index, &ToHost::Hello(hello.clone()));
        let mut insole = self.insole(index);
        let insole = &mut *insole;
        insole.hello = Some(hello.clone());
        insole.tissue = tissue;
        insole.session += 1;
        insole.axis = Axis::new();
        insole.acknowledge = None;
        for (_, link) in &mut insole.pages {
            // As if the page had said hello again: it is told who is there now.
            let is_streaming = link.next_live().is_some();
            greet(link, CONNECT, insole.tissue);
            link.receive(ToDevice::Stream { live: is_streaming }, NO_CLOCK_US);
        }
        self.changed.send_replace(());
    }

    /// An insole's session ended: pages hear nothing until there is another.
    pub fn lost(&self, index: usize) {
        self.insole(index).hello = None;
    }

    pub fn live(&self, index: usize, live: Live) {
        self.record(index, &ToHost::Live(live));
        for (_, link) in &mut self.insole(index).pages {
            // The frame keeps the insole's number, so that a page sees gaps from here and from there.
            if link.next_live().is_some() {
                link.push_live(live);
            }
        }
        self.changed.send_replace(());
    }

    pub fn step(&self, index: usize, step: Step) {
        let mut insole = self.insole(index);
        let session = insole.session;
        if insole.taken.iter().any(|taken| is_same_step(taken, &step)) {
            insole.acknowledge = Some(step.step);
            return;
        }
        if let Some(kept) = insole.kept.iter_mut().find(|kept| is_same_step(&kept.step, &step)) {
            kept.session = session;
            // It did not hear of that.
            if kept.is_recorded {
                insole.acknowledge = Some(step.step);
            }
            return;
        }
        let is_recorded = self.record(index, &ToHost::Step(step));
        push(&mut insole.kept, Kept { step, session, is_recorded });
        for (_, link) in &mut insole.pages {
            link.push_step(step);
        }
        if is_recorded {
            insole.acknowledge = Some(step.step);
        }
        drop(insole);
        self.changed.send_replace(());
    }

    pub fn status(&self, index: usize, status: Status) {
        self.record(index, &ToHost::Status(status));
        self.insole(index).status = status;
    }

    /// What is known of the insole's clock.
    pub fn clock(&self, index: usize, axis: &Axis) {
        self.insole(index).axis.clone_from(axis);
    }

    /// The step that the insole is to be told of, once.
    pub fn acknowledgement(&self, index: usize) -> Option<u32> {
        self.insole(index).acknowledge.take()
    }

    /// Lets a page watch.
    pub fn join(self: &Arc<Self>) -> Page {
        let mut next = self.next_page.lock().unwrap_or_else(PoisonError::into_inner);
        *next += 1;
        for insole in &self.insoles {
            let mut insole = insole.lock().unwrap_or_else(PoisonError::into_inner);
            let mut link = Session::new();
            for kept in &insole.kept {
                link.push_step(kept.step);
            }
            insole.pages.push((*next, link));
        }
        Page { hub: self.clone(), id: *next, changed: self.changed.subscribe() }
    }
}

/// For messages that ask for no time.
const NO_CLOCK_US: u64 = 0;

const CONNECT: ToDevice = ToDevice::Connect { major: plantar::protocol::MAJOR, minor: plantar::protocol::MINOR };

/// Opens a page's session; its link knows the parameters that the insole has.
fn greet(link: &mut Session, connect: ToDevice, tissue: Option<Tissue>) {
    link.receive(connect, NO_CLOCK_US);
    link.restore(tissue, link.identity());
}

/// One page's place in the hub; it leaves when this is dropped.
pub(crate) struct Page {
    hub: Arc<Hub>,
    id: u64,
    changed: watch::Receiver<()>,
}

impl Page {
    /// Waits until there may be something to send.
    pub async fn changed(&mut self) {
        // The sender lives as long as the hub, which this holds.
        let _ = self.changed.changed().await;
    }

    /// Takes what the page sent: an insole's index and a message.
    pub fn receive(&self, bytes: &[u8]) {
        let Some((&index, message)) = bytes.split_first() else { return };
        let index = usize::from(index);
        if index >= self.hub.insoles.len() {
            return;
        }
        let mut insole = self.hub.insole(index);
        let insole = &mut *insole;
        let Some((_, link)) = insole.pages.iter_mut().find(|(id, _)| *id == self.id) else { return };
        match decode(message) {
            // What an insole keeps is not a page's business.
            Some(
                ToDevice::SetTissue(_)
                | ToDevice::GetTissue
                | ToDevice::GetIdentity
                | ToDevice::SetIdentity { .. }
                | ToDevice::Update(_)
                | ToDevice::SetCalibrationBlock { .. }
                | ToDevice::SetCalibration { .. }
                | ToDevice::Restart,
            )
            | None => link.receive_unknown(),
            // The bridge has set it.
            Some(ToDevice::SetClock { .. }) => {}
            Some(question @ ToDevice::GetTime { .. }) => {
                if let Some(device_us) = insole.axis.device_us(unix_us()) {
                    link.receive(question, device_us);
                }
            }
            Some(connect @ ToDevice::Connect { .. }) => greet(link, connect, insole.tissue),
            Some(message) => {
                link.receive(message, NO_CLOCK_US);
                if let ToDevice::Acknowledge { step } = message {
                    insole.taken_by_page(step);
                }
            }
        }
    }

    /// The next message for the page after its insole's index; `None` when there is nothing.
    pub fn next(&self) -> Option<Vec<u8>> {
        (0..self.hub.insoles.len()).find_map(|index| {
            let mut insole = self.hub.insole(index);
            let insole = &mut *insole;
            let (_, link) = insole.pages.iter_mut().find(|(id, _)| *id == self.id)?;
            let mut buffer = [0; MAX_MESSAGE];
            let message = link.next(insole.hello.as_ref()?, || insole.status, &mut buffer)?;
            Some([&[index as u8], message].concat())
        })
    }
}

impl Insole {
    fn taken_by_page(&mut self, step: u32) {
        let Some(at) = self.kept.iter().position(|kept| kept.step.step == step) else { return };
        if let Some(Kept { step, session, .. }) = self.kept.remove(at) {
            push(&mut self.taken, step);
            // The number means another step to an insole that has restarted since.
            if session == self.session {
                self.acknowledge = Some(step.step);
            }
        }
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        for insole in &self.hub.insoles {
            insole.lock().unwrap_or_else(PoisonError::into_inner).pages.retain(|(id, _)| *id != self.id);
        }
    }
}

//! The state that processing, carriers and storage share.

use super::board::Gauges;
use super::scan::ScanCounters;
use crate::log;
use crate::pipeline::cadence::Cadence;
use crate::pipeline::stance_rule::Rejected;
use crate::protocol::session::Session;
use crate::protocol::{
    Capacity, CellStream, Contents, Hello, Identity, LoadRecord, Refusal, Status, ToDevice, ToHost, encode, gatt,
};
use crate::storage::update::{KEY, key_id};
use crate::storage::{Bonds, IdentityRecord, MAX_BONDS_BYTES, StorageError, Store};
use core::cell::{Cell, RefCell};
use core::sync::atomic::Ordering;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant};
use embedded_storage_async::nor_flash::MultiwriteNorFlash;
use heapless::Vec;
use mcumgr::{Answer, Head, Request};

/// Number of load records that can wait to be stored.
pub const STORAGE_QUEUE: usize = 2;

/// Time after the last message of a session's host in which messages over the other carrier are refused, except a connect
/// request, which always takes the session. Afterwards they are not answered: a host does not connect again by itself if it is
/// refused, but it does if the insole is silent. Hosts that receive the live stream send several messages a second; a
/// command-line program ends its session without a message, so only its silence shows that it has gone.
const OCCUPIED: Duration = Duration::from_secs(30);

/// Number of attempts to read the bonds at the start.
const BONDS_READS: usize = 3;

/// The kind of link to a host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Carrier {
    /// The serial port.
    Serial,
    /// Bluetooth LE.
    Bluetooth,
}

/// The last request of a management tool. A further request replaces it, so that a tool that gave up waiting does not block
/// others.
#[allow(clippy::large_enum_variant, reason = "there is one exchange at a time, in place")]
pub enum Exchange {
    /// There is no request, or its answer was sent.
    Idle,
    /// The request waits for the storage.
    Requested(Head, Request),
    /// The storage executes the request.
    Executing,
    /// The answer waits for the carrier.
    Answered(Head, Answer),
}

/// The state that the loops on the low-priority executor share.
///
/// There is one session at a time. It belongs to the host that sent [`ToDevice::Connect`] last, over either carrier. Other
/// messages over the other carrier are refused or, if the session has ended or its host is silent, not answered. So all load
/// records wait in one queue, and a record leaves the queue once a host has acknowledged it.
pub struct Shared {
    pub(super) session: &'static RefCell<Session>,
    /// A reference, because this structure is moved once at the start, which takes as much stack as its size.
    pub(super) exchange: &'static RefCell<Exchange>,
    /// The carrier of the exchange; `None` once this carrier has lost the tool. The request of the tool is executed nevertheless.
    pub(super) tool: Cell<Option<Carrier>>,
    /// The carrier of the session.
    carrier: Cell<Carrier>,
    /// Time of the last message of the session's host.
    last_message_at: Cell<Instant>,
    /// A host on the other carrier must learn that the session is not its own.
    is_other_host_refused: Cell<bool>,
    /// For each carrier: signalled when there may be something to send.
    changed: [Signal<NoopRawMutex, ()>; 2],
    pub(super) cadence: Cell<Cadence>,
    /// Time from the first scan to the last processed frame, us.
    pub(super) frame_us: Cell<u64>,
    pub(super) hello: Hello,
    serial_bytes_per_s: u32,
    pub(super) counters: RefCell<ProcessCounters>,
    pub(super) scan: &'static ScanCounters,
    gauges: Gauges,
    /// Load records that [`super::persist::persist`] has not taken yet.
    pub(super) records: Channel<NoopRawMutex, LoadRecord, STORAGE_QUEUE>,
    /// The bonded centrals and the insole's identity key, in the format of the package `bluetooth`.
    bonds: RefCell<Vec<u8, MAX_BONDS_BYTES>>,
    pub(super) bonds_changed: Cell<bool>,
    /// The stored bonds could not be read at the start.
    pub(super) are_bonds_unread: Cell<bool>,
    /// Number of frames that were processed before the end of the first load record that is not stored yet; `None` if all are
    /// stored.
    pub(super) frames_before: Cell<Option<u32>>,
    /// Signalled when there may be something to persist.
    pub(super) to_persist: Signal<NoopRawMutex, ()>,
    pub(super) contents: Cell<Contents>,
    /// Number of items that could not be stored.
    not_stored: Cell<u32>,
}

/// The counters of processing and carriers.
pub(super) struct ProcessCounters {
    pub(super) steps: u32,
    pub(super) rejected: Rejected,
    pub(super) bad_frames: u32,
    /// Least and most processor cycles for the evaluation of a frame with the foot on the ground.
    pub(super) frame_cycles: (u32, u32),
    /// Time of the evaluation of all frames, ms; wraps. Without the evaluation of steps.
    pub(super) processing_ms: u32,
    /// Cycles that are not part of a complete millisecond yet.
    pub(super) rest_cycles: u32,
}

impl ProcessCounters {
    /// Adds the time of a frame.
    pub(super) fn add_processing(&mut self, cycles: u32, cycles_per_ms: u32) {
        self.rest_cycles = self.rest_cycles.saturating_add(cycles);
        self.processing_ms = self.processing_ms.wrapping_add(self.rest_cycles / cycles_per_ms);
        self.rest_cycles %= cycles_per_ms;
    }
}

impl Shared {
    /// The state before the first connection.
    pub fn new(
        hello: Hello,
        serial_bytes_per_s: u32,
        scan: &'static ScanCounters,
        gauges: Gauges,
        exchange: &'static RefCell<Exchange>,
        session: &'static RefCell<Session>,
    ) -> Self {
        let counters = ProcessCounters {
            steps: 0,
            rejected: Rejected::default(),
            bad_frames: 0,
            frame_cycles: (u32::MAX, 0),
            processing_ms: 0,
            rest_cycles: 0,
        };
        Self {
            session,
            exchange,
            tool: Cell::default(),
            carrier: Cell::new(Carrier::Serial),
            last_message_at: Cell::new(Instant::MIN),
            is_other_host_refused: Cell::new(false),
            changed: [Signal::new(), Signal::new()],
            cadence: Cell::default(),
            frame_us: Cell::default(),
            hello,
            serial_bytes_per_s,
            counters: RefCell::new(counters),
            scan,
            gauges,
            records: Channel::new(),
            bonds: RefCell::default(),
            bonds_changed: Cell::default(),
            are_bonds_unread: Cell::default(),
            frames_before: Cell::default(),
            to_persist: Signal::new(),
            contents: Cell::default(),
            not_stored: Cell::default(),
        }
    }

    /// Restores the persisted bonds and identity after a start.
    pub async fn restore(
        &self,
        store: &mut Store<impl MultiwriteNorFlash>,
        identity: IdentityRecord,
        calibration_id: u32,
    ) {
        self.contents.set(store.contents());
        let mut bonds: Result<Option<Bonds>, StorageError> = Ok(None);
        for _ in 0..BONDS_READS {
            if !matches!(bonds, Ok(Some(_))) {
                // Part 0 is the whole record ([`Store::get`]).
                bonds = store.get(0).await;
            }
        }
        self.are_bonds_unread.set(bonds.is_err());
        let identity = Identity { side: identity.side, serial: identity.serial, calibration_id };
        self.session.borrow_mut().restore_identity(identity);
        self.bonds.replace(bonds.ok().flatten().map(|Bonds(bytes)| bytes).unwrap_or_default());
    }

    /// Time since the first scan, us: the time of live frames and steps.
    fn now_us(&self) -> u64 {
        Instant::now().as_micros().saturating_sub(self.scan.began_us.load(Ordering::Relaxed).into())
    }

    /// True if the session's host has sent nothing for a long time: it may have gone, which the serial port does not report.
    pub(super) fn is_host_silent(&self) -> bool {
        self.last_message_at.get().elapsed() >= OCCUPIED
    }

    /// Receives a message over a carrier; `None` stands for a message that was not understood. The function is marked `inline`,
    /// like those that it calls for each request, so that they are compiled with the board's package, which is optimised for
    /// size.
    #[inline]
    pub fn receive(&self, carrier: Carrier, message: Option<ToDevice>) {
        let mut session = self.session.borrow_mut();
        if matches!(message, Some(ToDevice::Connect { .. })) {
            log::info!("link: a host connects over {}", carrier);
            let former = self.carrier.replace(carrier);
            self.is_other_host_refused.set(former != carrier && session.is_open());
            if former != carrier {
                // The answers of the session before are not for this host.
                session.close();
            }
            self.changed(former).signal(());
        }
        if self.carrier.get() == carrier {
            self.last_message_at.set(Instant::now());
        }
        match message {
            _ if self.carrier.get() != carrier => {
                let is_occupied = session.is_open() && !self.is_host_silent();
                self.is_other_host_refused.set(is_occupied && message.is_some());
            }
            Some(ToDevice::StreamCells(Some(stream))) if let Some(refusal) = self.refuses(carrier, stream) => {
                session.refuse(refusal);
            }
            Some(message) => session.receive(message, self.now_us()),
            None => session.receive_unknown(),
        }
        self.to_persist.signal(());
    }

    /// The refusal of a stream of cells for which the carrier is too slow.
    fn refuses(&self, carrier: Carrier, stream: CellStream) -> Option<Refusal> {
        let capacity = match carrier {
            Carrier::Serial => Capacity::of_bytes(self.serial_bytes_per_s),
            Carrier::Bluetooth => gatt::CAPACITY,
        };
        let every = stream.fitting(self.hello.cells.into(), self.hello.period_us, capacity).unwrap_or(0);
        (every == 0 || every > stream.stride()).then_some(Refusal::CellRate { every })
    }

    /// The bonded centrals, as [`Shared::set_bonds`] or [`Shared::restore`] received them.
    pub fn bonds(&self) -> Vec<u8, MAX_BONDS_BYTES> {
        self.bonds.borrow().clone()
    }

    /// Replaces the bonded centrals and stores them.
    pub fn set_bonds(&self, bonds: Vec<u8, MAX_BONDS_BYTES>) {
        log::info!("bond: the list of bonded centrals changes");
        self.bonds.replace(bonds);
        self.bonds_changed.set(true);
        self.to_persist.signal(());
    }

    pub(super) fn count_not_stored(&self) {
        log::error!("storage: an item could not be stored");
        self.not_stored.set(self.not_stored.get().wrapping_add(1));
    }

    /// Counts a frame, or a value over Bluetooth, that came from a host and could not be decoded.
    pub(super) fn count_bad_frame(&self) {
        let mut counters = self.counters.borrow_mut();
        counters.bad_frames = counters.bad_frames.wrapping_add(1);
    }

    /// The next message to send over a carrier.
    pub fn next<'b>(&self, carrier: Carrier, buffer: &'b mut [u8]) -> Option<&'b [u8]> {
        if self.carrier.get() == carrier {
            return self.session.borrow_mut().next(&self.hello, || self.status(), buffer);
        }
        let is_refused = self.is_other_host_refused.take();
        is_refused.then(|| encode(&ToHost::Refused(Refusal::OtherHost), buffer).ok().map(|used| &*used)).flatten()
    }

    /// Ends the session of a carrier, if there is one, because another kind of host uses the carrier.
    pub(super) fn end_session(&self, carrier: Carrier) {
        if self.carrier.get() == carrier && self.session.borrow().is_open() {
            self.close(carrier);
        }
    }

    /// Ends the session of a carrier that lost its host, and discards the answer to a management tool on this carrier.
    pub fn close(&self, carrier: Carrier) {
        self.tool.set(self.tool.get().filter(|&tool| tool != carrier));
        if self.carrier.get() == carrier {
            log::info!("link: {} lost its host", carrier);
            self.session.borrow_mut().close();
        }
    }

    /// The signal of a carrier, which is signalled when there may be something to send.
    pub fn changed(&self, carrier: Carrier) -> &Signal<NoopRawMutex, ()> {
        match carrier {
            Carrier::Serial => &self.changed[0],
            Carrier::Bluetooth => &self.changed[1],
        }
    }

    /// Signals all carriers that there may be something to send.
    pub(super) fn signal_changed(&self) {
        self.changed.iter().for_each(|carrier| carrier.signal(()));
    }

    /// Number of steps of this foot so far, and cadence in steps of both feet per minute.
    pub(super) fn cadence(&self) -> (u32, u8) {
        let cadence = self.cadence.get();
        (cadence.steps, cadence.per_min(self.frame_us.get()))
    }

    /// The wall clock, us since 1970; `None` until it is set.
    pub(super) fn unix_us(&self) -> Option<u64> {
        self.session.borrow().unix_us(self.now_us())
    }

    /// Sets the wall clock, us since 1970. False for a time that is not accepted.
    pub(super) fn set_clock(&self, unix_us: u64) -> bool {
        self.session.borrow_mut().set_clock(unix_us, self.now_us())
    }

    /// Number of times that the wall clock was set; wraps.
    pub(super) fn clock_sets(&self) -> u32 {
        self.session.borrow().clock_sets()
    }

    fn status(&self) -> Status {
        let counters = self.counters.borrow();
        Status {
            uptime_us: Instant::now().as_micros(),
            frames: self.frames_before.get().unwrap_or(self.scan.heartbeats.processed()),
            frames_missed: self.scan.missed.load(Ordering::Relaxed),
            frames_overrun: self.scan.overrun.load(Ordering::Relaxed),
            steps: counters.steps,
            rejected: counters.rejected,
            bad_frames: counters.bad_frames,
            frame_cycles: counters.frame_cycles,
            stack_bytes: (self.gauges.stack_bytes)(),
            not_stored: self.not_stored.get(),
            contents: self.contents.get(),
            update_key: key_id(&KEY),
            is_worn: self.scan.is_worn(),
            frames_skipped: self.scan.skipped.load(Ordering::Relaxed),
            scanning_ms: self.scan.scanning_ms.load(Ordering::Relaxed),
            processing_ms: counters.processing_ms,
            supply_mv: (self.gauges.supply_mv)(),
            radio: self.scan.radio(),
            ..Status::default()
        }
    }
}

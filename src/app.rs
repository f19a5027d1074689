//! The firmware's loops over a few board traits. A board's `main` initialises, binds, builds and spawns; what runs is here.
//!
//! [`scan`] belongs on an interrupt executor: its deadline is one frame time, and a miss is a frame that is skipped and
//! counted. [`process`], [`serve`] and [`keep`] share the thread executor: processing has as many frame times as the board's
//! queue holds before frames are dropped and counted; keeping has the time of [`UNKEPT_STEPS`] steps before one is dropped and
//! counted; the link has none.

#![allow(async_fn_in_trait, reason = "boards implement these traits for executors that do not move tasks")]

use crate::device::EVIDENCE;
use crate::insole::{DEVICE_CELLS, Insole, Setup};
use crate::link::{Done, Job, Link};
use crate::pace::Pace;
use crate::region::Side;
use crate::store::{Bonds, Contents, Failed, MAX_BONDS_BYTES, Name, PART_CELLS, Part, Store};
use crate::update::{self, Header, Progress, Update};
use crate::watch::Life;
use crate::wire::{
    Decoder, Hello, Identity, Live, MAJOR, MAX_FRAME, MAX_MESSAGE, MINOR, Refusal, Reset, Serial, Status, Step,
    ToDevice, decode, frame,
};
use core::cell::{Cell, RefCell};
use core::future::poll_fn;
use core::pin::{Pin, pin};
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::{Context, Poll};
use embassy_futures::select::{Either3, select, select3};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::{CriticalSectionRawMutex, NoopRawMutex};
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use embassy_sync::zerocopy_channel::{Receiver, Sender};
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};
use embedded_storage_async::nor_flash::MultiwriteNorFlash;
use heapless::{String, Vec};

/// Time after which the link looks up without a cause, so that its progress can be seen.
const IDLE: Duration = Duration::from_millis(200);

/// What an accepted update leaves for its answer to go out.
const FAREWELL: Duration = Duration::from_millis(500);

/// An image on trial stays once it was seen to make progress this often in a row.
const TRIAL_LOOKS: u8 = 5;
/// Between these looks.
const TRIAL_EVERY: Duration = Duration::from_secs(1);

/// Steps that wait to be kept.
const UNKEPT_STEPS: usize = 2;

/// The insole of a device.
pub type DeviceInsole = Insole<f32, DEVICE_CELLS>;

/// One scan of the matrix.
pub struct Frame {
    seq: u32,
    codes: [u16; DEVICE_CELLS],
}

impl Frame {
    /// All zero.
    pub const EMPTY: Self = Self { seq: 0, codes: [0; DEVICE_CELLS] };
}

/// Tells when to scan.
pub trait FrameClock {
    /// True where time stands still until there is room for a frame: a simulator's clock.
    fn is_patient(&self) -> bool {
        false
    }

    /// When frame 0 was due: the beginning of the insole's time.
    fn start(&self) -> Instant;

    /// Waits for the next frame's time and returns its number, which wraps; numbers that passed meanwhile are left out.
    async fn next(&mut self) -> u32;
}

/// Frame times from the system clock: frame `n` is due `n` periods after the first.
pub struct Ticker {
    start: Instant,
    period_us: u64,
    /// The next frame. Wider than the numbers that are told, which begin anew after 124 days at 400 Hz.
    next: u64,
}

impl Ticker {
    /// Starts now.
    pub fn new(period_us: u32) -> Self {
        Self { start: Instant::now(), period_us: u64::from(period_us), next: 0 }
    }
}

impl FrameClock for Ticker {
    fn start(&self) -> Instant {
        self.start
    }

    async fn next(&mut self) -> u32 {
        let passed = self.start.elapsed().as_micros() / self.period_us;
        let seq = passed.max(self.next);
        self.next = seq + 1;
        Timer::at(self.start + Duration::from_micros(seq * self.period_us)).await;
        seq as u32
    }
}

/// The sensor matrix did not answer in time.
pub struct MatrixTimeout;

/// The sensor matrix.
pub trait Matrix {
    /// Rows of a scan.
    fn rows(&self) -> usize;

    /// Reads one row of scan number `seq` and writes the codes of its cells to their places in the frame.
    async fn read_row(&mut self, seq: u32, row: usize, codes: &mut [u16; DEVICE_CELLS]) -> Result<(), MatrixTimeout>;
}

/// Counts processor cycles across one frame.
pub trait Stopwatch {
    /// A mark to measure from.
    fn start(&self) -> u32;
    /// Cycles since `start`, which lies less than a millisecond back.
    fn cycles_since(&self, start: u32) -> u32;
}

/// What scanning counts; shared with a lower priority, so atomic.
#[derive(Default)]
pub struct ScanCounters {
    missed: AtomicU32,
    overrun: AtomicU32,
    /// When the first scan was due, us since start.
    began_us: AtomicU32,
    /// Signs of life, of processing and the link too.
    pub life: Life,
}

impl ScanCounters {
    /// All zero.
    pub const fn new() -> Self {
        Self { missed: AtomicU32::new(0), overrun: AtomicU32::new(0), began_us: AtomicU32::new(0), life: Life::new() }
    }
}

fn add(counter: &AtomicU32, count: u32) {
    // Every counter has one writer.
    counter.store(counter.load(Ordering::Relaxed).wrapping_add(count), Ordering::Relaxed);
}

/// Scans on the clock's ticks, for ever. Never waits for anyone: without a free frame the scan is skipped and counted.
pub async fn scan(
    mut clock: impl FrameClock,
    mut matrix: impl Matrix,
    mut frames: Sender<'_, CriticalSectionRawMutex, Frame>,
    counters: &ScanCounters,
) -> ! {
    // Scanning begins within the hour that 32 bits hold.
    counters.began_us.store(clock.start().as_micros() as u32, Ordering::Relaxed);
    let mut last = None;
    loop {
        counters.life.sleep(clock.is_patient());
        if clock.is_patient() {
            frames.send().await;
        }
        let seq = clock.next().await;
        counters.life.sleep(false);
        counters.life.scan();
        let passed = seq.wrapping_sub(last.replace(seq).unwrap_or(seq.wrapping_sub(1)));
        add(&counters.missed, passed.wrapping_sub(1));
        let Some(frame) = frames.try_send() else {
            add(&counters.overrun, 1);
            continue;
        };
        match scan_frame(&mut matrix, seq, &mut frame.codes, &counters.life).await {
            Ok(()) => {
                frame.seq = seq;
                frames.send_done();
                counters.life.hand_over();
            }
            Err(MatrixTimeout) => add(&counters.missed, 1),
        }
    }
}

async fn scan_frame(
    matrix: &mut impl Matrix,
    seq: u32,
    codes: &mut [u16; DEVICE_CELLS],
    life: &Life,
) -> Result<(), MatrixTimeout> {
    for row in 0..matrix.rows() {
        matrix.read_row(seq, row, codes).await?;
        life.scan();
    }
    Ok(())
}

/// What a board that runs `image` says of itself. `fault` is what went wrong before or during this start.
pub fn hello(
    image: &Header,
    setup: &Setup,
    insole: &DeviceInsole,
    reset: Reset,
    fault: Option<String<EVIDENCE>>,
) -> Hello {
    Hello {
        major: MAJOR,
        minor: MINOR,
        // Both have at most 16 bytes, as here.
        firmware: image.version().try_into().unwrap_or_default(),
        board: image.board().try_into().unwrap_or_default(),
        side: setup.side,
        layout_id: setup.layout_id,
        cells: insole.cells() as u16,
        period_us: setup.period_us,
        // The link names the set in force.
        tissue_id: 0,
        contact_rule: setup.contact,
        reset,
        last_panic: fault,
    }
}

/// A way to a host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carrier {
    /// The serial port.
    Serial,
    /// Bluetooth LE.
    Bluetooth,
}

/// What processing and the carriers share; all run on the thread executor.
///
/// There is one session at a time, with the host that said [`ToDevice::Connect`] last, whichever way; what others send is not
/// heard until they connect again. So a step waits in one queue, and is gone when one host has it.
pub struct Session {
    link: RefCell<Link>,
    carrier: Cell<Carrier>,
    /// One for each carrier.
    changed: [Signal<NoopRawMutex, ()>; 2],
    pace: Cell<Pace>,
    /// Time of the last processed frame since the first scan.
    frame_us: Cell<u64>,
    pub(crate) hello: Hello,
    counters: RefCell<ProcessCounters>,
    scan: &'static ScanCounters,
    /// Deepest use of the stack so far, bytes.
    stack_bytes: fn() -> u32,
    /// Steps that [`keep`] has not seen yet.
    steps: Channel<NoopRawMutex, Step, UNKEPT_STEPS>,
    /// The phones that are known.
    bonds: RefCell<Vec<u8, MAX_BONDS_BYTES>>,
    bonds_changed: Cell<bool>,
    /// Frames before the first of the steps that are not kept yet.
    frames_before: Cell<Option<u32>>,
    /// There may be something to keep.
    to_keep: Signal<NoopRawMutex, ()>,
    contents: Cell<Contents>,
    /// What could not be kept.
    unkept: Cell<u32>,
}

struct ProcessCounters {
    steps: u32,
    rejected: crate::stance::Rejected,
    bad_frames: u32,
    frame_cycles: (u32, u32),
}

impl Session {
    /// Nobody connected yet.
    pub fn new(hello: Hello, scan: &'static ScanCounters, stack_bytes: fn() -> u32) -> Self {
        Self {
            link: RefCell::new(Link::new()),
            carrier: Cell::new(Carrier::Serial),
            changed: [Signal::new(), Signal::new()],
            pace: Cell::default(),
            frame_us: Cell::default(),
            hello,
            counters: RefCell::new(ProcessCounters {
                steps: 0,
                rejected: Default::default(),
                bad_frames: 0,
                frame_cycles: (u32::MAX, 0),
            }),
            scan,
            stack_bytes,
            steps: Channel::new(),
            bonds: RefCell::default(),
            bonds_changed: Cell::default(),
            frames_before: Cell::default(),
            to_keep: Signal::new(),
            contents: Cell::default(),
            unkept: Cell::default(),
        }
    }

    /// Takes up what was kept before this start, [`name`] apart.
    pub async fn restore(&self, store: &mut Store<impl MultiwriteNorFlash>, name: Name, calibration_id: u32) {
        self.contents.set(store.contents());
        let tissue = store.get(0).await.unwrap_or_default();
        let bonds: Option<Bonds> = store.get(0).await.unwrap_or_default();
        let identity = Identity { side: name.side, serial: name.serial, calibration_id };
        self.link.borrow_mut().restore(tissue, identity);
        self.bonds.replace(bonds.map(|Bonds(bytes)| bytes).unwrap_or_default());
    }

    /// Time since the first scan, us: the time of live frames and steps.
    fn now_us(&self) -> u64 {
        Instant::now().as_micros().saturating_sub(self.scan.began_us.load(Ordering::Relaxed).into())
    }

    /// Takes a message that came over a carrier; `None` is one that is not understood.
    pub(crate) fn receive(&self, carrier: Carrier, message: Option<ToDevice>) {
        if matches!(message, Some(ToDevice::Connect { .. })) {
            self.carrier.set(carrier);
        }
        let mut link = self.link.borrow_mut();
        match message {
            _ if self.carrier.get() != carrier => {}
            Some(message) => link.receive(message, self.now_us()),
            None => link.receive_unknown(),
        }
        self.to_keep.signal(());
    }

    /// The phones that are known.
    pub(crate) fn bonds(&self) -> Vec<u8, MAX_BONDS_BYTES> {
        self.bonds.borrow().clone()
    }

    /// Keeps the phones that are known.
    pub(crate) fn keep_bonds(&self, bonds: Vec<u8, MAX_BONDS_BYTES>) {
        self.bonds.replace(bonds);
        self.bonds_changed.set(true);
        self.to_keep.signal(());
    }

    fn count_unkept(&self) {
        self.unkept.set(self.unkept.get().wrapping_add(1));
    }

    /// Counts what a host sent and could not be taken.
    pub(crate) fn count_bad_frame(&self) {
        let mut counters = self.counters.borrow_mut();
        counters.bad_frames = counters.bad_frames.wrapping_add(1);
    }

    /// The next message to send over a carrier.
    pub(crate) fn next<'b>(&self, carrier: Carrier, buffer: &'b mut [u8]) -> Option<&'b [u8]> {
        let mut link = self.link.borrow_mut();
        (self.carrier.get() == carrier).then(|| link.next(&self.hello, || self.status(), buffer)).flatten()
    }

    /// A carrier lost its host.
    pub(crate) fn close(&self, carrier: Carrier) {
        if self.carrier.get() == carrier {
            self.link.borrow_mut().close();
        }
    }

    /// Signals that there may be something to send.
    pub(crate) fn changed(&self, carrier: Carrier) -> &Signal<NoopRawMutex, ()> {
        match carrier {
            Carrier::Serial => &self.changed[0],
            Carrier::Bluetooth => &self.changed[1],
        }
    }

    /// Number of steps, and steps of both feet a minute.
    pub(crate) fn pace(&self) -> (u32, u8) {
        let pace = self.pace.get();
        (pace.steps, pace.cadence_per_min(self.frame_us.get()))
    }

    /// The wall clock, us since 1970.
    pub(crate) fn unix_us(&self) -> Option<u64> {
        self.link.borrow().unix_us(self.now_us())
    }

    pub(crate) fn set_clock(&self, unix_us: u64) {
        self.link.borrow_mut().set_clock(unix_us, self.now_us());
    }

    /// Tells whether the wall clock was set since.
    pub(crate) fn clock_sets(&self) -> u32 {
        self.link.borrow().clock_sets()
    }

    fn status(&self) -> Status {
        let counters = self.counters.borrow();
        Status {
            uptime_us: Instant::now().as_micros(),
            frames: self.frames_before.get().unwrap_or(self.scan.life.modelled()),
            frames_missed: self.scan.missed.load(Ordering::Relaxed),
            frames_overrun: self.scan.overrun.load(Ordering::Relaxed),
            steps: counters.steps,
            rejected: counters.rejected,
            bad_frames: counters.bad_frames,
            frame_cycles: counters.frame_cycles,
            stack_bytes: (self.stack_bytes)(),
            unkept: self.unkept.get(),
            contents: self.contents.get(),
            ..Status::default()
        }
    }
}

/// Turns frames into live messages and steps, for ever.
pub async fn process(
    insole: &mut DeviceInsole,
    mut frames: Receiver<'_, CriticalSectionRawMutex, Frame>,
    session: &Session,
    stopwatch: impl Stopwatch,
) -> ! {
    let period_us = insole.setup().map_or(0, |setup| u64::from(setup.period_us));
    loop {
        let frame = frames.receive().await;
        {
            let link = session.link.borrow();
            if let Some(tissue) = link.tissue_due().filter(|tissue| tissue.id != insole.tissue_id()) {
                // The link took none that is refused here.
                let _ = insole.set_tissue(tissue);
            }
        }
        let start = stopwatch.start();
        let seq = frame.seq;
        let toe_off = insole.frame(seq, &frame.codes);
        {
            let mut link = session.link.borrow_mut();
            if let Some(sequence) = link.next_live() {
                link.push_live(Live::new(sequence, u64::from(seq) * period_us, insole.loads(), insole.masked()));
            }
        }
        let cycles = stopwatch.cycles_since(start);
        frames.receive_done();
        session.frame_us.set(u64::from(seq) * period_us);
        {
            let mut counters = session.counters.borrow_mut();
            if insole.on_ground() {
                let (least, most) = counters.frame_cycles;
                counters.frame_cycles = (least.min(cycles), most.max(cycles));
            }
            counters.rejected = insole.rejected();
        }
        session.link.borrow_mut().set_faults(insole.faults());
        if toe_off {
            let mut regions = [Default::default(); 8];
            for (region, step) in regions.iter_mut().enumerate() {
                *step = insole.step_region(region);
                yield_now().await;
            }
            if let Some(step) = insole.step(regions) {
                let before = session.frames_before.get().unwrap_or(session.scan.life.modelled());
                session.frames_before.set(Some(before));
                let start_unix_us = session.link.borrow().unix_us(step.start_us);
                if session.steps.try_send(Step { start_unix_us, ..Step::new(&step) }).is_err() {
                    session.link.borrow_mut().count_dropped(1);
                }
                session.to_keep.signal(());
                let mut pace = session.pace.get();
                pace.step(step.start_us);
                session.pace.set(pace);
                session.counters.borrow_mut().steps += 1;
            }
        }
        session.scan.life.model();
        session.changed.iter().for_each(|carrier| carrier.signal(()));
        // The link's turn, also while frames are queued.
        yield_now().await;
    }
}

/// What the insole is called; the board's own `side` where it was not told another.
pub async fn name(store: &mut Store<impl MultiwriteNorFlash>, side: Side) -> Name {
    store.get(0).await.ok().flatten().unwrap_or(Name { side, serial: Serial::NONE })
}

/// Lets an insole go by the calibration that is kept of it: `recalibrate` does so from a cell on. Its id, 0 without one.
pub async fn calibrate(
    store: &mut Store<impl MultiwriteNorFlash>,
    insole: &mut DeviceInsole,
    recalibrate: impl Fn(&mut DeviceInsole, usize, &Part),
) -> u32 {
    let layout_id = insole.setup().map_or(0, |setup| setup.layout_id);
    let kept = store.calibration(layout_id, insole.cells() as u16).await;
    let Some(calibration) = kept.ok().flatten() else { return 0 };
    for first in (0..insole.cells()).step_by(PART_CELLS) {
        // All parts were there just now.
        let Ok(Some(part)) = store.part(&calibration, (first / PART_CELLS) as u8).await else { return 0 };
        recalibrate(insole, first, &part);
    }
    calibration.id
}

/// Keeps steps, acknowledgements, parameters and bonds in the flash chip, for ever. What the chip does not take holds until the
/// next start, and is counted. Takes in updates of `image`, which runs, and lets it stay once it is proven.
pub async fn keep(
    store: &mut Store<impl MultiwriteNorFlash>,
    session: &Session,
    image: &Header,
    restart: fn() -> !,
) -> ! {
    // The log holds steps after the last one at hand.
    let mut ahead = true;
    let mut is_readable = false;
    let mut update = Update::new();
    let mut restart_at = Instant::MAX;
    // Without a chip nothing can have been swapped.
    let is_on_trial = match store.flash() {
        Some(flash) => update::is_on_trial(flash).await == Ok(true),
        None => false,
    };
    let mut trial = is_on_trial.then(|| Trial::new(session));
    loop {
        while let Ok(step) = session.steps.try_receive() {
            let pushed = store.push_step(&step).await;
            let is_done = match pushed {
                Ok(dropped) => {
                    let mut link = session.link.borrow_mut();
                    link.count_dropped(dropped);
                    ahead |= !link.room().0;
                    ahead
                }
                Err(_) => {
                    session.count_unkept();
                    // At hand it would pass over those in the log, which are more.
                    let is_lost = ahead && is_readable;
                    session.link.borrow_mut().count_dropped(is_lost.into());
                    is_lost
                }
            };
            if !is_done {
                session.link.borrow_mut().push_step(step);
            }
        }
        session.frames_before.set(None);
        let acknowledged = session.link.borrow_mut().take_acknowledged();
        if let Some(step) = acknowledged
            && store.acknowledge(step).await.is_err()
        {
            session.count_unkept();
        }
        if ahead && session.link.borrow().room().0 {
            let brought = bring_steps(store, session).await;
            is_readable = brought.is_ok();
            // What cannot be read now is tried again with the next.
            ahead = brought.unwrap_or(true);
        }
        if session.bonds_changed.take() && store.put(0, &Bonds(session.bonds())).await.is_err() {
            session.count_unkept();
        }
        let job = session.link.borrow().job();
        if let Some(job) = job {
            let done = work(store, session, &mut update, image, job, restart).await;
            if done == Ok(Done::Update(Progress::Accepted)) {
                restart_at = Instant::now() + FAREWELL;
            }
            if done == Err(Refusal::NotKept) {
                session.count_unkept();
            }
            session.link.borrow_mut().done(done);
        }
        session.contents.set(store.contents());
        session.changed.iter().for_each(|carrier| carrier.signal(()));
        let look_at = trial.as_ref().map_or(Instant::MAX, |trial| trial.look_at);
        select(session.to_keep.wait(), Timer::at(restart_at.min(look_at))).await;
        if Instant::now() >= restart_at {
            restart();
        }
        if trial.as_mut().is_some_and(|trial| trial.is_passed(session)) {
            trial = None;
            if let Some(flash) = store.flash() {
                // What cannot be confirmed is swapped back, and the host sees the version.
                let _ = update::confirm(flash).await;
            }
        }
    }
}

/// Watches an image that was just swapped in.
struct Trial {
    looks_left: u8,
    look_at: Instant,
    before: [u32; 3],
}

impl Trial {
    fn new(session: &Session) -> Self {
        Self { looks_left: TRIAL_LOOKS, look_at: Instant::now() + TRIAL_EVERY, before: session.scan.life.signs() }
    }

    /// True once scanning, processing and the link each made progress from look to look.
    fn is_passed(&mut self, session: &Session) -> bool {
        if Instant::now() >= self.look_at {
            let now = session.scan.life.signs();
            let progressed = now.iter().zip(&self.before).all(|(now, before)| now != before);
            let looks_left = if progressed { self.looks_left - 1 } else { TRIAL_LOOKS };
            *self = Self { looks_left, look_at: Instant::now() + TRIAL_EVERY, before: now };
        }
        self.looks_left == 0
    }
}

/// Brings steps at hand that come after those that are; tells whether there are more.
async fn bring_steps(store: &mut Store<impl MultiwriteNorFlash>, session: &Session) -> Result<bool, Failed> {
    let (_, last) = session.link.borrow().room();
    let bring = |step| {
        let mut link = session.link.borrow_mut();
        let has_room = link.room().0;
        if has_room {
            link.push_step(step);
        }
        has_room
    };
    store.steps(last, bring).await
}

/// Does what a host wants kept.
async fn work(
    store: &mut Store<impl MultiwriteNorFlash>,
    session: &Session,
    update: &mut Update,
    image: &Header,
    job: Job,
    restart: fn() -> !,
) -> Result<Done, Refusal> {
    let identity = session.link.borrow().identity();
    let hello = &session.hello;
    match job {
        Job::Tissue(tissue) => {
            store.put(0, &tissue).await?;
            Ok(Done::Kept)
        }
        Job::Name(side, serial) => {
            store.put(0, &Name { side, serial }).await?;
            Ok(Done::Identity(Identity { side, serial, ..identity }))
        }
        Job::CalibrationPart(part, cells) => {
            store.put_part(part, &cells).await?;
            Ok(Done::Kept)
        }
        Job::Calibration { layout_id, cells, id } => {
            let fits = layout_id == hello.layout_id && cells == hello.cells;
            if !fits || !store.put_calibration(layout_id, cells, id).await? {
                return Err(Refusal::Calibration);
            }
            Ok(Done::Identity(Identity { calibration_id: id, ..identity }))
        }
        Job::Restart => restart(),
        Job::Update(request) => {
            let progress = match store.flash() {
                Some(flash) => {
                    let mut handled = pin!(update.handle(flash, image, &update::KEY, &request));
                    poll_fn(|context| poll_apart(handled.as_mut(), context)).await
                }
                None => Err(update::Refusal::Chip),
            };
            progress.map(Done::Update).map_err(Refusal::Update)
        }
    }
}

/// Polls with a stack frame of its own: what a check of signatures needs of the stack is not reserved all the time.
#[inline(never)]
fn poll_apart<F: Future>(work: Pin<&mut F>, context: &mut Context<'_>) -> Poll<F::Output> {
    work.poll(context)
}

impl From<Failed> for Refusal {
    fn from(_: Failed) -> Self {
        Self::NotKept
    }
}

/// Speaks to a host over a byte carrier, for ever.
pub async fn serve(mut rx: impl Read, mut tx: impl Write, session: &Session) -> ! {
    let mut decoder = Decoder::new();
    let mut received = [0; 64];
    let (mut message, mut framed) = ([0; MAX_MESSAGE], [0; MAX_FRAME]);
    loop {
        let heard = select3(rx.read(&mut received), session.changed(Carrier::Serial).wait(), Timer::after(IDLE)).await;
        session.scan.life.link();
        if let Either3::First(heard) = heard {
            // A framing or overrun error of the port shows as a bad CRC.
            for &byte in heard.ok().and_then(|n| received.get(..n)).unwrap_or_default() {
                if let Some(bytes) = decoder.push(byte) {
                    let message = decode(bytes);
                    if message.is_none() {
                        session.count_bad_frame();
                    }
                    session.receive(Carrier::Serial, message);
                }
                for _ in 0..core::mem::take(&mut decoder.bad_frames) {
                    session.count_bad_frame();
                }
            }
        }
        while let Some(message) = session.next(Carrier::Serial, &mut message) {
            let len = frame(message, &mut framed);
            if tx.write_all(&framed[..len]).await.is_err() {
                session.close(Carrier::Serial);
                break;
            }
        }
    }
}

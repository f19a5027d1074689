//! The firmware's loops over a few board traits. A board's `main` initialises, binds, builds and spawns; what runs is here.
//!
//! [`scan`] belongs on an interrupt executor: its deadline is one frame time, and a miss is a frame that is skipped and
//! counted. [`process`] and [`serve`] share the thread executor: processing has as many frame times as the board's
//! queue holds before frames are dropped and counted, the link has none.

#![allow(async_fn_in_trait, reason = "boards implement these traits for executors that do not move tasks")]

use crate::device::EVIDENCE;
use crate::insole::{DEVICE_CELLS, Insole, Setup};
use crate::link::Link;
use crate::pace::Pace;
use crate::wire::{
    Decoder, Hello, Live, MAJOR, MAX_FRAME, MAX_MESSAGE, MINOR, Reset, Status, Step, ToDevice, decode, frame,
};
use core::cell::{Cell, RefCell};
use core::sync::atomic::{AtomicU32, Ordering};
use embassy_futures::select::{Either3, select3};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::{CriticalSectionRawMutex, NoopRawMutex};
use embassy_sync::signal::Signal;
use embassy_sync::zerocopy_channel::{Receiver, Sender};
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};
use heapless::String;

/// Time after which the link looks up without a cause, so that its progress can be seen.
const IDLE: Duration = Duration::from_millis(200);

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

    /// Waits for the next frame's time and returns its number; numbers that passed meanwhile are left out.
    async fn next(&mut self) -> u32;
}

/// Frame times from the system clock: frame `n` is due `n` periods after the first.
pub struct Ticker {
    start: Instant,
    period_us: u64,
    seq: Option<u32>,
}

impl Ticker {
    /// Starts now.
    pub fn new(period_us: u32) -> Self {
        Self { start: Instant::now(), period_us: u64::from(period_us), seq: None }
    }
}

impl FrameClock for Ticker {
    fn start(&self) -> Instant {
        self.start
    }

    async fn next(&mut self) -> u32 {
        let passed = (self.start.elapsed().as_micros() / self.period_us) as u32;
        let seq = self.seq.map_or(0, |last| last.wrapping_add(1).max(passed));
        Timer::at(self.start + Duration::from_micros(u64::from(seq) * self.period_us)).await;
        self.seq = Some(seq);
        seq
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

/// The independent watchdog.
pub trait Watchdog {
    /// Starts its time anew.
    fn feed(&mut self);
}

/// What scanning counts; shared with a lower priority, so atomic.
#[derive(Default)]
pub struct ScanCounters {
    missed: AtomicU32,
    overrun: AtomicU32,
    /// When the first scan was due, us since start.
    began_us: AtomicU32,
}

impl ScanCounters {
    /// All zero.
    pub const fn new() -> Self {
        Self { missed: AtomicU32::new(0), overrun: AtomicU32::new(0), began_us: AtomicU32::new(0) }
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
        if clock.is_patient() {
            frames.send().await;
        }
        let seq = clock.next().await;
        let passed = seq.wrapping_sub(last.replace(seq).unwrap_or(seq.wrapping_sub(1)));
        add(&counters.missed, passed.wrapping_sub(1));
        let Some(frame) = frames.try_send() else {
            add(&counters.overrun, 1);
            continue;
        };
        match scan_frame(&mut matrix, seq, &mut frame.codes).await {
            Ok(()) => {
                frame.seq = seq;
                frames.send_done();
            }
            Err(MatrixTimeout) => add(&counters.missed, 1),
        }
    }
}

async fn scan_frame(matrix: &mut impl Matrix, seq: u32, codes: &mut [u16; DEVICE_CELLS]) -> Result<(), MatrixTimeout> {
    for row in 0..matrix.rows() {
        matrix.read_row(seq, row, codes).await?;
    }
    Ok(())
}

/// What a board says of itself. `fault` is what went wrong before or during this start.
pub fn hello(
    board: &str,
    setup: &Setup,
    insole: &DeviceInsole,
    reset: Reset,
    fault: Option<String<EVIDENCE>>,
) -> Hello {
    Hello {
        major: MAJOR,
        minor: MINOR,
        // The version of this package and the boards' names are shorter than 16 bytes.
        firmware: env!("CARGO_PKG_VERSION").try_into().unwrap_or_default(),
        board: board.try_into().unwrap_or_default(),
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
    /// Frames processed, and turns of the link's loop.
    frames: AtomicU32,
    link_turns: AtomicU32,
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
            frames: AtomicU32::new(0),
            link_turns: AtomicU32::new(0),
        }
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

    /// Counts that stand still when scanning, processing or the link does.
    fn progress(&self) -> [u32; 3] {
        let count = |counter: &AtomicU32| counter.load(Ordering::Relaxed);
        // A matrix that does not answer is counted and reported, not reset: processing has nothing to do then.
        let processed = count(&self.frames).wrapping_add(count(&self.scan.missed));
        let scanned = processed.wrapping_add(count(&self.scan.overrun));
        [scanned, processed, count(&self.link_turns)]
    }

    fn status(&self) -> Status {
        let counters = self.counters.borrow();
        Status {
            uptime_us: Instant::now().as_micros(),
            frames: self.frames.load(Ordering::Relaxed),
            frames_missed: self.scan.missed.load(Ordering::Relaxed),
            frames_overrun: self.scan.overrun.load(Ordering::Relaxed),
            steps: counters.steps,
            rejected: counters.rejected,
            bad_frames: counters.bad_frames,
            frame_cycles: counters.frame_cycles,
            stack_bytes: (self.stack_bytes)(),
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
            if link.tissue().id != insole.tissue_id() {
                // The link took none that is refused here.
                let _ = insole.set_tissue(link.tissue());
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
                session.link.borrow_mut().push_step(Step::new(&step));
                let mut pace = session.pace.get();
                pace.step(step.start_us);
                session.pace.set(pace);
                session.counters.borrow_mut().steps += 1;
            }
        }
        add(&session.frames, 1);
        session.changed.iter().for_each(|carrier| carrier.signal(()));
        // The link's turn, also while frames are queued.
        yield_now().await;
    }
}

/// Speaks to a host over a byte carrier, for ever.
pub async fn serve(mut rx: impl Read, mut tx: impl Write, session: &Session) -> ! {
    let mut decoder = Decoder::new();
    let mut received = [0; 64];
    let (mut message, mut framed) = ([0; MAX_MESSAGE], [0; MAX_FRAME]);
    loop {
        let heard = select3(rx.read(&mut received), session.changed(Carrier::Serial).wait(), Timer::after(IDLE)).await;
        add(&session.link_turns, 1);
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

/// Feeds the watchdog as long as scanning, processing and the link have each made progress since the last look. `every` is
/// at most half of the watchdog's time and longer than a frame and the link's idle time.
pub async fn supervise(mut watchdog: impl Watchdog, session: &Session, every: Duration) -> ! {
    let mut before = session.progress();
    loop {
        Timer::after(every).await;
        let now = session.progress();
        if now.iter().zip(&before).all(|(now, before)| now != before) {
            watchdog.feed();
            before = now;
        }
    }
}

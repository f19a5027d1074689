//! Scans the matrix frame by frame.

use super::board::{FrameClock, Matrix, MatrixTimeout};
use super::supervise::{Heartbeats, Part};
use crate::pipeline::setup::DEVICE_CELLS;
use crate::protocol::Radio;
#[cfg(not(shuttle))]
use core::sync::atomic::{AtomicU32, Ordering};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::zerocopy_channel::Sender;
use embassy_time::Instant;
#[cfg(shuttle)]
use shuttle::sync::atomic::{AtomicU32, Ordering};

/// One scan of the matrix.
pub struct Frame {
    pub(super) seq: u32,
    pub(super) codes: [u16; DEVICE_CELLS],
}

impl Frame {
    /// All zeros.
    pub const EMPTY: Self = Self { seq: 0, codes: [0; DEVICE_CELLS] };
}

/// The counters of the scan. They are atomic because tasks of a lower priority read them, and write `interval`.
pub struct ScanCounters {
    /// Number of frames that were due and not scanned completely, without those of the next two counters.
    pub(super) missed: AtomicU32,
    /// Number of frames that were not scanned because the queue to processing was full.
    pub(super) overrun: AtomicU32,
    /// Number of frames that were not scanned because the insole is not worn.
    pub(super) skipped: AtomicU32,
    /// Frames with a number that is a multiple of `interval` are scanned. `interval` is 1 while the insole is worn; processing
    /// changes it.
    pub(super) interval: AtomicU32,
    /// Total duration of all scans since the start, ms; wraps.
    pub(super) scanning_ms: AtomicU32,
    /// When the first scan was due, us since the start.
    pub(super) began_us: AtomicU32,
    /// The heartbeats of all parts.
    pub heartbeats: Heartbeats,
    /// Why the radio does not start: 0 if nothing is known, [`NO_RADIO_FIRMWARE`], or [`RADIO_FAILED`] plus a code.
    radio_failure: AtomicU32,
}

/// See [`ScanCounters::radio_failure`].
const NO_RADIO_FIRMWARE: u32 = 1;
/// See [`ScanCounters::radio_failure`].
const RADIO_FAILED: u32 = 1 << 8;

impl ScanCounters {
    /// The state before the first scan: every frame is scanned.
    pub const fn new() -> Self {
        Self {
            missed: AtomicU32::new(0),
            overrun: AtomicU32::new(0),
            skipped: AtomicU32::new(0),
            interval: AtomicU32::new(1),
            scanning_ms: AtomicU32::new(0),
            began_us: AtomicU32::new(0),
            heartbeats: Heartbeats::new(),
            radio_failure: AtomicU32::new(0),
        }
    }

    /// Records that the radio has no firmware. The status reports it.
    pub fn radio_has_no_firmware(&self) {
        self.radio_failure.store(NO_RADIO_FIRMWARE, Ordering::Relaxed);
    }

    /// Records that the radio does not start, with the vendor's code, 0 without one. The status reports it.
    pub fn radio_failed(&self, code: u8) {
        self.radio_failure.store(RADIO_FAILED + u32::from(code), Ordering::Relaxed);
    }

    /// The state of the radio.
    pub(super) fn radio(&self) -> Radio {
        match self.radio_failure.load(Ordering::Relaxed) {
            0 if self.heartbeats.count(Part::Radio) > 0 => Radio::Answers,
            0 => Radio::Silent,
            NO_RADIO_FIRMWARE => Radio::NoFirmware,
            failure => Radio::Failed(failure as u8),
        }
    }

    /// True while every frame is scanned.
    pub(super) fn is_worn(&self) -> bool {
        self.interval.load(Ordering::Relaxed) == 1
    }
}

impl Default for ScanCounters {
    fn default() -> Self {
        Self::new()
    }
}

fn add(counter: &AtomicU32, count: u32) {
    // Every counter has one writer.
    counter.store(counter.load(Ordering::Relaxed).wrapping_add(count), Ordering::Relaxed);
}

/// Scans at the frame times of the clock. Never waits for processing: if the queue of frames is full, the frame is not
/// scanned but counted. While the insole is not worn, it scans two frames a second. Never returns.
pub async fn scan(
    mut clock: impl FrameClock,
    mut matrix: impl Matrix,
    mut frames: Sender<'_, CriticalSectionRawMutex, Frame>,
    counters: &ScanCounters,
) -> ! {
    // Scanning begins within the first hour after the start, so the time in us fits into 32 bits.
    counters.began_us.store(clock.start().as_micros() as u32, Ordering::Relaxed);
    let mut last_seq = None;
    let mut scanning_us = 0;
    loop {
        let seq = clock.next().await;
        counters.heartbeats.scan_progressed();
        let elapsed = seq.wrapping_sub(last_seq.replace(seq).unwrap_or(seq.wrapping_sub(1)));
        add(&counters.missed, elapsed.wrapping_sub(1));
        if !seq.is_multiple_of(counters.interval.load(Ordering::Relaxed)) {
            add(&counters.skipped, 1);
            continue;
        }
        let Some(frame) = frames.try_send() else {
            add(&counters.overrun, 1);
            continue;
        };
        let began = Instant::now();
        let scanned = scan_frame(&mut matrix, seq, &mut frame.codes, &counters.heartbeats).await;
        scanning_us += began.elapsed().as_micros();
        counters.scanning_ms.store((scanning_us / 1000) as u32, Ordering::Relaxed);
        match scanned {
            Ok(()) => {
                frame.seq = seq;
                frames.send_done();
                counters.heartbeats.frame_queued();
            }
            Err(MatrixTimeout) => add(&counters.missed, 1),
        }
    }
}

async fn scan_frame(
    matrix: &mut impl Matrix,
    seq: u32,
    codes: &mut [u16; DEVICE_CELLS],
    heartbeats: &Heartbeats,
) -> Result<(), MatrixTimeout> {
    for row in 0..matrix.rows() {
        matrix.read_row(seq, row, codes).await?;
        heartbeats.scan_progressed();
    }
    Ok(())
}

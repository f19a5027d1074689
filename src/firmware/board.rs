//! The traits that a board implements for the loops.

use crate::pipeline::setup::DEVICE_CELLS;
use embassy_time::{Duration, Instant, Timer};

/// Decides when to scan.
pub trait FrameClock {
    /// The time at which frame 0 was due: the origin of the insole's time.
    fn start(&self) -> Instant;

    /// Waits for the time of the next frame and returns its number, which wraps. If frames became due before the call,
    /// it returns the last of them at once, and skips the others.
    async fn next(&mut self) -> u32;
}

/// Frame times from the system clock: frame `n` is due `n` periods after the first.
pub struct Ticker {
    start: Instant,
    period_us: u64,
    /// Number of the next frame. It has more bits than the reported number, which wraps after 124 days at 400 Hz.
    next: u64,
}

impl Ticker {
    /// Starts now, with the first frame due immediately.
    pub fn new(period_us: u32) -> Self {
        Self { start: Instant::now(), period_us: u64::from(period_us), next: 0 }
    }
}

impl FrameClock for Ticker {
    fn start(&self) -> Instant {
        self.start
    }

    async fn next(&mut self) -> u32 {
        let due = self.start.elapsed().as_micros() / self.period_us;
        let seq = due.max(self.next);
        self.next = seq + 1;
        Timer::at(self.start + Duration::from_micros(seq * self.period_us)).await;
        seq as u32
    }
}

/// The sensor matrix did not answer in time.
pub struct MatrixTimeout;

/// The sensor matrix.
pub trait Matrix {
    /// Number of rows.
    fn rows(&self) -> usize;

    /// Reads one row of the frame with number `seq`, and writes the codes of its cells to their places in the frame.
    ///
    /// # Errors
    /// If the matrix does not answer; the frame is then abandoned and counted as missed.
    async fn read_row(&mut self, seq: u32, row: usize, codes: &mut [u16; DEVICE_CELLS]) -> Result<(), MatrixTimeout>;
}

/// Counts processor cycles.
pub trait Stopwatch {
    /// Number of cycles in a millisecond.
    const CYCLES_PER_MS: u32;

    /// Begins a measurement and returns its mark. Called at the beginning of every processed frame.
    fn start(&self) -> u32;
    /// Number of cycles since the mark `start`. The counter of a board may wrap after a millisecond, so the caller measures
    /// longer work in parts, as differences of successive results. A part in which the counter wraps is measured wrongly.
    fn cycles_since(&self, start: u32) -> u32;
}

/// The measurements that a board makes of its own controller.
#[derive(Clone, Copy)]
pub struct Gauges {
    /// Returns the deepest use of the stack so far, bytes.
    pub stack_bytes: fn() -> u32,
    /// Returns the supply voltage of the controller, mV; `None` if it is not measured, or not yet.
    pub supply_mv: fn() -> Option<u16>,
}

/// The functions of a board that Bluetooth needs.
pub trait BluetoothBoard {
    /// The random static address; `None` if the Bluetooth controller has a public address.
    fn address(&self) -> Option<[u8; 6]>;

    /// Charge of the battery, percent; always `None` on a board that does not measure it, which then offers no Battery service.
    fn battery_percent(&self) -> Option<u8>;

    /// True while the owner allows a central to bond, such as shortly after power-on.
    fn allows_bonding(&self) -> bool;
}

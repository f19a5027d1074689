//! The board's side of the sensor plant, the simulation of the sensor matrix on the host: the matrix and, if the plant paces the
//! scans, the frame clock.
//!
//! The codes are in a file and only the handshake uses USART3, because the emulated USART receives only some 10 kB/s, and the
//! codes of 240 cells at 100 Hz are 48 kB/s.

use crate::injected_fault::inject;
use crate::port::Port;
use core::cell::Cell;
use core::pin::pin;
use embassy_sync::blocking_mutex::CriticalSectionMutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, with_timeout};
use emulation::{Answers, COLUMNS, InjectedFault, MATRIX_FILE, SCAN, TICK, answer_number};
use plantar::firmware::board::{FrameClock, Matrix, MatrixTimeout, Ticker};
use plantar::firmware::scan::ScanCounters;
use plantar::pipeline::setup::DEVICE_CELLS;
use semihosting::fs::File;
use semihosting::io::{Read, Seek, SeekFrom};

/// Time within which the plant must report that the next row is ready; otherwise the frame is abandoned.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(400);
/// Time between heartbeats while a paced clock waits.
const HEARTBEAT: Duration = Duration::from_millis(100);

/// Sends a request of this kind to the plant; `seq` is the number of the scan or of the tick.
fn request(port: &Port, kind: u8, seq: u32) {
    let [a, b, c, d] = seq.to_le_bytes();
    // The supervision must not reset the board within a request, because the plant would then read the beginning of the next
    // request as the end of this one.
    cortex_m::interrupt::free(|_| port.write(&[kind, a, b, c, d]));
}

/// Joins the bytes of the plant's answers. The variable is static, because a caller may time out between the two bytes of an
/// answer.
static ANSWERS: CriticalSectionMutex<Cell<Answers>> = CriticalSectionMutex::new(Cell::new(Answers::new()));

/// Waits for the next answer of the plant: [`answer_number`] of a tick and [`TICK`], or that of a scan and the number of its rows
/// in the file.
async fn answer(port: &Port) -> [u8; 2] {
    loop {
        let mut bytes = [0; 1];
        if port.read(&mut bytes).await == 0 {
            continue;
        }
        let [byte] = bytes;
        let answer = ANSWERS.lock(|cell| {
            let mut answers = cell.get();
            let answer = answers.push(byte);
            cell.set(answers);
            answer
        });
        if let Some(answer) = answer {
            return answer;
        }
    }
}

/// The matrix, with codes that the plant sets.
pub struct PlantMatrix {
    port: &'static Port,
    file: Option<File>,
    cells: usize,
    /// Number of rows of the current scan that the file contains.
    rows_ready: usize,
}

impl PlantMatrix {
    /// Opens the file of codes; without it, each read fails.
    pub fn open(port: &'static Port, cells: usize) -> Self {
        Self { port, file: File::open(MATRIX_FILE).ok(), cells, rows_ready: 0 }
    }

    /// Waits until the file contains this row of scan `seq`.
    async fn row_ready(&mut self, seq: u32, row: usize) {
        while self.rows_ready <= row {
            let [number, rows] = answer(self.port).await;
            // A late answer to an earlier request is ignored.
            if number == answer_number(seq) {
                self.rows_ready = usize::from(rows);
            }
        }
    }
}

impl Matrix for PlantMatrix {
    fn rows(&self) -> usize {
        self.cells.div_ceil(COLUMNS)
    }

    async fn read_row(&mut self, seq: u32, row: usize, codes: &mut [u16; DEVICE_CELLS]) -> Result<(), MatrixTimeout> {
        inject(&[InjectedFault::ScanStalled]);
        if row == 0 {
            self.rows_ready = 0;
            request(self.port, SCAN, seq);
        }
        if self.rows_ready > row {
            // This row was read together with an earlier one.
            return Ok(());
        }
        with_timeout(ANSWER_TIMEOUT, self.row_ready(seq, row)).await.map_err(|_| MatrixTimeout)?;
        // Reads all rows that are ready, because each access to the file halts the emulated core.
        let mut bytes = [0; 2 * DEVICE_CELLS];
        let end = (self.rows_ready * COLUMNS).min(self.cells).min(DEVICE_CELLS);
        let start = (row * COLUMNS).min(end);
        let bytes = &mut bytes[..2 * (end - start)];
        let file = self.file.as_mut().ok_or(MatrixTimeout)?;
        file.seek(SeekFrom::Start(2 * start as u64)).map_err(|_| MatrixTimeout)?;
        file.read_exact(bytes).map_err(|_| MatrixTimeout)?;
        for (code, pair) in codes[start..end].iter_mut().zip(bytes.chunks_exact(2)) {
            *code = u16::from_le_bytes([pair[0], pair[1]]);
        }
        Ok(())
    }
}

/// Signals that the queue has room: processing has evaluated a frame, and fewer frames are pending than the queue can hold. The
/// evaluated frame counts as pending until its step, load bout and alert are complete.
pub static FRAME_EVALUATED: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// The frame clock of the emulated board.
pub enum Clock {
    /// The board's own time paces the scans.
    Ticker(Ticker),
    /// The plant paces the scans: each waits for the plant, and for room in the queue of frames, so that none is dropped.
    Paced {
        port: &'static Port,
        counters: &'static ScanCounters,
        /// Length of the queue of frames.
        queue: u32,
        /// Number of the next tick, from 0.
        tick: u32,
        /// Number of the first scan.
        first: u32,
    },
}

impl FrameClock for Clock {
    fn start(&self) -> Instant {
        match self {
            Self::Ticker(ticker) => ticker.start(),
            // Paced frames are independent of the board's own time.
            Self::Paced { .. } => Instant::MIN,
        }
    }

    async fn next(&mut self) -> u32 {
        match self {
            Self::Ticker(ticker) => ticker.next().await,
            Self::Paced { port, counters, queue, tick, first } => {
                while counters.heartbeats.pending_frames() >= *queue {
                    wait_with_heartbeats(counters, FRAME_EVALUATED.wait()).await;
                }
                let current_tick = *tick;
                *tick = current_tick.wrapping_add(1);
                request(port, TICK, current_tick);
                while wait_with_heartbeats(counters, answer(port)).await != [answer_number(current_tick), TICK] {}
                first.wrapping_add(current_tick)
            }
        }
    }
}

/// Waits for `wait`, and counts heartbeats of the scan meanwhile: a scan that waits for a plant that pauses is not stalled, and
/// neither is one that waits for processing, which has heartbeats of its own.
async fn wait_with_heartbeats<T>(counters: &ScanCounters, wait: impl Future<Output = T>) -> T {
    let mut wait = pin!(wait);
    loop {
        counters.heartbeats.scan_progressed();
        if let Ok(done) = with_timeout(HEARTBEAT, wait.as_mut()).await {
            return done;
        }
    }
}

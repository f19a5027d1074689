//! The sensor plant's side of the emulated board: the set-up, the matrix and, where the plant keeps the time, the clock.
//!
//! Codes lie in a file and only the handshake goes over USART3: the emulated USART takes in some 10 KB/s, a walk has 50.

use crate::mishap::may_happen;
use crate::port::Port;
use core::sync::atomic::{AtomicU16, Ordering};
use embassy_time::{Duration, Instant, with_timeout};
use plantar::app::{FrameClock, Matrix, MatrixTimeout, Ticker};
use plantar::emulation::{COLUMNS, Head, MATRIX_FILE, Mishap, SCAN, SETUP_FILE, TICK, read_setup};
use plantar::insole::{DEVICE_CELLS, SetupCell};
use semihosting::fs::File;
use semihosting::io::{Read, Seek, SeekFrom};

/// A plant that stays silent for longer has stopped.
const SILENCE: Duration = Duration::from_millis(400);

/// The set-up; `None` where the file is absent or not whole.
pub fn set_up() -> Option<(Head, impl Iterator<Item = SetupCell> + Clone)> {
    read_setup(|at, bytes| {
        let mut file = File::open(SETUP_FILE).ok()?;
        file.seek(SeekFrom::Start(at as u64)).ok()?;
        file.read(bytes).ok()
    })
}

fn ask(port: &Port, kind: u8, seq: u32) {
    let [a, b, c, d] = seq.to_le_bytes();
    port.write(&[kind, a, b, c, d]);
}

/// The first byte of an answer whose second has not come, beyond eight bits: nothing. Who waits for it may give up between them.
static HALF: AtomicU16 = AtomicU16::new(NOTHING);
const NOTHING: u16 = u16::MAX;

async fn answer(port: &Port) -> [u8; 2] {
    let mut byte = [0; 1];
    if HALF.load(Ordering::Relaxed) == NOTHING {
        while port.read(&mut byte).await == 0 {}
        HALF.store(byte[0].into(), Ordering::Relaxed);
    }
    while port.read(&mut byte).await == 0 {}
    [HALF.swap(NOTHING, Ordering::Relaxed) as u8, byte[0]]
}

/// The matrix that the plant plays.
pub struct PlantMatrix {
    port: &'static Port,
    file: Option<File>,
    cells: usize,
    rows_ready: usize,
}

impl PlantMatrix {
    /// Without the file of codes it never answers.
    pub fn open(port: &'static Port, cells: usize) -> Self {
        Self { port, file: File::open(MATRIX_FILE).ok(), cells, rows_ready: 0 }
    }

    async fn row_ready(&mut self, seq: u32, row: usize) {
        while self.rows_ready <= row {
            let [number, rows] = answer(self.port).await;
            // A late answer to an earlier request is passed over.
            if number == seq as u8 {
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
        may_happen(&[Mishap::ScanWedged]);
        if row == 0 {
            self.rows_ready = 0;
            ask(self.port, SCAN, seq);
        }
        if self.rows_ready > row {
            // Came along with a row before.
            return Ok(());
        }
        with_timeout(SILENCE, self.row_ready(seq, row)).await.map_err(|_| MatrixTimeout)?;
        // All rows that are ready: each look into the file stops the emulator.
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

/// The board's own ticker, or time as the plant gives it.
pub enum Clock {
    Ticker(Ticker),
    Plant {
        port: &'static Port,
        ticks: u32,
        /// Number of the first scan.
        first: u32,
    },
}

impl FrameClock for Clock {
    fn is_patient(&self) -> bool {
        matches!(self, Self::Plant { .. })
    }

    fn start(&self) -> Instant {
        match self {
            Self::Ticker(ticker) => ticker.start(),
            // Frames have nothing to do with this board's own time.
            Self::Plant { .. } => Instant::MIN,
        }
    }

    async fn next(&mut self) -> u32 {
        match self {
            Self::Ticker(ticker) => ticker.next().await,
            Self::Plant { port, ticks, first } => {
                let this = *ticks;
                *ticks = this.wrapping_add(1);
                ask(port, TICK, this);
                while answer(port).await != [TICK, TICK] {}
                first.wrapping_add(this)
            }
        }
    }
}

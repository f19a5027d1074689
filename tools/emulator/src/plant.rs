//! The sensor plant, which simulates the sensor matrix: answers the board's requests for scans, and paces them if required. The
//! crate [`emulation`] describes requests and answers.

use crate::port::Stream;
use emulation::{COLUMNS, SCAN, TICK, answer_number};
use std::fs::OpenOptions;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};

/// The outcome of a scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scan {
    /// All rows answered.
    Whole,
    /// Only this number of rows answered, counted from the first.
    Rows(u8),
}

/// The load on the matrix over time.
pub trait Walk: Send + 'static {
    /// Number of scans; [`u32::MAX`] for a walk without end. After the last scan the codes stay as they are. If the plant paces
    /// the scans, its clock then stops.
    fn scans(&self) -> u32;

    /// Writes the codes of scan number `seq`, which is below [`Walk::scans`] unless the walk has no end: one code for each cell,
    /// in the order of the set-up.
    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan;
}

/// True if the walk has a scan with this number.
fn has_scan(walk: &impl Walk, seq: u32) -> bool {
    seq < walk.scans() || walk.scans() == u32::MAX
}

/// A handle of the thread that plays the walk into the matrix. The thread ends when the board closes its port.
pub struct Plant {
    /// See [`Plant::scans`].
    requested: Arc<AtomicU32>,
    /// Starts the clock of the plant.
    playing: Sender<()>,
    held: Arc<Held>,
}

/// Whether the clock of the plant is paused.
#[derive(Default)]
struct Held {
    is_held: Mutex<bool>,
    changed: Condvar,
}

impl Held {
    fn set(&self, is_held: bool) {
        *self.is_held.lock().unwrap_or_else(PoisonError::into_inner) = is_held;
        self.changed.notify_all();
    }

    /// Waits until the clock runs.
    fn wait(&self) {
        let guard = self.is_held.lock().unwrap_or_else(PoisonError::into_inner);
        let _running = self.changed.wait_while(guard, |is_held| *is_held).unwrap_or_else(PoisonError::into_inner);
    }
}

impl Drop for Plant {
    /// Ends a pause, during which the thread would not notice that the board has closed its port.
    fn drop(&mut self) {
        self.held.set(false);
    }
}

impl Plant {
    pub(crate) fn start(mut port: Stream, matrix: &Path, mut walk: impl Walk) -> io::Result<Self> {
        let mut file = OpenOptions::new().write(true).open(matrix)?;
        let cells = file.metadata()?.len() as usize / 2;
        let requested = Arc::new(AtomicU32::new(0));
        let count = requested.clone();
        let (playing, play) = channel();
        let held = Arc::new(Held::default());
        let clock = held.clone();
        std::thread::spawn(move || {
            let mut codes = vec![0; cells];
            let mut bytes = Vec::with_capacity(2 * cells);
            let mut request = [0; 5];
            // The port is closed when the emulator ends.
            while port.read_exact(&mut request).is_ok() {
                let [kind, a, b, c, d] = request;
                let seq = u32::from_le_bytes([a, b, c, d]);
                let answered = match kind {
                    // The first tick after each start of the board waits for a call of `Plant::play`. An error means that the
                    // `Plant`, and with it the sender, was dropped.
                    TICK if seq == 0 && play.recv().is_err() => break,
                    TICK if has_scan(&walk, seq) => {
                        clock.wait();
                        port.write_all(&[answer_number(seq), TICK])
                    }
                    SCAN => {
                        let outcome = if has_scan(&walk, seq) { walk.scan(seq, &mut codes) } else { Scan::Whole };
                        count.store(seq.wrapping_add(1), Ordering::Relaxed);
                        bytes.clear();
                        bytes.extend(codes.iter().flat_map(|code| code.to_le_bytes()));
                        let rows = match outcome {
                            Scan::Rows(rows) => rows,
                            // At most 256 cells, so at most 16 rows.
                            Scan::Whole => cells.div_ceil(COLUMNS) as u8,
                        };
                        file.seek(SeekFrom::Start(0))
                            .and_then(|_| file.write_all(&bytes))
                            .and_then(|()| port.write_all(&[answer_number(seq), rows]))
                    }
                    // The walk is over. The board may have skipped its last scans, because it is not worn.
                    TICK => {
                        count.store(walk.scans(), Ordering::Relaxed);
                        Ok(())
                    }
                    _ => Ok(()),
                };
                if answered.is_err() {
                    break;
                }
            }
        });
        Ok(Self { requested, playing, held })
    }

    /// Starts the plant's clock, if the plant paces the scans. Each reset of the board needs another call.
    pub fn play(&self) {
        // The thread may have ended with the board.
        let _ = self.playing.send(());
    }

    /// Pauses the plant's clock, or lets it continue. This has no effect if the board's own clock paces the scans.
    pub fn hold(&self, is_held: bool) {
        self.held.set(is_held);
    }

    /// The number after that of the last requested scan: the number of requested scans if they are numbered from 0.
    /// Before the first request it is 0. Once the clock of the plant has stopped, it is the number of scans of the walk.
    pub fn scans(&self) -> u32 {
        self.requested.load(Ordering::Relaxed)
    }
}

//! The parts of a simulated insole: sensor matrix, flash chip, serial cable and radio link.

use crate::executor::ResetCause;
use crate::fixtures::text;
use crate::nor_flash::{NorFlashChip, OperationFailed};
use crate::virtual_time::now_us;
use crate::walk::Wearer;
use embassy_time::Timer;
use embedded_io_async::{ErrorKind, ErrorType};
use embedded_storage_async::nor_flash::{self, MultiwriteNorFlash, NorFlash, ReadNorFlash};
use plantar::firmware::ble::GattServer;
use plantar::firmware::board::{BluetoothBoard, Matrix, MatrixTimeout, Stopwatch};
use plantar::firmware::boot_report::{Failures, RADIO_DELAYED};
use plantar::insole::Insole;
use plantar::pipeline::ellipse::Ellipse;
use plantar::pipeline::setup::{DEVICE_CELLS, SetupCell};
use plantar::protocol::gatt::GattChannel;
use plantar::protocol::{Bout, LoadRecord, MAX_FAULT_TEXT, Settings, Step};
use plantar::storage::flash_map::SECTOR;
use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::future::poll_fn;
use std::rc::Rc;
use std::task::{Poll, Waker};

/// Duration of a write operation of the flash chip, us: a typical value of a W25Q32.
const WRITE_US: u64 = 700;
/// Duration of an erase operation of a sector, us: a typical value of a W25Q32.
const ERASE_US: u64 = 45_000;

/// Number of rows of the matrix.
pub const ROWS: usize = 16;

/// The flash chip of an insole. The test and each boot of the insole share it, so that its content survives resets.
#[derive(Clone)]
pub struct SharedChip(pub Rc<RefCell<NorFlashChip>>);

impl nor_flash::ErrorType for SharedChip {
    type Error = OperationFailed;
}

impl ReadNorFlash for SharedChip {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), OperationFailed> {
        crate::nor_flash::block_on(self.0.borrow_mut().read(offset, bytes))
    }

    fn capacity(&self) -> usize {
        self.0.borrow().capacity()
    }
}

impl NorFlash for SharedChip {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = SECTOR as usize;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), OperationFailed> {
        for sector in (from..to).step_by(SECTOR as usize) {
            Timer::after_micros(ERASE_US).await;
            crate::nor_flash::block_on(self.0.borrow_mut().erase(sector, sector + SECTOR))?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), OperationFailed> {
        Timer::after_micros(WRITE_US).await;
        crate::nor_flash::block_on(self.0.borrow_mut().write(offset, bytes))
    }
}

impl MultiwriteNorFlash for SharedChip {}

/// Runs the pipeline on the frames of one boot, as a reference for the steps and load bouts that arrive.
pub struct Reference {
    insole: Box<Insole<f32, DEVICE_CELLS>>,
    /// The steps and load bouts of this boot, numbered from 0, and the time at which each was computed, us.
    pub records: Vec<(LoadRecord, u64)>,
    /// Number of complete frames of this boot.
    pub frames: u32,
    /// Number of frames of this boot, from its first complete scan to its last, without a complete scan, whatever the cause.
    pub frames_without_scan: u32,
    /// Number of the last complete frame; `None` before the first one.
    last_seq: Option<u32>,
    /// The contact ellipses of the regions in each frame, by the number of the frame; `None` unless a test requests them.
    pub ellipses: Option<BTreeMap<u32, [Option<Ellipse<f32>>; 8]>>,
}

impl Reference {
    /// A reference with the configuration of `wearer`'s insole, and with these settings, if a host has set any. The settings
    /// are applied here and not by the functions of the firmware, so that an error in those functions shows as a difference
    /// between reference and insole.
    ///
    /// # Panics
    /// If the configuration is refused.
    pub fn new(wearer: &Wearer, settings: Option<Settings>) -> Self {
        let mut setup = wearer.setup();
        let mut scale = 1.0;
        if let Some(settings) = settings {
            setup.contact = settings.contact;
            setup.stance = settings.stance;
            setup.period_us = settings.period_us;
            scale = settings.scale;
        }
        let cells = wearer.cells().map(|cell| SetupCell {
            x_mm: scale * cell.x_mm,
            y_mm: scale * cell.y_mm,
            area_mm2: scale * scale * cell.area_mm2,
            ..cell
        });
        let mut insole = Box::new(Insole::new());
        insole.set_up(setup, cells).expect("a computed insole is valid");
        Self { insole, records: Vec::new(), frames: 0, frames_without_scan: 0, last_seq: None, ellipses: None }
    }

    /// Passes a complete frame through the pipeline.
    fn frame(&mut self, seq: u32, codes: &[u16]) {
        self.frames += 1;
        self.frames_without_scan += self.last_seq.replace(seq).map_or(0, |last| seq - last - 1);
        if self.insole.frame(seq, codes) {
            let step = self.insole.whole_step().expect("the insole is set up");
            self.records.push((Step::new(&step).into(), now_us()));
        }
        self.records.extend(self.insole.take_bout().map(|bout| (Bout::new(&bout).into(), now_us())));
        if let Some(ellipses) = &mut self.ellipses {
            ellipses.insert(seq, std::array::from_fn(|region| self.insole.ellipse(region)));
        }
    }
}

/// The sensor matrix under a wearer's foot.
pub struct HostMatrix {
    /// The wearer.
    pub wearer: Rc<RefCell<Wearer>>,
    /// The reference of the running boot.
    pub reference: Rc<RefCell<Reference>>,
}

impl Matrix for HostMatrix {
    fn rows(&self) -> usize {
        ROWS
    }

    async fn read_row(&mut self, seq: u32, row: usize, codes: &mut [u16; DEVICE_CELLS]) -> Result<(), MatrixTimeout> {
        let mut wearer = self.wearer.borrow_mut();
        if row == 0 {
            wearer.codes_at(now_us(), codes);
        }
        if wearer.is_row_missing(row) {
            return Err(MatrixTimeout);
        }
        if row + 1 == ROWS {
            self.reference.borrow_mut().frame(seq, codes);
        }
        Ok(())
    }
}

/// A stopwatch that reads 0, because computation takes no virtual time.
pub struct NoStopwatch;

impl Stopwatch for NoStopwatch {
    const CYCLES_PER_MS: u32 = 1;

    fn start(&self) -> u32 {
        0
    }

    fn cycles_since(&self, _: u32) -> u32 {
        0
    }
}

/// A serial cable between insole and host.
pub struct Cable {
    /// Bytes in transit to the host.
    pub to_host: VecDeque<u8>,
    /// Bytes in transit to the insole.
    to_insole: VecDeque<u8>,
    /// Wakes the insole's task that waits for bytes.
    reader: Option<Waker>,
    /// The cable is cut: bytes are lost in both directions.
    pub is_cut: bool,
    /// Duration of the transfer of one byte to the host, us; 0 for an unlimited rate.
    pub byte_us: f64,
    /// Time at which the transmit buffer of the insole's port will be empty, us.
    sent_us: f64,
    /// Mean number of bytes, in both directions together, from one damaged byte to the next; 0 for no damage. The distances are
    /// random: a constant one can be the length of a retransmission, and the same byte would then be damaged in all
    /// retransmissions.
    pub damaged_every: u32,
    random: fastrand::Rng,
}

impl Default for Cable {
    fn default() -> Self {
        Self {
            to_host: VecDeque::new(),
            to_insole: VecDeque::new(),
            reader: None,
            is_cut: false,
            byte_us: 0.0,
            sent_us: 0.0,
            damaged_every: 0,
            random: fastrand::Rng::with_seed(0),
        }
    }
}

impl Cable {
    /// Sends bytes to the insole.
    pub fn write(&mut self, bytes: &[u8]) {
        if !self.is_cut {
            for byte in bytes {
                let byte = self.transferred(*byte);
                self.to_insole.push_back(byte);
            }
            self.reader.take().into_iter().for_each(Waker::wake);
        }
    }

    /// Reserves space in the transmit buffer of the insole's port for this number of bytes. False if there is not enough.
    fn reserve(&mut self, bytes: usize) -> bool {
        let now_us = now_us() as f64;
        let sent_us = self.sent_us.max(now_us) + bytes as f64 * self.byte_us;
        let has_space = sent_us - now_us <= PORT_BYTES as f64 * self.byte_us;
        if has_space {
            self.sent_us = sent_us;
        }
        has_space
    }

    /// Transfers bytes from the insole to the host.
    fn write_to_host(&mut self, bytes: &[u8]) {
        for byte in bytes {
            let byte = self.transferred(*byte);
            if !self.is_cut {
                self.to_host.push_back(byte);
            }
        }
    }

    /// A byte after its transfer in either direction, which can damage it.
    fn transferred(&mut self, byte: u8) -> u8 {
        let is_damaged = self.damaged_every > 0 && self.random.u32(..self.damaged_every) == 0;
        if is_damaged { byte ^ 0x10 } else { byte }
    }
}

/// Size of the transmit buffer of the insole's port, bytes.
const PORT_BYTES: usize = 192;

/// The insole's end of a cable. It writes as `BufferedUartTx` of `embassy-stm32` 0.6 does: a write that is longer than the
/// transmit buffer is refused, and nothing wakes a write that waits for space. The host receives bytes when the buffer accepts
/// them.
#[derive(Clone)]
pub struct CableEnd(pub Rc<RefCell<Cable>>);

impl ErrorType for CableEnd {
    type Error = ErrorKind;
}

impl embedded_io_async::Read for CableEnd {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Self::Error> {
        poll_fn(|context| {
            let mut cable = self.0.borrow_mut();
            let len = buffer.len().min(cable.to_insole.len());
            if len == 0 {
                cable.reader = Some(context.waker().clone());
                return Poll::Pending;
            }
            buffer.iter_mut().zip(cable.to_insole.drain(..len)).for_each(|(place, byte)| *place = byte);
            Poll::Ready(Ok(len))
        })
        .await
    }
}

impl embedded_io_async::Write for CableEnd {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Error> {
        if bytes.len() > PORT_BYTES {
            return Err(ErrorKind::OutOfMemory);
        }
        poll_fn(|_| if self.0.borrow_mut().reserve(bytes.len()) { Poll::Ready(()) } else { Poll::Pending }).await;
        self.0.borrow_mut().write_to_host(bytes);
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }
}

/// A radio link between insole and central, at the level of GATT values.
pub struct RadioLink {
    /// The insole's GATT server, while the insole is on.
    pub server: Option<Rc<dyn GattServer>>,
    /// Time of the insole's start, us.
    pub origin_us: u64,
    /// Values in transit to the central.
    pub to_central: VecDeque<(GattChannel, Vec<u8>)>,
    /// A central is connected.
    pub is_connected: bool,
    /// Wakes the task that waits until a central connects or disconnects.
    waker: Option<Waker>,
    /// Largest length of a value, bytes: the ATT MTU minus 3.
    pub max_value: usize,
    /// Duration of the transfer of one value to the central, us.
    pub value_us: u64,
}

/// Largest length of a GATT value, bytes: that of a packet with data length extension, 251, without its headers.
pub const MAX_VALUE: usize = 244;

impl Default for RadioLink {
    fn default() -> Self {
        Self {
            server: None,
            origin_us: 0,
            to_central: VecDeque::new(),
            is_connected: false,
            waker: None,
            max_value: MAX_VALUE,
            value_us: 1_500,
        }
    }
}

impl RadioLink {
    /// Connects or disconnects the central.
    pub fn set_connected(&mut self, is_connected: bool) {
        self.is_connected = is_connected;
        self.to_central.clear();
        self.waker.take().into_iter().for_each(Waker::wake);
    }
}

/// Acts as the Bluetooth stack: sends values while a central is connected, and closes the session when the central disconnects.
pub async fn run_gatt(server: Rc<dyn GattServer>, radio: Rc<RefCell<RadioLink>>) {
    let heartbeats = async {
        loop {
            Timer::after_secs(1).await;
            server.radio_answered();
        }
    };
    embassy_futures::join::join(heartbeats, serve_central(server.clone(), radio)).await;
}

/// Serves one central after the other.
async fn serve_central(server: Rc<dyn GattServer>, radio: Rc<RefCell<RadioLink>>) {
    loop {
        until(&radio, |radio| radio.is_connected).await;
        let sending = async {
            loop {
                server.changed().wait().await;
                let mut value = [0; MAX_VALUE];
                loop {
                    let (max_len, value_us) = (radio.borrow().max_value, radio.borrow().value_us);
                    let Some((channel, len)) = server.next(&mut value[..max_len]) else { break };
                    Timer::after_micros(value_us).await;
                    radio.borrow_mut().to_central.push_back((channel, value[..len].to_vec()));
                }
            }
        };
        embassy_futures::select::select(sending, until(&radio, |radio| !radio.is_connected)).await;
        server.close();
    }
}

/// Waits until `is_reached` returns true for the link.
async fn until(radio: &RefCell<RadioLink>, is_reached: impl Fn(&RadioLink) -> bool) {
    poll_fn(|context| {
        let mut radio = radio.borrow_mut();
        if is_reached(&radio) {
            return Poll::Ready(());
        }
        radio.waker = Some(context.waker().clone());
        Poll::Pending
    })
    .await
}

/// A Bluetooth board on which centrals can bond at any time.
pub struct HostBluetooth;

impl BluetoothBoard for HostBluetooth {
    fn address(&self) -> Option<[u8; 6]> {
        None
    }

    fn battery_percent(&self) -> Option<u8> {
        None
    }

    fn allows_bonding(&self) -> bool {
        true
    }
}

/// The fault text of a start after a reset with this cause: a short form of the text that `cortex_m_platform::boot_report`
/// composes from the crash record. `failures` are the failures that this start considers.
pub fn crash_text(cause: ResetCause, failures: Failures) -> Option<heapless::String<MAX_FAULT_TEXT>> {
    match cause {
        ResetCause::Software => None,
        ResetCause::Watchdog(parts) => {
            let names = plantar::firmware::supervise::PARTS.iter().enumerate();
            let stalled = names.filter(|(bit, _)| parts >> bit & 1 == 1).map(|(_, name)| *name);
            let delayed = if failures.is_radio_delayed() { RADIO_DELAYED } else { "" };
            Some(text(&format!("{delayed}stalled: {}", stalled.collect::<Vec<_>>().join(" "))))
        }
        ResetCause::Panic => Some(text("panic")),
    }
}

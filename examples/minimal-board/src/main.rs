//! The smallest board, as a template for a new board. Its sensor matrix, its flash chip, its port and its clock are stubs, so it
//! links but has no function; replace each `impl` by a driver. `CONTRIBUTING.md` has the procedure; `boards/wb55` is a complete
//! board.
#![no_std]
#![no_main]

use core::convert::Infallible;
use core::hint::black_box;
use core::task::Waker;
use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::zerocopy_channel::{Receiver, Sender};
use embedded_io_async::{Read, Write};
use embedded_storage_async::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use plantar::Side;
use plantar::firmware::board::{Gauges, Matrix, MatrixTimeout, Stopwatch, Ticker};
use plantar::firmware::front_end::UNLOADED_CODE;
use plantar::firmware::scan::{Frame, ScanCounters};
use plantar::firmware::shared::Shared;
use plantar::firmware::start::{Configuration, Memory, Started, start};
use plantar::firmware::{DeviceInsole, layout, persist, process, scan, serve};
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::protocol::update::Header;
use plantar::storage::flash_map::{SECTOR, SMALLEST_CHIP};

/// The header of this image: the name of the board, which updates must match, and the version.
#[used]
#[unsafe(link_section = ".header")]
static IMAGE: Header = Header::new("minimal", env!("PLANTAR_VERSION"));

static SCAN_EXECUTOR: InterruptExecutor = InterruptExecutor::new();
static SCAN_COUNTERS: ScanCounters = ScanCounters::new();
/// The frame queue holds three frames.
static MEMORY: Memory<NoChip, 3> = Memory::new();

/// A clock that does not advance. The package of a controller, such as `embassy-stm32`, has a time driver. A board without such a
/// package implements it here.
struct NoTime;

impl embassy_time_driver::Driver for NoTime {
    fn now(&self) -> u64 {
        0
    }

    fn schedule_wake(&self, _at: u64, _waker: &Waker) {}
}

embassy_time_driver::time_driver_impl!(static TIME: NoTime = NoTime);
defmt::timestamp!("{=u64:us}", 0);

/// A matrix without load. A real matrix selects the row, converts its columns, and writes their codes.
struct NoLoad;

impl Matrix for NoLoad {
    fn rows(&self) -> usize {
        layout::ROWS
    }

    async fn read_row(&mut self, _seq: u32, row: usize, codes: &mut [u16; DEVICE_CELLS]) -> Result<(), MatrixTimeout> {
        for cell in layout::WIRING[row].into_iter().flatten() {
            codes[usize::from(cell)] = UNLOADED_CODE;
        }
        Ok(())
    }
}

/// A flash chip that fails: steps remain in RAM, and the status counts the items that could not be stored.
struct NoChip;

/// The error of the chip, which does not answer.
#[derive(Debug)]
struct NoAnswer;

impl NorFlashError for NoAnswer {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl ErrorType for NoChip {
    type Error = NoAnswer;
}

impl ReadNorFlash for NoChip {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, _offset: u32, _bytes: &mut [u8]) -> Result<(), NoAnswer> {
        Err(NoAnswer)
    }

    fn capacity(&self) -> usize {
        SMALLEST_CHIP as usize
    }
}

impl NorFlash for NoChip {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = SECTOR as usize;

    async fn erase(&mut self, _from: u32, _to: u32) -> Result<(), NoAnswer> {
        Err(NoAnswer)
    }

    async fn write(&mut self, _offset: u32, _bytes: &[u8]) -> Result<(), NoAnswer> {
        Err(NoAnswer)
    }
}

impl MultiwriteNorFlash for NoChip {}

/// A port without a host.
struct NoPort;

impl embedded_io_async::ErrorType for NoPort {
    type Error = Infallible;
}

impl Read for NoPort {
    async fn read(&mut self, _buffer: &mut [u8]) -> Result<usize, Infallible> {
        core::future::pending().await
    }
}

impl Write for NoPort {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// A stopwatch without a cycle counter.
struct NoCycles;

impl Stopwatch for NoCycles {
    const CYCLES_PER_MS: u32 = 1;

    fn start(&self) -> u32 {
        0
    }

    fn cycles_since(&self, _start: u32) -> u32 {
        0
    }
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let boot = cortex_m_platform::boot_report(None);
    // The compiler must not assume the content of the header, because a tool may have patched it in the image.
    let image = black_box(&IMAGE);
    // A real board initialises its clocks and ports here, and sets SysTick to a period of
    // `plantar::firmware::supervise::CHECK_PERIOD_MS`, so that `tick` is called at this period.
    let configuration = Configuration {
        setup: layout::setup(Side::Left),
        cells: layout::cells(),
        serial_bytes_per_s: 11_520,
        fault: None,
        restart: cortex_m::peripheral::SCB::sys_reset,
    };
    let gauges = Gauges { stack_bytes: cortex_m_platform::stack_bytes, supply_mv: || None };
    let started = start(&MEMORY, async { Some(NoChip) }, &boot, image, &configuration, &SCAN_COUNTERS, gauges).await;
    let Started { insole, store, shared, to_process, scanned, period_us, .. } = started;
    // Each task has static memory of its own and is spawned once, so spawning cannot fail.
    SCAN_EXECUTOR.start(SpareInterrupt).spawn(run_scan(Ticker::new(period_us), to_process).unwrap());
    spawner.spawn(run_process(insole, scanned, shared).unwrap());
    spawner.spawn(run_serve(shared).unwrap());
    // In this task, the loop uses the memory that the start has used.
    persist::persist(store, shared, image, cortex_m_platform::image(), cortex_m::peripheral::SCB::sys_reset).await
}

#[embassy_executor::task]
async fn run_scan(clock: Ticker, frames: Sender<'static, CriticalSectionRawMutex, Frame>) {
    scan::scan(clock, NoLoad, frames, &SCAN_COUNTERS).await
}

#[embassy_executor::task]
async fn run_process(
    insole: &'static mut DeviceInsole,
    frames: Receiver<'static, CriticalSectionRawMutex, Frame>,
    shared: &'static Shared,
) {
    process::process(insole, frames, shared, NoCycles).await
}

#[embassy_executor::task]
async fn run_serve(shared: &'static Shared) {
    serve::serve(NoPort, NoPort, shared).await
}

/// The table of the controller's interrupt handlers, which the package of a controller contains. One entry is enough here.
#[used]
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [Option<extern "C" fn()>; 1] = [None];

/// An interrupt that is not used otherwise. On a real board, its handler runs the scan executor.
#[derive(Clone, Copy)]
struct SpareInterrupt;

// SAFETY: the table above has an interrupt with this number.
unsafe impl cortex_m::interrupt::InterruptNumber for SpareInterrupt {
    fn number(self) -> u16 {
        0
    }
}

cortex_m_platform::on_systick!(tick);

/// Checks that all parts of the firmware make progress, and resets the board if one of them is stalled. `frame` is the address
/// of the registers that the exception put on the stack.
extern "C" fn tick(frame: u32) {
    cortex_m_platform::check(frame, &SCAN_COUNTERS.heartbeats);
}

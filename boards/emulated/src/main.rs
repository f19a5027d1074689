//! The emulated board: an STM32F405 in QEMU (`-M netduinoplus2`) with the link on USART1, a Bluetooth controller on USART2, and
//! the sensor plant, a simulation of the sensor matrix on the host, on USART3.
//!
//! The emulator has no reset and clock control, no cycle counter, and nothing that supplies voltages to the ADC, so this board
//! has its own small USART driver, and a time driver that counts with the timer TIM5. Everything above the board traits is the
//! same code as on the real boards.
#![no_std]
#![no_main]

mod bluetooth;
mod injected_fault;
mod plant;
mod port;
mod time;

use ::bluetooth::HciPipe;
use bluetooth::{Emulated, pump};
use core::hint::black_box;
use core::sync::atomic::{AtomicU32, Ordering};
use cortex_m::peripheral::{NVIC, SYST};
use defmt_semihosting as _;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_futures::join::join;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::zerocopy_channel::{Receiver, Sender};
use embassy_time::{Duration, Instant, Timer};
use emulation::{EmulatorConfig, FlashFile, InjectedFault};
use injected_fault::{MayStall, inject};
use plant::{Clock, FRAME_EVALUATED, PlantMatrix};
use plantar::Side;
use plantar::firmware::ble::GattSession;
use plantar::firmware::board::{Gauges, Stopwatch, Ticker};
use plantar::firmware::boot_report::BootReport;
use plantar::firmware::scan::{Frame, ScanCounters};
use plantar::firmware::shared::Shared;
use plantar::firmware::start::{Configuration, Memory, Started, start};
use plantar::firmware::supervise::CHECK_PERIOD_MS;
use plantar::firmware::{DeviceInsole, layout, persist, process, scan, serve};
use plantar::protocol::Reset;
use plantar::protocol::update::Header;
use plantar::sequence::is_after;
use port::{Port, PortHandle};
use static_cell::StaticCell;
use stm32_metapac::{Interrupt, USART1, USART2, USART3, interrupt};
use time::{RELOAD, Time};

embassy_time_driver::time_driver_impl!(static TIME: Time = Time::new());
defmt::timestamp!("{=u64:us}", Instant::now().as_micros());

/// The header of this image. It is at a fixed place, where host programs find it, and where the running firmware finds it when
/// it receives this image as an update.
#[used]
#[unsafe(link_section = ".header")]
static IMAGE: Header = Header::new("emulated", env!("PLANTAR_VERSION"));

/// Rate of the link: that of a serial port at 460,800 bit/s, although the emulator does not limit the rate at which the board
/// sends.
const SERIAL_BYTES_PER_S: u32 = 46_080;
static LINK: Port = Port::new(USART1, Interrupt::USART1);
static HCI: Port = Port::new(USART2, Interrupt::USART2);
static FROM_RADIO: HciPipe = HciPipe::new();
static TO_RADIO: HciPipe = HciPipe::new();
static PLANT: Port = Port::new(USART3, Interrupt::USART3);
static SCAN_EXECUTOR: InterruptExecutor = InterruptExecutor::new();
static EXECUTOR: InterruptExecutor = InterruptExecutor::new();
static SCAN_COUNTERS: ScanCounters = ScanCounters::new();
/// Length of the frame queue. At 400 Hz, eight frames last 20 ms, longer than the evaluation of a step takes.
const FRAMES: usize = 8;
static MEMORY: Memory<FlashFile, FRAMES> = Memory::new();

/// The faults that are injected into processing.
const PROCESSING_FAULTS: [InjectedFault; 4] = [
    InjectedFault::ProcessStalled,
    InjectedFault::StackOverflow,
    InjectedFault::UndefinedInstruction,
    InjectedFault::Panic,
];

/// Counts the core's cycles with SysTick. The counter restarts every millisecond, so it can only measure shorter times.
struct SysTick;

impl Stopwatch for SysTick {
    const CYCLES_PER_MS: u32 = RELOAD + 1;

    fn start(&self) -> u32 {
        // Processing calls this function whenever it has taken a frame from the queue. A real stopwatch does only the last line;
        // this board also uses the call to inject faults into processing.
        inject(&PROCESSING_FAULTS);
        SYST::get_current()
    }

    fn cycles_since(&self, start: u32) -> u32 {
        let now = SYST::get_current();
        // Processing calls this function after it has evaluated a frame, and again while it evaluates a step. These calls also
        // wake a clock that the plant paces, which waits for room in the queue. It is woken only after the counter was read, so
        // that the interrupts of the simulated matrix are not part of the frame's time, and only if there is room, because a
        // useless wake-up would be measured as a part of the step's evaluation.
        if SCAN_COUNTERS.heartbeats.pending_frames() < FRAMES as u32 {
            FRAME_EVALUATED.signal(());
        }
        if now <= start { start - now } else { start + RELOAD + 1 - now }
    }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let boot = cortex_m_platform::boot_report(None);
    // The compiler must not assume the content of the header, because a tool may have patched it in the image.
    let image = black_box(&IMAGE);
    // SAFETY: `main` runs once. The rest of this program only reads SysTick's counter, pends, masks and unmasks interrupts,
    // and requests a reset.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    TIME.start(&mut core.SYST);
    for port in [&LINK, &HCI, &PLANT] {
        port.start();
    }
    // SysTick, which causes the regular checks of the time driver's queue and of the supervision, has the highest priority, 0,
    // after a reset. The ports have the next one; then follow the executor of the scan (TIM2) and, last, the executor of all
    // other tasks (TIM3).
    for (interrupt, priority) in [
        (Interrupt::USART1, 0x40),
        (Interrupt::USART2, 0x40),
        (Interrupt::USART3, 0x40),
        (Interrupt::TIM2, 0x80),
        (Interrupt::TIM3, 0xc0),
    ] {
        // SAFETY: no critical section of this program depends on interrupt priorities.
        unsafe { core.NVIC.set_priority(interrupt, priority) };
    }
    // SAFETY: everything that the handlers use is initialised above.
    unsafe {
        NVIC::unmask(Interrupt::USART1);
        NVIC::unmask(Interrupt::USART2);
        NVIC::unmask(Interrupt::USART3);
    }

    // The task has static memory of its own and is spawned once, so spawning cannot fail.
    EXECUTOR.start(Interrupt::TIM3).spawn(run(boot, image).unwrap());
    // The executors run in interrupts. `wfi` stops the emulator's processor until the next interrupt, whereas the `wfe` of a
    // thread executor would occupy a core of the host.
    loop {
        cortex_m::asm::wfi();
    }
}

/// Starts the firmware and spawns its loops, except [`persist::persist`], for which this task reuses the memory of the start.
#[embassy_executor::task]
async fn run(boot: BootReport, image: &'static Header) {
    // SAFETY: this task runs on an executor of this program, so its context is that of an `embassy-executor` task.
    let spawner = unsafe { Spawner::for_current_executor().await };
    let from_host = emulation::configuration().filter(|_| !boot.is_recovery());
    let config =
        from_host.as_ref().map_or_else(|| EmulatorConfig::new(layout::setup(Side::Left)), |(config, _)| *config);
    injected_fault::plan(config.fault.filter(|planned| planned.is_repeated || boot.reset == Reset::Power));
    // A panic that is due at once occurs here, before the loops start.
    inject(&[InjectedFault::Panic]);
    let chip = async {
        // On a real board, `start` is suspended until the chip answers. This board waits for a timer, so that its `start` is
        // suspended at the same place.
        Timer::after_millis(1).await;
        Some(FlashFile::open(config.power_cut))
    };
    let (received, built_in, fault) = match from_host {
        Some((_, cells)) => (Some(cells), None, None),
        None => {
            // In recovery mode, the hello reports the failed starts instead.
            let fault_text = "no usable setup.bin, the built-in insole is used: start with `plantar emulate`";
            (None, Some(layout::cells()), fault_text.try_into().ok())
        }
    };
    // One iterator for both cases: with two types of iterator, the function `start` would be compiled twice, and room
    // for both versions would be reserved on the stack.
    let cells = received.into_iter().flatten().chain(built_in.into_iter().flatten());
    let restart = cortex_m::peripheral::SCB::sys_reset;
    let setup = config.setup;
    let configuration = Configuration { setup, cells, serial_bytes_per_s: SERIAL_BYTES_PER_S, fault, restart };
    let gauges = Gauges { stack_bytes: cortex_m_platform::stack_bytes, supply_mv: || None };
    let started = start(&MEMORY, chip, &boot, image, &configuration, &SCAN_COUNTERS, gauges).await;
    let Started { insole, store, shared, to_process, scanned, period_us, radio_delay } = started;
    let matrix = PlantMatrix::open(&PLANT, insole.cells());
    let clock = if config.is_paced {
        let (counters, queue, first) = (&SCAN_COUNTERS, FRAMES as u32, config.first_scan);
        Clock::Paced { port: &PLANT, counters, queue, tick: 0, first }
    } else {
        Clock::Ticker(Ticker::new(period_us))
    };
    static GATT: StaticCell<GattSession<'static, Emulated>> = StaticCell::new();
    let (address, battery_percent) = (config.address, config.battery_percent);
    let board = Emulated { address, bonding: Duration::from_secs(config.bonding_s.into()), battery_percent };
    let gatt = GATT.init(GattSession::new(shared, board));
    // Each task has static memory of its own and is spawned once, so spawning cannot fail.
    SCAN_EXECUTOR.start(Interrupt::TIM2).spawn(run_scan(clock, matrix, to_process).unwrap());
    spawner.spawn(run_process(insole, scanned, shared).unwrap());
    spawner.spawn(run_serve(shared).unwrap());
    spawner.spawn(::bluetooth::run(&FROM_RADIO, &TO_RADIO, gatt).unwrap());
    spawner.spawn(pump_radio(radio_delay).unwrap());
    persist::persist(store, shared, image, cortex_m_platform::image(), restart).await
}

#[embassy_executor::task]
async fn run_scan(clock: Clock, matrix: PlantMatrix, frames: Sender<'static, CriticalSectionRawMutex, Frame>) {
    scan::scan(clock, matrix, frames, &SCAN_COUNTERS).await
}

#[embassy_executor::task]
async fn run_process(
    insole: &'static mut DeviceInsole,
    frames: Receiver<'static, CriticalSectionRawMutex, Frame>,
    shared: &'static Shared,
) {
    process::process(insole, frames, shared, SysTick).await
}

#[embassy_executor::task]
async fn run_serve(shared: &'static Shared) {
    serve::serve(MayStall(PortHandle(&LINK)), MayStall(PortHandle(&LINK)), shared).await
}

#[embassy_executor::task]
async fn pump_radio(delay: Duration) {
    Timer::after(delay).await;
    join(pump(PortHandle(&HCI), &FROM_RADIO), pump(&TO_RADIO, PortHandle(&HCI))).await;
}

#[interrupt]
fn USART1() {
    LINK.on_interrupt();
}

#[interrupt]
fn USART2() {
    HCI.on_interrupt();
}

#[interrupt]
fn USART3() {
    PLANT.on_interrupt();
}

/// The interrupt of a timer that is not used otherwise. It runs the scan executor.
#[interrupt]
unsafe fn TIM2() {
    // SAFETY: the executor was started before this interrupt was unmasked.
    unsafe { SCAN_EXECUTOR.on_interrupt() }
}

/// The interrupt of a timer that is not used otherwise. It runs the executor of all other tasks.
#[interrupt]
unsafe fn TIM3() {
    // SAFETY: the executor was started before this interrupt was unmasked.
    unsafe { EXECUTOR.on_interrupt() }
}

cortex_m_platform::on_systick!(tick);

/// Runs once a millisecond, or less often on a busy host.
extern "C" fn tick(stack_frame: u32) {
    static NEXT_CHECK_MS: AtomicU32 = AtomicU32::new(CHECK_PERIOD_MS);
    TIME.on_interrupt();
    // A count of milliseconds in 32 bits wraps after seven weeks.
    let now_ms = Instant::now().as_millis() as u32;
    let next_ms = NEXT_CHECK_MS.load(Ordering::Relaxed);
    if !is_after(next_ms, now_ms) {
        NEXT_CHECK_MS.store(now_ms.wrapping_add(CHECK_PERIOD_MS), Ordering::Relaxed);
        cortex_m_platform::check(stack_frame, &SCAN_COUNTERS.heartbeats);
    }
}

//! A board with an nRF52840, the Seeed XIAO nRF52840: the matrix on the SAADC behind multiplexers, and the link on UARTE0;
//! `README.md` has the wiring.
//!
//! Priorities of the interrupts, the highest first. The library of the radio prescribes those of the radio and of its
//! scheduler.
//!
//! | Priority | Interrupts |
//! |---|---|
//! | 0 | the radio: RADIO, TIMER0, RTC0. Critical sections of this program do not disable them |
//! | 1 | the supervision: RTC2 |
//! | 2 | drivers: RTC1 (time), SAADC, TIMER2, UARTE0, QSPI |
//! | 4 | the radio's scheduler: EGU0, CLOCK |
//! | 5 | the scan: the executor in EGU1 |
//! | 6 | the Bluetooth controller: the executor in EGU2 |
//! | 7 | all other tasks: the executor in EGU3 |
#![no_std]
#![no_main]

mod clock;
mod flash;
mod matrix;
mod radio;

use bluetooth::HciPipe;
use clock::Microseconds;
use core::hint::black_box;
use cortex_m::peripheral::{NVIC, SCB};
use cortex_m::register::fpscr::{self, Fpscr};
use cortex_m_platform::CycleCounter;
use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_futures::select::{Either, select};
use embassy_nrf::buffered_uarte::{self, BufferedUarte};
use embassy_nrf::config::{Config, Debug, LfclkSource};
use embassy_nrf::gpio::{AnyPin, Input, Level, Output, OutputDrive, Pull};
use embassy_nrf::interrupt::{InterruptExt, Priority};
use embassy_nrf::pac::gpio::vals::Pull as PinPull;
use embassy_nrf::pac::power::regs::Resetreas;
use embassy_nrf::pac::rtc::regs::Int;
use embassy_nrf::peripherals::UARTE0;
use embassy_nrf::saadc::Input as _;
use embassy_nrf::uarte::{self, Baudrate};
use embassy_nrf::{Peri, Peripherals, bind_interrupts, interrupt, pac};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::zerocopy_channel::{Receiver, Sender};
use embassy_time::Instant;
use flash::Chip;
use matrix::{ResistiveMatrix, ShiftRegister};
use nrf_sdc::Peripherals as ControllerPeripherals;
use nrf_sdc::mpsl::Peripherals as SchedulerPeripherals;
use nrf52840_drivers::{ground_divider, wait_cycles, watchdog};
use plantar::Side;
use plantar::firmware::ble::GattSession;
use plantar::firmware::board::{Gauges, Ticker};
use plantar::firmware::boot_report::BootReport;
use plantar::firmware::scan::{Frame, ScanCounters};
use plantar::firmware::shared::Shared;
use plantar::firmware::start::{Configuration, Memory, Started, start};
use plantar::firmware::supervise::CHECK_PERIOD_MS;
use plantar::firmware::{DeviceInsole, layout, persist, process, scan, serve};
use plantar::protocol::Reset;
use plantar::protocol::update::Header;
use radio::{Nrf52840, Parts};
use static_cell::{ConstStaticCell, StaticCell};

/// Bit rate of the link, the same as on the other boards. The actual rate of the peripheral is 0.8 % lower.
const LINK_BIT_HZ: u32 = 460_800;
const LINK_RATE: Baudrate = Baudrate::Baud460800;

/// The fault that the hello reports if the low-frequency crystal does not oscillate.
const NO_CRYSTAL: &str = "the 32 kHz crystal does not oscillate: times accurate to 0.05 % only; check its soldering";

/// Largest number of attempts to measure the battery at the start.
const BATTERY_ATTEMPTS: u32 = 3;

bind_interrupts!(struct Irqs {
    UARTE0 => buffered_uarte::InterruptHandler<UARTE0>;
});

defmt::timestamp!("{=u64:us}", Instant::now().as_micros());

/// The header of this image. It is at a fixed place, where host programs find it, and where the running firmware finds it when
/// it receives this image as an update.
#[used]
#[unsafe(link_section = ".header")]
static IMAGE: Header = Header::new("nrf52840", env!("PLANTAR_VERSION"));

static FROM_RADIO: HciPipe = HciPipe::new();
static TO_RADIO: HciPipe = HciPipe::new();
static SCAN_EXECUTOR: InterruptExecutor = InterruptExecutor::new();
static RADIO_EXECUTOR: InterruptExecutor = InterruptExecutor::new();
static EXECUTOR: InterruptExecutor = InterruptExecutor::new();
static SCAN_COUNTERS: ScanCounters = ScanCounters::new();
/// The static memory of the firmware. Its queue holds three frames: at the built-in 100 Hz they last 30 ms (28 ms at 105 Hz,
/// the highest supported rate of this board), longer than the evaluation of a step takes.
static MEMORY: Memory<Chip, 3> = Memory::new();
/// The transmit buffer of the link.
static TO_SEND: ConstStaticCell<[u8; 128]> = ConstStaticCell::new([0; 128]);
/// The receive buffer of the link. At least half of it is free for further bytes at any time: 144 bytes, 3 ms at 460,800 bit/s.
/// If the link is not served for longer, as during the evaluation of a step, bytes can be lost, and their message is damaged. A
/// host repeats acknowledgements; other requests then have no answer.
static RECEIVED: ConstStaticCell<[u8; 288]> = ConstStaticCell::new([0; 288]);

/// Number of cycles of the core from the activation of the strap's pull-up to its reading: 50 us.
const STRAP_CYCLES: u32 = 3_200;

/// Determines why the board started, and clears the flags. Power-on and a brown-out set no flag.
fn take_reset_reason() -> Reset {
    let flags = pac::POWER.resetreas().read();
    // A flag is cleared by writing 1.
    pac::POWER.resetreas().write_value(flags);
    // After a reset by the pin, other flags can be set, too (erratum 136).
    if flags.resetpin() {
        Reset::Pin
    } else if flags.dog() {
        Reset::Watchdog
    } else if flags.lockup() {
        // A fault in the handler of a fault.
        Reset::Panic
    } else if flags.sreq() {
        Reset::Software
    } else if flags == Resetreas(0) || flags.vbus() {
        // USB power, which sets the flag VBUS, starts a board that is off because its battery was empty.
        Reset::Power
    } else {
        Reset::Unknown
    }
}

/// The configuration of the microcontroller.
fn config(has_crystal: bool) -> Config {
    let mut config = Config::default();
    config.lfclk_source = if has_crystal { LfclkSource::ExternalXtal } else { LfclkSource::InternalRC };
    // The module has the inductor of the step-down converter of the core's supply.
    config.dcdc.reg1 = true;
    config.time_interrupt_priority = Priority::P2;
    // The feature permits the development key, with which anyone can replace the firmware, so the debug port needs no protection.
    // Firmware for a product is built without the feature, and does not change the protection of the debug port.
    config.debug = if cfg!(feature = "development-key") { Debug::Allowed } else { Debug::NotConfigured };
    config
}

/// Calls the supervision every [`CHECK_PERIOD_MS`] from RTC2. SysTick, which other boards use, stops while the core sleeps.
fn start_supervision() {
    /// The counter ticks at 32,768 Hz / 3277, every 100.01 ms.
    const PRESCALER: u32 = 32_768 * CHECK_PERIOD_MS / 1000;
    pac::RTC2.prescaler().write(|w| w.set_prescaler(PRESCALER as u16));
    pac::RTC2.intenset().write_value(TICK);
    pac::RTC2.tasks_start().write_value(1);
}

/// The bit that enables the interrupt of the event TICK, which occurs whenever the counter is incremented.
const TICK: Int = Int(1);

#[cortex_m_rt::entry]
fn main() -> ! {
    // The present bootloader has done this already, but an older one has not, and no update replaces the bootloader.
    ground_divider();
    // Before anything that can hang, so that the board is then reset.
    watchdog::start();
    let boot = cortex_m_platform::boot_report(Some(take_reset_reason()));
    // The compiler must not assume the content of the header, because a tool may have patched it in the image.
    let image = black_box(&IMAGE);
    let has_crystal = clock::has_crystal();
    let p = embassy_nrf::init(config(has_crystal));
    watchdog::feed();
    // Without its cache, the flash delays the core. No driver of this program enables it.
    pac::NVMC.icachecnf().write(|w| w.set_cacheen(true));
    // Erratum 246: otherwise the microcontroller may draw additional current in sleep.
    // SAFETY: the erratum prescribes address and value, and nothing else uses this register.
    unsafe { (0x4007_ac84 as *mut u32).write_volatile(2) };
    // SAFETY: `main` runs once and uses DCB and DWT only, of which other code of this program only reads the cycle counter.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
    for (interrupt, priority) in [
        (interrupt::RTC2, Priority::P1),
        (interrupt::SAADC, Priority::P2),
        (interrupt::TIMER2, Priority::P2),
        (interrupt::UARTE0, Priority::P2),
        (interrupt::QSPI, Priority::P2),
        (interrupt::EGU1_SWI1, Priority::P5),
        (interrupt::EGU2_SWI2, Priority::P6),
        (interrupt::EGU3_SWI3, Priority::P7),
    ] {
        interrupt.set_priority(priority);
    }
    // SAFETY: the handlers use statics only, which need no set-up.
    unsafe {
        interrupt::RTC2.enable();
        interrupt::TIMER2.enable();
        interrupt::QSPI.enable();
    }
    start_supervision();
    // The task has static memory of its own and is spawned once, so spawning cannot fail.
    EXECUTOR.start(interrupt::EGU3_SWI3).spawn(run(boot, image, p, has_crystal).unwrap());
    // All tasks run in interrupts, so that this loop can prepare each sleep.
    loop {
        // While a flag of a floating-point operation is set, the microcontroller does not sleep (erratum 87).
        // SAFETY: no code depends on these flags. This loop uses no floating-point numbers, and a handler has flags of its own.
        unsafe { fpscr::write(Fpscr::from_bits(0)) };
        NVIC::unpend(interrupt::FPU);
        cortex_m::asm::wfi();
    }
}

/// An output, which is low at first.
fn line(pin: Peri<'static, AnyPin>) -> Output<'static> {
    Output::new(pin, Level::Low, OutputDrive::Standard)
}

/// Starts the firmware and spawns its loops, except [`persist::persist`], for which this task reuses the memory of the start.
#[embassy_executor::task]
async fn run(boot: BootReport, image: &'static Header, p: Peripherals, has_crystal: bool) {
    // SAFETY: this task runs on an executor of this program, so its context is that of an `embassy-executor` task.
    let spawner = unsafe { Spawner::for_current_executor().await };
    // The strap is connected to ground on a right insole.
    let strap = Input::new(p.P0_05, Pull::Up);
    // The pull-up charges the line, and the components that protect it, in some microseconds.
    wait_cycles(STRAP_CYCLES);
    let mut matrix = ResistiveMatrix {
        adc: p.SAADC,
        inputs: [p.P0_02.degrade_saadc(), p.P0_03.degrade_saadc(), p.P0_28.degrade_saadc(), p.P0_29.degrade_saadc()],
        battery: p.P0_31.degrade_saadc(),
        register: ShiftRegister {
            clock: line(p.P1_13.into()),
            latch: line(p.P1_14.into()),
            data: line(p.P1_15.into()),
        },
        supply: line(p.P0_04.into()),
        timer: Microseconds::new(p.TIMER2),
        measured_at: Instant::now(),
        empty_readings: 0,
    };
    let side = if strap.is_low() { Side::Right } else { Side::Left };
    let is_started_by_user = boot.is_started_by_user;
    let configuration = Configuration {
        setup: layout::setup(side),
        cells: layout::cells(),
        // A byte takes ten bits: a start bit, eight data bits and a stop bit.
        serial_bytes_per_s: LINK_BIT_HZ / 10,
        // The text fits into the hello, so the conversion cannot fail.
        fault: if has_crystal { None } else { NO_CRYSTAL.try_into().ok() },
        restart: SCB::sys_reset,
    };
    // Without a measurement, the charge would read 0 % and the start could store nothing, so a failed measurement is repeated.
    for _ in 0..BATTERY_ATTEMPTS {
        matrix.measure_battery().await;
        if matrix::supply_mv().is_some() {
            break;
        }
    }
    let chip = flash::open(p.QSPI);
    let gauges = Gauges { stack_bytes: cortex_m_platform::stack_bytes, supply_mv: matrix::supply_mv };
    let started = start(&MEMORY, chip, &boot, image, &configuration, &SCAN_COUNTERS, gauges);
    let Either::First(started) = select(started, matrix.watch_supply()).await;
    let Started { insole, store, shared, to_process, scanned, period_us, radio_delay } = started;
    let mut link = uarte::Config::default();
    link.baudrate = LINK_RATE;
    // The length of `RECEIVED` is even, as the driver requires.
    let (to_send, received) = (TO_SEND.take(), RECEIVED.take());
    let link = BufferedUarte::new(
        p.UARTE0,
        p.TIMER1,
        p.PPI_CH0,
        p.PPI_CH1,
        p.PPI_GROUP0,
        p.P1_12,
        p.P1_11,
        Irqs,
        link,
        received,
        to_send,
    );
    // Without a cable the input would float.
    pac::P1.pin_cnf(12).modify(|w| w.set_pull(PinPull::Pullup));
    static GATT: StaticCell<GattSession<'static, Nrf52840>> = StaticCell::new();
    let gatt = GATT.init(GattSession::new(shared, Nrf52840 { is_started_by_user }));
    let parts = Parts {
        scheduler: SchedulerPeripherals::new(p.RTC0, p.TIMER0, p.TEMP, p.PPI_CH19, p.PPI_CH30, p.PPI_CH31),
        controller: ControllerPeripherals::new(
            p.PPI_CH17, p.PPI_CH18, p.PPI_CH20, p.PPI_CH21, p.PPI_CH22, p.PPI_CH23, p.PPI_CH24, p.PPI_CH25, p.PPI_CH26,
            p.PPI_CH27, p.PPI_CH28, p.PPI_CH29,
        ),
        rng: p.RNG,
        has_crystal,
    };

    let clock = Ticker::new(period_us);
    // Each task has static memory of its own and is spawned once, so spawning cannot fail.
    SCAN_EXECUTOR.start(interrupt::EGU1_SWI1).spawn(run_scan(clock, matrix, to_process).unwrap());
    RADIO_EXECUTOR
        .start(interrupt::EGU2_SWI2)
        .spawn(radio::run(radio_delay, parts, &FROM_RADIO, &TO_RADIO, &SCAN_COUNTERS).unwrap());
    // The radio's task has a higher priority, so it has requested the crystal of 32 MHz by now.
    clock::wait_for_fast_crystal();
    spawner.spawn(run_process(insole, scanned, shared).unwrap());
    spawner.spawn(run_serve(link, shared).unwrap());
    spawner.spawn(bluetooth::run(&FROM_RADIO, &TO_RADIO, gatt).unwrap());
    persist::persist(store, shared, image, cortex_m_platform::image(), SCB::sys_reset).await
}

#[embassy_executor::task]
async fn run_scan(clock: Ticker, matrix: ResistiveMatrix, frames: Sender<'static, CriticalSectionRawMutex, Frame>) {
    scan::scan(clock, matrix, frames, &SCAN_COUNTERS).await
}

#[embassy_executor::task]
async fn run_process(
    insole: &'static mut DeviceInsole,
    frames: Receiver<'static, CriticalSectionRawMutex, Frame>,
    shared: &'static Shared,
) {
    process::process(insole, frames, shared, CycleCounter::<{ clock::CORE_KHZ }>).await
}

#[embassy_executor::task]
async fn run_serve(link: BufferedUarte<'static>, shared: &'static Shared) {
    let (rx, tx) = link.split();
    serve::serve(rx, tx, shared).await
}

/// Runs the executor of the scan.
#[interrupt]
unsafe fn EGU1_SWI1() {
    // SAFETY: the executor was started before this interrupt was unmasked.
    unsafe { SCAN_EXECUTOR.on_interrupt() }
}

/// Runs the executor of the Bluetooth controller.
#[interrupt]
unsafe fn EGU2_SWI2() {
    // SAFETY: as above.
    unsafe { RADIO_EXECUTOR.on_interrupt() }
}

/// Runs the executor of all other tasks.
#[interrupt]
unsafe fn EGU3_SWI3() {
    // SAFETY: as above.
    unsafe { EXECUTOR.on_interrupt() }
}

/// The interrupt RTC2: calls [`tick`] with the address of the registers that the core has put on the stack.
#[unsafe(naked)]
#[unsafe(export_name = "RTC2")]
extern "C" fn supervise() {
    core::arch::naked_asm!("mov r0, sp", "b {tick}", tick = sym tick)
}

/// Runs the supervision, then feeds the hardware watchdog, which resets the board if interrupts do not run any more.
extern "C" fn tick(stack_frame: u32) {
    pac::RTC2.events_tick().write_value(0);
    // The event must be cleared before this function returns, or the interrupt would occur again. Reading waits for the write.
    let _ = pac::RTC2.events_tick().read();
    cortex_m_platform::check(stack_frame, &SCAN_COUNTERS.heartbeats);
    watchdog::feed();
}

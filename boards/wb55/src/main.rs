//! The reference board: an STM32WB55RG with the matrix on ADC1 and the link on USART1; `docs/hardware.md` has the wiring.
#![no_std]
#![no_main]

mod channels;
mod flash;
mod matrix;
mod radio;

use bluetooth::HciPipe;
use core::hint::black_box;
use cortex_m::peripheral::MPU;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_platform::CycleCounter;
use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_stm32::adc::AdcChannel;
use embassy_stm32::gpio::{AnyPin, Input, Level, Output, Pull, Speed};
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::pac;
use embassy_stm32::pac::iwdg::vals::{Key, Pr};
use embassy_stm32::pac::rcc::regs::Hsecr;
use embassy_stm32::peripherals::{IPCC, USART1};
use embassy_stm32::rcc::{self, mux};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::{Peri, bind_interrupts, interrupt};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::zerocopy_channel::{Receiver, Sender};
use embassy_time::{Duration, Instant};
use flash::Chip;
use matrix::ResistiveMatrix;
use plantar::Side;
use plantar::firmware::ble::GattSession;
use plantar::firmware::board::{Gauges, Ticker};
use plantar::firmware::scan::{Frame, ScanCounters};
use plantar::firmware::serve::WRITE_BYTES;
use plantar::firmware::shared::Shared;
use plantar::firmware::start::{Configuration, Memory, Started, start};
use plantar::firmware::supervise::CHECK_PERIOD_MS;
use plantar::firmware::{DeviceInsole, layout, persist, process, scan, serve};
use plantar::protocol::Reset;
use plantar::protocol::update::Header;
use radio::Wb55;
use static_cell::{ConstStaticCell, StaticCell};

/// Bit rate of the link. A live frame is at most 92 bytes with its framing: 9 kB/s at 100 Hz and 31 kB/s at 333 Hz, of the
/// 46 kB/s of the link. The rate is PCLK2 / 139, with an error of 0.08 %.
const LINK_BIT_HZ: u32 = 460_800;

/// The core's clock, kHz.
const CORE_KHZ: u32 = 64_000;

/// The independent watchdog resets the board after this time without a check by the supervision, ms.
const WATCHDOG_MS: u16 = 1_000;

/// Largest number of times that the oscillation of the crystal is checked. The bootloader starts this program with a clock of
/// 16 MHz, at which all checks take 100 ms; a crystal needs 2 ms.
const CRYSTAL_CHECKS: u32 = 1_000;
/// Number of iterations of the delay loop between two checks, of three cycles each.
const CRYSTAL_CHECK_LOOPS: u32 = 533;

/// The trim of the crystal's load capacitance, 0 to 63, from `PLANTAR_HSE_TUNE`; without it, that of [`programmed_trim`] applies.
const CRYSTAL_TRIM: Option<u8> = match option_env!("PLANTAR_HSE_TUNE") {
    None => None,
    Some(text) => match u8::from_str_radix(text, 10) {
        Ok(trim @ 0..64) => Some(trim),
        _ => panic!("PLANTAR_HSE_TUNE must be a number from 0 to 63"),
    },
};
/// The one-time programmable memory: records of eight bytes, the last of which is the identifier of the record.
const ONE_TIME_RECORDS: *const [u8; 8] = 0x1fff_7000 as _;
/// Number of these records.
const ONE_TIME_COUNT: usize = 128;
/// The identifier of the records that contain the trim, and the index of the trim's byte in such a record.
const TRIM_RECORD: (u8, usize) = (0, 6);
/// Allows the next write to the register with the trim.
const UNLOCK_TRIM: u32 = 0xcafe_cafe;

/// The fault that the hello reports if the crystal does not oscillate.
const NO_CRYSTAL: &str =
    "the crystal does not oscillate: no Bluetooth, times accurate to 1 % only; check its soldering";

bind_interrupts!(struct Irqs {
    USART1 => usart::BufferedInterruptHandler<USART1>;
});

defmt::timestamp!("{=u64:us}", Instant::now().as_micros());

/// The header of this image. It is at a fixed place, where host programs find it, and where the running firmware finds it when
/// it receives this image as an update.
#[used]
#[unsafe(link_section = ".header")]
static IMAGE: Header = Header::new("stm32wb55", env!("PLANTAR_VERSION"));

static FROM_RADIO: HciPipe = HciPipe::new();
static TO_RADIO: HciPipe = HciPipe::new();
static SCAN_EXECUTOR: InterruptExecutor = InterruptExecutor::new();
static SCAN_COUNTERS: ScanCounters = ScanCounters::new();
/// The static memory of the firmware. Its queue holds three frames. At the built-in 100 Hz they last 30 ms, longer than the
/// evaluation of a step takes. At 400 Hz they last 7.5 ms; frames that become due while the queue is full are not scanned, but
/// counted.
static MEMORY: Memory<Chip, 3> = Memory::new();
/// The transmit buffer of the link: while one part of a message is transmitted, the next one is written.
static TO_SEND: ConstStaticCell<[u8; 2 * WRITE_BYTES]> = ConstStaticCell::new([0; 2 * WRITE_BYTES]);
/// The receive buffer of the link, which is longer than the longest message to the insole.
static RECEIVED: ConstStaticCell<[u8; 288]> = ConstStaticCell::new([0; 288]);

/// Starts the independent watchdog. It runs from an oscillator of its own, and nothing can stop it.
fn start_watchdog() {
    pac::IWDG.kr().write(|w| w.set_key(Key::ENABLE));
    // 32 kHz / 32: one count is a millisecond.
    pac::IWDG.pr().write(|w| w.set_pr(Pr::DIVIDE_BY32));
    pac::IWDG.rlr().write(|w| w.set_rl(WATCHDOG_MS));
    pac::IWDG.kr().write(|w| w.set_key(Key::START));
}

/// The trim that the manufacturer of a module has stored in the controller's one-time programmable memory, as ST's examples read
/// it (`Config_HSE` in STM32CubeWB): in the last record of its kind.
fn programmed_trim() -> Option<u8> {
    let (kind, trim) = TRIM_RECORD;
    let records = (0..ONE_TIME_COUNT).rev().map(|i| {
        // SAFETY: the memory has this number of records, and reading it has no effect.
        unsafe { ONE_TIME_RECORDS.add(i).read_volatile() }
    });
    records.into_iter().find(|record| record[7] == kind).map(|record| record[trim]).filter(|&trim| trim < 64)
}

/// Starts the crystal's oscillator. Switches it off and returns false if the crystal does not oscillate.
fn start_crystal() -> bool {
    if let Some(trim) = CRYSTAL_TRIM.or_else(programmed_trim) {
        pac::RCC.hsecr().write_value(Hsecr(UNLOCK_TRIM));
        pac::RCC.hsecr().modify(|w| w.set_hsetune(trim));
    }
    pac::RCC.cr().modify(|w| w.set_hseon(true));
    for _ in 0..CRYSTAL_CHECKS {
        if pac::RCC.cr().read().hserdy() {
            return true;
        }
        cortex_m::asm::delay(CRYSTAL_CHECK_LOOPS);
    }
    pac::RCC.cr().modify(|w| w.set_hseon(false));
    false
}

/// The clocks: 64 MHz, the maximum of this core, from the 32 MHz crystal, which the radio needs in any case and which makes frame
/// times accurate. The converter runs at 64 MHz, too, which is also its maximum. The internal oscillator of 16 MHz replaces a
/// crystal that does not oscillate.
fn clocks(has_crystal: bool) -> rcc::Config {
    let mut clocks = rcc::Config::new();
    let (source, prediv) = if has_crystal {
        let mode = rcc::HseMode::Oscillator;
        clocks.hse = Some(rcc::Hse { freq: Hertz(32_000_000), mode, prescaler: rcc::HsePrescaler::DIV1 });
        // The sleep clock of the radio is HSE / 1024, which saves a second crystal.
        clocks.mux.rfwkpsel = mux::Rfwkpsel::HSE_DIV_1024;
        (rcc::PllSource::HSE, rcc::PllPreDiv::DIV2)
    } else {
        clocks.hsi = true;
        (rcc::PllSource::HSI, rcc::PllPreDiv::DIV1)
    };
    // 16 MHz * 12 / 3
    let (mul, divr) = (rcc::PllMul::MUL12, Some(rcc::PllRDiv::DIV3));
    clocks.pll = Some(rcc::Pll { source, prediv, mul, divp: None, divq: None, divr });
    clocks.sys = rcc::Sysclk::PLL1_R;
    // The maximum of the radio's core is 32 MHz.
    clocks.core2_ahb_pre = rcc::AHBPrescaler::DIV2;
    clocks.msi = None;
    // The random number generator of the radio's core needs this clock.
    clocks.hsi48 = Some(rcc::Hsi48Config { sync_from_usb: false });
    clocks.ls = rcc::LsConfig::off();
    clocks.mux.adcsel = mux::Adcsel::SYS;
    clocks
}

/// Determines why the board started, and clears the flags. Every reset also sets the flag of the pin, so the pin is checked last.
fn take_reset_reason() -> Reset {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    // If the bit remained set, it would clear the flags of the next reset, too.
    pac::RCC.csr().modify(|w| w.set_rmvf(false));
    if flags.iwdgrstf() || flags.wwdgrstf() {
        Reset::Watchdog
    } else if flags.borrstf() {
        // The bootloader may have reset the controller since: it does so once the supply suffices for a swap.
        Reset::Power
    } else if flags.sftrstf() {
        Reset::Software
    } else if flags.oblrstf() || flags.lpwrrstf() || !flags.pinrstf() {
        Reset::Unknown
    } else {
        Reset::Pin
    }
}

/// Denies access to the 16 KiB below RAM, which the stack reaches if it overflows. They are in the region of the system memory,
/// and ST does not document that a write to its unused addresses causes a fault, so an overflow could remain unnoticed.
fn guard_stack(mpu: &mut MPU) {
    const VALID: u32 = 1 << 4;
    const NEVER_EXECUTE: u32 = 1 << 28;
    const SIZE_16_KIB: u32 = 13 << 1;
    const ENABLE: u32 = 1;
    /// Outside of the regions, the memory map remains the default one.
    const DEFAULT_MAP: u32 = 1 << 2;
    // SAFETY: no object of the program is in the region; the drivers read calibration values of the system memory below it.
    unsafe {
        mpu.rbar.write(0x1fff_c000 | VALID);
        mpu.rasr.write(NEVER_EXECUTE | SIZE_16_KIB | ENABLE);
        mpu.ctrl.write(DEFAULT_MAP | ENABLE);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    // First of all, so that the board is reset if anything below hangs.
    start_watchdog();
    let boot = cortex_m_platform::boot_report(Some(take_reset_reason()));
    // The compiler must not assume the content of the header, because a tool may have patched it in the image.
    let image = black_box(&IMAGE);
    let mut config = embassy_stm32::Config::default();
    // This option leaves the debug clocks on while the core sleeps: a debugger stays connected, but the core uses several times
    // the current.
    config.enable_debug_during_sleep = cfg!(feature = "development-key");
    let has_crystal = start_crystal();
    config.rcc = clocks(has_crystal);
    let p = embassy_stm32::init(config);
    // Switches off MSI, the oscillator from which the bootloader ran and which `init` leaves on.
    pac::RCC.cr().modify(|w| w.set_msion(false));
    // SAFETY: `main` runs once and uses MPU, DCB, DWT and SYST only, of which other code of this program only reads the cycle
    // counter.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    guard_stack(&mut core.MPU);
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
    core.SYST.set_clock_source(SystClkSource::Core);
    core.SYST.set_reload(CORE_KHZ * CHECK_PERIOD_MS - 1);
    core.SYST.clear_current();
    core.SYST.enable_counter();
    core.SYST.enable_interrupt();
    // The scan has a higher priority than the thread, and a lower priority than timer, DMA and port, which have the highest
    // priority by default.
    interrupt::SAI1.set_priority(Priority::P6);

    // The strap is connected to ground on a right insole.
    let strap = Input::new(p.PA10, Pull::Up);
    let line = |pin: Peri<'static, AnyPin>| Output::new(pin, Level::Low, Speed::Low);
    let columns = [
        p.PC0.degrade_adc(),
        p.PC1.degrade_adc(),
        p.PC2.degrade_adc(),
        p.PC3.degrade_adc(),
        p.PA0.degrade_adc(),
        p.PA1.degrade_adc(),
        p.PA2.degrade_adc(),
        p.PA3.degrade_adc(),
        p.PA4.degrade_adc(),
        p.PA5.degrade_adc(),
        p.PA6.degrade_adc(),
        p.PA7.degrade_adc(),
        p.PC4.degrade_adc(),
        p.PC5.degrade_adc(),
        p.PA8.degrade_adc(),
        p.PA9.degrade_adc(),
    ];
    let address = [line(p.PC6.into()), line(p.PC10.into()), line(p.PC12.into()), line(p.PB8.into())];
    let rows_off = Output::new(p.PB9, Level::High, Speed::Low);
    // The front end is on until the matrix switches it.
    let front_end = Output::new(p.PC11, Level::High, Speed::Low);
    let mut matrix = ResistiveMatrix::new(p.ADC1, p.DMA1_CH1, columns, address, rows_off, front_end);
    let side = if strap.is_low() { Side::Right } else { Side::Left };
    let select = Output::new(p.PB12, Level::High, Speed::Medium);
    let is_started_by_user = boot.is_started_by_user;
    let chip = flash::open(p.SPI2, p.PB13, p.PB15, p.PB14, p.DMA1_CH2, p.DMA1_CH3, select);
    let configuration = Configuration {
        setup: layout::setup(side),
        cells: layout::cells(),
        // A byte takes ten bits: a start bit, eight data bits and a stop bit.
        serial_bytes_per_s: LINK_BIT_HZ / 10,
        // The text fits into the hello, so the conversion cannot fail.
        fault: if has_crystal { None } else { NO_CRYSTAL.try_into().ok() },
        restart: cortex_m::peripheral::SCB::sys_reset,
    };
    let gauges = Gauges { stack_bytes: cortex_m_platform::stack_bytes, supply_mv: matrix::supply_mv };
    let started = start(&MEMORY, chip, &boot, image, &configuration, &SCAN_COUNTERS, gauges).await;
    let Started { insole, store, shared, to_process, scanned, period_us, radio_delay } = started;
    let mut link = usart::Config::default();
    link.baudrate = LINK_BIT_HZ;
    // Without a cable the input would float.
    link.rx_pull = Pull::Up;
    // The pins belong to this port and its divider reaches the bit rate, so the configuration cannot be refused.
    let link = BufferedUart::new(p.USART1, p.PB7, p.PB6, TO_SEND.take(), RECEIVED.take(), Irqs, link).unwrap();
    static GATT: StaticCell<GattSession<'static, Wb55>> = StaticCell::new();
    let gatt = GATT.init(GattSession::new(shared, Wb55 { is_started_by_user }));

    matrix.set_period(period_us);
    let clock = Ticker::new(period_us);
    // Each task has static memory of its own and is spawned once, so spawning cannot fail.
    SCAN_EXECUTOR.start(interrupt::SAI1).spawn(run_scan(clock, matrix, to_process).unwrap());
    spawner.spawn(run_process(insole, scanned, shared).unwrap());
    spawner.spawn(run_serve(link, shared).unwrap());
    spawner.spawn(bluetooth::run(&FROM_RADIO, &TO_RADIO, gatt).unwrap());
    // Without a crystal, the radio's core does not run. The Bluetooth host waits for it then, which affects no other task.
    if has_crystal {
        spawner.spawn(run_radio(radio_delay, p.IPCC).unwrap());
    }
    // In this task, the loop uses the memory that the start has used.
    persist::persist(store, shared, image, cortex_m_platform::image(), cortex_m::peripheral::SCB::sys_reset).await
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
    process::process(insole, frames, shared, CycleCounter::<CORE_KHZ>).await
}

#[embassy_executor::task]
async fn run_serve(link: BufferedUart<'static>, shared: &'static Shared) {
    let (tx, rx) = link.split();
    serve::serve(rx, tx, shared).await
}

#[embassy_executor::task]
async fn run_radio(delay: Duration, ipcc: Peri<'static, IPCC>) {
    radio::run(delay, ipcc, &FROM_RADIO, &TO_RADIO, &SCAN_COUNTERS).await;
}

/// Runs the executor of the scan. The interrupt belongs to a peripheral that this program does not use.
#[interrupt]
unsafe fn SAI1() {
    // SAFETY: the executor was started before this interrupt was unmasked.
    unsafe { SCAN_EXECUTOR.on_interrupt() }
}

cortex_m_platform::on_systick!(tick);

/// Runs the supervision, then feeds the hardware watchdog, which resets the board if interrupts do not run any more.
extern "C" fn tick(stack_frame: u32) {
    cortex_m_platform::check(stack_frame, &SCAN_COUNTERS.heartbeats);
    pac::IWDG.kr().write(|w| w.set_key(Key::RESET));
}

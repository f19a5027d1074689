//! The insole's board: an STM32WB55RG with the matrix on ADC1 and the link on USART1; `docs/hardware.md` has the wiring.
#![no_std]
#![no_main]

mod flash;
mod layout;
mod mailbox;
mod matrix;
mod radio;

use core::hint::black_box;
use cortex_m::peripheral::DWT;
use cortex_m::peripheral::syst::SystClkSource;
use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_futures::block_on;
use embassy_stm32::adc::AdcChannel;
use embassy_stm32::gpio::{AnyPin, Input, Level, Output, Pull, Speed};
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::pac;
use embassy_stm32::pac::iwdg::vals::Key;
use embassy_stm32::peripherals::{IPCC, USART1};
use embassy_stm32::rcc::{self, mux};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peri, bind_interrupts, interrupt};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::zerocopy_channel::{Channel, Receiver, Sender};
use embassy_time::Instant;
use flash::Chip;
use matrix::ResistiveMatrix;
use plantar::Side;
use plantar::app::{self, DeviceInsole, Frame, ScanCounters, Session, Stopwatch, Ticker};
use plantar::ble::{self, HciPipe, OverBluetooth};
use plantar::device::{self, Start};
use plantar::insole::Insole;
use plantar::store::Store;
use plantar::update::Header;
use plantar::watch::LOOK_MS;
use plantar::wire::Reset;
use radio::Wb55;
use static_cell::{ConstStaticCell, StaticCell};

/// Bit rate of the link. A live frame is at most 90 bytes framed: 9 kB/s at 100 Hz and 36 kB/s at 400 Hz of the 46 kB/s that
/// this carries. PCLK2 / 139 is 0.08 % off.
const LINK_BIT_HZ: u32 = 460_800;

/// The core's clock, kHz.
const CORE_KHZ: u32 = 64_000;

/// Without a look for this long the board resets.
const WATCHDOG_US: u32 = 1_000_000;

bind_interrupts!(struct Irqs {
    USART1 => usart::BufferedInterruptHandler<USART1>;
});

defmt::timestamp!("{=u64:us}", Instant::now().as_micros());

/// What this image is, where the host and the insole before it look.
#[used]
#[unsafe(link_section = ".header")]
static IMAGE: Header = Header::new("stm32wb55", env!("CARGO_PKG_VERSION"));

static FROM_RADIO: HciPipe = HciPipe::new();
static TO_RADIO: HciPipe = HciPipe::new();
static SCAN_EXECUTOR: InterruptExecutor = InterruptExecutor::new();
static SCAN_COUNTERS: ScanCounters = ScanCounters::new();
static INSOLE: ConstStaticCell<DeviceInsole> = ConstStaticCell::new(Insole::new());
/// At this board's 100 Hz they last 30 ms, more than a step's evaluation takes.
static FRAMES: ConstStaticCell<[Frame; 3]> = ConstStaticCell::new([Frame::EMPTY; 3]);
static TO_SEND: ConstStaticCell<[u8; 192]> = ConstStaticCell::new([0; 192]);
/// The longest message fits.
static RECEIVED: ConstStaticCell<[u8; 288]> = ConstStaticCell::new([0; 288]);

type FrameSender = Sender<'static, CriticalSectionRawMutex, Frame>;
type FrameReceiver = Receiver<'static, CriticalSectionRawMutex, Frame>;

/// Counts the core's cycles, those of interrupts in between included.
struct CycleCounter;

impl Stopwatch for CycleCounter {
    fn start(&self) -> u32 {
        DWT::cycle_count()
    }

    fn cycles_since(&self, start: u32) -> u32 {
        DWT::cycle_count().wrapping_sub(start)
    }
}

/// 64 MHz, the most this core does, from the 32 MHz crystal: the radio needs it in any case, and frame times are as good as
/// it is. The converter runs from the same 64 MHz, its most too.
fn clocks() -> rcc::Config {
    let mut clocks = rcc::Config::new();
    clocks.hse =
        Some(rcc::Hse { freq: Hertz(32_000_000), mode: rcc::HseMode::Oscillator, prescaler: rcc::HsePrescaler::DIV1 });
    clocks.pll = Some(rcc::Pll {
        source: rcc::PllSource::HSE,
        prediv: rcc::PllPreDiv::DIV2,
        mul: rcc::PllMul::MUL12,
        divp: None,
        divq: None,
        divr: Some(rcc::PllRDiv::DIV3), // 32 MHz / 2 * 12 / 3
    });
    clocks.sys = rcc::Sysclk::PLL1_R;
    // The radio's core does at most 32 MHz.
    clocks.core2_ahb_pre = rcc::AHBPrescaler::DIV2;
    clocks.msi = None;
    // The radio's core draws random numbers by it.
    clocks.hsi48 = Some(rcc::Hsi48Config { sync_from_usb: false });
    clocks.ls = rcc::LsConfig::off();
    // The radio sleeps by HSE / 1024: no second crystal.
    clocks.mux.rfwkpsel = mux::Rfwkpsel::HSE_DIV_1024;
    clocks.mux.adcsel = mux::Adcsel::SYS;
    clocks
}

/// Why the board started; clears the flags. Every reset pulls the pin too, so the pin comes last.
fn take_reset_reason() -> Reset {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    // Left set, it would clear the next reset's flags as well.
    pac::RCC.csr().modify(|w| w.set_rmvf(false));
    if flags.iwdgrstf() || flags.wwdgrstf() {
        Reset::Watchdog
    } else if flags.sftrstf() {
        Reset::Software
    } else if flags.borrstf() {
        Reset::Power
    } else if flags.oblrstf() || flags.lpwrrstf() || !flags.pinrstf() {
        Reset::Unknown
    } else {
        Reset::Pin
    }
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let start = Start::take(Some(take_reset_reason()));
    // As it lies in the flash, not as the compiler knows it.
    let image = black_box(&IMAGE);
    let mut config = embassy_stm32::Config::default();
    config.rcc = clocks();
    let p = embassy_stm32::init(config);
    // SAFETY: `main` runs once and nothing else takes the core's peripherals.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
    IndependentWatchdog::new(p.IWDG, WATCHDOG_US).unleash();
    core.SYST.set_clock_source(SystClkSource::Core);
    core.SYST.set_reload(CORE_KHZ * LOOK_MS - 1);
    core.SYST.clear_current();
    core.SYST.enable_counter();
    core.SYST.enable_interrupt();
    // Scanning above the thread, below the timer, DMA and the port, which are as they start: highest.
    interrupt::SAI1.set_priority(Priority::P6);
    defmt::info!("plantar {} started, reset: {}", env!("CARGO_PKG_VERSION"), start.reset.name());
    if let Some(fault) = &start.fault {
        defmt::error!("before: {}", fault.as_str());
    }

    // A strap to ground makes a right insole.
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
    let matrix = ResistiveMatrix::new(p.ADC1, p.DMA1_CH1, columns, address, line(p.PB9.into()));
    let side = if strap.is_low() { Side::Right } else { Side::Left };
    // Nothing else runs yet, so what is awaited lies on the stack, and not in a static of this task.
    static STORE: StaticCell<Store<Chip>> = StaticCell::new();
    let select = Output::new(p.PB12, Level::High, Speed::Medium);
    let chip = if start.is_fallback {
        None
    } else {
        Some(block_on(flash::open(p.SPI2, p.PB13, p.PB15, p.PB14, p.DMA1_CH2, p.DMA1_CH3, select)))
    };
    let store = STORE.init(block_on(Store::open(chip, start.reset)));
    let name = block_on(app::name(store, side));
    let insole = INSOLE.take();
    insole.count_steps_from(store.contents().next_step);
    let setup = layout::setup(name.side);
    // A test sees that it is accepted. Formatting why it would not be takes 2 KiB.
    let refused = insole.set_up(setup, layout::cells()).err().and_then(|_| "set-up refused".try_into().ok());
    let calibration_id = app::calibrate(store, insole, |insole, first, part| {
        insole.recalibrate(layout::cells(), first, part);
    });
    let calibration_id = block_on(calibration_id);
    let hello = app::hello(image, &setup, insole, start.reset, start.fault.or(refused));
    let mut link = usart::Config::default();
    link.baudrate = LINK_BIT_HZ;
    // The pins are this port's and the bit rate is within its divider, so it cannot be refused.
    let link = BufferedUart::new(p.USART1, p.PB7, p.PB6, TO_SEND.take(), RECEIVED.take(), Irqs, link).unwrap();

    static CHANNEL: StaticCell<Channel<'static, CriticalSectionRawMutex, Frame>> = StaticCell::new();
    static SESSION: StaticCell<Session> = StaticCell::new();
    static OVER_BLUETOOTH: StaticCell<OverBluetooth<'static, Wb55>> = StaticCell::new();
    let (sender, receiver) = CHANNEL.init(Channel::new(FRAMES.take())).split();
    let session = SESSION.init(Session::new(hello, &SCAN_COUNTERS, device::stack_bytes));
    block_on(session.restore(store, name, calibration_id));

    // Each task has a place of its own and is spawned once, so spawning cannot fail.
    let clock = Ticker::new(setup.period_us);
    SCAN_EXECUTOR.start(interrupt::SAI1).spawn(scan(clock, matrix, sender).unwrap());
    spawner.spawn(process(insole, receiver, session).unwrap());
    spawner.spawn(serve(link, session).unwrap());
    spawner.spawn(keep(store, session, image).unwrap());
    let by_hand = matches!(start.reset, Reset::Power | Reset::Pin);
    let insole = OVER_BLUETOOTH.init(OverBluetooth::new(session, Wb55 { by_hand }));
    spawner.spawn(ble::run(&FROM_RADIO, &TO_RADIO, insole).unwrap());
    spawner.spawn(radio(p.IPCC).unwrap());
}

#[embassy_executor::task]
async fn scan(clock: Ticker, matrix: ResistiveMatrix, frames: FrameSender) {
    app::scan(clock, matrix, frames, &SCAN_COUNTERS).await
}

#[embassy_executor::task]
async fn process(insole: &'static mut DeviceInsole, frames: FrameReceiver, session: &'static Session) {
    app::process(insole, frames, session, CycleCounter).await
}

#[embassy_executor::task]
async fn serve(link: BufferedUart<'static>, session: &'static Session) {
    let (tx, rx) = link.split();
    app::serve(rx, tx, session).await
}

#[embassy_executor::task]
async fn keep(store: &'static mut Store<Chip>, session: &'static Session, image: &'static Header) {
    app::keep(store, session, image, cortex_m::peripheral::SCB::sys_reset).await
}

#[embassy_executor::task]
async fn radio(ipcc: Peri<'static, IPCC>) {
    radio::run(ipcc, &FROM_RADIO, &TO_RADIO).await;
}

/// Nobody's port here: its interrupt runs the scan executor.
#[interrupt]
unsafe fn SAI1() {
    // SAFETY: the executor was started before this interrupt was unmasked.
    unsafe { SCAN_EXECUTOR.on_interrupt() }
}

plantar::on_systick!(tick);

/// The watchdog is fed by who looks at the others: it bites where no interrupt runs.
extern "C" fn tick(frame: u32) {
    device::look(frame, &SCAN_COUNTERS.life);
    pac::IWDG.kr().write(|w| w.set_key(Key::RESET));
}

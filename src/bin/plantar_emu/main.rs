//! The emulated board: an STM32F405 in QEMU (`-M netduinoplus2`) with the link on USART1,
//! a Bluetooth controller on USART2 and the sensor plant on USART3.
//!
//! The emulator has no reset and clock control, no ADC and no cycle counter, so this board brings its own small USART and
//! takes time from a timer; everything above the board traits is the code of the real board.
#![no_std]
#![no_main]

mod flash;
#[path = "../plantar_wb55/layout.rs"]
#[allow(dead_code, reason = "this board's matrix is wired otherwise")]
mod layout;
mod mishap;
mod plant;
mod port;
mod radio;
mod time;

use core::hint::black_box;
use core::sync::atomic::{AtomicU32, Ordering};
use cortex_m::peripheral::{NVIC, SYST};
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_futures::block_on;
use embassy_futures::join::join;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::zerocopy_channel::{Channel, Receiver, Sender};
use embassy_time::{Duration, Instant};
use flash::FlashFile;
use mishap::{MayWedge, may_happen};
use plant::{Clock, PlantMatrix};
use plantar::Side;
use plantar::app::{self, DeviceInsole, Frame, ScanCounters, Session, Stopwatch, Ticker};
use plantar::ble::{self, HciPipe, OverBluetooth};
use plantar::device::{self, Start};
use plantar::emulation::{Head, Mishap};
use plantar::insole::Insole;
use plantar::store::{Part, Store};
use plantar::update::Header;
use plantar::watch::LOOK_MS;
use plantar::wire::Reset;
use port::{End, Port};
use radio::{Emulated, pump};
use static_cell::{ConstStaticCell, StaticCell};
use stm32_metapac::{Interrupt, USART1, USART2, USART3, interrupt};
use time::{RELOAD, Time};

embassy_time_driver::time_driver_impl!(static TIME: Time = Time::new());

/// What this image is, where the host and the insole before it look.
#[used]
#[unsafe(link_section = ".header")]
static IMAGE: Header = Header::new("emulated", env!("CARGO_PKG_VERSION"));

static LINK: Port = Port::new(USART1);
static HCI: Port = Port::new(USART2);
static FROM_RADIO: HciPipe = HciPipe::new();
static TO_RADIO: HciPipe = HciPipe::new();
static PLANT: Port = Port::new(USART3);
static SCAN_EXECUTOR: InterruptExecutor = InterruptExecutor::new();
static SCAN_COUNTERS: ScanCounters = ScanCounters::new();
static INSOLE: ConstStaticCell<DeviceInsole> = ConstStaticCell::new(Insole::new());
/// At 400 Hz they last 20 ms, more than a step's evaluation takes.
static FRAMES: ConstStaticCell<[Frame; 8]> = ConstStaticCell::new([Frame::EMPTY; 8]);

type FrameSender = Sender<'static, CriticalSectionRawMutex, Frame>;
type FrameReceiver = Receiver<'static, CriticalSectionRawMutex, Frame>;

/// What may go wrong in processing.
const PROCESSING: [Mishap; 4] = [Mishap::ModelWedged, Mishap::StackOverflow, Mishap::Fault, Mishap::Panic];

/// Measures with SysTick itself, so less than a millisecond.
struct SysTick;

impl Stopwatch for SysTick {
    fn start(&self) -> u32 {
        may_happen(&PROCESSING);
        SYST::get_current()
    }

    fn cycles_since(&self, start: u32) -> u32 {
        let now = SYST::get_current();
        if now <= start { start - now } else { start + RELOAD + 1 - now }
    }
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let start = Start::take(None);
    // As it lies in the flash, not as the compiler knows it.
    let image = black_box(&IMAGE);
    // SAFETY: `main` runs once and nothing else takes the core's peripherals.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    TIME.start(&mut core.SYST);
    LINK.start();
    HCI.start();
    PLANT.start();
    // Scanning above everything but the timer and the ports that feed it.
    for (interrupt, priority) in
        [(Interrupt::USART1, 0x40), (Interrupt::USART2, 0x40), (Interrupt::USART3, 0x40), (Interrupt::TIM2, 0x80)]
    {
        // SAFETY: no critical section of this program works by priority.
        unsafe { core.NVIC.set_priority(interrupt, priority) };
    }
    // SAFETY: what the handlers use is set up above.
    unsafe {
        NVIC::unmask(Interrupt::USART1);
        NVIC::unmask(Interrupt::USART2);
        NVIC::unmask(Interrupt::USART3);
    }

    let set_up = plant::set_up().filter(|_| !start.is_fallback);
    let mut head = set_up.as_ref().map_or_else(|| Head::new(layout::setup(Side::Left)), |(head, _)| *head);
    mishap::plan(head.mishap.filter(|planned| planned.is_repeated || start.reset == Reset::Power));
    may_happen(&[Mishap::Panic]);
    // Nothing else runs yet, so what is awaited lies on the stack, and not in a static of this task.
    static STORE: StaticCell<Store<FlashFile>> = StaticCell::new();
    let chip = (!start.is_fallback).then(|| FlashFile::open(head.power_cut));
    let store = STORE.init(block_on(Store::open(chip, start.reset)));
    let name = block_on(app::name(store, head.setup.side));
    head.setup.side = name.side;
    let insole = INSOLE.take();
    insole.count_steps_from(store.contents().next_step);
    let refused = if let Some((_, cells)) = &set_up {
        insole.set_up(head.setup, cells.clone()).err().map(device::cut)
    } else {
        // A test sees that it is accepted.
        let _ = insole.set_up(head.setup, layout::cells());
        "no whole setup.bin: the built-in insole".try_into().ok()
    };
    let recalibrate = |insole: &mut DeviceInsole, first, part: &Part| match &set_up {
        Some((_, cells)) => insole.recalibrate(cells.clone(), first, part),
        None => insole.recalibrate(layout::cells(), first, part),
    };
    let calibration_id = block_on(app::calibrate(store, insole, recalibrate));
    let hello = app::hello(image, &head.setup, insole, start.reset, start.fault.or(refused));
    let matrix = PlantMatrix::open(&PLANT, insole.cells());
    let clock = if head.paced {
        Clock::Plant { port: &PLANT, ticks: 0, first: head.first_scan }
    } else {
        Clock::Ticker(Ticker::new(head.setup.period_us))
    };

    static CHANNEL: StaticCell<Channel<'static, CriticalSectionRawMutex, Frame>> = StaticCell::new();
    static SESSION: StaticCell<Session> = StaticCell::new();
    static OVER_BLUETOOTH: StaticCell<OverBluetooth<'static, Emulated>> = StaticCell::new();
    let (sender, receiver) = CHANNEL.init(Channel::new(FRAMES.take())).split();
    let session = SESSION.init(Session::new(hello, &SCAN_COUNTERS, device::stack_bytes));
    block_on(session.restore(store, name, calibration_id));

    // Each task has a place of its own and is spawned once, so spawning cannot fail.
    SCAN_EXECUTOR.start(Interrupt::TIM2).spawn(scan(clock, matrix, sender).unwrap());
    spawner.spawn(process(insole, receiver, session).unwrap());
    spawner.spawn(serve(session).unwrap());
    spawner.spawn(keep(store, session, image).unwrap());
    let board = Emulated { address: head.address, bonding: Duration::from_secs(head.bonding_s.into()) };
    let insole = OVER_BLUETOOTH.init(OverBluetooth::new(session, board));
    spawner.spawn(ble::run(&FROM_RADIO, &TO_RADIO, insole).unwrap());
    spawner.spawn(pump_radio().unwrap());
}

#[embassy_executor::task]
async fn scan(clock: Clock, matrix: PlantMatrix, frames: FrameSender) {
    app::scan(clock, matrix, frames, &SCAN_COUNTERS).await
}

#[embassy_executor::task]
async fn process(insole: &'static mut DeviceInsole, frames: FrameReceiver, session: &'static Session) {
    app::process(insole, frames, session, SysTick).await
}

#[embassy_executor::task]
async fn serve(session: &'static Session) {
    app::serve(MayWedge(End(&LINK)), End(&LINK), session).await
}

#[embassy_executor::task]
async fn keep(store: &'static mut Store<FlashFile>, session: &'static Session, image: &'static Header) {
    app::keep(store, session, image, cortex_m::peripheral::SCB::sys_reset).await
}

#[embassy_executor::task]
async fn pump_radio() {
    join(pump(End(&HCI), &FROM_RADIO), pump(&TO_RADIO, End(&HCI))).await;
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

/// Nobody's timer here: its interrupt runs the scan executor.
#[interrupt]
unsafe fn TIM2() {
    // SAFETY: the executor was started before this interrupt was unmasked.
    unsafe { SCAN_EXECUTOR.on_interrupt() }
}

plantar::on_systick!(tick);

/// Once a millisecond, or less often on a busy host.
extern "C" fn tick(frame: u32) {
    static NEXT_LOOK_MS: AtomicU32 = AtomicU32::new(LOOK_MS);
    TIME.on_interrupt();
    // 32 bits of milliseconds are seven weeks.
    let now_ms = Instant::now().as_millis() as u32;
    let next_ms = NEXT_LOOK_MS.load(Ordering::Relaxed);
    if now_ms.wrapping_sub(next_ms) <= u32::MAX / 2 {
        NEXT_LOOK_MS.store(now_ms.wrapping_add(LOOK_MS), Ordering::Relaxed);
        device::look(frame, &SCAN_COUNTERS.life);
    }
}

//! A simulated insole: the firmware's tasks on a host board, with its restarts after resets and losses of power.

use crate::board::{
    Cable, CableEnd, HostBluetooth, HostMatrix, NoStopwatch, RadioLink, Reference, SharedChip, crash_text, run_gatt,
};
use crate::executor::{Executor, ResetCause, reset};
use crate::nor_flash::{NorFlashChip, Torn};
use crate::virtual_time::{now_us, with_origin};
use crate::walk::{Codes, Wearer};
use embassy_sync::mutex::Mutex;
use embassy_time::Timer;
use emulation::{ACTIVE_IMAGE, FLASH_BYTES};
use firmware_image::Image;
use plantar::firmware::ble::GattSession;
use plantar::firmware::board::{Gauges, Ticker};
use plantar::firmware::boot_report::{BootReport, Failures, is_started_by_user};
use plantar::firmware::scan::ScanCounters;
use plantar::firmware::start::{Configuration, Memory, Started, start};
use plantar::firmware::supervise::{CHECK_PERIOD_MS, Watchdog};
use plantar::firmware::{persist, process, scan, serve};
use plantar::protocol::update::{CHUNK, Header};
use plantar::protocol::{Reset, Settings};
use plantar::storage::boot::{Blocking, swap_if_due};
use plantar::storage::flash_map::{HEADER, HEADER_BYTES, SMALL_LOG, STATE};
use plantar::storage::partition::Partition;
use serde::Deserialize;
use std::cell::RefCell;
use std::rc::Rc;

/// Number of frames in the queue between scan and processing, as on the reference board.
const FRAMES: usize = 3;
/// Duration from a reset to the start of the firmware, us.
const RESET_US: u64 = 20_000;

/// Name of the board in images.
pub const BOARD: &str = "host";
/// Version of the image that runs at first.
pub const INITIAL_VERSION: &str = env!("CARGO_PKG_VERSION");
/// Length of the images, bytes.
const IMAGE_BYTES: usize = 40 * CHUNK;
/// Time from the start to the panic of an image with [`Defect::Crash`], s.
const CRASH_S: u64 = 20;

/// A defect of an image; the byte after the space that is reserved for the header of an image states it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Defect {
    /// The image works.
    #[default]
    None,
    /// Processing of frames stalls from the start on.
    Process,
    /// The radio does not answer.
    Radio,
    /// The flash chip does not store what the firmware writes to its records and its log.
    Storage,
    /// The firmware panics 20 s after each start.
    Crash,
}

impl Defect {
    const ALL: [Self; 5] = [Self::None, Self::Process, Self::Radio, Self::Storage, Self::Crash];
}

/// A signed image for the host board.
///
/// # Panics
/// If the version is longer than 16 bytes.
pub fn image(version: &str, defect: Defect) -> Image {
    let mut bytes = vec![0xa5; IMAGE_BYTES];
    let header = Header::new(BOARD, version).bytes();
    bytes[HEADER as usize..][..header.len()].copy_from_slice(&header);
    bytes[(HEADER + HEADER_BYTES) as usize] = defect as u8;
    let secret = firmware_image::development_key().expect("the development key is valid");
    Image::sign(bytes, &secret).expect("the image has a header")
}

/// One boot of an insole.
pub struct Boot {
    /// The reset reason that the insole reports.
    pub reset: Reset,
    /// The results of the pipeline for the frames that this boot scanned.
    pub reference: Rc<RefCell<Reference>>,
    /// Version of the firmware.
    pub version: String,
    /// Time at which a loss of power, a crash or a stalled task ended the boot, us: its last records may be lost.
    pub cut_us: Option<u64>,
    /// Time of the start of the firmware, us.
    pub from_us: u64,
}

/// An insole with its wearer and its links.
pub struct HostInsole {
    /// The wearer.
    pub wearer: Rc<RefCell<Wearer>>,
    /// The flash chip.
    pub chip: SharedChip,
    /// The serial cable.
    pub cable: Rc<RefCell<Cable>>,
    /// The radio link.
    pub radio: Rc<RefCell<RadioLink>>,
    /// All boots so far.
    pub boots: Vec<Boot>,
    /// The settings that the insole has accepted from a host. They are in force from its next start on.
    pub settings: Option<Settings>,
    /// The flash chip does not answer from the next start on.
    pub is_chip_silent: bool,
    /// The first read of the bootloader's state fails in each start of the firmware.
    pub fails_state_read: bool,
    executor: Option<Executor>,
    /// The record of failures that the present run has made at its start.
    failures: Failures,
    /// The next start while the insole is off: its time in us, the reset reason that the insole will report, and the cause of
    /// the reset, which is `None` after a loss of power. `None` while the insole is on.
    restart: Option<(u64, Reset, Option<ResetCause>)>,
}

impl HostInsole {
    /// A new insole that is switched on now. Its flash chip contains only the firmware.
    pub fn new(codes: Rc<Codes>) -> Self {
        let mut chip = NorFlashChip::new(FLASH_BYTES);
        let active = image(INITIAL_VERSION, Defect::None);
        chip.bytes[ACTIVE_IMAGE.start as usize..][..active.bytes().len()].copy_from_slice(active.bytes());
        Self {
            wearer: Rc::new(RefCell::new(Wearer::new(codes))),
            chip: SharedChip(Rc::new(RefCell::new(chip))),
            cable: Rc::default(),
            radio: Rc::default(),
            boots: Vec::new(),
            settings: None,
            is_chip_silent: false,
            fails_state_read: false,
            executor: None,
            failures: Failures::default(),
            restart: Some((now_us(), Reset::Power, None)),
        }
    }

    /// True while the firmware runs.
    pub fn is_on(&self) -> bool {
        self.executor.is_some()
    }

    /// Time of the next start while the insole is off, us.
    pub fn starts_at_us(&self) -> Option<u64> {
        self.restart.map(|(at_us, ..)| at_us)
    }

    /// Removes power for `off_us`.
    pub fn cut_power(&mut self, off_us: u64) {
        self.end(true);
        self.restart = Some((now_us() + off_us, Reset::Power, None));
    }

    /// Schedules a loss of power within a write or erase operation of the flash chip, after `operations` complete ones from now
    /// on.
    pub fn cut_power_in_operation(&mut self, operations: u64) {
        let mut chip = self.chip.0.borrow_mut();
        let at = chip.operations + operations;
        chip.cut = Some((at, Torn::Within));
    }

    /// Stalls the task `scan`, `process` (which processes frames), `link` or `radio` (Bluetooth), as an endless loop in that task
    /// would.
    pub fn stall(&mut self, part: &str) {
        self.executor.iter_mut().for_each(|executor| executor.stall(part));
    }

    /// Resets the insole as after a panic.
    pub fn crash(&mut self) {
        if self.is_on() {
            self.reset(ResetCause::Panic);
        }
    }

    /// Ends the running boot: the radio link is lost, and so are the bytes that are in transit on the cable to the host.
    fn end(&mut self, is_cut_short: bool) {
        self.executor = None;
        let mut radio = self.radio.borrow_mut();
        radio.server = None;
        radio.set_connected(false);
        let mut cable = self.cable.borrow_mut();
        cable.to_host.clear();
        if let Some(boot) = self.boots.last_mut() {
            boot.cut_us = boot.cut_us.or(is_cut_short.then(now_us));
        }
    }

    /// Ends the running boot, and schedules the next one.
    fn reset(&mut self, cause: ResetCause) {
        self.end(cause != ResetCause::Software);
        let reason = match cause {
            ResetCause::Software => Reset::Software,
            ResetCause::Watchdog(_) => Reset::Watchdog,
            ResetCause::Panic => Reset::Panic,
        };
        self.restart = Some((now_us() + RESET_US, reason, Some(cause)));
    }

    /// Boots the insole if its start is due, and runs its woken tasks; returns true if a task ran.
    pub fn run(&mut self) -> bool {
        if let Some((at_us, reason, cause)) = self.restart
            && at_us <= now_us()
        {
            self.restart = None;
            self.boot(reason, cause);
        }
        let Some(executor) = &mut self.executor else { return false };
        let chip = self.chip.clone();
        let has_run = executor.run_woken(|| chip.0.borrow().is_off());
        if self.chip.0.borrow().is_off() {
            // Without power, a restart that the firmware requested does not happen. Power returns after a second.
            let chip = self.chip.0.borrow().restarted();
            self.chip.0.replace(chip);
            self.cut_power(1_000_000);
            return true;
        }
        has_run.unwrap_or_else(|cause| {
            self.reset(cause);
            true
        })
    }

    /// Runs the bootloader and starts the firmware.
    fn boot(&mut self, reason: Reset, cause: Option<ResetCause>) {
        let run_us = self.boots.last().map_or(0, |boot| now_us() - boot.from_us);
        let checks = (run_us / 1_000) as u32 / CHECK_PERIOD_MS;
        let recorded =
            (1..=checks).fold(self.failures, |recorded, check| recorded.recorded_after(check).unwrap_or(recorded));
        let failures = recorded.at_next_start(reason, cause.map_or(0, ResetCause::stalled));
        self.failures = failures.recorded();
        {
            let mut chip = self.chip.0.borrow_mut();
            let chip = Mutex::new(&mut *chip);
            let active = Blocking(Partition::<_, CHUNK>::new(&chip, ACTIVE_IMAGE));
            // A chip that fails here fails again in the firmware.
            let _ = swap_if_due(&chip, active);
        }
        let (header, content, defect) = {
            let chip = self.chip.0.borrow();
            let active = &chip.bytes[ACTIVE_IMAGE.start as usize..ACTIVE_IMAGE.end as usize];
            let header = active[HEADER as usize..].first_chunk().and_then(Header::read);
            let defect = Defect::ALL[usize::from(active[(HEADER + HEADER_BYTES) as usize])];
            (header.expect("the active image has a header"), active[..IMAGE_BYTES].to_vec(), defect)
        };
        // In recovery mode, the insole has no settings.
        let settings = self.settings.filter(|_| !failures.lead_to_recovery());
        let reference = Rc::new(RefCell::new(Reference::new(&self.wearer.borrow(), settings)));
        let from_us = now_us();
        let version = header.version().to_owned();
        self.boots.push(Boot { reset: reason, reference: reference.clone(), version, cut_us: None, from_us });
        let resources = BootResources {
            chip: self.chip.clone(),
            is_chip_silent: self.is_chip_silent,
            report: BootReport {
                reset: reason,
                fault: cause.and_then(|cause| crash_text(cause, failures)),
                failures,
                // The simulated supply fails for so long that the RAM loses its contents.
                is_started_by_user: is_started_by_user(reason, reason != Reset::Power),
            },
            image: Box::leak(Box::new(header)),
            content: content.leak(),
            matrix: HostMatrix { wearer: self.wearer.clone(), reference },
            cable: self.cable.clone(),
            radio: self.radio.clone(),
        };
        self.chip.0.borrow_mut().forgets_writes_below = None;
        self.chip.0.borrow_mut().failing_read_at = self.fails_state_read.then_some(STATE.start);
        let mut executor = Executor::new(from_us);
        resources.spawn(&mut executor, from_us);
        match defect {
            Defect::None => {}
            Defect::Process => executor.stall("process"),
            Defect::Radio => executor.stall("radio"),
            Defect::Storage => self.chip.0.borrow_mut().forgets_writes_below = Some(SMALL_LOG.end),
            Defect::Crash => executor.spawn("crash", async {
                Timer::after_secs(CRASH_S).await;
                reset(ResetCause::Panic)
            }),
        }
        self.executor = Some(executor);
    }
}

/// The resources of one boot.
struct BootResources {
    chip: SharedChip,
    /// The chip never answers.
    is_chip_silent: bool,
    report: BootReport,
    image: &'static Header,
    content: &'static [u8],
    matrix: HostMatrix,
    cable: Rc<RefCell<Cable>>,
    radio: Rc<RefCell<RadioLink>>,
}

/// A value that the task `start` passes to one of the firmware's loops; `None` until it is available.
type Slot<T> = Rc<RefCell<Option<T>>>;

/// An empty slot.
fn slot<T>() -> Slot<T> {
    Rc::default()
}

/// Waits until a slot is filled.
async fn take<T>(slot: Slot<T>) -> T {
    loop {
        if let Some(value) = slot.borrow_mut().take() {
            return value;
        }
        Timer::after_millis(1).await;
    }
}

impl BootResources {
    /// Spawns the task `start` and the firmware's loops, each of which waits for its values from `start`. The static memory of a
    /// boot is leaked, because a test has few boots.
    fn spawn(self, executor: &mut Executor, from_us: u64) {
        let Self { chip, is_chip_silent, report, image, content, matrix, cable, radio } = self;
        let counters: &'static ScanCounters = Box::leak(Box::new(ScanCounters::new()));
        let memory: &'static Memory<SharedChip, FRAMES> = Box::leak(Box::new(Memory::new()));
        let (setup, cells) = (matrix.wearer.borrow().setup(), matrix.wearer.borrow().cells());
        let slots = (slot(), slot(), slot(), slot(), slot());
        let (for_scan, for_process, for_serve, for_persist, for_gatt) = slots.clone();
        executor.spawn("start", async move {
            let restart = || reset(ResetCause::Software);
            let configuration = Configuration { setup, cells, serial_bytes_per_s: 46_080, fault: None, restart };
            let chip = async {
                if is_chip_silent {
                    std::future::pending::<()>().await;
                }
                Some(chip)
            };
            let gauges = Gauges { stack_bytes: || 0, supply_mv: || None };
            let started = start(memory, chip, &report, image, &configuration, counters, gauges).await;
            let Started { insole, store, shared, to_process, scanned, period_us, radio_delay } = started;
            for_scan.replace(Some((Ticker::new(period_us), to_process)));
            for_process.replace(Some((insole, scanned, shared)));
            for_serve.replace(Some(shared));
            for_persist.replace(Some((store, shared)));
            for_gatt.replace(Some((shared, radio_delay)));
        });
        let (for_scan, for_process, for_serve, for_persist, for_gatt) = slots;
        executor.spawn("scan", async move {
            let (clock, to_process) = take(for_scan).await;
            scan::scan(clock, matrix, to_process, counters).await
        });
        executor.spawn("process", async move {
            let (insole, scanned, shared) = take(for_process).await;
            process::process(insole, scanned, shared, NoStopwatch).await
        });
        let end = CableEnd(cable);
        executor.spawn("link", async move {
            let shared = take(for_serve).await;
            serve::serve(end.clone(), end, shared).await
        });
        executor.spawn("persist", async move {
            let (store, shared) = take(for_persist).await;
            persist::persist(store, shared, image, content, || reset(ResetCause::Software)).await
        });
        executor.spawn("radio", async move {
            let (shared, radio_delay) = take(for_gatt).await;
            Timer::after(radio_delay).await;
            let server = with_origin(from_us, || Rc::new(GattSession::new(shared, HostBluetooth)));
            {
                let mut radio = radio.borrow_mut();
                radio.server = Some(server.clone());
                radio.origin_us = from_us;
            }
            run_gatt(server, radio).await
        });
        executor.spawn("supervision", async move {
            let mut watchdog = Watchdog::new();
            loop {
                Timer::after_millis(CHECK_PERIOD_MS.into()).await;
                let stalled = watchdog.check(&counters.heartbeats);
                if stalled != 0 {
                    reset(ResetCause::Watchdog(stalled));
                }
            }
        });
    }
}

//! The start that every board shares: it creates the state of the loops from a flash chip and a configuration.

use super::DeviceInsole;
use super::board::Gauges;
use super::boot_report::{BootReport, MAX_FAILED_STARTS, MAX_RADIO_STALLS, RADIO_DELAY};
use super::scan::{Frame, ScanCounters};
use super::shared::{Exchange, Shared};
use super::trial::is_on_trial;
use crate::insole::Insole;
use crate::log;
use crate::pipeline::alert::AlertRules;
use crate::pipeline::setup::{DEVICE_CELLS, Setup, SetupCell, SetupError};
use crate::pipeline::tissue::Tissue;
use crate::protocol::session::Session;
use crate::protocol::update::Header;
use crate::protocol::{BLOCK_CELLS, Hello, MAJOR, MAX_FAULT_TEXT, MINOR, Reset, Serial, Settings};
use crate::storage::{IdentityRecord, SettingsRecord, Store, previous};
use core::cell::RefCell;
use core::fmt::{Display, Write};
use core::pin::pin;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::zerocopy_channel::{Channel, Receiver, Sender};
use embassy_time::{Duration, with_timeout};
use embedded_storage_async::nor_flash::MultiwriteNorFlash;
use heapless::{String, Vec};
use static_cell::{ConstStaticCell, StaticCell};

/// A board's configuration: that of its insole, and what the start must know of the board.
pub struct Configuration<C> {
    /// The configuration of the insole, except its cells. Stored settings change it, and the foot of a stored identity replaces
    /// [`Setup::side`].
    pub setup: Setup,
    /// The cells.
    pub cells: C,
    /// Bytes per second of the serial port.
    pub serial_bytes_per_s: u32,
    /// A fault of the board that the hello is to report, such as a crystal that does not oscillate; `None` without one.
    pub fault: Option<String<MAX_FAULT_TEXT>>,
    /// Restarts the board.
    pub restart: fn() -> !,
}

/// The static memory of the loops. `FRAMES` is the length of the frame queue: the evaluation of a step may take as many frame
/// times.
pub struct Memory<F, const FRAMES: usize> {
    insole: ConstStaticCell<DeviceInsole>,
    cells: ConstStaticCell<Vec<SetupCell, DEVICE_CELLS>>,
    frames: ConstStaticCell<[Frame; FRAMES]>,
    channel: StaticCell<Channel<'static, CriticalSectionRawMutex, Frame>>,
    store: StaticCell<Store<F>>,
    shared: StaticCell<Shared>,
    exchange: StaticCell<RefCell<Exchange>>,
    session: StaticCell<RefCell<Session>>,
}

impl<F, const FRAMES: usize> Memory<F, FRAMES> {
    /// Unused memory. All of its bytes are zero, so that it occupies no flash.
    pub const fn new() -> Self {
        Self {
            insole: ConstStaticCell::new(Insole::new()),
            cells: ConstStaticCell::new(Vec::new()),
            frames: ConstStaticCell::new([Frame::EMPTY; FRAMES]),
            channel: StaticCell::new(),
            store: StaticCell::new(),
            shared: StaticCell::new(),
            exchange: StaticCell::new(),
            session: StaticCell::new(),
        }
    }
}

impl<F, const FRAMES: usize> Default for Memory<F, FRAMES> {
    fn default() -> Self {
        Self::new()
    }
}

/// The parts that the loops use.
pub struct Started<F: 'static> {
    /// For [`super::process::process`].
    pub insole: &'static mut DeviceInsole,
    /// For [`super::persist::persist`].
    pub store: &'static mut Store<F>,
    /// For all loops but the scan.
    pub shared: &'static Shared,
    /// For [`super::scan::scan`].
    pub to_process: Sender<'static, CriticalSectionRawMutex, Frame>,
    /// For [`super::process::process`].
    pub scanned: Receiver<'static, CriticalSectionRawMutex, Frame>,
    /// Time between frames, us.
    pub period_us: u32,
    /// Time from the start after which the board is to start its radio: zero or, if the radio has stalled repeatedly, an hour.
    /// An image on trial has not stalled yet, and must show that its radio works, so its radio starts at once.
    pub radio_delay: Duration,
}

/// Time within which the flash chip must answer.
const CHIP_TIMEOUT: Duration = Duration::from_secs(2);
/// Time within which the store must be opened. Erasing a chip with foreign contents may take that long; a chip of 16 MiB
/// needs a second start, which continues the erasure. This time is shorter than the one in which the supervision expects the
/// parts to start ([`super::supervise::START_CHECKS`]).
const STORE_TIMEOUT: Duration = Duration::from_secs(110);
/// The text of [`Hello::fault`] after a start without the chip, or with a chip that returns changing data.
const NO_CHIP: &str = "the flash chip does not answer reliably: nothing is stored, check chip and supply";
/// The text of [`Hello::fault`] if the store was not opened in [`STORE_TIMEOUT`].
const NO_STORE: &str = "the flash chip was not opened in 110 s: nothing is stored; restart, or replace the chip";
/// The text of [`Hello::fault`] if the stored settings cannot be used.
const OTHER_SETTINGS: &str = "the stored settings do not fit this board, which uses its own: send the settings again";
/// The text of [`Hello::fault`] if the stored parameters cannot be used.
const OTHER_RULE: &str = "the parameters belong to another contact rule and are not used: identify or send them again";

/// Opens the store on the chip that `chip` returns (`None` if there is none that can be used), configures the insole, restores
/// the persisted state, and composes the hello. `image` is the header of the running image.
///
/// After [`MAX_FAILED_STARTS`] failed starts, or [`MAX_RADIO_STALLS`] stalls of the radio, the board restarts and the bootloader
/// swaps the previous image back, if an update had replaced that image and the new one has not run for an hour yet. Otherwise the
/// insole starts in recovery mode after the failed starts: it scans and communicates, stores nothing, and accepts updates. After
/// the stalls it starts as usual, and its radio later ([`Started::radio_delay`]).
///
/// To be awaited in a task of an Embassy executor: the start limits times, and the timers of `embassy-time` panic if another
/// executor, such as `embassy_futures::block_on`, has to wait for one.
///
/// # Panics
/// When called twice with the same memory.
pub fn start<F: MultiwriteNorFlash, const FRAMES: usize>(
    memory: &'static Memory<F, FRAMES>,
    chip: impl Future<Output = Option<F>>,
    boot: &BootReport,
    image: &Header,
    configuration: &Configuration<impl Iterator<Item = SetupCell> + Clone>,
    counters: &'static ScanCounters,
    gauges: Gauges,
) -> impl Future<Output = Started<F>> {
    // Initialising the session takes much stack in firmware compiled for size. Outside the future, this stack is not added to
    // that of the future.
    let session = init_session(&memory.session);
    start_with(memory, session, chip, boot, image, configuration, counters, gauges)
}

/// Does what [`start`] documents. `session` is the initialised session, which has no host yet.
#[expect(clippy::too_many_arguments, reason = "those of `start` and the session")]
async fn start_with<F: MultiwriteNorFlash, const FRAMES: usize>(
    memory: &'static Memory<F, FRAMES>,
    session: &'static RefCell<Session>,
    chip: impl Future<Output = Option<F>>,
    boot: &BootReport,
    image: &Header,
    configuration: &Configuration<impl Iterator<Item = SetupCell> + Clone>,
    counters: &'static ScanCounters,
    gauges: Gauges,
) -> Started<F> {
    log::info!("start: firmware {}, reset: {}", image.version(), boot.reset.name());
    if let Some(fault) = &boot.fault {
        log::error!("start: after a failure: {}", fault.as_str());
    }
    let &Configuration { mut setup, ref cells, serial_bytes_per_s, ref fault, restart } = configuration;
    // Whatever the chip does, the insole starts.
    let chip = with_timeout(CHIP_TIMEOUT, pin!(chip)).await.ok().flatten();
    let mut no_chip = chip.is_none().then_some(NO_CHIP);
    let store = memory.store.init_with(|| Store::new(chip));
    // Pinned, because each move of this future would take its size in stack.
    let is_open = with_timeout(STORE_TIMEOUT, pin!(open_store(store, boot, image, restart))).await.is_ok();
    if !is_open {
        store.give_up();
        no_chip = Some(NO_STORE);
    } else if no_chip.is_none() && !boot.is_recovery() && !store.is_in_full_use() {
        // Its surveys have contradicted each other.
        no_chip = Some(NO_CHIP);
    }
    let is_radio_delayed = boot.failures.is_radio_delayed()
        && match store.flash() {
            Some(flash) => !is_on_trial(flash).await,
            None => true,
        };
    let contents = store.contents();
    log::info!("storage: boot {}, next record {}", contents.start, contents.next_record);
    if contents.erased > 0 {
        log::error!("storage: {} of two areas, records and log, were damaged and are erased", contents.erased);
    }
    // Here and below, the type selects the record, and part 0 is the whole record ([`Store::get`]).
    let stored_identity = store.get(0).await.ok().flatten();
    let identity = stored_identity.unwrap_or(IdentityRecord { side: setup.side, serial: Serial::NONE });
    setup.side = identity.side;
    let stored = store.get(0).await.ok().flatten().and_then(|SettingsRecord(settings)| settings);
    let mut other_settings = stored.is_some_and(|settings| !settings.is_valid()).then_some(OTHER_SETTINGS);
    let stored = stored.filter(Settings::is_valid);
    let insole = memory.insole.take();
    insole.set_next_record_number(contents.next_record);
    let (mut settings, mut refused) = (None, None);
    // A loop, so that the firmware contains the code of this call only once.
    for attempt in [stored, None] {
        settings = attempt;
        refused = set_up(insole, &mut setup, cells, settings).err();
        match refused {
            Some(error) if settings.is_some() => {
                log::error!("settings: the stored ones do not fit this board: {}", truncated(error).as_str());
                other_settings = Some(OTHER_SETTINGS);
            }
            _ => break,
        }
    }
    let cells = cells.clone().map(|cell| scaled(cell, settings));
    let calibrated = memory.cells.take();
    if refused.is_none() {
        // `set_up` has accepted the cells, so there is room for all of them.
        calibrated.extend(cells.clone().take(DEVICE_CELLS));
    }
    let alert_rules = store.get(0).await.ok().flatten().filter(AlertRules::is_valid);
    if let Some(rules) = &alert_rules {
        insole.set_alert_rules(rules);
    }
    if let Ok(Some(earlier)) = store.get(0).await {
        insole.restore_day(&earlier);
    }
    let calibration_id = restore_calibration(store, insole, cells, calibrated).await;
    let (tissue, identified) = store.tissue().await.unwrap_or((Tissue::NONE, None));
    let is_of_rule = identified.is_none_or(|identified| identified.contact == setup.contact);
    let other_rule = (!is_of_rule).then_some(OTHER_RULE);
    log::info!("settings: layout {}, calibration {:x}", setup.layout_id, calibration_id);
    let mut hello = hello(
        image,
        &setup,
        insole,
        boot.reset,
        // If nothing is stored, the wearer must know this first. A failure that ended the previous run was written to the debug
        // output above.
        no_chip
            .filter(|_| !boot.is_recovery())
            .map(truncated)
            .or_else(|| boot.fault.clone().or_else(|| fault.clone()))
            .or(refused.map(truncated))
            .or_else(|| other_settings.or(other_rule).map(truncated)),
    );
    hello.layout_id = settings.map_or(setup.layout_id, |settings| settings.id(setup.layout_id));
    let (to_process, scanned) = memory.channel.init(Channel::new(memory.frames.take())).split();
    let exchange = init_exchange(&memory.exchange);
    let shared = init_shared(&memory.shared, hello, serial_bytes_per_s, counters, gauges, exchange, session);
    shared.restore(store, identity, calibration_id).await;
    {
        let mut session = shared.session.borrow_mut();
        if let Some(rules) = alert_rules {
            session.set_alert_rules(rules);
        }
        if is_of_rule {
            session.restore_tissue(tissue, identified);
        }
        if !calibrated.is_empty() {
            session.set_layout(setup, calibrated, settings);
        }
    }
    let radio_delay = if is_radio_delayed { RADIO_DELAY } else { Duration::from_ticks(0) };
    Started { insole, store, shared, to_process, scanned, period_us: setup.period_us, radio_delay }
}

/// Opens the store completely, unless the insole starts in recovery mode: then lets the store return the bonds only in the first
/// such start, and does nothing in the following ones. After repeated stalls of the radio, and before recovery mode, first swaps
/// the previous image back and restarts if possible.
async fn open_store<F: MultiwriteNorFlash>(
    store: &mut Store<F>,
    boot: &BootReport,
    image: &Header,
    restart: fn() -> !,
) {
    // If one of these accesses to the chip crashes in recovery mode, the next start does without them.
    let is_first_recovery = boot.failures.starts == MAX_FAILED_STARTS;
    let has_radio_stalled = boot.failures.radio_stalls == MAX_RADIO_STALLS && !boot.is_recovery();
    if (is_first_recovery || has_radio_stalled)
        && let Some(flash) = store.flash()
        && previous::swap_back(flash, image).await == Ok(true)
    {
        log::error!("update: this image fails, restarting to swap back the previous one");
        restart();
    }
    if !boot.is_recovery() {
        return store.begin(boot.reset).await;
    }
    log::error!("start: {} starts have failed: recovery mode", boot.failures.starts);
    if is_first_recovery {
        store.use_bonds();
    }
}

/// Initialises the exchange with management tools, in a function of its own, like [`init_shared`].
#[inline(never)]
fn init_exchange(memory: &'static StaticCell<RefCell<Exchange>>) -> &'static RefCell<Exchange> {
    memory.init(RefCell::new(Exchange::Idle))
}

/// Initialises the session, in a function of its own, like [`init_shared`].
#[inline(never)]
fn init_session(memory: &'static StaticCell<RefCell<Session>>) -> &'static RefCell<Session> {
    memory.init_with(|| RefCell::new(Session::new()))
}

/// Initialises the shared state, in a function of its own: the stack that its move needs is not reserved while the chip is read.
#[inline(never)]
fn init_shared(
    memory: &'static StaticCell<Shared>,
    hello: Hello,
    serial_bytes_per_s: u32,
    counters: &'static ScanCounters,
    gauges: Gauges,
    exchange: &'static RefCell<Exchange>,
    session: &'static RefCell<Session>,
) -> &'static Shared {
    // With a closure, because most of the state is then composed in `memory`, not on the stack.
    memory.init_with(|| Shared::new(hello, serial_bytes_per_s, counters, gauges, exchange, session))
}

/// Configures the insole, by the stored settings if there are any, and changes `setup` accordingly.
///
/// # Errors
/// If the configuration is invalid; nothing is changed.
#[inline(never)]
fn set_up(
    insole: &mut DeviceInsole,
    setup: &mut Setup,
    cells: &(impl Iterator<Item = SetupCell> + Clone),
    settings: Option<Settings>,
) -> Result<(), SetupError> {
    let configured = settings.map_or(*setup, |settings| settings.apply_to(*setup));
    insole.set_up(configured, cells.clone().map(|cell| scaled(cell, settings)))?;
    *setup = configured;
    Ok(())
}

/// A cell of the board's layout, scaled as the settings require.
fn scaled(cell: SetupCell, settings: Option<Settings>) -> SetupCell {
    settings.map_or(cell, |settings| settings.scaled(cell))
}

/// The hello of a board that runs `image`. `fault` is the text of [`Hello::fault`].
fn hello(
    image: &Header,
    setup: &Setup,
    insole: &DeviceInsole,
    reset: Reset,
    fault: Option<String<MAX_FAULT_TEXT>>,
) -> Hello {
    Hello {
        major: MAJOR,
        minor: MINOR,
        // A header has room for 16 bytes of each, as the hello has, so the conversions cannot fail.
        firmware: image.version().try_into().unwrap_or_default(),
        board: image.board().try_into().unwrap_or_default(),
        side: setup.side,
        layout_id: setup.layout_id,
        cells: insole.cells() as u16,
        period_us: setup.period_us,
        // The session replaces it by the identifier of the parameters in force.
        tissue_id: 0,
        contact_rule: setup.contact,
        reset,
        fault,
    }
}

/// Applies the stored calibration to the insole and to the copy of its cells. Returns its identifier; 0 without a valid one.
async fn restore_calibration(
    store: &mut Store<impl MultiwriteNorFlash>,
    insole: &mut DeviceInsole,
    cells: impl Iterator<Item = SetupCell> + Clone,
    calibrated: &mut [SetupCell],
) -> u32 {
    let layout_id = insole.setup().map_or(0, |setup| setup.layout_id);
    let stored = store.calibration(layout_id, insole.cells() as u16).await;
    let Some(calibration) = stored.ok().flatten() else { return 0 };
    for first in (0..insole.cells()).step_by(BLOCK_CELLS) {
        // `Store::calibration` has just read all blocks, so reading one fails only if the chip has failed since.
        let block = store.calibration_block(&calibration, (first / BLOCK_CELLS) as u8).await;
        let Ok(Some(block)) = block else { return 0 };
        insole.recalibrate(cells.clone(), first, &block);
        let valid = calibrated.iter_mut().skip(first).zip(block).filter(|(_, new)| new.is_valid());
        valid.for_each(|(cell, calibration)| *cell = cell.calibrated(calibration));
    }
    calibration.id
}

/// A text for the hello; truncated if it is too long.
pub fn truncated(text: impl Display) -> String<MAX_FAULT_TEXT> {
    struct Truncated(String<MAX_FAULT_TEXT>);

    impl Write for Truncated {
        fn write_str(&mut self, text: &str) -> core::fmt::Result {
            text.chars().try_for_each(|character| self.0.push(character)).map_err(|_| core::fmt::Error)
        }
    }

    let mut truncated = Truncated(String::new());
    // An error here is the truncation.
    let _ = write!(truncated, "{text}");
    truncated.0
}

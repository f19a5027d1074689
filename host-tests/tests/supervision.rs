//! Supervision: stalls, panics and hard faults are detected, reported and followed by a restart within a short time. Some tests
//! run the real firmware in QEMU, from the file in `PLANTAR_FIRMWARE`; the others test only the watchdog's logic, and what the
//! status reports of the radio.

use crate::common::{firmware, synthetic_walk};
use addr2line::Loader;
use client::{Carrier, Framed};
use emulation::{EmulatorConfig, InjectedFault, PlannedFault};
use emulator::{Board, Link, Looped, Recorded, Scan, Time, Walk};
use plantar::firmware::board::Gauges;
use plantar::firmware::scan::ScanCounters;
use plantar::firmware::shared::{Carrier as SharedCarrier, Exchange, Shared};
use plantar::firmware::supervise::{
    CHECK_PERIOD_MS, HEALTHY_CHECKS, Heartbeats, MOST_CHECKS, Part, STALLED_CHECKS, START_CHECKS, Watchdog,
};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::session::Session;
use plantar::protocol::{Hello, MAJOR, MAX_MESSAGE, MINOR, Radio, Reset, Status, ToDevice, ToHost, decode};
use recording::VirtualInsole;
use std::cell::RefCell;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Time within which the insole must run again after a fault, s.
const MAX_RECOVERY_S: f64 = 2.0;
/// Longest duration of a test. A machine that needs more time is too busy for the test.
const TIMEOUT: Duration = Duration::from_secs(120);
/// Time without a live frame after which the host connects again, and the longest wait for a message.
const SILENCE: Duration = Duration::from_millis(50);

/// A matrix that never answers.
struct NoAnswer;

impl Walk for NoAnswer {
    fn scans(&self) -> u32 {
        u32::MAX
    }

    fn scan(&mut self, _: u32, _: &mut [u16]) -> Scan {
        Scan::Rows(0)
    }
}

/// A board and the link to it.
struct ConnectedBoard {
    _board: Board,
    link: Framed<Link>,
    firmware: PathBuf,
    /// Start of the test.
    began: Instant,
}

impl ConnectedBoard {
    /// Starts a board in real time with a walk that never ends, and injects a fault.
    fn start(fault: Option<PlannedFault>) -> Self {
        Self::start_with(|config| EmulatorConfig { fault, ..config }, Time::Real, None::<NoAnswer>)
    }

    /// Starts a board with a changed configuration. Without `walk`, the wearer walks without end.
    fn start_with(change: impl Fn(EmulatorConfig) -> EmulatorConfig, time: Time, walk: Option<impl Walk>) -> Self {
        let firmware = firmware();
        let recording = synthetic_walk(3, 100.0);
        let virtual_insole = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
        let config = change(EmulatorConfig::new(virtual_insole.setup));
        let cells = virtual_insole.cells.clone();
        let board = match walk {
            Some(walk) => Board::start(&firmware, &config, &cells, time, walk),
            None => Board::start(&firmware, &config, &cells, time, Looped(Recorded::new(recording, virtual_insole))),
        };
        Self::connect(board.expect("the board boots"), firmware)
    }

    fn connect(board: Board, firmware: PathBuf) -> Self {
        let mut link = board.link().expect("the board has a link");
        link.set_read_timeout(Some(SILENCE)).expect("a timeout");
        Self { _board: board, link: Framed::new(link), firmware, began: Instant::now() }
    }

    fn send(&mut self, message: ToDevice) {
        self.link.send(message).expect("the link works");
    }

    /// Receives a message or waits a short time.
    fn receive(&mut self) -> Option<ToHost> {
        assert!(self.began.elapsed() < TIMEOUT, "the board does not run, or the machine is too busy");
        self.link.receive().expect("the link works")
    }

    /// Requests live frames, and connects again whenever the board sends none, until a hello meets the condition.
    fn hello(&mut self, is_expected: impl Fn(&Hello) -> bool) -> Hello {
        let (found, _) = self.hello_and_last_live(is_expected);
        found
    }

    /// The same as [`Self::hello`]; also returns the time of the last live frame before the hello.
    fn hello_and_last_live(&mut self, is_expected: impl Fn(&Hello) -> bool) -> (Hello, Instant) {
        let mut last_live = Instant::now();
        let mut requested = None;
        loop {
            if last_live.max(requested.unwrap_or(last_live)).elapsed() > SILENCE {
                requested = Some(Instant::now());
                self.send(ToDevice::Connect { major: MAJOR, minor: MINOR });
            }
            match self.receive() {
                Some(ToHost::Live(_)) => last_live = Instant::now(),
                Some(ToHost::Hello(hello)) => {
                    self.send(ToDevice::Stream { live: true });
                    if is_expected(&hello) {
                        return (hello, last_live);
                    }
                }
                _ => {}
            }
        }
    }

    /// Waits for a live frame.
    fn wait_for_live_frame(&mut self) {
        while !matches!(self.receive(), Some(ToHost::Live(_))) {}
    }

    fn status(&mut self) -> Status {
        self.send(ToDevice::GetStatus);
        loop {
            if let Some(ToHost::Status(status)) = self.receive() {
                return status;
            }
        }
    }

    /// The functions that contain the addresses in a fault report, innermost first, including inlined ones.
    fn functions(&self, report: &str) -> Vec<String> {
        let loader = Loader::new(&self.firmware).expect("the firmware has symbols");
        let is_address = |word: &&str| word.len() == 8;
        let addresses = report.split(' ').filter(is_address).filter_map(|word| u64::from_str_radix(word, 16).ok());
        let mut functions = Vec::new();
        for address in addresses {
            let mut frames = loader.find_frames(address).expect("the firmware has line tables");
            while let Some(frame) = frames.next().expect("the line tables can be read") {
                functions.extend(frame.function.and_then(|name| Some(name.demangle().ok()?.into_owned())));
            }
        }
        functions
    }
}

/// The uptime at which the previous run ended, from its fault report, s.
fn ended_s(report: &str) -> f64 {
    let (_, after) = report.split_once(" after ").expect("the report contains a time");
    after.split(' ').next().and_then(|s| s.parse().ok()).expect("the time is a number")
}

/// The fault report of the previous run; empty if there is none.
fn report(hello: &Hello) -> &str {
    hello.fault.as_deref().unwrap_or_default()
}

/// A fault that is injected once.
fn once(kind: InjectedFault, after_ms: u32) -> Option<PlannedFault> {
    Some(PlannedFault { kind, after_ms, is_repeated: false })
}

/// Injects a fault during a walk. The board must restart within [`MAX_RECOVERY_S`], and report this reset reason, this text, and
/// an address in this function.
fn assert_recovers(fault: InjectedFault, reset: Reset, text: &str, function: &str) {
    const AFTER_MS: u32 = 1500;
    let mut board = ConnectedBoard::start(once(fault, AFTER_MS));
    let first = board.hello(|_| true);
    assert_eq!((first.reset, report(&first)), (Reset::Power, ""));
    let (hello, last_live) = board.hello_and_last_live(|hello| hello.reset != Reset::Power);
    assert_eq!(hello.reset, reset, "{}", report(&hello));
    assert!(report(&hello).starts_with(text), "{}", report(&hello));
    let up_s = board.status().uptime_us as f64 * 1e-6;
    let functions = board.functions(report(&hello));
    assert!(functions.iter().any(|name| name.contains(function)), "{}: {functions:#?}", report(&hello));
    board.wait_for_live_frame();
    let host_s = last_live.elapsed().as_secs_f64();
    let found_s = (ended_s(report(&hello)) - f64::from(AFTER_MS) * 1e-3).max(0.0);
    println!("{fault:?}: {}", report(&hello));
    println!(
        "    detected after {found_s:.1} s; the board answers {up_s:.3} s after its start (board's time); {host_s:.2} s \
         without a live frame"
    );
    assert!(found_s + up_s < MAX_RECOVERY_S, "{found_s} s and {up_s} s");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn an_endless_loop_in_the_scan_is_detected() {
    assert_recovers(InjectedFault::ScanStalled, Reset::Watchdog, "stalled: scan", "read_row");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn an_endless_loop_in_the_processing_is_detected() {
    // Processing and link have the same executor, so a loop in one of them stalls both.
    assert_recovers(InjectedFault::ProcessStalled, Reset::Watchdog, "stalled: process link", "process");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn an_endless_loop_in_the_link_is_detected() {
    assert_recovers(InjectedFault::LinkStalled, Reset::Watchdog, "stalled: process link", "serve");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_stack_overflow_is_caught() {
    assert_recovers(InjectedFault::StackOverflow, Reset::Panic, "stack overflow", "too_deep");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_hard_fault_is_caught() {
    assert_recovers(InjectedFault::UndefinedInstruction, Reset::Panic, "fault", "inject");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_panic_is_caught() {
    assert_recovers(InjectedFault::Panic, Reset::Panic, "panic", "inject");
}

/// Every start that reads the set-up panics. In recovery mode the board does not read the set-up, and so it answers and scans.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_board_recovers_with_its_built_in_insole_after_repeated_failures() {
    let mut board =
        ConnectedBoard::start(Some(PlannedFault { kind: InjectedFault::Panic, after_ms: 0, is_repeated: true }));
    let hello = board.hello(|_| true);
    println!("{}", report(&hello));
    assert!(report(&hello).starts_with("recovery after 3 failed starts: panic after 0.0 s at "), "{}", report(&hello));
    assert_eq!(
        (hello.reset, hello.layout_id, hello.cells),
        (Reset::Panic, 4201, 240),
        "the insole must be the built-in one"
    );
    board.wait_for_live_frame();
    let frames = board.status().frames;
    board.wait_for_live_frame();
    assert!(board.status().frames > frames);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn without_a_set_up_the_board_uses_its_built_in_insole_and_reports_it() {
    let firmware = firmware();
    let board = Board::start_without_set_up(&firmware, NoAnswer).expect("the board boots");
    let mut board = ConnectedBoard::connect(board, firmware);
    let hello = board.hello(|_| true);
    assert_eq!((hello.reset, hello.layout_id, hello.cells), (Reset::Power, 4201, 240));
    assert_eq!(report(&hello), "no usable setup.bin, the built-in insole is used: start with `plantar emulate`");
}

/// Twice the time after which a stall is detected, us.
const LONG_US: u64 = 2 * 1000 * (CHECK_PERIOD_MS * STALLED_CHECKS as u32) as u64;

/// Checks that the board runs longer than a stall may last, and is not restarted.
fn assert_not_restarted(mut board: ConnectedBoard) -> Status {
    board.hello(|_| true);
    let status = loop {
        let status = board.status();
        if status.uptime_us > LONG_US {
            break status;
        }
    };
    board.send(ToDevice::Connect { major: MAJOR, minor: MINOR });
    let hello = board.hello(|_| true);
    assert_eq!((hello.reset, report(&hello)), (Reset::Power, ""));
    status
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_stopped_frame_clock_is_no_fault() {
    // With `Time::Fastest`, the frame clock does not run before `Board::play`.
    let board = ConnectedBoard::start_with(|config| config, Time::Fastest, None::<NoAnswer>);
    assert_eq!(assert_not_restarted(board).frames, 0);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_matrix_that_does_not_answer_is_no_fault() {
    let board = ConnectedBoard::start_with(|config| config, Time::Real, Some(NoAnswer));
    let status = assert_not_restarted(board);
    assert_eq!(status.frames, 0);
    assert!(status.frames_missed > 0);
}

/// `stopped` is the part that stops, and `healthy` the number of checks before it stops.
#[test]
fn the_watchdog_finds_a_stalled_part_after_the_allowed_number_of_checks_and_not_before() {
    for stopped in [Part::Scan, Part::Process, Part::Link, Part::Storage, Part::Radio] {
        let most = u32::from(MOST_CHECKS[stopped as usize]);
        for healthy in 1..30 {
            let (heartbeats, mut watchdog) = (Heartbeats::new(), Watchdog::new());
            let mut checks = 0;
            let stalled = loop {
                let runs = |part| part != stopped || checks < healthy;
                // The scan queues frames even if processing is stalled.
                if runs(Part::Scan) {
                    heartbeats.scan_progressed();
                    heartbeats.frame_queued();
                }
                if runs(Part::Process) && runs(Part::Scan) {
                    heartbeats.frame_processed();
                }
                for part in [Part::Link, Part::Storage, Part::Radio].into_iter().filter(|&part| runs(part)) {
                    heartbeats.progressed(part);
                }
                checks += 1;
                match watchdog.check(&heartbeats) {
                    0 => assert!(checks <= healthy + most),
                    stalled => break stalled,
                }
            };
            assert_eq!((stalled, checks), (1 << stopped as u32, healthy + most), "{stopped:?}");
            assert_eq!(watchdog.checks(), checks);
        }
    }
}

/// A start may wait for the flash chip for a limited time. It does not count as successful meanwhile.
#[test]
fn a_start_that_never_ends_is_detected() {
    let (heartbeats, mut watchdog) = (Heartbeats::new(), Watchdog::new());
    let found = (1..).find(|_| watchdog.check(&heartbeats) != 0);
    assert_eq!(found, Some(START_CHECKS - 1 + u32::from(STALLED_CHECKS)));
    assert!(watchdog.healthy_checks() < HEALTHY_CHECKS);
}

#[test]
fn an_idle_part_is_not_stalled() {
    let (heartbeats, mut watchdog) = (Heartbeats::new(), Watchdog::new());
    // Scan, link and storage have heartbeats while they wait; a radio that has never answered counts as idle.
    let wait = || {
        heartbeats.scan_progressed();
        heartbeats.progressed(Part::Link);
        heartbeats.progressed(Part::Storage);
    };
    for _ in 0..1000 {
        wait();
        assert_eq!(watchdog.check(&heartbeats), 0);
    }
    // Processing is stalled if a queued frame is not processed.
    heartbeats.frame_queued();
    let found = (1..).find(|_| {
        wait();
        watchdog.check(&heartbeats) != 0
    });
    assert_eq!(found, Some(u32::from(STALLED_CHECKS)));
}

#[test]
fn the_status_reports_why_the_radio_does_not_start() {
    /// A change of the counters, and the state of the radio that the status then reports.
    type Change = (fn(&ScanCounters), Radio);
    let changes: [Change; 5] = [
        (|_| (), Radio::Silent),
        (|counters| counters.heartbeats.progressed(Part::Radio), Radio::Answers),
        (|counters| counters.radio_has_no_firmware(), Radio::NoFirmware),
        (|counters| counters.radio_failed(0), Radio::Failed(0)),
        (|counters| counters.radio_failed(255), Radio::Failed(255)),
    ];
    for (change, expected) in changes {
        let counters: &'static ScanCounters = Box::leak(Box::new(ScanCounters::new()));
        let exchange = Box::leak(Box::new(RefCell::new(Exchange::Idle)));
        let session = Box::leak(Box::new(RefCell::new(Session::new())));
        let gauges = Gauges { stack_bytes: || 0, supply_mv: || None };
        let shared = Shared::new(testkit::fixtures::hello(), 1000, counters, gauges, exchange, session);
        change(counters);
        let mut buffer = [0; MAX_MESSAGE];
        shared.receive(SharedCarrier::Serial, Some(ToDevice::Connect { major: MAJOR, minor: MINOR }));
        shared.next(SharedCarrier::Serial, &mut buffer);
        shared.receive(SharedCarrier::Serial, Some(ToDevice::GetStatus));
        let Some(ToHost::Status(status)) = shared.next(SharedCarrier::Serial, &mut buffer).and_then(decode) else {
            panic!("the insole answers with its status");
        };
        assert_eq!(status.radio, expected);
    }
}

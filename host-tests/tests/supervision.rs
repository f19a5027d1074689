//! What goes wrong on the insole is found, told and over soon: the real firmware in QEMU, and the looks alone.
//!
//! The firmware is the file that `PLANTAR_FIRMWARE` names.

mod common;

use addr2line::Loader;
use client::{Carrier, Framed};
use common::{firmware, synthetic_walk};
use emulation::{EmulatorConfig, InjectedFault, PlannedFault};
use emulator::{Board, Looped, Recorded, Scan, Time, Walk};
use plantar::firmware::supervise::{
    CHECK_PERIOD_MS, HEALTHY_CHECKS, Heartbeats, STALLED_CHECKS, START_CHECKS, Watchdog,
};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance::StanceRule;
use plantar::protocol::{Hello, MAJOR, MINOR, Reset, Status, ToDevice, ToHost};
use recording::VirtualInsole;
use std::net::TcpStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The insole is back within this time.
const BAR_S: f64 = 2.0;
/// A machine that has not got there by then is too busy for this test.
const PATIENCE: Duration = Duration::from_secs(120);
/// A board that says nothing for so long is asked who it is.
const SILENCE: Duration = Duration::from_millis(50);

/// A matrix that never answers.
struct Mute;

impl Walk for Mute {
    fn scans(&self) -> u32 {
        u32::MAX
    }

    fn scan(&mut self, _: u32, _: &mut [u16]) -> Scan {
        Scan::Rows(0)
    }
}

/// A board and what it says.
struct Watched {
    _board: Board,
    link: Framed<TcpStream>,
    firmware: PathBuf,
    began: Instant,
}

impl Watched {
    /// With a walk that never ends; time is this machine's.
    fn start(fault: Option<PlannedFault>) -> Self {
        Self::start_with(|head| EmulatorConfig { fault, ..head }, Time::Real, None::<Mute>)
    }

    fn start_with(head: impl Fn(EmulatorConfig) -> EmulatorConfig, time: Time, walk: Option<impl Walk>) -> Self {
        let firmware = firmware();
        let recording = synthetic_walk(3, 100.0);
        let worn = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::WALKING);
        let head = head(EmulatorConfig::new(worn.setup));
        let cells = worn.cells.clone();
        let board = match walk {
            Some(walk) => Board::start(&firmware, &head, &cells, time, walk),
            None => Board::start(&firmware, &head, &cells, time, Looped(Recorded::new(recording, worn))),
        };
        Self::watch(board.expect("the board boots"), firmware)
    }

    fn watch(board: Board, firmware: PathBuf) -> Self {
        let link = board.link().expect("the link is there");
        link.set_read_timeout(Some(SILENCE)).expect("a socket takes a time-out");
        Self { _board: board, link: Framed::new(link), firmware, began: Instant::now() }
    }

    fn send(&mut self, message: ToDevice) {
        self.link.send(message).expect("the link holds");
    }

    fn receive(&mut self) -> Option<ToHost> {
        assert!(self.began.elapsed() < PATIENCE, "the board is not there, or the machine too busy");
        self.link.receive().expect("the link holds")
    }

    /// Streams, and connects again whenever the board falls silent, until it says hello as asked for.
    fn hello(&mut self, is_it: impl Fn(&Hello) -> bool) -> Hello {
        let (found, _) = self.hello_after(is_it);
        found
    }

    /// The same, and when the last live frame came before it.
    fn hello_after(&mut self, is_it: impl Fn(&Hello) -> bool) -> (Hello, Instant) {
        let mut last_live = Instant::now();
        let mut asked = None;
        loop {
            if last_live.max(asked.unwrap_or(last_live)).elapsed() > SILENCE {
                asked = Some(Instant::now());
                self.send(ToDevice::Connect { major: MAJOR, minor: MINOR });
            }
            match self.receive() {
                Some(ToHost::Live(_)) => last_live = Instant::now(),
                Some(ToHost::Hello(hello)) => {
                    self.send(ToDevice::Stream { live: true });
                    if is_it(&hello) {
                        return (hello, last_live);
                    }
                }
                _ => {}
            }
        }
    }

    /// Waits for a live frame.
    fn live(&mut self) {
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

    /// The functions that the addresses in a hello lie in, innermost first, those that were inlined among them.
    fn functions(&self, told: &str) -> Vec<String> {
        let loader = Loader::new(&self.firmware).expect("the firmware has its symbols");
        let is_address = |word: &&str| word.len() == 8;
        let addresses = told.split(' ').filter(is_address).filter_map(|word| u64::from_str_radix(word, 16).ok());
        let mut functions = Vec::new();
        for address in addresses {
            let mut frames = loader.find_frames(address).expect("the firmware has its lines");
            while let Some(frame) = frames.next().expect("they can be read") {
                functions.extend(frame.function.and_then(|name| Some(name.demangle().ok()?.into_owned())));
            }
        }
        functions
    }
}

/// When the start ended that a text of the hello tells of, s.
fn ended_s(told: &str) -> f64 {
    let (_, after) = told.split_once(" after ").expect("when");
    after.split(' ').next().and_then(|s| s.parse().ok()).expect("seconds")
}

fn told(hello: &Hello) -> &str {
    hello.last_panic.as_deref().unwrap_or_default()
}

fn once(kind: InjectedFault, after_ms: u32) -> Option<PlannedFault> {
    Some(PlannedFault { kind, after_ms, is_repeated: false })
}

/// A mishap in the midst of a walk: the board comes back and tells of it; gives what it told.
fn assert_recovers(what: InjectedFault, reset: Reset, begins: &str, function: &str) {
    const AFTER_MS: u32 = 1500;
    let mut board = Watched::start(once(what, AFTER_MS));
    let first = board.hello(|_| true);
    assert_eq!((first.reset, told(&first)), (Reset::Power, ""));
    let (hello, silent) = board.hello_after(|hello| hello.reset != Reset::Power);
    assert_eq!(hello.reset, reset, "{}", told(&hello));
    assert!(told(&hello).starts_with(begins), "{}", told(&hello));
    let functions = board.functions(told(&hello));
    assert!(functions.iter().any(|name| name.contains(function)), "{}: {functions:#?}", told(&hello));
    let up_s = board.status().uptime_us as f64 * 1e-6;
    board.live();
    let host_s = silent.elapsed().as_secs_f64();
    let found_s = (ended_s(told(&hello)) - f64::from(AFTER_MS) * 1e-3).max(0.0);
    println!("{what:?}: {}", told(&hello));
    println!(
        "    found after {found_s:.1} s, {up_s:.3} s old as it answers (board's time); {host_s:.2} s without a frame here"
    );
    assert!(found_s + up_s < BAR_S, "{found_s} s and {up_s} s");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_scan_that_goes_round_for_ever_is_found() {
    assert_recovers(InjectedFault::ScanStalled, Reset::Watchdog, "stalled: scan", "read_row");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_model_that_goes_round_for_ever_is_found() {
    assert_recovers(InjectedFault::ModelStalled, Reset::Watchdog, "stalled: model link", "process");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_link_that_goes_round_for_ever_is_found() {
    assert_recovers(InjectedFault::LinkStalled, Reset::Watchdog, "stalled: model link", "serve");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_stack_that_is_too_deep_is_caught() {
    assert_recovers(InjectedFault::StackOverflow, Reset::Panic, "stack overflow", "too_deep");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_fault_is_caught() {
    assert_recovers(InjectedFault::Fault, Reset::Panic, "fault", "inject");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_panic_is_caught() {
    assert_recovers(InjectedFault::Panic, Reset::Panic, "panic", "inject");
}

/// Every start that reads its set-up panics: the one that does not read it talks, scans, and goes on doing so.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_board_that_fails_again_and_again_falls_back_to_what_is_built_in() {
    let mut board = Watched::start(Some(PlannedFault { kind: InjectedFault::Panic, after_ms: 0, is_repeated: true }));
    let hello = board.hello(|_| true);
    println!("{}", told(&hello));
    assert!(told(&hello).starts_with("fallback after 3 failed starts: panic after 0.0 s at "), "{}", told(&hello));
    assert_eq!((hello.reset, hello.layout_id, hello.cells), (Reset::Panic, 4201, 240), "the built-in insole");
    board.live();
    let frames = board.status().frames;
    board.live();
    assert!(board.status().frames > frames);
}

/// Failures that are far between are no reason to forget the set-up.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn starts_that_lived_do_not_count_as_failed() {
    let after_ms = HEALTHY_CHECKS * CHECK_PERIOD_MS + 500;
    let mut board = Watched::start(Some(PlannedFault { kind: InjectedFault::Panic, after_ms, is_repeated: true }));
    let layout_id = board.hello(|_| true).layout_id;
    let (mut starts, mut before_us) = (0, 0);
    while starts < 4 {
        let hello = board.hello(|_| true);
        let up_us = board.status().uptime_us;
        // On a busy machine the same start is asked twice.
        if up_us < before_us {
            assert!(told(&hello).starts_with("panic after "), "{}", told(&hello));
            starts += 1;
        }
        assert_eq!(hello.layout_id, layout_id);
        before_us = up_us;
    }
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn without_a_set_up_the_board_has_the_built_in_insole_and_says_so() {
    let firmware = firmware();
    let board = Board::start_without_set_up(&firmware, Mute).expect("the board boots");
    let mut board = Watched::watch(board, firmware);
    let hello = board.hello(|_| true);
    assert_eq!((hello.reset, hello.layout_id, hello.cells), (Reset::Power, 4201, 240));
    assert_eq!(told(&hello), "setup.bin is missing or incomplete: the built-in insole is used");
}

/// Longer than anything may stand still, by the board's clock, and then as much again.
const LONG_US: u64 = 2 * 1000 * (CHECK_PERIOD_MS * STALLED_CHECKS as u32) as u64;

fn assert_lives_on(mut board: Watched) -> Status {
    board.hello(|_| true);
    let status = loop {
        let status = board.status();
        if status.uptime_us > LONG_US {
            break status;
        }
    };
    board.send(ToDevice::Connect { major: MAJOR, minor: MINOR });
    let hello = board.hello(|_| true);
    assert_eq!((hello.reset, told(&hello)), (Reset::Power, ""));
    status
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_clock_that_stands_still_is_no_fault() {
    let board = Watched::start_with(|head| head, Time::Max, None::<Mute>);
    assert_eq!(assert_lives_on(board).frames, 0);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_matrix_that_does_not_answer_is_no_fault() {
    let board = Watched::start_with(|head| head, Time::Real, Some(Mute));
    let status = assert_lives_on(board);
    assert_eq!(status.frames, 0);
    assert!(status.frames_missed > 0);
}

/// Whenever a part stops, it is found after the looks that are allowed, and only then.
#[test]
fn looks_find_who_stopped_and_when() {
    for stopped in 0..3 {
        for lived in 1..30 {
            let (life, mut watch) = (Heartbeats::new(), Watchdog::new());
            let mut looks = 0;
            let wedged = loop {
                let runs = |part| part != stopped || looks < lived;
                // The scan leaves frames even where nobody takes them.
                if runs(0) {
                    life.scan_progressed();
                    life.frame_queued();
                }
                if runs(1) && runs(0) {
                    life.frame_processed();
                }
                if runs(2) {
                    life.link_progressed();
                }
                looks += 1;
                match watch.check(&life) {
                    0 => assert!(looks <= lived + u32::from(STALLED_CHECKS)),
                    wedged => break wedged,
                }
            };
            assert_eq!((wedged, looks), (1 << stopped, lived + u32::from(STALLED_CHECKS)), "{stopped}");
            assert_eq!(watch.checks(), looks);
        }
    }
}

/// A start may wait for the flash chip, but not for ever, and has not succeeded meanwhile.
#[test]
fn a_start_that_never_begins_is_found() {
    let (life, mut watch) = (Heartbeats::new(), Watchdog::new());
    let found = (1..).find(|_| watch.check(&life) != 0);
    assert_eq!(found, Some(START_CHECKS - 1 + u32::from(STALLED_CHECKS)));
    assert!(watch.healthy_checks() < HEALTHY_CHECKS);
}

#[test]
fn who_has_nothing_to_do_rests() {
    let (life, mut watch) = (Heartbeats::new(), Watchdog::new());
    // A frame clock that waits leaves heartbeats.
    let waits = || {
        life.scan_progressed();
        life.link_progressed();
    };
    for _ in 0..1000 {
        waits();
        assert_eq!(watch.check(&life), 0);
    }
    // A frame that is not processed.
    life.frame_queued();
    let found = (1..).find(|_| {
        waits();
        watch.check(&life) != 0
    });
    assert_eq!(found, Some(STALLED_CHECKS));
}

//! The real firmware in QEMU: its messages for a walk equal those that a host computes, even if the matrix or the link has
//! faults.
//!
//! `PLANTAR_FIRMWARE` contains the path of the firmware.

use crate::common;
use crate::common::{connect, connect_within, firmware, replay, replay_faulty, replay_with, synthetic_walk, tissue};
use client::{Client, Framed};
use emulation::{EmulatorConfig, FLASH_BYTES};
use emulator::{Board, Faulty, Hardware, Joined, Link, Recorded, Scan, Time, Walk};
use fit::quality::Evaluated;
use fit::{Filter, Options, Study};
use parameters::{InsoleSize, Parameters};
use plantar::faults::{Fault, FaultKind};
use plantar::insole::Insole;
use plantar::pipeline::alert::{AlertRules, DailyLoad};
use plantar::pipeline::bout::BoutKind;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::cumulative::LoadLimits;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::{Rejected, StanceRule};
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::{
    Alert, Bout, Live, MAX_FRAME, MAX_MESSAGE, Refusal, Reset, Settings, Status, Step, ToDevice, ToHost, encode, frame,
};
use plantar::storage::{SettingsRecord, Store};
use plantar::{Region, Side};
use recording::synthetic::SyntheticWalk;
use recording::{Recording, VirtualInsole, jiku, pedar};
use rstest::rstest;
use std::io::Write;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};
use testkit::activity::{self, Activity};
use testkit::faults::one_of_each;
use testkit::nor_flash::{NorFlashChip, block_on};
use testkit::wear::{Residual, find, noisy_walk, with_residual};

/// A recording in which some scans are incomplete.
struct IncompleteWalk {
    walk: Recorded,
    /// The result of the scan with this number; `None` for a complete scan.
    fault: fn(u32) -> Option<Scan>,
}

impl Walk for IncompleteWalk {
    fn scans(&self) -> u32 {
        self.walk.scans()
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        let scan = self.walk.scan(seq, codes);
        (self.fault)(seq).unwrap_or(scan)
    }
}

/// Time at which a fault begins, in the fifth step of a computed walk, s.
const FAULT_S: f64 = 5.0;
/// Number of successive reads without a message after which the board counts as stopped. A read takes up to 50 ms, and on a busy
/// machine it may return a single byte of a message.
const SILENT_READS: usize = 2_000;

/// A session with a board that scans a walk. The walk does not begin before [`Board::play`].
struct Session {
    board: Board,
    client: Client<Framed<Link>>,
    /// Number of scans of the walk.
    scans: u32,
}

impl Session {
    /// Starts a board with a recording, and sets typical parameters. `fault` selects the incomplete scans.
    fn start(recording: &Recording, contact: ContactRule, fault: fn(u32) -> Option<Scan>) -> Self {
        let mut session = Self::start_without_tissue(recording, contact, fault);
        session.client.set_tissue(&tissue()).expect("typical parameters are valid");
        session
    }

    /// The same as [`Self::start`], without parameters.
    fn start_without_tissue(recording: &Recording, contact: ContactRule, fault: fn(u32) -> Option<Scan>) -> Self {
        let virtual_insole = VirtualInsole::new(recording, contact, StanceRule::ADAPTIVE);
        let walk = Recorded::new(recording.clone(), virtual_insole.clone());
        Self::start_walk(&virtual_insole, IncompleteWalk { walk, fault })
    }

    /// Starts a board that has the configuration of `virtual_insole` and scans `walk`.
    fn start_walk(virtual_insole: &VirtualInsole, walk: impl Walk + 'static) -> Self {
        let firmware = firmware();
        let scans = walk.scans();
        let config = EmulatorConfig::new(virtual_insole.setup);
        let board =
            Board::start(&firmware, &config, &virtual_insole.cells, Time::Fastest, walk).expect("the board boots");
        let client = connect(&board);
        Self { board, client, scans }
    }

    /// The next message.
    fn next(&mut self) -> ToHost {
        for _ in 0..SILENT_READS {
            if let Some(message) = self.client.receive().expect("the link works") {
                return message;
            }
        }
        panic!("the board sent no message in {SILENT_READS} successive reads");
    }

    /// Receives one message; returns true if it is an answer.
    fn receive(&mut self, received: &mut Received) -> bool {
        let message = self.next();
        self.store(message, received)
    }

    /// Stores a message; returns true if it is an answer.
    fn store(&mut self, message: ToHost, received: &mut Received) -> bool {
        let is_answer = !matches!(message, ToHost::Live(_) | ToHost::Step(_) | ToHost::Bout(_) | ToHost::Alert(_));
        match message {
            ToHost::Live(live) => received.live.push(live),
            ToHost::Step(step) => {
                self.client.send(ToDevice::Acknowledge { number: step.step }).expect("the link works");
                // A replay has no wall clock.
                received.steps.push(Step { start_unix_us: None, ..step });
            }
            ToHost::Bout(bout) => {
                self.client.send(ToDevice::Acknowledge { number: bout.number }).expect("the link works");
                received.bouts.push(Bout { start_unix_us: None, ..bout });
            }
            ToHost::Alert(alert) => {
                self.client.send(ToDevice::Acknowledge { number: alert.number }).expect("the link works");
                received.alerts.push(Alert { start_unix_us: None, ..alert });
            }
            ToHost::Status(status) => received.status = status,
            ToHost::Tissue(tissue) => received.tissues.push((received.live.len(), tissue)),
            ToHost::Refused(refusal) => received.refusals.push(refusal),
            ToHost::Hello(hello) => panic!("the insole restarted: {:?}", hello.fault),
            other => panic!("no request for this message was sent: {other:?}"),
        }
        is_answer
    }

    /// Receives until the board has counted all scans of the walk; returns the messages.
    fn finish(&mut self) -> Received {
        let mut received = Received::default();
        self.finish_into(&mut received);
        received
    }

    /// The same as [`Self::finish`], but adds the messages to `received`.
    fn finish_into(&mut self, received: &mut Received) {
        // While the board scans, requests would only slow it down.
        let mut silent = 0;
        while self.board.plant().scans() < self.scans {
            silent += 1;
            assert!(silent < SILENT_READS, "{} of {} scans", self.board.plant().scans(), self.scans);
            if let Some(message) = self.client.receive().expect("the link works") {
                self.store(message, received);
                silent = 0;
            }
        }
        loop {
            self.ask(ToDevice::GetStatus, received);
            let status = &received.status;
            if status.frame_times() >= self.scans {
                return;
            }
        }
    }

    /// Sends a request and receives until its answer arrives.
    fn ask(&mut self, request: ToDevice, received: &mut Received) {
        self.client.send(request).expect("the link works");
        while !self.receive(received) {}
    }
}

/// The messages that a session received.
#[derive(Default)]
struct Received {
    live: Vec<Live>,
    steps: Vec<Step>,
    bouts: Vec<Bout>,
    alerts: Vec<Alert>,
    /// Confirmed parameters, each with the number of live frames that arrived before.
    tissues: Vec<(usize, Tissue)>,
    refusals: Vec<Refusal>,
    /// The last status.
    status: Status,
}

/// The parameters of another wearer, with a greater stiffness in every region.
fn other_tissue() -> Tissue {
    let mut force_laws = tissue().force_laws;
    force_laws.iter_mut().for_each(|law| law.stiffness_pa *= 1.5);
    Tissue::new(force_laws)
}

/// Plays a recording and compares live frames and steps of the board with a replay.
fn assert_device_equals_host(recording: &Recording, contact: ContactRule, min_steps: usize) {
    let mut session = Session::start(recording, contact, |_| None);
    session.client.stream().expect("the stream starts");
    session.board.play();
    let received = session.finish();
    let (live, steps) = replay(recording, contact, |_| false);
    assert!(steps.len() >= min_steps, "{} steps in {}", steps.len(), recording.source);
    assert_eq!(received.steps, steps);
    assert_eq!(received.live.len(), live.len());
    for (received, computed) in received.live.iter().zip(&live) {
        assert_eq!(received, computed);
    }
    let counters = session.client.counters();
    assert_eq!(
        (counters.frames_sent, counters.frames_received, counters.frames_lost, counters.crc_errors),
        (session.scans, session.scans, 0, 0)
    );
    assert_eq!((received.status.frames_missed, received.status.frames_overrun), (0, 0));
}

/// A walk of this number of scans, in each of which every cell has the number of the scan as its code.
struct Numbered(u32);

impl Walk for Numbered {
    fn scans(&self) -> u32 {
        self.0
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        codes.fill(seq as u16);
        Scan::Whole
    }
}

/// Period of the scans in the tests of joined walks. It is so long that the running time of these tests is rounded to 0 scans.
const PERIOD: Duration = Duration::from_secs(90);

/// For each of the board's own scans `seqs`, the number of the scan of the walk that the board receives.
fn scans(walk: &mut Joined<Numbered>, seqs: [u32; 3]) -> [u16; 3] {
    seqs.map(|seq| {
        let mut codes = [0];
        walk.scan(seq, &mut codes);
        codes[0]
    })
}

#[test]
fn a_board_that_starts_later_joins_the_walk_where_it_is() {
    let start = Arc::new(OnceLock::new());
    let mut first = Joined::new(Numbered(1000), PERIOD, 1000 * PERIOD, start.clone());
    assert_eq!(scans(&mut first, [0, 1, 1002]), [0, 1, 2]);
    assert!(start.get().is_some(), "the first scan begins the walk");
    let began = Instant::now().checked_sub(7 * PERIOD).expect("a time");
    let mut late = Joined::new(Numbered(1000), PERIOD, 1000 * PERIOD, Arc::new(began.into()));
    assert_eq!(scans(&mut late, [0, 1, 998]), [7, 8, 5]);
}

/// The second board has 1.5 times the frame rate.
#[test]
fn walks_of_different_lengths_begin_each_repetition_together() {
    let (start, repeated_after) = (Arc::new(OnceLock::new()), 12 * PERIOD);
    let mut longer = Joined::new(Numbered(12), PERIOD, repeated_after, start.clone());
    let mut shorter = Joined::new(Numbered(15), PERIOD * 2 / 3, repeated_after, start);
    assert_eq!(scans(&mut longer, [11, 12, 120]), [11, 0, 0]);
    assert_eq!(scans(&mut shorter, [17, 18, 180]), [14, 0, 0]);
}

#[test]
fn an_error_of_a_file_names_the_folder_with_the_files_of_the_emulator() {
    let text = emulator::Error::from(std::io::Error::other("the disk is full")).to_string();
    assert!(text.contains("the disk is full") && text.contains("free space"), "{text}");
    assert!(text.contains(std::env::temp_dir().to_str().expect("UTF-8")), "{text}");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_synthetic_walk_is_the_same_on_the_device_and_on_a_host() {
    assert_device_equals_host(&synthetic_walk(4, 100.0), ContactRule::COUNTED, 4);
}

/// A minute after the foot was lifted, the insole counts as not worn and skips most frames. Among the skipped ones are the heel
/// strike of the next contact, which is therefore rejected as a step, and the last frame of the walk.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_walk_with_pauses_without_load_differs_from_a_replay_by_the_first_contact_after_the_pause() {
    let mut walk = synthetic_walk(3, 100.0);
    let steps = walk.pressure_kpa.clone();
    // Its length is such that the last frame is skipped.
    let pause = vec![0.0; 7_000 * walk.cells()];
    walk.pressure_kpa.extend([&pause[..], &steps, &pause].concat());
    walk.t_s = (0..walk.pressure_kpa.len() / walk.cells()).map(|i| i as f64 / walk.rate_hz).collect();
    let mut session = Session::start(&walk, ContactRule::COUNTED, |_| None);
    session.board.play();
    let received = session.finish();
    assert_eq!(session.board.plant().scans(), session.scans);
    assert!(!received.status.is_worn && !(session.scans - 1).is_multiple_of(50), "the last frame is skipped");
    let starts = |steps: &[Step]| steps.iter().map(|step| step.start_us).collect::<Vec<_>>();
    let (_, replayed) = replay(&walk, ContactRule::COUNTED, |_| false);
    let mut expected = starts(&replayed);
    expected.remove(3);
    assert_eq!((starts(&received.steps), replayed.len()), (expected, 6));
    assert_eq!(received.status.rejected, Rejected { broken: 1, ..Rejected::default() });
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn covered_shares_are_the_same_on_the_device_and_on_a_host() {
    assert_device_equals_host(&synthetic_walk(3, 100.0), ContactRule::COVERED, 3);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn walks_at_50_and_400_hz_are_the_same_on_the_device_and_on_a_host() {
    for rate_hz in [50.0, 400.0] {
        assert_device_equals_host(&synthetic_walk(2, rate_hz), ContactRule::COUNTED, 2);
    }
}

#[test]
#[ignore = "needs the emulated board's firmware and the data set SpeedPP2DS: cargo xtask test"]
fn barefoot_steps_on_a_plate_are_the_same_on_the_device_and_on_a_host() {
    let walk = jiku::import(common::jiku(), 2, 0..6, &mut |_, _| ()).expect("the data set can be read");
    let walk = walk.at_rate(100.0).and_then(|walk| walk.binned(DEVICE_CELLS)).expect("a walk can be binned");
    assert_device_equals_host(&walk, ContactRule::COUNTED, 6);
}

/// Tests with recordings of people, which are not public.
mod unpublished {
    use super::*;

    #[test]
    #[ignore = "needs the emulated board's firmware and recordings of people, which are not public: PLANTAR_RECORDINGS"]
    fn in_shoe_steps_are_the_same_on_the_device_and_on_a_host() {
        let data = common::recordings().join("pedar");
        for side in [Side::Left, Side::Right] {
            let walk = pedar::import(data.join("pedar_example.asc"), data.join("geometry.csv"), side, &mut |_, _| ())
                .expect("the recording can be read");
            assert_device_equals_host(&walk, ContactRule::COUNTED, 8);
        }
    }
}

/// In three frames of a stance the matrix answers only for seven rows.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn incomplete_scans_are_counted_as_missing_frames_and_bridged() {
    let is_missing = |seq: u32| (60..63).contains(&seq);
    let walk = synthetic_walk(3, 100.0);
    let fault = |seq: u32| (60..63).contains(&seq).then_some(Scan::Rows(7));
    let mut session = Session::start(&walk, ContactRule::COUNTED, fault);
    session.client.stream().expect("the stream starts");
    session.board.play();
    let received = session.finish();
    let (live, steps) = replay(&walk, ContactRule::COUNTED, is_missing);
    assert_eq!(received.status.frames_missed, 3);
    assert_eq!(received.steps, steps);
    assert_eq!(received.steps.iter().map(|step| step.bridged_frames).collect::<Vec<_>>(), [3, 0, 0]);
    assert_eq!(received.live, live, "the missing frames must show as a gap in time");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn foreign_bytes_on_the_link_are_counted_and_the_session_continues() {
    let walk = synthetic_walk(2, 100.0);
    let mut session = Session::start(&walk, ContactRule::COUNTED, |_| None);
    let mut link = session.board.link().expect("the board has a link");
    // Text of another program, a truncated frame, zeros, and more bytes than any frame has.
    let long = [0x55; 2000];
    for bytes in [&b"AT+NAME?\r\n\0"[..], &[3, 1, 0], &[0, 0, 0], &long, &[0]] {
        link.write_all(bytes).expect("the link works");
    }
    session.client.stream().expect("the insole answers");
    session.board.play();
    let received = session.finish();
    assert_eq!(received.steps.len(), 2);
    assert_eq!(received.status.bad_frames, 3, "the text, the truncated frame and the long frame must count");
}

/// The bytes fill the receive buffer of the port before a task reads it. If the port then requested interrupts without end, the
/// board would not answer.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn bytes_that_arrive_during_the_start_do_not_stop_the_insole() {
    let walk = synthetic_walk(1, 100.0);
    let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let config = EmulatorConfig::new(virtual_insole.setup);
    let recorded = Recorded::new(walk, virtual_insole.clone());
    let board =
        Board::start(&firmware(), &config, &virtual_insole.cells, Time::Fastest, recorded).expect("the board boots");
    let mut link = board.link().expect("the board has a link");
    link.write_all(&[0x55; 200_000]).expect("the link works");
    // The emulated port receives some 10 to 60 kB/s.
    assert_eq!(connect_within(&board, Duration::from_secs(120)).hello().fault, None);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn the_hello_identifies_the_insole() {
    let walk = synthetic_walk(1, 100.0);
    let session = Session::start(&walk, ContactRule::COVERED, |_| None);
    let hello = session.client.hello();
    assert_eq!((hello.side, hello.cells, hello.period_us), (Side::Left, 240, 10_000));
    assert_eq!((hello.tissue_id, hello.contact_rule), (tissue().id, ContactRule::COVERED));
    assert_eq!((hello.board.as_str(), hello.fault.as_deref()), ("emulated", None));
}

/// A board that refuses its set-up answers nevertheless, and reports the reason.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_refused_set_up_is_reported_in_the_hello() {
    let firmware = firmware();
    let walk = synthetic_walk(1, 100.0);
    let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let mut cells = virtual_insole.cells.clone();
    cells.reverse();
    assert_ne!(cells.first().map(|c| c.region), Some(Region::Heel));
    let config = EmulatorConfig::new(virtual_insole.setup);
    let board = Board::start(&firmware, &config, &cells, Time::Fastest, Recorded::new(walk, virtual_insole))
        .expect("the board boots");
    let client = connect(&board);
    let report = client.hello().fault.as_deref().unwrap_or_default().to_owned();
    assert!(report.contains("belongs to a region before that of the previous cell"), "{report}");
    // A number of cells of 0 shows a host that the insole does not measure.
    assert_eq!(client.hello().cells, 0);
}

/// The log of the reference design's chip holds the 25,000 steps of one foot on a day of 50,000 steps.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn an_insole_continues_with_a_full_log_of_16_mib() {
    const STEPS: u32 = 30_000;
    let mut chip = NorFlashChip::new(16 << 20);
    let mut store = block_on(Store::open(Some(&mut chip), Reset::Power));
    let dropped: u32 =
        (0..STEPS).map(|number| block_on(store.push_record(testkit::step(number))).expect("the chip works")).sum();
    assert!(dropped > 0 && STEPS - dropped >= 25_000, "{dropped}");
    let hardware = Hardware { flash: Some(chip.bytes), ..Hardware::default() };
    let walk = synthetic_walk(1, 100.0);
    let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let (config, cells) = (EmulatorConfig::new(virtual_insole.setup), virtual_insole.cells.clone());
    let walk = Recorded::new(walk, virtual_insole);
    let board =
        Board::start_with(&firmware(), &config, &cells, Time::Fastest, walk, &hardware).expect("the board boots");
    let mut client = connect(&board);
    let status = client.status().expect("the insole answers");
    assert_eq!((status.contents.next_record, status.contents.erased, status.not_stored), (STEPS, 0, 0));
    client.stream().expect("the insole streams");
    let first =
        std::iter::repeat_with(|| client.receive().expect("the link works")).take(SILENT_READS).find_map(|message| {
            let Some(ToHost::Step(step)) = message else { return None };
            Some(step.step)
        });
    assert_eq!(first, Some(dropped));
}

/// Other firmware, or a chip of another board, can leave settings that this board must not use.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn stored_settings_that_do_not_fit_are_reported_in_the_hello() {
    let walk = synthetic_walk(1, 100.0);
    let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let settings = Settings { scale: 3.0, period_us: 20_000, ..Settings::of(&virtual_insole.setup) };
    let mut chip = NorFlashChip::new(FLASH_BYTES);
    let mut store = block_on(Store::open(Some(&mut chip), Reset::Power));
    block_on(store.put(0, &SettingsRecord(Some(settings)))).expect("the settings are stored");
    let hardware = Hardware { flash: Some(chip.bytes), ..Hardware::default() };
    let (config, cells) = (EmulatorConfig::new(virtual_insole.setup), virtual_insole.cells.clone());
    let walk = Recorded::new(walk, virtual_insole);
    let board =
        Board::start_with(&firmware(), &config, &cells, Time::Fastest, walk, &hardware).expect("the board boots");
    let client = connect(&board);
    let hello = client.hello();
    assert!(hello.fault.as_deref().unwrap_or_default().contains("the stored settings do not fit"), "{hello:?}");
    assert_eq!((hello.cells, hello.period_us), (240, 10_000));
}

/// Plays a recording, compares steps and load bouts of the board with those of a host, and returns the load bouts.
fn assert_records_equal_host(recording: &Recording) -> Vec<Bout> {
    let mut session = Session::start(recording, ContactRule::COVERED, |_| None);
    session.board.play();
    let received = session.finish();
    let (_, steps) = replay(recording, ContactRule::COVERED, |_| false);
    assert_eq!(received.steps, steps, "{}", recording.source);
    let found = find(recording, ContactRule::COVERED, StanceRule::ADAPTIVE);
    let mut computed: Vec<_> = found.bouts.iter().map(Bout::new).collect();
    // A bout that is still in progress at the end is not sent yet.
    computed.truncate(received.bouts.len().max(computed.len() - 1));
    assert_eq!(received.bouts, computed, "{}", recording.source);
    received.bouts
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn load_bouts_are_the_same_on_the_device_and_on_a_host() {
    let activities = [Activity::Walk, Activity::Stand, Activity::Shuffle, Activity::Run, Activity::Sit, Activity::Walk];
    let (recording, _) = activity::recording(&activities, 650.0, 100.0, 10.0, 5);
    let bouts = assert_records_equal_host(&recording);
    assert!(bouts.iter().any(|bout| bout.kind == BoutKind::Shuffling), "{bouts:?}");
}

/// A child of 15 kg and a wearer of 180 kg, low and high frame rates, and every activity.
#[rstest]
#[case(147.0, 100.0, &[Activity::Walk, Activity::Stand, Activity::Run])]
#[case(1766.0, 100.0, &[Activity::Walk, Activity::Stairs, Activity::StandOnOne])]
#[case(650.0, 50.0, &[Activity::Shuffle, Activity::Walk, Activity::Lift])]
#[case(650.0, 400.0, &[Activity::Run, Activity::Stand])]
#[case(650.0, 100.0, &[Activity::Sit, Activity::Stairs, Activity::Sit])]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn activities_are_the_same_on_the_device_and_on_a_host(
    #[case] weight_n: f64,
    #[case] rate_hz: f64,
    #[case] activities: &[Activity],
) {
    let (recording, _) = activity::recording(activities, weight_n, rate_hz, 10.0, 5);
    assert_records_equal_host(&recording);
}

/// The baselines of the cells follow the residual pressure.
#[rstest]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn residual_pressure_is_the_same_on_the_device_and_on_a_host(
    #[values(Residual::Everywhere, Residual::Patches, Residual::Appearing, Residual::Creeping, Residual::Released)]
    residual: Residual,
) {
    let walk = noisy_walk(&SyntheticWalk { steps: 12, variation: 0.1, ..SyntheticWalk::default() });
    assert_records_equal_host(&with_residual(walk, residual, 4.0));
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn alerts_and_the_load_of_the_day_are_the_same_on_the_device_and_on_a_host() {
    let limits = LoadLimits { window_s: 60, ..LoadLimits::DEFAULT };
    let rules = AlertRules { limits, pause_s: 60, ..AlertRules::RECOMMENDED };
    let activities = [Activity::Walk, Activity::Stand, Activity::Stand, Activity::Walk];
    let (recording, _) = activity::recording(&activities, 650.0, 100.0, 40.0, 5);
    let mut session = Session::start(&recording, ContactRule::COVERED, |_| None);
    session.client.set_alert_rules(&rules).expect("the rules are valid");
    session.board.play();
    let received = session.finish();
    let daily = session.client.daily_load().expect("the insole answers");

    let virtual_insole = VirtualInsole::new(&recording, ContactRule::COVERED, StanceRule::ADAPTIVE);
    let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("the set-up is valid");
    let mut codes = vec![0; virtual_insole.cells.len()];
    let (mut alerts, mut load, mut seconds) = (Vec::new(), DailyLoad::NONE, 0);
    for i in 0..session.scans as usize {
        virtual_insole.codes_of(&recording, i, &mut codes);
        if insole.frame(i as u32, &codes) {
            insole.whole_step();
        }
        insole.take_bout();
        if insole.has_ended_second() {
            seconds += 1;
            // The device puts new rules of alerts in force at the end of a second.
            if seconds == 1 {
                insole.set_alert_rules(&rules);
            }
            load = insole.daily_load();
            alerts.extend(insole.take_alert().as_ref().map(Alert::new));
        }
    }
    assert_eq!(received.alerts, alerts);
    assert_eq!(alerts.len(), 1, "{alerts:?}");
    assert_eq!(daily.totals, load.totals);
    assert_eq!((daily.sustained, daily.alerts, daily.snoozed_s), (load.sustained, load.alerts, load.snoozed_s));
    assert!(load.totals.regions[0].sustained_s > 10, "{load:?}");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn without_parameters_areas_and_measured_forces_are_valid_and_model_forces_are_zero() {
    let walk = synthetic_walk(2, 100.0);
    let mut session = Session::start_without_tissue(&walk, ContactRule::COUNTED, |_| None);
    assert_eq!(session.client.hello().tissue_id, 0);
    assert_eq!(session.client.tissue().expect("the insole answers"), Tissue::NONE);
    session.client.stream().expect("the stream starts");
    session.board.play();
    let received = session.finish();
    let (live, steps) = replay_with(&walk, ContactRule::COUNTED, |_| false, &[]);
    assert_eq!((&received.live, &received.steps), (&live, &steps));
    let regions = || received.live.iter().flat_map(|live| &live.regions);
    assert!(regions().any(|region| region.area_mm2 > 0 && region.measured_dn > 0));
    assert!(regions().all(|region| region.model_dn == 0 && region.deformation_um == 0));
    assert_eq!(received.steps.len(), 2);
}

/// The new parameters apply from a certain live frame onwards, and to every step that ends after that frame.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn parameters_change_during_a_walk_without_loss_of_a_frame() {
    let walk = synthetic_walk(4, 100.0);
    let mut session = Session::start(&walk, ContactRule::COUNTED, |_| None);
    session.client.stream().expect("the stream starts");
    session.board.play();
    // The parameters change after the beginning of the second stance.
    let mut received = Received::default();
    while received.live.len() < 150 {
        session.receive(&mut received);
    }
    // The walk pauses meanwhile, so that it does not end before the request arrives.
    session.board.plant().hold(true);
    session.ask(ToDevice::SetTissue(other_tissue()), &mut received);
    session.board.plant().hold(false);
    session.finish_into(&mut received);
    let [(changed, answer)] = received.tissues[..] else { panic!("{:?}", received.tissues) };
    assert_eq!(answer, other_tissue());
    assert!(changed < session.scans as usize, "the parameters must change before the end of the walk");
    let results = (received.live, received.steps);
    let tissues = [(0, tissue()), (changed, other_tissue())];
    assert_eq!(results, replay_with(&walk, ContactRule::COUNTED, |_| false, &tissues));
    assert_ne!(results, replay(&walk, ContactRule::COUNTED, |_| false), "the change must have an effect");
    let counters = session.client.counters();
    assert_eq!((counters.frames_received, counters.frames_lost), (session.scans, 0));
    assert_eq!((received.status.frames_missed, received.status.frames_overrun), (0, 0));

    assert_eq!(
        session.client.tissue().expect("the insole answers"),
        other_tissue(),
        "the parameters must be the same bit for bit"
    );
    let hello = session.client.reconnect(Duration::from_secs(20)).expect("the insole answers");
    assert_eq!(hello.tissue_id, other_tissue().id);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn damaged_and_invalid_parameters_are_refused_and_the_old_ones_remain() {
    let walk = synthetic_walk(3, 100.0);
    let mut session = Session::start(&walk, ContactRule::COUNTED, |_| None);
    session.client.stream().expect("the stream starts");
    session.board.play();
    let mut invalid = other_tissue().force_laws;
    invalid[Region::Hallux as usize].ab_m2 = f32::NAN;
    let mixed = Tissue { id: other_tissue().id, ..tissue() };
    let mut received = Received::default();
    for bad in [Tissue::new(invalid), mixed, Tissue::NONE] {
        session.ask(ToDevice::SetTissue(bad), &mut received);
    }
    // A damaged frame is followed by an intact frame with the first half of a message. Only the intact frame is answered.
    let (mut message, mut framed) = ([0; MAX_MESSAGE], [0; MAX_FRAME]);
    let message = encode(&ToDevice::SetTissue(other_tissue()), &mut message).expect("the message fits");
    let mut link = session.board.link().expect("the board has a link");
    let len = frame(message, &mut framed);
    framed[len / 2] ^= 0x80;
    link.write_all(&framed[..len]).expect("the link works");
    let len = frame(&message[..message.len() / 2], &mut framed);
    link.write_all(&framed[..len]).expect("the link works");
    while !session.receive(&mut received) {}
    session.finish_into(&mut received);
    let reasons = [Refusal::Tissue(Region::Hallux), Refusal::TissueId, Refusal::TissueId, Refusal::NotUnderstood];
    assert_eq!(received.refusals, reasons);
    assert_eq!(received.status.bad_frames, 2);
    assert_eq!((received.live, received.steps), replay(&walk, ContactRule::COUNTED, |_| false));
    assert_eq!(session.client.tissue().expect("the insole answers"), tissue());
}

/// Each fault is detected during a walk and reported, and its cells are masked, unless it is a single cell that is saturated only
/// in stance. Live frames, steps and faults equal those that a host computes from the same codes.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn every_kind_of_fault_is_found_on_the_device_as_on_a_host() {
    let walk = synthetic_walk(10, 100.0);
    let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let zeros: Vec<u16> = virtual_insole.cells.iter().map(|cell| cell.offset).collect();
    for fault in one_of_each(&walk, FAULT_S) {
        let played = Recorded::new(walk.clone(), virtual_insole.clone());
        let played = Faulty::new(played, vec![fault], virtual_insole.setup.period_us, zeros.clone());
        let mut session = Session::start_walk(&virtual_insole, played);
        session.client.set_tissue(&tissue()).expect("typical parameters are valid");
        session.client.stream().expect("the stream starts");
        session.board.play();
        let received = session.finish();
        let faults = session.client.faults().expect("the insole answers");
        let (live, steps, found) = replay_faulty(&walk, &[fault]);
        assert_eq!(received.steps, steps, "{fault}");
        assert_eq!(received.live, live, "{fault}");
        assert_eq!(faults, found, "{fault}");
        assert_eq!(received.status.faults, faults.found, "{fault}");

        let is_same = |reported: &&Fault| (reported.kind, reported.place) == (fault.kind, fault.place);
        let reported = faults.list.iter().find(is_same);
        let reported = reported.unwrap_or_else(|| panic!("{fault} is not among {:?}", faults.list));
        let found_s = f64::from(reported.found_ms) / 1e3;
        println!("{fault}: found at {found_s:.2} s");
        assert!(found_s > FAULT_S);
        let mut masked = [0; 8];
        // A single cell that is saturated only in stance remains in use.
        if fault.kind != FaultKind::Saturated {
            fault
                .cells(virtual_insole.cells.len())
                .for_each(|cell| masked[virtual_insole.cells[cell].region as usize] += 1);
        }
        assert_eq!(faults.masked_cells, masked, "{fault}");
        let bits = masked.iter().enumerate().fold(0, |bits, (i, &cells)| bits | u8::from(cells > 0) << i);
        assert_eq!((received.live[0].masked, received.live.last().map(|live| live.masked)), (0, Some(bits)));
        let last = received.steps.last().expect("there are steps");
        assert_eq!(last.regions.map(|region| region.masked_cells), masked, "{fault}");
    }
}

/// The parameters are identified from some steps of a walker. In all steps the insole reports the forces that the identification
/// itself computes from these parameters.
#[test]
#[ignore = "needs the emulated board's firmware and the data set SpeedPP2DS: cargo xtask test"]
fn the_insole_reports_the_force_that_the_fit_evaluated() {
    /// Numbers of the steps from which the parameters are identified.
    const FITTED: std::ops::Range<u32> = 6..14;
    let walk =
        jiku::import(common::jiku(), 2, 0..FITTED.end as usize, &mut |_, _| ()).expect("the data set can be read");
    let walk = walk.at_rate(100.0).and_then(|walk| walk.binned(240)).expect("a walk can be binned");
    for contact in [ContactRule::COUNTED, ContactRule::COVERED] {
        let options = Options::usual(InsoleSize::default().thickness_m());
        let mut study = Study::new("walker 2".into(), contact, options);
        let virtual_insole = VirtualInsole::new(&walk, contact, StanceRule::ADAPTIVE);
        study.add("walk".into(), &walk, &virtual_insole, &mut |_| ()).expect("the recording is valid");
        let steps = study.steps.clone();
        study.steps.retain(|step| FITTED.contains(&step.number));
        study.fit(&|_| ());

        let mut parameters = Parameters::typical(InsoleSize::default());
        for (region, fit) in parameters.regions.iter_mut().zip(&study.fits) {
            if let Ok(fit) = fit {
                *region = fit.ellipsoid;
            }
        }
        let mut session = Session::start_without_tissue(&walk, contact, |_| None);
        session.client.set_tissue(&parameters.tissue()).expect("identified parameters are valid");
        session.client.stream().expect("the insole answers");
        session.board.play();
        let received = session.finish();
        assert_eq!(received.steps.len(), steps.len());
        let mut compared = 0;
        for (device, step) in received.steps.iter().zip(&steps) {
            assert_eq!(device.step, step.number);
            for (region, fit) in study.fits.iter().enumerate() {
                let Ok(fit) = fit else { continue };
                let Some(ours) = Evaluated::new(&step.regions[region], Filter::Direct, &fit.law) else { continue };
                let device = &device.regions[region];
                let peak_n = ours.model_n.iter().copied().fold(0.0, f64::max);
                let integral_n_s = ours.model_n.iter().sum::<f64>() * ours.sample_s;
                // The device's value is in single precision and rounded to the unit of the message.
                let is_equal = |sent: u16, value: f64| (f64::from(sent) - value).abs() <= 1.0;
                assert!(is_equal(device.model_peak_dn, peak_n * 10.0), "{device:?}, {peak_n} N");
                assert!(is_equal(device.model_integral_dns, integral_n_s * 10.0), "{device:?}, {integral_n_s} N s");
                let error_bp = (ours.nrmse() * 1e4).min(f64::from(u16::MAX));
                assert!(is_equal(device.model_error_bp, error_bp), "{device:?}, {error_bp}");
                compared += 1;
            }
        }
        assert!(compared > 80, "{compared}");
    }
}

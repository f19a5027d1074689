//! Drives `plantar identify` in a pseudo-terminal, with an emulated insole whose wearer follows the instructions on the screen.

use crate::board::{Cable, forward};
use client::{Client, Framed, READ_TIMEOUT, ReconnectPolicy};
use emulation::EmulatorConfig;
use emulator::{Board, Hardware, Scan, Time, Walk};
use parameters::Parameters;
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use portable_pty::{CommandBuilder, PtySize, native_pty_system};
use recording::synthetic::{self, SyntheticStanding, SyntheticWalk};
use recording::{Recording, VirtualInsole};
use std::io::{Read, Write};
use std::net::{Shutdown, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, mpsc};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Each test holds this lock, so that they run one after the other: with several emulated insoles and a simulated radio at
/// once, a connection can exceed its timeout.
static ALONE: Mutex<()> = Mutex::new(());

/// The values of [`Wearer::action`].
const LIFTED: u8 = 0;
const STANDING: u8 = 1;
const WALKING: u8 = 2;

/// Number of steps that the session needs.
const STEPS: usize = 12;
/// Longest time of a session. After it, the program is killed.
const SESSION_TIMEOUT: Duration = Duration::from_secs(180);
/// The first session is interrupted after this number of steps.
const INTERRUPTED_AFTER: usize = 4;

/// An emulated insole's wearer, who follows the last instruction. Each unloaded cell reads its own offset.
struct Wearer {
    /// The present action: [`LIFTED`], [`STANDING`] or [`WALKING`].
    action: Arc<AtomicU8>,
    insole: VirtualInsole,
    /// The pressure of each cell while the wearer stands, kPa.
    standing_kpa: Vec<f32>,
    /// The recording that is played while the wearer walks.
    walk: Recording,
    /// Number of scans in which the wearer has walked.
    walked_scans: usize,
    /// Factor of the cells' [`offset`]: 0 for cells that read 0 without load.
    offset_factor: u16,
}

impl Walk for Wearer {
    fn scans(&self) -> u32 {
        u32::MAX
    }

    fn scan(&mut self, _: u32, codes: &mut [u16]) -> Scan {
        match self.action.load(Ordering::Relaxed) {
            STANDING => self.insole.codes(&self.standing_kpa, codes),
            WALKING => {
                self.insole.codes_of(&self.walk, self.walked_scans % self.walk.frames(), codes);
                self.walked_scans += 1;
            }
            _ => codes.fill(0),
        }
        for (i, code) in codes.iter_mut().enumerate() {
            *code = code.saturating_add(self.offset_factor * offset(i));
        }
        Scan::Whole
    }
}

/// Code of an unloaded cell, if [`Wearer::offset_factor`] is 1.
fn offset(cell: usize) -> u16 {
    1600 + 16 * (cell as u16 % 50)
}

/// Asserts that the offsets in this calibration file are the codes of the unloaded cells, and that all gains are 1.
fn assert_offsets(calibration: &Path) {
    let text = std::fs::read_to_string(calibration).expect("a calibration");
    assert!(text.lines().count() > 1);
    for (i, line) in text.lines().skip(1).enumerate() {
        assert_eq!(line, format!("{i},{},1", offset(i)), "the offset of a cell differs from its code without load");
    }
}

/// Runs the command with these environment variables in a terminal of 100 by 40 characters until it ends. `respond` receives each
/// screen that differs from the one before, and returns the keys to press. Returns the exit status and these screens; the last
/// one has the text that the program prints after the session.
fn run(
    arguments: &[&str],
    environment: &[(&str, &str)],
    mut respond: impl FnMut(&str) -> &'static [u8],
) -> (u32, Vec<String>) {
    let pair = native_pty_system()
        .openpty(PtySize { rows: 40, cols: 100, pixel_width: 0, pixel_height: 0 })
        .expect("a terminal");
    let mut command = CommandBuilder::new(env!("CARGO_BIN_EXE_plantar"));
    command.args(arguments);
    environment.iter().for_each(|(name, value)| command.env(name, value));
    let mut child = pair.slave.spawn_command(command).expect("the program starts");
    drop(pair.slave);
    let (end, ended) = mpsc::channel::<()>();
    let mut killer = child.clone_killer();
    let guard = std::thread::spawn(move || {
        // A session without progress would never end.
        if ended.recv_timeout(SESSION_TIMEOUT) == Err(mpsc::RecvTimeoutError::Timeout) {
            let _ = killer.kill();
        }
    });
    let mut output = pair.master.try_clone_reader().expect("a reader");
    let mut keys = pair.master.take_writer().expect("a writer");
    let mut parser = vt100::Parser::new(40, 100, 200);
    let mut screens: Vec<String> = Vec::new();
    let mut bytes = [0; 4096];
    // The program has ended when reading fails or returns no bytes.
    while let Ok(count @ 1..) = output.read(&mut bytes) {
        parser.process(&bytes[..count]);
        let screen = parser.screen().contents();
        if screens.last() != Some(&screen) {
            keys.write_all(respond(&screen)).expect("the program reads its keys");
            screens.push(screen);
        }
    }
    drop(end);
    guard.join().expect("no panic");
    (child.wait().expect("the program ends").exit_code(), screens)
}

/// Makes the wearer follow the instruction, which is in the first five lines of the screen. Below it, the remark on a trial that
/// has failed describes all parts of a trial.
fn obey(screen: &str, action: &AtomicU8) {
    let instruction = screen.lines().take(5).collect::<Vec<_>>().join(" ");
    for (words, next) in [("lift both feet", LIFTED), ("stand still", STANDING), ("Walk", WALKING)] {
        if instruction.contains(words) {
            action.store(next, Ordering::Relaxed);
        }
    }
}

/// The text on the screen without its frame and line breaks.
fn words(screen: &str) -> String {
    screen.replace('│', " ").split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Presses Enter if the screen asks for it.
fn enter(screen: &str) -> &'static [u8] {
    if words(screen).contains("Press Enter") { b"\r" } else { b"" }
}

/// The force of the right foot on the screen, N.
fn force_n(screen: &str) -> Option<f64> {
    words(screen).split_once("right foot ")?.1.split(' ').next()?.parse().ok()
}

/// The path of the emulated board's firmware.
fn firmware() -> PathBuf {
    std::env::var_os("PLANTAR_FIRMWARE").expect("PLANTAR_FIRMWARE names the emulated board's firmware").into()
}

/// Starts an emulated insole of this foot. `action` is the wearer's present action; the code of an unloaded cell is [`offset`]
/// times `offset_factor`. `hardware` includes the address of the insole's radio controller, if there is one.
fn board(side: Side, action: &Arc<AtomicU8>, offset_factor: u16, hardware: &Hardware) -> Board {
    let walk = synthetic::walk(&SyntheticWalk { side, steps: 40, ..Default::default() }).recording;
    let standing = synthetic::standing(&SyntheticStanding { side, ..Default::default() });
    let standing_kpa = standing.frame(standing.frames() / 2).to_vec();
    let insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let config = EmulatorConfig { address: [1, 0, 0, 0, 0, 0xc0], ..EmulatorConfig::new(insole.setup) };
    let cells = insole.cells.clone();
    let wearer = Wearer { action: action.clone(), insole, standing_kpa, walk, walked_scans: 0, offset_factor };
    Board::start_with(&firmware(), &config, &cells, Time::Real, wearer, hardware).expect("the board boots")
}

/// Starts an emulated insole with [`board`], without a radio. Also returns the network address of its link, and the connection
/// of the current host.
fn insole(side: Side, action: &Arc<AtomicU8>, offset_factor: u16) -> (Board, String, Cable) {
    let board = board(side, action, offset_factor, &Hardware::default());
    let (address, cable) = forward(&board);
    (board, address, cable)
}

/// The log of an emulated board, for the message of a failure.
fn log(board: &Board) -> String {
    let entries = board.log(&firmware()).expect("the log can be read");
    entries.iter().map(|entry| format!("{entry}\n")).collect()
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_wearer_is_identified_although_the_session_is_interrupted() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().expect("a folder");
    let action = Arc::new(AtomicU8::new(LIFTED));
    let (board, address, cable) = insole(Side::Right, &action, 1);
    let out = folder.path().join("me");
    let (out, steps) = (out.to_str().expect("a path"), STEPS.to_string());
    let arguments = ["identify", "--tcp", &address, "--out", out, "--steps", &steps, "--verify", "4"];

    let obey = |screen: &str| obey(screen, &action);
    let after = format!("{INTERRUPTED_AFTER} of {STEPS}");
    // Before the trial, the wearer rests: stands until the screen shows the changed force, and only then presses the key.
    let mut resting_n = None;
    let mut screens_before_trial = None;
    let mut shown_screens = 0;
    let (status, screens) = run(&arguments, &[], |screen| {
        shown_screens += 1;
        if words(screen).contains("Press Enter to start it") && screens_before_trial.is_none() {
            let (Some(now_n), before_n) = (force_n(screen), resting_n) else { return b"" };
            action.store(STANDING, Ordering::Relaxed);
            resting_n = resting_n.or(Some(now_n));
            if before_n.is_none_or(|before_n: f64| (now_n - before_n).abs() < 50.0) {
                return b"";
            }
            action.store(LIFTED, Ordering::Relaxed);
            screens_before_trial = Some(shown_screens);
        } else {
            obey(screen);
        }
        if screen.contains(&after) { b"q" } else { enter(screen) }
    });
    let text = screens.last().expect("a screen");
    assert!(status == 1 && text.contains("give the same command again"), "{text}\n{}", log(&board));
    let (before, trial) = screens.split_at(screens_before_trial.expect("a question before the trial"));
    let is_shown = |screens: &[String], expected: &str| screens.iter().any(|screen| words(screen).contains(expected));
    assert!(is_shown(before, "open wound") && is_shown(before, "You may stop at any time"));
    assert!(!is_shown(before, "off the floor: "), "the trial begins only with the key");
    assert!(is_shown(trial, "Stand up"), "the session begins with a standing trial");

    // The connection is cut once during the walk.
    let cut_after = format!("{} of {STEPS}", INTERRUPTED_AFTER + 3);
    let mut is_cut = false;
    let (status, screens) = run(&arguments, &[], |screen| {
        obey(screen);
        if screen.contains(&cut_after)
            && !is_cut
            && let Some(host) = cable.lock().expect("no panic").take()
        {
            is_cut = true;
            // This fails if the connection has already ended.
            let _ = host.shutdown(Shutdown::Both);
        }
        enter(screen)
    });
    let text = screens.last().expect("a screen");
    let shown = |words: &str| screens.iter().any(|screen| screen.contains(words));
    assert!(!shown("Stand up"), "the standing trial is not repeated");
    assert!(shown(&after) && shown("verify the result"), "{text}");
    assert!(is_shown(&screens, "stop walking; connection lost"), "{text}");
    assert!(is_shown(&screens, "rest where you like: the steps so far count"), "{text}");
    assert!(
        status == 0 && text.contains("as predicted") && text.contains("The session is complete"),
        "{status}: {text}"
    );

    let side = Path::new(out).join("right");
    for file in [
        "standing.parquet",
        "calibration.csv",
        "walk-000.plantar",
        "walk-001.plantar",
        "verify-000.plantar",
        "params.toml",
        "report.html",
    ] {
        assert!(side.join(file).is_file(), "no {file}");
    }
    assert_offsets(&side.join("calibration.csv"));
    // The pressures of the cells were recorded, too.
    assert!(Recording::read(side.join("cells-000/000")).is_ok_and(|cells| cells.frames() > 100));
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn both_feet_are_identified_without_a_terminal() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().expect("a folder");
    // The thickness of the heel is out of range, so its result is reported as incomplete, as by `plantar fit`.
    let tissue = folder.path().join("tissue.toml");
    std::fs::write(&tissue, "heel = 99\n").expect("written");
    let action = Arc::new(AtomicU8::new(WALKING));
    let feet = [Side::Left, Side::Right].map(|side| insole(side, &action, 0));
    let addresses = feet.each_ref().map(|(_, address, _)| address.as_str());
    let out = folder.path().join("me");
    // A file of an earlier session that cannot be read is named once.
    std::fs::create_dir_all(out.join("left")).expect("made");
    std::fs::write(out.join("left/walk-000.plantar"), "damaged").expect("written");
    let plantar = |addresses: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_plantar"));
        command.args(["identify", "--no-standing", "--steps", "6", "--verify", "2", "--out"]).arg(&out);
        command.arg("--tissue").arg(&tissue);
        for address in addresses {
            command.args(["--tcp", address]);
        }
        command.output().expect("the program starts")
    };
    let output = plantar(&addresses);
    let [text, errors] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).expect("text"));
    assert!(output.status.code() == Some(3) && text.contains("INCOMPLETE"), "{text}{errors}");
    assert_eq!(errors.matches("walk-000.plantar").count(), 1, "{errors}");
    assert_eq!(text.matches("open wound").count(), 1, "{text}");
    for (side, address) in ["left", "right"].into_iter().zip(addresses) {
        assert!(text.contains(&format!("{side}: 6 of 6")), "{text}");
        let parameters = Parameters::read(&out.join(side).join("params.toml")).expect("parameters");
        let link = TcpStream::connect(address).expect("the insole");
        link.set_read_timeout(Some(READ_TIMEOUT)).expect("a time");
        let mut client = Client::connect(Framed::new(link), ReconnectPolicy::STREAM.answer).expect("a session");
        assert_eq!(client.tissue().expect("an answer"), parameters.tissue(), "{side}");
        let identified = client.identified().expect("an answer").expect("the insole knows how it was identified");
        assert_eq!((identified.contact, identified.side.map(Side::name)), (ContactRule::COVERED, Some(side)));
    }
}

/// The computer is the central. Linux's Bluetooth service and both controllers are simulated; the firmware is the real one. The
/// insole restarts within the session, which ends the connection.
#[test]
#[cfg(all(target_os = "linux", feature = "ble"))]
#[ignore = "needs the emulated board's firmware, Python with bumble and a D-Bus daemon: cargo xtask test"]
fn a_wearer_is_identified_over_bluetooth() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().expect("a folder");
    let action = Arc::new(AtomicU8::new(LIFTED));
    let (radio, address, values) = crate::radio::Radio::start("Plantar R");
    let _board = board(Side::Right, &action, 1, &Hardware { hci: Some(address), ..Default::default() });
    let bus = crate::bluez::Bus::start(Some(radio), values);
    let out = folder.path().join("me");
    let out = out.to_str().expect("a path");
    let arguments = ["identify", "--ble", "right", "--out", out, "--steps", "6", "--verify", "2"];
    let (status, screens) = run(&arguments, &bus.environment(), |screen| {
        obey(screen, &action);
        enter(screen)
    });
    let text = screens.last().expect("a screen");
    assert!(
        status == 0 && text.contains("as predicted") && text.contains("The session is complete"),
        "{status}: {text}"
    );
    let side = Path::new(out).join("right");
    assert_offsets(&side.join("calibration.csv"));

    let pulled = folder.path().join("pulled.toml");
    let mut pull = std::process::Command::new(env!("CARGO_BIN_EXE_plantar"));
    pull.args(["params", "pull", "--ble", "right", "--out"]).arg(&pulled).envs(bus.environment());
    assert!(pull.status().expect("the program starts").success());
    let [pulled, identified] =
        [pulled, side.join("params.toml")].map(|path| Parameters::read(&path).expect("parameters").tissue());
    assert_eq!(pulled, identified, "the insole has the parameters that were identified");
}

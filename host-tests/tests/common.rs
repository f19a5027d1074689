//! Shared parts of the tests: programs and data that environment variables name, sessions with boards, replays, computed walks.

use client::{Client, Framed};
use emulator::{Board, Link, SensorFault};
use parameters::{InsoleSize, Parameters};
use plantar::Side;
use plantar::faults::Faults;
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::{Live, Step};
use recording::{Recording, VirtualInsole, synthetic};
use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Longest wait for the insole's answer.
pub const TIMEOUT: Duration = Duration::from_secs(20);

/// Opens a session with the insole on the serial link of a board.
pub fn connect(board: &Board) -> Client<Framed<Link>> {
    connect_within(board, TIMEOUT)
}

/// The same as [`connect`], with `timeout` as the longest wait for the insole's answer.
pub fn connect_within(board: &Board, timeout: Duration) -> Client<Framed<Link>> {
    let mut link = board.link().expect("the board has a link");
    link.set_read_timeout(Some(Duration::from_millis(50))).expect("a timeout");
    Client::connect(Framed::new(link), timeout).expect("the insole answers")
}

/// The firmware of the emulated board.
///
/// # Panics
/// If `PLANTAR_FIRMWARE` does not contain its path.
pub fn firmware() -> PathBuf {
    named_by("PLANTAR_FIRMWARE", "the firmware of the emulated board")
}

/// The folder of the data set SpeedPP2DS.
///
/// # Panics
/// If `PLANTAR_JIKU` does not contain its path.
pub fn jiku() -> PathBuf {
    named_by("PLANTAR_JIKU", "the folder SpeedPP2DS of the package jiku-data")
}

/// The source archive of the package moticon-opengo.
///
/// # Panics
/// If `PLANTAR_MOTICON` does not contain its path.
pub fn moticon() -> PathBuf {
    named_by("PLANTAR_MOTICON", "the source archive of the package moticon-opengo")
}

/// A Python interpreter with smpclient.
///
/// # Panics
/// If `PLANTAR_SMP` does not contain its path.
pub fn smp() -> PathBuf {
    named_by("PLANTAR_SMP", "a Python interpreter with smpclient")
}

/// A Python interpreter with bumble, NumPy and SciPy.
///
/// # Panics
/// If `PLANTAR_PYTHON` does not contain its path.
pub fn python() -> PathBuf {
    named_by("PLANTAR_PYTHON", "a Python interpreter with bumble, NumPy and SciPy")
}

/// Runs a Python program, given by these arguments, with this standard input. Returns its output.
///
/// # Panics
/// If `PLANTAR_PYTHON` does not contain the path of an interpreter, or the program fails.
pub fn run_python(arguments: &[&str], input: &str) -> String {
    let child = Command::new(python()).args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
    let mut child = child.expect("Python can be started");
    child.stdin.take().expect("stdin is piped").write_all(input.as_bytes()).expect("the program reads its input");
    let output = child.wait_with_output().expect("the program ends");
    assert!(output.status.success(), "{arguments:?} failed: {}", output.status);
    String::from_utf8(output.stdout).expect("the program prints text")
}

/// The folder with recordings of people, which are not public.
///
/// # Panics
/// If `PLANTAR_RECORDINGS` does not contain its path.
pub fn recordings() -> PathBuf {
    named_by("PLANTAR_RECORDINGS", "a folder with recordings of people")
}

/// The path in an environment variable. `content` describes the file or folder.
fn named_by(variable: &str, content: &str) -> PathBuf {
    let path = std::env::var_os(variable).map(PathBuf::from);
    path.unwrap_or_else(|| {
        panic!("the environment variable {variable} must contain the path of {content}, see CONTRIBUTING.md")
    })
}

/// The typical parameters of a wearer.
pub fn tissue() -> Tissue {
    Parameters::typical(InsoleSize::default()).tissue()
}

/// Computes live frames and steps from a recording by the insole's code on the host, with typical parameters. `is_missing`
/// selects the frames that the matrix does not deliver, by their numbers.
pub fn replay(recording: &Recording, contact: ContactRule, is_missing: fn(u32) -> bool) -> (Vec<Live>, Vec<Step>) {
    replay_with(recording, contact, is_missing, &[(0, tissue())])
}

/// The same as [`replay`], with parameters that change: each item of `tissues` applies from the live frame with its number on.
pub fn replay_with(
    recording: &Recording,
    contact: ContactRule,
    is_missing: fn(u32) -> bool,
    tissues: &[(usize, Tissue)],
) -> (Vec<Live>, Vec<Step>) {
    let (live, steps, _) = replay_codes(recording, contact, is_missing, tissues, &[]);
    (live, steps)
}

/// Computes live frames, steps and detected faults from a recording with these sensor faults, as [`replay`] does.
pub fn replay_faulty(recording: &Recording, faults: &[SensorFault]) -> (Vec<Live>, Vec<Step>, Faults) {
    replay_codes(recording, ContactRule::COUNTED, |_| false, &[(0, tissue())], faults)
}

fn replay_codes(
    recording: &Recording,
    contact: ContactRule,
    is_missing: fn(u32) -> bool,
    tissues: &[(usize, Tissue)],
    faults: &[SensorFault],
) -> (Vec<Live>, Vec<Step>, Faults) {
    let virtual_insole = VirtualInsole::new(recording, contact, StanceRule::ADAPTIVE);
    let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("a recording's insole is valid");
    let zeros: Vec<u16> = virtual_insole.cells.iter().map(|cell| cell.offset).collect();
    let mut codes = vec![0; virtual_insole.cells.len()];
    let (mut live, mut steps) = (Vec::new(), Vec::new());
    for i in 0..virtual_insole.frames(recording) as u32 {
        if is_missing(i) {
            continue;
        }
        for (_, tissue) in tissues.iter().filter(|(before, _)| *before == live.len()) {
            insole.set_tissue(tissue).expect("the parameters are valid");
        }
        virtual_insole.codes_of(recording, i as usize, &mut codes);
        let t_us = u64::from(i) * u64::from(virtual_insole.setup.period_us);
        faults.iter().for_each(|fault| fault.apply(t_us as f64 / 1e6, &zeros, &mut codes));
        let toe_off = insole.frame(i, &codes);
        live.push(Live::new(live.len() as u32, t_us, insole.loads(), insole.masked(), insole.foot_centre_mm()));
        if toe_off {
            steps.push(Step::new(&insole.whole_step().expect("the insole is set up")));
        }
        // The load bouts are taken because they are numbered together with the steps.
        insole.take_bout();
    }
    (live, steps, insole.faults().clone())
}

/// A computed walk of a left foot.
pub fn synthetic_walk(steps: usize, rate_hz: f64) -> Recording {
    synthetic::walk(&synthetic::SyntheticWalk { steps, rate_hz, side: Side::Left, ..Default::default() }).recording
}

//! Tests `plantar record --cells` with the emulated insole: the recording that the command writes has the same codes, and so the
//! same steps, as the part of the recording that was played into the insole meanwhile.

use crate::board::forward;
use emulation::EmulatorConfig;
use emulator::{Board, Recorded, Time};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use recording::synthetic::{self, SyntheticWalk};
use recording::{Recording, VirtualInsole};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// Number of steps of the walk. The walk is played in real time, so that it continues after the program has connected.
const STEPS: usize = 8;
/// Number of received steps after which the recording ends. Those that the insole had stored before the program connected are
/// among them.
const RECORDED_STEPS: usize = 5;
/// Largest number of recordings. On a busy computer the board may miss a scan, for which the recording has an interpolated frame
/// that is no frame of the walk; then the walk is recorded again.
const ATTEMPTS: usize = 3;

fn plantar(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_plantar")).args(arguments).output().expect("the program starts");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// Replays a recording, and returns the quantities of all regions for each step. `json` is the file that the replay writes.
fn steps(recording: &Path, json: &Path) -> Vec<Value> {
    plantar(&["replay", &recording.to_string_lossy(), "--json", &json.to_string_lossy()]);
    let steps: Value = serde_json::from_slice(&std::fs::read(json).expect("a file")).expect("JSON");
    steps.as_array().expect("steps").iter().map(|step| step["regions"].clone()).collect()
}

/// Plays the walk into an emulated insole, and records its cells to the folder `out`.
fn record(firmware: &Path, walk: &Recording, insole: &VirtualInsole, out: &Path) {
    let played = Recorded::new(walk.clone(), insole.clone());
    let config = EmulatorConfig::new(insole.setup);
    let board = Board::start(firmware, &config, &insole.cells, Time::Real, played).expect("the board boots");
    let (address, _) = forward(&board);
    let (steps, out) = (RECORDED_STEPS.to_string(), out.to_string_lossy());
    let text = plantar(&["record", "--cells", "--bits", "16", "--tcp", &address, "--steps", &steps, "--out", &out]);
    assert!(text.contains("; 0 frames lost on the way, 0 dropped by the insole"), "{text}");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_recording_of_cells_yields_the_steps_of_the_walk() {
    let firmware = std::env::var_os("PLANTAR_FIRMWARE").expect("PLANTAR_FIRMWARE names the emulated board's firmware");
    let firmware = Path::new(&firmware);
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let walk = synthetic::walk(&SyntheticWalk { steps: STEPS, ..Default::default() }).recording;
    let walk = walk.at_rate(100.0).and_then(|walk| walk.binned(240)).expect("a walk for the device");
    let insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let played = all_codes(&insole, &walk);
    let (parts, recording, first) = (0..ATTEMPTS)
        .find_map(|attempt| {
            let out = path(&format!("session-{attempt}"));
            record(firmware, &walk, &insole, &out);
            let parts = out.join("cells/000");
            let recording = Recording::read(&parts).expect("a recording in parts");
            // The recording begins when the program connects. The insole has stored the steps before, and they are sent, too.
            let recorded = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
            let received = &all_codes(&recorded, &recording)[..recording.frames()];
            let first = played.windows(received.len()).position(|frames| frames == received)?;
            Some((parts, recording, first))
        })
        .expect("the recorded frames are successive frames of the walk");
    assert!(recording.source.contains("contact on at 10 kPa"), "{}", recording.source);
    // The steps before a step influence its limits, so only a replay of the same part has the same steps.
    let (t_s, pressure_kpa) = (walk.t_s[first..].to_vec(), walk.pressure_kpa[first * walk.cells()..].to_vec());
    Recording { t_s, pressure_kpa, ..walk }.write(path("walk.parquet")).expect("the walk is written");
    let (original, recorded) = (steps(&path("walk.parquet"), &path("a.json")), steps(&parts, &path("b.json")));
    assert!(recorded.len() >= RECORDED_STEPS - 3, "{} steps", recorded.len());
    assert_eq!(recorded, original[..recorded.len()]);
}

/// The codes of all cells in each frame.
fn all_codes(insole: &VirtualInsole, recording: &Recording) -> Vec<Vec<u16>> {
    let codes = |i| {
        let mut codes = vec![0; recording.cells()];
        insole.codes_of(recording, i, &mut codes);
        codes
    };
    (0..insole.frames(recording)).map(codes).collect()
}

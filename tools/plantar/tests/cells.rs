//! Tests `plantar record --cells` with the emulated insole: the recording that the command writes yields the same steps as the
//! recording that was played into the insole.

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
const STEPS: u32 = 6;

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

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_recording_of_cells_yields_the_steps_of_the_walk() {
    let firmware = std::env::var_os("PLANTAR_FIRMWARE").expect("PLANTAR_FIRMWARE names the emulated board's firmware");
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let walk = synthetic::walk(&SyntheticWalk { steps: STEPS as usize, ..Default::default() }).recording;
    let walk = walk.at_rate(100.0).and_then(|walk| walk.binned(240)).expect("a walk for the device");
    walk.write(path("walk.parquet")).expect("the walk is written");
    let insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let config = EmulatorConfig::new(insole.setup);
    let played = Recorded::new(walk, insole.clone());
    let board =
        Board::start(Path::new(&firmware), &config, &insole.cells, Time::Real, played).expect("the board boots");
    let (address, _) = forward(&board);
    let out = path("session");
    let text = plantar(&[
        "record",
        "--cells",
        "--bits",
        "16",
        "--tcp",
        &address,
        "--steps",
        &STEPS.to_string(),
        "--out",
        &out.to_string_lossy(),
    ]);
    assert!(text.contains("; 0 frames lost on the way, 0 dropped by the insole"), "{text}");

    let parts = out.join("cells/000");
    let recording = Recording::read(&parts).expect("a recording in parts");
    assert!(recording.source.contains("contact on at 10 kPa"), "{}", recording.source);
    let (original, recorded) = (steps(&path("walk.parquet"), &path("a.json")), steps(&parts, &path("b.json")));
    // The recording begins when the program connects and ends with the last step, so the first steps may be missing.
    assert!(recorded.len() as u32 >= STEPS - 3, "{} steps", recorded.len());
    assert!(recorded.iter().all(|step| original.contains(step)), "a recorded step differs from all that were played");
}

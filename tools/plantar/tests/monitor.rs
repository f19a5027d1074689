//! `plantar monitor` on the real firmware in the emulator, through a network bridge.
//!
//! The firmware is the file that `PLANTAR_FIRMWARE` names; without it this test says so and passes.

use emulator::{Board, Recorded, Time};
use plantar::contact::ContactRule;
use plantar::emulation::Head;
use plantar::stance::StanceRule;
use recording::{VirtualInsole, synthetic};
use std::io::copy;
use std::net::{TcpListener, TcpStream};
use std::process::Command;

fn pump(mut from: TcpStream, mut to: TcpStream) {
    // Either end may close first; that ends the pump.
    std::thread::spawn(move || copy(&mut from, &mut to));
}

#[test]
fn monitor_shows_and_stores_the_steps_of_an_insole_on_the_network() {
    let Some(firmware) = std::env::var_os("PLANTAR_FIRMWARE") else {
        println!("skipped: set PLANTAR_FIRMWARE to the emulated board's firmware (`cargo xtask test` does)");
        return;
    };
    let walk = synthetic::walk(&synthetic::SyntheticWalk { steps: 3, ..Default::default() }).recording;
    let worn = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::WALKING);
    let head = Head::new(worn.setup);
    let cells = worn.cells.clone();
    let board =
        Board::start(firmware.as_ref(), &head, &cells, Time::Max, Recorded::new(walk, worn)).expect("the board boots");

    let bridge = TcpListener::bind("127.0.0.1:0").expect("a port");
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("steps.json");
    let monitor = Command::new(env!("CARGO_BIN_EXE_plantar"))
        .args(["monitor", "--steps", "3", "--tcp"])
        .arg(bridge.local_addr().expect("an address").to_string())
        .arg("--json")
        .arg(&json)
        .stdout(std::process::Stdio::piped())
        .spawn()
        .expect("the program starts");
    let (host, _) = bridge.accept().expect("the monitor connects");
    pump(host.try_clone().expect("a socket"), board.link().expect("the link"));
    pump(board.link().expect("the link"), host);
    board.play();
    let output = monitor.wait_with_output().expect("the monitor ends");
    let said = String::from_utf8(output.stdout).expect("text");
    assert!(output.status.success(), "{said}");
    assert!(said.contains("right insole, 240 cells at 100 Hz, emulated board"), "{said}");
    let steps: serde_json::Value = serde_json::from_slice(&std::fs::read(json).expect("a file")).expect("JSON");
    let numbers: Vec<_> = steps.as_array().expect("steps").iter().map(|s| s["step"].as_u64()).collect();
    assert_eq!(numbers, [Some(0), Some(1), Some(2)]);
}

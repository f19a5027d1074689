//! The log of the firmware on the emulated board, which `plantar emulate --log` writes.

use crate::common::{TIMEOUT, connect, firmware, synthetic_walk, tissue};
use emulation::EmulatorConfig;
use emulator::{Board, Faulty, Recorded, SensorFault, Time};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::ToHost;
use recording::VirtualInsole;
use std::time::Instant;

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn the_log_contains_the_state_changes_of_the_firmware_with_their_levels() {
    let firmware = firmware();
    let recording = synthetic_walk(8, 100.0);
    let virtual_insole = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let faults: Vec<SensorFault> = vec!["short-cell:20@1.5".parse().expect("the fault can be parsed")];
    let zeros = virtual_insole.cells.iter().map(|cell| cell.offset).collect();
    let walk =
        Faulty::new(Recorded::new(recording, virtual_insole.clone()), faults, virtual_insole.setup.period_us, zeros);
    let board =
        Board::start(&firmware, &EmulatorConfig::new(virtual_insole.setup), &virtual_insole.cells, Time::Fastest, walk)
            .expect("the board boots");
    let mut client = connect(&board);
    client.set_tissue(&tissue()).expect("the parameters are accepted");
    board.play();
    let (start, mut steps) = (Instant::now(), 0);
    while steps < 4 && start.elapsed() < TIMEOUT {
        if let Some(ToHost::Step(_)) = client.receive().expect("the link works") {
            steps += 1;
        }
    }
    let restart = client.restart(TIMEOUT);

    let log = board.log(&firmware).expect("the log can be decoded");
    log.iter().for_each(|entry| println!("{entry}"));
    assert_eq!(steps, 4, "steps within {TIMEOUT:?}");
    restart.expect("the insole restarts");
    let mut rest = log.iter();
    for (level, beginning) in [
        ("info", "start: firmware "),
        ("info", "storage: boot 1,"),
        ("info", "settings: layout "),
        ("info", "link: a host connects"),
        ("info", "settings: parameters "),
        ("warn", "fault: Short Cell(20)"),
        ("info", "restart: requested by the host"),
        ("info", "start: firmware "),
        ("info", "storage: boot 2,"),
    ] {
        let is_found = rest.any(|entry| entry.level == level && entry.text.starts_with(beginning));
        assert!(is_found, "the log lacks \"{level} {beginning}\" after the previous entry of this list");
    }
}

//! Parameters, identity and steps that the real firmware has stored are available after a restart and after the insole was
//! switched off. Power cuts within write operations are part of `cargo xtask soak`.

use crate::common::{TIMEOUT, connect, firmware, synthetic_walk, tissue};
use emulation::EmulatorConfig;
use emulator::{Board, Hardware, Recorded, Time};
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{Reset, Serial, ToHost};
use recording::VirtualInsole;

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn parameters_identity_and_steps_survive_a_restart_and_a_loss_of_power() {
    let firmware = firmware();
    let walk = synthetic_walk(3, 100.0);
    let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let boot = |flash| {
        let hardware = Hardware { flash, ..Hardware::default() };
        let walk = Recorded::new(walk.clone(), virtual_insole.clone());
        Board::start_with(
            &firmware,
            &EmulatorConfig::new(virtual_insole.setup),
            &virtual_insole.cells,
            Time::Fastest,
            walk,
            &hardware,
        )
        .expect("the board boots")
    };
    let board = boot(None);
    let mut client = connect(&board);
    let serial = Serial::new("P-0001").expect("the serial number is valid");
    client.set_tissue(&tissue()).expect("the request is accepted");
    let identity = client.set_identity(Side::Right, serial).expect("the request is accepted");
    // The stored foot is in force from the next start on.
    assert_eq!((identity.side, identity.serial, client.hello().side), (Side::Right, serial, Side::Left));
    board.play();
    let mut recorded = Vec::new();
    while recorded.len() < 3 {
        if let Some(ToHost::Step(step)) = client.receive().expect("the link works") {
            recorded.push(step);
        }
    }
    // The insole first restarts on command, and then after a loss of power.
    client.restart(TIMEOUT).expect("the insole answers again");
    // A client does not deliver a step twice: a new client receives the steps again.
    client = connect(&board);
    let mut boards = vec![board];
    for boots_since in 1..3 {
        let hello = client.hello().clone();
        assert_eq!((hello.tissue_id, hello.side), (tissue().id, Side::Right));
        assert_eq!(hello.reset, if boots_since == 1 { Reset::Software } else { Reset::Power });
        let mut again = Vec::new();
        while again.len() < 3 {
            if let Some(ToHost::Step(step)) = client.receive().expect("the link works") {
                again.push(step);
            }
        }
        for (recorded, again) in recorded.iter().zip(&again) {
            assert_eq!(*again, plantar::protocol::Step { boots_since, ..*recorded });
        }
        let status = client.status().expect("the insole answers");
        assert_eq!((status.contents.start, status.contents.next_record), (boots_since + 1, 3));
        let flash = boards.pop().expect("a board is on").flash().expect("the chip can be read");
        boards.push(boot(Some(flash)));
        client = connect(&boards[0]);
    }
    assert_eq!(client.identity().expect("the insole answers").serial, serial);
}

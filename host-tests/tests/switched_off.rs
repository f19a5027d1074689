//! The real firmware and its flash chip; power that fails is `cargo xtask soak`'s matter.

mod common;

use client::{Client, Framed};
use common::{firmware, synthetic_walk, tissue};
use emulation::EmulatorConfig;
use emulator::{Board, Hardware, Recorded, Time};
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance::StanceRule;
use plantar::protocol::{Reset, Serial, ToHost};
use recording::VirtualInsole;
use std::net::TcpStream;
use std::time::Duration;

const PATIENCE: Duration = Duration::from_secs(20);

fn session(board: &Board) -> Client<Framed<TcpStream>> {
    let link = board.link().expect("the link is there");
    link.set_read_timeout(Some(Duration::from_millis(50))).expect("a socket takes a time-out");
    Client::connect(Framed::new(link), PATIENCE).expect("the insole answers")
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn what_was_sent_and_walked_is_there_after_a_restart_and_after_a_loss_of_power() {
    let firmware = firmware();
    let walk = synthetic_walk(3, 100.0);
    let worn = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::WALKING);
    let boot = |flash| {
        let hardware = Hardware { flash, ..Hardware::default() };
        let walk = Recorded::new(walk.clone(), worn.clone());
        Board::start_with(&firmware, &EmulatorConfig::new(worn.setup), &worn.cells, Time::Max, walk, &hardware)
            .expect("it boots")
    };
    let board = boot(None);
    let mut client = session(&board);
    let serial = Serial::new("P-0001").expect("printable");
    client.set_tissue(&tissue()).expect("sound");
    let identity = client.set_identity(Side::Right, serial).expect("sound");
    assert_eq!((identity.side, identity.serial, client.hello().side), (Side::Right, serial, Side::Left));
    board.play();
    let mut made = Vec::new();
    while made.len() < 3 {
        if let Some(ToHost::Step(step)) = client.receive().expect("the link holds") {
            made.push(step);
        }
    }
    // By command, then by the switch.
    client.restart(PATIENCE).expect("it is back");
    // One who knows the steps already would not get them again.
    client = session(&board);
    let mut boards = vec![board];
    for boots_since in 1..3 {
        let hello = client.hello().clone();
        assert_eq!((hello.tissue_id, hello.side), (tissue().id, Side::Right));
        assert_eq!(hello.reset, if boots_since == 1 { Reset::Software } else { Reset::Power });
        let mut again = Vec::new();
        while again.len() < 3 {
            if let Some(ToHost::Step(step)) = client.receive().expect("the link holds") {
                again.push(step);
            }
        }
        for (made, again) in made.iter().zip(&again) {
            assert_eq!(*again, plantar::protocol::Step { boots_since, ..*made });
        }
        let status = client.status().expect("an answer");
        assert_eq!((status.contents.start, status.contents.next_step), (boots_since + 1, 3));
        let flash = boards.pop().expect("one is on").flash().expect("the chip can be read");
        boards.push(boot(Some(flash)));
        client = session(&boards[0]);
    }
    assert_eq!(client.identity().expect("an answer").serial, serial);
}

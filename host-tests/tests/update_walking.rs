//! During the transfer of an update in a walk in real time, no live frame and no step is lost. An emulator on a busy computer
//! misses scans, and leaves scans out because processing is late (overrun), also without an update. So their numbers are printed
//! and not checked; that the transfer delays no scan is shown in virtual time, by the scenario `update_in_a_walk`.
//! `cargo xtask test` runs at most one other test beside this one, because more of them would disturb the walk.

use crate::common::{connect, firmware, synthetic_walk};
use client::{Client, Framed};
use emulation::EmulatorConfig;
use emulator::{Board, Looped, Recorded, Time};
use firmware_image::{Image, development_key, flash_image};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::update::{Progress, Request};
use plantar::protocol::{LoadRecord, Status, ToDevice, ToHost};
use recording::VirtualInsole;

/// Number of chunks that are transferred. A part of the image is enough.
const CHUNKS: u16 = 300;

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_transfer_during_a_walk_loses_no_frame_and_no_step() {
    let firmware = firmware();
    let walk = synthetic_walk(8, 100.0);
    let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let (config, cells) = (EmulatorConfig::new(virtual_insole.setup), virtual_insole.cells.clone());
    let walk = Looped(Recorded::new(walk, virtual_insole));
    let board = Board::start(&firmware, &config, &cells, Time::Real, walk).expect("the board boots");
    let mut session = connect(&board);
    session.stream().expect("the stream starts");

    let secret = development_key().expect("the development key is valid");
    let image =
        Image::sign(flash_image(&firmware).expect("the firmware is built"), &secret).expect("the image has a header");
    let mut offer = image.offer();
    // Only the beginning of the image is sent, without the request to check it. The insole therefore does not restart, and its
    // counters can be read.
    offer.chunks = CHUNKS;
    let mut numbers = Vec::new();
    let mut progress = session.update(Request::Begin(offer));
    while let Ok(Progress::Next(number @ 0..CHUNKS)) = progress {
        progress = session.update(Request::Chunk { number, chunk: image.chunk(number) });
    }
    assert!(matches!(progress, Ok(Progress::Next(CHUNKS))), "{progress:?}");
    // Messages that arrived during the transfer are queued in the client, and are returned before the status.
    session.send(ToDevice::GetStatus).expect("the link works");
    let status = loop {
        if let Some(status) = receive(&mut session, &mut numbers) {
            break status;
        }
    };
    let counters = session.counters();
    println!(
        "{} chunks during {} frames and {} steps; live frames lost {}, scans missed {}, overrun {}; stack {} bytes",
        offer.chunks,
        status.frames,
        status.steps,
        counters.frames_lost,
        status.frames_missed,
        status.frames_overrun,
        status.stack_bytes
    );
    assert_eq!((counters.frames_lost, counters.crc_errors, status.records_dropped), (0, 0, 0));
    // Steps and load bouts are numbered together. Some of them may still be on the insole.
    let received = numbers.len() as u32;
    assert!(status.steps > 0 && received > 0 && numbers.iter().copied().eq(0..received), "{numbers:?}");
}

/// Receives a message; returns it if it is a status. Acknowledges a load record, and adds its number to `numbers`.
fn receive(session: &mut Client<Framed<emulator::Link>>, numbers: &mut Vec<u32>) -> Option<Status> {
    match session.receive().expect("the link works")? {
        ToHost::Status(status) => return Some(status),
        ToHost::Hello(hello) => panic!("the insole restarted: {hello:?}"),
        message => {
            if let Some(record) = LoadRecord::of(&message) {
                session.send(ToDevice::Acknowledge { number: record.number() }).expect("the link works");
                numbers.push(record.number());
            }
        }
    }
    None
}

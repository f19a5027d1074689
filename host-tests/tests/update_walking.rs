//! An update that arrives in real time while the insole is walked in costs no frame. Scans that the busy emulator leaves out, with or
//! without an update, are printed and not judged. Alone in its file, because other tests beside it
//! would be measured too.

mod common;

use client::{Client, Framed};
use common::{firmware, synthetic_walk};
use emulation::EmulatorConfig;
use emulator::{Board, Looped, Recorded, Time};
use firmware_image::{Image, development_key, flash_image};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance::StanceRule;
use plantar::protocol::update::{Progress, Request};
use plantar::protocol::{Status, ToDevice, ToHost};
use recording::VirtualInsole;
use std::time::Duration;

/// Of the image: a good part is enough.
const CHUNKS: u16 = 300;

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_transfer_beside_walking_loses_no_frame_and_no_step() {
    let firmware = firmware();
    let walk = synthetic_walk(8, 100.0);
    let worn = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::WALKING);
    let (head, cells) = (EmulatorConfig::new(worn.setup), worn.cells.clone());
    let walk = Looped(Recorded::new(walk, worn));
    let board = Board::start(&firmware, &head, &cells, Time::Real, walk).expect("it boots");
    let link = board.link().expect("the link is there");
    link.set_read_timeout(Some(Duration::from_millis(50))).expect("a socket takes a time-out");
    let mut session = Client::connect(Framed::new(link), Duration::from_secs(20)).expect("the insole answers");
    session.stream().expect("the stream starts");

    let secret = development_key().expect("it is there");
    let image = Image::sign(flash_image(&firmware).expect("it is built"), &secret).expect("it has a header");
    let mut offer = image.offer();
    // Looked through and refused at the end: so frames can be counted afterwards.
    offer.chunks = CHUNKS;
    let mut steps = Vec::new();
    let mut request = Request::Begin(offer);
    while let Ok(Progress::Next(number)) = session.update(request) {
        request = match number < offer.chunks {
            true => Request::Chunk { number, chunk: image.chunk(number) },
            false => Request::Finish,
        };
    }
    assert_eq!(request, Request::Finish);
    // What came meanwhile waits in the session, and the answer comes after it.
    session.send(ToDevice::GetStatus).expect("the link holds");
    let status = loop {
        if let Some(status) = take(&mut session, &mut steps) {
            break status;
        }
    };
    let counters = session.counters();
    println!(
        "{} chunks beside {} frames and {} steps; live frames lost {}, scans left out {}, overrun {}; stack {} bytes",
        offer.chunks,
        status.frames,
        status.steps,
        counters.frames_lost,
        status.frames_missed,
        status.frames_overrun,
        status.stack_bytes
    );
    assert_eq!((counters.frames_lost, counters.crc_errors, status.frames_overrun, status.steps_dropped), (0, 0, 0, 0));
    assert!(status.steps > 0 && steps.windows(2).all(|pair| pair[1] == pair[0] + 1), "{steps:?}");
}

/// Receives a message; a status, where it is one.
fn take(session: &mut Client<Framed<std::net::TcpStream>>, steps: &mut Vec<u32>) -> Option<Status> {
    match session.receive().expect("the link holds")? {
        ToHost::Step(step) => {
            session.send(ToDevice::Acknowledge { step: step.step }).expect("the link holds");
            steps.push(step.step);
        }
        ToHost::Status(status) => return Some(status),
        ToHost::Hello(hello) => panic!("it restarted: {hello:?}"),
        _ => {}
    }
    None
}

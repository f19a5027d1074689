//! The stream of all cells. Through the emulated board and its link, the received codes equal those of the walk, and a rate
//! that the port cannot carry is refused. On a host board in virtual time, a rate that Bluetooth cannot carry is refused, too,
//! and a stream with `every` 0 has the cells of all frames.

use crate::common::{TIMEOUT, connect, firmware, synthetic_walk, tissue};
use client::{Client, Error, StartedCells};
use emulation::EmulatorConfig;
use emulator::{Board, Recorded, Time};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::session::Session;
use plantar::protocol::{CellStream, MAJOR, MAX_MESSAGE, MINOR, Refusal, Resolution, Status, ToDevice, ToHost, decode};
use recording::{StreamedCells, VirtualInsole};
use std::cell::RefCell;
use std::rc::Rc;
use testkit::host::{Link, LinkKind};
use testkit::world::World;

/// Number of steps of the walk, which takes a little more than a minute.
const STEPS: usize = 57;

/// One minute at 100 Hz, with live frames and steps beside the cells.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn every_cell_of_every_frame_arrives_in_either_resolution() {
    let walk = synthetic_walk(STEPS, 100.0);
    let insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    // Each resolution, and the bits of a code that it transmits.
    for (resolution, mask) in [(Resolution::Converter, 0xfff0), (Resolution::Oversampled, 0xffff)] {
        let board = Board::start(
            &firmware(),
            &EmulatorConfig::new(insole.setup),
            &insole.cells,
            Time::Fastest,
            Recorded::new(walk.clone(), insole.clone()),
        )
        .expect("the board boots");
        let mut client = connect(&board);
        client.set_tissue(&tissue()).expect("typical parameters are valid");
        client.stream().expect("the live stream starts");
        let stream = CellStream { resolution, every: 1 };
        let StartedCells { setup, cells, mut receiver } = client.start_cells(stream).expect("the port is fast enough");
        assert_eq!((setup, &cells), (insole.setup, &insole.cells));
        let mut streamed = StreamedCells::new(setup, cells, stream.every);
        let (mut codes, mut expected) = (vec![0; insole.cells.len()], vec![0; insole.cells.len()]);
        let frames = insole.frames(&walk);
        board.play();
        while (receiver.received as usize) < frames {
            match client.receive().expect("the link works") {
                Some(ToHost::Cells(frame)) => {
                    assert!(receiver.frame(&frame), "frame {} cannot be unpacked", frame.sequence);
                    insole.codes_of(&walk, frame.scan as usize, &mut expected);
                    expected.iter_mut().for_each(|code| *code &= mask);
                    assert_eq!(receiver.codes(), expected, "scan {}", frame.scan);
                    streamed.push(frame.scan, receiver.codes());
                }
                Some(ToHost::Step(step)) => {
                    client.send(ToDevice::Acknowledge { number: step.step }).expect("the link works")
                }
                _ => {}
            }
        }
        assert_eq!((receiver.lost, receiver.dropped), (0, 0));
        assert!(frames >= 6_000, "{frames} frames");
        let status = client.status().expect("the insole answers");
        assert_eq!((status.frames_missed, status.frames_overrun, status.steps), (0, 0, STEPS as u32));
        let counters = client.counters();
        assert_eq!((counters.frames_received as usize, counters.frames_lost), (frames, 0));

        // The pressures of the recording, converted to codes again, give the codes that were streamed.
        let recording = streamed.take("Recorded in a test").expect("there are frames");
        let again = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
        for i in 0..recording.frames() {
            again.codes_of(&recording, i, &mut codes);
            insole.codes_of(&walk, i, &mut expected);
            expected.iter_mut().for_each(|code| *code &= mask);
            assert_eq!(codes, expected, "frame {i} of the recording");
        }
    }
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_rate_that_the_port_cannot_carry_is_refused_with_the_highest_that_it_can() {
    let walk = synthetic_walk(1, 400.0);
    let insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let config = EmulatorConfig::new(insole.setup);
    let board = Board::start(&firmware(), &config, &insole.cells, Time::Fastest, Recorded::new(walk, insole.clone()))
        .expect("the board boots");
    let mut client = connect(&board);
    let request = |every| Some(CellStream { resolution: Resolution::Converter, every });
    let Err(Error::Refused(Refusal::CellRate { every })) = client.stream_cells(request(1)) else {
        panic!("must be refused: 400 frames a second with 240 cells each do not fit into 46,080 bytes a second")
    };
    assert_eq!(every, 11);
    client.stream_cells(request(every)).expect("the rate that was offered is accepted");
}

/// The link carries 133 values a second: four in each 30 ms. Of these, 100 live frames take 100, and frames of cells, assumed to
/// have 238 bytes, one each.
#[test]
fn bluetooth_carries_every_fourth_frame_of_cells_and_refuses_every_frame() {
    let world = Rc::new(RefCell::new(World::new(1, 100.0)));
    let link = Link::open(&world, 0, LinkKind::Bluetooth).expect("the insole is in range");
    let mut client = Client::connect(link, TIMEOUT).expect("the insole answers");
    let request = |every| Some(CellStream { resolution: Resolution::Converter, every });
    let Err(Error::Refused(Refusal::CellRate { every })) = client.stream_cells(request(1)) else {
        panic!("every frame must be refused")
    };
    assert_eq!(every, 4);
    client.stream_cells(request(4)).expect("every fourth frame is accepted");
}

/// A missed scan must not shift the following ones: a host interpolates frames only at the distance of the stream. Only after two
/// successive scans of the stream were missed, here 34 and 37, the next scan is sent at once.
#[test]
fn a_missed_scan_does_not_shift_the_stream() {
    let mut session = Session::new();
    session.set_layout(testkit::SETUP, &[], None);
    session.receive(ToDevice::Connect { major: MAJOR, minor: MINOR }, 0);
    let stream = CellStream { resolution: Resolution::Converter, every: 3 };
    session.receive(ToDevice::StreamCells(Some(stream)), 0);
    let (mut buffer, mut scans) = ([0; MAX_MESSAGE], Vec::new());
    for scan in (10..40).filter(|scan| ![12, 16, 26, 27, 28, 34, 37].contains(scan)) {
        session.push_cells(scan, &[0; 240]);
        while let Some(message) = session.next(&testkit::hello(), Status::default, &mut buffer) {
            if let Some(ToHost::Cells(frame)) = decode(message) {
                scans.push(frame.scan);
            }
        }
    }
    assert_eq!(scans, [10, 13, 19, 22, 25, 31, 38]);
}

#[test]
fn a_cell_stream_with_every_0_has_the_cells_of_all_frames() {
    let world = Rc::new(RefCell::new(World::new(1, 100.0)));
    let link = Link::open(&world, 0, LinkKind::Serial).expect("the cable is connected");
    let mut client = Client::connect(link, TIMEOUT).expect("the insole answers");
    let stream = CellStream { resolution: Resolution::Converter, every: 0 };
    client.stream_cells(Some(stream)).expect("the port is fast enough");
    let mut scans = Vec::new();
    while scans.len() < 3 {
        if let Some(ToHost::Cells(frame)) = client.receive().expect("the link works") {
            scans.push(frame.scan);
        }
    }
    assert!(scans.windows(2).all(|pair| pair[1] == pair[0] + 1), "{scans:?}");
}

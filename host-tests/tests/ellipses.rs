//! The stream of ellipses through the firmware's loops on a host in virtual time, with the real client, and through the emulated
//! board.

use crate::common::{connect, firmware, synthetic_walk};
use client::{Client, Error};
use emulation::EmulatorConfig;
use emulator::{Board, Recorded, Time};
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::ellipse::Ellipse;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{ContactEllipse, Ellipses, LoadRecord, Refusal, ToDevice, ToHost};
use recording::VirtualInsole;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::time::Duration;
use testkit::host::{Link, LinkKind};
use testkit::virtual_time::now_us;
use testkit::world::{InsoleEvent, SharedWorld, World};

const STEPS: u32 = 6;
/// Time between two frames of the insole, us.
const PERIOD_US: u64 = 10_000;
/// The ellipses of every fourth frame are sent: 25 Hz.
const EVERY: u8 = 4;

/// A left insole that scans 100 times a second, and a host with a live stream over this link.
fn session(over: LinkKind) -> (SharedWorld, Client<Link>) {
    let world = Rc::new(RefCell::new(World::new(1, 1e6 / PERIOD_US as f64)));
    world.borrow_mut().run_for(500_000);
    // From now on, the pipeline that is the reference for this boot also stores the ellipses of each frame.
    world.borrow().insoles[0].boots[0].reference.borrow_mut().ellipses = Some(BTreeMap::new());
    let link = Link::open(&world, 0, over).expect("the insole is on");
    let mut client = Client::connect(link, Duration::from_secs(2)).expect("the insole answers");
    client.stream().expect("the insole answers");
    (world, client)
}

/// The wearer walks; returns the ellipses that arrive until all steps have arrived.
fn walk(world: &SharedWorld, client: &mut Client<Link>) -> Vec<Ellipses> {
    world.borrow_mut().schedule(now_us(), 0, InsoleEvent::Walk { steps: STEPS });
    let (mut ellipses, mut steps) = (Vec::new(), 0);
    while steps < STEPS {
        match client.receive().expect("the link works") {
            Some(ToHost::Ellipses(message)) => ellipses.push(message),
            Some(message) if let Some(record) = LoadRecord::of(&message) => {
                steps += u32::from(record.step().is_some());
                client.send(ToDevice::Acknowledge { number: record.number() }).expect("the link works");
            }
            _ => {}
        }
    }
    ellipses
}

/// Asserts that each number of a received ellipse differs from the expected one by at most half of its unit in the message.
/// `None` stands for a region without contact.
fn assert_equal(got: &ContactEllipse, expected: Option<Ellipse<f32>>, frame: u32) {
    let Some(expected) = expected else { return assert_eq!(*got, ContactEllipse::default(), "frame {frame}") };
    let near = |got: f64, expected: f32, unit: f64| (got - f64::from(expected)).abs() <= 0.5001 * unit;
    assert!(
        near(got.x_mm(), expected.x_mm, 0.1)
            && near(got.y_mm(), expected.y_mm, 0.1)
            && near(got.r_a_mm(), expected.r_a_mm, 0.01)
            && near(got.r_b_mm(), expected.r_b_mm, 0.01)
            && near(got.angle_deg(), expected.angle_deg(), 0.1),
        "frame {frame}: {got:?}, {expected:?}"
    );
}

#[test]
fn the_streamed_ellipses_are_those_of_their_frames() {
    for over in [LinkKind::Serial, LinkKind::Bluetooth] {
        let (world, mut client) = session(over);
        let refused = client.stream_ellipses(EVERY - 1);
        assert!(matches!(refused, Err(Error::Refused(Refusal::EllipseRate { every: EVERY }))), "{refused:?}");
        assert_eq!(walk(&world, &mut client), [], "there must be no stream yet");

        client.stream_ellipses(EVERY).expect("25 Hz are accepted");
        let streamed = walk(&world, &mut client);
        let reference = world.borrow().insoles[0].boots[0].reference.clone();
        let expected = reference.borrow_mut().ellipses.take().expect("the reference collects ellipses");
        let frame = |message: &Ellipses| (message.t_us / PERIOD_US) as u32;
        for (i, message) in streamed.iter().enumerate() {
            assert_eq!(
                (message.sequence, frame(message)),
                (i as u32, frame(&streamed[0]) + i as u32 * u32::from(EVERY))
            );
            for (got, expected) in message.regions.iter().zip(expected[&frame(message)]) {
                assert_equal(got, expected, frame(message));
            }
        }
        // A walk of six steps takes more than six seconds, and loads each region.
        assert!(streamed.len() > 6 * 25, "{} messages", streamed.len());
        for region in 0..8 {
            assert!(streamed.iter().any(|message| message.regions[region].r_a_cmm > 0), "region {region}");
        }

        client.stream_ellipses(0).expect("the stream ends");
        let ended_us = client.device_us().expect("the insole answers");
        assert!(walk(&world, &mut client).iter().all(|message| message.t_us <= ended_us), "the stream must have ended");
        let counters = client.counters();
        assert_eq!((counters.frames_lost, counters.crc_errors), (0, 0));
    }
}

#[test]
fn a_link_that_is_too_slow_for_ellipses_loses_no_step_and_no_live_frame() {
    let (world, mut client) = session(LinkKind::Serial);
    // Live frames need 9 kB/s, and ellipses 2.5 kB/s.
    world.borrow().insoles[0].cable.borrow_mut().byte_us = 1e6 / 10_500.0;
    client.stream_ellipses(EVERY).expect("25 Hz are accepted");
    let streamed = walk(&world, &mut client);
    let status = client.status().expect("the insole answers");
    assert_eq!((status.steps, status.records_dropped), (STEPS, 0));
    assert_eq!(client.counters().frames_lost, 0);
    // The insole replaces messages that could not be sent by newer ones.
    let last = streamed.last().expect("ellipses arrive").sequence;
    assert!(streamed.len() > 10 && (streamed.len() as u32) < last, "{} of {last}", streamed.len());
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn the_emulated_board_streams_the_ellipses_of_its_frames() {
    let recording = synthetic_walk(3, 1e6 / PERIOD_US as f64);
    let virtual_insole = VirtualInsole::new(&recording, ContactRule::COVERED, StanceRule::ADAPTIVE);
    let played = Recorded::new(recording.clone(), virtual_insole.clone());
    let config = EmulatorConfig::new(virtual_insole.setup);
    let board =
        Board::start(&firmware(), &config, &virtual_insole.cells, Time::Fastest, played).expect("the board boots");
    let mut client = connect(&board);
    client.stream_ellipses(EVERY).expect("25 Hz are accepted");
    board.play();
    let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("the insole is valid");
    let (mut codes, mut next, mut steps, mut in_contact) = (vec![0; virtual_insole.cells.len()], 0, 0, 0);
    while steps < 3 {
        match client.receive().expect("the link works") {
            Some(ToHost::Ellipses(message)) => {
                let frame = (message.t_us / PERIOD_US) as u32;
                for frame in next..=frame {
                    virtual_insole.codes_of(&recording, frame as usize, &mut codes);
                    insole.frame(frame, &codes);
                }
                next = frame + 1;
                for (region, got) in message.regions.iter().enumerate() {
                    assert_equal(got, insole.ellipse(region), frame);
                    in_contact += u32::from(got.r_a_cmm > 0);
                }
            }
            Some(ToHost::Step(_)) => steps += 1,
            _ => {}
        }
    }
    assert!(in_contact > 100, "{in_contact} ellipses");
}

//! The stream of all cells over Bluetooth in real time, beside live frames: every frame that arrives has the codes that were
//! played. The rate is printed and not checked, because it depends on the host machine as much as on the insole.
//!
//! `cargo xtask test` runs at most one other test beside this one, because more of them would disturb the walk.

use crate::common::{firmware, synthetic_walk};
use crate::phones::{RadioSimulation, boot};
use client::CellReceiver;
use emulator::{Looped, Recorded, Time};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{CellStream, MAX_MESSAGE, Refusal, Resolution, ToDevice, ToHost, encode};
use recording::VirtualInsole;
use std::time::Instant;

/// Number of scans in which the stream is followed: half a minute.
const SCANS: u32 = 3_000;

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn the_cells_that_arrive_over_bluetooth_are_those_that_were_played() {
    let walk = synthetic_walk(8, 100.0);
    let insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let frames = insole.frames(&walk);
    let mut radio = RadioSimulation::start();
    let played = Looped(Recorded::new(walk.clone(), insole.clone()));
    let _board = boot(&mut radio, &firmware(), &insole, Time::Real, played, |_| {}, None);
    let mut phone = radio.bonded_phone(1, "Plantar L", 247);

    // A rate that the connection cannot carry beside live frames is refused with the highest one that it can carry.
    let mut stream = CellStream { resolution: Resolution::Converter, every: 1 };
    let refused = phone.answer(&mut radio, ToDevice::StreamCells(Some(stream)));
    assert_eq!(refused, ToHost::Refused(Refusal::CellRate { every: 4 }));
    stream.every = 4;
    phone.send(&mut radio, ToDevice::Stream { live: true });
    assert_eq!(phone.answer(&mut radio, ToDevice::StreamCells(Some(stream))), ToHost::CellStream(Some(stream)));

    let mut receiver = CellReceiver::new(&stream, insole.cells.len());
    let mut expected = vec![0; insole.cells.len()];
    let (mut first, mut bytes, mut live) = (None, 0, 0);
    loop {
        let (arrival, message) = phone.next_with_arrival(&mut radio);
        match &message {
            ToHost::Cells(frame) => {
                let (first_scan, start) = *first.get_or_insert((frame.scan, arrival));
                assert!(receiver.frame(frame), "frame {} cannot be unpacked", frame.sequence);
                insole.codes_of(&walk, frame.scan as usize % frames, &mut expected);
                // `Resolution::Converter` transmits the upper 12 bits of a code.
                expected.iter_mut().for_each(|code| *code &= 0xfff0);
                assert_eq!(receiver.codes(), expected, "scan {}", frame.scan);
                bytes += encode(&message, &mut [0; MAX_MESSAGE]).expect("a received message fits").len();
                if frame.scan - first_scan >= SCANS {
                    print(&receiver, live, bytes, start, arrival);
                    break;
                }
            }
            ToHost::Live(_) if first.is_some() => live += 1,
            ToHost::Live(_) => {}
            ToHost::Step(step) => phone.send(&mut radio, ToDevice::Acknowledge { number: step.step }),
            other => panic!("{other:?}"),
        }
    }
    // On a link without loss, the insole itself drops the scans for which the link is too slow, and counts them.
    assert_eq!(receiver.lost, 0);
    assert_eq!(phone.answer(&mut radio, ToDevice::StreamCells(None)), ToHost::CellStream(None));
}

/// Prints the rates of a stream.
fn print(receiver: &CellReceiver, live: u32, bytes: usize, start: Instant, end: Instant) {
    let seconds = end.duration_since(start).as_secs_f64();
    println!(
        "{:.1} frames of all cells a second with {:.0} bytes each, {:.1} kB/s, beside {:.1} live frames; {} scans dropped in \
         {seconds:.0} s",
        f64::from(receiver.received) / seconds,
        bytes as f64 / f64::from(receiver.received),
        bytes as f64 / seconds / 1e3,
        f64::from(live) / seconds,
        receiver.dropped,
    );
}

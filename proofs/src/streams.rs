//! The streams of cells and of ellipses.

use plantar::Side;
use plantar::pipeline::calibrate::SensorLaw;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::Setup;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::session::Session;
use plantar::protocol::{
    CellCoder, CellStream, ContactEllipse, Ellipses, MAJOR, MAX_MESSAGE, MINOR, Refusal, Resolution, Status, ToDevice,
    ToHost, decode,
};

use crate::acknowledgement::hello;

/// Number of packed frames that can wait for the carrier.
const QUEUE: usize = 3;

fn next(session: &mut Session) -> Option<ToHost> {
    let mut buffer = [0; MAX_MESSAGE];
    session.next(&hello(), Status::default, &mut buffer).map(|bytes| decode(bytes).expect("a message"))
}

/// A session of an insole with this time between frames, us; a host is connected and has received the hello.
fn session(period_us: u32) -> Session {
    let mut session = Session::new();
    let sensor = SensorLaw { full_kpa: 1000.0, exponent: 1.0 };
    let (contact, stance) = (ContactRule::COUNTED, StanceRule::ADAPTIVE);
    session.set_layout(Setup { side: Side::Left, layout_id: 1, period_us, sensor, contact, stance }, &[], None);
    session.receive(ToDevice::Connect { major: MAJOR, minor: MINOR }, 0);
    assert!(matches!(next(&mut session), Some(ToHost::Hello(_))));
    session
}

/// Of each `every` frames of cells (0 stands for 1), the first is sent; it is dropped and counted if three frames wait already.
/// In `events`, true is a new frame, and false is a message that the carrier takes.
pub fn cells(every: u8, events: &[bool]) {
    let mut session = session(10_000);
    let stream = CellStream { resolution: Resolution::Oversampled, every };
    session.receive(ToDevice::StreamCells(Some(stream)), 0);
    assert_eq!(next(&mut session), Some(ToHost::CellStream(Some(stream))));
    let mut host = CellCoder::new(stream.resolution);
    let (mut waiting, mut scan, mut sequence, mut dropped) = (Vec::new(), 0, 0, 0);
    for &is_frame in events {
        if is_frame {
            session.push_cells(scan, &[scan as u16 * 7, 500]);
            if scan.is_multiple_of(u32::from(every.max(1))) {
                if waiting.len() == QUEUE {
                    dropped += 1;
                } else {
                    waiting.push((scan, sequence, dropped));
                    sequence += 1;
                }
            }
            scan += 1;
        } else {
            let due = (!waiting.is_empty()).then(|| waiting.remove(0));
            let sent = match next(&mut session) {
                Some(ToHost::Cells(frame)) => {
                    let mut codes = [0; 2];
                    assert!(host.unpack(&frame, &mut codes).is_some());
                    assert_eq!(codes, [frame.scan as u16 * 7, 500]);
                    Some((frame.scan, frame.sequence, frame.dropped))
                }
                None => None,
                other => panic!("not a frame of cells: {other:?}"),
            };
            assert_eq!(sent, due);
        }
    }
}

/// Of each `every` frames, the ellipses of the first are due, and the newest due ellipses are sent; a rate above 25 Hz is
/// refused, unless it is the lowest one, one frame in 255. `period_us` is the time between frames. The carrier takes a message
/// after frame `n` if bit `n` modulo 32 of `taken` is set.
pub fn ellipses(every: u8, period_us: u32, frames: u32, taken: u32) {
    let mut session = session(period_us);
    session.receive(ToDevice::StreamEllipses { every }, 0);
    // 25 Hz is one frame in 40,000 us.
    let least = (1..=255).find(|&least: &u32| u64::from(least) * u64::from(period_us.max(1)) >= 40_000).unwrap_or(255);
    let is_refused = every > 0 && u32::from(every) < least;
    let answer = is_refused.then_some(ToHost::Refused(Refusal::EllipseRate { every: least as u8 }));
    assert_eq!(next(&mut session), answer);
    assert_eq!(session.ellipses.every(), if is_refused { 0 } else { every });
    let (mut sequence, mut newest) = (0, None);
    for frame in 0..frames {
        let is_due = every > 0 && !is_refused && frame.is_multiple_of(every.into());
        assert_eq!(session.ellipses.due(), is_due.then_some(sequence));
        if is_due {
            let regions = [(); 8].map(|()| ContactEllipse::new::<f32>(None));
            let ellipses = Ellipses { sequence, t_us: frame.into(), regions };
            session.ellipses.push(ellipses);
            (sequence, newest) = (sequence + 1, Some(ellipses));
        }
        if taken >> (frame % 32) & 1 == 1 {
            assert_eq!(next(&mut session), newest.take().map(ToHost::Ellipses));
        }
    }
}

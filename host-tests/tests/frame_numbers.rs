//! Times of an insole whose frame number wraps, which happens after 497 days at 100 Hz.

use plantar::Side;
use plantar::insole::Insole;
use plantar::pipeline::setup::DEVICE_CELLS;
use std::rc::Rc;
use testkit::walk::{Codes, Wearer};

const PERIOD_US: u64 = 10_000;
const FRAMES: u32 = 1_500;

/// Walks with frame numbers from `first` on. Returns the times of all frames, and the starts of all steps and load bouts.
fn times_us(first: u32) -> (Vec<u64>, Vec<u64>) {
    let mut wearer = Wearer::new(Rc::new(Codes::new(Side::Left, 100.0)));
    let mut insole = Insole::<f32, DEVICE_CELLS>::new();
    insole.set_up(wearer.setup(), wearer.cells()).expect("a computed insole is valid");
    wearer.walk(0, 10);
    let (mut frames_us, mut starts_us, mut codes) = (Vec::new(), Vec::new(), [0; DEVICE_CELLS]);
    for frame in 0..FRAMES {
        let seq = first.wrapping_add(frame);
        wearer.codes_at(u64::from(frame) * PERIOD_US, &mut codes);
        if insole.frame(seq, &codes) {
            starts_us.push(insole.whole_step().expect("the insole is set up").start_us);
        }
        starts_us.extend(insole.take_bout().map(|bout| bout.start_us));
        frames_us.push(insole.time_us(seq));
    }
    (frames_us, starts_us)
}

/// The clock that `GetTime` reads does not wrap, so the times of frames and records must not, either.
#[test]
fn times_continue_after_the_frame_number_has_wrapped() {
    let (frames_us, starts_us) = times_us(0);
    assert!(frames_us.iter().zip(0..).all(|(time_us, frame)| *time_us == frame * PERIOD_US));
    assert!(starts_us.len() > 8, "{starts_us:?}");
    for frames_before in [1, 150, 333, 700, 1_111] {
        let first = u32::MAX - frames_before + 1;
        let later = |times_us: &[u64]| -> Vec<u64> {
            times_us.iter().map(|time_us| time_us + u64::from(first) * PERIOD_US).collect()
        };
        assert_eq!(times_us(first), (later(&frames_us), later(&starts_us)), "{frames_before} frames before the wrap");
    }
}

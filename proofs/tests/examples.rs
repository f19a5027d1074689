//! Most properties, each for a few inputs. `cargo xtask assure` runs this test in Miri, an interpreter that is too slow for all
//! inputs.

use critical_section as _; // links the host's implementation of the critical sections that the firmware uses
use plantar::protocol::{Capacity, Resolution, ToDevice};
use plantar::storage::flash_map::SMALLEST_CHIP;
use proofs::acknowledgement::EVENTS;
use proofs::fragments::Fragment;
use proofs::{acknowledgement, cells, codec, flash, fragments, image, numbers, supervision};

#[test]
fn properties_hold_for_examples() {
    numbers::order(u32::MAX, 2);
    numbers::live_losses(0b1011, 4, 2);
    numbers::fitting_rate(Resolution::Converter, 1, 240, 10_000, Capacity::of_bytes(46_080));
    codec::stream(&[1, 1, 1, 1, 1, 0, 3, 0, 2, 7, 0, 0]);
    for len in [0, 1, 254, 255, 560] {
        codec::framing(&vec![7; len]);
    }
    codec::damage(&[0], [1, 6], [9, 1]);
    assert!(codec::message_of::<ToDevice>(&[0, 3, 0]) && !codec::message_of::<ToDevice>(&[0xff]));
    let part = |number, is_last| Fragment { number: Some(number), is_last, len: 300 };
    fragments::joining(&[part(0, false), part(1, true), part(1, true), part(0, true)]);
    fragments::joining_plain(560, &[300, 260, 1, 560]);
    fragments::splitting(560, 6);
    fragments::disorder(&fragments::split(14, 6), &[0, 2, 0, 1, 2]);
    flash::read(4096..5120, 0, 200, &mut [0; 300]);
    flash::change(4096..5120, 1000, &[0; 30]);
    flash::map(SMALLEST_CHIP, 0);
    image::version("1.22.333+x");
    image::header(&[0xff; 40]);
    acknowledgement::session(u32::MAX, &EVENTS);
    supervision::watchdog(20, |part, check| part as u32 != check % 5);
    cells::packing(Resolution::Oversampled, &[3; 17], &[4000; 17]);
}

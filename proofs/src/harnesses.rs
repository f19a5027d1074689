//! Harnesses with which Kani can prove properties. A harness covers all inputs at once, within the bounds that its comment
//! states, if any.
//!
//! These harnesses have never run; they were only type-checked, with a stub of Kani's functions. Kani's set-up needs Kani's
//! compiler from its release page, and the workflow `.github/workflows/ci.yml`, which runs Kani, has not run yet.

use crate::{codec, flash, fragments, numbers};
use fragments::Fragment;
use plantar::protocol::update::CHUNK;
use plantar::protocol::{Capacity, Resolution};

#[kani::proof]
fn order_of_all_numbers() {
    numbers::order(kani::any(), kani::any());
}

/// Six frames, any of which may be lost.
#[kani::proof]
#[kani::unwind(8)]
fn live_losses() {
    let (arrived, status) = (kani::any_where(|arrived| *arrived < 1 << 6), kani::any_where(|status| *status <= 6));
    numbers::live_losses(arrived, 6, status);
}

/// All frame periods and rates of a carrier of bytes, up to 256 cells with codes of 12 bits, and a request for every frame or for
/// one frame in 251 or more.
#[kani::proof]
#[kani::unwind(257)]
fn fitting_rate_of_cells() {
    let every = kani::any_where(|every| *every <= 1 || *every > 250);
    let cells = kani::any_where(|cells| *cells <= 256);
    numbers::fitting_rate(Resolution::Converter, every, cells, kani::any(), Capacity::of_bytes(kani::any()));
}

/// All streams of seven bytes.
#[kani::proof]
#[kani::unwind(40)]
fn decoder() {
    codec::stream(&kani::any::<[u8; 7]>());
}

/// All sequences of three fragments with up to two bytes of a message each.
#[kani::proof]
#[kani::unwind(6)]
fn joiner() {
    let any_fragment = || Fragment {
        number: kani::any_where(|number: &Option<u8>| number.is_none_or(|number| number < 128)),
        is_last: kani::any(),
        len: kani::any_where(|len| *len <= 2),
    };
    fragments::joining(&[any_fragment(), any_fragment(), any_fragment()]);
}

/// Changes of three bytes, for all areas and offsets.
#[kani::proof]
#[kani::unwind(5)]
fn changes_of_a_partition() {
    let (start, end): (u32, u32) = (kani::any(), kani::any());
    kani::assume(start <= end);
    flash::change(start..end, kani::any(), &[0; 3]);
}

/// Reads of two bytes, which may be in two pages, for all offsets, and for all areas that end at least a page before the largest
/// address.
#[kani::proof]
#[kani::unwind(258)]
fn reads_of_a_partition() {
    let (start, end): (u32, u32) = (kani::any(), kani::any());
    kani::assume(start <= end && end <= u32::MAX - CHUNK as u32);
    flash::read(start..end, kani::any(), kani::any(), &mut [0; 2]);
}

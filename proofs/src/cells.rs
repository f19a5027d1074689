//! The packed codes of a stream of cells.

use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::protocol::{CellCoder, MAX_PACKED, Resolution};

/// Two successive frames with the codes `before` and `after` are unpacked to the same codes, in the resolution of the stream,
/// and no packed frame is longer than [`MAX_PACKED`].
pub fn packing(resolution: Resolution, before: &[u16], after: &[u16]) {
    let (mut packer, mut unpacker) = (CellCoder::new(resolution), CellCoder::new(resolution));
    let mask = u16::MAX << (16 - resolution.bits());
    let mut unpacked = [0; DEVICE_CELLS];
    for codes in [before, after] {
        let frame = packer.pack(0, 0, codes);
        assert!(frame.packed.len() <= MAX_PACKED);
        let unpacked = &mut unpacked[..codes.len()];
        assert!(unpacker.unpack(&frame, unpacked).is_some());
        assert!(codes.iter().zip(unpacked).all(|(code, unpacked)| code & mask == *unpacked));
    }
}

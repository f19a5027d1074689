//! Sequence numbers, the counts of lost frames, and the rate of a stream of cells.

use plantar::protocol::{Capacity, CellStream, LiveCounter, Resolution};
use plantar::sequence::{is_after, skipped};

/// The number that is `distance` ahead of `from` is after it if the distance is from 1 to 2^31 - 1. Then `from` and all numbers
/// up to the later number, exclusive, count as skipped.
pub fn order(from: u32, distance: u32) {
    let to = ((u64::from(from) + u64::from(distance)) % (1 << 32)) as u32;
    let is_ahead = (1..=0x7fff_ffff).contains(&distance);
    assert_eq!(is_after(to, from), is_ahead);
    assert_eq!(skipped(from, to), if is_ahead { distance } else { 0 });
}

/// Of `due` live frames, those with a bit set in `arrived` arrive. The counter reports exactly the other frames as lost once it
/// receives the insole's count of due frames. It receives this count at the end, and also earlier, once `status` frames were
/// due.
pub fn live_losses(arrived: u32, due: u32, status: u32) {
    let mut counter = LiveCounter::NEW;
    for sequence in 0..due {
        if sequence == status {
            counter.due(sequence);
            let received = (arrived & ((1 << sequence) - 1)).count_ones();
            assert_eq!((counter.received, counter.lost), (received, sequence - received));
        }
        if arrived >> sequence & 1 == 1 {
            counter.frame(sequence);
        }
    }
    counter.due(due);
    let received = (arrived & ((1 << due) - 1)).count_ones();
    assert_eq!((counter.received, counter.lost), (received, due - received));
}

/// A stream of cells is sent at the highest rate, not above the requested one, at which the carrier can also send all live
/// frames. One frame in `every` is requested.
pub fn fitting_rate(resolution: Resolution, every: u8, cells: u32, period_us: u32, carrier: Capacity) {
    let frames_per_s = 1_000_000 / u64::from(period_us.max(1));
    // Bytes with the framing of a byte carrier: for a frame of cells 22 plus 60 % of the length of the plain codes, for a live
    // frame 92.
    let frame_bytes = 22 + u64::from(cells) * u64::from(resolution.bits()) * 6 / 80;
    let packets_per_s = u64::from(carrier.packets_per_s);
    // A message takes whole packets.
    let per_s = |bytes: u64| {
        let packet_bytes = u64::from(carrier.packet_bytes);
        (bytes / packet_bytes + u64::from(!bytes.is_multiple_of(packet_bytes))) * frames_per_s
    };
    let (live_per_s, cells_per_s) = (per_s(92), per_s(frame_bytes));
    let fits = |every: u64| live_per_s * every + cells_per_s <= packets_per_s * every;
    let least = (u64::from(every.max(1))..=255).find(|&every| fits(every) && live_per_s < packets_per_s);
    let fitting = CellStream { resolution, every }.fitting(cells, period_us, carrier);
    assert_eq!(fitting.map(u64::from), least);
}

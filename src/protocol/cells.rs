//! The stream of cells: the codes of all cells of a frame, packed without loss.
//!
//! The codes of a frame are coded in groups of [`GROUP`] cells, as differences from the frame before. A group begins with four
//! bits: the width of its differences, 0 for a group without change and [`PLAIN`] for plain codes. Then follows one number for
//! each cell of the group: the numbers 0, 1, 2, 3, ... stand for the differences 0, -1, 1, -2, ... Bits are stored from the
//! least significant bit of a byte on. So cells without change take half a bit each, and loaded cells take about as many bits
//! as their differences need.
//!
//! A frame can only be unpacked after the frame that was packed before it. Every [`KEY_INTERVAL`]th frame is a key frame, which
//! is coded as differences from zero, so that a receiver can begin there, also after a loss.

mod bits;

use crate::pipeline::setup::DEVICE_CELLS;
use bits::{BitReader, BitWriter, unzigzag, zigzag};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Number of cells that share a width.
const GROUP: usize = 8;
/// Value in the place of a width which states that the codes of the group follow as they are, not as differences.
const PLAIN: u32 = 15;
/// Number of bits of a width.
const WIDTH_BITS: u32 = 4;
/// Number of frames from one key frame to the next one.
pub const KEY_INTERVAL: u32 = 64;
/// Longest packed frame, bytes: plain codes of 16 bits, a width for each group, and the rest of the last unit of 16 bits.
pub const MAX_PACKED: usize = 2 * DEVICE_CELLS + DEVICE_CELLS.div_ceil(GROUP) / 2 + 2;
const _: () = assert!(MAX_PACKED.is_multiple_of(2), "whole units of 16 bits");

/// The resolution of the codes in a stream of cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Resolution {
    /// The upper 12 bits of each code.
    Converter,
    /// All 16 bits of each code: on `wb55` the sum of 16 conversions of 12 bits, on `nrf52840` four times a result of 14 bits.
    Oversampled,
}

impl Resolution {
    /// Number of bits of a code.
    pub const fn bits(self) -> u32 {
        match self {
            Self::Converter => 12,
            Self::Oversampled => 16,
        }
    }

    /// Number of low bits of a 16-bit code that are not sent.
    const fn shift(self) -> u32 {
        16 - self.bits()
    }
}

/// Usual number of bytes of a message with cells, beside the packed codes, on a byte carrier: tag, numbers, CRC and COBS.
const OVERHEAD_BYTES: u32 = 22;
/// Length of the longest live frame with a time below 2^56 us on a byte carrier, bytes, with CRC and COBS. Live frames are sent
/// in addition to frames of cells.
const LIVE_BYTES: u32 = 92;

/// What a carrier can send to the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capacity {
    /// Number of packets per second.
    pub packets_per_s: u32,
    /// Number of bytes of messages in a packet, at least 1. A message takes whole packets, however short it is.
    pub packet_bytes: u32,
}

impl Capacity {
    /// The capacity of a carrier of single bytes.
    pub const fn of_bytes(bytes_per_s: u32) -> Self {
        Self { packets_per_s: bytes_per_s, packet_bytes: 1 }
    }
}

/// A stream of cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CellStream {
    /// The resolution of the codes.
    pub resolution: Resolution,
    /// One of every `every` frames is sent; 0 and 1 stand for all frames.
    pub every: u8,
}

impl CellStream {
    /// Number of frames from one that is sent to the next one, at least 1.
    pub fn stride(self) -> u8 {
        self.every.max(1)
    }

    /// Estimated length of a message with a frame of `cells` cells during a stance, bytes. The packed codes are assumed to take
    /// 60 % of the length of plain codes. Longer frames are rare; if the carrier cannot send them in time, scans are dropped.
    const fn frame_bytes(self, cells: u32) -> u32 {
        OVERHEAD_BYTES + cells * self.resolution.bits() * 6 / 10 / 8
    }

    /// The smallest [`CellStream::every`], at least that of this stream, with which a carrier can send the frames of `cells`
    /// cells in addition to the live frames; `None` if it is too slow for any. `period_us` is the time between scans.
    pub fn fitting(self, cells: u32, period_us: u32, carrier: Capacity) -> Option<u8> {
        let frames_per_s = 1_000_000 / period_us.max(1);
        // Numbers of packets.
        let available_per_s =
            carrier.packets_per_s.saturating_sub(LIVE_BYTES.div_ceil(carrier.packet_bytes) * frames_per_s);
        let needed_per_s = self.frame_bytes(cells).div_ceil(carrier.packet_bytes) * frames_per_s;
        let every =
            needed_per_s.checked_div(available_per_s)? + u32::from(!needed_per_s.is_multiple_of(available_per_s));
        u8::try_from(every.max(self.stride().into())).ok()
    }
}

/// All cells of one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellFrame {
    /// Number of the frame in its stream. A gap means that frames were lost on the way; frames can be unpacked again from the
    /// next key frame on.
    pub sequence: u32,
    /// Number of the frame since the start of the insole; frames without a scan count, too. If the number increases by more than
    /// [`CellStream::stride`] without a gap in `sequence`, scans were missed, or dropped because the carrier was too slow.
    pub scan: u32,
    /// Number of scans since the start of the stream that were dropped because the carrier was too slow.
    pub dropped: u32,
    /// Sum of the codes in the resolution of the stream, modulo 2^16: a check that the frame was unpacked correctly, with the
    /// codes of the right previous frame.
    pub sum: u16,
    /// The packed codes.
    #[serde(with = "packed_bytes")]
    pub packed: Vec<u8, MAX_PACKED>,
}

/// Serialises the packed codes as one block of bytes: the same encoding as that of single bytes, with fewer instructions.
mod packed_bytes {
    use super::MAX_PACKED;
    use core::fmt;
    use heapless::Vec;
    use serde::de::{Error, Visitor};
    use serde::{Deserializer, Serializer};

    pub fn serialize<S: Serializer>(packed: &Vec<u8, MAX_PACKED>, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(packed)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<u8, MAX_PACKED>, D::Error> {
        struct Packed;

        impl Visitor<'_> for Packed {
            type Value = Vec<u8, MAX_PACKED>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "at most {MAX_PACKED} bytes")
            }

            fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Self::Value, E> {
                Vec::from_slice(bytes).map_err(|_| E::invalid_length(bytes.len(), &self))
            }
        }

        deserializer.deserialize_bytes(Packed)
    }
}

/// Packs or unpacks the frames of a stream. `codes` are those of the previous frame, in the resolution of the stream; the next
/// frame contains the differences from them.
#[derive(Debug)]
pub struct CellCoder {
    resolution: Resolution,
    codes: [u16; DEVICE_CELLS],
    /// Number of the next frame.
    sequence: u32,
}

impl CellCoder {
    /// A coder at the start of a stream.
    pub const fn new(resolution: Resolution) -> Self {
        Self { resolution, codes: [0; DEVICE_CELLS], sequence: 0 }
    }

    /// Packs the codes of a scan as a frame.
    pub fn pack(&mut self, scan: u32, dropped: u32, codes: &[u16]) -> CellFrame {
        let mut packed = [0; MAX_PACKED];
        let Packed { sequence, sum, len } = self.pack_into(codes, &mut packed);
        let mut packed = Vec::from_array(packed);
        packed.truncate(len);
        CellFrame { sequence, scan, dropped, sum, packed }
    }

    /// Packs the codes of a scan into `packed`.
    pub(super) fn pack_into(&mut self, codes: &[u16], packed: &mut [u8; MAX_PACKED]) -> Packed {
        let sequence = self.sequence;
        if sequence.is_multiple_of(KEY_INTERVAL) {
            self.codes = [0; DEVICE_CELLS];
        }
        self.sequence = sequence.wrapping_add(1);
        // The function is compiled separately for each resolution, so that shifts and widths are constants.
        match self.resolution {
            Resolution::Converter => self.pack_groups::<{ Resolution::Converter.bits() }>(sequence, codes, packed),
            Resolution::Oversampled => self.pack_groups::<{ Resolution::Oversampled.bits() }>(sequence, codes, packed),
        }
    }

    fn pack_groups<const BITS: u32>(&mut self, sequence: u32, codes: &[u16], packed: &mut [u8; MAX_PACKED]) -> Packed {
        let mut writer = BitWriter::new(packed);
        let (groups, last_codes) = codes.as_chunks();
        let (groups_before, _) = self.codes.as_chunks_mut();
        let mut groups_before = groups_before.iter_mut();
        let mut sum = 0u32;
        for (codes, before) in groups.iter().zip(&mut groups_before) {
            sum += pack_group::<BITS>(&mut writer, codes, GROUP, before);
        }
        if let (false, Some(before)) = (last_codes.is_empty(), groups_before.next()) {
            // The codes beyond the last cell are not packed.
            let mut codes = [0; GROUP];
            codes[..last_codes.len()].copy_from_slice(last_codes);
            sum += pack_group::<BITS>(&mut writer, &codes, last_codes.len(), before);
        }
        Packed { sequence, sum: sum as u16, len: writer.finish() }
    }

    /// Unpacks the codes of a frame into `codes`, one for each cell, in 16 bits in either resolution. `None` if the frame does
    /// not continue the stream, or is damaged; the next key frame can be unpacked again.
    pub fn unpack(&mut self, frame: &CellFrame, codes: &mut [u16]) -> Option<()> {
        if frame.sequence.is_multiple_of(KEY_INTERVAL) {
            self.codes = [0; DEVICE_CELLS];
        } else if frame.sequence != self.sequence {
            return None;
        }
        // If this frame cannot be unpacked, only a key frame can be unpacked next.
        self.sequence = 0;
        let mut reader = BitReader::new(&frame.packed);
        let (bits, shift) = (self.resolution.bits(), self.resolution.shift());
        let mut sum = 0u16;
        for (codes, before) in codes.chunks_mut(GROUP).zip(self.codes.chunks_mut(GROUP)) {
            let width = reader.pull(WIDTH_BITS)?;
            for (code, before) in codes.iter_mut().zip(before) {
                *before = match width {
                    PLAIN => reader.pull(bits)? as u16,
                    width => before.wrapping_add_signed(unzigzag(reader.pull(width)?) as i16),
                };
                sum = sum.wrapping_add(*before);
                *code = *before << shift;
            }
        }
        let is_whole = reader.is_at_end() && sum == frame.sum;
        if is_whole {
            self.sequence = frame.sequence.wrapping_add(1);
        }
        is_whole.then_some(())
    }
}

/// The fields of a packed frame that describe its packed codes.
pub(super) struct Packed {
    /// Number of the frame in its stream.
    pub sequence: u32,
    /// See [`CellFrame::sum`].
    pub sum: u16,
    /// Length of the packed codes, bytes.
    pub len: usize,
}

/// Packs the first `count` codes of a group, in `BITS` bits, as differences from the codes `before`, which they replace. Returns
/// their sum.
#[inline(always)]
fn pack_group<const BITS: u32>(
    writer: &mut BitWriter,
    codes: &[u16; GROUP],
    count: usize,
    before: &mut [u16; GROUP],
) -> u32 {
    let shift = 16 - BITS;
    let mut numbers = [0u32; GROUP];
    let (mut all_bits, mut sum) = (0, 0);
    for ((number, &code), before) in numbers.iter_mut().zip(codes).zip(before) {
        let code = code >> shift;
        *number = zigzag(i32::from(code) - i32::from(*before));
        all_bits |= *number;
        sum += u32::from(code);
        *before = code;
    }
    let width = u32::BITS - all_bits.leading_zeros();
    if width >= PLAIN.min(BITS) {
        writer.push(PLAIN, WIDTH_BITS);
        codes[..count].iter().for_each(|&code| writer.push(u32::from(code >> shift), BITS));
        return sum;
    }
    match width {
        0 => writer.push(0, WIDTH_BITS),
        // The numbers of a group are pushed in two parts of up to 16 bits, which takes fewer instructions than single numbers.
        1..=3 if count == GROUP => {
            let [a, b, c, d, e, f, g, h] = numbers;
            let four = |[a, b, c, d]: [u32; 4]| (a | b << width) | (c | d << width) << (2 * width);
            writer.push(width | four([a, b, c, d]) << WIDTH_BITS, WIDTH_BITS + 4 * width);
            writer.push(four([e, f, g, h]), 4 * width);
        }
        _ => {
            writer.push(width, WIDTH_BITS);
            numbers[..count].iter().for_each(|&number| writer.push(number, width));
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::gatt::CAPACITY;

    #[test]
    fn unpacked_codes_equal_the_packed_codes() {
        let mut random = 1u32;
        for resolution in [Resolution::Converter, Resolution::Oversampled] {
            for cells in [1, 7, 8, 240, DEVICE_CELLS] {
                let (mut packer, mut unpacker) = (CellCoder::new(resolution), CellCoder::new(resolution));
                let mut codes = [0u16; DEVICE_CELLS];
                for scan in 0..3 * KEY_INTERVAL {
                    for code in &mut codes {
                        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                        let change = (random >> 16) as u16;
                        *code = if scan % 7 == 0 { change } else { code.wrapping_add(change >> (scan % 16)) };
                    }
                    let frame = packer.pack(scan, 0, &codes[..cells]);
                    let mut unpacked = [0; DEVICE_CELLS];
                    unpacker.unpack(&frame, &mut unpacked[..cells]).expect("a frame of this stream");
                    let mask = u16::MAX << resolution.shift();
                    assert!(codes[..cells].iter().zip(&unpacked).all(|(code, unpacked)| code & mask == *unpacked));
                }
            }
        }
    }

    #[test]
    fn after_a_lost_frame_the_next_key_frame_can_be_unpacked() {
        let (mut packer, mut unpacker) = (CellCoder::new(Resolution::Converter), CellCoder::new(Resolution::Converter));
        let mut unpacked = [0; 16];
        for scan in 0..2 * KEY_INTERVAL {
            let frame = packer.pack(scan, 0, &[scan as u16 * 100; 16]);
            if scan != 3 {
                let is_unpacked = unpacker.unpack(&frame, &mut unpacked).is_some();
                assert_eq!(is_unpacked, !(3..KEY_INTERVAL).contains(&scan), "frame {scan}");
            }
        }
    }

    /// A serial port at 460,800 bit/s: a byte is ten bits.
    const SERIAL: Capacity = Capacity::of_bytes(46_080);

    #[test]
    fn a_serial_port_sends_240_cells_at_100_hz_and_offers_less_at_400_hz() {
        let stream = CellStream { resolution: Resolution::Converter, every: 1 };
        assert_eq!(stream.fitting(240, 10_000, SERIAL), Some(1));
        // 36.8 kB/s of live frames leave 9.28 kB/s: almost 39 messages of 238 bytes a second.
        assert_eq!(stream.fitting(240, 2_500, SERIAL), Some(11));
        let slow = Capacity::of_bytes(960);
        assert_eq!(stream.fitting(240, 10_000, slow), None, "9,600 bit/s are too slow for live frames");
    }

    #[test]
    fn bluetooth_sends_133_values_per_second_and_no_value_has_parts_of_two_messages() {
        let of_bits = |resolution| CellStream { resolution, every: 1 };
        let [short, long] = [Resolution::Converter, Resolution::Oversampled].map(of_bits);
        // At 100 Hz, live frames leave 33 values per second. A frame of cells with 12 bits, 238 bytes, takes one of them; one
        // with 16 bits, 310 bytes, takes two.
        assert_eq!(short.fitting(240, 10_000, CAPACITY), Some(4));
        assert_eq!(long.fitting(240, 10_000, CAPACITY), Some(7));
        // At 50 Hz, they leave 83.
        assert_eq!(short.fitting(240, 20_000, CAPACITY), Some(1));
        assert_eq!(long.fitting(240, 20_000, CAPACITY), Some(2));
        assert_eq!(short.fitting(8, 7_500, CAPACITY), None, "live frames take all 133 values");
    }
}

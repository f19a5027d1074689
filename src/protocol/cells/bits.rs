//! Numbers of a few bits, one after the other in bytes, from the least significant bit of each byte on.

use super::MAX_PACKED;

/// Writes numbers of up to 16 bits. The low `bits` bits of `pending` are not written yet.
pub struct BitWriter<'b> {
    units: core::slice::IterMut<'b, [u8; 2]>,
    pending: u32,
    bits: u32,
}

impl<'b> BitWriter<'b> {
    /// A writer into `packed`.
    #[inline(always)]
    pub fn new(packed: &'b mut [u8; MAX_PACKED]) -> Self {
        Self { units: packed.as_chunks_mut().0.iter_mut(), pending: 0, bits: 0 }
    }

    /// Adds a number of `width` bits.
    #[inline(always)]
    pub fn push(&mut self, value: u32, width: u32) {
        // Fewer than 16 bits are pending, so 32 bits can hold the pending bits and the number.
        self.pending |= value << self.bits;
        self.bits += width;
        if self.bits >= 16 {
            self.flush();
            self.pending >>= 16;
            self.bits -= 16;
        }
    }

    /// Writes a unit of 16 bits. `units` has room for it, because the longest frame fits into MAX_PACKED bytes.
    #[inline(always)]
    fn flush(&mut self) {
        if let Some(unit) = self.units.next() {
            *unit = (self.pending as u16).to_le_bytes();
        }
    }

    /// Writes the pending bits; returns the length of the frame, bytes.
    pub fn finish(mut self) -> usize {
        self.flush();
        MAX_PACKED - 2 * self.units.len() - (2 - self.bits.div_ceil(8) as usize)
    }
}

/// Reads the numbers that a [`BitWriter`] wrote. The low `bits` bits of `pending` were read from `bytes` and not returned yet.
pub struct BitReader<'b> {
    bytes: &'b [u8],
    pending: u32,
    bits: u32,
}

impl<'b> BitReader<'b> {
    /// A reader of the numbers in `bytes`.
    pub fn new(bytes: &'b [u8]) -> Self {
        Self { bytes, pending: 0, bits: 0 }
    }

    /// Returns the next number, which has `width` bits; `None` if fewer bits are left.
    pub fn pull(&mut self, width: u32) -> Option<u32> {
        while self.bits < width {
            let (&byte, rest) = self.bytes.split_first()?;
            self.pending |= u32::from(byte) << self.bits;
            (self.bytes, self.bits) = (rest, self.bits + 8);
        }
        let value = self.pending & ((1 << width) - 1);
        self.pending >>= width;
        self.bits -= width;
        Some(value)
    }

    /// True if all bytes were read, and no bit that was not returned is set.
    pub fn is_at_end(&self) -> bool {
        self.bytes.is_empty() && self.pending == 0
    }
}

/// The number that stands for a difference: 0, 1, 2, 3, ... stand for 0, -1, 1, -2, ...
#[inline(always)]
pub fn zigzag(difference: i32) -> u32 {
    ((difference << 1) ^ (difference >> 31)) as u32
}

/// The difference for which a number stands; the inverse of [`zigzag`].
pub fn unzigzag(number: u32) -> i32 {
    (number >> 1) as i32 ^ -((number & 1) as i32)
}

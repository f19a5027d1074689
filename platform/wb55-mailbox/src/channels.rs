//! The interrupts of the six channels between the cores (IPCC). In the registers, bit i stands for channel i + 1. In the mask
//! register, bit i masks the interrupt of a channel that the other core has filled, and bit 16 + i that of a channel to the
//! other core that is empty.
//!
//! An interrupt that is not masked is due as long as its channel is in this state. The handler therefore masks each interrupt
//! that is due; otherwise the same interrupt would occur again at once, without end.

/// Number of channels in each direction.
pub const CHANNELS: usize = 6;

/// All channels.
const ALL: u32 = (1 << CHANNELS) - 1;
/// Position of the masks of emptied channels in the mask register.
const EMPTIED: u32 = 16;

/// The value of this core's mask register, C1MR: a set bit masks an interrupt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Masks(pub u32);

impl Masks {
    /// Masks the due interrupts of channels that the other core has filled, and returns these channels. `filled` is C2TOC1SR.
    pub fn take_filled(&mut self, filled: u32) -> u32 {
        let due = filled & !self.0 & ALL;
        self.0 |= due;
        due
    }

    /// Masks the due interrupts of channels that the other core has emptied, and returns these channels. `filled` is C1TOC2SR.
    pub fn take_emptied(&mut self, filled: u32) -> u32 {
        let due = !filled & !(self.0 >> EMPTIED) & ALL;
        self.0 |= due << EMPTIED;
        due
    }

    /// Unmasks the interrupt that occurs once the other core has filled this channel, a number below [`CHANNELS`].
    pub fn await_filled(&mut self, channel: usize) {
        self.0 &= !(1 << channel);
    }

    /// Unmasks the interrupt that occurs once the other core has emptied this channel, a number below [`CHANNELS`].
    pub fn await_emptied(&mut self, channel: usize) {
        self.0 &= !(1 << channel << EMPTIED);
    }
}

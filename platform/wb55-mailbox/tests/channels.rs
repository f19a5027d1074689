//! The interrupts of the mailbox, compared with a model of the peripheral by RM0434, section IPCC.

use wb55_mailbox::channels::{CHANNELS, Masks};

/// The registers of the first core.
struct Ipcc {
    /// C1MR: bits 0 to 5 mask the interrupts of filled receive channels, bits 16 to 21 those of free transmit channels.
    masks: u32,
    /// C2TOC1SR: bits of the channels that the second core has filled.
    received: u32,
    /// C1TOC2SR: bits of the channels that the first core has filled.
    sent: u32,
}

impl Ipcc {
    /// The channels that assert the interrupt line of reception.
    fn receive_line(&self) -> u32 {
        (0..6).filter(|i| self.received >> i & 1 == 1 && self.masks >> i & 1 == 0).fold(0, |line, i| line | 1 << i)
    }

    /// The channels that assert the interrupt line of transmission.
    fn transmit_line(&self) -> u32 {
        (0..6).filter(|i| self.sent >> i & 1 == 0 && self.masks >> (16 + i) & 1 == 0).fold(0, |line, i| line | 1 << i)
    }
}

/// An interrupt line that remained asserted would call the handler without end, and stop everything below its priority.
#[test]
fn one_call_of_a_handler_releases_its_interrupt_line() {
    for flags in 0..1 << 6 {
        for masked in 0..1 << 6 {
            let mut ipcc = Ipcc { masks: masked | !masked << 16, received: flags, sent: flags };
            let (received, emptied) = (ipcc.receive_line(), ipcc.transmit_line());
            let mut masks = Masks(ipcc.masks);
            assert_eq!(masks.take_filled(flags), received, "every due channel must be reported");
            ipcc.masks = masks.0;
            assert_eq!((ipcc.receive_line(), ipcc.transmit_line()), (0, emptied));
            assert_eq!(masks.take_emptied(flags), emptied, "every due channel must be reported");
            ipcc.masks = masks.0;
            assert_eq!((ipcc.receive_line(), ipcc.transmit_line()), (0, 0));
        }
    }
}

/// This includes the last channel, number 6: the firmware waits until it is empty before it sends the next data packet.
#[test]
fn each_channel_asserts_its_line_once_it_is_awaited_and_changes() {
    assert_eq!(CHANNELS, 6);
    for channel in 0..6 {
        let mut masks = Masks(u32::MAX);
        masks.await_filled(channel);
        masks.await_emptied(channel);
        for flags in [0, 1 << channel, !(1 << channel), u32::MAX] {
            let ipcc = Ipcc { masks: masks.0, received: flags, sent: flags };
            let is_filled = flags >> channel & 1 == 1;
            assert_eq!(ipcc.receive_line(), u32::from(is_filled) << channel);
            assert_eq!(ipcc.transmit_line(), u32::from(!is_filled) << channel);
        }
    }
}

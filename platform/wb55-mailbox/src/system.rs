//! Events and replies of the radio's core on the system channel, as STM32CubeWB's shci.h and tl.h define them.

/// H4 byte of a reply to a system command.
const REPLY: u8 = 0x11;
/// H4 byte of a system event.
const EVENT: u8 = 0x12;
/// Codes of a completed command and of a vendor's event.
const COMMAND_COMPLETE: u8 = 0x0e;
const VENDOR: u8 = 0xff;
/// Codes of vendor's events: the core has started (SHCI_SUB_EVT_CODE_READY), and an error (SHCI_SUB_EVT_ERROR_NOTIF).
const READY: u16 = 0x9200;
const ERROR: u16 = 0x9201;

/// An event of the radio's core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SystemEvent {
    /// The wireless firmware runs.
    Ready,
    /// ST's update service (FUS) runs instead of the wireless firmware: none is installed, or an installation is not complete.
    UpdateService,
    /// The radio's core reports an error with this code.
    Error(u8),
    /// Another event, by its code.
    Other(u16),
}

impl SystemEvent {
    /// Decodes a packet, from its H4 byte on; `None` if it is not a system event.
    pub fn decode(packet: &[u8]) -> Option<Self> {
        let &[EVENT, VENDOR, _, low, high, ref parameters @ ..] = packet else { return None };
        Some(match (u16::from_le_bytes([low, high]), parameters) {
            (READY, [0, ..]) => Self::Ready,
            (READY, _) => Self::UpdateService,
            (ERROR, &[code, ..]) => Self::Error(code),
            (code, _) => Self::Other(code),
        })
    }
}

/// The status in the reply to the command `opcode`, 0 for success; `None` if the packet, from its H4 byte on, is not such a
/// reply.
pub fn reply_status(packet: &[u8], opcode: u16) -> Option<u8> {
    match packet {
        &[REPLY, COMMAND_COMPLETE, _, _, low, high, status, ..] if u16::from_le_bytes([low, high]) == opcode => {
            Some(status)
        }
        _ => None,
    }
}

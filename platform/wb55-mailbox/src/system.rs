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

/// Why the radio's core stopped: it then writes a word over the first one of the mailbox, which remains after a reset. ST's
/// documents do not define these words; they are those of reports in ST's forum
/// (<https://community.st.com/t5/stm32-mcus-wireless/stm32wb-cpu2-hard-fault-in-hci-stack-variants-in-v1-20-0/td-p/709479>).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CoreStop {
    /// A hard fault. The second word of the mailbox is the program counter, the third one the link register.
    Fault,
    /// The core has detected what it takes for an attack, such as an access to its memory.
    Attack,
}

impl CoreStop {
    /// The meaning of the first word of the mailbox; `None` if the core has not stopped.
    pub fn of(first_word: u32) -> Option<Self> {
        match first_word {
            0x1170_fd0f => Some(Self::Fault),
            0x3de9_6f61 => Some(Self::Attack),
            _ => None,
        }
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

//! The first message of every session.

use crate::pipeline::contact::ContactRule;
use crate::pipeline::region::Side;
use heapless::String;
use serde::{Deserialize, Serialize};

/// Longest text of [`Hello::fault`], bytes.
pub const MAX_FAULT_TEXT: usize = 96;

/// Identifies the insole. The encoding of this message never changes, nor do those of [`Side`], [`ContactRule`] and [`Reset`]
/// within it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// Major protocol version of the insole.
    pub major: u8,
    /// Minor protocol version of the insole.
    pub minor: u8,
    /// Firmware version.
    pub firmware: String<16>,
    /// Board name.
    pub board: String<16>,
    /// Foot.
    pub side: Side,
    /// Identifies the layout, and the settings if any are stored.
    pub layout_id: u32,
    /// Number of cells; 0 if the set-up of the board was refused.
    pub cells: u16,
    /// Time between frames, us.
    pub period_us: u32,
    /// Identifies the wearer's parameters; 0 without any.
    pub tissue_id: u32,
    /// The rule that determines contact areas.
    pub contact_rule: ContactRule,
    /// Why the insole last started.
    pub reset: Reset,
    /// If a failure ended the previous run: its cause, its time, and addresses in the program, which `cargo xtask explain`
    /// translates to source lines. In recovery mode, after several failed starts in a row, the text begins with the word
    /// "recovery"; the insole then ignores the stored data, except the bonds in the first such start. Without such a failure:
    /// a fault of this start, such as a chip that does not answer, or stored parameters of another contact rule. If the set-up
    /// of the board was refused, [`Hello::cells`] is 0, and the insole does not measure.
    pub fault: Option<String<MAX_FAULT_TEXT>>,
}

/// Why an insole started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Reset {
    /// Power-on or brown-out.
    Power,
    /// The reset pin.
    Pin,
    /// Requested by the software.
    Software,
    /// The watchdog: a part of the firmware was stalled, such as scanning or the link, or interrupts stayed disabled.
    Watchdog,
    /// After a panic, a hard fault or a stack overflow; see [`Hello::fault`].
    Panic,
    /// None of these.
    Unknown,
}

impl Reset {
    /// One word, lower case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Power => "power",
            Self::Pin => "pin",
            Self::Software => "software",
            Self::Watchdog => "watchdog",
            Self::Panic => "panic",
            Self::Unknown => "unknown",
        }
    }
}

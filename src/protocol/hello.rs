//! The first message of every session.

use crate::pipeline::contact::ContactRule;
use crate::pipeline::region::Side;
use heapless::String;
use serde::{Deserialize, Deserializer, Serialize};

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
    #[serde(deserialize_with = "printable")]
    pub firmware: String<16>,
    /// Board name.
    #[serde(deserialize_with = "printable")]
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
    /// "recovery"; the insole then ignores the stored data, except the bonds in the first such start. After several stalls of the
    /// radio, it states that Bluetooth starts an hour later. Except in recovery mode, a flash chip that cannot be used takes
    /// precedence: the text states that nothing is stored. Without any of these: another fault of this start, such as stored
    /// parameters of another contact rule. If the set-up of the board was refused, [`Hello::cells`] is 0, and the insole does not
    /// measure.
    #[serde(deserialize_with = "printable_option")]
    pub fault: Option<String<MAX_FAULT_TEXT>>,
}

/// Decodes a text. Control characters, which would have an effect on the terminal of a host that prints the text, become question
/// marks.
fn printable<'de, const N: usize, D: Deserializer<'de>>(deserializer: D) -> Result<String<N>, D::Error> {
    String::deserialize(deserializer).map(|text| without_control_characters(&text))
}

/// As [`printable`], for an optional text.
fn printable_option<'de, const N: usize, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String<N>>, D::Error> {
    let text: Option<String<N>> = Option::deserialize(deserializer)?;
    Ok(text.map(|text| without_control_characters(&text)))
}

fn without_control_characters<const N: usize>(text: &String<N>) -> String<N> {
    let mut printable = String::new();
    for character in text.chars() {
        // A question mark is not longer than the character that it replaces, so all of them fit.
        let _ = printable.push(if character.is_control() { '?' } else { character });
    }
    printable
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

//! The identity of an insole: foot, serial number and calibration.

use crate::pipeline::region::Side;
use serde::{Deserialize, Serialize};

/// The stored identity of an insole. A change is in force from the next start of the insole on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// The foot.
    pub side: Side,
    /// The serial number.
    pub serial: Serial,
    /// Identifies the calibration of the cells; 0 stands for the built-in calibration.
    pub calibration_id: u32,
}

/// A serial number: up to 16 printable ASCII characters without spaces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Serial([u8; 16]);

impl Serial {
    /// No serial number.
    pub const NONE: Self = Self([0; 16]);

    /// True if the 16 bytes are printable ASCII characters without spaces, followed by zeros only.
    pub fn is_valid(&self) -> bool {
        self.0.iter().skip(self.as_str().len()).all(|byte| *byte == 0)
    }

    /// The serial number `text`; `None` if `text` is longer than 16 characters, or contains a space or a character that is not
    /// printable ASCII.
    pub fn new(text: &str) -> Option<Self> {
        let mut serial = Self::default();
        let is_printable = text.bytes().all(|byte| byte.is_ascii_graphic());
        serial.0.get_mut(..text.len()).filter(|_| is_printable)?.copy_from_slice(text.as_bytes());
        Some(serial)
    }

    /// The text; empty for an insole without a serial number.
    pub fn as_str(&self) -> &str {
        let len = self.0.iter().take_while(|byte| byte.is_ascii_graphic()).count();
        // Printable ASCII is UTF-8.
        core::str::from_utf8(&self.0[..len]).unwrap_or_default()
    }
}

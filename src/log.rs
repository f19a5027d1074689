//! Log messages of the firmware: `defmt` where the board has a logger, nothing elsewhere.

#[cfg(feature = "defmt")]
pub(crate) use defmt::{error, info, warn};

/// Discards a message, but uses its arguments.
#[cfg(not(feature = "defmt"))]
macro_rules! discard {
    ($text:literal $(, $argument:expr)* $(,)?) => {{
        let _ = $text;
        $(let _ = &$argument;)*
    }};
}

#[cfg(not(feature = "defmt"))]
pub(crate) use {discard as error, discard as info, discard as warn};

//! Log messages of the firmware. They are written by `defmt` if the board has a logger, and discarded otherwise.

#[cfg(feature = "defmt")]
pub(crate) use defmt::{error, info, warn};

/// Discards a message, but uses its arguments, so that the compiler does not report them as unused.
#[cfg(not(feature = "defmt"))]
macro_rules! discard {
    ($text:literal $(, $argument:expr)* $(,)?) => {{
        let _ = $text;
        $(let _ = &$argument;)*
    }};
}

#[cfg(not(feature = "defmt"))]
pub(crate) use {discard as error, discard as info, discard as warn};

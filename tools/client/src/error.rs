//! Why no session could be opened, why a session ended, or why a request failed.

use plantar::protocol::{MAJOR, MINOR, Refusal};
use std::io;
use std::time::Duration;
use thiserror::Error;

/// Why no session could be opened, why a session ended, or why a request failed.
#[derive(Debug, Error)]
pub enum Error {
    /// The carrier, that is the serial port, the network connection or the Bluetooth link, could not be opened.
    #[error(transparent)]
    Open(Box<dyn std::error::Error + Send + Sync>),
    /// No answer to a connect request within this time; and the number of damaged frames that have arrived so far, also before
    /// the request.
    #[error(
        "no insole answered within {seconds} s ({1} damaged or unknown frames): another program may be connected to it, which \
         must be closed first; if frames were damaged or unknown, its firmware may be older or newer than this program, or the \
         bit rate is another one; otherwise check the port and the wiring (docs/hardware.md)",
        seconds = .0.as_secs_f64()
    )]
    NoAnswer(Duration, u32),
    /// No answer to another request within this time; and the number of damaged frames that have arrived so far, also before the
    /// request.
    #[error(
        "the insole, which had answered before, did not answer a request within {seconds} s ({1} damaged or unknown frames): \
         move closer to it, or check the cable; if the request changed something, it may have been executed nevertheless",
        seconds = .0.as_secs_f64()
    )]
    LostAnswer(Duration, u32),
    /// The insole was expected to restart. It answers, but did not restart within the expected time: that of the request, or
    /// that of the [`ReconnectPolicy`](crate::ReconnectPolicy).
    #[error("the insole answers, but it has not restarted")]
    NotRestarted,
    /// The other end closed the link before the insole answered, as a bridge with another client does.
    #[error(
        "the link was closed before an insole answered: another program may be connected to it, which must be closed first"
    )]
    Closed(#[source] io::Error),
    /// The insole uses another major version of the protocol.
    #[error(
        "the insole (firmware {firmware}) uses protocol {major}.{minor}, this program uses {MAJOR}.{MINOR}: {remedy}",
        remedy = remedy_of_version(*major)
    )]
    OtherVersion {
        /// Version of its firmware.
        firmware: String,
        /// Major version of its protocol.
        major: u8,
        /// Minor version of its protocol.
        minor: u8,
    },
    /// The insole refused the request.
    #[error("the insole refused: {0}")]
    Refused(Refusal),
    /// The carrier failed.
    #[error("the link to the insole failed")]
    Carrier(#[from] io::Error),
}

/// The remedy for an insole with this other major version of the protocol. A program cannot update the firmware of an insole with
/// an older protocol, because it cannot open a session.
fn remedy_of_version(major: u8) -> &'static str {
    if major < MAJOR {
        "this program is newer and cannot update the insole: receive the stored steps with a program of the insole's version, \
         then flash newer firmware over the debug port (CHANGELOG.md)"
    } else {
        "install a newer version of this program"
    }
}

impl Error {
    /// True if the link failed, or another host has taken the session: opening it again can help, immediately or later.
    pub fn is_link_failure(&self) -> bool {
        matches!(
            self,
            Self::Open(_)
                | Self::NoAnswer(..)
                | Self::LostAnswer(..)
                | Self::Closed(_)
                | Self::Carrier(_)
                | Self::Refused(Refusal::OtherHost)
        )
    }
}

//! How long a central may occupy the insole, which serves one central at a time, without an encrypted link.
//!
//! The limits shorten the time for which a stranger's connection delays the owner's phone. They do not ensure that the phone can
//! connect: a stranger that is the first to connect whenever the insole advertises denies the link for as long as it does so. The
//! insole stores its steps meanwhile.

use embassy_time::{Duration, Instant};

/// Time that a central has to encrypt the link, or to pair.
const ENCRYPTION: Duration = Duration::from_secs(30);
/// Time that a suspected central has to encrypt the link: one without a bond, while bonding is not allowed, within [`SUSPICION`]
/// after a central occupied the insole. The time is short, so that the insole advertises more often and the owner's phone can
/// connect.
const SUSPECTED: Duration = Duration::from_secs(2);
/// Time for which centrals without a bond are suspected after a central occupied the insole.
const SUSPICION: Duration = Duration::from_secs(300);
/// A central that was connected for this time, without an encrypted link and a bond, has occupied the insole, also if it
/// disconnected itself: otherwise it could do so shortly before each time limit, and connect again. Shorter connections, as of a
/// scanner that looks for devices, raise no suspicion.
const OCCUPIED: Duration = Duration::from_secs(1);

/// Limits the connections without an encrypted link.
#[derive(Default)]
pub struct Admission {
    /// Time until which centrals without a bond are suspected; `None` if no central has occupied the insole yet.
    suspicious_until: Option<Instant>,
}

impl Admission {
    /// No central has occupied the insole yet.
    pub const fn new() -> Self {
        Self { suspicious_until: None }
    }

    /// Time after the connection within which a central must have an encrypted link and a bond. `is_known` states that the
    /// central has a bond, `allows_bonding` that it may make one now.
    pub fn time_limit(&self, is_known: bool, allows_bonding: bool) -> Duration {
        let is_suspected = self.suspicious_until.is_some_and(|until| Instant::now() < until);
        if is_suspected && !is_known && !allows_bonding { SUSPECTED } else { ENCRYPTION }
    }

    /// Records the end of a connection after this time. `was_admitted` states that the central had an encrypted link and a bond.
    /// Only a connection without them that lasted for at least one second has an effect.
    pub fn ended(&mut self, after: Duration, was_admitted: bool) {
        if !was_admitted && after >= OCCUPIED {
            self.suspicious_until = Some(Instant::now() + SUSPICION);
        }
    }
}

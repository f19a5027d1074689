//! How long a central may occupy the insole, which serves one central at a time, without an encrypted link.

use embassy_time::{Duration, Instant};

/// Time that a central has to encrypt the link, or to pair.
const ENCRYPTION: Duration = Duration::from_secs(30);
/// Time that a suspected central has to encrypt the link: one without a bond, while bonding is not allowed, within [`SUSPICION`]
/// after a central exceeded its time limit. The time is short, so that the owner's phone can connect soon.
const SUSPECTED: Duration = Duration::from_secs(2);
/// Time for which centrals without a bond are suspected after a central exceeded its time limit.
const SUSPICION: Duration = Duration::from_secs(300);

/// Limits the connections without an encrypted link.
#[derive(Default)]
pub struct Admission {
    /// Time until which centrals without a bond are suspected; `None` if no central has exceeded its limit yet.
    suspicious_until: Option<Instant>,
}

impl Admission {
    /// No central has exceeded its limit yet.
    pub const fn new() -> Self {
        Self { suspicious_until: None }
    }

    /// Time after the connection within which a central must have an encrypted link and a bond. `is_known` states that the
    /// central has a bond, `allows_bonding` that it may make one now.
    pub fn time_limit(&self, is_known: bool, allows_bonding: bool) -> Duration {
        let is_suspected = self.suspicious_until.is_some_and(|until| Instant::now() < until);
        if is_suspected && !is_known && !allows_bonding { SUSPECTED } else { ENCRYPTION }
    }

    /// Records that a central was disconnected because it exceeded its time limit.
    pub fn expelled(&mut self) {
        self.suspicious_until = Some(Instant::now() + SUSPICION);
    }
}
